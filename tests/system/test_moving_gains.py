"""Gains, weights, u0 and border that the motion gives: (5.5) integrated beside a run, (5.6) by its determinants, refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import vlmb
from tests.system.test_core_rows import shares
from tests.system.test_programme import ROWS, held, programme_of, skier
from vlmb.system.core_engine import CoreEngine
from vlmb.system.core_rows import solved_programme
from vlmb.system.engines import make_engine
from vlmb.system.system import make_system

Table = dict[str, Any]

ENGINES = ("core", "pinocchio")
SERVO = [ROWS[1], ROWS[2], "speed = 5"]
DRIVEN = ["M_phi1", "F1_1", "F_x"]
H = [["-20 - 10*sin(3*t)", "xi1_1"], ["-2*psi1", "-30 - 4*speed"], ["3*phi0_dot", 2.0]]
K = [["-6 - psi1**2", 0.0, 0.3], ["2*cos(x)", "-9*exp(-t)", "psi1_dot"], [-1.0, 0.5, "-4 - step(t - 0.4)*t"]]


def gains_along(run: vlmb.Trajectory, late: bool) -> np.ndarray:
    """H and K (N, 3, 5) along a run, written once more in numpy."""
    t, one = run.t, np.ones(len(run.t))
    h = [
        [-20 - 10 * np.sin(3 * t), run["xi1_1"]], [-2 * run["psi1"], -30 - 4 * run["speed"]],
        [3 * run["phi0_dot"], 2.0 * one],
    ]  # fmt: skip
    k = [
        [-6 - run["psi1"] ** 2, 0 * one, 0.3 * one], [2 * np.cos(run["x"]), -9 * np.exp(-t), run["psi1_dot"]],
        [-one, 0.5 * one, -4 - late * t],
    ]  # fmt: skip
    return np.array([[*a, *b] for a, b in zip(h, k, strict=True)]).transpose(2, 0, 1)


@pytest.mark.parametrize("engine", ENGINES)
def test_errors_obey_the_perturbation_equations_with_gains_of_the_motion(engine: str) -> None:
    made = vlmb.Scene.from_dict(skier(SERVO, DRIVEN, h=H, k=K))
    for begin, end in ((0.0, 0.4), (0.4, 1.0)):  # the gains jump at 0.4 s
        start = None if begin == 0.0 else run.end  # noqa: F821
        times = np.linspace(begin, end, int((end - begin) * 2000) + 1)
        run = vlmb.simulate(made, end - begin, start=start, t0=begin, t_eval=times, rtol=1e-11, atol=1e-12, engine=engine)
        assert run.status == "finished", run.message
        gains, (heading, height, speed) = CubicSpline(run.t, gains_along(run, begin > 0.0)), (run.residuals[text] for text in SERVO)
        found = np.array([heading.position, height.position, heading.velocity, height.velocity, speed.velocity])

        def rates(t: float, z: np.ndarray, gains: CubicSpline = gains) -> np.ndarray:
            return np.concatenate([z[2:4], gains(t) @ z])

        exact = solve_ivp(rates, (begin, end), found[:, 0], "DOP853", run.t, rtol=1e-12, atol=1e-14).y
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-6)
    assert np.abs(exact).max() > 1e-3 and "no decay of errors is promised" in run.summary()


BORDER: list[list[float | str]] = [[1.0, "0.1*psi1", 0.0, 0.0, "t"], [0.0, 1.0, 0.2, "xi1_1", -1.0]]
FIVE = ["M_phi0", "M_phi1", "M_psi1", "F1_1", "F_x"]


def determinants(rows: np.ndarray) -> np.ndarray:
    """u_tau of (5.6): the determinant with delta^l_s in its first row, for every s."""
    return np.array([np.linalg.det(np.vstack([unit, rows])) for unit in np.eye(rows.shape[1])])


@pytest.mark.parametrize("engine", ENGINES)
def test_a_border_gives_the_determinant_of_the_paper(engine: str) -> None:
    t, law, weights = 0.3, "2e4*psi1*(1 + t)", {"M_phi0": "1e-4*(1 + xi1_1)"}
    workspace, y = held(skier(ROWS[1:3], FIVE, u0=law, border=BORDER, weights=weights))
    without, _ = held(skier(ROWS[1:3], FIVE, weights=weights))
    seen, programme = workspace.mechanism.scene.start, programme_of(workspace)
    scales = np.array(programme.scales)
    scales[0] = (1e-4 * (1 + seen["xi1_1"])) ** -0.5
    least = np.array([without.evaluate(t, y).controls[name] for name in FIVE])
    applied = np.array([workspace.evaluate(t, y).controls[name] for name in FIVE])
    physical = programme.control_matrix / scales
    if engine == "core":
        core = make_engine(workspace.system, workspace.branch, engine="core")
        assert isinstance(core, CoreEngine)
        core.evaluate(t, core.pack(workspace.unpack(t, y)))
        applied = shares(core)[0]
        found, beta = solved_programme(core.plan.plant.rows, core.memory.rows)
        physical, weight = found / scales, np.diag(scales**2)
        own = weight @ physical.T @ np.linalg.solve(physical @ weight @ physical.T, beta)
        np.testing.assert_allclose(own, least, rtol=0, atol=1e-9 * np.abs(least).max())
    border = np.array([[1.0, 0.1 * seen["psi1"], 0.0, 0.0, t], [0.0, 1.0, 0.2, seen["xi1_1"], -1.0]])
    added = 2e4 * seen["psi1"] * (1 + t) * determinants(np.vstack([physical, border]))
    np.testing.assert_allclose(applied, least + added, rtol=0, atol=1e-10 * np.abs(least).max())
    assert np.abs(added).max() > 1e-4 * np.abs(least).max()


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_with_a_border_keeps_the_programme_and_its_account_of_energy(engine: str, tmp_path: Path) -> None:
    keys = {"u0": "5e4*sin(3*t)*psi1_dot", "border": BORDER, "weights": {"M_phi0": "1e-4*(1 + xi1_1)"}}
    plain, pushed = (
        vlmb.simulate(vlmb.Scene.from_dict(skier(ROWS[1:3], FIVE, **more)), 0.6, engine=engine) for more in ({}, keys)
    )
    for text in ROWS[1:3]:
        np.testing.assert_allclose(plain.residuals[text].position, pushed.residuals[text].position, rtol=0, atol=1e-8)
    assert np.abs(pushed["balance"]).max() < 1e-9 * np.abs(pushed["energy"]).max()
    assert np.abs(plain["psi1"] - pushed["psi1"]).max() > 1e-5
    again = vlmb.load_trajectory(pushed.save(tmp_path / "run.npz"))
    assert again.scene == pushed.scene and again.scene.programme.border == pushed.scene.programme.border
    for name in FIVE:
        np.testing.assert_array_equal(again.controls[name], pushed.controls[name])


# ---- refusals

REFUSED: dict[str, tuple[Table, list[str]]] = {
    "an unknown name": ({"h": [["-psi9"]], "k": [[-1.0]]}, ["programme.h[0][0]", "psi9"]),
    "an unknown name in a weight": ({"weights": {"M_psi1": "x9"}}, ["programme.weights.M_psi1", "x9"]),
    "a weight below 0 by parameters": ({"weights": {"M_psi1": "-lean"}}, ["programme.weights.M_psi1", "above 0"]),
    "rows of different lengths": ({"h": [[-1.0, 2.0], ["-t"]], "k": [[-1.0]]}, ["programme.h", "2, 1 entries"]),
    "a border without u0": ({"border": [[1.0, 0.0, 0.0]]}, ["programme.border", "u0"]),
    "no border": ({"u0": "t"}, ["programme.u0", "3 controls and 1 rows", "1 rows of 3 entries"]),
    "a border of the wrong size": ({"u0": "t", "border": [[1.0, 0.0]]}, ["`border`", "1 rows of 3", "1 rows of 2"]),
    "u0 beside secondary rows": (
        {"u0": "t", "border": [[1.0, 0.0, 0.0]], "secondary": ["psi1 = 1"]}, ["programme.u0", "`secondary`"]
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_named(name: str) -> None:
    keys, texts = REFUSED[name]
    with pytest.raises(vlmb.SceneError) as caught:
        make_system(vlmb.build(vlmb.Scene.from_dict(skier(ROWS[2:3], ["M_psi1", "F1_1", "M_phi0"], **keys))))
    for text in texts:
        assert text in str(caught.value), str(caught.value)


def test_constant_entries_are_checked_for_decay_and_gains_of_velocity_rows_have_no_h() -> None:
    with pytest.raises(vlmb.SceneError, match="not stable"):
        make_system(vlmb.build(vlmb.Scene.from_dict(skier(ROWS[2:3], ["F1_1"], h=[["lean"]], k=[["-lean"]]))))
    with pytest.raises(vlmb.SceneError, match="programme.h: its columns are the rows of positions"):
        make_system(vlmb.build(vlmb.Scene.from_dict(skier(["speed = 5"], ["F_x"], h=[["-t"]], k=[[-1.0]]))))


FAILING = {
    "a gain without a value": ({"h": [["-1/(0.2 - t)"]], "k": [["-4*sqrt(0.1 - t)"]]}, "programme.k[0][0]"),
    "a weight that reaches 0": ({"weights": {"F1_1": "1e-6*(0.1 - t)"}}, "programme.weights.F1_1 = '1e-6*(0.1 - t)' is"),
    "a border without a value": (
        {"u0": "t", "border": [["log(0.1 - t)", 0.0, 0.0]]}, "programme.border[0][0] = 'log(0.1 - t)' has no finite value"
    ),
}  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", FAILING)
def test_a_run_ends_where_one_has_no_value(name: str, engine: str) -> None:
    keys, words = FAILING[name]
    made = vlmb.Scene.from_dict(skier(ROWS[2:3], ["M_psi1", "F1_1", "M_phi0"], **keys))
    run = vlmb.simulate(made, 0.5, engine=engine)
    assert run.status == "failed" and run.t[-1] == pytest.approx(0.1, abs=0.02)
    assert words in run.message, run.message
