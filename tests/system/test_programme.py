"""Programme control (section 5): exact decay, exact cases, the identities of (5.6), an independent formulation, refusals."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import quad
from scipy.linalg import expm

import vlmb
from tests.reference import skier_reference
from tests.small_scenes import ANY_LENGTH, FIXED, PIVOT, SKI, TIGHT, link, scene
from vlmb.simulation.checking import check
from vlmb.system.gains import gain_matrices, largest_stable_step, perturbation_matrix
from vlmb.system.programme import ProgrammeControl, cross
from vlmb.system.system import make_system
from vlmb.system.workspace import Workspace

Array = np.ndarray[Any, np.dtype[np.float64]]
Table = dict[str, Any]

PARAMETERS = {"A": 0.8, "k": 0.6, "L": 0.75, "lean": 1.2}
ROWS = ["tan(phi0) = A*k*cos(k*x)", "phi1 = phi0", "(xi1_1 + 0.5)*sin(psi1) = L", "psi1 = lean"]
CONTROLS = ["M_phi0", "M_phi1", "M_psi1", "F1_1"]
START = {"x": 0.1, "phi0": 0.35, "phi1": 0.2, "psi1": 1.1, "xi1_1": 0.33, "speed": 4.0, "phi0_dot": 0.2, "phi1_dot": -0.1,
         "psi1_dot": 0.15, "xi1_1_dot": -0.1}  # fmt: skip


def skier(
    rows: list[str], controls: list[str] = CONTROLS, start: Table = START, keys: Table | None = None, **programme: Any
) -> Table:
    """The one-link skier under a programme, as a dict."""
    leg = link("legs", rod={"length": 0.5, "mass": 30.0}, tip_mass=40.0, lower={"length": 0.3, "limits": ANY_LENGTH}, upper=FIXED)
    if not {"frequency", "gains", "h", "k"} & programme.keys():
        programme["frequency"] = 5.0
    servo = {"constraints": rows, "controls": controls, **programme}
    table = {"base": SKI, "links": [leg], "slope": 0.1, "parameters": PARAMETERS, "start": start, "run": TIGHT}
    return {**table, "programme": servo, **(keys or {})}


def held(table: Table) -> tuple[Workspace, Array]:
    """The dynamics of a scene, and the state that its start gives as it is."""
    checked = vlmb.Scene.from_dict(table)
    mechanism = vlmb.build(checked)
    values = dict.fromkeys(mechanism.coordinate_names, 0.0) | checked.start
    rates = {name: value for name, value in values.items() if name.endswith("_dot")}
    if "speed" in values:
        rates |= {"x_dot": values["speed"] * math.cos(values["phi0"]), "y_dot": values["speed"] * math.sin(values["phi0"])}
    coordinates = {name: values[name] for name in mechanism.coordinate_names}
    state = mechanism.state(coordinates, rates)
    workspace = make_system(mechanism).workspace(branch=list(coordinates.values()))
    return workspace, workspace.pack(state)


def programme_of(workspace: Workspace) -> ProgrammeControl:
    assert workspace.solver.programme is not None
    return workspace.solver.programme


# ---- the errors obey (5.5)


COUPLED_H = [[-30.0, 4.0], [-6.0, -18.0], [3.0, 2.0]]
COUPLED_K = [[-9.0, 1.0, 0.5], [2.0, -7.0, 0.0], [-1.0, 0.5, -5.0]]
DECAYS: dict[str, Table] = {
    "one frequency": skier(ROWS, frequency=4.0),
    "a frequency and a damping for each": skier(ROWS, frequency=[3.0, 6.0, 4.0, 9.0], damping_ratio=[0.4, 1.0, 2.0, 0.7]),
    "a rate beside positions": skier(["speed = 5", *ROWS[1:]], ["F_x", *CONTROLS[1:]], frequency=[2.0, 5.0, 5.0, 4.0]),
    "rates alone": skier(["speed = 5", "psi1_dot = 0.1*t"], ["F_x", "M_psi1"], frequency=[2.0, 3.0]),
    "coupled h and k": skier([ROWS[1], ROWS[2], "speed = 5"], ["M_phi1", "F1_1", "F_x"], h=COUPLED_H, k=COUPLED_K),
    "more controls than rows": skier(ROWS[:2], frequency=3.0),
    "beside an ideal constraint": skier([ROWS[0], ROWS[2], ROWS[3]], ["M_phi0", "M_psi1", "F1_1"], frequency=4.0,
                                        start={**START, "phi1": 0.35, "phi1_dot": 0.2}, keys={"constraints": ["phi1 = phi0"]}),
    "of directions": skier(["legs.direction.x*sin(phi0) = legs.direction.y*cos(phi0)", "legs.tip.z = 0.9"], frequency=5.0),
    "beside a pumped segment": skier(["legs.length = 1.1", *ROWS[1::2]], ["F1_1", "M_phi1", "M_psi1"], keys={"links": [
        link("legs", lower={"length": 0.3, "limits": ANY_LENGTH}, upper={"motion": "prescribed", "law": "0.3 + 0.1*sin(4*t)"})]}),
    "by a hinge torque": skier(ROWS[1:], ["M_phi1", "T_legs", "F1_1"], frequency=4.0),
    "in the ski's plane": skier([ROWS[2], ROWS[3]], ["M_psi1", "F1_1"], keys={"plane": True}, start={
        name: value for name, value in START.items() if not name.startswith("phi1")}),
    "in time": skier(["psi1 = lean + 0.1*sin(3*t)", "legs.length = 1 + 0.05*cos(2*t)"], ["M_psi1", "F1_1"]),
}  # fmt: skip


@pytest.mark.parametrize("name", DECAYS)
def test_errors_decay_as_the_matrix_exponential(name: str) -> None:
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(DECAYS[name]), duration=1.5, t_eval=np.linspace(0.0, 1.5, 31))
    assert trajectory.status == "finished", trajectory.message
    pairs = [trajectory.residuals[text] for text in trajectory.scene.programme.constraints]
    z = [pair.position for pair in pairs if pair.position is not None]
    found = np.array([*z, *(pair.velocity for pair in pairs)]).T
    workspace, _ = held(DECAYS[name])
    programme = programme_of(workspace)
    matrix = perturbation_matrix(programme.plan.h, programme.plan.k, programme.plan.holonomic.tolist())
    size = np.linalg.norm(found[0])
    assert size > 0.05
    for t, errors in zip(trajectory.t, found, strict=True):
        assert np.linalg.norm(errors - expm(t * matrix) @ found[0]) < 1e-6 * size, t
    assert np.linalg.norm(found[-1]) < 0.5 * size


def test_gains_from_frequency_and_damping() -> None:
    """z'' + 2 d w z' + w^2 z = 0; of a rate z'' + w z' = 0."""
    checked = vlmb.Scene.from_dict(skier(ROWS[:2], frequency=[3.0, 7.0], damping_ratio=[0.5, 1.0]))
    h, k = gain_matrices(checked.programme, [True, False], 1.0, None)
    assert h.tolist() == [[-9.0], [0.0]] and k.tolist() == [[-3.0, 0.0], [0.0, -7.0]]


def test_automatic_gains_follow_the_motion_and_the_step() -> None:
    """Three times sqrt(g / length); half of what the step allows where that is less."""
    table = skier(ROWS[1:], gains="auto")
    programme = programme_of(held(table)[0])
    rate = 3.0 * math.sqrt(9.81 / (0.3 + 0.5 + 0.2))
    np.testing.assert_allclose(programme.plan.h, -(rate**2) * np.eye(3), rtol=1e-12)
    slow = programme_of(held({**table, "run": {"method": "euler", "step": 0.1}})[0])
    np.testing.assert_allclose(slow.plan.h, -25.0 * np.eye(3), rtol=1e-12)
    run = {"method": "euler", "step": 0.002, "fall": False}
    trajectory = vlmb.simulate(vlmb.Scene.from_dict({**table, "run": run}), duration=2.0)
    assert trajectory.status == "finished", trajectory.message
    assert abs(trajectory.residuals[ROWS[1]].position[-1]) < 1e-3


# ---- exact cases


def test_programmed_length_without_gravity() -> None:
    """l^2 theta' = h: the angle, the servo force m (l'' - l theta'^2) and its work."""
    mass, turn = 2.0, 1.3
    arm = {"name": "a", "rod": {"length": 0.5, "mass": 0.0}, "lower": {"length": 0.5, "limits": [0.1, 2.0]}, "tip_mass": mass}
    servo = {"constraints": ["a.length = 1 + 0.2*sin(2*t)"], "controls": ["F1_1"], "frequency": 5.0}
    start = {"psi1": 0.2, "psi1_dot": turn}
    table = {"base": PIVOT, "links": [arm], "plane": True, "gravity": 0.0, "programme": servo, "start": start, "run": TIGHT}
    times = np.linspace(0.0, 4.0, 41)
    trajectory = vlmb.simulate(vlmb.Scene.from_dict({**table, "run": {**TIGHT, "rtol": 1e-12}}), duration=4.0, t_eval=times)
    length, growth, bend = 1.0 + 0.2 * np.sin(2.0 * times), 0.4 * np.cos(2.0 * times), -0.8 * np.sin(2.0 * times)
    rate = turn / length**2
    angle = [0.2 + quad(lambda t: turn / (1.0 + 0.2 * math.sin(2.0 * t)) ** 2, 0.0, end, epsabs=1e-13)[0] for end in times]
    np.testing.assert_allclose(trajectory["psi1"], angle, rtol=0, atol=1e-9)
    np.testing.assert_allclose(trajectory.controls["F1_1"], mass * (bend - length * rate**2), rtol=0, atol=1e-9)
    energy = 0.5 * mass * (growth**2 + (length * rate) ** 2)
    np.testing.assert_allclose(trajectory.work_by_force["F1_1"], energy - energy[0], rtol=0, atol=1e-9)


def test_an_existing_motion_needs_no_control_skate() -> None:
    """The cycloid of a skate on a slope."""
    g = 9.81 * math.sin(0.3)
    rows = ["phi0 = w*t", "x = G*sin(w*t)**2/(2*w**2)"]
    servo = {"constraints": rows, "controls": ["M_phi0", "F_x"], "frequency": 4.0}
    base = {"kind": "ski", "mass": 5.0, "inertia": 0.6}
    table = {"base": base, "slope": 0.3, "parameters": {"w": 1.1, "G": g}, "programme": servo, "run": TIGHT}
    trajectory = vlmb.simulate(vlmb.Scene.from_dict({**table, "start": {"phi0_dot": 1.1}}), duration=1.2)
    for name in servo["controls"]:
        assert np.abs(trajectory.controls[name]).max() < 1e-7, name
    swing = 2.2 * trajectory.t
    np.testing.assert_allclose(trajectory["y"], g * (0.5 * swing - np.sin(swing) / 2.0) / (2.0 * 1.1**2), rtol=0, atol=1e-9)
    edge = 2.0 * 5.0 * g * np.sin(1.1 * trajectory.t)
    np.testing.assert_allclose(np.abs(trajectory.reactions["knife_edge"]), np.abs(edge), rtol=0, atol=1e-7)


def test_an_existing_motion_needs_no_control_conical_pendulum() -> None:
    """r = l0 + m g / (k cos theta), rate^2 = g / (r cos theta); the azimuth goes round and round."""
    mass, stiffness, rest, theta = 2.0, 400.0, 0.9, 0.5
    r = rest + mass * 9.81 / (stiffness * math.cos(theta))
    rate = math.sqrt(9.81 / (r * math.cos(theta)))
    lower = {"length": rest, "stiffness": stiffness, "limits": [0.1, 3.0]}
    bob = {"name": "a", "rod": {"length": 0.0, "mass": 0.0}, "lower": lower, "tip_mass": mass}
    servo = {
        "constraints": ["phi1 = w*t", "psi1 = tilt", "xi1_1 = r"],
        "controls": ["M_phi1", "M_psi1", "F1_1"],
        "frequency": 4.0,
    }
    table = {"base": PIVOT, "links": [bob], "parameters": {"w": rate, "r": r, "tilt": theta - math.pi / 2}, "programme": servo}
    start = {"psi1": theta - math.pi / 2, "phi1_dot": rate, "xi1_1": r}
    trajectory = vlmb.simulate(vlmb.Scene.from_dict({**table, "start": start, "run": TIGHT}), duration=6.0)
    assert trajectory.status == "finished" and trajectory.adjustments == ()
    assert trajectory["phi1"][-1] == pytest.approx(6.0 * rate, abs=1e-8)
    for name in servo["controls"]:
        assert np.abs(trajectory.controls[name]).max() < 1e-7, name


# ---- the least solution and the null space (5.6)


NUMBERS = st.floats(-10.0, 10.0).map(lambda x: x if abs(x) > 1e-6 else 0.0)


def shaped(rows: int, controls: int) -> st.SearchStrategy[Array]:
    return arrays(float, (rows, controls), elements=NUMBERS).filter(lambda g: np.linalg.cond(g) < 1e6)


@pytest.fixture(scope="module")
def paper() -> ProgrammeControl:
    """Three controls for two rows, of two units and one weight given."""
    workspace, _ = held(skier(ROWS[:2], ["M_phi0", "M_psi1", "F1_1"], weights={"M_psi1": 0.04}))
    return programme_of(workspace)


@settings(max_examples=200, deadline=None)
@given(g=shaped(2, 3), beta=arrays(float, 2, elements=NUMBERS), w=NUMBERS)
def test_identities_of_the_law(paper: ProgrammeControl, g: Array, beta: Array, w: float) -> None:
    """u_nu = R^-1 G^T (G R^-1 G^T)^-1 beta, G u_tau = 0, u_nu' R u_tau = 0, and u_tau spans ker G."""
    scales, weight = paper.scales, np.diag(paper.scales**-2)
    physical = g / scales
    least = scales * paper.least(g, beta)
    inverse = np.linalg.inv(weight)
    size = np.abs(least / scales).max() + 1.0
    expected = inverse @ physical.T @ np.linalg.lstsq(physical @ inverse @ physical.T, beta, rcond=None)[0]
    precise = 1e-13 * np.linalg.cond(g) ** 2
    np.testing.assert_allclose(least / scales, expected / scales, rtol=0, atol=max(precise, 1e-11) * size)
    tau = cross(physical)
    null = paper.null_space(g)
    for free in (tau, scales * null[:, 0] * w):
        unit = np.linalg.norm(free / scales) or 1.0
        assert np.abs(physical @ free).max() <= 1e-12 * np.linalg.norm(g) * unit
        assert abs(least @ weight @ free) / unit < max(1e-14 * np.linalg.cond(g), 1e-11) * size
    along = np.abs(null[:, 0] @ (tau / scales)) / (np.linalg.norm(tau / scales) or 1.0)
    assert along == pytest.approx(1.0, abs=1e-9)


