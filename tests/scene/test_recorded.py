"""Measured data in scenes: what files and arrays hold is read to the last digit, and what is wrong with them is named."""

from __future__ import annotations

import math
import os
import pickle
import random
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb import SceneError

BODY: dict[str, Any] = {
    "base": {"kind": "pivot"},
    "links": [{"name": "leg", "rod": {"length": 0.4, "mass": 2.0}, "lower": {"motion": "prescribed", "law": "mocap.knee"}}],
    "start": {"psi1": -1.0}, "run": {"duration": 0.3},
}  # fmt: skip
TIMES = [0.0, 0.1, 0.25, 0.30000000000000004, 0.4, 1 / 3 + 0.2, 0.7]
VALUES = [0.1, 0.30000000000000004, 1 / 3, -2.5e-7, 123456.789012345, 1e-300, math.pi]


def scene(folder: Path, **data: Any) -> vlmb.Scene:
    entry = {"name": "mocap", "columns": {"knee": "knee"}, **data}
    return vlmb.Scene.from_dict({**BODY, "data": [entry]}, folder=folder)


def column(made: vlmb.Scene, name: str = "knee") -> list[float | None]:
    return list(made.data[0].columns[name].values)  # type: ignore[union-attr, arg-type]


def csv_text(values: list[float] = VALUES, header: str = "time,other,knee") -> str:
    return "\n".join([header, *(f"{t!r},7,{v!r}" for t, v in zip(TIMES, values, strict=True))]) + "\n"


def sto_text(degrees: str | None = "no", values: list[float] = VALUES) -> str:
    told = [f"inDegrees={degrees}"] if degrees else []
    head = ["trial", "version=1", f"nRows={len(values)}", "nColumns=3", *told, "endheader", "time\tknee\tpelvis_tx"]
    return "\n".join([*head, *(f"{t!r}\t{v!r}\t  1.5" for t, v in zip(TIMES, values, strict=True))]) + "\n"


@pytest.mark.parametrize("ending", ["csv", "sto", "mot"])
def test_files_are_read_to_the_last_digit(ending: str, tmp_path: Path) -> None:
    (tmp_path / f"trial.{ending}").write_text(csv_text() if ending == "csv" else sto_text(None))
    made = scene(tmp_path, file=f"trial.{ending}")
    assert column(made) == VALUES and list(made.data[0].time) == TIMES
    again = vlmb.Scene.from_dict(made.to_dict(), folder="/nowhere")  # it has taken its data in
    assert again == made and hash(again) == hash(made) and column(again) == VALUES
    assert pickle.loads(pickle.dumps(made)) == made  # noqa: S301
    assert column(made.changed(name="other")) == VALUES


