"""`vlmb run`: simulate a scene, keep the run, draw it."""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from vlmb.cli.output import results, wrote
from vlmb.errors import VlmbError
from vlmb.scene.scene import load_scene
from vlmb.simulation.facts import facts
from vlmb.simulation.keeping import keep
from vlmb.simulation.loading import load_trajectory
from vlmb.simulation.methods import METHODS
from vlmb.simulation.simulate import run_options, simulate
from vlmb.simulation.trajectory import Trajectory
from vlmb.views import view
from vlmb.views.live import Live

WHAT = "simulate a scene (or replay a stored run) and write run.npz, run.csv, plots and a page that plays the motion"
OPTIONS = ("duration", "method", "rtol", "atol", "step", "knife_edge", "gain", "engine", "max_step")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.epilog = "What is not given is taken from the scene's [run]."
    parser.add_argument("scene", help="scene file (.toml), name of a model, or stored run (.npz)")
    parser.add_argument("-o", "--output", type=Path, default=None, help="folder for the results (default: results/NAME)")
    parser.add_argument("--duration", type=float, help="[s] simulated time")
    parser.add_argument("--method", choices=METHODS, help="integration method")
    parser.add_argument("--rtol", type=float, help="relative tolerance of adaptive methods")
    parser.add_argument("--atol", type=float, help="absolute tolerance of adaptive methods")
    parser.add_argument("--step", type=float, help="[s] step of the fixed-step methods")
    parser.add_argument("--knife-edge", choices=("reduction", "multiplier", "projection"), help="how the knife edge is enforced")
    parser.add_argument("--gain", type=float, help="[1/s] how fast errors of constraints are corrected")
    parser.add_argument("--engine", choices=("auto", "core", "pinocchio"), help="engine that evaluates the motion")
    parser.add_argument("--max-step", type=float, metavar="S", help="[s] longest step of adaptive methods")
    parser.add_argument("--no-plots", action="store_true", help="write no pictures and no run.html")
    parser.add_argument("--view", action="store_true", help="show the motion in the browser while it is computed")
    parser.add_argument("--json", action="store_true", help="print results as JSON instead of text")
    parser.add_argument("--verbose", action="store_true", help="print vlmb's log to stderr")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    path, times, t0 = Path(args.scene), None, 0.0
    changes = {key: getattr(args, key) for key in OPTIONS}
    if path.suffix == ".npz":
        stored = load_trajectory(path)
        if stored.input_names:
            raise VlmbError(f"{path}: this run used a Python control function, which is not stored, so it cannot be replayed")
        scene, t0 = stored.scene.changed(run=stored.run), stored.t0
        if stored.status == "finished" and args.duration is None:
            times = stored.t
    else:
        scene = load_scene(path)
    run = run_options(scene, **changes)
    if args.view:
        view.need_display()
    folder = args.output or _folder_of(path)
    watched = Live(scene, changes, browser=True) if args.view else None
    watch = watched.take if watched else None
    if folder.exists() and not folder.is_dir():
        raise VlmbError(f"--output {folder}: must be a folder for the results; there is a file of this name")
    made = [part for part in (folder, *folder.parents) if not part.exists()]
    folder.mkdir(parents=True, exist_ok=True)  # before the run: nothing computed shall be lost
    try:
        with _log_shown(args.verbose):
            kept = keep(
                lambda: _with_progress(
                    lambda tell: simulate(scene, **changes, t_eval=times, t0=t0, progress=lambda t: tell(t - t0), watch=watch),
                    run.duration,
                    args.quiet,
                ),
                folder,
            )
    except BaseException:
        if watched:
            watched.close()
        _remove(made)
        raise
    trajectory, written, ended = kept.trajectory, kept.written, kept.ended
    for sentence in kept.said:
        print(f"vlmb run: {sentence}", file=sys.stderr)
    if not args.json:
        print(trajectory.summary(), results(trajectory), sep="\n\n")
    if not (args.no_plots or ended):
        try:
            for what, draw in (("plots", _draw), ("run.html", _page)):
                try:
                    written += draw(trajectory, folder)
                except VlmbError as error:
                    print(f"no {what}: {error}", file=sys.stderr)
        except KeyboardInterrupt:
            ended = True
    if ended and not args.no_plots:
        print("vlmb run: interrupted: pictures in this folder may be those of an earlier run", file=sys.stderr)
    print(json.dumps({**facts(trajectory), "files": [str(file) for file in written]}, indent=1) if args.json else wrote(written))
    if watched and (ended or kept.error is not None):
        watched.close()
    if kept.error is not None:
        raise kept.error
    if watched and not ended:
        view.keep(watched.finish(trajectory))
    return 0 if trajectory.status in ("finished", "stopped") and not (trajectory.doubts or ended or kept.said) else 1


@contextlib.contextmanager
def _log_shown(wanted: bool) -> Iterator[None]:
    """Let the log of vlmb be printed on stderr, if that is wanted."""
    log, shown = logging.getLogger("vlmb"), logging.StreamHandler()
    shown.setFormatter(logging.Formatter("%(name)s: %(message)s"))
    before = log.level
    if wanted:
        log.addHandler(shown)
        log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(shown)
        log.setLevel(before)


def _folder_of(path: Path) -> Path:
    """Name a folder for results: by the scene under `results`; of a replay beside the folder of its run, or its file."""
    if path.suffix != ".npz":
        return Path("results") / path.stem
    source = path.parent if path.stem == "run" and path.parent.name not in ("", "..") else path.with_suffix("")
    return source.with_name(f"{source.name}_replay")


def _remove(folders: list[Path]) -> None:
    """Remove folders that were made for a run that wrote nothing."""
    for folder in folders:
        with contextlib.suppress(OSError):
            folder.rmdir()


def _draw(trajectory: Trajectory, folder: Path) -> list[Path]:
    from vlmb.views.plots import save_all

    return save_all(trajectory, folder)


def _page(trajectory: Trajectory, folder: Path) -> list[Path]:
    return [view.export_html(trajectory, folder / "run.html")]


def _with_progress(run: Callable[[Callable[[float], None]], Trajectory], duration: float, quiet: bool) -> Trajectory:
    from tqdm import tqdm

    with tqdm(total=duration, unit="s", disable=quiet or None, bar_format="{l_bar}{bar}| {n:.2f}/{total:.2f} s simulated") as bar:
        return run(lambda t: _advance(bar, t))


def _advance(bar: Any, t: float) -> None:
    bar.update(t - bar.n)
