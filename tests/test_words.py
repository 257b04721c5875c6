"""What is said where somebody meant something else: degrees, quotes, another file, a misspelt option."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import FIXED, PIVOT, SKI, Table, bent, link, scene, table, write_toml
from vlmb.cli import main

BAR = link("bar", lower=FIXED, upper=FIXED)


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ({"psi1": 80.0}, "start.psi1 = 80 is 12.7 turns: angles are in radians, and 80 degrees are 1.396"),
        ({"bar.elevation": 45.0}, "start.bar.elevation = 45 is 7.16 turns: angles are in radians, and 45 degrees are 0.7854"),
        ({"phi1": -90.0, "psi1": 1.2}, "start.phi1 = -90 is -14.3 turns"),
    ],
)
def test_angles_in_degrees(start: dict[str, float], said: str) -> None:
    made = scene(PIVOT, [BAR], start=start)
    assert said in vlmb.check(made).report
    assert said in vlmb.simulate(made, duration=0.05).summary()


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"constraints": ["psi1 = 80"]}, "constraint 'psi1 = 80': 80 is 12.7 turns: angles are in radians"),
        ({"constraints": ["a = bar.azimuth"], "parameters": {"a": 22.5}}, "constraint 'a = bar.azimuth': 22.5 is 3.58 turns"),
        ({"programme": {"constraints": ["psi1 = 45 + sin(t)"], "controls": ["M_psi1"], "frequency": 2.0}}, "sin(t)': 45 is 7.16"),
        (
            {"forces": [{"between": ["base", "bar"], "stiffness": 5.0, "rest": 30.0}], "start": {"psi1": 1.2}},
            "forces[0].rest = 30 is 4.77 turns",
        ),
        ({"start": {"psi1": 80.5}}, "start.psi1 = 80.5 is 12.8 turns"),
    ],
)  # fmt: skip
def test_angles_in_degrees_elsewhere(keys: Table, said: str) -> None:
    assert said in vlmb.check(scene(PIVOT, [BAR], **keys)).report


def test_angles_that_may_be_radians() -> None:
    for start in ({"psi1": 1.2, "phi1": 7.5}, {"phi1": 4 * math.pi}, {"psi1": 3.0}, {"psi1": 1.0, "psi1_dot": 40.0}):
        assert "turns" not in vlmb.check(scene(PIVOT, [BAR], start=start)).report
    with pytest.raises(vlmb.SceneError, match=r"slope = 12.*in radians \(degrees times pi/180\)"):
        vlmb.Scene.from_dict({**table(SKI, [BAR]), "slope": 12.0})
    with pytest.raises(vlmb.SceneError, match=r"under the snow; raise psi \(in radians\), or set run.fall = false"):
        vlmb.simulate(scene(SKI, [BAR], start={"psi1": 30.0}, run={"fall": True}), duration=0.1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[base]\nkind = pivot\n", 'line 2: pivot needs quotes: a text is written "pivot"'),
        ("name = my_scene\n[base]\nkind = 'pivot'\n", "line 1: my_scene needs quotes"),
        ("[base]\nkind = 'ski'\n[run]\nmethod=rk4\n", "line 4: rk4 needs quotes"),
        ("[base\nkind = 'ski'\n", "not a TOML file: Expected ']'"),
    ],
)
def test_texts_without_quotes(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    with pytest.raises(vlmb.SceneError) as caught:
        vlmb.load_scene(tmp_path / "a.toml")
    assert said in str(caught.value)


def test_a_stored_run_is_no_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = vlmb.simulate(bent(PIVOT, 1), duration=0.05).save(tmp_path / "run.npz")
    path.with_suffix(".toml").write_bytes(path.read_bytes())
    for file in (path, path.with_suffix(".toml")):
        with pytest.raises(vlmb.SceneError, match="a stored run, not a scene file: read it with load_trajectory"):
            vlmb.simulate(str(file))
        assert main(["check", str(file)]) == 1
        assert "replay it with `vlmb run`" in capsys.readouterr().err


@pytest.mark.parametrize("control", [lambda t: {}, lambda: None, lambda t, view, gain: {}])
def test_a_control_of_other_arguments(control: Any) -> None:
    with pytest.raises(vlmb.SceneError, match=r"must be a function of \(t, view\) that returns forces by name"):
        vlmb.simulate(bent(PIVOT, 1), duration=0.05, control=control)
    for fine in (lambda *both: None, lambda t, view, gain=2.0: {"M_psi1": gain}):
        assert vlmb.simulate(bent(PIVOT, 1), duration=0.05, control=fine).status == "finished"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "a.toml", "--metod", "rk4"], "unrecognized arguments: --metod rk4; did you mean '--method'"),
        (["run", "a.toml", "--durations=3"], "did you mean '--duration'"),
        (["view", "a.toml", "--gosts", "3"], "did you mean '--ghosts'"),
        (["check", "a.toml", "b.toml"], "unrecognized arguments: b.toml"),
        (["plot", "--only", "path"], "the following arguments are required: runs"),
        (["matrices", "--block", "K"], "the following arguments are required: scene"),
        (["matrices", "--block", "K", "a.toml", "--at", "b.toml"], "more than one scene: a.toml, b.toml"),
    ],
)
def test_wrong_options(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2 and said in capsys.readouterr().err


def test_options_of_many_names_leave_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    made: Table = {**table(PIVOT, [BAR]), "name": "bar", "start": {"psi1": 0.4}, "run": {"duration": 0.1}}
    write_toml(tmp_path / "bar.toml", made)
    assert main(["run", "bar.toml", "--quiet", "--no-plots"]) == 0
    capsys.readouterr()
    assert main(["plot", "--only", "path", "energy", "results/bar/run.npz"]) == 0
    assert capsys.readouterr().out.strip() == f"wrote {Path('plots/path.png')}, {Path('plots/energy.png')}"
    printed = []
    for order in (["--block", "D", "bar.toml"], ["--at", "psi1=0.4", "bar.toml", "--block", "D"], ["bar.toml", "--block", "D"]):
        assert main(["matrices", *order]) == 0
        printed.append(capsys.readouterr().out)
    assert len(set(printed)) == 1 and printed[0]
    before = (tmp_path / "results" / "bar" / "run.npz").read_bytes()
    assert main(["run", "results/bar/run.npz", "--quiet"]) == 0
    out = capsys.readouterr().out.splitlines()[-1]
    assert out.startswith(f"wrote into {Path('results/bar_replay')}: run.npz, run.csv, coordinates.png") and len(out) < 130
    assert (tmp_path / "results" / "bar" / "run.npz").read_bytes() == before


def test_a_fall_at_the_start_says_how_to_go_on() -> None:
    flat = scene(SKI, [link("bar", lower=FIXED, upper=FIXED, tip_mass=None)], start={"psi1": 0.0, "psi1_dot": -1.0}, run={})
    run = vlmb.simulate(flat, duration=0.2)
    assert run.status == "stopped" and run.t[-1] == 0.0
    assert "reached the snow as it starts; raise psi, or set run.fall = false to go on" in run.message


def test_controls_are_printed_with_their_units() -> None:
    run = vlmb.simulate(bent(PIVOT, 1), duration=0.1, control=lambda t, view: {"M_psi1": 2.0, "F1_1": 1.0})
    assert "control          M_psi1: up to 2 N m, power" in run.summary()
    assert "control          F1_1: up to 1 N, power" in run.summary()


# A free base has no ground --------------------------------------------------------------------------------------------


def falling(**keys: Any) -> vlmb.Trajectory:
    start = {"z": 1.0, "psi1": 0.3}
    made = scene({"kind": "free", "mass": 1.0}, [BAR], **{"start": start, "run": {"fall": True}, **keys})
    return vlmb.simulate(made, duration=0.8)


def test_what_falls_through_the_ground_is_said() -> None:
    run = falling()
    first = float(run.t[np.argmax(run.position("bar", "hinge")[:, 2] < 0.0)])
    assert run.status == "finished" and not run.doubts
    said = f"WARNING          bar.hinge goes through z = 0 at t = {first:.4g} s: there is no ground under a free base"
    assert said in run.summary()


def test_what_does_not_fall_through_it_is_not() -> None:
    for keys in (
        {"run": {"fall": False}},
        {"gravity": 0.0},
        {"start": {"z": 0.0, "psi1": -0.3}},  # begins below it
        {"start": {"z": 9.0, "psi1": 0.3}},
        {"constraints": ["z = 1"]},
    ):
        assert "no ground" not in falling(**keys).summary()


# Words that were not true --------------------------------------------------------------------------------------------


def test_a_single_row_too_has_a_condition() -> None:
    """A moment on the azimuth of a link that rises to the vertical moves it less and less: by cos(psi)^2."""
    made = scene(
        PIVOT, [link("bar", lower=FIXED, upper=FIXED)], start={"psi1": 0.2, "psi1_dot": 0.0}, gravity=0.0,
        constraints=["psi1 = 0.2 + t"],
        programme={"constraints": ["bar.direction.y = 0"], "controls": ["M_phi1"], "frequency": 3.0},
    )  # fmt: skip
    run = vlmb.simulate(made, duration=1.2)
    strength = 1.0 / np.cos(run["psi1"])  # of M_phi on d_y: cos(psi) M / (J cos(psi)^2)
    np.testing.assert_allclose(run.conditions, strength.max() / strength, rtol=1e-6)
    assert f"condition of G up to {strength.max() / strength.min():.4g}" in run.summary()


def test_the_work_of_an_equation_that_names_the_time_is_counted() -> None:
    """A mass that an equation raises by 1 m: m g h."""
    bob = link("bob", rod={"length": 0.0, "mass": 0.0}, lower={"length": 1.0}, upper=FIXED | {"length": 0.0}, tip_mass=2.0)
    rows = {"constraints": ["xi1_1 = 1 + t**2", "psi1 = pi/2"], "plane": True}
    made = scene(PIVOT, [bob], start={"psi1": math.pi / 2, "xi1_1": 1.0}, **rows)
    run = vlmb.simulate(made, duration=1.0)
    assert run.work_by_force["xi1_1 = 1 + t**2"][-1] == pytest.approx(2.0 * 9.81 + 0.5 * 2.0 * 4.0, rel=1e-7)
    assert "do no work if the equation does not name `t`" in (
        Path(__file__).resolve().parents[1] / "docs" / "howto" / "write-a-scene.md"
    ).read_text(encoding="utf-8").replace("\n", " ")
