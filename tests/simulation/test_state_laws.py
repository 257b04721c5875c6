"""Laws that see the state, in both engines: against controls that say the same, and against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import ANY_LENGTH, FLYING, MOVING, PIVOT, SKI, TIGHT, bent, link, scene
from vlmb.errors import ExpressionError, SceneError

ENGINES = ["core", "pinocchio"]
GLIDING = {"kind": "ski", "mass": 80.0, "inertia": 4.0, "com_offset": 0.0}


def with_law(made: vlmb.Scene, on: str, law: str, **run: Any) -> vlmb.Scene:
    data = made.to_dict()
    return vlmb.Scene.from_dict({**data, "forces": [{"on": on, "law": law}], "run": {**data["run"], "duration": 1.0, **run}})


CASES: dict[str, tuple[vlmb.Scene, str, str, Any]] = {
    "PD on an elevation": (
        bent(PIVOT, 1, start={"phi1": 0.4, "psi1": 0.7, "phi1_dot": 0.8}), "M_psi1", "-100*psi1 - 20*psi1_dot",
        lambda t, see: -100.0 * see["psi1"] - 20.0 * see["psi1_dot"],
    ),
    "drag on a ski": (
        bent(SKI, 1), "M_phi0", "-0.2*speed*abs(speed) + k*sin(phi0)*phi0_dot",
        lambda t, see: -0.2 * see["speed"] * abs(see["speed"]) + 3.0 * math.sin(see["phi0"]) * see["phi0_dot"],
    ),
    "points and lengths": (
        bent(SKI, 2), "F1_1", "-50*link2.tip.z_dot + 20*(link1.length - 1)*com.z - t*link2.direction.y",
        lambda t, see: (
            -50.0 * see["link2.tip.z_dot"] + 20.0 * (see["link1.length"] - 1.0) * see["com.z"] - t * see["link2.direction.y"]
        ),
    ),
    "a hinge": (
        bent(PIVOT, 2), "T_link2", "-8*phi2_dot + min(xi2_1, 0.3)",
        lambda t, see: -8.0 * see["phi2_dot"] + min(see["xi2_1"], 0.3),
    ),
    "in flight": (
        bent(FLYING, 2), "F_z", "-30*z - 4*z_dot", lambda t, see: -30.0 * see["z"] - 4.0 * see["z_dot"],
    ),
    "in a plane": (
        bent(PIVOT, 2, plane=True), "M_psi2", "-40*(psi2 - psi1) - 5*(psi2_dot - psi1_dot)",
        lambda t, see: -40.0 * (see["psi2"] - see["psi1"]) - 5.0 * (see["psi2_dot"] - see["psi1_dot"]),
    ),
    "a prescribed length": (
        scene(PIVOT, [link("leg", upper={"motion": "prescribed", "law": "0.2 + 0.05*sin(3*t)"})],
              start={"psi1": 0.9, **{k: v for k, v in MOVING.items() if k[3] == "1"}}),
        "M_psi1", "leg.length_dot*10 - xi1_2*psi1_dot",
        lambda t, see: 10.0 * see["leg.length_dot"] - see["xi1_2"] * see["psi1_dot"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", CASES)
def test_a_law_is_the_control_that_says_the_same(name: str, engine: str) -> None:
    made, on, law, control = CASES[name]
    data = made.to_dict()
    made = vlmb.Scene.from_dict({**data, "parameters": {"k": 3.0}, "run": {**data["run"], "duration": 1.0, "engine": engine}})
    by_law = vlmb.simulate(with_law(made, on, law))
    by_control = vlmb.simulate(made, control=lambda t, see: {on: control(t, see)})
    assert by_law.status == by_control.status == "finished"
    for coordinate in by_law.mechanism.coordinate_names:
        np.testing.assert_allclose(by_law[coordinate], by_control[coordinate], rtol=1e-7, atol=1e-8, err_msg=coordinate)
    np.testing.assert_allclose(by_law.controls[on], by_control.controls[on], rtol=1e-6, atol=1e-6)
    assert np.abs(by_law.controls[on]).max() > 1e-3
    assert np.abs(by_law["balance"]).max() < 1e-8 * max(1.0, np.abs(by_law["energy"]).max())


@pytest.mark.parametrize("engine", ENGINES)
def test_quadratic_drag_in_closed_form(engine: str) -> None:
    """m w' = -c w^2: w = w0/(1 + c w0 t/m), x = (m/c) log(1 + c w0 t/m)."""
    made = vlmb.Scene.from_dict({
        "base": GLIDING, "start": {"speed": 8.0}, "forces": [{"on": "F_x", "law": "-0.2*speed*abs(speed)"}],
        "run": {"duration": 20.0, "rtol": 1e-11, "atol": 1e-12, "engine": engine},
    })  # fmt: skip
    run = vlmb.simulate(made)
    np.testing.assert_allclose(run["speed"], 8.0 / (1.0 + 0.02 * run.t), rtol=1e-9)
    np.testing.assert_allclose(run["x"], 400.0 * np.log(1.0 + 0.02 * run.t), rtol=1e-9, atol=1e-9)
    assert np.abs(run["balance"]).max() < 1e-7


