"""Forces of a control callable are recorded as they act; nothing that the user gave is called after the run."""

from __future__ import annotations

import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson

import vlmb
import vlmb.simulation.simulate
from tests.small_scenes import FIXED, PIVOT, SKI, bent, link, scene
from vlmb.simulation.methods import METHODS

RIGID = scene(PIVOT, [link("a", lower=FIXED, upper=FIXED)], start={"psi1": 0.3, "phi1": 0.2})
TIMES = np.linspace(0.0, 1.0, 201)


class Integral:
    """M_psi1 = 30 e + 40 (integral of e) - 2 psi1', which remembers; `back`: whether it goes back with the time as well."""

    def __init__(self, back: bool) -> None:
        self.back, self.integral, self.last, self.asked = back, 0.0, 0.0, []

    def __call__(self, t: float, view: Any) -> dict[str, float]:
        self.asked.append(t)
        error = 0.6 - view["psi1"]
        if self.back or t > self.last:
            self.integral += error * (t - self.last)
            self.last = t
        return {"M_psi1": 30.0 * error + 40.0 * self.integral - 2.0 * view["psi1_dot"]}


@pytest.mark.parametrize("back", [True, False])
@pytest.mark.parametrize("method", METHODS)
def test_the_power_of_a_control_that_remembers_integrates_to_its_work(method: str, back: bool) -> None:
    if method == "gauss" and back:
        pytest.skip("its stages converge only where the same state has the same forces")
    control = Integral(back)
    run = vlmb.simulate(RIGID, duration=1.0, method=method, control=control, t_eval=TIMES, rtol=1e-6, atol=1e-8)
    assert run.status == "finished", run.message
    work = run.work_by_force["M_psi1"]
    assert np.abs(work).max() > 5.0
    power = run.controls["M_psi1"] * run["psi1_dot"]  # with the forces as they are stored
    np.testing.assert_allclose(run.power("M_psi1"), power, rtol=0, atol=1e-9)
    assert simpson(power, x=run.t) == pytest.approx(work[-1], abs=5e-3 * np.abs(work).max())
    called = len(control.asked)
    run.summary(), run.reactions, run["energy"], run.hinge_force("a"), pickle.dumps(run)
    assert len(control.asked) == called


def test_a_control_is_asked_once_for_every_sample_in_order() -> None:
    seen: list[tuple[float, float]] = []

    def control(t: float, view: Any) -> dict[str, float]:
        seen.append((t, view["psi1"]))
        return {"M_psi1": float(len(seen))}  # every answer is another

    run = vlmb.simulate(RIGID, duration=1.0, method="rk4", step=0.25, control=control, t_eval=[0.1, 0.2, 0.5, 0.9])
    answers = run.controls["M_psi1"]
    assert len(set(answers)) == len(run) and (np.diff(answers) > 0.0).all()
    for t, psi, answer in zip(run.t, run["psi1"], answers, strict=True):
        assert seen[int(answer) - 1] == (t, pytest.approx(psi, abs=1e-13))


def test_what_it_sees_cannot_be_changed() -> None:
    def honest(t: float, view: Any) -> dict[str, float]:
        return {"M_psi1": 1.0 - view["psi1_dot"]}

    refused = []

    def hostile(t: float, view: Any) -> dict[str, float]:
        answer = honest(t, view)
        for write in (
            lambda: view.q.fill(0.0), lambda: view.v.fill(9.0), lambda: view.values.update(psi1=0.0),
            lambda: view.values.__setitem__("psi1", 0.0),
        ):  # fmt: skip
            with pytest.raises((ValueError, TypeError, AttributeError)):
                write()
            refused.append(t)
        view.position("link1")[:] = 0.0  # a copy
        return answer

    runs = [vlmb.simulate(bent(SKI, 1), duration=0.2, control=control) for control in (honest, hostile)]
    assert len(refused) > 100
    assert np.array_equal(runs[0].q, runs[1].q) and np.array_equal(runs[0].v, runs[1].v)
    assert np.array_equal(runs[0].controls["M_psi1"], runs[1].controls["M_psi1"])


