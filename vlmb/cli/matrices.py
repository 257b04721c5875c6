"""`vlmb matrices`: blocks of the equations of motion."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from vlmb.cli.terminal import apart
from vlmb.equations import matrices
from vlmb.equations.motion import FORMS
from vlmb.errors import VlmbError
from vlmb.simulation.files import replacing, write_text

WHAT = "print the blocks of the equations of motion (4.1) in a posture, without the scene's forces and constraints"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("scene", nargs="?", help="scene file (.toml) or model")
    parser.add_argument(
        "--at", action="append", nargs="+", metavar="NAME=VALUE", default=[],
        help="coordinates and rates that differ from the scene's start, e.g. psi1=1.2 legs.azimuth_dot=0.5 speed=8 [m, rad, s]",
    )  # fmt: skip
    parser.add_argument(
        "--block", action="append", nargs="+", metavar="NAME", default=[],
        help="A B C1 C2 D E F1 F2 G H1 H2 K; X Y PHI0 and others for a base; mass_matrix, bias; W, w, supported_mass_matrix, "
        "supported_bias for a phase (default: every block)",
    )  # fmt: skip
    parser.add_argument(
        "--closed", action="append", nargs="+", metavar="CONTACT", default=[],
        help="contacts that hold: the rows W of that phase, and the matrix of the chain on the first of them",
    )  # fmt: skip
    parser.add_argument("--form", choices=FORMS, default="full", help="which form of the equations of a ski (default: full)")
    parser.add_argument("--format", choices=matrices.FORMATS, default="text", help="format of the output (default: text)")
    parser.add_argument("-o", "--output", type=Path, help="file to write instead of printing")


def settle(args: argparse.Namespace, parser: argparse.ArgumentParser) -> None:
    """Give the scene back that `--block` or `--at` swallowed."""
    scenes = [args.scene] if args.scene else []
    for name in ("block", "at", "closed"):
        groups = [apart([], group) for group in getattr(args, name)]
        scenes += [file for files, _ in groups for file in files]
        setattr(args, name, [names or [] for _, names in groups])
    if len(scenes) != 1:
        parser.error(f"more than one scene: {', '.join(scenes)}" if scenes else "the following arguments are required: scene")
    args.scene = scenes[0]


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    wanted = [entry for group in args.block for entry in group]
    with np.errstate(all="ignore"):
        closed = [entry for group in args.closed for entry in group]
        eom = matrices.at_posture(args.scene, [entry for group in args.at for entry in group], args.form, closed)
        found = matrices.tables(eom, wanted)
    if not all(np.isfinite(table.values).all() for table in found):
        raise VlmbError("entries of the blocks overflow at this posture: a length or rate in --at is too large")
    if args.format == "npz":
        if args.output is None:
            raise VlmbError("--format npz: a binary file needs --output FILE")
        with replacing(args.output) as beside, beside.open("wb") as file:
            np.savez(file, **matrices.arrays(eom, wanted))  # type: ignore[arg-type]
    else:
        content = {"text": matrices.text, "latex": matrices.latex, "csv": matrices.comma_separated}[args.format](eom, found)
        if args.output is None:
            print(content, end="")
            return 0
        write_text(args.output, content)
    print(f"wrote {args.output}")
    return 0
