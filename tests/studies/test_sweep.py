"""Many runs: equal to single ones bit for bit, resumed, refused, and failures as rows."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.cli import main
from vlmb.errors import SceneError, StudyError, TrajectoryError
from vlmb.scene.keys import changed_data
from vlmb.scene.renumbered import differ_in_numbers, renumbered
from vlmb.studies.ensemble import Ensemble, Task
from vlmb.studies.reductions import kept_of, reduced

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"
STIFFNESS = "links.arm.lower.stiffness"


@pytest.fixture(scope="module")
def scene() -> vlmb.Scene:
    return vlmb.load_scene(MODELS / "one_link.toml").changed(run={"duration": 0.5})


def lean(trajectory: vlmb.Trajectory) -> float:
    return float(trajectory["psi1"].mean())


def test_a_grid_has_its_keys_as_dimensions_and_is_the_single_runs(scene: vlmb.Scene) -> None:
    vary = {STIFFNESS: [250.0, 300.0], "start.psi1": [-0.5, -0.4, -0.3], "links.arm.rod.mass": [2.0, 2.5]}
    table = vlmb.sweep(scene, vary, {"last": "psi1:last", "most": "energy:max", "lean": lean}, ["xi1_1"], workers=1)
    assert dict(table.sizes) == {STIFFNESS: 2, "start.psi1": 3, "links.arm.rod.mass": 2, "t": 201}
    for place in ({STIFFNESS: 250.0, "start.psi1": -0.4, "links.arm.rod.mass": 2.5}, {STIFFNESS: 300.0, "start.psi1": -0.3,
                                                                                   "links.arm.rod.mass": 2.0}):  # fmt: skip
        alone, found = vlmb.simulate(scene.changed_at(place)), table.sel(place)
        assert float(found["last"]) == alone["psi1"][-1]
        assert float(found["most"]) == alone["energy"].max()
        assert float(found["lean"]) == lean(alone)
        np.testing.assert_array_equal(found["xi1_1"].values, alone["xi1_1"])
        np.testing.assert_array_equal(found["t"].values, alone.t)
        assert str(found["status"].values) == alone.status and str(found["message"].values) == alone.message
    assert table["last"].attrs["units"] == "rad" and table["most"].attrs["units"] == "J"


@pytest.mark.parametrize("model", sorted(path.stem for path in MODELS.glob("*.toml")))
def test_runs_that_share_a_system_are_the_single_runs(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = vlmb.load_scene(MODELS / f"{model}.toml")
    scene = scene.changed(run={"duration": min(0.2, scene.run.duration), "engine": "auto"})
    changes: dict[str, Any] = {f"start.{name}": value + 1e-3 for name, value in list(scene.start.items())[:1]}
    for link in scene.links:
        for side in ("lower", "upper"):
            segment = getattr(link, side)
            if segment.motion == "free" and segment.stiffness > 0.0:
                changes[f"links.{link.name}.{side}.stiffness"] = 1.01 * segment.stiffness
                changes[f"links.{link.name}.{side}.rest"] = segment.rest_length + 1e-3
    if not changes:
        pytest.skip("nothing that runs could share")
    ensemble = Ensemble(Task(scene, tuple(changes), (), (), ""))
    assert ensemble.system is not None and renumbered(scene, changes) is not None
    shared, changed = ensemble.trajectory(changes), scene.changed_at(changes)
    assert differ_in_numbers(scene, changed) and changed == vlmb.Scene.from_dict(changed_data(scene, changes))
    monkeypatch.setattr("vlmb.system.system._made", ())
    alone = vlmb.simulate(changed)
    assert shared.scene == alone.scene and shared.message == alone.message and shared.adjustments == alone.adjustments
    np.testing.assert_array_equal(shared.states, alone.states)
    for name in (*alone.mechanism.coordinate_names, "balance", "spring"):
        np.testing.assert_array_equal(shared[name], alone[name])
    for name in alone.reactions:
        np.testing.assert_array_equal(shared.reactions[name], alone.reactions[name])


def test_histories_through_impacts_stand_at_their_times() -> None:
    ball = vlmb.load_scene(MODELS / "bouncing_ball.toml").changed(run={"duration": 1.0, "samples": 10.0})
    found = vlmb.sweep(ball, {"start.z": [0.9, 1.0]}, histories=["z"], workers=1).sel({"start.z": 1.0})
    t, landed = found["t"].values, np.sqrt(2.0 / 9.81)
    up = 0.8 * np.sqrt(2.0 * 9.81) * (t - landed) - 4.905 * (t - landed) ** 2
    np.testing.assert_allclose(found["z"].values, np.where(t < landed, 1.0 - 4.905 * t * t, up), atol=1e-8)


def test_threads_processes_and_one_thread_give_the_same(scene: vlmb.Scene) -> None:
    table = vlmb.sample("latin", {STIFFNESS: (250.0, 350.0), "start.phi1_dot": (2.0, 3.0)}, runs=24, seed=3)
    keep = {"last": "psi1:last", "rms": "xi1_1:rms", "lean": lean}
    serial = vlmb.sweep(scene, table, keep, ["phi1"], workers=1)
    with ProcessPoolExecutor(2) as pool:
        others = [vlmb.sweep(scene, table, keep, ["phi1"], workers=3), vlmb.sweep(scene, table, keep, ["phi1"], executor=pool)]
    for other in others:
        assert other.attrs["digest"] == serial.attrs["digest"] and other.identical(serial)
    assert serial["run"].size == 24 and serial[STIFFNESS].dims == ("run",)


def test_dask_gives_the_same(scene: vlmb.Scene) -> None:
    distributed = pytest.importorskip("distributed")
    table = {"start.psi1": [-0.5, -0.4, -0.3]}
    with distributed.Client(n_workers=1, processes=False, dashboard_address=":0") as client:
        found = vlmb.sweep(scene, table, ["psi1:last"], executor=client)
    assert found.identical(vlmb.sweep(scene, table, ["psi1:last"], workers=1))


def test_failures_and_stops_are_rows() -> None:
    scene = vlmb.load_scene(MODELS / "skier_one_link.toml").changed(run={"duration": 1.0})
    link = scene.links[0].name
    limits = scene.links[0].lower.limits
    assert limits is not None
    vary = {"start.psi1": [0.2, -1.0], "start.xi1_1": [limits[1] + 1.0, 0.5 * sum(limits)]}
    table = vlmb.sweep(scene, vary, ["psi1:last"], ["psi1"])
    status = dict(zip([(i, j) for i in range(2) for j in range(2)], table["status"].values.ravel().tolist(), strict=True))
    assert status[0, 0] == "failed" and "outside its limits" in str(table["message"].values[0, 0]) and link
    assert np.isnan(table["psi1:last"].values[0, 0]) and np.isnan(table["psi1"].values[0, 0]).all()
    assert status[1, 1] == "failed" and "under the snow" in str(table["message"].values[1, 1])
    alone = vlmb.simulate(scene.changed_at({"start.psi1": 0.2, "start.xi1_1": 0.5 * sum(limits)}))
    assert status[0, 1] == alone.status and float(table["psi1:last"].values[0, 1]) == alone["psi1"][-1]
    known = np.isfinite(table["psi1"].values[0, 1])
    assert known.sum() == (table["t"].values <= alone.t[-1]).sum()


def test_a_study_goes_on_where_it_was_and_refuses_another(scene: vlmb.Scene, tmp_path: Path) -> None:
    folder, vary, keep = tmp_path / "sweep", {"start.psi1": np.linspace(-0.5, -0.2, 7)}, ["psi1:last", "xi1_1:max"]
    first = vlmb.sweep(scene, vary, keep, output=folder, workers=1)
    shards = sorted(folder.glob("shard-*.npz"))
    assert len(shards) == 7 and (folder / "table.nc").exists()
    shards[2].unlink()
    shards[4].write_bytes(shards[4].read_bytes()[:100])  # torn
    before = {path: path.stat().st_mtime_ns for path in shards if path not in (shards[2], shards[4])}
    told: list[tuple[int, int]] = []
    again = vlmb.sweep(scene, vary, keep, output=folder, resume=True, progress=lambda done, all_: told.append((done, all_)))
    assert told == [(6, 7), (7, 7)] and again.identical(first)
    assert before == {path: path.stat().st_mtime_ns for path in before}
    with pytest.raises(StudyError, match="has a study already"):
        vlmb.sweep(scene, vary, keep, output=folder)
    with pytest.raises(StudyError, match="another scene and another reductions"):
        vlmb.sweep(scene.changed(gravity=9.8), vary, keep[:1], output=folder, resume=True)
    note = json.loads((folder / "study.json").read_text())
    assert note["study"]["scene"]["name"] == scene.name and note["runs"] == 7 and note["versions"]["vlmb"] == vlmb.__version__
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(folder / "table.nc", engine="scipy") as stored:
        np.testing.assert_array_equal(stored["psi1:last"].values, first["psi1:last"].values)
        assert [str(text) for text in stored["status"].values.tolist()] == first["status"].values.tolist()


def test_the_command_writes_goes_on_and_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, folder = tmp_path / "one.toml", tmp_path / "out"
    model.write_text((MODELS / "one_link.toml").read_text().replace("duration = 10.0", "duration = 0.2"))
    command = ["sweep", str(model), "--vary", "start.psi1=-0.5:-0.3:3", "--vary", f"{STIFFNESS}=250,300", "--keep", "psi1:last"]
    command += ["energy:max", "--output", str(folder), "--quiet"]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert "6 runs: 6 finished" in said and str(folder / "table.nc") in said
    assert main(command) == 1 and "--resume" in capsys.readouterr().err
    assert main([*command, "--resume", "--workers", "1"]) == 0
    sampled = ["sweep", str(model), "--vary", "start.psi1=-0.5:-0.3", "--sample", "sobol", "--runs", "4", "--keep", "psi1:last"]
    assert main([*sampled, "--output", str(tmp_path / "other"), "--quiet"]) == 0 and "4 runs" in capsys.readouterr().out
    assert main(["sweep", str(model), "--vary", "start.psi1", "--quiet"]) == 1
    assert "KEY=LOW:HIGH:COUNT" in capsys.readouterr().err


def test_the_command_for_steady_motions(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["steady", str(MODELS / "spring_pendulum_cone.toml"), "--hold", "psi1=-1.1"]) == 0
    said = capsys.readouterr().out
    assert "neutral" in said and "phi1_dot                 4.09932" in said and said.count("eigenvalue") == 5
    assert main(["steady", str(MODELS / "skier_one_link.toml"), "--speed", "7", "--radius", "15"]) == 1
    assert "depends on time" in capsys.readouterr().err


CLIENT = """
import sys, vlmb, numpy as np
scene = vlmb.load_scene(sys.argv[1]).changed(run={"duration": 3.0})
vlmb.sweep(scene, {"start.psi1": np.linspace(-0.5, -0.2, 300)}, ["psi1:last"], output=sys.argv[2], resume=True)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
def test_a_killed_study_ends_with_the_same_digest(tmp_path: Path) -> None:
    model = MODELS / "one_link.toml"
    scene = vlmb.load_scene(model).changed(run={"duration": 3.0})
    vary = {"start.psi1": np.linspace(-0.5, -0.2, 300)}
    whole = vlmb.sweep(scene, vary, ["psi1:last"])
    counts = []
    for _ in range(3):
        command = [sys.executable, "-c", CLIENT, str(model), str(tmp_path / "s")]
        process = subprocess.Popen(command, cwd=ROOT, env=os.environ.copy())
        start = len(list(tmp_path.glob("s/shard-*.npz")))
        until = time.monotonic() + 60.0
        while len(list(tmp_path.glob("s/shard-*.npz"))) < start + 3 and process.poll() is None and time.monotonic() < until:
            time.sleep(0.002)
        process.kill()
        process.wait()
        counts.append(len(list(tmp_path.glob("s/shard-*.npz"))))
    assert counts == sorted(counts) and counts[0] >= 3  # nothing that was done is done again
    assert vlmb.sweep(scene, vary, ["psi1:last"], output=tmp_path / "s", resume=True).attrs["digest"] == whole.attrs["digest"]


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
def test_a_killed_worker_costs_no_shard_that_was_done(scene: vlmb.Scene, tmp_path: Path) -> None:
    vary, folder = {"start.psi1": np.linspace(-0.5, -0.2, 200)}, tmp_path / "s"
    with ProcessPoolExecutor(1) as pool:

        def kill(done: int, total: int) -> None:
            if done >= 20:
                for worker in list(pool._processes):
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(worker, signal.SIGKILL)

        with pytest.raises(StudyError, match="resume = True goes on"):
            vlmb.sweep(scene, vary, ["psi1:last"], output=folder, executor=pool, progress=kill)
    there = len(list(folder.glob("shard-*.npz")))
    assert there >= 10
    found = vlmb.sweep(scene, vary, ["psi1:last"], output=folder, resume=True)
    assert found.attrs["digest"] == vlmb.sweep(scene, vary, ["psi1:last"]).attrs["digest"]