@settings(max_examples=100, deadline=None)
@given(g=shaped(2, 3), beta=arrays(float, 2, elements=NUMBERS), w=NUMBERS)
def test_the_least_is_least(paper: ProgrammeControl, g: Array, beta: Array, w: float) -> None:
    least = paper.least(g, beta)
    assert g @ least == pytest.approx(beta, abs=1e-9 * (1.0 + np.abs(least).max()))
    other = least + paper.null_space(g)[:, 0] * w
    assert np.linalg.norm(other) >= np.linalg.norm(least) * (1.0 - 1e-9) - 1e-12


def test_the_free_scalar_leaves_the_programme_alone() -> None:
    """u = u_nu + u0 u_tau with u_tau = G_1 x G_2: another motion, the same errors of the programme."""
    controls = ["M_phi0", "M_psi1", "F1_1"]
    plain, pushed = (skier(ROWS[:3:2], controls, **free) for free in ({}, {"u0": "3*cos(t)"}))
    (first, y), (second, _) = held(plain), held(pushed)
    without, within = (one.evaluate(0.4, y) for one in (first, second))
    physical = programme_of(second).control_matrix / programme_of(second).scales
    extra = [within.controls[name] - without.controls[name] for name in controls]
    np.testing.assert_allclose(extra, 3.0 * math.cos(0.4) * np.cross(*physical), rtol=1e-9)
    assert np.linalg.norm(extra) > 1e-3
    runs = [vlmb.simulate(vlmb.Scene.from_dict(one), duration=0.8) for one in (plain, pushed)]
    for text in ROWS[:3:2]:
        np.testing.assert_allclose(runs[0].residuals[text].position, runs[1].residuals[text].position, rtol=0, atol=1e-8)
    assert np.abs(runs[0]["psi1"] - runs[1]["psi1"]).max() > 1e-5