@pytest.mark.parametrize("engine", ENGINES)
def test_a_spring_by_law_in_closed_form(engine: str) -> None:
    """A mass on a massless leg along the vertical: m l'' = -k (l - l0) - c l' - m g."""
    m, k, c, gravity = 2.0, 300.0, 6.0, 9.81
    rod = {"length": 0.4, "mass": m, "com": 0.0, "inertia": 0.02}
    leg = {"name": "leg", "rod": rod, "lower": {"length": 0.6, "limits": ANY_LENGTH}}
    made = vlmb.Scene.from_dict({
        "base": PIVOT, "links": [leg], "start": {"psi1": math.pi / 2}, "parameters": {"k": k},
        "forces": [{"on": "F1_1", "law": f"-k*(leg.lower - 0.5) - {c}*leg.lower_dot"}], "plane": True,
        "run": {**TIGHT, "duration": 1.5, "engine": engine},
    })  # fmt: skip
    run = vlmb.simulate(made)
    rest, rate = 0.5 - m * gravity / k, c / (2.0 * m)
    swing = math.sqrt(k / m - rate**2)
    wanted = rest + (0.6 - rest) * np.exp(-rate * run.t) * (np.cos(swing * run.t) + rate / swing * np.sin(swing * run.t))
    np.testing.assert_allclose(run["xi1_1"], wanted, atol=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_switch_of_the_state_is_not_stepped_over(engine: str) -> None:
    """Free fall from 2 m; from 1 m on a push: z' and z have a closed form on either side, to the absolute tolerance."""
    body = {"name": "body", "rod": {"length": 0.2, "mass": 2.0}}
    made = vlmb.Scene.from_dict({
        "base": {"kind": "free"}, "links": [body], "gravity": 10.0,
        "start": {"z": 2.0}, "forces": [{"on": "F_z", "law": "where(z < 1, 60, 0)"}],
        "run": {"duration": 0.8, "rtol": 1e-5, "atol": 1e-7, "engine": engine},
    })  # fmt: skip
    run = vlmb.simulate(made)
    first = math.sqrt(0.2)
    before = 2.0 - 5.0 * run.t**2
    late = run.t - first
    after = 1.0 - 10.0 * first * late + 10.0 * late**2
    np.testing.assert_allclose(run["z"], np.where(late < 0.0, before, after), rtol=0, atol=2e-7)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_law_that_has_no_value_is_named(engine: str) -> None:
    made = with_law(bent(PIVOT, 1), "M_psi1", "sqrt(psi1 - 100)", engine=engine)
    with pytest.raises(vlmb.VlmbError, match=r"sqrt\(psi1 - 100\).*M_psi1.*no finite value"):
        raise_or_message(made)
    upright = with_law(scene(PIVOT, 1, start={"psi1": math.pi / 2}), "M_psi1", "-phi1_dot", engine=engine)
    with pytest.raises(vlmb.VlmbError, match=r"phi1.* pole"):
        raise_or_message(upright)


def raise_or_message(made: vlmb.Scene) -> None:
    run = vlmb.simulate(made)
    if run.status == "failed":
        raise vlmb.VlmbError(run.message)


def test_what_a_law_may_not_name() -> None:
    with pytest.raises(ExpressionError, match=r"forces\[0\].law.*unknown name 'psi2'.*psi1"):
        vlmb.check(with_law(bent(PIVOT, 1), "M_psi1", "psi2"))
    with pytest.raises(ExpressionError, match=r"forces\[0\].law.*M_psi1.*result"):
        vlmb.check(with_law(bent(PIVOT, 1), "M_psi1", "M_psi1"))
    leg = link("leg", upper={"motion": "prescribed", "law": "0.2 + 0.01*psi1"})
    with pytest.raises(SceneError, match=r"links\[0\].upper.law.*psi1.*only t and parameters.*law of a force"):
        vlmb.check(scene(PIVOT, [leg]))
