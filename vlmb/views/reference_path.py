"""The course: the way on the snow that a programme prescribes to a ski."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import ExpressionError
from vlmb.scene.expressions import Equation, evaluate, parse_equation
from vlmb.scene.rows import rows_of
from vlmb.scene.scene import Scene

Array = NDArray[np.float64]

KNOWN = frozenset({"x", "y", "phi0", "phi0_dot", "speed", "t"})
ITERATIONS, CLOSE, NUDGE = 30, 1e-10, 1e-6
POINTS = 3000  # of a way at most; further samples are left out
FARTHEST = 0.5  # [rad, rad/s] of one Newton step: the branch next to the last heading is meant


def course(scene: Scene, t: Array, speed: Array, place: tuple[float, float, float]) -> Array | None:
    """Return the way (n, 2) [m] of a ski that meets its programme, passed at `speed` (N,) [m/s] at the times t (N,) [s].

    It begins at `place` (x, y, phi0). The first equation of the heading alone decides, such as tan(phi0) = A*k*cos(k*x)
    (7.5) or phi0_dot = 0.2*speed: names x, y, phi0, phi0_dot, speed, t and parameters. None where there is no such
    equation. The way ends early where the equation has no solution.
    """
    equation = steering(scene)
    if equation is None or len(t) < 2:
        return None
    if len(t) > POINTS:
        t, speed = np.linspace(t[0], t[-1], POINTS), np.interp(np.linspace(t[0], t[-1], POINTS), t, speed)
    unknown = "phi0_dot" if "phi0_dot" in equation.names else "phi0"
    x, y, heading = place
    guess, way = 0.0 if unknown == "phi0_dot" else heading, [(x, y)]
    for k in range(len(t) - 1):
        step, middle = float(t[k + 1] - t[k]), 0.5 * float(speed[k] + speed[k + 1])
        at = {**scene.parameters, "x": x, "y": y, "phi0": heading, "speed": float(speed[k]), "t": float(t[k])}
        half = {**at, "speed": middle, "t": at["t"] + 0.5 * step}
        for now, length in ((at, 0.5 * step), (half, step)):  # the rule of the midpoint
            found = solved(equation, unknown, now, guess)
            if found is None:
                return np.array(way) if len(way) > 1 else None
            guess = found
            along = found if unknown == "phi0" else now["phi0"]
            half["x"] = x + length * now["speed"] * math.cos(along)
            half["y"] = y + length * now["speed"] * math.sin(along)
            half["phi0"] = found if unknown == "phi0" else heading + length * found
        x, y, heading = half["x"], half["y"], half["phi0"]
        way.append((x, y))
    return np.array(way)


def steering(scene: Scene) -> Equation | None:
    """Return the programme's first equation of the heading alone."""
    for row in rows_of(scene).servo if scene.on_snow else ():
        equation = parse_equation(row.equation, row.key)
        if equation.names <= KNOWN | set(scene.parameters) and equation.names & {"phi0", "phi0_dot"}:
            return equation
    return None


def solved(equation: Equation, unknown: str, values: Mapping[str, float], guess: float) -> float | None:
    """Return the value of a name that meets an equation, near a guess; None where Newton's method finds none."""

    def off(value: float) -> float:
        known = {**values, unknown: value}
        return evaluate(equation.left, known) - evaluate(equation.right, known)

    try:
        for _ in range(ITERATIONS):
            slope = (off(guess + NUDGE) - off(guess - NUDGE)) / (2.0 * NUDGE)
            if slope == 0.0:
                return None
            change = -off(guess) / slope
            guess += math.copysign(min(abs(change), FARTHEST), change)
            if abs(change) < CLOSE:
                return guess
    except ExpressionError:
        pass
    return None
