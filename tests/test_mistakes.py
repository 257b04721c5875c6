"""What beginners get wrong, each with the words that tell them what to change."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import vlmb
from tests.small_scenes import write_toml
from vlmb.cli import main

LEG: dict[str, Any] = {"name": "leg", "rod": {"length": 0.5, "mass": 2.0}, "lower": {"length": 0.25, "stiffness": 300.0}}
PENDULUM: dict[str, Any] = {"base": {"kind": "pivot"}, "links": [LEG], "start": {"psi1": 0.4}, "run": {"duration": 0.1}}
RIDER: dict[str, Any] = {"base": {"kind": "ski", "mass": 5.0, "inertia": 0.6}, "links": [LEG]}

# What is wrong in a scene, and what the message says of it: all of its text that matters, with the remedy.
SCENES: dict[str, tuple[dict[str, Any], str]] = {
    "elevation in degrees": (
        {**RIDER, "start": {"psi1": 80.0}},
        "leg.rod_end is 0.745 m under the snow; raise psi (in radians), or set run.fall = false"),
    "slope in degrees": ({"slope": 12}, "slope = 12: expected number < 1.5707, in radians (degrees times pi/180)"),
    "no base": ({"base": None}, 'missing key \'base\': base = {kind = "pivot"}; kinds are pivot, ski, free'),
    "a base that is a word": ({"base": "pivot"}, 'base = \'pivot\': expected table, got text; write base = {kind = "pivot"}'),
    "a capital letter": ({"base": {"kind": "Pivot"}}, "base.kind = 'Pivot': allowed: pivot, ski, free"),
    "one link without a list": ({"links": LEG},
        "expected list, got table; each begins with [[links]], with two brackets on each side"),
    "no rod": ({"links": [{"name": "leg"}]}, "missing key 'links[0].rod': rod = {length = 0.5, mass = 2.0} in m and kg"),
    "a rod without mass": ({"links": [{"rod": {"length": 1.0}}]}, "missing key 'links[0].rod.mass': mass [kg]"),
    "a unit": (
        {"links": [{"rod": {"length": 1.0, "mass": "2 kg"}}]}, "numbers stand without their unit: 2 (m, rad, s, kg, N)"),
    "a duration with its unit": ({"run": {"duration": "5s"}}, "run.duration = '5s': not an expression"),
    "a negative mass": ({"links": [{"rod": {"length": 1.0, "mass": -2}}]}, "links[0].rod.mass = -2: expected number >= 0.0"),
    "gravity upwards": ({"gravity": -9.81},
        "gravity = -9.81: expected number >= 0.0 [m/s^2]: it acts downwards; a slope tilts it"),
    "gravity as a vector": ({"gravity": [0, 0, -9.81]}, "expected number, got list [m/s^2]: it acts downwards"),
    "a misspelt key": ({"gravitty": 9.81}, "unknown key 'gravitty'; did you mean 'gravity'?"),
    "a key of other programs": ({"run": {"dt": 0.01}}, "unknown key 'run.dt'; did you mean 'step'?"),
    "a spring constant called k": ({"links": [{**LEG, "lower": {"length": 0.2, "k": 3.0}}]}, "did you mean 'stiffness'?"),
    "a spring without its length": (
        {"links": [{**LEG, "lower": {"stiffness": 3.0}}]}, "links[0].lower.length: a free segment needs a length [m]"),
    "a prescribed length without a law": (
        {"links": [{**LEG, "lower": {"motion": "prescribed"}}]}, 'needs a law, e.g. law = "0.2 + 0.05*sin(6*t)"'),
    "limits the wrong way round": (
        {"links": [{**LEG, "lower": {"length": 0.25, "limits": [0.5, 0.3]}}]}, "must be [low, high] with low < high"),
    "a name with a blank": ({"links": [{**LEG, "name": "left leg"}]},
        "a name begins with a letter and has letters, digits and _"),
    "two links of one name": ({"links": [LEG, LEG]}, "links[1].name = 'leg': links[0] has this name already"),
    "a parent that is not there": ({"links": [LEG, {**LEG, "name": "arm", "parent": "legs"}]}, "did you mean 'leg'?"),
    "a coordinate that is not there": ({"start": {"psi2": 1.0}},
        "start.psi2: no such coordinate in this scene; did you mean 'psi1'"),
    "a force on a coordinate": ({"forces": [{"on": "psi1", "law": 1.0}]}, "unknown force 'psi1'; did you mean 'M_psi1'"),
    "a force without a law": (
        {"forces": [{"on": "M_psi1"}]}, "the force on M_psi1 needs a law, a number or an expression of t: law = '20*sin(3*t)'"),
    "a force at a link": (
        {"forces": [{"at": "leg", "force": [0, 0, 1]}]}, "'leg' is a link, and a point of it is needed; valid names: hinge"),
    "a power as ^": ({"forces": [{"on": "M_psi1", "law": "t^2"}]}, "found 't^2' (BitXor); a power is **"),
    "a module before a function": ({"forces": [{"on": "M_psi1", "law": "np.sin(t)"}]},
        "'np.sin' is not a function; did you mean 'sin'"),
    "a bracket left open": ({"forces": [{"on": "M_psi1", "law": "sin(t"}]}, "'(' was never closed"),
    "a parameter that is not there": ({"gravity": "g"}, "unknown name 'g'; a number is needed, or an expression of parameters"),
    "an equation with ==": ({"constraints": ["psi1 == 0.4"]}, "an equation is written with one =, e.g. phi1 = phi0"),
    "an equation without =": ({"constraints": ["psi1 - 0.4"]}, "found 0 equals signs; an equation is written with one ="),
    "an equation of numbers": ({"constraints": ["1 = 2"]}, "contains no coordinate or rate: nothing can make it true or false"),
    "a method of SciPy": ({"run": {"method": "RK45"}},
        "run.method = 'RK45': allowed: euler, rk4, gauss, dop853, adams, bdf, radau"),
    "too sharp a tolerance": ({"run": {"rtol": 1e-20}}, "run.rtol = 1e-20: expected number >= 3e-14"),
    "a programme without gains": (
        {"programme": {"constraints": ["psi1 = 0.4"], "controls": ["M_psi1"]}}, "give frequency [rad/s], or gains"),
    "fewer controls than rows": (
        {"programme": {"constraints": ["psi1 = 0.4", "phi1 = 0"], "controls": ["M_psi1"], "frequency": 3.0}},
        "2 rows need at least as many controls; there are 1 (M_psi1); name more of M_phi1"),
    "a spring to the ground": (
        {"springs": [{"between": ["leg.tip", "ground"], "stiffness": 3.0}]},
        "unknown point 'ground'; valid names: leg; points are"),
    "a ski without inertia": ({**RIDER, "base": {"kind": "ski", "mass": 5.0}},
        "a ski needs mass > 0 [kg] and inertia > 0 [kg m^2]"),
    "friction of a pivot": ({"base": {"kind": "pivot", "friction": 0.1}}, "belong to kind = 'ski'; remove them from 'pivot'"),
    "an edge that lets go, on the snow for good": ({"base": {**RIDER["base"], "hold": 0.4}}, "hold and skid need lift = true"),
    "a contact of no point": ({"contacts": [{"name": "foot"}]}, "missing key 'contacts[0].point': point = \"legs.tip\""),
    "a contact at a point that is not there": (
        {"contacts": [{"point": "leg.foot"}]}, "'leg' has no point 'foot'; valid names: hinge, rod_start, rod_end, tip"),
    "one contact without a list": ({"contacts": {"point": "leg.tip"}}, "each begins with [[contacts]], with two brackets"),
    "an event that never says when": ({"events": [{"name": "low"}]}, "missing key 'events[0].when': when = \"legs.tip.z = 0.8\""),
    "an event as a comparison": ({"events": [{"name": "low", "when": "psi1 > 0.3"}]}, "found a comparison; an equation is"),
    "a programme as a list": ({"programme": ["psi1 = 0.4"]}, "expected table, got list; write [programme] with constraints = "),
    "a control twice": (
        {"programme": {"constraints": ["psi1 = 0.4"], "controls": ["M_psi1", "M_psi1"], "frequency": 3.0}},
        "programme.controls: 'M_psi1' is named twice"),
}  # fmt: skip

FILES = {
    "a word without quotes": ("base = {kind = pivot}", 'line 1: pivot needs quotes: a text is written "pivot"'),
    "an expression without quotes": ("slope = pi/12", 'line 1: an expression needs quotes: "pi/12"'),
    "a decimal comma": ("slope = 0,2", "line 1: 0,2: a decimal point is meant: 0.2"),
    "true as in Python": ("plane = True", "line 1: True is written true"),
    "a key given twice": ("gravity = 1.0\ngravity = 2.0", "line 2: 'gravity' is given twice; keep one"),
    "a colon": ("slope: 0.2", "Expected '=' after a key"),
    "an empty file": ("", "missing key 'base': base = "),
}

CALLS: dict[str, tuple[dict[str, Any], str]] = {
    "a control of time alone": ({"control": lambda t: {}}, "must be a function of (t, view) that returns forces by name"),
    "a control that returns a number": ({"control": lambda t, view: 3.0}, "it must return a dict of force names and numbers"),
    "a control of a wrong name": ({"control": lambda t, view: {"M_psi": 1.0}},
        "control: unknown force 'M_psi'; did you mean 'M_psi1'"),
    "a view of a wrong name": ({"control": lambda t, view: {"M_psi1": view["psi"]}},
        "control: unknown name 'psi'; did you mean 'psi1'"),
    "times that do not ascend": ({"t_eval": [0.1, 0.0]}, "t_eval: times must ascend within [0, 0.1] s"),
    "an end that is not there": ({"until": "landing"},
        "no event or quantity of this name; this scene has no events; an expression ends the run where it falls through 0"),
    "a number as progress": ({"progress": 5}, "progress = 5: must be a function that is called with the time reached"),
    "a start as a list": ({"start": [0.4]}, "must be the end of a run, or a dict of coordinates and rates by name"),
}

COMMANDS: dict[str, tuple[list[str], int, str]] = {
    "an option misspelt": (["run", "scene.toml", "--metod", "rk4"], 2, "did you mean '--method'"),
    "a method misspelt": (["run", "scene.toml", "--method", "rk45"], 2, "invalid choice: 'rk45' (choose from"),
    "a number with its unit": (["run", "scene.toml", "--duration", "5s"], 2, "invalid float value: '5s'"),
    "a command misspelt": (["simulate", "scene.toml"], 2, "invalid choice: 'simulate' (choose from"),
    "a file that is not there": (["run", "scen.toml"], 1, "scen.toml: no such scene file"),
    "a model misspelt": (["run", "slalm"], 1, "did you mean 'skier_slalom' or 'slip_walker'? (`vlmb models` lists them)"),
    "a plot misspelt": (["plot", "run.npz", "--only", "enrgy"], 1, "no plot 'enrgy'; did you mean 'energy'?"),
    "a picture of no kind": (["view", "scene.toml", "--png", "a.xyz"], 1, "must end as a picture's does, such as .png"),
    "a time beyond the run": (["view", "run.npz", "--time", "9", "--png", "a.png"], 1, "the motion lasts from 0 to 0.1 s"),
    "a file as the folder of results": (
        ["run", "scene.toml", "--output", "scene.toml"], 1, "--output scene.toml: must be a folder for the results"),
    "a format that is not there": (["convert", "run.npz", "run.mat"], 1, "a stored run (.npz) becomes .csv, .nc, .sto"),
    "a block that is not there": (["matrices", "scene.toml", "--block", "Q"], 1, "--block Q: no such block; valid names: A, B"),
    "a sweep without values": (["sweep", "scene.toml", "--vary", "start.psi1"], 1, "must be KEY=LOW:HIGH:COUNT or KEY=A,B,C"),
    "a reduction of no kind": (
        ["sweep", "scene.toml", "--vary", "start.psi1=1,2", "--keep", "psi1:final"], 1, "'final'; allowed: last, first, min"),
    "a run where a scene is meant": (["info", "run.npz"], 1, "a stored run, not a scene file"),
}


def made(keys: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in {**PENDULUM, **keys}.items() if value is not None}


@pytest.mark.parametrize("what", SCENES)
def test_in_a_scene(what: str) -> None:
    keys, text = SCENES[what]
    with pytest.raises(vlmb.VlmbError) as caught:
        vlmb.check(made(keys))
    assert text in str(caught.value), str(caught.value)


@pytest.mark.parametrize("what", FILES)
def test_in_a_file(what: str, tmp_path: Path) -> None:
    content, text = FILES[what]
    (tmp_path / "scene.toml").write_text(content, encoding="utf-8")
    with pytest.raises(vlmb.SceneError, match=r"scene\.toml: ") as caught:
        vlmb.load_scene(tmp_path / "scene.toml")
    assert text in str(caught.value), str(caught.value)


@pytest.mark.parametrize("what", CALLS)
def test_in_a_call(what: str) -> None:
    arguments, text = CALLS[what]
    with pytest.raises(vlmb.VlmbError) as caught:
        vlmb.simulate(PENDULUM, **arguments)
    assert text in str(caught.value), str(caught.value)


def test_in_a_result() -> None:
    run = vlmb.simulate(PENDULUM)
    for ask, text in (
        (lambda: run[5], "trajectory[5]: a name is needed, such as trajectory['energy']"),
        (lambda: run.save(None), "None: must be the path of a file, such as 'run.npz'"),
        (lambda: vlmb.load_trajectory(True), "True: must be the path of a file, such as 'run.npz'"),
        (lambda: run["psi"], "this trajectory has no 'psi'; did you mean 'psi1'"),
        (lambda: run.reactions["edge"], "this trajectory has no reaction 'edge'; valid names: none"),
        (lambda: run.position("leg", "end"), "no point 'end' of link 'leg'; links: leg; points: hinge, rod_start, rod_end, tip"),
        (lambda: run.power("M_psi1"), "'M_psi1'"),
        (lambda: run.save("run.csv"), "run.csv: save writes npz files; save_csv and `vlmb convert"),
    ):
        with pytest.raises(vlmb.TrajectoryError, match=re.escape(text)):
            ask()


@pytest.mark.parametrize("what", COMMANDS)
def test_on_the_command_line(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words, code, text = COMMANDS[what]
    monkeypatch.chdir(tmp_path)
    write_toml(tmp_path / "scene.toml", PENDULUM)
    if "run.npz" in words:
        vlmb.simulate(PENDULUM).save(tmp_path / "run.npz")
    if code == 2:
        with pytest.raises(SystemExit) as caught:
            main(words)
        assert caught.value.code == 2
    else:
        assert main(words) == code
    printed = capsys.readouterr().err
    assert text in printed and "Traceback" not in printed
