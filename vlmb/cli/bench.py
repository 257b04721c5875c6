"""`vlmb bench`: error against CPU time of a scene."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from vlmb.errors import VlmbError
from vlmb.scene.scene import load_scene
from vlmb.simulation.files import write_text
from vlmb.simulation.methods import METHODS
from vlmb.studies import bench
from vlmb.studies.work_precision import measure
from vlmb.views import work_precision_plots

WHAT = "measure error against CPU time for each method and form of the knife edge"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("scenes", nargs="+", metavar="SCENE", help="scene files (.toml)")
    parser.add_argument("--duration", type=float, help="[s] simulated time of each run")
    parser.add_argument("--methods", nargs="+", choices=METHODS, help="default: all")
    parser.add_argument("--repeats", type=int, default=5, help="repeats of each run; the fastest counts (default: 5)")
    parser.add_argument("--budget", type=float, default=1.0, help="[s] end a series after a run that took longer (default: 1)")
    parser.add_argument("-o", "--output", type=Path, default=Path("results/bench"), help="folder for bench.md, .json and .png")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if args.repeats < 1 or not args.budget > 0.0:
        raise VlmbError("bench: --repeats must be at least 1 and --budget positive")
    found = [
        measure(load_scene(path), args.duration, args.methods, repeats=args.repeats, budget=args.budget, progress=print)[0]
        for path in args.scenes
    ]
    args.output.mkdir(parents=True, exist_ok=True)
    where = bench.footer()
    page = "\n\n".join(["# Work and precision", *(bench.section(entry) for entry in found)])
    files = [args.output / f"bench.{end}" for end in ("md", "json", "png")]
    write_text(files[0], f"{page}\n\nMeasured by `vlmb bench` on {where}\n")
    data = {"scenes": [bench.as_data(entry) for entry in found], "machine": where}
    write_text(files[1], json.dumps(data, indent=1, allow_nan=False) + "\n")
    work_precision_plots.save(found, files[2])
    print(page)
    print("wrote " + ", ".join(map(str, files)))
    return 0
