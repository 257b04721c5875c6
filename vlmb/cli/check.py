"""`vlmb check`: whether a scene would run."""

from __future__ import annotations

import argparse

from vlmb.simulation.simulate import check

WHAT = "validate a scene without running it"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("scene", help="scene file (.toml)")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    print(f"{args.scene}: {check(args.scene).report}")
    return 0
