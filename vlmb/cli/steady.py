"""vlmb steady: a steady motion, and how stable it is."""

from __future__ import annotations

import argparse
from pathlib import Path

from vlmb.errors import VlmbError
from vlmb.studies.linearize import linearize
from vlmb.studies.modes import Mode
from vlmb.studies.steady import steady
from vlmb.views import view
from vlmb.views.stills import save_still

WHAT = "find a steady motion, such as a turn, and its stability"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("scene", help="scene file (.toml)")
    parser.add_argument("--speed", type=float, help="[m/s] speed of the ski")
    parser.add_argument("--radius", type=float, help="[m] radius of its turn, positive to the left")
    parser.add_argument("--hold", nargs="+", action="extend", default=[], metavar="NAME=VALUE", help="other quantities to hold")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write the eigenvalues in the complex plane (.png)")
    parser.add_argument("--dark", action="store_true", help="draw them on a dark background")
    parser.add_argument("--mode", type=int, metavar="K", help="show mode K of those listed, the first 0, in the browser")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write the page of that mode instead")
    parser.add_argument("--png", type=Path, metavar="FILE", help="write a still: the steady posture and both ends of the mode")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    hold: dict[str, float] = {name: getattr(args, name) for name in ("speed", "radius") if getattr(args, name) is not None}
    for text in args.hold:
        name, _, value = text.partition("=")
        try:
            hold[name] = float(value)
        except ValueError:
            raise VlmbError(f"--hold {text}: must be NAME=VALUE") from None
    if args.mode is None and (args.html or args.png):
        raise VlmbError("--html and --png show a mode: say which by --mode K")
    if args.dark and not args.plot:
        raise VlmbError("--dark is of the figure: say where it goes by --plot FILE")
    found = steady(args.scene, hold)
    linear = linearize(found)
    print(f"{found.scene.name}: steady motion, residual {found.residual:.1e}, family of {found.family}; {linear.stability}")
    for name, value in {**found.coordinates, **found.rates}.items():
        print(f"  {name:<24s} {value:.9g}")
    print(f"  in {', '.join(linear.names)}")
    for k, (value, label) in enumerate(zip(linear.eigenvalues, linear.labels, strict=True)):
        print(f"  eigenvalue {k:<13d} {value.real:+.6g} {value.imag:+.6g}i 1/s{f'  {label}' if label else ''}")
    if args.plot:
        from vlmb.views.eigenvalue_plots import save_eigenvalues

        print(f"wrote {save_eigenvalues(linear, args.plot, args.dark)}")
    if args.mode is not None:
        _show(linear.mode(args.mode), args)
    return 0


def _show(mode: Mode, args: argparse.Namespace) -> None:
    """Show a mode, or write it."""
    written = [view.export_html(mode, args.html)] if args.html else []
    if args.png:
        written.append(save_still(view.picture(mode), args.png))
    if written:
        print("wrote " + ", ".join(map(str, written)))
        return
    view.keep(view.play(mode))
