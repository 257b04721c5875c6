"""The command line: vlmb run | info | check | matrices | plot | view | bench.

Exit codes: 0 done, 1 failed or refused, 2 wrong usage.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from vlmb import bench, matrices, view
from vlmb._version import __version__
from vlmb.errors import VlmbError
from vlmb.integrate import METHODS
from vlmb.long_chains import is_long
from vlmb.mechanism import Mechanism, build, data_bytes
from vlmb.scene import Scene, load_scene
from vlmb.simulate import check, run_options, simulate
from vlmb.start import Start, consistent_start
from vlmb.symbols import counted
from vlmb.trajectory import Trajectory, load_trajectory


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; print errors as one sentence on stderr."""
    parser = _parser()
    args = parser.parse_args(arguments)
    try:
        return int(args.run(args))
    except VlmbError as error:
        scene = getattr(args, "scene", None)
        where = f"{scene}: " if scene and str(scene) not in str(error) else ""
        print(f"vlmb {args.command}: {where}{error}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        return 1
    except KeyboardInterrupt:
        print("vlmb: interrupted", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"vlmb {args.command}: {error.filename or ''}: {error.strerror}", file=sys.stderr)
        return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="vlmb", description="Mechanisms whose links change their length, on Pinocchio.")
    parser.add_argument("--version", action="version", version=f"vlmb {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, what: str, run: Callable[[argparse.Namespace], int]) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=what, description=what)
        added.set_defaults(run=run)
        return added

    run = command("run", "simulate a scene (or replay a stored run); write run.npz, run.csv, plots and a page that plays", _run)
    run.add_argument("scene", help="scene file (.toml) or a stored run (.npz)")
    run.add_argument("-o", "--output", type=Path, default=None, help="folder for the results (default: results/NAME)")
    run.add_argument("--duration", type=float, help="[s]")
    run.add_argument("--method", choices=METHODS, help="integration method")
    run.add_argument("--rtol", type=float)
    run.add_argument("--atol", type=float)
    run.add_argument("--step", type=float, help="[s] of the fixed-step methods")
    run.add_argument("--knife-edge", choices=("reduction", "multiplier", "projection"))
    run.add_argument("--gain", type=float, help="[1/s] Baumgarte gain of the knife edge as a multiplier")
    run.add_argument("--no-plots", action="store_true", help="write no pictures and no run.html")
    run.add_argument("--view", action="store_true", help="play the run in the browser when it is done")
    run.add_argument("--quiet", action="store_true", help="no progress bar")
    info = command("info", "print degrees of freedom, joints, and what was left out and why", _info)
    info.add_argument("scene", help="scene file (.toml)")
    checked = command("check", "validate a scene without running it", _check)
    checked.add_argument("scene", help="scene file (.toml)")
    what = "print the blocks of the equations of motion (4.1) at a posture, without the scene's forces and constraints"
    blocks = command("matrices", what, matrices.run)
    matrices.add_arguments(blocks)
    seen = command("view", "show a scene or play a run in the browser, or write it as html, pictures or a gif", view.run)
    view.add_arguments(seen)
    measured = command("bench", "measure error against CPU time of every method and form of the knife edge", bench.run)
    bench.add_arguments(measured)
    plot = command("plot", "draw the plots of stored runs; several runs share one figure", _plot)
    plot.add_argument("runs", nargs="+", help="stored runs (.npz)")
    plot.add_argument("--only", nargs="+", metavar="NAME", help="which figures, e.g. path energy")
    plot.add_argument("-o", "--output", type=Path, default=Path("plots"), help="folder for the pictures")
    return parser


def _run(args: argparse.Namespace) -> int:
    path, times = Path(args.scene), None
    changes = {key: getattr(args, key) for key in ("duration", "method", "rtol", "atol", "step", "knife_edge", "gain")}
    if path.suffix == ".npz":
        stored = load_trajectory(path)
        if stored.asked_names:
            raise VlmbError(f"{path}: this run had a Python control callable, which is not stored; it cannot be replayed")
        scene = msgspec.structs.replace(stored.scene, run=stored.run)
        if stored.status == "finished" and args.duration is None:
            times = stored.t
    else:
        scene = load_scene(path)
    run = run_options(scene, **changes)
    if args.view:
        view.need_display()
    folder = args.output or Path("results") / path.stem
    made = [part for part in (folder, *folder.parents) if not part.exists()]
    folder.mkdir(parents=True, exist_ok=True)  # before the run: nothing computed shall be lost
    try:
        trajectory = _with_progress(
            lambda progress: simulate(scene, **changes, t_eval=times, progress=progress), run.duration, args.quiet
        )
    except BaseException:
        for part in made:
            part.rmdir()
        raise
    written = [trajectory.save(folder / "run.npz"), trajectory.save_csv(folder / "run.csv")]
    print(trajectory.summary())
    if not args.no_plots:
        for what, draw in (("plots", _draw), ("run.html", _page)):
            try:
                written += draw(trajectory, folder)
            except VlmbError as error:
                print(f"no {what}: {error}", file=sys.stderr)
    print("wrote " + ", ".join(str(file) for file in written))
    if args.view:
        view.keep(view.play(trajectory, browser=True))
    return 0 if trajectory.status in ("finished", "stopped") else 1


def _draw(trajectory: Trajectory, folder: Path) -> list[Path]:
    from vlmb.plots import save_all

    return save_all(trajectory, folder)


def _page(trajectory: Trajectory, folder: Path) -> list[Path]:
    return [view.export_html(trajectory, folder / "run.html")]


def _with_progress(run: Callable[[Callable[[float], None]], Trajectory], duration: float, quiet: bool) -> Trajectory:
    from tqdm import tqdm

    with tqdm(total=duration, unit="s", disable=quiet or None, bar_format="{l_bar}{bar}| {n:.2f}/{total:.2f} s simulated") as bar:
        return run(lambda t: _advance(bar, t))


def _advance(bar: Any, t: float) -> None:
    bar.update(t - bar.n)


def _info(args: argparse.Namespace) -> int:
    scene = load_scene(args.scene)
    mechanism = build(scene)
    layout, held = mechanism.layout, independent(mechanism, consistent_start(mechanism))
    print(f"{scene.name}: {scene.base.kind} base, {counted(len(scene.links), 'link')}, {sum_mass(scene):g} kg")
    print(f"  coordinates         {len(layout.names)}: {' '.join(layout.names)}")
    print(f"  degrees of freedom  {held}")
    memory = data_bytes(layout.nv) / 2**20
    print(f"  state               {layout.nq} positions, {layout.nv} velocities; pinocchio.Data {memory:.2g} MiB")
    if is_long(scene):
        print("  runs as             sub-chains of one link each, without that Data")
    print("  joints")
    for joint, name in list(zip(mechanism.model.joints, mechanism.model.names, strict=True))[1:]:
        print(f"    {name:<20s} {joint.shortname().removeprefix('JointModel')}")
    print("  left out" if mechanism.left_out else "  left out            nothing")
    for entry in mechanism.left_out:
        print(f"    {entry}")
    for entry in mechanism.warnings:
        print(f"  warning             {entry}")
    return 0


def independent(mechanism: Mechanism, start: Start) -> int:
    """Count independent velocities at the start: coordinates less prescribed ones, the knife edge and ideal constraints."""
    prescribed = sum(at.motion == "prescribed" and at.joint > 0 for e in mechanism.layout.links for at in (e.lower, e.upper))
    edge = mechanism.layout.base == "ski"
    return len(mechanism.layout.names) - prescribed - edge - start.rank


def sum_mass(scene: Scene) -> float:
    """Total mass [kg]."""
    return scene.base.mass + sum(link.rod.mass + link.tip_mass for link in scene.links)


def _check(args: argparse.Namespace) -> int:
    mechanism, start = check(load_scene(args.scene))
    coordinates, free = len(mechanism.coordinate_names), independent(mechanism, start)
    print(f"{args.scene}: fine. {counted(coordinates, 'coordinate')}, {counted(free, 'degree')} of freedom")
    for text in (*mechanism.warnings, *start.repairs):
        print(f"  {text}")
    return 0


def _plot(args: argparse.Namespace) -> int:
    from vlmb.plots import save_all

    runs = [load_trajectory(path) for path in args.runs]
    written = save_all(runs if len(runs) > 1 else runs[0], args.output, args.only)
    print("wrote " + ", ".join(str(file) for file in written))
    return 0


if __name__ == "__main__":
    sys.exit(main())
