"""The command line: vlmb run | info | check | matrices | plot | view | bench.

Exit codes: 0 done, 1 failed, refused, interrupted or doubtful, 2 wrong usage.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vlmb._version import __version__
from vlmb.equations import matrices
from vlmb.equations.motion import FORMS
from vlmb.errors import VlmbError
from vlmb.model.building import build
from vlmb.model.mechanism import Mechanism
from vlmb.model.memory import data_bytes
from vlmb.model.mjcf import left_behind, mjcf
from vlmb.model.names import counted
from vlmb.scene.names import listed
from vlmb.scene.scene import Scene, load_scene
from vlmb.simulation.files import replacing, write_text
from vlmb.simulation.keeping import ended_by_signals, keep
from vlmb.simulation.loading import load_trajectory
from vlmb.simulation.methods import METHODS
from vlmb.simulation.simulate import Checked, check, run_options, simulate
from vlmb.simulation.trajectory import Trajectory
from vlmb.studies import bench
from vlmb.studies.work_precision import measure
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system
from vlmb.views import view, work_precision_plots
from vlmb.views.live import Live
from vlmb.views.page import page
from vlmb.views.stills import animation, frames, save_still
from vlmb.views.terminal import parsed, printable
from vlmb.views.sceneries import of_trajectory
from vlmb.views.visual_model import Scenery

OPTIONS = ("duration", "method", "rtol", "atol", "step", "knife_edge", "gain", "engine", "max_step")  # of `vlmb run`


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; print errors as one sentence on stderr."""
    parser = make_parser()
    with printable(), ended_by_signals():
        args = parsed(parser, arguments)
        try:
            return int(args.run(args))
        except VlmbError as error:
            scene = getattr(args, "scene", None)
            where = f"{scene}: " if scene and str(scene) not in str(error) else ""
            print(f"vlmb {args.command}: {where}{error}", file=sys.stderr)
        except BrokenPipeError:
            pass
        except KeyboardInterrupt:
            print(f"vlmb {args.command}: interrupted; earlier results are as they were", file=sys.stderr)
        except OSError as error:
            print(f"vlmb {args.command}: {error.filename or ''}: {error.strerror}", file=sys.stderr)
    return 1


def make_parser() -> argparse.ArgumentParser:
    """Describe every command."""
    parser = argparse.ArgumentParser(prog="vlmb", description="Mechanisms whose links change their length, on Pinocchio.")
    parser.add_argument("--version", action="version", version=f"vlmb {__version__}")
    parser.commands = {}  # type: ignore[attr-defined]
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, what: str, run: Callable[[argparse.Namespace], int]) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=what, description=what)
        parser.commands[name] = added  # type: ignore[attr-defined]
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
    run.add_argument("--engine", choices=("auto", "core", "pinocchio"), help="what evaluates the motion (default: auto)")
    run.add_argument("--max-step", type=float, metavar="S", help="[s] longest step of adaptive methods")
    run.add_argument("--no-plots", action="store_true", help="write no pictures and no run.html")
    run.add_argument("--view", action="store_true", help="show the motion in the browser while it is computed")
    run.add_argument("--quiet", action="store_true", help="no progress bar")
    info = command("info", "print degrees of freedom, joints, and what was left out and why", _info)
    info.add_argument("scene", help="scene file (.toml)")
    checked = command("check", "validate a scene without running it", _check)
    checked.add_argument("scene", help="scene file (.toml)")
    what = "print the blocks of the equations of motion (4.1) at a posture, without the scene's forces and constraints"
    blocks = command("matrices", what, _matrices)
    _matrices_arguments(blocks)
    seen = command("view", "show a scene or play a run in the browser, or write it as html, pictures or a gif", _view)
    _view_arguments(seen)
    measured = command("bench", "measure error against CPU time of every method and form of the knife edge", _bench)
    _bench_arguments(measured)
    plot = command("plot", "draw the plots of stored runs; several runs share one figure", _plot)
    plot.add_argument("runs", nargs="*", help="stored runs (.npz)")
    plot.add_argument("--only", nargs="+", metavar="NAME", help="which figures, e.g. path energy")
    plot.add_argument("-o", "--output", type=Path, default=Path("plots"), help="folder for the pictures")
    what = "write a scene as MJCF, which MuJoCo reads: vlmb convert scene.toml scene.xml"
    converted = command("convert", what, _convert)
    converted.add_argument("source", help="scene file (.toml)")
    converted.add_argument("target", type=Path, help="file to write (.xml)")
    return parser


