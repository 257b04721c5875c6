"""Steady motions: relative equilibria, in which nothing changes but place and heading."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, StudyError, VlmbError, finite
from vlmb.model.mechanism import build
from vlmb.model.names import DOT
from vlmb.model.reading import read_along
from vlmb.scene.names import PHASE_START, listed
from vlmb.scene.scene import Scene, as_scene
from vlmb.studies.chart import Chart, chart_at
from vlmb.studies.standing import in_phase, standing
from vlmb.system.jets import Numbers, as_numbers, derivatives
from vlmb.system.pace import laws_of
from vlmb.system.start import Start
from vlmb.system.system import System, make_system

Array = NDArray[np.float64]

ROUNDS, HELD, FLAT = 60, 1e-10, 1e-7  # iterations; the residual that is accepted; singular values over the largest that are none
RADIUS = "radius"
Held = Callable[[Numbers], Numbers]


@dataclass(frozen=True, eq=False)
class Steady:
    """A steady motion: coordinates and rates by name at one instant of it, place and heading as in the scene's start.

    `residual` is the largest rate [1/s, 1/s^2] that should be none; `rank` of the equations on `unknowns` numbers: what is
    left is a family of steady motions, such as those of other speeds.
    """

    scene: Scene
    coordinates: dict[str, float]
    rates: dict[str, float]
    residual: float
    rank: int
    unknowns: int
    held: dict[str, float]

    @property
    def family(self) -> int:
        """Dimensions of the family of steady motions around this one, what is held left free."""
        return self.unknowns - self.rank

    def __repr__(self) -> str:
        shown = [f"{name} = {value:.6g}" for name, value in {**self.coordinates, **self.rates}.items() if value]
        return f"<Steady motion of {self.scene.name!r}: {listed(shown) or 'at rest'}; residual {self.residual:.1e}>"

    @property
    def start(self) -> dict[str, float]:
        """The start of a run of it: `simulate(scene, start=steady.start)`."""
        names = {name for name in self.coordinates if not self._is_prescribed(name)}
        found = {name: value for name, value in self.coordinates.items() if name in names}
        return found | {name: value for name, value in self.rates.items() if name.removesuffix(DOT) in names}

    def _is_prescribed(self, name: str) -> bool:
        if not name.startswith("xi"):
            return False
        link, segment = (int(part) for part in name.removeprefix("xi").split("_"))
        return self.scene.links[link - 1].segment(segment).motion == "prescribed"


def steady(
    scene: Scene | str | Path | Mapping[str, Any],
    hold: Mapping[str, float] | None = None,
    *,
    guess: Mapping[str, float] | None = None,
) -> Steady:
    """Find a steady motion near the start of a scene: accelerations are 0, and so is every rate but those of place and heading.

    Place is divided out where nothing depends on it, the heading (of a pivot or free base: the azimuth of one link) on the level
    where nothing names it.

    Parameters
    ----------
    hold : {name: value}: any quantity, `speed` among them, and `radius` = speed / phi0' [m] of a ski's turn, positive to the left
    guess : coordinates and rates by name over the scene's start, where the search begins

    Raises SceneError for a scene whose laws depend on time, and for a radius on a slope; StudyError where no steady motion is
    found: the residual stays.
    """
    scene = as_scene(scene)
    refuse_time(scene)
    hold = {name: finite(f"hold: {name}", value) for name, value in (hold or {}).items()}
    chart = _first_chart(scene, hold, guess or {})
    _refuse_unknown(chart, hold)
    x = chart.numbers(chart.origin)
    for _ in range(3):  # a chart around what was found: links may have come near the pole, or away from it
        x, residual = _solved(chart, x, hold)
        moved = _chart_around(chart, x)
        if moved.names == chart.names:
            break
        chart, x = moved, moved.numbers(moved.origin)
    if not residual <= HELD * max(1.0, float(np.abs(x).max(initial=0.0))):
        worst = _worst(chart, x, hold)
        raise StudyError(
            f"no steady motion near this start: {worst} stays at {residual:.3g}; begin nearer to one (guess), hold other "
            "quantities, or there is none"
        )
    _refuse_other_phase(scene, chart.system, _chart_around(chart, x).start)
    matrix = derivatives(lambda at: np.concatenate(chart.equations(at)), x)
    coordinates, rates = named_at(chart, x)
    return Steady(scene, coordinates, rates, residual, _rank(matrix), len(x), dict(hold))


def refuse_time(scene: Scene) -> None:
    """Raise SceneError for a scene with laws of time: no motion of it is steady."""
    timed = [str(root.text) for root in laws_of(scene) if root.names & {"t", PHASE_START, *_signals(scene)}]
    if timed:
        raise SceneError(f"the law {timed[0]!r} depends on time: there is no steady motion; see vlmb.periodic")


def _signals(scene: Scene) -> frozenset[str]:
    columns = [f"{entry.name}.{column}" for entry in scene.data for column in entry.columns]
    return frozenset(f"{column}{rate}" for column in columns for rate in ("", DOT, "_ddot"))


def _first_chart(scene: Scene, hold: Mapping[str, float], guess: Mapping[str, float]) -> Chart:
    """Make the chart around the start with what is held put into it, as far as a start may say it."""
    names = build(scene).names
    given = dict(guess)
    for name, value in hold.items():
        if name in names and names.find(name).name in names.known and names.find(name).name not in given:
            given[names.find(name).name] = value
    if RADIUS in hold and "speed" in hold and f"phi0{DOT}" not in given:
        given[f"phi0{DOT}"] = hold["speed"] / hold[RADIUS]
    start = {k: v for k, v in names.canonical(scene.start, "start").items() if k not in given}
    if "speed" in given:
        start = {k: v for k, v in start.items() if k not in ("x_dot", "y_dot")}
    try:
        scene = scene.changed(start=None).changed(start={**start, **given})
        return chart_at(make_system(build(scene)))
    except SceneError:
        if guess:
            raise
        return chart_at(make_system(build(scene)))


def _refuse_unknown(chart: Chart, hold: Mapping[str, float]) -> None:
    scene, names = chart.system.mechanism.scene, chart.system.mechanism.names
    for name, value in hold.items():
        if name != RADIUS:
            names.find(name, "hold")
            continue
        if not scene.on_snow:
            raise SceneError("hold: radius is that of a ski's turn; this scene has none")
        if scene.slope:
            raise SceneError("hold: radius: on a slope no turn is steady; set slope = 0")
        if not value:
            raise SceneError("hold: radius = 0: a ski that turns on the spot has speed = 0; hold that, and phi0_dot")
    if "phi0" in hold and chart.turning:
        raise SceneError("hold: phi0 is divided out: every heading has the same steady motions")


def _chart_around(chart: Chart, x: Array) -> Chart:
    coordinates, rates = named_at(chart, x)
    start = chart.start._replace(
        state=chart.system.mechanism.state(coordinates, rates), coordinates=coordinates, rates=rates
    )
    return Chart(chart.system, start)


def named_at(chart: Chart, x: Array) -> tuple[dict[str, float], dict[str, float]]:
    """Return coordinates and rates by name, with the place and the heading of the start."""
    y = chart.placed(x)
    seen = chart.system.core_plan.postures(np.array([chart.t]), y[None])
    values, rates = read_along(seen, np.array([chart.t]), chart.values[None])
    names = chart.layout.names
    return (
        dict(zip(names, values[0].tolist(), strict=True)),
        {f"{name}{DOT}": rate for name, rate in zip(names, rates[0].tolist(), strict=True)},
    )


def _refuse_other_phase(scene: Scene, system: System, start: Start) -> None:
    """Raise StudyError where contacts do not stand as they did at the start of the search."""
    if system.contacts is None:
        return
    asked, found = standing(system), standing(in_phase(make_system(build(scene)), start))
    if found != asked:
        raise StudyError(
            f"a steady motion with contacts as at the start ({listed(asked)}) is none that they allow: there they would be "
            f"{listed(found)}; begin in another phase, or hold other quantities"
        )


def _holding(chart: Chart, hold: Mapping[str, float]) -> Held:
    """Return what tells how far quantities are from what is held."""
    names = dict.fromkeys(name for name in hold if name != RADIUS)
    if RADIUS in hold:
        names |= dict.fromkeys(("speed", f"phi0{DOT}"))
    read = chart.reading(list(names))

    def off(x: Numbers) -> Numbers:
        seen = dict(zip(names, read(x), strict=True))
        turns = [seen[f"phi0{DOT}"] - seen["speed"] / value for name, value in hold.items() if name == RADIUS]
        return as_numbers([*(seen[name] - value for name, value in hold.items() if name != RADIUS), *turns])

    return off


def _lacking(chart: Chart, x: Numbers, held: Held) -> Numbers:
    """Return what a steady motion must not have, what rows lack, and what is held."""
    return np.concatenate([*chart.equations(x), held(x)])


def _solved(chart: Chart, x: Array, hold: Mapping[str, float]) -> tuple[Array, float]:
    """Search by Gauss-Newton of least norm with shorter steps where they do not help; return where it ends and what is left."""
    held = _holding(chart, hold)
    error = _lacking(chart, x, held)
    for _ in range(ROUNDS):
        size = float(np.linalg.norm(error))
        if size < 1e-13:
            break
        matrix = derivatives(lambda at: _lacking(chart, at, held), x) * chart.scales
        left, sizes, right = np.linalg.svd(matrix, full_matrices=False)
        useful = sizes > FLAT * sizes[0]
        step = chart.scales * (right[useful].T @ ((left[:, useful].T @ -error) / sizes[useful]))
        longest = float(np.abs(step / chart.scales).max(initial=0.0))
        step *= min(1.0, 0.5 / max(longest, 0.5))
        for share in (1.0, 0.5, 0.2, 0.05, 0.01):
            try:
                found = _lacking(chart, x + share * step, held)
            except VlmbError:
                continue
            if float(np.linalg.norm(found)) < size:
                x, error = x + share * step, found
                break
        if not float(np.linalg.norm(error)) < (0.5 if size < HELD else 1.0) * size:
            break  # no step helps, or rounding is what is left
    return x, float(np.abs(error).max(initial=0.0))


def _worst(chart: Chart, x: Array, hold: Mapping[str, float]) -> str:
    error = np.abs(_lacking(chart, x, _holding(chart, hold)))
    names = [f"the rate of {name}" for name in chart.names]
    own = sorted(hold, key=lambda name: name == RADIUS)  # it comes last
    names += ["a constraint"] * (len(error) - len(names) - len(hold)) + [f"{name} (held)" for name in own]
    return names[int(np.argmax(error))]


def _rank(matrix: Array) -> int:
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return int((sizes > FLAT * max(float(sizes[0]), 1e-300)).sum()) if sizes.size else 0