def test_weights_change_the_controls_by_the_formula() -> None:
    found = {}
    for name, weights in (("default", {}), ("given", {"M_phi0": 3.0, "M_phi1": 0.5, "M_psi1": 1.0, "F1_1": 20.0})):
        workspace, y = held(skier(ROWS[:2], weights=weights))
        controls = workspace.evaluate(0.0, y).controls
        programme = programme_of(workspace)
        found[name] = programme.control_matrix / programme.scales, np.array([controls[key] for key in CONTROLS]), programme.scales
    (g, u, scales), (again, changed, _) = found["default"], found["given"]
    np.testing.assert_allclose(again, g, rtol=1e-9, atol=1e-12)
    inverse = np.diag([1.0 / 3.0, 2.0, 1.0, 0.05])
    np.testing.assert_allclose(changed, inverse @ g.T @ np.linalg.solve(g @ inverse @ g.T, g @ u), rtol=1e-9)
    assert np.linalg.norm(changed - u) > 1.0
    total = 5.0 + 30.0 + 40.0
    np.testing.assert_allclose(scales, total * 9.81 * np.array([1.0, 1.0, 1.0, 1.0]), rtol=1e-12)  # legs of 1 m


def test_secondary_rows_are_served_by_what_is_free() -> None:
    """The paper's controls and rows let the rider tip over; held upright in the null space he does not."""
    rows, controls = ["tan(phi0) = A*k*cos(k*x)", "(xi1_1 + 0.5)*sin(psi1) = L"], ["M_phi0", "M_psi1", "F1_1"]
    start = {"phi0": 0.4, "phi1": 0.4, "psi1": 1.5, "speed": 4.0}
    keys = {"constraints": ["phi1 = phi0"], "run": {**TIGHT, "rtol": 1e-9}}
    alone = vlmb.simulate(vlmb.Scene.from_dict(skier(rows, controls, start, keys)), duration=3.0)
    steady = {**keys, "run": {**TIGHT, "rtol": 1e-9}}
    upright = skier(rows, controls, start, steady, secondary=["psi1 = 1.5"], secondary_frequency=6.0)
    balanced = vlmb.simulate(vlmb.Scene.from_dict(upright), duration=3.0)
    assert balanced.status == "finished", balanced.message
    assert np.abs(balanced["psi1"] - 1.5).max() < 1e-6
    assert np.abs(alone["psi1"] - 1.5).max() > 0.05
    for text in rows:
        np.testing.assert_allclose(balanced.residuals[text].position, alone.residuals[text].position, rtol=0, atol=1e-7)


