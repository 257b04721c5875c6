"""`vlmb convert`: a file in another format."""

from __future__ import annotations

import argparse
from pathlib import Path

from vlmb.cli.mjcf import to_mjcf
from vlmb.errors import VlmbError
from vlmb.simulation.export import FORMATS, export
from vlmb.simulation.loading import load_trajectory

WHAT = "convert a stored run to csv, nc or sto (vlmb convert run.npz run.sto), or a scene to MJCF (vlmb convert a.toml a.xml)"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("source", help="stored run (.npz) or scene file (.toml)")
    parser.add_argument("target", type=Path, help="file to write: .csv, .nc or .sto for a run, .xml for a scene")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    source, target = Path(args.source), args.target
    if source.suffix == ".npz" and target.suffix in FORMATS:
        print(f"wrote {export(load_trajectory(args.source), target)}")
        return 0
    if source.suffix == ".toml" and target.suffix == ".xml":
        return to_mjcf(args.source, target)
    formats = ", ".join(FORMATS)
    raise VlmbError(f"{source} to {target}: a stored run (.npz) becomes {formats}, a scene (.toml) becomes MJCF (.xml)")
