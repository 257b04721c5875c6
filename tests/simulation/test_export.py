"""Runs in files of other programs, read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray

import vlmb
from vlmb.cli import main
from vlmb.errors import TrajectoryError
from vlmb.simulation.export import export

MODELS = Path(__file__).resolve().parents[2] / "models"


@pytest.fixture(scope="module")
def run() -> vlmb.Trajectory:
    return vlmb.simulate(MODELS / "skier_one_link.toml", duration=0.2)


def test_a_storage_file_is_measured_data_of_a_scene(run: vlmb.Trajectory, tmp_path: Path) -> None:
    path = export(run, tmp_path / "run.sto")
    head = path.read_text().splitlines()[:7]
    assert head[1] == "version=1" and head[2] == f"nRows={len(run)}" and head[5] == "endheader"
    assert head[3] == f"nColumns={len(head[6].split(chr(9)))}"
    base = {"kind": "pivot"}
    data = {"name": "old", "file": "run.sto", "columns": {"tip": "legs.tip.z"}, "smooth": "none"}
    link = {"name": "legs", "rod": {"length": 1.0, "mass": 1.0}}
    scene = vlmb.Scene.from_dict({"base": base, "links": [link], "data": [data]}, folder=tmp_path)
    signals = vlmb.build(scene).signals
    np.testing.assert_allclose(signals.along("old.tip", run.t), run["legs.tip.z"], atol=1e-12)


def test_a_netcdf_file_has_every_column_with_its_unit(run: vlmb.Trajectory, tmp_path: Path) -> None:
    with xarray.open_dataset(export(run, tmp_path / "run.nc"), engine="scipy") as stored:
        whole = run.to_xarray(points=True)
        assert set(stored.data_vars) == {name.replace("/", " per ") for name in whole.data_vars}
        np.testing.assert_array_equal(stored["psi1"].values, run["psi1"])
        assert stored["psi1"].attrs["units"] == "rad" and stored.attrs["scene"] == run.scene.name


def test_the_command_writes_and_refuses(run: vlmb.Trajectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stored = run.save(tmp_path / "run.npz")
    for end in ("csv", "nc", "sto"):
        assert main(["convert", str(stored), str(tmp_path / f"new.{end}")]) == 0 and (tmp_path / f"new.{end}").exists()
    assert main(["convert", str(stored), str(tmp_path / "new.xls")]) == 1
    assert "a stored run (.npz) becomes .csv, .nc, .sto" in capsys.readouterr().err
    with pytest.raises(TrajectoryError, match="is written as"):
        export(run, tmp_path / "run.txt")
