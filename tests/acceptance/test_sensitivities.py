"""Sensitivities through many events against differences of fourth order of runs at rtol 1e-13, 1e-7 relative."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.studies.runs import value_at

pytestmark = pytest.mark.acceptance

MODELS = Path(__file__).resolve().parents[2] / "models"
NEAR, STEPS = 1e-7, (1e-3, 3e-4, 1e-4)  # relative; of a number's size: the best of them is the witness


def model(name: str) -> vlmb.Scene:
    return vlmb.load_scene(MODELS / f"{name}.toml")


def limited(restitution: float) -> vlmb.Scene:
    """A swing whose length comes to its limit, where it bounces or is held."""
    lower = {"length": 0.3, "stiffness": 100.0, "limits": [0.1, 0.45], "at_limit": "bounce", "restitution": restitution}
    link = {"name": "legs", "rod": {"length": 0.5, "mass": 1.0}, "lower": lower, "tip_mass": 2.0}
    return vlmb.Scene.from_dict({"base": {"kind": "pivot"}, "plane": True, "links": [link], "start": {"psi1": -1.2}})


def phased() -> vlmb.Scene:
    """A ball with a force that breaks some time after each landing."""
    scene = model("bouncing_ball").changed(parameters={"late": 0.15})
    return scene.changed(forces=[{"on": "F_z", "law": "3*step(phase_t - late)"}])


SPRING = "links.legs.lower.stiffness"
CASES: dict[str, tuple[Any, list[str], list[str], float]] = {
    "rimless wheel": (lambda: model("rimless_wheel"), ["parameters.turning", "gravity"], ["psi1", "psi1_dot", "x"], 1.5),
    "SLIP runner": (lambda: model("slip_runner"), ["start.z", "legs.0.stiffness"], ["x", "z", "z_dot"], 1.5),
    "ski jump": (lambda: model("ski_jump"), ["start.speed"], ["x", "z", "z_dot", "x_dot"], 2.5),
    "friction of a ski": (lambda: model("skier_slalom_friction"), ["base.friction"], ["x", "psi1"], 1.0),
    "a limit that bounces": (lambda: limited(0.6), [SPRING, "links.legs.lower.limits.1"], ["psi1", "xi1_1"], 2.0),
    "a limit that holds": (lambda: limited(0.0), [SPRING, "start.psi1"], ["psi1", "psi1_dot"], 2.0),
    "a break after each landing": (phased, ["parameters.late", "start.z"], ["z", "z_dot"], 1.6),
}


@pytest.mark.parametrize("case", CASES)
def test_sensitivities_are_those_of_tight_differences(case: str) -> None:
    make, keys, names, duration = CASES[case]
    scene, t = make(), np.linspace(0.0, duration, 8)
    found = vlmb.sensitivities(scene, keys, names, t_eval=t)
    assert found.attrs["error"] < NEAR
    for key in keys:
        own = np.array([found[name].sel(parameter=key).values for name in names])
        apart = [_apart(own, _differences(scene, key, names, t, step)) for step in STEPS]
        print(f"{case}, {key}: apart by {min(apart):.1e} of the largest")
        assert min(apart) < NEAR


def _apart(own: np.ndarray, other: np.ndarray) -> float:
    return float((np.abs(own - other).max(axis=1) / np.maximum(np.abs(other).max(axis=1), 1e-9)).max())


def _differences(scene: vlmb.Scene, key: str, names: list[str], t: np.ndarray, step: float) -> np.ndarray:
    value = value_at(scene, key)
    size = max(abs(value), 0.1)

    def at(z: float) -> np.ndarray:
        changed = scene.changed_at({key: value + z * step * size})
        run = vlmb.simulate(changed, float(t[-1]), rtol=1e-13, atol=1e-15, t_eval=t)
        assert run.t[-1] == t[-1]
        return np.array([run[name][np.searchsorted(run.t, t, side="right") - 1] for name in names])

    return (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * step * size)
