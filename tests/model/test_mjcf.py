"""MJCF of link scenes: the same masses and the same motion in MuJoCo, where it is installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import vlmb
from vlmb.cli import main
from vlmb.model.memory import make_data
from vlmb.model.mjcf import mjcf
from vlmb.model.velocity_map import VelocityMap
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

SPRUNG = {"length": 0.3, "stiffness": 800.0, "damping": 3.0}
FORK = [
    {"name": "legs", "rod": {"length": 0.5, "mass": 3.0}, "lower": SPRUNG, "upper": {**SPRUNG, "length": 0.2}, "tip_mass": 2.0},
    {"name": "trunk", "rod": {"length": 0.6, "mass": 4.0}, "lower": SPRUNG},
    {"name": "arm", "parent": "trunk", "parent_point": "rod_end", "rod": {"length": 0.4, "mass": 1.0}, "tip_mass": 0.5,
     "upper": {"length": 0.1, "motion": "fixed"}},
]  # fmt: skip
START = {"phi1": 0.3, "psi1": -1.0, "phi2": 0.5, "psi2": -0.6, "psi3": -0.3, "phi1_dot": 1.0, "psi2_dot": -0.5, "xi1_1_dot": 0.2}
SCENES: dict[str, dict[str, Any]] = {
    "pivot": {"base": {"kind": "pivot"}, "links": FORK, "start": START},
    "free": {"base": {"kind": "free", "mass": 1.5}, "links": FORK, "start": {**START, "x_dot": 1.0, "z_dot": 2.0}, "slope": 0.2},
    "plane": {"base": {"kind": "pivot"}, "plane": True, "links": FORK, "start": {k: START[k] for k in START if "phi" not in k}},
}


@pytest.mark.parametrize("name", SCENES)
def test_mass_matrix_and_a_second_of_motion(name: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    scene = vlmb.Scene.from_dict({**SCENES[name], "run": {"duration": 1.0, "rtol": 1e-11, "fall": False}})
    mechanism = vlmb.build(scene)
    start = consistent_start(make_system(mechanism))
    there = mujoco.MjModel.from_xml_string(mjcf(mechanism, start.state))
    state = mujoco.MjData(there)
    mujoco.mj_resetDataKeyframe(there, state, 0)
    mujoco.mj_forward(there, state)
    whole = np.zeros((there.nv, there.nv))
    mujoco.mj_fullM(there, whole, state.qM) if hasattr(state, "qM") else mujoco.mj_fullM(there, state, whole)
    data = make_data(mechanism.model)
    change = VelocityMap(mechanism, start.coordinates, data)  # links without spin: a thin rod's axial inertia is not seen
    rates = change.velocities(np.eye(len(mechanism.coordinate_names)))
    eom = vlmb.equations_of_motion(mechanism, start.coordinates, start.rates)
    assert np.abs(rates @ whole @ rates.T - eom.mass_matrix).max() < 1e-10 * np.abs(eom.mass_matrix).max()
    run = vlmb.simulate(scene)
    while state.time < 1.0 - 1e-9:
        mujoco.mj_step(there, state)
    mujoco.mj_kinematics(there, state)
    for link in ("legs", "trunk", "arm"):
        body = state.body(link)
        point = run.position(link, "rod_start" if f"{link}.lower" in names_of(there) else "hinge")[-1]
        assert np.abs(body.xpos - point).max() < 1e-6, link


def names_of(model: Any) -> list[str]:
    return [model.joint(at).name for at in range(model.njnt)]


def test_text_is_xml_and_says_all_bodies() -> None:
    mechanism = vlmb.build(SCENES["free"])
    tree = ElementTree.fromstring(mjcf(mechanism))
    assert [body.get("name") for body in tree.iter("body")] == ["base", "legs", "legs.upper", "trunk", "arm"]
    assert len(list(tree.iter("joint"))) == 3 + 2 + 1 + 2 + 1


def test_what_has_no_counterpart_is_refused_or_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ski = {"base": {"kind": "ski", "mass": 5.0, "inertia": 1.0}, "links": FORK}
    with pytest.raises(vlmb.SceneError, match="no knife edge"):
        mjcf(vlmb.build(ski))
    models = Path(__file__).resolve().parents[2] / "models"
    assert main(["convert", str(models / "two_links.toml"), str(tmp_path / "two.xml")]) == 0
    assert "wrote" in capsys.readouterr().out
    assert ElementTree.parse(tmp_path / "two.xml").getroot().tag == "mujoco"
    assert main(["convert", str(models / "skier_one_link.toml"), str(tmp_path / "ski.xml")]) == 1
    assert "no knife edge" in capsys.readouterr().err
