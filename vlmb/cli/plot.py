"""`vlmb plot`: figures of stored runs."""

from __future__ import annotations

import argparse
from pathlib import Path

from vlmb.cli.output import wrote
from vlmb.cli.terminal import apart
from vlmb.simulation.loading import load_trajectory

WHAT = "draw the plots of stored runs; several runs share one figure"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("runs", nargs="*", help="stored runs (.npz)")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="figures, e.g. path energy (default: all that apply)")
    parser.add_argument("--dark", action="store_true", help="draw on a dark background")
    parser.add_argument("-o", "--output", type=Path, default=Path("plots"), help="folder for the pictures (default: plots)")


def settle(args: argparse.Namespace, parser: argparse.ArgumentParser) -> None:
    """Give runs back that `--only` swallowed."""
    args.runs, args.only = apart(args.runs, args.only)
    if not args.runs:
        parser.error("the following arguments are required: runs")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    from vlmb.views.plots import save_all

    runs = [load_trajectory(path) for path in args.runs]
    written = save_all(runs if len(runs) > 1 else runs[0], args.output, args.only, dark=args.dark)
    print(wrote(written))
    return 0
