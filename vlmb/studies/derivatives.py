"""Derivatives of maps that runs make, such as a period's, by central differences, extrapolated to step zero, with their error.

Those of accelerations are exact: vlmb/system/jets.py. Along runs this way measures better than variational equations
(benchmarks/derivatives.py), and goes through events.
"""

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
    h, steps, differences, why = FIRST * size, list[float](), list[Array | None](), ""
    for _ in range(LEVELS):
        ahead, behind = x.copy(), x.copy()
        ahead[k] += h
        behind[k] -= h
        steps.append(h)
        try:
            differences.append((function(ahead) - function(behind)) / (ahead[k] - behind[k]))
        except VlmbError as refused:  # beyond a pole or a limit: nearer
            differences.append(None)
            why = f": {refused}"
        h /= SHRINK
    known = next((entry for entry in differences if entry is not None), None)
    if known is None:
        raise StudyError(f"there are no derivatives here{why}")
    rows = np.array([np.full_like(known, np.nan) if entry is None else entry for entry in differences])
    best, error = extrapolated(np.array(steps), rows)
    if not np.isfinite(error):
        raise StudyError(f"there are no derivatives here{why}")
    return best, error


def extrapolated(steps: Array, differences: Array) -> tuple[Array, float]:
    """Return central differences (levels, n) by falling steps (levels,) at step 0, and their error; both nan where not known.

    By Ridders: polynomials in h^2 through ever more of them; the one that agrees best with those before it, over all n. Levels
    that are nan are none.
    """
    before, best, error = list[Array](), np.full(differences.shape[1:], np.nan), np.nan
    for at, difference in enumerate(differences):
        if np.isnan(difference).any():
            before = []
            continue
        row = [difference]
        for back, known in enumerate(before, 1):
            factor = float(steps[at - back] / steps[at]) ** 2
            row.append((factor * row[-1] - known) / (factor - 1.0))
        for last, new, other in zip(row, row[1:], before, strict=False):
            off = max(float(np.abs(new - last).max(initial=0.0)), float(np.abs(new - other).max(initial=0.0)))
            if not off >= error:
                best, error = new, off
        before = row
    return best, error
