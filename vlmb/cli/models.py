"""`vlmb models`: the scenes that come with vlmb."""

from __future__ import annotations

import argparse

from vlmb.scene.shipped import model_file, model_lines

WHAT = "list the models that come with vlmb, or print the file of one to start your own from"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("name", nargs="?", help="a model: print its scene file, e.g. vlmb models slalom > mine.toml")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if args.name:
        print(model_file(args.name).read_text(encoding="utf-8"), end="")
        return 0
    lines = model_lines()
    width = max(map(len, lines))
    for name, text in lines.items():
        print(f"{name:<{width}}  {text}")
    print("\nRun one by its name or the end of it: vlmb run slalom")
    return 0
