"""Runs of the default method and of other engines on one scene, with the errors of their ends: what ratios are made of."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from typing import Any

from common import CLOCK

# isort: split
import numpy as np
from peers.chain import Outcome

from vlmb.model.mechanism import build
from vlmb.scene.scene import Scene
from vlmb.simulation.simulate import simulate
from vlmb.studies.bench import ERRORS
from vlmb.studies.work_precision import TIGHT, Array, cost_at, observe

FINE = tuple(10.0 ** -(k / 2) for k in range(4, 25))
BASELINE = "plain_pinocchio"
SAMPLED = 60.0  # [1/s] of the second comparison with the baseline
NEARBY = 9  # starts near a scene's own: one start alone may suit one side by chance


class Rival:
    """Another engine on one scene: errors of its settings, and a timed run."""

    def __init__(
        self, label: str, run: Callable[[float], Outcome], settings: tuple[float, ...], truth: Array, budget: float
    ) -> None:
        self.label, self.run, self.truth = label, run, truth
        self.errors: dict[float, float] = {}
        self.evaluations: dict[float, int | None] = {}
        self.failures: list[str] = []
        for setting in settings:  # the warm-up
            began = CLOCK()
            try:
                outcome = run(setting)
            except (ArithmeticError, RuntimeError, ValueError) as error:
                why = str(error).splitlines()[0] if str(error) else type(error).__name__
                self.failures.append(f"{label} at {setting:.2g}: {why}")
                continue
            error_now = float(np.linalg.norm(outcome.points - self.truth, axis=1).max())
            self.errors[setting] = error_now if math.isfinite(error_now) else math.inf
            self.evaluations[setting] = outcome.evaluations
            if CLOCK() - began > budget:
                break

    def timed(self, setting: float) -> float:
        """Processor seconds of one run."""
        began = CLOCK()
        self.run(setting)
        return CLOCK() - began


def ours(
    scene: dict[str, Any], duration: float, samples: bool, truth: Array
) -> tuple[tuple[float, ...], Callable[[float], float], dict[float, float]]:
    """The default method at the baseline's tolerances: its timed run and its errors."""
    mechanism = build(Scene.from_dict(scene))
    when = times_of(duration, samples)

    def run(rtol: float) -> Any:
        return simulate(mechanism, duration, rtol=rtol, atol=0.1 * rtol, t_eval=when)

    errors = {}
    for rtol in FINE:
        found = run(rtol)
        off = float(np.linalg.norm(end_of(found) - truth, axis=1).max())
        errors[rtol] = off if found.status == "finished" else math.inf
    return FINE, lambda rtol: float(run(rtol).stats["cpu_time"]), errors


def times_of(duration: float, samples: bool) -> list[float]:
    """Return the end alone, or 60 times a second."""
    return np.linspace(0.0, duration, round(SAMPLED * duration) + 1).tolist() if samples else [duration]


def end_of(trajectory: Any) -> Array:
    """Points at the end (k, 3): the ski's point A or the pivot, then the tips."""
    points = observe(trajectory).points[-1]
    return points if trajectory.mechanism.layout.base == "ski" else np.vstack([np.zeros(3), points])


def nearby(scene: dict[str, Any], seed: int) -> dict[str, Any]:
    """Move the start a little: angles by up to 0.05 rad, rates by up to 5 %, lengths by up to 2 %."""
    random, moved = np.random.default_rng(seed), {}
    for name, value in scene["start"].items():
        share = random.uniform(-1.0, 1.0)
        if name.endswith("_dot") or name == "speed":
            moved[name] = value * (1.0 + 0.05 * share)
        else:
            moved[name] = value * (1.0 + 0.02 * share) if name.startswith("xi") else value + 0.05 * share
    return {**scene, "start": moved}


def ratios_nearby(scene: dict[str, Any], duration: float, repeats: int = 3) -> dict[str, list[list[float]]]:
    """Times of the default method over the baseline's at each error, start by start, with and without samples."""
    found: dict[str, list[list[float]]] = {"vlmb": [], "vlmb, sampled": []}
    for seed in range(NEARBY):
        moved = nearby(scene, seed)
        method, rtol = TIGHT[0]
        truth = end_of(simulate(Scene.from_dict(moved), duration, method, rtol, atol=0.1 * rtol, t_eval=[duration]))
        sides: dict[str, tuple[Callable[[float], float], dict[float, float]]] = {}
        for label, (settings, run) in importlib.import_module(f"peers.{BASELINE}").prepare(moved, duration).items():
            rival = Rival(label, run, settings, truth, math.inf)
            sides[label] = rival.timed, rival.errors
        for label in found:
            _, once, errors = ours(moved, duration, label.endswith("sampled"), truth)
            sides[label] = once, errors
        seconds = {label: dict.fromkeys(errors, math.inf) for label, (_, errors) in sides.items()}
        for _ in range(repeats):
            for label, (once, errors) in sides.items():
                for setting in errors:
                    seconds[label][setting] = min(seconds[label][setting], once(setting))
        costs = {
            label: [cost_at([(seconds[label][s], errors[s]) for s in errors], error) for error in ERRORS]
            for label, (_, errors) in sides.items()
        }
        for label in found:
            other = costs[label.replace("vlmb", "plain loop")]
            found[label].append([mine / theirs for mine, theirs in zip(costs[label], other, strict=True)])
    return found
