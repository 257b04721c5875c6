"""A run that goes on from another one's end, and runs that begin at a time of their own."""

from __future__ import annotations

import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.cli import main
from vlmb.simulation.end import End

SLALOM = Path(__file__).resolve().parents[2] / "models" / "skier_slalom.toml"
ROD = {"length": 1.0, "mass": 2.0}
SPRING = {"length": 0.3, "stiffness": 900.0, "rest": 0.3}
SCENES: dict[str, dict[str, Any]] = {
    "turns of an azimuth": {
        "base": {"kind": "pivot"}, "links": [{"name": "a", "rod": ROD, "lower": SPRING}],
        "start": {"phi1_dot": 6.0, "psi1": -0.8},
    },
    "turns in a plane": {
        "plane": True, "base": {"kind": "pivot"}, "links": [{"name": "a", "rod": ROD}], "start": {"psi1": 0.0, "psi1_dot": 9.0},
    },
    "a law of time with a kink where the second run begins": {
        "base": {"kind": "pivot"}, "links": [{"name": "a", "rod": ROD, "lower": SPRING}],
        "start": {"psi1": -1.2, "phi1_dot": 0.5}, "forces": [{"on": "M_psi1", "law": "3*sin(2*t) + 4*abs(t - 2)"}],
    },
    "a prescribed length": {
        "base": {"kind": "pivot"}, "start": {"psi1": -1.0, "phi1_dot": 1.0},
        "links": [{"name": "a", "rod": ROD, "lower": {"motion": "prescribed", "law": "0.5 + 0.2*sin(3*t)"}}],
    },
    "a row with t": {
        "base": {"kind": "pivot"}, "start": {"psi1": -0.8, "phi1": 0.1},
        "links": [{"name": "a", "rod": ROD, "lower": SPRING}], "constraints": ["phi1 = 0.1 + 5*t"],
    },
    "a turning ski": {
        "base": {"kind": "ski", "mass": 5.0, "inertia": 0.6, "com_offset": 0.1}, "slope": 0.1,
        "links": [{"name": "a", "rod": {"length": 0.5, "mass": 30.0}, "lower": SPRING | {"stiffness": 4e4, "damping": 50.0}}],
        "start": {"phi0_dot": 3.5, "psi1": 1.5, "speed": 2.0}, "forces": [{"on": "T_a", "law": "20*cos(t)"}],
        "run": {"fall": False},
    },
}  # fmt: skip
TIGHT = {"rtol": 1e-11, "atol": 1e-12}


def copied(what: Any) -> Any:
    return pickle.loads(pickle.dumps(what))  # noqa: S301 - our own


def apart(first: vlmb.Trajectory, second: vlmb.Trajectory, at: int = -1) -> float:
    return max(abs(first[name][at] - second[name][at]) / (1.0 + abs(first[name][at])) for name in first.mechanism.names.known)


@pytest.mark.parametrize("name", SCENES)
def test_two_runs_are_one(name: str) -> None:
    scene = vlmb.Scene.from_dict(SCENES[name])
    whole, first = vlmb.simulate(scene, 5.0, **TIGHT), vlmb.simulate(scene, 2.0, **TIGHT)
    second = vlmb.simulate(scene, 3.0, start=first.end, t0=2.0, t_eval=whole.t[whole.t >= 2.0], **TIGHT)
    assert whole.status == first.status == second.status == "finished"
    assert (second.t[0], second.t[-1], second.t0) == (2.0, 5.0, 2.0)
    assert second["energy"][0] == pytest.approx(first["energy"][-1], rel=1e-10)
    for known in whole.mechanism.names.known:
        assert second[known][0] == pytest.approx(first[known][-1], rel=1e-9, abs=1e-9), known
    assert apart(whole, second) < 2e-7, name
    assert abs(second["balance"]).max() < 1e-6
    work = first["work"][-1] - first["dissipated"][-1] + second["work"][-1] - second["dissipated"][-1]
    assert work == pytest.approx(whole["work"][-1] - whole["dissipated"][-1], abs=1e-6)
    for force in whole.controls:
        assert second.controls[force][-1] == pytest.approx(whole.controls[force][-1], rel=1e-6, abs=1e-6)
    for row in whole.reactions:
        assert second.reactions[row][-1] == pytest.approx(whole.reactions[row][-1], rel=1e-5, abs=1e-5)


