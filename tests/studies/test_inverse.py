"""Inverse dynamics: forces that drove a motion are found again from its samples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.simulation.trajectory import Trajectory

ARM: dict[str, Any] = {
    "base": {"kind": "pivot"}, "plane": True, "links": [{"name": "arm", "rod": {"length": 1.0, "mass": 2.0}}],
    "start": {"psi1": -1.2}, "forces": [{"on": "M_psi1", "law": "-0.5*psi1_dot"}], "run": {"duration": 4.0, "samples": 100.0},
}  # fmt: skip
DRIVEN = {**ARM, "forces": [*ARM["forces"], {"on": "M_psi1", "law": "6*sin(4*t)"}]}


def rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_a_force_is_found_in_noisy_samples() -> None:
    """Errors of 2 mrad, 100 Hz, a hole of 15 samples: within 15 % of the force, in the median of 20 recordings."""
    run = vlmb.simulate(DRIVEN)
    wanted, shares = 6.0 * np.sin(4.0 * run.t), []
    for seed in range(20):
        seen = run["psi1"] + 2e-3 * np.random.default_rng(seed).normal(size=len(run.t))
        seen[150:165] = np.nan
        found = vlmb.inverse(ARM, {"time": run.t, "psi1": seen})
        off = np.interp(run.t, found.t, found.controls["M_psi1"]) - wanted
        shares.append(rms(off[30:-30]) / rms(wanted))
    assert np.median(shares) < 0.15 and max(shares) < 0.25


def test_exact_samples_give_the_force_beyond_the_scenes_own() -> None:
    run = vlmb.simulate(DRIVEN, rtol=1e-12)
    found = vlmb.inverse(ARM, run.to_pandas(), smooth="none")
    assert isinstance(found, Trajectory) and found.status == "finished" and len(found) == len(run)
    np.testing.assert_allclose(found.controls["M_psi1"][20:-20], 6.0 * np.sin(4.0 * run.t)[20:-20], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found["psi1"], run["psi1"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["energy"][5:-5], run["energy"][5:-5], rtol=0, atol=1e-3)
    assert np.abs(found["balance"])[:-5].max() < 1e-4  # the scene's damper, which is a law here, and the force found
    np.testing.assert_allclose(found.work_by_force["M_psi1"][:-5], run.work_by_force["M_psi1"][:-5], rtol=0, atol=1e-3)
    assert "psi1: 401 samples" in found.adjustments[0] and "inverse dynamics" in found.summary()


def test_links_in_space_with_springs_and_a_given_length() -> None:
    scene: dict[str, Any] = {
        "base": {"kind": "pivot"},
        "start": {"phi1": 0.1, "psi1": -0.3, "phi2": 0.4, "psi2": 0.1, "phi1_dot": 2.0, "phi2_dot": 2.0},
        "links": [
            {"name": "a", "rod": {"length": 0.6, "mass": 2.0}, "lower": {"motion": "prescribed", "law": "0.2 + 0.02*sin(5*t)"}},
            {"name": "b", "rod": {"length": 0.6, "mass": 1.0}, "lower": {"length": 0.2, "stiffness": 900.0, "damping": 5.0}},
        ],
        "forces": [{"between": ["a", "b"], "stiffness": 30.0, "damping": 1.0}],
        "run": {"duration": 0.8, "samples": 600.0, "rtol": 1e-12, "atol": 1e-13},
    }  # fmt: skip
    driven = {**scene, "forces": [*scene["forces"], {"on": "M_psi2", "law": "3*sin(3*t)"}, {"on": "F2_1", "law": "20*t"}]}
    run = vlmb.simulate(driven)
    assert np.abs(np.cos(run["psi1"])).min() > 0.3 and np.abs(np.cos(run["psi2"])).min() > 0.3
    free = ("phi1", "psi1", "phi2", "psi2", "xi2_1")
    found = vlmb.inverse(scene, {"time": run.t, **{name: run[name] for name in free}}, "none")
    assert set(found.input_names) == {"M_phi1", "M_psi1", "M_phi2", "M_psi2", "F2_1"}
    within = slice(20, -20)
    for name in found.input_names:
        wanted = {"M_psi2": 3.0 * np.sin(3.0 * run.t), "F2_1": 20.0 * run.t}.get(name, np.zeros(len(run.t)))
        np.testing.assert_allclose(found.controls[name][within], wanted[within], rtol=0, atol=1e-3)
    np.testing.assert_allclose(found.controls["F1_1"][within], run.controls["F1_1"][within], rtol=0, atol=1e-3)
    assert np.abs(found["balance"] - found["balance"][20])[within].max() < 1e-5


def test_a_skier_needs_nothing_but_what_pushed_it() -> None:
    scene = vlmb.load_scene("models/skier_one_link.toml")
    run = vlmb.simulate(scene, duration=0.5, t_eval=np.linspace(0.0, 0.5, 101), rtol=1e-11)
    found = vlmb.inverse(scene, run.to_pandas(), smooth="none")
    for name in found.input_names:
        assert np.abs(found.controls[name][10:-10]).max() < 2e-3
    for name in ("knife_edge", "normal"):
        np.testing.assert_allclose(found.reactions[name][10:-10], run.reactions[name][10:-10], rtol=1e-5)


def test_data_of_the_scene_and_aliases(tmp_path: Path) -> None:
    run = vlmb.simulate("models/recorded_pumping.toml", duration=4.0, rtol=1e-11)
    found = vlmb.inverse(run.scene, {"t": run.t, "rope.azimuth": run["phi1"], "rope.elevation": run["psi1"]}, {"sigma": 1e-9})
    np.testing.assert_allclose(found.controls["M_psi1"][20:-20], 0.0, atol=3.0)  # of 1300 N m that gravity has
    np.testing.assert_allclose(found.controls["F1_1"][20:-20], run.controls["F1_1"][20:-20], rtol=0.02)
    again = vlmb.load_trajectory(found.save(tmp_path / "inverse.npz"))
    np.testing.assert_array_equal(again.controls["M_psi1"], found.controls["M_psi1"])


def test_azimuths_may_jump_by_full_turns() -> None:
    scene = {**ARM, "plane": False, "start": {"psi1": -0.5, "phi1_dot": 4.0}, "forces": []}
    run = vlmb.simulate(scene)
    wrapped = (run["phi1"] + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs(np.diff(wrapped)).max() > 3.0
    found = vlmb.inverse(scene, {"time": run.t, "phi1": wrapped, "psi1": run["psi1"]}, "none")
    np.testing.assert_allclose(found["phi1"], run["phi1"], rtol=0, atol=1e-9)
    assert np.abs(found.controls["M_phi1"][20:-20]).max() < 1e-3


SAMPLES: dict[str, Any] = {"time": np.arange(20) / 20.0, "psi1": np.zeros(20)}


@pytest.mark.parametrize("data, words", [
    ({"time": SAMPLES["time"]}, "lacks psi1"), ({"psi1": SAMPLES["psi1"]}, "needs `time`"), (7, "must be a DataFrame"),
    ({**SAMPLES, "arm.elevation": SAMPLES["psi1"]}, "given already"),
    ({**SAMPLES, "psi1": np.zeros(19)}, "19 values at 20 times"),
    ({**SAMPLES, "time": SAMPLES["time"][::-1]}, "times must ascend"), ({**SAMPLES, "psi1": ["x"] * 20}, "list of numbers"),
    ({**SAMPLES, "time": SAMPLES["time"] * [*[1.0] * 10, *[2.0] * 10]}, "longer than gap"),
    ({name: values[:5] for name, values in SAMPLES.items()}, "needs 6 at least"),
])  # fmt: skip
def test_wrong_data_are_named(data: Any, words: str) -> None:
    with pytest.raises(vlmb.SceneError, match=words):
        vlmb.inverse(ARM, data)


def test_what_has_no_inverse_is_named() -> None:
    with pytest.raises(vlmb.SceneError, match="forces of constraints cannot be told"):
        vlmb.inverse({**ARM, "constraints": ["psi1 = 0.1*sin(t)"]}, SAMPLES)
    programme = {"constraints": ["psi1 = 0"], "controls": ["M_psi1"], "frequency": 5.0}
    with pytest.raises(vlmb.SceneError, match="a programme makes a motion of its own"):
        vlmb.inverse({**ARM, "programme": programme}, SAMPLES)
    with pytest.raises(vlmb.SceneError, match="smooth = 'more'"):
        vlmb.inverse(ARM, SAMPLES, "more")