def test_secondary_rows_give_way_to_the_programme() -> None:
    """Two more wishes than one free control can meet: the programme holds, the wishes only roughly."""
    rows, controls = [ROWS[0], ROWS[2]], ["M_phi0", "M_psi1", "F1_1"]
    wishes = {"secondary": ["psi1 = 1.2", "phi1 = 0.3"], "secondary_frequency": 4.0}
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(skier(rows, controls, **wishes)), duration=0.5)
    plain = vlmb.simulate(vlmb.Scene.from_dict(skier(rows, controls)), duration=0.5)
    for text in rows:
        np.testing.assert_allclose(trajectory.residuals[text].position, plain.residuals[text].position, rtol=0, atol=1e-7)
    assert np.abs(trajectory["psi1"] - plain["psi1"]).max() > 1e-4


# ---- the independent formulation in the paper's coordinates


REFERENCES = {
    "complete": skier_reference.Skier(),
    "with the edge's moment ideal": skier_reference.Skier(
        ideal=True, rows=(0, 2, 3), controls=("M_phi0", "M_psi1", "F1_1"), scales=(1.0, 1.0, 1.0),
        frequency=(4.0, 5.0, 6.0), damping=(1.0, 1.2, 1.0),
        start={"x": 0.1, "y": -0.2, "phi0": 0.35, "phi1": 0.35, "psi1": 1.05, "xi1_1": 0.33},
        rates={"speed": 4.0, "phi0_dot": 0.2, "phi1_dot": 0.2, "psi1_dot": 0.15, "xi1_1_dot": -0.1},
    ),
    "more controls than rows": skier_reference.Skier(
        controls=skier_reference.CONTROLS, scales=(700.0, 650.0, 720.0, 800.0, 500.0)
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFERENCES)
def test_agreement_with_the_paper_s_coordinates(name: str) -> None:
    """Five seconds from a start that violates the programme."""
    model = REFERENCES[name]
    times = np.linspace(0.0, 5.0, 51)
    wanted = skier_reference.simulate(model, times)
    entry = model.scene(rtol=1e-12, atol=1e-13, fall=False)
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(entry), duration=5.0, t_eval=times)
    assert trajectory.status == "finished", trajectory.message
    assert np.abs(wanted.z[0]).max() > 0.1
    for coordinate, values in wanted.coordinates.items():
        np.testing.assert_allclose(trajectory[coordinate], values, rtol=0, atol=1e-8, err_msg=coordinate)
    for control, values in wanted.controls.items():
        np.testing.assert_allclose(
            trajectory.controls[control], values, rtol=0, atol=1e-8 * np.abs(values).max(), err_msg=control
        )
    largest = np.abs(wanted.edge).max()
    np.testing.assert_allclose(trajectory.reactions["knife_edge"], wanted.edge, rtol=0, atol=1e-8 * largest)
    for k, text in enumerate(skier_reference.ROWS[row] for row in model.rows):
        np.testing.assert_allclose(trajectory.residuals[text].position, wanted.z[:, k], rtol=0, atol=1e-8, err_msg=text)
    assert np.abs(trajectory["balance"]).max() < 1e-8 * trajectory["kinetic"].max()


