"""Derivatives of vector functions by central differences, extrapolated to step zero, with their error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import StudyError, VlmbError

Array = NDArray[np.float64]

FIRST, SHRINK, LEVELS = 0.04, 1.6, 8  # the widest step, in units of a coordinate; how steps shrink, and how often
QUICK = 1e-5  # in units of a coordinate
LOOSE = 1e-5  # relative error at which a derivative is refused


def jacobian(
    function: Callable[[Array], Array], x: Array, steps: Array, quick: bool = False, floor: float = 1.0
) -> tuple[Array, float]:
    """Return the derivatives (m, n) of a function of x (n,), and the largest error relative to the largest entry of a column.

    One below `floor` counts as that.

    steps (n,) are the sizes of what may be taken for a small change. By Ridders: differences with shrinking steps, extrapolated
    in h^2; the best of the table is taken. `quick` takes one small step, for a search that goes on. Raises StudyError where the
    function is not smooth enough.
    """
    if quick:
        nudges = [QUICK * steps[k] * (np.arange(len(x)) == k) for k in range(len(x))]
        sides = [(function(x + nudge), function(x - nudge)) for nudge in nudges]
        return np.array([(a - b) / (2.0 * QUICK * h) for (a, b), h in zip(sides, steps, strict=True)]).T, QUICK
    columns, worst = [], 0.0
    for k in range(len(x)):
        column, error = _column(function, x, k, float(steps[k]))
        columns.append(column)
        worst = max(worst, error / max(float(np.abs(column).max(initial=0.0)), floor))
    if worst > LOOSE:
        raise StudyError(f"the accelerations are not smooth here: derivatives are known to {worst:.1g} of their largest only")
    size = len(function(x)) if not columns else len(columns[0])
    return (np.array(columns).T if columns else np.zeros((size, 0))), worst


def _column(function: Callable[[Array], Array], x: Array, k: int, size: float) -> tuple[Array, float]:
    h, before, best, error = FIRST * size, list[Array](), None, np.inf
    for _ in range(LEVELS):
        ahead, behind = x.copy(), x.copy()
        ahead[k] += h
        behind[k] -= h
        try:
            difference = (function(ahead) - function(behind)) / (ahead[k] - behind[k])
        except VlmbError:  # beyond a pole or a limit: nearer
            before, h = [], h / SHRINK
            continue
        row, factor = [difference], 1.0
        for known in before:
            factor *= SHRINK * SHRINK
            row.append((factor * row[-1] - known) / (factor - 1.0))
        for last, new, other in zip(row, row[1:], before, strict=False):
            off = max(float(np.abs(new - last).max()), float(np.abs(new - other).max()))
            if off < error:
                best, error = new, off
        before, h = row, h / SHRINK
    if best is None:
        raise StudyError("the accelerations have no derivatives here")
    return best, error

