"""Numbers that are changed without checking the whole scene again: what is changed, or refused, is what the check of it says."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.scene.keys import changed_data
from vlmb.scene.renumbered import differ_in_numbers, renumbered
from vlmb.system.system import make_system

MODELS = Path(__file__).resolve().parents[2] / "models"
KEYS = (
    "links.0.lower.stiffness", "links[0].lower.damping", "links.0.lower.rest", "links.0.upper.stiffness", "links.0.upper.rest",
    "links.0.lower.length", "links.7.lower.rest", "links.0.lower.stiffnes", "links.0.lower", "start.phi1", "start.speed",
    "start.x[1]", "start", "run.rtol", 3, None,
)  # fmt: skip
VALUES = (
    300, 2.5, 0, -0.0, -1.0, 1e-60, 1e60, math.nan, math.inf, 2**63 + 1, 10**400, True, "2*k", "300", None, np.float64(2.5),
    np.float32(2.5), np.int64(3), [1.0], {"a": 1.0},
)  # fmt: skip


def result(make: Any) -> Any:
    try:
        return make()
    except Exception as error:
        return type(error), str(error)


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("model", ["one_link", "skier_two_links"])
def test_a_change_is_what_the_check_of_the_whole_scene_makes_of_it(model: str, key: Any) -> None:
    scene = vlmb.load_scene(MODELS / f"{model}.toml")
    for value in VALUES:
        whole = result(lambda value=value: vlmb.Scene.from_dict(changed_data(scene, {key: value}), "changed scene"))
        quick = result(lambda value=value: scene.changed_at({key: value}))
        assert quick == whole, value
        if isinstance(quick, vlmb.Scene):
            assert repr(quick.to_dict()) == repr(whole.to_dict()) and hash(quick) == hash(whole)


def test_expressions_stay_expressions() -> None:
    scene = vlmb.load_scene(MODELS / "one_link.toml").changed(parameters={"k": 100.0})
    written = scene.changed_at({"links.0.lower.stiffness": "2*k"})
    again = scene.changed_at({"links.0.lower.stiffness": written.links[0].lower.stiffness})
    assert again == written and again.to_dict()["links"][0]["lower"]["stiffness"] == "2*k"
    assert renumbered(scene, {"links.0.lower.stiffness": written.links[0].lower.stiffness}) is None
    assert differ_in_numbers(scene, written)  # its value is a number like any other


def test_only_numbers_of_springs_and_of_the_start_share_a_system() -> None:
    scene = vlmb.load_scene(MODELS / "one_link.toml")
    mechanism = vlmb.build(scene)
    vlmb.simulate(mechanism, duration=0.01)
    run = mechanism.scene.run
    plan = make_system(mechanism, run).core_plan
    for changes, shares in (
        ({"links.0.lower.stiffness": 310.0}, True), ({"links.0.lower.rest": 0.2, "start.psi1": 0.1}, True),
        ({"links.0.lower.stiffness": 0.0}, False), ({"links.0.lower.damping": 1.0}, False),
        ({"links.0.lower.length": 0.3}, False),
        ({"links.0.rod.mass": 3.0}, False), ({"gravity": 1.6}, False), ({"name": "another"}, False),
    ):  # fmt: skip
        changed = scene.changed_at(changes)
        assert differ_in_numbers(scene, changed) == shares, changes
        assert (make_system(vlmb.build(changed), run).core_plan.table is plan.table) == shares, changes