def test_angles_keep_their_turns() -> None:
    turned, plane, ski = (
        vlmb.simulate(SCENES[name], 2.0) for name in ("turns of an azimuth", "turns in a plane", "a turning ski")
    )
    for run, name in ((turned, "phi1"), (plane, "psi1"), (ski, "phi0")):
        again = vlmb.simulate(run.scene, 0.1, start=run.end)
        assert abs(run[name][-1]) > 2.0 * math.pi or name == "phi0"
        assert run.end.coordinates[name] == run[name][-1] == pytest.approx(again[name][0], rel=1e-14)


def test_a_programme_goes_on() -> None:
    whole = vlmb.simulate(SLALOM, 3.0, rtol=1e-10)
    first = vlmb.simulate(SLALOM, 1.2, rtol=1e-10)
    second = vlmb.simulate(SLALOM, 1.8, start=first.end, t0=1.2, rtol=1e-10)
    assert apart(whole, second) < 1e-8
    for name in whole.controls:
        assert second.controls[name][-1] == pytest.approx(whole.controls[name][-1], rel=1e-6, abs=1e-6)
    for name in whole.residuals:
        assert second.residuals[name].velocity[-1] == pytest.approx(whole.residuals[name].velocity[-1], abs=1e-7)


@pytest.mark.parametrize("method", ["euler", "rk4", "gauss", "dop853", "adams", "bdf", "radau"])
@pytest.mark.parametrize("t0", [-40.0, 7.5])
def test_time_has_no_origin(method: str, t0: float) -> None:
    """The motion under a law of t - t0 that begins at t0 is that under the law of t that begins at 0."""
    made = SCENES["a law of time with a kink where the second run begins"]
    here = {**made, "forces": [{"on": "M_psi1", "law": "3*sin(2*t) + 4*abs(t - 0.3)"}]}
    there = {**made, "forces": [{"on": "M_psi1", "law": f"3*sin(2*(t - ({t0}))) + 4*abs(t - ({t0 + 0.3}))"}]}
    times = np.array([0.25, 0.5, 1.0])
    options: dict[str, Any] = {"method": method, "step": 1e-3 if method != "gauss" else 1e-2, "rtol": 1e-9}
    first = vlmb.simulate(here, 1.0, t_eval=times, **options)
    second = vlmb.simulate(there, 1.0, t_eval=t0 + times, t0=t0, **options)
    assert second.message == f"finished at t = {t0 + 1.0:g} s."
    for name in first.mechanism.names.known:
        assert second[name] == pytest.approx(first[name], rel=1e-6, abs=1e-6), name


def test_prescribed_lengths_and_rows_are_met_at_the_start_time() -> None:
    run = vlmb.simulate(SCENES["a prescribed length"], 0.5, t0=1.7)
    assert run["xi1_1"] == pytest.approx(0.5 + 0.2 * np.sin(3.0 * run.t), abs=1e-14)
    assert run["xi1_1_dot"][0] == pytest.approx(0.6 * math.cos(5.1), abs=1e-14)
    row = vlmb.simulate(SCENES["a row with t"], 0.5, t0=2.0)
    turns = (row["phi1"] - 0.1 - 5.0 * row.t) / (2.0 * math.pi)  # a row on azimuths alone holds up to full turns
    assert turns == pytest.approx(np.full(len(row), round(turns[0])), abs=1e-8)
    assert row["phi1_dot"][0] == pytest.approx(5.0, abs=1e-12)
    jump = vlmb.simulate(SCENES["a prescribed length"], 0.5, t0=1.7, start=run.end)
    assert any(note.startswith("start: xi1_1 = 0.314") and "by its law" in note for note in jump.adjustments)


def test_another_scene_goes_on_with_other_forces() -> None:
    first = vlmb.simulate(SCENES["turns of an azimuth"], 1.0)
    calm = {**SCENES["turns of an azimuth"], "gravity": 0.0, "start": {}}
    second = vlmb.simulate(calm, 1.0, start=first.end, t0=first.end.time)
    assert {name: second[name][0] for name in first.end.coordinates} == pytest.approx(first.end.coordinates, rel=1e-14)
    assert second["kinetic"][0] == pytest.approx(first["kinetic"][-1], rel=1e-12)
    assert second.scene.gravity == 0.0


def test_a_dict_lies_over_the_start_of_the_scene() -> None:
    ski = SCENES["a turning ski"]
    run = vlmb.simulate(ski, 0.1, start={"a.elevation": 1.3, "a.lower_dot": 0.2, "x_dot": 3.0})
    begins = {name: run[name][0] for name in ("psi1", "xi1_1_dot", "phi0_dot", "speed")}
    assert begins == pytest.approx({"psi1": 1.3, "xi1_1_dot": 0.2, "phi0_dot": 3.5, "speed": 3.0})
    assert vlmb.simulate(run.scene, 0.1, start={"speed": 1.0})["speed"][0] == pytest.approx(1.0)
    assert run.scene.start["psi1"] == 1.3


