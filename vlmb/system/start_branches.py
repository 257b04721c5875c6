r"""A start in a posture in which ideal rows lose their independence: which motions leave it, and whether the rates tell which.

There mu^T J = 0 for some mu, and of the rates w with J w = 0 only those go on that meet the rows to second order as well,

    mu^T d/ds J(q + s w) w = w^T B w = 0.

A motion is determined where its rates meet that, and B w is not 0: then the third order gives what the second does not. Where B
is 0 altogether the rows repeat each other everywhere, and nothing is lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError
from vlmb.model.mechanism import Mechanism
from vlmb.system.row_sets import RowSet
from vlmb.system.start_rows import ALIKE, given_values, gradients
from vlmb.system.system import System

Array = NDArray[np.float64]
Values = dict[str, float]

MOST = 12  # directions of a motion that are looked at
NUDGE = 1e-4  # [rad, m] of a difference quotient
FLAT = 1e-5  # of the largest entry of B: below it is rounding
AT_REST = 1e-9  # [rad/s, m/s]
ON_CONE = 1e-6  # of |B| |w|^2: rates that meet the second order


class _Posture:
    """The ideal rows near a posture, over the rates that are free."""

    def __init__(self, mechanism: Mechanism, followed: set[str], coordinates: Values, rows: RowSet) -> None:
        self.rows, self.coordinates = rows, coordinates
        ski = mechanism.layout.edged
        heading = coordinates["phi0"] if ski else 0.0
        self.along = {"x": math.cos(heading), "y": math.sin(heading)} if ski else {}
        self.names = [*(["speed"] if ski else []), *(n for n in mechanism.layout.names if n not in followed | self.along.keys())]

    def spread(self, w: Array) -> Values:
        """Return rates of all coordinates, by their names."""
        found = dict.fromkeys(self.coordinates, 0.0) | dict(zip(self.names, w.tolist(), strict=True))
        speed = found.pop("speed", 0.0)
        return found | {name: share * speed for name, share in self.along.items()}

    def rates(self, w: Array, step: float = 0.0) -> Array:
        """Return z' of the rows under rates w, a step [s] along them from the posture."""
        moving = self.spread(w)
        place = {name: value + step * moving[name] for name, value in self.coordinates.items()}
        return self.rows.values(place, {f"{name}_dot": rate for name, rate in moving.items()}).rate

    def bend(self, w: Array) -> Array:
        """Return w^T B w for all rows (r,)."""
        bent: Array = (self.rates(w, NUDGE) - self.rates(w, -NUDGE)) / (2.0 * NUDGE)
        return bent

    def read(self, rates: Values) -> Array:
        """Return the free ones of rates by name."""
        speed = sum(share * rates[f"{name}_dot"] for name, share in self.along.items())
        return np.array([speed if name == "speed" else rates[f"{name}_dot"] for name in self.names])

    def told(self, w: Array) -> str:
        """Write a motion by its rates, the largest one 1."""
        unit = w / w[np.argmax(np.abs(w))]
        names = [name if name == "speed" else f"{name}_dot" for name in self.names]
        return ", ".join(f"{name} = {value:.4g}" for name, value in zip(names, unit, strict=True) if abs(value) > FLAT)