def test_it_lists_every_name_that_it_knows() -> None:
    seen: list[Any] = []
    made = bent(PIVOT, 2, parameters={"gain_of_knee": 2.5})
    vlmb.simulate(made, duration=0.01, control=lambda t, view: seen.append(view))
    view = seen[0]
    names = view.keys()
    assert names == list(view) == view._ipython_key_completions_() and len(set(names)) == len(names)
    assert {"t", "gain_of_knee", "psi2_dot", "link1.lower", "link2.tip.z_dot", "com.z"} < set(names)
    assert all(name in view and math.isfinite(view[name]) for name in names)
    assert "speed" not in view and 3 not in view and "psi3" not in view
    assert "t = 0 s" in repr(view) and "psi2" in repr(view)
    close = {"psi3": "psi1", "gain_of_kne": "gain_of_knee", "link2.tp.z": "link2.tip.z", "zzzz": "valid names"}
    for wrong, near in close.items():
        with pytest.raises(vlmb.SceneError, match=f"control: unknown name '{wrong}'; .*{near}"):
            view[wrong]
    with pytest.raises(vlmb.SceneError, match=r"view\[0\]: a name is needed"):
        view[0]


@pytest.mark.parametrize("method", METHODS)
def test_an_exception_carries_the_run_so_far(method: str) -> None:
    def control(t: float, view: Any) -> dict[str, float]:
        if t > 0.25:
            raise ZeroDivisionError("mine")
        return {"M_psi1": 0.1}

    with pytest.raises(ZeroDivisionError, match="mine") as caught:
        vlmb.simulate(bent(PIVOT, 1), duration=0.5, control=control, method=method, rtol=1e-7, atol=1e-9)
    run = caught.value.trajectory  # type: ignore[attr-defined]
    assert run.status == "failed" and "the control raised ZeroDivisionError: mine" in run.message
    assert 1 < len(run) <= 101 and run.t[-1] <= 0.25
    np.testing.assert_array_equal(run.controls["M_psi1"], 0.1)
    assert run.summary().startswith("FAILED")


def test_an_error_of_progress_carries_the_run_so_far() -> None:
    def progress(t: float) -> None:
        if t > 0.2:
            raise RuntimeError("the terminal is gone")

    with pytest.raises(RuntimeError, match="terminal") as caught:
        vlmb.simulate(bent(PIVOT, 1), duration=0.5, progress=progress)
    run = caught.value.trajectory  # type: ignore[attr-defined]
    assert run.t[-1] > 0.19 and "RuntimeError: the terminal is gone" in run.message and "control" not in run.message


def test_an_interrupted_run_has_the_forces_that_acted() -> None:
    def control(t: float, view: Any) -> dict[str, float]:
        if t > 0.25:
            raise KeyboardInterrupt
        return {"M_psi1": 3.0 + t}

    run = vlmb.simulate(bent(SKI, 1), duration=0.5, control=control)
    assert run.status == "interrupted" and len(run) > 10
    np.testing.assert_allclose(run.controls["M_psi1"], 3.0 + run.t, rtol=1e-14)
    assert np.isfinite(run.reactions["knife_edge"]).all()


def test_forces_that_are_not_known_are_nan_and_said(tmp_path: Path) -> None:
    """Interrupted before the first sample asked for: the control never answered there."""

    def control(t: float, view: Any) -> dict[str, float]:
        if t > 0.25:
            raise KeyboardInterrupt
        return {"M_psi1": 3.0}

    run = vlmb.simulate(bent(SKI, 1), duration=0.5, control=control, t_eval=[0.4, 0.5])
    assert run.status == "interrupted" and len(run) == 1
    assert "the forces of the control at this sample are not known" in run.message
    loaded = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    for one in (run, loaded):
        assert np.isnan(one.controls["M_psi1"]).all() and np.isnan(one.reactions["knife_edge"]).all()
        assert np.isfinite(one["energy"]).all()
        assert "nan" in one.summary()
    assert run.save_csv(tmp_path / "run.csv").read_text(encoding="utf-8").count("nan") > 3


