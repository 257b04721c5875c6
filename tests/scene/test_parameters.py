"""Numbers of a scene that are expressions of its parameters."""

from __future__ import annotations

import copy
import json
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import PIVOT, SKI, Table, link, table
from vlmb.scene.written import Written, as_numbers

PARAMETERS = {"k": 1000.0, "double": "2*k", "L": 0.3, "V": "sqrt(16)", "tilt": "pi/30"}
WRITTEN = table(
    {**SKI, "mass": "10*L"},
    [
        link("legs", rod={"length": "2*L", "mass": 3.0}, lower={"length": "L", "stiffness": "double", "limits": ["L/10", "4*L"]}),
        link("trunk", upper={"length": "L/2", "motion": "fixed"}, tip_mass="k/500"),
    ],
    slope="tilt", start={"speed": "V", "psi1": "pi/2 - 0.1"}, parameters=PARAMETERS,
    forces=[{"between": ["legs", "trunk"], "stiffness": "0.1*k", "rest": "tilt"}, {"on": "M_psi2", "law": "k*sin(t)"}],
    programme={
        "constraints": ["phi1 = phi0", "phi2 = phi0"], "controls": ["M_phi1", "M_phi2"], "frequency": ["V", 5.0],
        "h": None, "weights": {"M_phi1": "1/k"},
    },
    run={"duration": "L", "rtol": 1e-9},
)  # fmt: skip
PLAIN = table(
    {**SKI, "mass": 3.0},
    [
        link("legs", lower={"length": 0.3, "stiffness": 2000.0, "limits": [0.03, 1.2]}, rod={"length": 0.6, "mass": 3.0}),
        link("trunk", upper={"length": 0.15, "motion": "fixed"}, tip_mass=2.0),
    ],
    slope=math.pi / 30, start={"speed": 4.0, "psi1": math.pi / 2 - 0.1},
    parameters={"k": 1000.0, "double": 2000.0, "L": 0.3, "V": 4.0, "tilt": math.pi / 30},
    forces=[{"between": ["legs", "trunk"], "stiffness": 100.0, "rest": math.pi / 30}, {"on": "M_psi2", "law": "k*sin(t)"}],
    programme={
        "constraints": ["phi1 = phi0", "phi2 = phi0"], "controls": ["M_phi1", "M_phi2"], "frequency": [4.0, 5.0],
        "weights": {"M_phi1": "1/k"},  # may see the motion, so it stays as it is written
    },
    run={"duration": 0.3, "rtol": 1e-9},
)  # fmt: skip


def same(a: Any, b: Any) -> bool:
    """Equal data, numbers to rounding."""
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[name], b[name]) for name in a)
    if isinstance(a, (list, tuple)):
        return isinstance(b, (list, tuple)) and len(a) == len(b) and all(map(same, a, b))
    return bool(np.isclose(a, b, rtol=1e-14)) if isinstance(a, float) else bool(a == b)


def refused(**keys: Any) -> str:
    with pytest.raises(vlmb.SceneError) as caught:
        vlmb.Scene.from_dict(table(PIVOT, **keys), "file.toml")
    assert str(caught.value).startswith("file.toml: ")
    return str(caught.value)


def test_a_scene_holds_the_values() -> None:
    made = vlmb.Scene.from_dict(WRITTEN)
    assert same(as_numbers(made), vlmb.Scene.from_dict(PLAIN).to_dict())
    assert made.links[0].lower.stiffness == 2000.0
    assert made.links[0].lower.bounds == pytest.approx((0.03, 1.2))
    assert made.links[1].parent == "legs"


def test_the_text_stays_as_it_was_written() -> None:
    made = vlmb.Scene.from_dict(WRITTEN)
    data = made.to_dict()
    assert data["links"][0]["lower"] == {"length": "L", "stiffness": "double", "limits": ("L/10", "4*L")}
    assert (data["slope"], data["start"]["speed"], data["parameters"]) == ("tilt", "V", PARAMETERS)
    assert vlmb.Scene.from_dict(data) == made == pickle.loads(pickle.dumps(made)) == copy.deepcopy(made)  # noqa: S301
    assert pickle.loads(pickle.dumps(made)).to_dict() == data  # noqa: S301
    assert hash(vlmb.Scene.from_dict(data)) == hash(made)
    assert made != vlmb.Scene.from_dict(PLAIN)  # what a parameter reaches is another scene


def test_a_changed_parameter_reaches_what_is_written_with_it() -> None:
    made = vlmb.Scene.from_dict(WRITTEN)
    stiffer = made.changed(parameters={"k": 2e4})
    assert (stiffer.links[0].lower.stiffness, stiffer.links[1].tip_mass, stiffer.forces[0].stiffness) == (4e4, 40.0, 2000.0)
    assert stiffer.changed_at({"parameters.k": 1000}) == made
    fixed = made.changed_at({"links.legs.lower.stiffness": 7.0}).changed(parameters={"k": 1.0})
    assert (fixed.links[0].lower.stiffness, fixed.parameters["double"]) == (7.0, 2.0)
    other = vlmb.Scene(base=vlmb.Base(kind="pivot"), links=made.links[:1], parameters={"L": 0.5, "double": 3.0})
    assert (other.links[0].rod.length, other.links[0].lower.stiffness) == (1.0, 3.0)


