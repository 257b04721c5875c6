"""Work and precision: what each method and each form of the knife edge costs, and how far it is from a reference."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError
from vlmb.model.mechanism import Mechanism, build
from vlmb.scene.rows import rows_of
from vlmb.scene.scene import Scene
from vlmb.simulation.methods import METHODS, find_method
from vlmb.simulation.simulate import simulate
from vlmb.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

TOLERANCES = tuple(10.0 ** -(k / 2) for k in range(6, 25, 2))
STEPS = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4)  # [s]
ATOL = 0.1  # atol / rtol, of every adaptive run
GAINS = (0.0, 5.0, 50.0)  # [1/s] of the knife edge as a multiplier
TIGHT = (("dop853", 2e-13), ("adams", 1e-12))  # the reference, and the run that says how good it is
QUANTITIES = {"position": "m", "angle": "rad", "reaction": "N", "energy": "J"}


class Variant(NamedTuple):
    """A way to run a scene."""

    method: str
    knife_edge: str = "reduction"
    gain: float | None = None

    @property
    def label(self) -> str:
        """Such as `adams`, `rk4, multiplier 5/s`."""
        if self.knife_edge == "reduction":
            return self.method
        return f"{self.method}, {self.knife_edge}" + (f" {self.gain:g}/s" if self.gain is not None else "")


class Motion(NamedTuple):
    """What is compared: points [m] and directions (T, k, 3), forces [N] (T, r, 3), sampled at the same times."""

    points: Array
    directions: Array
    forces: Array


@dataclass
class Entry:
    """One variant at one setting: its cost, errors by quantity as (final, max), or the sentence of a run that did not finish."""

    variant: Variant
    setting: float  # rtol, or the step [s]
    seconds: float = math.inf  # processor time, fastest of the repeats
    evaluations: int = 0
    steps: int = 0
    errors: dict[str, tuple[float, float]] = field(default_factory=dict)
    failure: str = ""

    @property
    def position(self) -> float:
        """Final position error [m]; inf for a run that failed."""
        return self.errors["position"][0] if self.errors else math.inf


@dataclass(frozen=True)
class Measured:
    """All entries of a scene, and how good the reference is."""

    name: str
    duration: float
    reference: str
    uncertainty: dict[str, tuple[float, float]]  # (final, max) by quantity
    entries: list[Entry]
    left_out: list[str]


def variants(scene: Scene, methods: Sequence[str] | None = None) -> list[Variant]:
    """List every method, on a ski with every form of the knife edge."""
    forms: list[tuple[str, float | None]] = [("reduction", None)]
    if scene.on_snow:
        forms += [*(("multiplier", gain) for gain in GAINS), ("projection", None)]
    return [Variant(find_method(method).name, *form) for form in forms for method in (methods or METHODS)]


def observe(trajectory: Trajectory) -> Motion:
    """Collect points of the base and tips, directions of links and ski, forces of hinges and snow."""
    layout, size = trajectory.mechanism.layout, len(trajectory)
    points, directions, forces = [], [], []
    zero = np.zeros(size)
    if layout.headed:
        points.append(np.column_stack([trajectory["x"], trajectory["y"], zero]))
        directions.append(np.column_stack([np.cos(trajectory["phi0"]), np.sin(trajectory["phi0"]), zero]))
        forces += [np.column_stack([zero, trajectory.reactions["knife_edge"], trajectory.reactions["normal"]])]
    elif layout.base == "free":
        points.append(np.column_stack([trajectory[name] if name in trajectory.names else zero for name in "xyz"]))
    for link in layout.links:
        points.append(trajectory.position(link.name, "tip"))
        directions.append(np.column_stack([trajectory[f"{link.name}.direction.{axis}"] for axis in "xyz"]))
        forces.append(trajectory.hinge_force(link.name))
    return Motion(*(np.stack(part, axis=1) for part in (points, directions, forces)))


def compare(motion: Motion, reference: Motion) -> dict[str, tuple[float, float]]:
    """Largest distance [m], angle between directions [rad] and difference of forces [N]: (final, max over time)."""
    distances = np.linalg.norm(motion.points - reference.points, axis=2)
    angles = 2.0 * np.arcsin(np.minimum(1.0, 0.5 * np.linalg.norm(motion.directions - reference.directions, axis=2)))
    forces = np.linalg.norm(motion.forces - reference.forces, axis=2)
    return {"position": _pair(distances), "angle": _pair(angles), "reaction": _pair(forces)}


def own_errors(trajectory: Trajectory) -> dict[str, tuple[float, float]]:
    """What needs no reference: energy balance [J]; residuals of ideal rows, each in its equation's unit and per second."""
    found = {"energy": _pair(trajectory["balance"])}
    rows = rows_of(trajectory.scene)
    keys = {name: name for name in ("knife_edge", *(row.name for row in rows.ideal))}
    keys |= {f"programme, {row.name}": row.name for row in rows.servo}
    for name, key in keys.items():
        residual = trajectory.residuals.get(key)
        if residual is not None:
            if residual.position is not None:
                found[f"{name}: position"] = _pair(residual.position)
            found[f"{name}: velocity"] = _pair(residual.velocity)
    return found