def test_an_interrupt_after_the_last_sample_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    make, tries = vlmb.Trajectory.from_run, []

    def late(*args: Any, **kwargs: Any) -> vlmb.Trajectory:
        tries.append(1)
        if len(tries) == 1:
            raise KeyboardInterrupt
        return make(*args, **kwargs)

    monkeypatch.setattr(vlmb.Trajectory, "from_run", staticmethod(late))
    run = vlmb.simulate(bent(PIVOT, 1), duration=0.1)
    assert run.status == "finished" and len(run) > 100 and len(tries) == 2


def test_the_reactions_of_a_failed_run_end_where_it_failed() -> None:
    """A massless hinge between lined-up legs has no accelerations at the start, so no forces: not zero ones."""
    legs = [link("thigh", tip_mass=None), link("shank")]
    run = vlmb.simulate(scene(PIVOT, legs, start={"psi1": 1.0, "psi2": 1.0}), duration=0.1)
    assert run.status == "failed"
    assert run.summary().startswith("FAILED")
    assert np.isnan(run.hinge_force("shank")).all()


def test_a_control_without_forces_is_stored(tmp_path: Path) -> None:
    run = vlmb.simulate(bent(PIVOT, 1), duration=0.1, control=lambda t, view: None)
    loaded = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert np.array_equal(loaded["psi1"], run["psi1"])


def test_what_a_control_is_not_asked_for(tmp_path: Path) -> None:
    """A stored run has its forces to the last digit, without the control."""
    made = bent(SKI, 2, constraints=["phi1 = phi0"])
    run = vlmb.simulate(made, duration=0.3, control=lambda t, view: {"M_psi1": math.sin(9 * t), "F1_1": view["xi1_1"]})
    loaded = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    for name in ("M_psi1", "F1_1"):
        np.testing.assert_array_equal(loaded.controls[name], run.controls[name])
    np.testing.assert_allclose(run.controls["M_psi1"], np.sin(9 * run.t), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(loaded.reactions["phi1 = phi0"], run.reactions["phi1 = phi0"])


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_a_run_that_stops_at_its_start_has_the_force_of_the_control_there(engine: str) -> None:
    leg = {"length": 0.25, "limits": [0.25, 0.6]}
    made = scene(PIVOT, [link("a", lower=leg, upper=FIXED)], start={"psi1": 0.3, "xi1_1_dot": -1.0})
    run = vlmb.simulate(made, duration=0.3, engine=engine, control=lambda t, view: {"M_psi1": 3.0})
    assert run.status == "stopped" and run.t.tolist() == [0.0]
    assert run.controls["M_psi1"].tolist() == [3.0] and "not known" not in run.message


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("error", [SystemExit, RuntimeError, vlmb.SceneError])
def test_an_error_of_any_kind_tells_its_time_and_keeps_the_run(error: type[BaseException], engine: str) -> None:
    """Also where the control fails at a sample that was just taken, and where the error ends the program."""

    def control(t: float, view: Any) -> dict[str, float]:
        if t == 0.125:
            raise error("mine")
        return {"M_psi1": 0.1}

    times = [0.0, 0.1, 0.125, 0.3]
    try:
        run = vlmb.simulate(bent(PIVOT, 1), duration=0.3, engine=engine, control=control, t_eval=times)
    except (SystemExit, RuntimeError) as caught:
        run = caught.trajectory  # type: ignore[union-attr]
    assert run.status == "failed" and "mine" in run.message
    assert run.t.tolist() == [0.0, 0.1, 0.125]
    assert 0.1 <= float(run.message.split()[4]) <= 0.15
    assert run.controls["M_psi1"][:2].tolist() == [0.1, 0.1] and math.isnan(run.controls["M_psi1"][2])
