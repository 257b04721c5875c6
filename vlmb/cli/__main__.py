"""Run the command line as `python -m vlmb.cli`."""

import sys

from vlmb.cli.program import main

sys.exit(main())
