"""Measured data in runs: laws, rows and lengths that name them, in both engines; what is beyond them and what is told of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.cli import main
from vlmb.model.signals import signals_of
from vlmb.scene.scene import Scene
from vlmb.system.pace import longest_steps
from vlmb.views.plots import PLOTS

RATE = 2.0 * np.pi
TIMES = np.arange(301) / 100.0


def recording(noise: float = 1e-3, seed: int = 3) -> np.ndarray:
    values = 0.4 + 0.05 * np.sin(RATE * TIMES) + noise * np.random.default_rng(seed).normal(size=len(TIMES))
    values[100:115] = np.nan
    return values


def data(values: np.ndarray | None = None, **more: Any) -> dict[str, Any]:
    values = recording() if values is None else values
    return {"name": "mocap", "time": TIMES, "columns": {"knee": {"values": values, "unit": "m"}}, **more}


def swing(law: str = "mocap.knee", **more: Any) -> dict[str, Any]:
    return {
        "base": {"kind": "pivot"}, "data": [data()], "start": {"phi1": 0.1, "psi1": -0.9, "psi1_dot": 0.3},
        "links": [{"name": "leg", "rod": {"length": 1.0, "mass": 2.0}, "lower": {"motion": "prescribed", "law": law},
                   "upper": {"motion": "free", "length": 0.3, "stiffness": 500.0}, "tip_mass": 1.0}],
        "forces": [{"on": "M_psi1", "law": "5*mocap.knee_dot + 0.1*mocap.knee_ddot*psi1"}],
        "run": {"duration": 3.0, "rtol": 1e-10, "atol": 1e-12}, **more,
    }  # fmt: skip


def test_both_engines_follow_the_same_curve() -> None:
    scene = Scene.from_dict(swing(forces=[*swing()["forces"], {"on": "F1_2", "law": "20*abs(mocap.knee - 0.4)"}]))
    core, pinocchio = (vlmb.simulate(scene, engine=engine) for engine in ("core", "pinocchio"))  # type: ignore[arg-type]
    assert core.status == pinocchio.status == "finished" and not core.doubts and not pinocchio.doubts
    for name in ("phi1", "psi1", "psi1_dot", "xi1_1", "xi1_1_dot", "xi1_2", "energy"):
        np.testing.assert_allclose(core[name], pinocchio[name], rtol=0, atol=2e-8)
    for name in core.controls:
        np.testing.assert_allclose(core.controls[name], pinocchio.controls[name], rtol=0, atol=1e-5)
    signal = signals_of(scene).columns[0]
    np.testing.assert_allclose(core["xi1_1"], signal.values(core.t), rtol=1e-15)
    np.testing.assert_array_equal(core["mocap.knee_ddot"], signal.values(core.t, 2))
    assert np.abs(core["xi1_1"] - 0.4 - 0.05 * np.sin(RATE * core.t)).max() < 2e-3
    law = 5.0 * core["mocap.knee_dot"] + 0.1 * core["mocap.knee_ddot"] * core["psi1"]
    np.testing.assert_allclose(core.controls["M_psi1"], law, rtol=1e-9, atol=1e-12)
    for run in (core, pinocchio):  # the length does work, and all of it is counted
        assert np.abs(run["balance"]).max() < 1e-6 and abs(run.work_by_force["F1_1"][-1]) > 0.5


def test_data_replace_a_formula() -> None:
    """Exact samples give what the formula does, to what a quintic spline through 100 samples in a second leaves."""
    exact = 0.4 + 0.05 * np.sin(RATE * TIMES)
    for engine in ("core", "pinocchio"):
        by_data = vlmb.simulate(swing(data=[data(exact, smooth="none")], forces=[]), engine=engine)
        by_formula = vlmb.simulate(swing("0.4 + 0.05*sin(2*pi*t)", forces=[], data=[]), engine=engine)
        np.testing.assert_allclose(by_data["psi1"], by_formula["psi1"], rtol=0, atol=1e-6)
        within = slice(20, -20)  # of 40 N; the ends leave a trace in the spring
        np.testing.assert_allclose(by_data.controls["F1_1"][within], by_formula.controls["F1_1"][within], rtol=0, atol=0.01)


@pytest.mark.parametrize("law, read", [
    ("mocap.knee", lambda run: run["mocap.knee"]), ("t", lambda run: run.t),
    ("mocap.knee_dot", lambda run: run["mocap.knee_dot"]),
    ("max(mocap.knee, 0.42)*psi1", lambda run: np.maximum(run["mocap.knee"], 0.42) * run["psi1"]),
])  # fmt: skip
def test_a_law_may_be_a_bare_name(law: str, read: Any) -> None:
    scene = swing(forces=[{"on": "M_psi1", "law": law}])
    for engine in ("core", "pinocchio"):
        run = vlmb.simulate(scene, engine=engine)
        np.testing.assert_allclose(run.controls["M_psi1"], read(run), rtol=1e-9, atol=1e-12)


def test_rows_and_programmes_follow_data() -> None:
    link = {"name": "leg", "rod": {"length": 0.5, "mass": 5.0}, "lower": {"length": 0.4, "stiffness": 2000.0}, "tip_mass": 20.0}
    base = {"base": {"kind": "pivot"}, "links": [link], "start": {"psi1": -1.2}, "data": [data()], "run": {"duration": 2.0}}
    ideal = {**base, "constraints": ["length: xi1_1 = mocap.knee"]}
    programme = {**base, "programme": {"constraints": ["xi1_1 = mocap.knee"], "controls": ["F1_1"], "frequency": 8.0}}
    for scene in (ideal, programme):
        runs = [vlmb.simulate(scene, engine=engine) for engine in ("core", "pinocchio")]
        for run in runs:
            late = run.t > 1.6
            assert np.abs(run["xi1_1"] - run["mocap.knee"])[late].max() < 1e-4
            assert np.abs(run["balance"]).max() < 1e-4
        np.testing.assert_allclose(runs[0]["psi1"], runs[1]["psi1"], rtol=0, atol=1e-6)
    (row,) = vlmb.simulate(ideal).system.info
    assert row.holonomic and row.working  # data move it, so that it does work


def test_kinks_in_data_are_breaks() -> None:
    scene = Scene.from_dict(swing(forces=[{"on": "M_psi1", "law": "3*abs(mocap.knee - 0.4)"}]))
    run = vlmb.simulate(scene)
    found = sorted(run.system.breaks(0.0, 3.0))
    curve = signals_of(scene)
    assert 5 <= len(found) <= 9
    np.testing.assert_allclose(curve.along("mocap.knee", np.array(found)), 0.4, atol=1e-12)


def test_steps_are_as_short_as_data_vary() -> None:
    """Within a step h^2 max|f''| <= the range of f, of the curve and of its second derivative: h w about 1 for a sine."""
    smooth = longest_steps(Scene.from_dict(swing()), 0.0, 3.0)
    assert 0.3 < smooth[:, 2].min() * RATE < 1.5
    rough = longest_steps(Scene.from_dict(swing(data=[data(smooth="none")])), 0.0, 3.0)
    assert 1e-3 < rough[:, 2].min() < 0.02  # a curve through noisy samples turns from sample to sample
    pulse = np.exp(-(((TIMES - 1.73) / 0.03) ** 2))
    scene = swing("0.4", data=[data(pulse, smooth="none")], forces=[{"on": "M_psi1", "law": "50*mocap.knee"}])
    run, loose = vlmb.simulate(scene), vlmb.simulate(scene, rtol=1e-4, atol=1e-6)
    assert run.work_by_force["M_psi1"][-1] == pytest.approx(loose.work_by_force["M_psi1"][-1], rel=0.05)  # not stepped over
    assert abs(run.work_by_force["M_psi1"][-1]) > 0.1


def test_outside_the_data_is_a_named_error() -> None:
    words = r"from t = 0 to 4 s needs mocap\.knee, whose data reach from 0 to 3 s"
    for do in (lambda: vlmb.simulate(swing(), duration=4.0), lambda: vlmb.check(swing(run={"duration": 4.0}))):
        with pytest.raises(vlmb.SceneError, match=words):
            do()
    with pytest.raises(vlmb.SceneError, match=r"needs mocap\.knee"):
        vlmb.simulate(swing(), t0=-1.0)
    with pytest.raises(vlmb.SceneError, match=r"the instant from t = 3.5 to 3.5 s needs mocap.knee"):
        vlmb.accelerations(swing(), {"phi1": 0.1, "psi1": 0.3, "xi1_2": 0.3}, t=3.5)
    late = {**data(), "time": TIMES + 1.0}
    run = vlmb.simulate(swing(data=[late]), duration=2.0, t0=1.5)  # lengths at the start are those of the data
    assert run.status == "finished" and run["xi1_1"][0] == pytest.approx(run["mocap.knee"][0])


def test_where_may_pass_the_ends_by() -> None:
    law = "where(t < 3, 5*mocap.knee_dot, 0)"
    for engine in ("core", "pinocchio"):
        run = vlmb.simulate(swing("0.4", forces=[{"on": "M_psi1", "law": law}]), duration=3.5, engine=engine)
        assert run.status == "finished" and np.isnan(run["mocap.knee"][-1])
        beyond = swing("0.4", forces=[{"on": "M_psi1", "law": law.replace("3,", "3.2,")}])
        run = vlmb.simulate(beyond, duration=3.5, engine=engine)
        assert run.status == "failed" and "mocap.knee has data from 0 to 3 s" in run.message


def test_holes_that_are_too_long_are_named() -> None:
    values = recording()
    values[100:125] = np.nan
    words = r"data\[0\].columns.knee: no sample from t = 0.99 to 1.25 s, a hole of 0.26 s: longer than gap = 0.2 s"
    with pytest.raises(vlmb.SceneError, match=words):
        vlmb.build(swing(data=[data(values)]))
    assert vlmb.check(swing(data=[data(values, gap=0.3)])).mechanism.signals.columns[0].holes == ((0.99, 1.25),)
    values[5:] = np.nan
    with pytest.raises(vlmb.SceneError, match="5 samples; a curve with two derivatives needs 6"):
        vlmb.build(swing(data=[data(values)]))


@pytest.mark.parametrize("name, words", [
    ("mocap.kne", "did you mean 'mocap.knee'"), ("mocap.knee_dddot", "did you mean"), ("mocap", "unknown name 'mocap'"),
])  # fmt: skip
def test_wrong_names_are_explained(name: str, words: str) -> None:
    for scene in (swing(forces=[{"on": "M_psi1", "law": name}]), swing(constraints=[f"psi1 = {name}"])):
        with pytest.raises(vlmb.SceneError, match=words):
            vlmb.check(scene)
    with pytest.raises(vlmb.SceneError, match=r"unknown name|read of the motion"):
        vlmb.check(swing(name))


def test_a_control_sees_data() -> None:
    seen = []

    def control(t: float, view: vlmb.StateView) -> dict[str, float]:  # type: ignore[name-defined]
        seen.append("mocap.knee" in view and "mocap.knee_ddot" in list(view))
        return {"M_psi1": 5.0 * view["mocap.knee"]}

    run = vlmb.simulate(swing(forces=[]), duration=0.5, control=control)
    np.testing.assert_allclose(run.controls["M_psi1"], 5.0 * run["mocap.knee"], rtol=1e-12)
    assert all(seen)


def test_tables_files_and_figures_have_the_data(tmp_path: Path) -> None:
    run = vlmb.simulate(swing(), duration=1.0)
    header = run.save_csv(tmp_path / "run.csv").read_text().splitlines()[0].split(",")
    assert header[header.index("mocap.knee [m]") + 1] == "mocap.knee_dot [m/s]" and "mocap.knee_ddot [m/s^2]" in header
    np.testing.assert_array_equal(run.to_pandas()["mocap.knee"], run["mocap.knee"])
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))  # the data are in the file
    np.testing.assert_array_equal(again["mocap.knee_ddot"], run["mocap.knee_ddot"])
    assert "mocap.knee" in run.names and "mocap.knee" in run._ipython_key_completions_()
    figure = PLOTS["data"](run)
    assert [ax.get_ylabel() for ax in figure.axes] == ["mocap.knee [m]", "its 2nd derivative\n[m/s²]"]
    dots, curve = figure.axes[0].lines
    assert len(dots.get_xdata()) == 100 and np.abs(np.asarray(curve.get_ydata()) - 0.4).max() < 0.06
    assert len(figure.axes[1].patches) == 1  # the end that the run begins at
    empty = PLOTS["data"](vlmb.simulate("models/one_link.toml", duration=0.1))
    assert not empty.axes


def test_check_and_info_tell_of_the_data(capsys: pytest.CaptureFixture[str]) -> None:
    told = (
        "mocap.length: 1186 samples from 0 to 12 s, about 100 Hz; 1 hole bridged, the longest from 4.99 to 5.15 s; "
        "smoothed by cross-validation: residual 0.0014"
    )
    for command in ("check", "info"):
        assert main([command, "models/recorded_pumping.toml"]) == 0
        shown = capsys.readouterr().out
        assert told in shown and "acceleration up to 2." in shown and "its ends, 0.0" in shown


def test_the_recorded_swing_swings_as_the_formula_does() -> None:
    by_data, by_formula = vlmb.simulate("models/recorded_pumping.toml"), vlmb.simulate("models/pumping.toml")
    np.testing.assert_allclose(by_data["psi1"], by_formula["psi1"], rtol=0, atol=2e-3)
    within = slice(60, -60)  # of forces that reach 740 N
    off = by_data.controls["F1_1"][within] - by_formula.controls["F1_1"][within]
    assert np.sqrt(np.mean(off**2)) < 5.0


def test_scenes_without_data_carry_nothing() -> None:
    run = vlmb.simulate("models/one_link.toml", duration=0.1)
    assert not run.mechanism.signals and run.system.core_plan.plant.tape.series.shape == (0, 7)
