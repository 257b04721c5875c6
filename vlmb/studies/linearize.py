"""Linearizations: small deviations from a motion, how they grow, and what controls do to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, StudyError, VlmbError
from vlmb.model.mechanism import build
from vlmb.scene.names import listed
from vlmb.scene.scene import Scene, as_scene
from vlmb.studies.chart import Chart, chart_at
from vlmb.studies.modes import GROWS, SIZE, Mode, mode_about
from vlmb.studies.standing import footings_of
from vlmb.studies.steady import Steady, refuse_time
from vlmb.system.beginning import start_in_phase
from vlmb.system.jets import derivatives
from vlmb.system.start import Start
from vlmb.system.system import System, make_system

Array = NDArray[np.float64]

FLAT = 1e-9  # singular values over the largest that are none
STEPS, LOOSE = (1e-5, 1e-6), 1e-5  # in units of a coordinate; relative difference at which derivatives are refused
ALIKE = 9  # decimals of the largest eigenvalue, to which two are told apart
FAMILY, DEFECTIVE = "family", "defective"


@dataclass(frozen=True, eq=False)
class Linear:
    """dx' = A dx + B du around a motion; x are `names`, independent of each other where rows and symmetries leave no more.

    `eigenvalues` (n,) [1/s] by growth, the fastest first; `modes` (n, n) are their columns over `names`, the largest entry 1.
    `labels` tell zeros: "family" for those that lead to another steady motion, "defective" for those beside them along which
    deviations grow with time. Derivatives are exact but for rounding; `error` is how far a quotient of small differences along
    one direction is from them, relative: about 1e-9, as such quotients are.
    """

    names: tuple[str, ...]
    A: Array
    B: Array
    controls: tuple[str, ...]
    eigenvalues: NDArray[np.complex128]
    modes: NDArray[np.complex128]
    labels: tuple[str, ...]
    error: float
    residual: float  # largest rate that the motion itself has: not 0 where it is not steady
    scene: Scene
    around: dict[str, float]  # coordinates and rates by name

    @property
    def growth(self) -> float:
        """Largest growth [1/s] of a deviation that does not lead to another steady motion."""
        found = [value.real for value, label in zip(self.eigenvalues, self.labels, strict=True) if label != FAMILY]
        return float(max(found, default=0.0))

    @property
    def stability(self) -> str:
        """"asymptotically stable", "neutral" (to first order nothing grows or decays) or "unstable", modulo the family."""
        size = max(1.0, float(np.abs(self.eigenvalues).max(initial=0.0)))
        if DEFECTIVE in self.labels or self.growth > GROWS * size:
            return "unstable"
        alone = len(self.eigenvalues) == self.labels.count(FAMILY)
        return "neutral" if self.growth > -GROWS * size and not alone else "asymptotically stable"

    def mode(self, k: int, size: float = SIZE) -> Mode:
        """Return mode k as a motion to look at, by `vlmb.view.picture`, `play` or `export_html`.

        It swings as far as `size` [rad], or of a length. Raises StudyError for a mode that is none, or that moves no posture.
        """
        if not 0 <= k < len(self.eigenvalues):
            raise StudyError(f"mode {k}: there are modes 0 to {len(self.eigenvalues) - 1}")
        chart, start = _chart(self.scene, self.around), dict(zip(self.names, self.modes[:, k].tolist(), strict=True))
        basis, _ = independent(chart, chart.numbers(chart.origin))
        return mode_about(chart, basis, k, complex(self.eigenvalues[k]), self.labels[k], start, size)

    def __repr__(self) -> str:
        labelled = zip(self.eigenvalues, self.labels, strict=True)
        shown = [f"{value:.6g}{f' ({label})' if label else ''}" for value, label in labelled]
        return f"<Linearization in {listed(self.names)}: {self.stability}; eigenvalues {listed(shown)}>"


def linearize(
    what: Steady | Scene | str | Path | Mapping[str, Any],
    coordinates: Mapping[str, float] | None = None,
    rates: Mapping[str, float] | None = None,
    *,
    controls: Sequence[str] | None = None,
) -> Linear:
    """Linearize the equations of motion around a steady motion, or around a state of a scene.

    Symmetries are divided out as `steady` does: azimuths and directions are counted from the heading. Positions are those that
    rows of positions leave, velocities those that all rows leave. With a programme A is that of the closed loop. Contacts and
    friction stay as they are at this state: feet that hold and a ski on the snow are rows. Azimuth and elevation are the
    coordinates of a link; near the pole the horizontal components of its direction, `legs.direction.x`.

    Parameters
    ----------
    coordinates : of the state, over the scene's start
    rates : the same
    controls : forces by name whose effect is B, added to whatever acts; default: those of the programme

    Raises SceneError for laws of time, unknown forces and contacts that strike, StudyError on a switch, or where the equations
    are not smooth.
    """
    if isinstance(what, Steady):
        if coordinates is not None or rates is not None:
            raise SceneError("linearize: a steady motion has its coordinates and rates; leave them out")
        scene, given = what.scene, {**what.coordinates, **what.rates}
    else:
        scene, given = as_scene(what), {**(coordinates or {}), **(rates or {})}
    refuse_time(scene)
    chart = _chart(scene, given)
    system = chart.system
    x = chart.numbers(chart.origin)
    both = derivatives(lambda at: np.concatenate(chart.equations(at)), x)
    full = both[: len(x)]
    error = _beside_quotient(chart, x, full)
    basis, names = _independent(chart, both[len(x) :])
    picks = [chart.names.index(name) for name in names]
    reduced = full[picks] @ basis
    used = tuple(controls if controls is not None else system.programme.names if system.programme else ())
    pushed = _pushes(scene, chart, used)[picks]
    values, modes, labels = _eigen(reduced)
    residual = float(np.abs(chart.rates(x)).max(initial=0.0))
    around = {**chart.start.coordinates, **chart.start.rates}
    return Linear(names, reduced, pushed, used, values, modes, labels, error, residual, scene, around)


def _chart(scene: Scene, given: Mapping[str, float]) -> Chart:
    """Make the chart around a state of a scene, in the phase in which it stands."""
    system = make_system(build(scene))
    return chart_at(system, _start(system, given))


def _start(system: System, given: Mapping[str, float]) -> Start:
    """Return the state that is meant, as given: rows are not repaired where everything is."""
    names = system.mechanism.names
    start = start_in_phase(system, 0.0)
    plain = names.canonical(given, "linearize")
    known = {**start.coordinates, **start.rates}
    for name in plain:
        if name not in known:
            names.find(name, "linearize")
            raise SceneError(f"linearize: {name!r} is no coordinate and no rate of this scene; {names.hint(name)}")
    known.update({name: float(value) for name, value in plain.items()})
    coordinates = {name: known[name] for name in start.coordinates}
    rates = {name: known[name] for name in start.rates}
    return start._replace(state=system.mechanism.state(coordinates, rates), coordinates=coordinates, rates=rates)


def independent(chart: Chart, x: Array) -> tuple[Array, tuple[str, ...]]:
    """Return how all numbers of a chart follow (n, m) from those that rows leave independent, and the names of these."""
    if not len(chart.positional):
        return np.eye(len(x)), chart.names
    return _independent(chart, derivatives(lambda at: chart.equations(at)[1], x))


def _independent(chart: Chart, rows: Array) -> tuple[Array, tuple[str, ...]]:
    """The same by the derivatives (r, n) of what rows lack."""
    if not len(rows):
        return np.eye(len(chart.names)), chart.names
    _, sizes, right = np.linalg.svd(rows * chart.scales)
    rank = int((sizes > FLAT * sizes[0]).sum())
    null = chart.scales[:, None] * right[rank:].T
    picks, left_over = list[int](), null / chart.scales[:, None]
    count = len(chart.positions)
    for part in (range(count), range(count, len(chart.names))):  # positions first, then what velocities add
        own, left_over = _picked(left_over, list(part))
        picks += own
    return null @ np.linalg.inv(null[picks]), tuple(chart.names[k] for k in picks)


def _picked(matrix: Array, rows: Sequence[int]) -> tuple[list[int], Array]:
    """Return independent ones among some rows, in order, and the matrix (n, k) on the directions in which those are 0."""
    from scipy.linalg import qr

    part = matrix[rows]
    if not part.size:
        return [], matrix
    _, sizes, order = qr(part.T, pivoting=True)
    rank = int((np.abs(np.diag(sizes)) > FLAT * max(abs(float(sizes[0, 0])), FLAT)).sum())
    picks = sorted(rows[k] for k in order[:rank])
    rest = np.linalg.svd(matrix[picks])[2][rank:].T if rank else np.eye(matrix.shape[1])
    return picks, matrix @ rest


def _pushes(scene: Scene, like: Chart, names: Sequence[str]) -> Array:
    """Return what unit forces add to the rates of a chart's numbers (n, controls); a programme does not see them."""
    plain = scene.changed(programme=None, programmes=None)
    system, footings = make_system(build(plain), inputs=list(names) or None), footings_of(like.system)
    chart = Chart(system.phase(footings) if footings else system, like.start, like=like)
    return chart.pushes()


