"""The command line: a file a command, `program` what they share.

Exit codes: 0 done, 1 failed, refused, interrupted or doubtful, 2 wrong usage.
"""

from vlmb.cli.program import main, make_parser

__all__ = ["main", "make_parser"]