def measure(
    scene: Scene,
    duration: float | None = None,
    methods: Sequence[str] | None = None,
    exact: Callable[[Array], Motion] | None = None,
    rivals: Mapping[str, tuple[Sequence[float], Callable[[float], float]]] | None = None,
    samples: int = 51,
    repeats: int = 5,
    budget: float = 1.0,
    progress: Callable[[str], None] = lambda text: None,
) -> tuple[Measured, dict[str, dict[float, float]]]:
    """Run every variant at every setting: errors against the reference, then times.

    Parameters
    ----------
    exact : the true motion at times (T,), where one is known; otherwise a tight run is the reference
    rivals : by name, settings and a function that runs one and returns its processor seconds; timed in the same turns
    samples : times at which errors are taken; timed runs give the end alone
    repeats : turns through all runs; the fastest counts
    budget : [s] a sweep of settings ends after a run that took longer

    Returns what was measured, and the seconds of the rivals by name and setting.
    Raises SceneError for a scene that does not reach its end.
    """
    mechanism = build(scene)
    end = scene.run.duration if duration is None else duration
    times = np.linspace(0.0, end, samples)
    tight = [_tight(mechanism, method, rtol, times) for method, rtol in TIGHT]
    truth, text = observe(tight[0]), f"{TIGHT[0][0]} at rtol {TIGHT[0][1]:g}"
    uncertainty = compare(observe(tight[1]), truth) | own_errors(tight[0])
    text += f", beside {TIGHT[1][0]} at {TIGHT[1][1]:g}"
    if exact is not None:
        known = exact(times)
        uncertainty, truth, text = dict.fromkeys(("position", "angle", "reaction"), (0.0, 0.0)), known, "exact solution"
    entries: list[Entry] = []
    left_out = []
    for variant in variants(scene, methods):
        adaptive = find_method(variant.method).adaptive
        settings: tuple[float, ...] = TOLERANCES if adaptive else tuple(step for step in STEPS if step <= end / 5)
        for setting in settings:
            entry = _first_run(mechanism, variant, setting, times, truth)
            entries.append(entry)
            progress(f"{scene.name}: {variant.label} at {setting:.2g}: {entry.failure or f'{entry.position:.1e} m'}")
            if entry.seconds > budget and setting != settings[-1]:
                left_out.append(f"{variant.label} finer than {setting:.2g}: more than {budget:g} s a run")
                break
    others = {name: dict.fromkeys(rival[0], math.inf) for name, rival in (rivals or {}).items()}
    for _ in range(repeats):
        _one_turn(mechanism, entries, end, budget)
        for name, (theirs, once) in (rivals or {}).items():
            for setting in theirs:
                others[name][setting] = min(others[name][setting], once(setting))
    return Measured(scene.name, end, text, uncertainty, entries, left_out), others


def front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Keep of (cost, error) what no cheaper one beats in error, cheapest first."""
    kept: list[tuple[float, float]] = []
    for cost, error in sorted(points):
        if math.isfinite(cost) and math.isfinite(error) and (not kept or error < kept[-1][1]):
            kept.append((cost, error))
    return kept


def cost_at(points: Sequence[tuple[float, float]], error: float) -> float:
    """Cost at which an error is reached, between two runs on their log-log line; nan where none reaches it."""
    kept = front(points)
    if kept and kept[0][1] <= error:
        return kept[0][0]
    for (cheap, rough), (dear, fine) in pairwise(kept):
        if fine <= error:
            share = math.log(rough / error) / math.log(rough / max(fine, 1e-300))
            return math.exp((1.0 - share) * math.log(cheap) + share * math.log(dear))
    return math.nan


def _pair(values: Array) -> tuple[float, float]:
    return float(np.abs(values[-1]).max(initial=0.0)), float(np.abs(values).max(initial=0.0))


def _options(variant: Variant, setting: float) -> dict[str, Any]:
    chosen: dict[str, Any] = {"method": variant.method, "knife_edge": variant.knife_edge, "gain": variant.gain}
    if find_method(variant.method).adaptive:
        return {**chosen, "rtol": setting, "atol": ATOL * setting}
    return {**chosen, "step": setting}


def _tight(mechanism: Mechanism, method: str, rtol: float, times: Array) -> Trajectory:
    found = simulate(mechanism, float(times[-1]), method, rtol, atol=ATOL * rtol, t_eval=times, knife_edge="reduction")
    if found.status != "finished":
        raise SceneError(f"no reference: {found.message} Choose a duration that the motion reaches")
    return found


def _first_run(mechanism: Mechanism, variant: Variant, setting: float, times: Array, truth: Motion) -> Entry:
    """Run once with samples: the warm-up, and the errors."""
    trajectory = simulate(mechanism, float(times[-1]), t_eval=times, **_options(variant, setting))
    stats = trajectory.stats
    entry = Entry(variant, setting, float(stats["cpu_time"]), int(stats["rhs_evaluations"]), int(stats["steps"]))
    if trajectory.status == "finished":
        entry.errors = compare(observe(trajectory), truth) | own_errors(trajectory)
    else:
        entry.failure = trajectory.message
    return entry


def _one_turn(mechanism: Mechanism, entries: Sequence[Entry], end: float, budget: float) -> None:
    """Time every run once more that finished within the budget; the others keep the time of their first run."""
    for entry in entries:
        if entry.failure or entry.seconds > budget:
            continue
        gc.disable()
        try:
            stats = simulate(mechanism, end, t_eval=[end], **_options(entry.variant, entry.setting)).stats
        finally:
            gc.enable()
        entry.evaluations, entry.steps = int(stats["rhs_evaluations"]), int(stats["steps"])
        entry.seconds = min(entry.seconds, float(stats["cpu_time"]))
