"""A run as a table: every column once, with its unit, the same in CSV, pandas and xarray; what a prompt completes and shows."""

from __future__ import annotations

import csv
import importlib
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import PIVOT, SKI, bent, link, scene
from vlmb.model.names import Names
from vlmb.scene.names import kind_of
from vlmb.simulation.columns import columns
from vlmb.system.core_plan import make_core_plan
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

MODELS = Path(__file__).resolve().parents[2] / "models"
ROWS = ["lean: phi1 = phi0"]
PROGRAMME = {"constraints": ["course: tan(phi0) = 0.2*cos(0.4*x)"], "controls": ["M_phi0"], "frequency": 4.0}


@pytest.fixture(scope="module")
def skier() -> vlmb.Trajectory:
    legs = link("legs", lower={"motion": "prescribed", "law": "0.3 + 0.02*sin(t)"})
    start = {"psi1": 1.2, "speed": 2.0}
    return vlmb.simulate(scene(SKI, [legs], constraints=ROWS, programme=PROGRAMME, start=start, slope=0.1), duration=0.2)


def test_a_frame_holds_every_result(skier: vlmb.Trajectory) -> None:
    pandas = pytest.importorskip("pandas")
    frame = skier.to_pandas()
    assert isinstance(frame, pandas.DataFrame) and frame.index.name == "t"
    assert np.array_equal(frame.index, skier.t)
    told = {name: skier[name] for name in skier.names if name != "t"}
    told |= dict(skier.controls) | dict(skier.reactions)
    for name, residual in skier.residuals.items():
        told |= {f"residual_dot:{name}": residual.velocity}
        told |= {} if residual.position is None else {f"residual:{name}": residual.position}
    assert list(frame.columns) == list(dict.fromkeys(frame.columns)) and set(frame.columns) == set(told)
    for name, values in told.items():
        np.testing.assert_array_equal(frame[name], values, err_msg=name)
    units = frame.attrs["units"]
    assert units["t"] == "s" and set(units) == {"t", *frame.columns}
    expected = {
        "x": "m", "phi0_dot": "rad/s", "speed": "m/s", "xi1_1": "m", "energy": "J", "M_phi0": "N m", "F1_1": "N", "normal": "N",
        "roll_moment": "N m", "residual_dot:knife_edge": "m/s", "lean": "", "residual:course": "",
    }  # fmt: skip
    assert {name: units[name] for name in expected} == expected
    frame["x"] = 0.0  # a table of its own
    assert skier["x"][-1] != 0.0


def test_a_dataset_holds_the_same(skier: vlmb.Trajectory) -> None:
    pytest.importorskip("xarray")
    frame, made = skier.to_pandas(points=True, hinges=True), skier.to_xarray(points=True, hinges=True)
    assert list(made.data_vars) == list(frame.columns) and dict(made.sizes) == {"t": len(skier)}
    for name in made.data_vars:
        np.testing.assert_array_equal(made[name], frame[name], err_msg=str(name))
        assert made[name].attrs == {"units": frame.attrs["units"][name]}
    assert made["t"].attrs == {"units": "s"}
    assert {"scene": "scene", "status": "finished", "method": "dop853", "vlmb": vlmb.__version__}.items() <= made.attrs.items()
    made["x"][:] = 0.0
    assert skier["x"][-1] != 0.0


def test_points_and_hinges_are_asked_for(skier: vlmb.Trajectory) -> None:
    few, all_of = ({column.name: column for column in columns(skier, *ask)} for ask in ((), (True, True)))
    assert len(few) + 3 * 4 + 3 + 2 * 3 == len(all_of)
    np.testing.assert_array_equal(all_of["legs.tip.z"].values, skier.position("legs", "tip")[:, 2])
    np.testing.assert_array_equal(all_of["com.x"].values, skier["com.x"])
    np.testing.assert_array_equal(all_of["hinge_force:legs.y"].values, skier.hinge_force("legs")[:, 1])
    assert (all_of["hinge_torque:legs.x"].unit, all_of["hinge_force:legs.x"].unit, all_of["com.x"].unit) == ("N m", "N", "m")