def test_reductions() -> None:
    t, values = np.array([0.0, 1.0, 3.0]), np.array([2.0, -4.0, 0.0])
    found = {name: reduced(name, t, values) for name in ("last", "first", "min", "max", "absmax", "mean", "rms")}
    assert found["last"] == 0.0 and found["first"] == 2.0 and found["min"] == -4.0 and found["max"] == 2.0
    assert found["absmax"] == 4.0 and found["mean"] == pytest.approx((-1.0 - 4.0) / 3.0)
    assert found["rms"] == pytest.approx(np.sqrt((10.0 + 16.0) / 3.0))
    assert [entry.quantity for entry in kept_of(["residual:course:absmax", "psi1:last"])] == ["residual:course", "psi1"]


@pytest.mark.parametrize(
    ("vary", "keep", "message"),
    [
        ({"links.arm.lower.stifness": [1.0]}, ["psi1:last"], "did you mean 'stiffness'"),
        ({"start.psi1": 1.0}, ["psi1:last"], "must be a list of values"),
        ({"start.psi1": []}, ["psi1:last"], "an empty list"),
        ({}, ["psi1:last"], "names no key"),
        ({"start.psi1": [1.0]}, ["psi1"], "say how it is reduced"),
        ({"start.psi1": [1.0]}, ["psi1:lst"], "allowed: last, first, min"),
        ({"start.psi1": [1.0]}, ["psi7:last"], "no 'psi7'"),
        ({"start.psi1": [1.0]}, "psi1:last", "must be a dict of names"),
    ],
)
def test_what_is_wrong_is_said_before_any_run(scene: vlmb.Scene, vary: Any, keep: Any, message: str) -> None:
    with pytest.raises((SceneError, TrajectoryError), match=message):
        vlmb.sweep(scene, vary, keep)


def test_samples_are_even_and_the_same_for_a_seed() -> None:
    ranges = {"start.speed": (6.0, 8.0), "links.legs.lower.stiffness": (8e3, 1.2e4)}
    for method in ("sobol", "latin", "halton", "uniform"):
        frame = vlmb.sample(method, ranges, runs=64, seed=5)
        assert list(frame.columns) == list(ranges) and len(frame) == 64
        assert frame.equals(vlmb.sample(method, ranges, runs=64, seed=5))
        assert not frame.equals(vlmb.sample(method, ranges, runs=64))
        assert ((frame["start.speed"] >= 6.0) & (frame["start.speed"] < 8.0)).all()
    quarters = np.histogram(vlmb.sample("sobol", ranges, runs=64, seed=1)["start.speed"], 4, (6.0, 8.0))[0]
    assert quarters.tolist() == [16, 16, 16, 16]
    with pytest.raises(SceneError, match="did you mean 'sobol'"):
        vlmb.sample("sobel", ranges, runs=4)
    with pytest.raises(SceneError, match="the first below the second"):
        vlmb.sample("latin", {"start.speed": (8.0, 6.0)}, runs=4)
