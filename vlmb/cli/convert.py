"""`vlmb convert`: a file in another format."""

from __future__ import annotations

import argparse
from pathlib import Path

from vlmb.cli.mjcf import to_mjcf
from vlmb.errors import VlmbError

WHAT = "write a scene as MJCF, which MuJoCo reads: vlmb convert scene.toml scene.xml"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("source", help="scene file (.toml)")
    parser.add_argument("target", type=Path, help="file to write (.xml)")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if args.target.suffix == ".xml":
        return to_mjcf(args.source, args.target)
    raise VlmbError(f"convert: {args.source} to {args.target}: a scene (.toml) becomes MJCF (.xml)")
