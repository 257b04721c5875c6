"""Files of runs: format 1, with the numbers that the version which wrote it told; format 2, of both engines."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import msgspec
import numpy as np
import pytest

import vlmb
from tests.small_scenes import FLYING, PIVOT, SKI, bent
from vlmb.cli import main

RUNS = Path(__file__).parent / "runs"


def test_a_run_of_format_1_tells_what_it_told() -> None:
    run = vlmb.load_trajectory(RUNS / "format_1.npz")
    told = json.loads((RUNS / "format_1.json").read_text(encoding="utf-8"))
    assert (run.engine, run.status, len(run)) == ("pinocchio", "finished", 11)
    assert run.versions["vlmb"] == "0.1.0" and run.input_names == ("M_psi1",)
    for name, values in told.items():
        found = run.controls[name] if name in run.controls else run.reactions[name] if name in run.reactions else run[name]
        size = max(1.0, np.abs(values).max())
        np.testing.assert_allclose(found, values, rtol=0, atol=1e-10 * size, err_msg=name)
    assert run.q.shape == (11, run.mechanism.model.nq) and run.v.shape == (11, run.mechanism.model.nv)
    assert "a skier of format 1" in run.summary()


def test_a_run_of_format_1_is_replayed_and_written_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = vlmb.load_trajectory(RUNS / "format_1_law.npz")
    assert main(["run", str(RUNS / "format_1_law.npz"), "--no-plots", "--quiet", "-o", str(tmp_path)]) == 0
    assert "finished" in capsys.readouterr().out
    again = vlmb.load_trajectory(tmp_path / "run.npz")
    assert (old.engine, again.engine) == ("pinocchio", "core")
    np.testing.assert_array_equal(again.t, old.t)
    np.testing.assert_allclose(again.position("rod"), old.position("rod"), rtol=0, atol=1e-7)
    second = vlmb.load_trajectory(old.save(tmp_path / "second.npz"))
    for name in ("t", "q", "v", "work"):
        np.testing.assert_array_equal(getattr(second, name), getattr(old, name))
    with np.load(tmp_path / "second.npz") as file:
        assert json.loads(str(file["note"]))["format"] == 2 and "states" in file.files


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("base", [PIVOT, SKI, FLYING], ids=["pivot", "ski", "free"])
def test_runs_of_both_engines_are_stored_and_pickled_whole(base: dict[str, object], engine: str, tmp_path: Path) -> None:
    run = vlmb.simulate(bent(base, 2), duration=0.3, engine=engine)
    loaded, pickled = vlmb.load_trajectory(run.save(tmp_path / "run.npz")), pickle.loads(pickle.dumps(run))  # noqa: S301
    for other in (loaded, pickled):
        assert other.engine == engine and other.stats == run.stats and other.summary() == run.summary()
        for name in ("t", "states", "q", "v", "work", "branch"):
            np.testing.assert_array_equal(getattr(other, name), getattr(run, name), err_msg=name)
        for name in run.names:
            np.testing.assert_array_equal(other[name], run[name], err_msg=name)
    again = vlmb.simulate(msgspec.structs.replace(loaded.scene, run=loaded.run))
    assert again.engine == engine  # options are stored
    np.testing.assert_array_equal(again.states, run.states)


@pytest.mark.parametrize("base", [PIVOT, SKI, FLYING], ids=["pivot", "ski", "free"])
def test_pinocchios_states_of_both_engines_are_of_one_posture(base: dict[str, object]) -> None:
    """q is without roll from the heading where the core ran: the points and their velocities are the same."""
    core, other = (vlmb.simulate(bent(base, 2), duration=0.3, engine=engine) for engine in ("core", "pinocchio"))
    for i in (0, len(core) // 2, -1):
        for entry in ("link1", "link2"):
            for point in ("hinge", "rod_end", "tip"):
                places = [run.mechanism.position((run.q[i], run.v[i]), entry, point) for run in (core, other)]
                np.testing.assert_allclose(places[0], places[1], rtol=0, atol=1e-8)
                np.testing.assert_allclose(places[0], core.position(entry, point)[i], rtol=0, atol=1e-12)
    np.testing.assert_allclose(core["kinetic"], other["kinetic"], rtol=1e-8)