def _beside_quotient(chart: Chart, x: Array, matrix: Array) -> float:
    """Return how far a quotient of small differences along a direction is from the derivatives (n, n), relative to the largest.

    At a kink, or where angles have no direction, calculus gives derivatives that are none: raises StudyError there.
    """
    way, size = np.random.default_rng(1).standard_normal(len(x)), max(1.0, float(np.abs(matrix * chart.scales).max(initial=0.0)))
    least, why = np.inf, ""
    for step in STEPS:
        nudge = step * chart.scales * way
        try:
            quotient = (chart.rates(x + nudge) - chart.rates(x - nudge)) / (2.0 * step)
        except VlmbError as refused:  # beyond a pole or a limit: nearer
            why = f": {refused}"
            continue
        least = min(least, float(np.abs(quotient - matrix @ (chart.scales * way)).max(initial=0.0)) / size)
    if not np.isfinite(least):
        raise StudyError(f"there are no derivatives here{why}")
    if least > LOOSE:
        raise StudyError(f"the accelerations are not smooth here: derivatives are off by {least:.1g} from a small step's")
    return least


def _zeros(matrix: Array) -> tuple[int, int]:
    """Return how many directions a matrix leaves at rest, and how often 0 is an eigenvalue.

    Rounding splits a defective 0 into roots of its size: eigenvalues alone do not tell. The directions at rest are taken away,
    and what is left of the matrix has more of them as often as 0 is defective. (Ranks of its powers would take slow modes of
    something stiff for 0.)
    """
    from scipy.linalg import matrix_balance

    left, counts = matrix_balance(matrix, permute=False)[0], list[int]()
    least = FLAT * max(float(np.linalg.norm(left, 2)), 1.0)
    while len(left):
        _, sizes, right = np.linalg.svd(left)
        count = int((sizes <= least).sum())
        if not count:
            break
        counts.append(count)
        rest = right[: len(right) - count]
        left = rest @ left @ rest.T
    return counts[0] if counts else 0, sum(counts)


def _eigen(matrix: Array) -> tuple[NDArray[np.complex128], NDArray[np.complex128], tuple[str, ...]]:
    """Return eigenvalues by growth, modes and labels; zeros are told from defective ones by the rank."""
    if not len(matrix):
        return np.zeros(0, complex), np.zeros((0, 0), complex), ()
    values, modes = np.linalg.eig(matrix)
    family, zeros = _zeros(matrix)
    labels = np.full(len(values), "", dtype=object)
    for place, k in enumerate(np.argsort(np.abs(values))[:zeros].tolist()):
        values[k], labels[k] = 0.0, FAMILY if place < family else DEFECTIVE
    size = max(float(np.abs(values).max()), 1e-300)
    growth, turning = np.round(values.real / size, ALIKE), np.round(np.abs(values.imag) / size, ALIKE)
    order = np.lexsort((-values.imag, turning, -growth))  # what differs by rounding alone does not change places
    modes = modes / np.where(np.abs(modes).max(axis=0) > 0.0, modes[np.abs(modes).argmax(axis=0), np.arange(len(values))], 1.0)
    return values[order].astype(complex), modes[:, order].astype(complex), tuple(str(labels[k]) for k in order)