# ---- ideal constraints beside programmes


def test_an_ideal_row_and_a_programme_row_agree_where_the_control_acts_along_it() -> None:
    links = [link("a", upper=FIXED)]
    start = {"psi1": 0.5, "phi1_dot": 1.5}
    ideal = vlmb.simulate(scene(PIVOT, links, constraints=["psi1 = 0.5"], start=start), duration=2.0)
    servo = {"constraints": ["psi1 = 0.5"], "controls": ["M_psi1"], "frequency": 5.0}
    driven = vlmb.simulate(scene(PIVOT, links, programme=servo, start=start), duration=2.0)
    np.testing.assert_allclose(driven.position("a"), ideal.position("a"), rtol=0, atol=1e-8)
    moment = ideal.reactions["psi1 = 0.5"]
    np.testing.assert_allclose(driven.controls["M_psi1"], moment, rtol=0, atol=1e-7 * np.abs(moment).max())


@pytest.mark.parametrize(
    "text", ["psi1 = 0.5 + 0.2*sin(2*t)", "a.tip.z = 0.5 + 0.1*sin(3*t)", "phi1_dot = 1.5 + t", "phi1 = 1.5*t + 0.3*t**2"]
)
def test_the_work_of_a_moving_ideal_constraint_is_counted(text: str) -> None:
    links = [link("a", upper=FIXED)]
    start = {"psi1": 0.5, "phi1_dot": 1.5}
    trajectory = vlmb.simulate(scene(PIVOT, links, constraints=[text], start=start, gravity=2.0), duration=1.0)
    assert trajectory.status == "finished", trajectory.message
    work = trajectory.work_by_force[text]
    assert np.abs(work).max() > 0.1
    assert np.abs(trajectory["balance"]).max() < 1e-8 * trajectory["kinetic"].max()
    assert text not in trajectory.controls


