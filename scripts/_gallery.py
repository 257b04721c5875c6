"""Render every shipped scene to a still and a page that plays it: scripts/gallery [FOLDER] [SCENE ...]."""

from __future__ import annotations

import argparse
import html
import sys
import time
from pathlib import Path
from typing import Any

import vlmb
from vlmb.views.view import export_html, picture

ROOT = Path(__file__).resolve().parent.parent

# What shows a scene best: time of the still [s] (default: the end), earlier postures, direction to the camera
TURN: dict[str, Any] = {"ghosts": 4, "since": 2.6}
SLALOM: dict[str, Any] = {"ghosts": 4}
LOOKS: dict[str, dict[str, Any]] = {
    "skier_one_link": {"ghosts": 4, "since": 3.4},
    "skier_two_links": {"ghosts": 4, "since": 3.4},
    "skier_whole_body": TURN,
    "skier_with_arms": TURN,
    "two_legs_on_a_board": {"ghosts": 4, "since": 2.0},
    "skier_slalom": SLALOM,
    "skier_slalom_friction": SLALOM,
    "skier_slalom_two_links": SLALOM,
    "skier_slalom_with_arms": SLALOM,
    "carved_turn": {"ghosts": 5},
    "crane": {"ghosts": 4, "since": 7.0},
    "skier_slalom_whole_body": SLALOM,
    "skier_paper": {"ghosts": 4, "view_from": (0.5, -1.0, 0.3)},
    "skier_paper_balanced": {"ghosts": 5},
    "stiff_skier": {"ghosts": 4, "since": 3.4},
    "falling_skier": {"ghosts": 5},
    "flight": {"ghosts": 6},
    "single_support": {"ghosts": 3},
    "bouncing_ball": {"time": 2.4, "ghosts": 32, "since": 0.0, "view_from": (0.15, -1.0, 0.25)},
    "compass_gait": {"time": 3.1, "ghosts": 8, "since": 0.0, "view_from": (0.25, -1.0, 0.25)},
    "rimless_wheel": {"ghosts": 4, "since": 0.0, "view_from": (0.25, -1.0, 0.25)},
    "simplest_walker": {"ghosts": 6, "since": 0.0, "view_from": (0.25, -1.0, 0.25)},
    "slip_runner": {"time": 0.95, "ghosts": 16, "since": 0.2, "view_from": (0.2, -1.0, 0.2), "arrows": True},
    "slip_walker": {"time": 1.55, "ghosts": 6, "since": 0.3, "view_from": (0.2, -1.0, 0.2), "arrows": True},
    "figure_walker": {"time": 4.4, "ghosts": 4, "since": 2.0, "view_from": (0.35, -1.0, 0.2)},
    "figure_walker_hops": {"time": 0.37, "view_from": (0.5, -1.0, 0.2)},
    "jumper": {"time": 0.36, "ghosts": 1, "since": 0.0, "view_from": (0.3, -1.0, 0.2)},
    "exoskeleton": {"time": 2.2, "ghosts": 1, "since": 0.0, "view_from": (0.6, -1.0, 0.25)},
    "chaplygin_sleigh": {"time": 3.0, "ghosts": 6},
    "skate_on_slope": {"ghosts": 12},
    "skate_lets_go": {"ghosts": 12},
    "skier_skids": {"time": 8.4, "ghosts": 8, "since": 7.2},
    "ski_jump": {"time": 1.62, "ghosts": 5, "since": 0.95},
}
SMALL, QUALITY = (480, 300), 88  # of the pictures of the documentation


def main() -> int:
    """Run the scenes, write pictures, pages and an index."""
    parser = argparse.ArgumentParser(prog="scripts/gallery", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "results" / "gallery", help="default: results/gallery")
    parser.add_argument("scenes", nargs="*", help="names of scenes in models/ (default: all)")
    parser.add_argument("--docs", action="store_true", help="write the pictures of docs/ and the README as well")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    known = {path.stem: path for path in sorted((ROOT / "models").glob("*.toml"))}
    entries = []
    for name in args.scenes or known:
        if name not in known:
            parser.error(f"no scene {name!r} in models/; there are: {', '.join(known)}")
        began = time.perf_counter()
        trajectory = vlmb.simulate(known[name])
        shown = picture(trajectory, **LOOKS.get(name, {}))
        shown.save(args.folder / f"{name}.png")
        if args.docs:
            compact(shown.resize(SMALL), ROOT / "docs" / "images" / "gallery" / f"{name}.jpg")
        export_html(trajectory, args.folder / f"{name}.html")
        title, message = html.escape(trajectory.scene.name), html.escape(trajectory.message)
        entries.append(f'<a href="{name}.html"><img src="{name}.png" alt="{title}" width="480"><p>{title}: {message}</p></a>')
        print(f"{name:<24s} {time.perf_counter() - began:5.1f} s  {trajectory.message}", flush=True)
    if args.docs:
        trajectory = vlmb.simulate(known["skier_with_arms"])
        compact(picture(trajectory, 3.2, size=(1200, 520), ghosts=6, since=1.3), ROOT / "docs" / "images" / "skier.png")
    style = "body{font-family:sans-serif;display:flex;flex-wrap:wrap;gap:16px}a{color:inherit;max-width:480px}"
    page = f'<!DOCTYPE html><meta charset="utf-8"><title>vlmb: gallery</title><style>{style}</style>'
    (args.folder / "index.html").write_text(page + "\n".join(entries), encoding="utf-8")
    print(f"wrote {args.folder / 'index.html'}")
    return 0


def compact(shown: Any, path: Path) -> None:
    """Write a small file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    shown.save(path, optimize=True, quality=QUALITY)
    print(f"wrote {path}")


if __name__ == "__main__":
    sys.exit(main())