def _convert(args: argparse.Namespace) -> int:
    if args.target.suffix == ".xml":
        return _to_mjcf(args.source, args.target)
    raise VlmbError(f"convert: {args.source} to {args.target}: a scene (.toml) becomes MJCF (.xml)")


def _to_mjcf(source: str, target: Path) -> int:
    """Write a scene of links as MJCF, at its start."""
    mechanism, start = check(load_scene(source))
    if not isinstance(mechanism, Mechanism):
        raise VlmbError(f"{source}: MJCF is written of scenes of links; of a robot there is its URDF, which MuJoCo reads")
    write_text(target, mjcf(mechanism, start.state))
    for sentence in left_behind(mechanism):
        print(f"  note  {sentence}")
    print(f"wrote {target}")
    return 0


def _run(args: argparse.Namespace) -> int:
    path, times, t0 = Path(args.scene), None, 0.0
    changes = {key: getattr(args, key) for key in OPTIONS}
    if path.suffix == ".npz":
        stored = load_trajectory(path)
        if stored.input_names:
            raise VlmbError(f"{path}: this run had a Python control callable, which is not stored; it cannot be replayed")
        scene, t0 = stored.scene.changed(run=stored.run), stored.t0
        if stored.status == "finished" and args.duration is None:
            times = stored.t
    else:
        scene = load_scene(path)
    run = run_options(scene, **changes)
    if args.view:
        view.need_display()
    folder = args.output or Path("results") / _name_of(path)
    watched = Live(scene, changes, t0, browser=True) if args.view else None
    made = [part for part in (folder, *folder.parents) if not part.exists()]
    folder.mkdir(parents=True, exist_ok=True)  # before the run: nothing computed shall be lost
    try:
        kept = keep(
            lambda: _with_progress(
                lambda tell: simulate(scene, **changes, t_eval=times, t0=t0, progress=lambda t: tell(t - t0)),
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
    print(trajectory.summary())
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
    print(_wrote(written))
    if watched and (ended or kept.error is not None):
        watched.close()
    if kept.error is not None:
        raise kept.error
    if watched and not ended:
        view.keep(watched.finish(trajectory))
    return 0 if trajectory.status in ("finished", "stopped") and not (trajectory.doubts or ended or kept.said) else 1


def _name_of(path: Path) -> str:
    """Name a folder of results: a scene's name; of a stored run, whose file is mostly run.npz, its folder's, as a replay."""
    if path.suffix != ".npz":
        return path.stem
    return f"{path.resolve().parent.name if path.stem == 'run' else path.stem}_replay"


def _wrote(files: Sequence[Path]) -> str:
    """List written files, many of one folder by their names."""
    folders = {file.parent for file in files}
    if len(files) < 4 or len(folders) > 1:
        return "wrote " + ", ".join(str(file) for file in files)
    return f"wrote into {folders.pop()}: " + ", ".join(file.name for file in files)


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


def _info(args: argparse.Namespace) -> int:
    scene = load_scene(args.scene)
    mechanism = build(scene)
    if not isinstance(mechanism, Mechanism):
        return _info_of_robots(mechanism)
    layout, free = mechanism.layout, Checked(mechanism, consistent_start(make_system(mechanism))).degrees_of_freedom
    print(f"{scene.name}: {scene.base.kind} base, {counted(len(scene.links), 'link')}, {sum_mass(scene):g} kg")
    print(f"  coordinates         {len(layout.names)}: {' '.join(layout.names)}")
    for quantity in mechanism.names.coordinates:
        print(f"    {quantity.name:<20s} {quantity.unit:<4s} {mechanism.names.meaning(quantity)}")
    print(f"  degrees of freedom  {free}")
    memory = data_bytes(layout.nv) / 2**20
    print(f"  state               {layout.nq} positions, {layout.nv} velocities; pinocchio.Data {memory:.2g} MiB")
    print("  joints")
    for joint, name in list(zip(mechanism.model.joints, mechanism.model.names, strict=True))[1:]:
        print(f"    {name:<20s} {joint.shortname().removeprefix('JointModel')}")
    print("  left out" if mechanism.left_out else "  left out            nothing")
    for entry in mechanism.left_out:
        print(f"    {entry}")
    for entry in mechanism.warnings:
        print(f"  warning             {entry}")
    for column in mechanism.signals.columns:
        print(f"  data                {column.report}")
    return 0


def _info_of_robots(mechanism: Any) -> int:
    """Print the same of a scene with robots."""
    scene, names, checked = mechanism.scene, mechanism.names, check(mechanism)
    print(f"{scene.name}: {scene.base.kind} base, {mechanism.facts}")
    print(f"  coordinates         {len(names.index)}")
    for quantity in names.coordinates:
        print(f"    {quantity.name:<28s} {quantity.unit:<4s} {names.meaning(quantity)}")
    print(f"  degrees of freedom  {checked.degrees_of_freedom}")
    print(f"  state               {mechanism.model.nq} positions, {mechanism.model.nv} velocities")
    print(f"  frames              {len(mechanism.model.frames)}: {listed([name for name in mechanism.frames if name != 'universe'])}")
    for entry in mechanism.left_out or ("nothing",):
        print(f"  left out            {entry}")
    return 0


def sum_mass(scene: Scene) -> float:
    """Total mass [kg]."""
    return scene.base.mass + sum(link.rod.mass + link.tip_mass for link in scene.links)


def _check(args: argparse.Namespace) -> int:
    print(f"{args.scene}: {check(args.scene).report}")
    return 0


def _plot(args: argparse.Namespace) -> int:
    from vlmb.views.plots import save_all

    runs = [load_trajectory(path) for path in args.runs]
    written = save_all(runs if len(runs) > 1 else runs[0], args.output, args.only)
    print(_wrote(written))
    return 0


def _matrices_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", nargs="?", help="scene file (.toml)")
    parser.add_argument(
        "--at", action="append", nargs="+", metavar="NAME=VALUE", default=[],
        help="coordinates and rates that differ from the scene's start, e.g. psi1=1.2 legs.azimuth_dot=0.5 speed=8 [m, rad, s]",
    )  # fmt: skip
    parser.add_argument(
        "--block", action="append", nargs="+", metavar="NAME", default=[],
        help="A B C1 C2 D E F1 F2 G H1 H2 K, X Y PHI0 and others of a base, mass_matrix, bias; default: every block",
    )  # fmt: skip
    parser.add_argument("--form", choices=FORMS, default="full", help="which equations of a ski (default: full)")
    parser.add_argument("--format", choices=matrices.FORMATS, default="text", help="default: text")
    parser.add_argument("-o", "--output", type=Path, help="file to write instead of printing")


def _matrices(args: argparse.Namespace) -> int:
    wanted = [entry for group in args.block for entry in group]
    with np.errstate(all="ignore"):
        eom = matrices.at_posture(args.scene, [entry for group in args.at for entry in group], args.form)
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


def _view_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("what", metavar="SCENE|RUN.npz", help="scene file (.toml): its start; stored run (.npz): its motion")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write one self-contained page instead of opening a browser")
    parser.add_argument("--png", type=Path, metavar="FILE", help="write a still")
    parser.add_argument("--time", type=float, metavar="T", help="[s] of the still (default: the end)")
    parser.add_argument("--ghosts", type=int, default=0, metavar="N", help="earlier postures in the still, paler")
    parser.add_argument("--gif", type=Path, metavar="FILE", help="write an animated GIF")
    parser.add_argument("--mp4", type=Path, metavar="FILE", help="write a film; needs the extra `film`")
    parser.add_argument("--frames", type=Path, metavar="DIR", help="write one PNG a frame, for a film")
    parser.add_argument("--size", type=int, nargs=2, metavar=("W", "H"), help="[pixels] of stills, frames and films")
    parser.add_argument("--fps", type=float, help="frames a second (default: page 60, frames and MP4 30, GIF 20)")
    parser.add_argument("--speed", type=float, default=1.0, help="times real time (default: 1)")
    parser.add_argument("--azimuth", type=float, metavar="DEG", help="of the camera of pictures and films, from the fall line")
    parser.add_argument("--elevation", type=float, metavar="DEG", help="of the camera above the surface")
    parser.add_argument("--zoom", type=float, default=1.0, help="of the camera's lens (default: 1)")
    parser.add_argument("--side", action="store_true", help="the camera on the right of the way")
    parser.add_argument("--follow", action=argparse.BooleanOptionalAction, help="the camera goes along (default: in films)")
    parser.add_argument("--arrows", action="store_true", help="draw gravity and the edge force")
    parser.add_argument("--no-browser", action="store_true", help="serve the page, and open it yourself")
    parser.add_argument("--port", type=int, default=0, help="of the page on this machine (default: any free one)")


def _view(args: argparse.Namespace) -> int:
    for name, value in (("--speed", args.speed), ("--fps", args.fps), *(("--size", side) for side in args.size or ())):
        if value is not None and not 0.0 < value < 1e5:
            raise VlmbError(f"{name} {value:g}: must be positive")
    what = load_trajectory(args.what) if Path(args.what).suffix == ".npz" else check(load_scene(args.what))[0]

    if not isinstance(what, Trajectory) and (args.time is not None or args.ghosts):
        raise VlmbError(f"{args.what}: a scene shows its start; --time and --ghosts need a stored run (.npz)")

    def made(fps: float) -> Scenery:
        return of_trajectory(what, fps, args.arrows) if isinstance(what, Trajectory) else view.posture(what, None, args.arrows)

    size: dict[str, Any] = {"size": tuple(args.size)} if args.size else {}
    size["shot"] = view.Shot(args.azimuth, args.elevation, args.zoom, args.follow, args.side).checked()
    written: list[Path] = []
    if args.png:
        written.append(save_still(view.picture(what, args.time, ghosts=args.ghosts, arrows=args.arrows, **size), args.png))
    for path, usual in ((args.gif, 20.0), (args.mp4, 30.0)):
        if path:
            fps = args.fps or usual
            written.append(animation(made(fps / args.speed), path, fps=fps, speed=args.speed, **size))
    if args.frames:
        written += frames(made(args.fps or 30.0), args.frames, fps=args.fps or 30.0, **size)[:1]
    if args.html:
        written.append(write_text(args.html, page(made(args.fps or view.FPS), args.speed)))
    if written:
        print("wrote " + ", ".join(str(path) for path in written) + (", ..." if args.frames else ""))
        return 0
    view.keep(view.serve(page(made(args.fps or view.FPS), args.speed), not args.no_browser, args.port))
    return 0


def _bench_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scenes", nargs="+", metavar="SCENE", help="scene files (.toml)")
    parser.add_argument("--duration", type=float, help="[s]")
    parser.add_argument("--methods", nargs="+", choices=METHODS, help="default: all")
    parser.add_argument("--repeats", type=int, default=5, help="turns through all runs; the fastest counts")
    parser.add_argument("--budget", type=float, default=1.0, help="[s] a sweep ends after a run that took longer")
    parser.add_argument("-o", "--output", type=Path, default=Path("results/bench"), help="folder for bench.md, .json and .png")


def _bench(args: argparse.Namespace) -> int:
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


if __name__ == "__main__":
    sys.exit(main())
