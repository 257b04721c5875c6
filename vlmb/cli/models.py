"""`vlmb models`: the scenes that come with vlmb."""

from __future__ import annotations

import argparse

from vlmb.scene.shipped import model_file, model_lines

WHAT = "list the models that come with vlmb, or print one as a start for your own"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("name", nargs="?", help="print the scene file of this model, e.g. vlmb models slalom > mine.toml")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if args.name:
        print(model_file(args.name).read_text(encoding="utf-8"), end="")
        return 0
    lines = model_lines()
    width = max(map(len, lines))
    for name, text in lines.items():
        print(f"{name:<{width}}  {text}")
    print("\nRun one by its name or the end of its name: vlmb run slalom")
    return 0