@pytest.mark.parametrize("text", [
    "time;other;knee\n0;1;0.5\n1;;0.25\n", "\ufefftime\tother\tknee\n0\t1\t0.5\n1\t\t0.25\n",
    '# made by hand\n\n"time",other,"knee"\n0,1,0.5\n\n# a remark\n1,,0.25\n',
    "time [s],other,knee [m]\r\n0,1,0.5\r\n1,1,0.25\r\n",
])  # fmt: skip
def test_csv_comes_in_many_forms(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8", newline="")
    assert column(scene(tmp_path, file="a.csv")) == [0.5, 0.25]


def test_units_are_honoured(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("ms,angle,knee,force [kN],wide [mm]\n0,90,9,1,3\n500,180,0.3,2,4\n")
    made = scene(
        tmp_path, file="a.csv", time={"from": "ms", "unit": "ms"},
        columns={"angle": {"unit": "deg"}, "knee": {"from": "knee", "unit": "mm"}, "force": "force", "wide": "wide"},
    )  # fmt: skip
    assert list(made.data[0].time) == [0.0, 0.5]
    assert column(made, "angle") == [math.radians(90.0), math.radians(180.0)]
    assert column(made, "knee") == [0.009, 0.0003] and column(made, "force") == [1000.0, 2000.0]
    assert column(made, "wide") == [0.003, 0.004]  # by the header, where nothing else is said
    units = {name: entry.unit for name, entry in made.data[0].columns.items()}  # type: ignore[union-attr]
    assert units == {"angle": "rad", "knee": "m", "force": "N", "wide": "m"}
    assert column(vlmb.Scene.from_dict(made.to_dict()), "angle") == column(made, "angle")  # not converted twice


def test_degrees_of_opensim_need_a_unit(tmp_path: Path) -> None:
    (tmp_path / "ik.mot").write_text(sto_text("yes"))
    with pytest.raises(SceneError, match=r"knee: ik.mot says inDegrees=yes: give its unit, 'deg' of an angle, 'm' of a length"):
        scene(tmp_path, file="ik.mot")
    made = scene(tmp_path, file="ik.mot", columns={"knee": {"unit": "deg"}, "side": {"from": "pelvis_tx", "unit": "m"}})
    assert column(made) == [math.radians(value) for value in VALUES] and column(made, "side") == [1.5] * 7
    with pytest.raises(SceneError, match="says inDegrees=yes; mend the one that is wrong"):
        scene(tmp_path, file="ik.mot", columns={"knee": {"unit": "rad"}})
    (tmp_path / "ik.mot").write_text(sto_text("no"))
    assert column(scene(tmp_path, file="ik.mot")) == VALUES
    with pytest.raises(SceneError, match="says inDegrees=no"):
        scene(tmp_path, file="ik.mot", columns={"knee": {"unit": "deg"}})


def test_arrays_from_python() -> None:
    time, knee = np.arange(5) / 10.0, np.array([1.0, np.nan, 3.0, 4.0, 5.0])
    columns: Any = {"knee": {"values": knee, "unit": "mm"}}
    entry = vlmb.Data(name="mocap", time=time, columns=columns, smooth=vlmb.Smoothing(sigma=0.1))  # type: ignore[arg-type]
    made = vlmb.Scene.from_dict({**BODY, "data": [entry]})
    assert column(made) == [0.001, None, 0.003, 0.004, 0.005] and made.data[0].smooth == vlmb.Smoothing(sigma=0.1)
    assert made == vlmb.Scene.from_dict({**BODY, "data": [{"name": "mocap", "time": list(time), "columns": {
        "knee": {"values": tuple(knee), "unit": "mm"}}, "smooth": {"sigma": 0.1}}]})  # fmt: skip
    assert made.changed_at({"data.0.smooth": "none"}).data[0].smooth == "none"


def test_a_parameter_may_stand_where_a_number_does() -> None:
    entry = {"name": "mocap", "time": [0, 1], "columns": {"knee": [1, 2]}, "gap": "2*g", "smooth": {"sigma": "g/100"}}
    made = vlmb.Scene.from_dict({**BODY, "parameters": {"g": 0.5}, "data": [entry]})
    assert made.data[0].gap == 1.0 and made.data[0].smooth.sigma == 0.005  # type: ignore[union-attr]


# ---- what is wrong is named


GOOD: dict[str, Any] = {"time": [0.0, 0.1, 0.2], "columns": {"knee": [1.0, 2.0, 3.0]}}


@pytest.mark.parametrize("change, words", [
    ({"time": [0.0, 0.2, 0.1]}, r"data\[0\].time: times must ascend: sample 3 is at 0.1 s"),
    ({"time": [0.0, 0.1, 0.1]}, "times must ascend"), ({"time": [0.0, float("nan"), 0.2]}, "sample 2 has no time"),
    ({"time": [0.0, 0.1]}, "3 values at 2 times"), ({"time": "time"}, "need a list of times"),
    ({"columns": {"knee": [1.0, float("inf"), 2.0]}}, "sample 2 is inf"),
    ({"columns": {"knee": ["1", 2, 3]}}, "list of numbers"),
    ({"columns": {"knee": [[1.0, 2.0], [3.0]]}}, "list of numbers"), ({"columns": {"knee": 7}}, "must be a list of numbers"),
    ({"columns": {"knee": [1.0, 1e60, 2.0]}}, "too large"), ({"columns": {}}, "must be a table of names"),
    ({"columns": {"knee_dot": [1.0]}}, "those of derivatives"), ({"columns": {"my knee": [1.0]}}, "is no name"),
    ({"columns": {"knee": {"values": [1, 2, 3], "unit": "inch"}}}, "unknown unit"),
    ({"columns": {"knee": {"values": [1, 2, 3], "unti": "m"}}}, "did you mean 'unit'"),
    ({"smooth": "more"}, "allowed: auto, none"),
    ({"smooth": {"sigma": 0.0}}, "sigma"), ({"smooth": {"sigmas": 1.0}}, "did you mean 'sigma'"), ({"gap": 0.0}, "gap"),
    ({"gab": 1.0}, "did you mean 'gap'"), ({"name": "leg"}, "has this name already"), ({"name": "ski"}, "the base's own"),
    ({"name": "a b"}, "a name begins with a letter"),
])  # fmt: skip
def test_wrong_entries_are_named(change: dict[str, Any], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        vlmb.Scene.from_dict({**BODY, "data": [{"name": "mocap", **GOOD, **change}]})


@pytest.mark.parametrize("text, words", [
    ("", "is empty"), ("# only a remark\n", "is empty"), ("0,1\n1,2\n", "numbers where the names of the columns"),
    ("time,kneee\n0,1\n", "no column 'knee'; did you mean 'kneee'"), ("t,knee\n0,1\n", "no column 'time'"),
    ("time,knee\n0,1\n0.1\n", "line 3: 1 cells where the header has 2"),
    ("time,knee\n0,1\n0.1,x\n", "line 3, column 'knee': 'x'"),
    ("time;knee\n0;1,5\n", "the decimal mark is a point"), ("time,knee\n0,1_0\n", "'1_0' is no number"),
    ("time,knee\n0,1e999\n", "no finite number"), ("time,knee\n0,-inf\n", "no finite number"),
    ("time,knee\n0,\u0661\n", "is no number"), ("time,knee\n0,1\n,2\n", "sample 2 has no time"),
    ("time,knee\n1,1\n0,2\n", "times must ascend"), ("time,knee,knee\n0,1,2\n", "2 columns are called 'knee'"),
    ('time,knee\n0,"1\n', "line 2: unexpected end of data"), ("time,knee\n0,1\0\n", "line 2"),
    ("time," + "knee" * 100_000 + "\n", "field larger than field limit"), ("time," * 10_001 + "knee\n", "at most 10000"),
    ("time,knee\n0," + "1" * 1000 + "\n", "is no number"), ("time,knee [parsec]\n0,1\n", None),
])  # fmt: skip
def test_damaged_csv_files_are_refused_by_name(text: str, words: str | None, tmp_path: Path) -> None:
    (tmp_path / "trial.csv").write_text(text, encoding="utf-8")
    if words is None:  # a unit that is none of ours is left to the reader
        assert column(scene(tmp_path, file="trial.csv")) == [1.0]
        return
    with pytest.raises(SceneError, match=rf"(?s)data\[0\].file: trial.csv: .*{re.escape(words)}"):
        scene(tmp_path, file="trial.csv")


@pytest.mark.parametrize("change, words", [
    (lambda text: text.replace("endheader", "endhead"), "no line `endheader`"),
    (lambda text: text[: text.index("0.25")], "it is damaged, or was cut"),
    (lambda text: text.replace("nColumns=3", "nColumns=4"), "ncolumns = 4, and there are 3"),
    (lambda text: text.replace("inDegrees=no", "inDegrees=maybe"), "must be yes or no"),
    (lambda text: text.replace("version=1", "DataType=Vec3"), "DataType=Vec3"),
    (lambda text: text.replace("\tknee", "\tkneeflex"), "no column"),
    (lambda text: text.split("time\t")[0], "no line with the names"),
    (lambda text: text.replace("1.5", "1.5 2.5", 1), "4 cells"),
])  # fmt: skip
def test_damaged_sto_files_are_refused_by_name(change: Any, words: str, tmp_path: Path) -> None:
    (tmp_path / "trial.sto").write_text(change(sto_text()))
    with pytest.raises(SceneError, match=f"trial.sto: .*{words}"):
        scene(tmp_path, file="trial.sto")


def test_files_stay_below_the_scene(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    (inner / "deep").mkdir(parents=True)
    (tmp_path / "secret.csv").write_text(csv_text())
    (inner / "deep" / "trial.csv").write_text(csv_text())
    (inner / "link.csv").symlink_to(tmp_path / "secret.csv")
    (inner / "folder.csv").mkdir()
    (inner / "trial.xlsx").write_text("")
    os.mkfifo(inner / "pipe.csv")
    with (inner / "huge.csv").open("wb") as file:
        file.truncate(64_000_001)  # a hole in the disk, not bytes
    assert column(scene(inner, file="deep/trial.csv")) == VALUES
    for name, words in (
        ("../secret.csv", "below it, by a relative path"), (str(tmp_path / "secret.csv"), "relative path"),
        ("link.csv", "leads out"), ("folder.csv", "is no file"), ("pipe.csv", "is no file"),
        ("trial.xlsx", "csv, .sto, .mot, .c3d"),
        ("none.csv", "no such file"), ("huge.csv", "at most 64000000"), ("a\0b.csv", "relative path"), ("", "relative path"),
        ("a" * 500 + ".csv", "cannot be read"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=words):
            scene(inner, file=name)


@pytest.mark.parametrize("ending", ["csv", "sto"])
def test_any_damage_is_read_or_refused_by_name(ending: str, tmp_path: Path) -> None:
    """Bytes changed, dropped, doubled or cut off at random: a scene with finite samples, or a SceneError."""
    whole, chance = (csv_text() if ending == "csv" else sto_text()).encode(), random.Random(5)
    refused = 0
    for _ in range(400):
        data = bytearray(whole)
        for _ in range(chance.randint(1, 6)):
            at = chance.randrange(max(len(data), 1))
            data = data or bytearray(b"\0")
            match chance.randrange(4):
                case 0:
                    data[at] = chance.randrange(256)
                case 1:
                    del data[at : at + chance.randint(1, 20)]
                case 2:
                    data[at:at] = data[at : at + chance.randint(1, 20)]
                case _:
                    del data[at + 1 :]
        (tmp_path / f"trial.{ending}").write_bytes(data)
        try:
            made = scene(tmp_path, file=f"trial.{ending}")
        except SceneError as error:
            named = f"trial.{ending}" in str(error)
            refused += 1
        else:
            named = all(value is None or math.isfinite(value) for value in column(made))
        assert named
    assert 100 < refused < 400


# ---- c3d


def c3d_file(path: Path, units: str = "mm", lost: int | None = None) -> np.ndarray:
    """Write points and analogs by ezc3d; return the points (xyz, points, frames)."""
    ezc3d = pytest.importorskip("ezc3d", reason="ezc3d is not installed, so no c3d file can be read")
    made, frames = ezc3d.c3d(), 20
    points = np.float32(np.random.default_rng(1).uniform(-900.0, 900.0, (4, 2, frames)))
    points[3] = 1.0
    if lost is not None:
        points[:3, 0, lost] = np.nan
    made["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    made["parameters"]["POINT"]["UNITS"]["value"] = [units]
    made["parameters"]["POINT"]["LABELS"]["value"] = ("LKNE", "RKNE")
    made["data"]["points"] = points.astype(float)
    made["parameters"]["ANALOG"]["RATE"]["value"] = [1000.0]
    made["parameters"]["ANALOG"]["LABELS"]["value"] = ("Fz1",)
    made["parameters"]["ANALOG"]["UNITS"]["value"] = ("N",)
    made["data"]["analogs"] = np.float32(np.random.default_rng(2).uniform(0.0, 900.0, (1, 1, 10 * frames))).astype(float)
    made.write(str(path))
    return points


def test_c3d_points_and_analogs(tmp_path: Path) -> None:
    points = c3d_file(tmp_path / "trial.c3d", lost=4)
    made = scene(tmp_path, file="trial.c3d", columns={"knee": "LKNE.z", "side": {"from": "RKNE.x", "unit": "m"}})
    wanted = [None if k == 4 else float(x) / 1000 for k, x in enumerate(points[2, 0])]
    assert column(made) == wanted and column(made, "side") == [float(x) for x in points[0, 1]]
    assert list(made.data[0].time) == [k / 100.0 for k in range(20)]
    force = scene(tmp_path, file="trial.c3d", columns={"force": "Fz1"})
    assert len(column(force, "force")) == 200 and force.data[0].time[1] == 0.001
    assert force.data[0].columns["force"].unit == "N"  # type: ignore[union-attr]
    with pytest.raises(SceneError, match=r"different rates \(LKNE.z 100 Hz, Fz1 1000 Hz\)"):
        scene(tmp_path, file="trial.c3d", columns={"knee": "LKNE.z", "force": "Fz1"})
    with pytest.raises(SceneError, match=r"no point or analog 'LKNE'; did you mean 'LKNE"):
        scene(tmp_path, file="trial.c3d", columns={"knee": "LKNE"})


def test_damaged_c3d_files_are_refused_by_name(tmp_path: Path) -> None:
    c3d_file(tmp_path / "whole.c3d")
    whole, chance, path = (tmp_path / "whole.c3d").read_bytes(), random.Random(3), tmp_path / "trial.c3d"
    for cut in (0, 1, 500, 1000, len(whole) // 2, len(whole) - 600):
        path.write_bytes(whole[:cut])
        with pytest.raises(SceneError, match=r"trial.c3d: "):
            scene(tmp_path, file="trial.c3d", columns={"knee": "LKNE.z"})
    for _ in range(40):
        data = bytearray(whole)
        for _ in range(chance.randint(1, 4)):
            data[chance.randrange(1536)] = chance.randrange(256)
        path.write_bytes(data)
        try:
            made = scene(tmp_path, file="trial.c3d", columns={"knee": "LKNE.z"})
        except SceneError as error:
            named = "trial.c3d" in str(error) or "data[0]" in str(error)
        else:
            named = all(value is None or math.isfinite(value) for value in column(made))
        assert named


def test_without_ezc3d_its_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "trial.c3d").write_bytes(bytes(1024))
    monkeypatch.setitem(__import__("sys").modules, "ezc3d", None)
    with pytest.raises(SceneError, match=r"trial.c3d: c3d files need ezc3d, which is not installed: pip install vlmb\[mocap\]"):
        scene(tmp_path, file="trial.c3d")