def test_an_end_is_a_small_frozen_value() -> None:
    run = vlmb.simulate(SCENES["turns of an azimuth"], 0.5)
    end = run.end
    assert end == copied(end) == run.end and hash(end) == hash(run.end)
    assert len(pickle.dumps(end)) < 500
    with pytest.raises(AttributeError):
        end.time = 1.0  # type: ignore[misc]
    end.coordinates["phi1"] = 0.0
    assert end.coordinates["phi1"] == run["phi1"][-1] and end.rates["psi1_dot"] == run["psi1_dot"][-1]
    assert repr(end).startswith("<End at t = 0.5 s: phi1 = ")


def test_an_end_at_the_pole_keeps_its_motion() -> None:
    """A link that passes the vertical sideways has no azimuth there, but a velocity."""
    scene = vlmb.Scene.from_dict({"base": {"kind": "pivot"}, "links": [{"name": "a", "rod": ROD}]})
    mechanism = vlmb.build(scene)
    for psi in (0.5 * math.pi, -0.5 * math.pi):
        made = vlmb.simulate(scene, 1.0, t_eval=[0.0], start={"psi1": psi})
        q, v = mechanism.state({"phi1": 0.5 * math.pi - 0.1, "psi1": psi}, {"psi1_dot": 0.7})
        moved = vlmb.Trajectory(
            mechanism, made.t, np.concatenate([q, v])[None], "pinocchio", made.inputs, (), np.array([[0.2, psi]]), made.run,
            "finished", "", (), made.stats, made.versions,
        )  # fmt: skip
        assert moved["psi1_dot"][0] != pytest.approx(0.7)  # of the azimuth it is read on
        again = mechanism.postures(mechanism.state(moved.end.coordinates, moved.end.rates))
        assert again.direction_rates[0] == pytest.approx(moved._postures.direction_rates[0, 0], abs=1e-15)
        assert abs(moved.end.coordinates["phi1"] - 0.2) <= 0.5 * math.pi


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": End(0.0, ("phi1",), (0.0,), (0.0,))}, "other coordinates: it lacks psi1, xi1_1; give a dict"),
        ({"start": End(0.0, ("phi1", "psi1", "xi1_1", "x"), (0.0,) * 4, (0.0,) * 4)}, "this scene has no x; give a dict"),
        ({"start": {"psi2": 1.0}}, "start.psi2: no such coordinate in this scene"),
        ({"start": {"a.azimuth": 1.0, "phi1": 1.0}}, "start.phi1: phi1 is given already"),
        ({"start": {"psi1": "up"}}, "start.psi1"),
        ({"start": {"psi1": math.nan}}, "start.psi1"),
        ({"start": 3}, "start = 3: must be the end of a run, or a dict"),
        ({"t0": math.inf}, "t0 = inf: must be the time of the start"),
        ({"t0": "now"}, "t0 = 'now': must be"),
        ({"t0": 1e18}, "cannot be told apart"),
        ({"t0": 2.0, "t_eval": [0.0, 1.0]}, r"t_eval: times must ascend within \[2, 3\] s"),
    ],
)  # fmt: skip
def test_what_no_start_is(options: dict[str, Any], message: str) -> None:
    with pytest.raises(vlmb.SceneError, match=message):
        vlmb.simulate(SCENES["turns of an azimuth"], 1.0, **options)


def test_a_trajectory_is_no_start_but_its_end_is() -> None:
    run = vlmb.simulate(SCENES["turns of an azimuth"], 0.1)
    with pytest.raises(vlmb.SceneError, match="a trajectory has its `end`"):
        vlmb.simulate(run.scene, 0.1, start=run)  # type: ignore[arg-type]


def test_a_stored_run_knows_its_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = SCENES["a law of time with a kink where the second run begins"]
    first = vlmb.simulate(scene, 0.5)
    second = vlmb.simulate(scene, 0.5, start=first.end, t0=0.5, t_eval=[0.6, 1.0])
    assert "simulated        0.5 s in" in second.summary()
    path = second.save(tmp_path / "run.npz")
    assert (vlmb.load_trajectory(path).t0, copied(second).t0) == (0.5, 0.5)
    assert main(["run", str(path), "--output", str(tmp_path / "again"), "--no-plots", "--quiet"]) == 0
    again = vlmb.load_trajectory(tmp_path / "again" / "run.npz")
    assert again.t.tolist() == second.t.tolist() and again.q == pytest.approx(second.q, abs=1e-14)
