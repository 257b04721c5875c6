"""`vlmb convert`: a file in another format."""

from __future__ import annotations

import argparse
from pathlib import Path

from vlmb.errors import VlmbError
from vlmb.simulation.export import FORMATS, export
from vlmb.simulation.loading import load_trajectory

WHAT = "write a stored run as csv, nc or sto: vlmb convert run.npz run.sto"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("source", help="stored run (.npz)")
    parser.add_argument("target", type=Path, help="file to write (.csv, .nc, .sto)")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if Path(args.source).suffix == ".npz" and args.target.suffix in FORMATS:
        print(f"wrote {export(load_trajectory(args.source), args.target)}")
        return 0
    raise VlmbError(f"convert: {args.source} to {args.target}: a stored run (.npz) becomes {', '.join(FORMATS)}")