def test_a_resting_ideal_constraint_does_no_work() -> None:
    trajectory = vlmb.simulate(scene(PIVOT, [link("a")], constraints=["psi1 = 0.5"], start={"psi1": 0.5}), duration=0.2)
    assert trajectory.work_by_force == {}


def test_an_ideal_row_repeated_by_the_programme_is_named() -> None:
    """The reaction holds it already: no control can move it, and none has to."""
    table = skier(ROWS[1:3], ["M_phi1", "F1_1"], {**START, "phi1": 0.35, "phi1_dot": 0.2}, {"constraints": [ROWS[1]]})
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(table), duration=0.3)
    assert trajectory.status == "finished", trajectory.message
    assert "2 rows of rank 1" in trajectory.summary()
    wrong = skier(["phi1 = phi0 + 0.1", ROWS[2]], ["M_phi1", "F1_1"], START, {"constraints": [ROWS[1]]})
    stopped = vlmb.simulate(vlmb.Scene.from_dict(wrong), duration=0.3)
    assert stopped.status == "failed"
    assert "phi1 = phi0 + 0.1" in stopped.message and "M_phi1" in stopped.message


@pytest.mark.parametrize("knife_edge", ["multiplier", "projection"])
@pytest.mark.parametrize("keys", [{}, {"constraints": ["phi1 = phi0"]}], ids=["alone", "beside an ideal constraint"])
def test_forms_of_the_knife_edge_agree_under_a_programme(knife_edge: str, keys: Table) -> None:
    rows = [ROWS[0], *ROWS[2:]] if keys else ROWS
    controls = ["M_phi0", "M_psi1", "F1_1"] if keys else CONTROLS
    start = {**START, "phi1": 0.35, "phi1_dot": 0.2}
    checked = vlmb.Scene.from_dict(skier(rows, controls, start, keys))
    wanted = vlmb.simulate(checked, duration=0.6, t_eval=np.linspace(0.0, 0.6, 13))
    found = vlmb.simulate(checked, duration=0.6, t_eval=wanted.t, knife_edge=knife_edge, gain=3.0)
    assert found.status == "finished", found.message
    np.testing.assert_allclose(found.position("legs"), wanted.position("legs"), rtol=0, atol=1e-8)
    for name in controls:
        largest = np.abs(wanted.controls[name]).max()
        np.testing.assert_allclose(found.controls[name], wanted.controls[name], rtol=0, atol=1e-7 * largest, err_msg=name)
    edge = wanted.reactions["knife_edge"]
    np.testing.assert_allclose(found.reactions["knife_edge"], edge, rtol=0, atol=1e-7 * np.abs(edge).max())


# ---- what cannot be controlled


def test_redundant_rows_that_agree_are_met() -> None:
    once = vlmb.simulate(vlmb.Scene.from_dict(skier(ROWS[2:], ["M_psi1", "F1_1"])), duration=0.6)
    again = "2*psi1 = 2*lean"
    table = skier([*ROWS[2:], again], ["M_psi1", "F1_1", "M_phi0"])
    twice = vlmb.simulate(vlmb.Scene.from_dict(table), duration=0.6)
    assert twice.status == "finished", twice.message
    for name in ("psi1", "xi1_1", "phi0"):
        np.testing.assert_allclose(twice[name], once[name], rtol=0, atol=1e-8, err_msg=name)
    workspace, y = held(table)
    workspace.rhs(0.0, y)
    programme = programme_of(workspace)
    rank, condition = programme.rank(programme.control_matrix)
    assert rank == 2 and condition > 1e9
    assert "3 rows of rank 2" in twice.summary() and "of rank" not in once.summary()


def test_rows_that_contradict_are_named() -> None:
    rows = ["psi1 = 1.2", "psi1 = 1.1 + 0.2*t", "xi1_1 = 0.3"]
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(skier(rows, ["M_psi1", "F1_1", "M_phi1"])), duration=0.5)
    assert trajectory.status == "failed" and len(trajectory) == 1
    assert "psi1 = 1.2" in trajectory.message and "psi1 = 1.1 + 0.2*t" in trajectory.message
    assert "xi1_1 = 0.3" not in trajectory.message and "M_psi1" in trajectory.message


def test_controls_without_effect_are_named() -> None:
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(skier(["phi0 = 0.5"], ["F1_1"])), duration=0.5)
    assert trajectory.status == "failed"
    assert "phi0 = 0.5" in trajectory.message and "F1_1" in trajectory.message