def choose_branch(
    system: System, followed: set[str], coordinates: Values, rates: Values, sets: Sequence[RowSet]
) -> list[str]:
    """Bring rates onto the one motion that leaves a singular posture and has the given ones; say so.

    Rows count as lost where they are so over directions: that an azimuth has no rate at the vertical loses nothing.
    SceneError where two motions have the given rates, or none leaves.
    """
    mechanism = system.mechanism
    rows = next((entry for entry in sets if entry.ideal), None)
    if rows is None or not all(row.holonomic and not row.working for row in rows.info):
        return []
    near = _Posture(mechanism, followed, coordinates, rows)
    if not near.names:
        return []
    jacobian = np.column_stack([near.rates(unit) for unit in np.eye(len(near.names))])
    sizes = np.maximum(np.linalg.norm(jacobian, axis=1), ALIKE)
    _, singular, right = np.linalg.svd(jacobian / sizes[:, None])
    kernel = right[int((singular > ALIKE).sum()) :].T
    over = gradients(system, rows, coordinates, rates)
    sizes = np.maximum(np.linalg.norm(over, axis=1), ALIKE)
    left, singular, _ = np.linalg.svd(over / sizes[:, None])
    lost = (left[:, int((singular > ALIKE).sum()) :] / sizes[:, None]).T
    if not len(lost) or not 0 < kernel.shape[1] <= MOST:
        return []
    forms = _effective(np.stack([lost @ near.bend(w) for w in _pairs(kernel)], axis=1), kernel.shape[1])
    if not len(forms):
        return []
    w = kernel.T @ near.read(rates)
    texts = " and ".join(repr(text) for text, share in zip(rows.texts, np.abs(lost).max(axis=0), strict=True) if share > FLAT)
    lines = _lines(forms[0]) if len(forms) == 1 and kernel.shape[1] <= 2 else None
    if np.linalg.norm(w) > AT_REST and _isolated(forms, w):
        return []
    if lines is not None and not lines:
        raise SceneError(
            f"start: the ideal constraints {texts} lose their independence in this posture, and no motion leaves it: no finite "
            "force holds it there; say it by an equation of an angle or a length"
        )
    given = given_values(mechanism)
    wanted = [k for k, name in enumerate(near.names) if (name if name == "speed" else f"{name}_dot") in given]
    asked = near.read(rates)[wanted]
    found = [motion for motion in (_like(kernel @ line, wanted, asked) for line in lines or ()) if motion is not None]
    if len(found) == 1:
        moving = near.spread(found[0])
        rates.update({f"{name}_dot": rate for name, rate in moving.items() if name not in followed})
        return [f"start: of the motions that meet in this posture the one with the given rates goes on: {near.told(found[0])}"]
    both = " or ".join(f"({near.told(kernel @ line)})" for line in lines or ())
    raise SceneError(
        f"start: the ideal constraints {texts} lose their independence in this posture, and the rates do not tell which of the "
        f"motions that meet there goes on{f': {both}, or a multiple' if both else ''}; give the rates of one of them, or start "
        "beside that posture"
    )


def _pairs(kernel: Array) -> list[Array]:
    """Return the sums of every two columns, each with itself too: by them a form of squares is known."""
    count = kernel.shape[1]
    return [kernel[:, i] + kernel[:, j] for i in range(count) for j in range(i, count)]


def _effective(values: Array, count: int) -> Array:
    """Return the forms B (k, m, m), orthogonal to each other, that are not 0; `values` are those at the sums of `_pairs`."""
    forms = np.zeros((len(values), count, count))
    places = [(i, j) for i in range(count) for j in range(i, count)]
    for at, (i, j) in enumerate(places):
        forms[:, i, j] = forms[:, j, i] = values[:, at]
    squares = 0.25 * np.einsum("kii->ki", forms)  # a sum of a column with itself is twice as long
    forms = 0.5 * (forms - squares[:, :, None] - squares[:, None, :])
    _, sizes, right = np.linalg.svd(forms.reshape(len(forms), -1), full_matrices=False)
    kept: Array = right[sizes > FLAT * max(1.0, sizes[0])].reshape(-1, count, count)
    return kept


def _isolated(forms: Array, w: Array) -> bool:
    """Whether rates meet the second order, and no others near them do but their multiples."""
    slopes = forms @ w / np.linalg.norm(w)
    on_cone = np.abs(slopes @ w).max() <= ON_CONE * np.linalg.norm(w)
    return bool(on_cone and np.linalg.svd(slopes, compute_uv=False)[-1] > math.sqrt(FLAT))


def _lines(form: Array) -> list[Array] | None:
    """Return the lines on which a form of one or two squares is 0: two, or none. None where two coincide."""
    if len(form) == 1:
        return []
    (a, b), (_, c) = form.tolist()
    square = b * b - a * c
    if square <= FLAT**2:
        return [] if square < -(FLAT**2) else None
    q = -(b + math.copysign(math.sqrt(square), b))  # a x^2 + 2 b x y + c y^2 = 0: x : y = q : a and c : q
    return [line / np.linalg.norm(line) for line in (np.array([q, a]), np.array([c, q]))]


def _like(motion: Array, wanted: Sequence[int], asked: Array) -> Array | None:
    """Return the multiple of a motion that has the rates asked for; None where none does, or all do."""
    own = motion[list(wanted)]
    if not np.linalg.norm(own) > FLAT or not np.linalg.norm(asked) > AT_REST:
        return None
    share = float(own @ asked / (own @ own))
    return share * motion if np.abs(share * own - asked).max() <= ON_CONE * max(1.0, float(np.abs(asked).max())) else None