def test_a_file_has_the_columns_of_a_frame(skier: vlmb.Trajectory, tmp_path: Path) -> None:
    with skier.save_csv(tmp_path / "run.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    found = list(columns(skier))
    assert header == [column.header for column in found]
    assert [re.sub(r" \[[^]]*\]$", "", text) for text in header] == [column.name for column in found]
    values = np.array(rows, dtype=float)
    for k, column in enumerate(found):
        np.testing.assert_array_equal(values[:, k], column.values, err_msg=column.name)


def test_a_package_that_is_not_there_is_named(skier: vlmb.Trajectory, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(vlmb.TrajectoryError, match=r"this needs pandas, .*pip install vlmb\[data\]"):
        skier.to_pandas()
    with pytest.raises(vlmb.TrajectoryError, match="this needs xarray"):
        skier.to_xarray()


def test_a_prompt_completes_names(skier: vlmb.Trajectory) -> None:
    offered = skier._ipython_key_completions_()
    assert {"t", "phi0", "psi1_dot", "speed", "legs.azimuth", "legs.tip.z", "com.x", "energy"} <= set(offered)
    assert all(skier[name].shape == skier.t.shape for name in offered)
    for what in ("controls", "reactions", "residuals"):
        assert list(getattr(skier, what)) == getattr(skier, what)._ipython_key_completions_()


def test_what_is_shown_is_a_line_or_two(skier: vlmb.Trajectory) -> None:
    system, forced = make_system(skier.mechanism), vlmb.build(bent(PIVOT, 1, forces=[{"on": "T_link1", "law": "t"}]))
    plan = make_core_plan(forced, forced.scene.run, (), (), (), ("T_link1",))
    shown = {
        "<Mechanism of 'scene': ski base; x y phi0 phi1 psi1": skier.mechanism,
        "<Trajectory of 'scene': 201 samples, finished at t = 0.2 s; x y phi0 phi1 psi1": skier,
        "<Start: phi0 = ": consistent_start(system),
        "<System of 'scene': core engine, knife edge reduction; prescribed xi1_1; rows lean, course; ": system,
        "<End at t = 0.2 s: x = ": skier.end,
        "<Residual of 'phi1 = phi0': 201 samples, up to ": skier.residuals["lean"],
        "<Residual: 201 samples, its rate up to ": skier.residuals["knife_edge"],
        "<controls: M_phi0, F1_1>": skier.controls,
        "<reactions: knife_edge, normal, roll_moment, pitch_moment, lean>": skier.reactions,
        "<Names: x y phi0 ": skier.mechanism.names,
        "<EquationsOfMotion of 'scene': form full; rows x, y, ": vlmb.equations_of_motion(
            skier.mechanism, skier.end.coordinates, skier.end.rates
        ),
        "<CorePlan of 'scene': 5 positions, 5 velocities, ": plan,
    }
    for text, what in shown.items():
        assert repr(what).startswith(text) and len(repr(what)) < 330, repr(what)
    assert "controls M_phi0, F1_1; reactions knife_edge" in repr(skier)
    long = vlmb.build(scene(PIVOT, 12))
    first = "phi1 psi1 xi1_1 xi1_2 phi2 psi2 xi2_1 xi2_2 phi3 psi3 xi3_1 xi3_2"
    assert repr(long) == f"<Mechanism of 'scene': pivot base; {first} ... (48)>"


@pytest.mark.parametrize("path", sorted(MODELS.glob("*.toml")), ids=lambda path: path.stem)
def test_the_forms_of_names_are_those_of_the_vocabulary(path: Path) -> None:
    names: Names = vlmb.build(path).names
    assert {kind_of(name) for c in names.coordinates for name in (c.name, f"{c.name}_dot")} == {"a coordinate"}
    assert {kind_of(name) for name in names.forces} <= {"a force"}
    assert {kind_of(name) for name in ("speed", "com.x", *(f"{entry}.tip.z" for entry in names.links))} == {None}