def test_a_posture_where_control_is_lost_keeps_the_part_before() -> None:
    """A link of 1 m is turned up until its tip is at 1 m, at t = 1.5; higher no moment brings it."""
    text, links = "a.tip.z = 0.55 + 0.3*t", [link("a", upper=FIXED, lower={"length": 0.3, "motion": "fixed"})]
    servo = {"constraints": [text], "controls": ["M_psi1"], "frequency": 3.0}
    trajectory = vlmb.simulate(scene(PIVOT, links, programme=servo, start={"phi1": 0.3, "psi1": math.asin(0.55)}), duration=3.0)
    assert trajectory.status == "failed", trajectory.message
    assert text in trajectory.message and "M_psi1" in trajectory.message
    assert 1.4 < trajectory.t[-1] < 1.6
    assert np.abs(trajectory.residuals[text].position[:-3]).max() < 1e-6


def test_a_path_steeper_than_the_heading_allows_ends_with_a_sentence() -> None:
    """tan(phi0) follows 40 x: the ski comes to point across, where the tangent has its pole."""
    rows = ["tan(phi0) = 40*t/(1 - t)"]
    base = {"kind": "ski", "mass": 5.0, "inertia": 0.6}
    servo = {"constraints": rows, "controls": ["M_phi0"], "frequency": 5.0}
    table = {"base": base, "programme": servo, "start": {"speed": 1.0}, "run": {"fall": False}}
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(table), duration=3.0)
    assert trajectory.status == "failed", trajectory.message
    assert 0.3 < trajectory.t[-1] < 1.1
    assert np.isfinite(trajectory["phi0"]).all()


def test_too_few_controls_are_counted() -> None:
    with pytest.raises(vlmb.SceneError, match=r"4 rows .* at least as many controls; there are 2 \(M_phi0, M_phi1\)"):
        vlmb.simulate(vlmb.Scene.from_dict(skier(ROWS, CONTROLS[:2])))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"controls": ["M_phi0", "M_ps1"]}, ["programme.controls[1]", "M_psi1"]),
        ({"controls": ["M_phi0", "M_phi0"]}, ["named twice"]),
        ({"controls": ["M_phi0", "F1_2"]}, ["F1_2", "F1_1"]),
        ({"weights": {"M_phi": 2.0}}, ["programme.weights.M_phi", "M_phi1"]),
        ({"frequency": None}, ["frequency", "auto"]),
        ({"frequency": [1.0, 2.0, 3.0]}, ["programme.frequency", "3 values for 2 rows"]),
        ({"frequency": None, "h": [[-1.0]], "k": [[-1.0]]}, ["h must be 2 x 2"]),
        ({"h": [[-1.0, 0.0], [0.0, -1.0]]}, ["either h and k, or frequency"]),
        ({"frequency": None, "h": [[1.0, 0.0], [0.0, -1.0]], "k": [[-1.0, 0.0], [0.0, -1.0]]}, ["not stable", "eigenvalue"]),
        ({"damping_ratio": 0.0}, ["not stable"]),
        ({"u0": "sin(t)"}, ["u0", "2 controls and 2 rows"]),
        ({"gains": "auto"}, ["exclude each other"]),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_programme_is_said(change: Table, words: list[str]) -> None:
    table = skier(ROWS[:2], CONTROLS[:2])
    table["programme"] = {key: value for key, value in {**table["programme"], **change}.items() if value is not None}
    with pytest.raises(vlmb.SceneError) as error:
        vlmb.simulate(vlmb.Scene.from_dict(table))
    for word in words:
        assert word in str(error.value)


def test_an_equation_that_loses_its_value_is_named() -> None:
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(skier(["psi1 = 1 + 0.2*sqrt(0.4 - t)"], ["M_psi1"])), duration=1.0)
    assert trajectory.status == "failed"
    assert 0.3 < trajectory.t[-1] <= 0.4 and len(trajectory) > 10
    early = skier(["psi1 = 1 + 0.2*sqrt(t - 0.1)"], ["M_psi1"])
    with pytest.raises(vlmb.VlmbError, match="no finite value") as error:
        vlmb.simulate(vlmb.Scene.from_dict(early))
    assert "psi1 = 1 + 0.2*sqrt(t - 0.1)" in str(error.value)


# ---- fixed steps (paper.md 5b)


