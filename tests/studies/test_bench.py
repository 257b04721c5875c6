"""The command `vlmb bench`, and what it rests on: errors, costs at an error, references."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.reference.exact import skate as exact_skate
from vlmb import cli
from vlmb.errors import SceneError
from vlmb.simulation.methods import METHODS
from vlmb.studies.work_precision import GAINS, Motion, compare, cost_at, front, measure, observe, variants

SKATE: dict[str, Any] = {
    "name": "skate", "slope": 0.3, "base": {"kind": "ski", "mass": 75.0, "inertia": 1.2}, "start": {"phi0_dot": 1.5},
    "run": {"duration": 1.0},
}  # fmt: skip
LINK = {"rod": {"length": 0.5, "mass": 2.0}, "lower": {"length": 0.25, "stiffness": 300.0}}
PENDULUM: dict[str, Any] = {"base": {"kind": "pivot"}, "links": [LINK], "start": {"psi1": -0.5, "phi1_dot": 2.5}}


def motion(points: Any, directions: Any, forces: Any) -> Motion:
    return Motion(*(np.array(part, dtype=float) for part in (points, directions, forces)))


def test_errors_are_distances_angles_and_forces_at_the_end_and_at_their_largest() -> None:
    still = [[[1.0, 0.0, 0.0]]] * 3
    true = motion(np.zeros((3, 1, 3)), still, np.zeros((3, 1, 3)))
    turned = [[[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]], [[math.cos(1e-9), math.sin(1e-9), 0.0]]]
    off = motion([[[0, 0, 0]], [[3, 4, 0]], [[0, 0, 1]]], turned, [[[0, 0, 0]], [[0, 0, 0]], [[2, 0, 0]]])
    errors = compare(off, true)
    assert errors["position"] == pytest.approx((1.0, 5.0))
    assert errors["angle"] == pytest.approx((1e-9, math.pi / 2))
    assert errors["reaction"] == (2.0, 2.0)


def test_cost_at_an_error_lies_on_the_log_log_line_of_the_front() -> None:
    runs = [(1.0, 1e-2), (100.0, 1e-6), (50.0, 1e-1), (10.0, math.inf)]  # one dearer and worse, one failed
    assert front(runs) == [(1.0, 1e-2), (100.0, 1e-6)]
    assert cost_at(runs, 1e-4) == pytest.approx(10.0)
    assert cost_at(runs, 1.0) == 1.0
    assert cost_at(runs, 1e-6) == pytest.approx(100.0)
    assert math.isnan(cost_at(runs, 1e-7)) and math.isnan(cost_at([], 1.0))


def test_every_method_and_every_form_of_the_knife_edge_takes_part() -> None:
    on_ski = variants(vlmb.Scene.from_dict(SKATE))
    assert len(on_ski) == len(set(on_ski)) == len(METHODS) * (2 + len(GAINS))
    assert {v.method for v in variants(vlmb.Scene.from_dict(PENDULUM))} == set(METHODS)
    assert {v.knife_edge for v in on_ski} == {"reduction", "multiplier", "projection"}


def test_errors_against_an_exact_motion_fall_with_the_tolerance() -> None:
    times: list[Any] = []

    def exact(t: Any) -> Motion:
        times.append(t)
        known = exact_skate(t, mass=75.0, slope=0.3, yaw_rate=1.5)
        zero = np.zeros(len(t))
        heading = np.column_stack([np.cos(1.5 * t), np.sin(1.5 * t), zero])
        snow = np.column_stack([zero, known["knife_edge"], zero + 75.0 * 9.81 * math.cos(0.3)])
        return Motion(np.column_stack([known["x"], known["y"], zero])[:, None], heading[:, None], snow[:, None])

    found, _ = measure(vlmb.Scene.from_dict(SKATE), methods=["adams"], exact=exact, repeats=1, samples=11)
    assert len(times[0]) == 11 and found.reference == "exact solution"
    reduced = [entry for entry in found.entries if entry.variant.knife_edge == "reduction"]
    assert reduced[0].errors["position"][1] > 1e-6 > 1e-10 > reduced[-1].errors["position"][1]
    assert reduced[-1].errors["reaction"][1] < 1e-7
    assert reduced[-1].errors["knife_edge: velocity"][1] < 1e-14
    assert all(entry.evaluations >= entry.steps > 0 and 0.0 < entry.seconds < math.inf for entry in found.entries)


def test_the_reference_says_how_good_it_is_and_a_worse_one_would_show() -> None:
    found, _ = measure(vlmb.Scene.from_dict(PENDULUM), 0.5, ["adams"], repeats=1, samples=6)
    assert 0.0 < found.uncertainty["position"][1] < 1e-10
    assert found.entries[0].position > 100 * found.uncertainty["position"][0]


def test_a_run_that_fails_stays_in_the_table_with_its_sentence() -> None:
    stiff = {**PENDULUM, "links": [{**LINK, "lower": {"length": 0.25, "stiffness": 3e6, "rest": 0.2505}}]}
    found, _ = measure(vlmb.Scene.from_dict(stiff), 0.3, ["rk4"], repeats=1, samples=6, budget=0.1)
    failed = [entry for entry in found.entries if entry.failure]
    assert failed and not failed[0].errors and math.isinf(failed[0].position)
    assert failed[0].failure in vlmb.studies.bench.section(found)


def test_a_scene_that_does_not_reach_its_end_has_no_reference() -> None:
    falling = {"base": {"kind": "ski", "mass": 5.0, "inertia": 0.6}, "links": [LINK], "start": {"psi1": 0.5}}
    with pytest.raises(SceneError, match=r"no reference: stopped .*Choose a duration"):
        measure(vlmb.Scene.from_dict(falling), 5.0, ["adams"], repeats=1)


def test_rivals_are_timed_at_each_of_their_settings() -> None:
    asked: list[float] = []

    def rival(setting: float) -> float:
        asked.append(setting)
        return setting + 1.0 / len(asked)

    _, others = measure(vlmb.Scene.from_dict(PENDULUM), 0.1, ["adams"], rivals={"other": ((1.0, 2.0), rival)}, repeats=2)
    assert asked == [1.0, 2.0, 1.0, 2.0]
    assert others == {"other": {1.0: pytest.approx(1.0 + 1 / 3), 2.0: 2.25}}


def test_points_of_a_flying_and_a_plane_mechanism_are_observed() -> None:
    for base, plane in (("free", False), ("free", True), ("pivot", True)):
        mass = {"mass": 1.0} if base == "free" else {}
        scene = vlmb.Scene.from_dict({**PENDULUM, "base": {"kind": base, **mass}, "plane": plane, "start": {"psi1": 0.2}})
        seen = observe(vlmb.simulate(scene, 0.1, t_eval=[0.0, 0.1]))
        assert seen.points.shape == (2, 1 + (base == "free"), 3) and np.isfinite(seen.forces).all()


def test_the_command_writes_table_numbers_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "swing.toml"
    scene.write_text(
        'name = "swing"\n[base]\nkind = "pivot"\n[[links]]\nrod = {length = 0.5, mass = 2.0}\n'
        "lower = {length = 0.25, stiffness = 300.0}\n[start]\npsi1 = -0.5\n", encoding="utf-8",
    )  # fmt: skip
    out = tmp_path / "out"
    options = ["--duration", "0.2", "--methods", "adams", "rk4", "--repeats", "1", "-o", str(out)]
    assert cli.main(["bench", str(scene), *options]) == 0
    data = json.loads((out / "bench.json").read_text(encoding="utf-8"))
    runs = data["scenes"][0]["runs"]
    assert {run["method"] for run in runs} == {"adams", "rk4"} and str(tmp_path) not in json.dumps(data)
    assert all(set(run["errors"]) == {"position", "angle", "reaction", "energy"} for run in runs)
    text = (out / "bench.md").read_text(encoding="utf-8")
    assert "| adams |" in text and "pin " in text and (out / "bench.png").stat().st_size > 10_000
    assert "swing" in capsys.readouterr().out


def test_bad_options_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bench", str(tmp_path / "none.toml"), "--repeats", "0"]) == 1
    assert "--repeats" in capsys.readouterr().err
