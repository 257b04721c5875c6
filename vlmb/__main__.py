"""Run the command line as `python -m vlmb`."""

import sys

from vlmb.cli import main

sys.exit(main())
