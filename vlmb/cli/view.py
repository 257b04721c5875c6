"""`vlmb view`: a scene or a run in the browser, or as a page, pictures or a film."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vlmb.errors import VlmbError
from vlmb.scene.scene import load_scene
from vlmb.simulation.checking import check
from vlmb.simulation.files import write_text
from vlmb.simulation.loading import load_trajectory
from vlmb.simulation.trajectory import Trajectory
from vlmb.views import view
from vlmb.views.page import page
from vlmb.views.sceneries import of_trajectory
from vlmb.views.stills import animation, frames, save_still
from vlmb.views.visual_model import Scenery

WHAT = "show a scene or play a run in the browser, or write it as a page, pictures or a film"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("what", metavar="SCENE|RUN.npz", help="scene file or model: shows its start; stored run (.npz): plays it")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write one self-contained page instead of opening a browser")
    parser.add_argument("--png", type=Path, metavar="FILE", help="write a still")
    parser.add_argument("--time", type=float, metavar="T", help="[s] time of the still (default: the end)")
    parser.add_argument("--ghosts", type=int, default=0, metavar="N", help="number of earlier, paler postures in the still")
    parser.add_argument("--gif", type=Path, metavar="FILE", help="write an animated GIF")
    parser.add_argument("--mp4", type=Path, metavar="FILE", help="write a film; needs the extra `film`")
    parser.add_argument("--frames", type=Path, metavar="DIR", help="write one PNG per frame")
    parser.add_argument("--size", type=int, nargs=2, metavar=("W", "H"), help="[pixels] of stills, frames and films")
    parser.add_argument("--fps", type=float, help="frames per second (default: page 60, frames and MP4 30, GIF 20)")
    parser.add_argument("--speed", type=float, default=1.0, help="multiple of real time (default: 1)")
    parser.add_argument("--azimuth", type=float, metavar="DEG", help="of the camera in pictures and films, from the fall line")
    parser.add_argument("--elevation", type=float, metavar="DEG", help="elevation of the camera above the surface")
    parser.add_argument("--zoom", type=float, default=1.0, help="zoom of the camera's lens (default: 1)")
    parser.add_argument("--side", action="store_true", help="look from the right of the direction of travel")
    parser.add_argument("--follow", action=argparse.BooleanOptionalAction, help="move the camera along (default: in films)")
    parser.add_argument("--arrows", action="store_true", help="draw gravity, the edge force, and forces and impulses of contacts")
    parser.add_argument("--no-browser", action="store_true", help="serve the page without opening a browser")
    parser.add_argument("--port", type=int, default=0, help="port of the page on this machine (default: any free one)")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
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
