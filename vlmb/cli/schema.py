"""`vlmb schema`: what may stand in a scene file, for editors."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from vlmb.cli.output import wrote
from vlmb.scene.schema import scene_schema
from vlmb.simulation.files import write_text

WHAT = "print a JSON schema of scene files, so that editors complete keys and mark mistakes"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("-o", "--output", type=Path, help="file to write instead of printing, e.g. scene.schema.json")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    text = json.dumps(scene_schema(), indent=1) + "\n"
    if args.output is None:
        print(text, end="")
    else:
        print(wrote([write_text(args.output, text)]))
    return 0
