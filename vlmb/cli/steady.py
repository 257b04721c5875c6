"""vlmb steady: a steady motion, and how stable it is."""

from __future__ import annotations

import argparse

from vlmb.errors import VlmbError
from vlmb.studies.linearize import linearize
from vlmb.studies.steady import steady

WHAT = "find a steady motion, such as a turn, and its stability"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("scene", help="scene file (.toml)")
    parser.add_argument("--speed", type=float, help="[m/s] speed of the ski")
    parser.add_argument("--radius", type=float, help="[m] radius of its turn, positive to the left")
    parser.add_argument("--hold", nargs="+", action="extend", default=[], metavar="NAME=VALUE", help="other quantities to hold")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    hold: dict[str, float] = {name: getattr(args, name) for name in ("speed", "radius") if getattr(args, name) is not None}
    for text in args.hold:
        name, _, value = text.partition("=")
        try:
            hold[name] = float(value)
        except ValueError:
            raise VlmbError(f"--hold {text}: must be NAME=VALUE") from None
    found = steady(args.scene, hold)
    linear = linearize(found)
    print(f"{found.scene.name}: steady motion, residual {found.residual:.1e}, family of {found.family}; {linear.stability}")
    for name, value in {**found.coordinates, **found.rates}.items():
        print(f"  {name:<24s} {value:.9g}")
    print(f"  in {', '.join(linear.names)}")
    for value, label in zip(linear.eigenvalues, linear.labels, strict=True):
        print(f"  eigenvalue               {value.real:+.6g} {value.imag:+.6g}i 1/s{f'  {label}' if label else ''}")
    return 0