@pytest.mark.parametrize("method", ["euler", "rk4"])
@pytest.mark.parametrize(("frequency", "damping"), [(20.0, 1.0), (12.0, 0.5), (8.0, 2.0)])
def test_the_largest_stable_step_is_the_measured_one(method: str, frequency: float, damping: float) -> None:
    """A row that is linear in the state decays just below the limit, grows just above, and above is refused."""
    h, k = -(frequency**2), -2.0 * damping * frequency
    limit = largest_stable_step(np.linalg.eigvals([[0.0, 1.0], [h, k]]).astype(complex), method)
    if method == "euler":  # k < tau h and 4 + 2 tau k - tau^2 h > 0
        sides = [k / h, (-2.0 * k - math.sqrt(4.0 * k**2 + 16.0 * h)) / (-2.0 * h) if k**2 + 4.0 * h > 0 else math.inf]
        assert limit == pytest.approx(min(sides), rel=1e-12)
    base = {"kind": "ski", "mass": 5.0, "inertia": 0.6}
    servo = {"constraints": ["phi0 = 0.2"], "controls": ["M_phi0"], "h": [[h]], "k": [[k]]}
    table = {"base": base, "programme": servo, "start": {"phi0": 0.2001, "speed": 0.0}}

    def run(step: float) -> vlmb.Scene:
        return vlmb.Scene.from_dict({**table, "run": {"method": method, "step": step, "fall": False, "duration": 300.0 * step}})

    with pytest.raises(vlmb.SceneError, match="largest stable step") as refused:
        vlmb.simulate(run(1.001 * limit))
    assert f"{limit:.6g}" in str(refused.value)
    below = run(0.98 * limit)
    trajectory = vlmb.simulate(below, t_eval=0.98 * limit * np.arange(301))
    z = np.abs(trajectory.residuals["phi0 = 0.2"].position)
    assert z[-20:].max() < 0.2 * z[:20].max()
    workspace, y = held({**table, "start": {"phi0": 0.2001, "speed": 0.0}})
    step, error = 1.02 * limit, 0.0
    for _ in range(300):
        error = abs(workspace.evaluate(0.0, y).residuals["phi0 = 0.2"][0])
        if error > 1e-2:
            break
        k1 = workspace.rhs(0.0, y).copy()
        if method == "euler":
            y = y + step * k1
            continue
        k2 = workspace.rhs(0.0, y + 0.5 * step * k1).copy()
        k3 = workspace.rhs(0.0, y + 0.5 * step * k2).copy()
        k4 = workspace.rhs(0.0, y + step * k3).copy()
        y = y + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    assert error > 2e-4


def test_errors_of_the_first_order_scheme_are_of_the_order_of_the_step() -> None:
    """The floor O(tau) of 5b: halving the step halves it."""
    floors = []
    for step in (0.004, 0.002, 0.001):
        table = skier(ROWS, frequency=5.0, keys={"run": {"method": "euler", "step": step, "fall": False}})
        trajectory = vlmb.simulate(vlmb.Scene.from_dict(table), duration=4.0)
        late = trajectory.t > 3.0
        floors.append(np.abs(trajectory.residuals[ROWS[0]].position[late]).max())
    assert floors[0] / floors[1] == pytest.approx(2.0, rel=0.1)
    assert floors[1] / floors[2] == pytest.approx(2.0, rel=0.1)


# ---- the start


def test_what_is_given_is_kept_and_the_rest_is_solved() -> None:
    given_ = {"x": 0.1, "speed": 4.0, "psi1": 1.15}
    table = skier([ROWS[0], ROWS[1], ROWS[2], "phi1_dot = phi0_dot"][:3], start=given_)
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(table), duration=0.5)
    for name, value in given_.items():
        assert trajectory[name][0] == pytest.approx(value, abs=1e-12)
    for text in trajectory.scene.programme.constraints:
        assert np.abs(trajectory.residuals[text].position).max() < 1e-8
        assert np.abs(trajectory.residuals[text].velocity).max() < 1e-7
    assert any("phi0" in repair for repair in trajectory.adjustments)
    assert not any("off by" in repair for repair in trajectory.adjustments)


def test_an_error_of_the_start_is_reported_and_decays() -> None:
    trajectory = vlmb.simulate(vlmb.Scene.from_dict(skier(ROWS, frequency=8.0)), duration=2.0)
    for name in ("phi0", "psi1", "xi1_1"):
        assert trajectory[name][0] == pytest.approx(START[name], abs=1e-12)
    for text in ROWS:
        assert any(text in repair and "off by" in repair for repair in trajectory.adjustments)
        z = np.abs(trajectory.residuals[text].position)
        assert z[0] > 0.01 and z[-1] < 1e-4


def test_stability_and_controllability_are_told_in_advance() -> None:
    """The slowest decay is that of the gains, and G has full rank away from its singular posture."""
    table = skier(ROWS[:2], ["M_phi0", "M_psi1", "F1_1"])
    notes = check(vlmb.Scene.from_dict(table))[1].adjustments
    plan = programme_of(held(table)[0]).plan
    slowest = -np.linalg.eigvals(perturbation_matrix(plan.h, plan.k, [True, True])).real.max()
    words = r"programme: errors decay at least as exp\(-([\d.]+) t\).*; G has rank 2 for 2 rows, condition ([\d.]+) at the start"
    said = re.fullmatch(words, notes[-1])
    assert said, notes
    assert float(said[1]) == pytest.approx(slowest, rel=1e-3)
    assert 1.0 <= float(said[2]) < 1e6
