"""Figures of programmes: deviations, joint moments beside published strengths, orders; and runs without stabilization."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.views.scenes import MODELS
from vlmb.scene.rows import rows_of
from vlmb.views.biomechanics import STRENGTHS, both_legs, joint_moments, knee_distance

pytest.importorskip("matplotlib")

from vlmb.views.plots import PLOTS
from vlmb.views.programme_plots import MOST, convergence

Array = np.ndarray[Any, np.dtype[np.float64]]


def paper(**changes: Any) -> vlmb.Scene:
    data = vlmb.load_scene(MODELS / "skier_paper_balanced.toml").to_dict()
    data["programme"] |= changes.pop("programme", {})
    for key in changes.pop("without", ()):
        del data["programme"][key]
    return vlmb.Scene.from_dict({**data, **changes})


# ---- figures


def test_deviations_are_drawn_as_computed_and_compared(slalom: vlmb.Trajectory) -> None:
    other = vlmb.simulate(MODELS / "skier_slalom.toml", duration=1.0, method="rk4", step=0.01)
    axes = np.array(PLOTS["deviations"]([slalom, other]).axes).reshape(-1, 2)
    texts = [row.name for row in rows_of(slalom.scene).servo]
    assert len(axes) == len(texts)
    for (plain, log), text in zip(axes, texts, strict=True):
        assert log.get_yscale() == "log" and plain.get_yscale() == "linear"
        for run, line, size in zip((slalom, other), plain.lines, log.lines, strict=False):
            error = run.residuals[text].position
            assert error is not None
            np.testing.assert_array_equal(line.get_ydata(), error)
            np.testing.assert_array_equal(size.get_ydata(), np.maximum(np.abs(error), 1e-18))


def test_a_scene_without_a_programme_has_no_deviations() -> None:
    run = vlmb.simulate(MODELS / "one_link.toml", duration=0.1)
    assert not PLOTS["deviations"](run).axes and not PLOTS["strengths"](run).axes


def test_of_many_controls_the_largest_are_drawn(whole: vlmb.Trajectory) -> None:
    figure = PLOTS["power"](whole)
    programme, work, drag, _ = figure.axes
    assert len(programme.lines) == len(work.lines) == MOST and len(drag.lines) == 1
    names = list(whole.scene.programme.controls)  # type: ignore[union-attr]
    peaks = sorted((np.abs(whole.power(name)).max() for name in names), reverse=True)
    drawn = sorted((np.abs(line.get_ydata()).max() for line in programme.lines), reverse=True)
    np.testing.assert_array_equal(drawn, peaks[:MOST])


def test_strengths_are_drawn_beside_the_moments(whole: vlmb.Trajectory) -> None:
    figure = PLOTS["strengths"](whole)
    assert [ax.get_ylabel() for ax in figure.axes] == ["ankle [N m]", "knee [N m]", "hip [N m]"]
    for ax, (joint, (forwards, _)) in zip(figure.axes, joint_moments(whole).items(), strict=True):
        lines = {line.get_label(): line for line in ax.lines}
        np.testing.assert_array_equal(lines["moment"].get_ydata(), forwards)
        for strength in STRENGTHS[joint]:
            assert lines[strength.way].get_ydata()[0] == both_legs(strength)[0]


def test_convergence_fits_the_slope() -> None:
    steps = (0.1, 0.05, 0.025)
    figure = convergence({"third order": (steps, [7.0 * h**3 for h in steps])}, "errors", "error")
    assert [line.get_label() for line in figure.axes[0].lines if line.get_label()[0] != "_"] == ["third order: slope 3.00"]


# ---- joint moments


def test_strengths_are_those_of_a_young_man() -> None:
    """Table 3 of Anderson et al.: knee extension 0.163 of weight times height, 203 N m for 73 kg and 1.741 m, one leg."""
    extension, flexion = STRENGTHS["knee"]
    assert both_legs(extension)[0] == pytest.approx(2 * 0.163 * 73.0 * 9.81 * 1.741)
    assert both_legs(flexion)[0] < 0.0 < both_legs(flexion)[1]
    for ways in STRENGTHS.values():
        assert {strength.sign for strength in ways} == {-1.0, 1.0}


def test_knee_distance_is_that_of_a_triangle() -> None:
    """Law of cosines at the hip: the knee is thigh * sin(angle) off the line."""
    length = np.array([0.3, 0.6, 0.8])
    angle = np.arccos((0.4222**2 + length**2 - 0.4403**2) / (2 * 0.4222 * length))
    np.testing.assert_allclose(knee_distance(length), 0.4222 * np.sin(angle), rtol=1e-12)
    assert knee_distance(np.array([0.8625, 0.9])) == pytest.approx(0.0, abs=1e-6)


def test_the_torque_of_the_boots_is_that_of_the_controls(slalom: vlmb.Trajectory) -> None:
    """M_phi and M_psi make N = (M_phi/cos psi) u_psi - M_psi u_phi."""
    phi, psi = slalom["phi1"], slalom["psi1"]
    u_psi = np.stack([-np.cos(phi) * np.sin(psi), -np.sin(phi) * np.sin(psi), np.cos(psi)], axis=1)
    u_phi = np.stack([-np.sin(phi), np.cos(phi), np.zeros(len(phi))], axis=1)
    along = slalom.controls["M_phi1"] / np.cos(psi)
    torque = along[:, None] * u_psi - slalom.controls["M_psi1"][:, None] * u_phi
    np.testing.assert_allclose(slalom.hinge_torque("legs"), torque, atol=1e-7 * np.abs(torque).max())
    with pytest.raises(vlmb.TrajectoryError, match="did you mean 'legs'"):
        slalom.hinge_torque("leg")


def test_joints_in_a_row_carry_what_is_above_them(whole: vlmb.Trajectory) -> None:
    """Forwards means about the ski's left: the sum of the torques on the links above a joint, the trunk's for the hip."""
    heading = whole["phi0"]
    left = np.stack([-np.sin(heading), np.cos(heading), np.zeros(len(heading))], axis=1)
    total = np.zeros((len(whole), 3))
    for i in (6, 5, 4, 3):
        phi, psi = whole[f"phi{i}"], whole[f"psi{i}"]
        u_psi = np.stack([-np.cos(phi) * np.sin(psi), -np.sin(phi) * np.sin(psi), np.cos(psi)], axis=1)
        u_phi = np.stack([-np.sin(phi), np.cos(phi), np.zeros(len(phi))], axis=1)
        total += (whole.controls[f"M_phi{i}"] / np.cos(psi))[:, None] * u_psi - whole.controls[f"M_psi{i}"][:, None] * u_phi
    forwards, _ = joint_moments(whole)["hip"]
    np.testing.assert_allclose(forwards, (total * left).sum(axis=1), atol=1e-6 * np.abs(forwards).max())


# ---- the paper's figures 7 and 8


@pytest.mark.slow
def test_the_papers_figures_are_reproduced(tmp_path: Path) -> None:
    """O(step) for the first-order scheme, with stabilization and without, O(step^4) for RK4; the paper's set tips over."""
    words = [sys.executable, str(MODELS.parent / "scripts" / "_figures.py"), str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    slopes = dict(re.findall(r"^  (\(\d\.\d\) [\w ]+): .*slope ([\d.]+)$", done.stdout, re.M))
    assert len(slopes) == 6, done.stdout
    for name, slope in slopes.items():
        assert float(slope) == pytest.approx(4.0 if "RK4" in name else 1.0, rel=0.1), name
    times = [float(time) for time in re.findall(r"10 deg after ([\d.]+) s", done.stdout)]
    assert times == [pytest.approx(0.47, abs=0.02), pytest.approx(1.35, abs=0.05)]
    pictures = {path.stem for path in tmp_path.glob("*.png")}
    assert pictures >= {"figures_7_and_8", "stabilization", "methods", "tipping_over", "floor_7_5", "floor_8_2"}
    assert pictures >= {f"figure_{number}" for number in range(1, 7)}


def test_the_papers_mechanisms_have_as_many_coordinates_as_it_counts(tmp_path: Path) -> None:
    """3, 7 and 4n - 1 of pivoted chains; 7, 11 and 4n + 3 on a ski."""
    schemes = runpy.run_path(str(MODELS.parent / "scripts" / "_schemes.py"))
    counts = []
    for scheme in schemes["SCHEMES"]:
        path = schemes["draw"](scheme, tmp_path)
        scene = vlmb.Scene.from_dict({"base": scheme.base, "links": scheme.links})
        counts.append((path.stem, len(scheme.links), len(vlmb.build(scene).coordinate_names)))
        assert path.stat().st_size > 5000
    assert counts == [("figure_1", 1, 3), ("figure_2", 2, 7), ("figure_3", 4, 15), ("figure_4", 1, 7), ("figure_5", 2, 11),
                      ("figure_6", 5, 23)]  # fmt: skip


# ---- with and without stabilization


def test_without_gains_errors_stay() -> None:
    """z'' = 0: an error at the start goes on as z + z' t, where gains make it decay."""
    start = {"speed": 3.0, "phi0": 0.5, "phi0_dot": 0.1, "psi1": 1.37}
    run = vlmb.simulate(paper(programme={"gains": "none"}, without=["frequency"], start=start), 1.0, "adams")
    z, rate = run.residuals["tan(phi0) = A*k*cos(k*x)"]
    assert z is not None and abs(z[0]) > 0.01 and abs(rate[0]) > 0.01
    np.testing.assert_allclose(z, z[0] + rate[0] * run.t, atol=1e-7)
    np.testing.assert_allclose(rate, rate[0], atol=1e-6)
    assert "no stabilization" in run.summary()
    held = vlmb.simulate(paper(start=start), 1.0, "adams").residuals["tan(phi0) = A*k*cos(k*x)"].position
    assert held is not None and abs(held[-1]) < 1e-2 * abs(z[-1])


@pytest.mark.parametrize(
    "programme, without, words",
    [
        ({"gains": "none"}, (), "gains = 'none' and frequency exclude each other"),
        ({"gains": "auto"}, (), "gains = 'auto' and frequency exclude each other"),
        ({}, ("frequency",), 'or gains = "none"'),
        ({"gains": "non"}, ("frequency",), "programme.gains = 'non': allowed: auto, none"),
        ({"h": [[0.0, 0.0], [0.0, 0.0]], "k": [[0.0, 0.0], [0.0, 0.0]]}, ("frequency",), "gains = 'none'"),
    ],
)
def test_gains_that_are_not_clear_are_refused(programme: dict[str, Any], without: tuple[str, ...], words: str) -> None:
    with pytest.raises(vlmb.SceneError) as error:
        vlmb.simulate(paper(programme=programme, without=without))
    assert words in str(error.value)


def test_the_condition_of_the_programme() -> None:
    """G of two lengths that do not touch each other is diagonal: 1/m of each branch times the scale of its control."""
    branch = {"parent": "base", "lower": {"length": 0.5}, "rod": {"length": 0.0, "mass": 0.0}}
    scene: dict[str, Any] = {
        "base": {"kind": "pivot"}, "links": [{**branch, "tip_mass": 1.0}, {**branch, "tip_mass": 4.0}],
        "programme": {"constraints": ["xi1_1 = 0.5", "xi2_1 = 0.5"], "controls": ["F1_1", "F2_1"], "frequency": 5.0},
        "start": {"psi1": -1.5, "psi2": -1.5}, "run": {"duration": 0.1},
    }  # fmt: skip
    np.testing.assert_allclose(vlmb.simulate(vlmb.Scene.from_dict(scene)).conditions, 4.0, rtol=1e-9)
    scene["programme"]["weights"] = {"F1_1": 1.0, "F2_1": 1.0 / 16.0}
    np.testing.assert_allclose(vlmb.simulate(vlmb.Scene.from_dict(scene)).conditions, 1.0, rtol=1e-9)
    assert not vlmb.simulate(MODELS / "one_link.toml", duration=0.1).conditions.size