def test_the_motion_is_that_of_the_numbers(tmp_path: Path) -> None:
    written, plain = vlmb.simulate(WRITTEN), vlmb.simulate(PLAIN)
    assert written.message == plain.message and written.t.size > 10
    assert np.abs(written.q - plain.q).max() < 1e-9
    again = vlmb.load_trajectory(written.save(tmp_path / "run.npz"))
    assert again.scene == written.scene
    assert again.scene.to_dict()["start"]["speed"] == "V"
    assert (again.run, type(again.run.duration)) == (written.run, float)


def test_arguments_may_be_expressions_too() -> None:
    run = vlmb.simulate(table(PIVOT, 1, start={"psi1": 0.3}, parameters={"T": 0.01}), duration="2*T")
    assert run.t[-1] == 0.02


UNKNOWN: dict[str, tuple[Table, tuple[str, ...]]] = {
    "nothing near": (
        {"start": {"psi1": "up"}},
        ("start.psi1 = 'up'", "unknown name 'up'", "a number is needed, or an expression of parameters; this scene has none"),
    ),
    "near": ({"start": {"psi1": "tlt"}, "parameters": {"tilt": 1.0}}, ("start.psi1 = 'tlt'", "did you mean 'tilt'?")),
    "in a link": (
        {"links": [link("a", lower={"length": "L", "motion": "fixed"})], "parameters": {"l": 0.2}},
        ("links[0].lower.length = 'L'", "valid names: l"),
    ),
    "in a parameter": ({"parameters": {"a": "2*b"}}, ("parameters.a = '2*b'", "'b'")),
    "of the motion": ({"gravity": "psi1", "parameters": {"g": 9.0}}, ("gravity = 'psi1'", "'psi1'", "valid names: g")),
    "time": ({"gravity": "9.81 + t"}, ("gravity", "unknown name 't'")),
    "a ring": ({"parameters": {"a": "2*b", "b": "c + 1", "c": "a"}}, ("parameters: ", "a -> ", "ring")),
    "itself": ({"parameters": {"a": "a + 1"}}, ("parameters: a -> a", "ring")),
    "no value": ({"parameters": {"a": 0.0}, "gravity": "1/a"}, ("gravity = '1/a'", "at a = 0.0")),
    "no expression": ({"gravity": "9.81 m/s"}, ("gravity = '9.81 m/s'", "not an expression")),
    "a force": ({"gravity": "M_psi1"}, ("gravity = 'M_psi1'", "unknown name")),
    "of what is no number": ({"parameters": {"a": [1.0], "b": "a"}}, ("parameters.a = [1.0]", "number")),
}


@pytest.mark.parametrize("case", UNKNOWN)
def test_what_has_no_value_is_named(case: str) -> None:
    keys, texts = UNKNOWN[case]
    message = refused(**keys)
    for text in texts:
        assert text in message


def test_bounds_hold_for_the_values() -> None:
    negative = refused(links=[link("a", rod={"length": 0.5, "mass": "m - 3"})], parameters={"m": 1.0})
    assert "links[0].rod.mass = 'm - 3' = -2.0" in negative and ">= 0" in negative
    outside = refused(links=[link("a", lower={"length": "L", "limits": [0.1, 0.2]})], parameters={"L": 0.5})
    assert "links[0].lower.length" in outside and "0.5 is outside limits [0.1, 0.2]" in outside and "'L' = 0.5" in outside
    assert "gravity = 'g*g' = 1e+60: between" in refused(gravity="g*g", parameters={"g": 1e30})
    assert "parameters.g = '1e30*1e30' = 1e+60: between" in refused(parameters={"g": "1e30*1e30"})


def test_texts_stay_texts() -> None:
    """A parameter may have the name of a link, a kind or a method: where a text is meant nothing is looked up."""
    made = vlmb.Scene.from_dict(table(
        PIVOT, [link("a", lower={"motion": "prescribed", "law": "0.3 + 0*rk4"})], name="rk4", parameters={"rk4": 1.0, "a": 2.0},
        run={"method": "rk4"}, expect={"text": "a"},
    ))  # fmt: skip
    assert (made.name, made.run.method, made.links[0].name, made.expect) == ("rk4", "rk4", "a", {"text": "a"})
    assert made.links[0].lower.law == "0.3 + 0*rk4"


def test_a_written_number_is_a_float() -> None:
    number = Written(2.5, "2*L + 0.1")
    assert (number + 1.0, np.array([number]).dtype, json.dumps(number), f"{number:g}") == (3.5, np.float64, "2.5", "2.5")
    assert (pickle.loads(pickle.dumps(number)).text, copy.copy(number).text) == (number.text, number.text)  # noqa: S301
