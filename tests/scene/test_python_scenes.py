"""Scenes made of the classes, changed by key path, compared, pickled and shown."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import PIVOT, SKI, link, scene
from vlmb import Base, Force, Link, Programme, Rod, Run, Segment

MODELS = Path(__file__).resolve().parents[2] / "models"


def by_hand() -> vlmb.Scene:
    legs = Link(name="legs", rod=Rod(length=0.5, mass=30), lower=Segment(length=0.25, stiffness=8e3), tip_mass=40.0)
    return vlmb.Scene(
        name="skier", base=Base(kind="ski", mass=5, inertia=0.6), links=[legs, Link(rod=Rod(length=np.float64(0.3), mass=2.0))],
        start={"psi1": 1.2, "speed": 8}, constraints=["phi1 = phi0"], forces=[Force(on="M_psi2", law=1)],
        programme=Programme(constraints=["psi1 = 1.2"], controls=["M_psi1"], frequency=5.0), run=Run(duration=0.1),
    )  # fmt: skip


AS_DATA = {
    "name": "skier", "base": {"kind": "ski", "mass": 5, "inertia": 0.6},
    "links": [
        {"name": "legs", "rod": {"length": 0.5, "mass": 30}, "lower": {"length": 0.25, "stiffness": 8e3}, "tip_mass": 40.0},
        {"rod": {"length": 0.3, "mass": 2.0}},
    ],
    "start": {"psi1": 1.2, "speed": 8}, "constraints": ["phi1 = phi0"], "forces": [{"on": "M_psi2", "law": 1}],
    "programme": {"constraints": ["psi1 = 1.2"], "controls": ["M_psi1"], "frequency": 5.0}, "run": {"duration": 0.1},
}  # fmt: skip


def test_classes_make_the_scene_that_a_dict_makes() -> None:
    made = by_hand()
    assert made == vlmb.Scene.from_dict(AS_DATA)
    assert made.to_dict() == vlmb.Scene.from_dict(AS_DATA).to_dict()
    assert [(entry.name, entry.parent) for entry in made.links] == [("legs", "base"), ("link2", "legs")]
    assert (type(made.links), type(made.base.mass), type(made.links[1].rod.length)) == (tuple, float, float)
    assert vlmb.build(made).coordinate_names == vlmb.build(AS_DATA).coordinate_names
    mixed = {**AS_DATA, "links": [by_hand().links[0], AS_DATA["links"][1]], "base": Base(kind="ski", mass=5, inertia=0.6)}
    assert vlmb.Scene.from_dict(mixed) == made.changed(links=list(made.links)) == made


def test_every_model_comes_back_from_its_classes() -> None:
    for path in sorted(MODELS.glob("*.toml")):
        made = vlmb.load_scene(path)
        parts = {name: getattr(made, name) for name in made.__struct_fields__}
        assert vlmb.Scene(**parts) == made, path


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({"base": Base(kind="ground")}, "base.kind = 'ground': allowed: pivot, ski, free"),
        ({"base": Base(kind="ski")}, "base: a ski needs mass > 0"),
        ({"base": 3}, "base = 3"),
        ({"links": []}, "links: a 'pivot' base needs at least one link"),
        ({"links": Link(rod=Rod(length=1.0, mass=1.0))}, "links"),
        ({"links": [Link(rod=Rod(length=1.0, mass=-1.0))]}, r"links\[0\].rod.mass = -1.0"),
        ({"links": [Link(rod=Rod(length=1.0, mass=float("nan")))]}, r"links\[0\].rod.mass = nan: must be a finite number"),
        ({"links": [Link(rod=Rod(length=1.0, mass=1.0), lower=Segment())]}, r"links\[0\].lower.length: a free segment needs"),
        ({"links": [Link(rod=Segment(length=1.0))]}, r"links\[0\].rod"),
        ({"links": [Link(rod=Rod(length=1.0, mass=1.0), parent="arm")]}, r"links\[0\].parent = 'arm': no such link"),
        ({"links": [Link(rod=Rod(length=1.0, mass=1.0), name="a b")]}, r"links\[0\].name = 'a b'"),
        ({"links": [Link(rod=Rod(length="2*L", mass=1.0))]}, r"links\[0\].rod.length = '2\*L': unknown name 'L'"),
        ({"run": Run(method="rk5")}, "run.method = 'rk5'"),
        ({"forces": [Force(on="M_psi1")]}, r"forces\[0\]"),
        ({"start": None}, "start = None"),
        ({"gravity": object()}, "gravity"),
    ],
)
def test_no_invalid_scene_can_be_made(keys: dict[str, Any], text: str) -> None:
    parts = {"base": Base(kind="pivot"), "links": [Link(rod=Rod(length=1.0, mass=1.0))]} | keys
    with pytest.raises(vlmb.SceneError, match=text) as caught:
        vlmb.Scene(**parts)
    with pytest.raises(vlmb.SceneError) as again:
        vlmb.Scene.from_dict(parts, "scene")
    assert str(again.value) == f"scene: {caught.value}"


def test_equality_hash_copies_and_pickles() -> None:
    made, other = by_hand(), by_hand().changed(gravity=9.8)
    assert len({made, by_hand(), other}) == 2
    assert {made: 1}[vlmb.Scene.from_dict(AS_DATA)] == 1
    assert made != other and made != 3
    for again in (pickle.loads(pickle.dumps(made)), copy.copy(made), copy.deepcopy(made)):  # noqa: S301
        assert again == made and hash(again) == hash(made)
    full = [vlmb.load_scene(path) for path in sorted(MODELS.glob("*.toml"))]
    assert len(set(full)) == len(full)


def test_a_repr_is_short_and_names_what_is_in_a_scene() -> None:
    text = repr(by_hand().changed(constraints=["lean: phi1 = phi0"]))
    assert text == (
        "<Scene 'skier': ski base; links (coordinates) legs (3), link2 (2); ideal rows lean; programme psi1 = 1.2; "
        "controls M_psi1; 1 force>"
    )
    for path in sorted(MODELS.glob("*.toml")):
        made = vlmb.load_scene(path)
        base = len(vlmb.build(made).coordinate_names) - sum(made._coordinates_of(entry) for entry in made.links)
        assert base == len(vlmb.build(made).layout.names) - len([c for c in vlmb.build(made).layout.coordinates if c.link >= 0])
        assert len(repr(made)) < 450
    assert "... (50)" in repr(scene(PIVOT, 50))


# Changes by key path ---------------------------------------------------------------------------------------------------


def test_changes_by_key_path() -> None:
    made = by_hand()
    changed = made.changed_at({
        "links.legs.lower.stiffness": 1e4, "start.speed": 7.0, "start.phi0": 0.1, "run.rtol": 1e-9, "base.mass": 4,
        "forces.0.law": "20*sin(t)", "links[1].rod.mass": 3.0, "programme.frequency": 2.0, "constraints.0": "lean: phi1 = phi0",
        "links.link2.tip_mass": 1.0, "links.0.upper.length": 0.1, "name": "changed", "links.legs.lower.limits": [0.0, 2.0],
    })  # fmt: skip
    legs, second = changed.links
    assert (legs.lower.stiffness, legs.lower.length, legs.lower.limits) == (1e4, 0.25, (0.0, 2.0))
    assert (legs.upper.length, legs.upper.motion) == (0.1, "fixed")
    assert (second.rod.mass, second.tip_mass) == (3.0, 1.0)
    assert (changed.start, changed.run.rtol, changed.run.duration) == ({"psi1": 1.2, "speed": 7.0, "phi0": 0.1}, 1e-9, 0.1)
    assert (changed.base.mass, changed.base.inertia, changed.forces[0].law) == (4.0, 0.6, "20*sin(t)")
    assert (changed.programme.frequency, changed.constraints, changed.name) == (2.0, ("lean: phi1 = phi0",), "changed")
    assert made == by_hand()
    assert made.changed_at({}) == made
    assert changed.changed_at({"links.legs.lower.limits.1": 3.0}).links[0].lower.limits == (0.0, 3.0)
    assert made.changed_at({"programme": None, "start.speed": None}).start == {"psi1": 1.2}


@pytest.mark.parametrize(
    ("key", "value", "texts"),
    [
        ("links.leg.lower.stiffness", 1.0, ("links.leg.lower.stiffness", "'leg'", "did you mean 'legs'")),
        ("links.7.lower.stiffness", 1.0, ("links has 2 entries",)),
        ("links.legs.lower.stifness", 1.0, ("links.legs.lower has no key 'stifness'", "did you mean 'stiffness'")),
        ("link.legs.tip_mass", 1.0, ("a scene has no key 'link'", "'links'")),
        ("parameters.kk", 1.0, ("parameters.kk: no such parameter", "valid names: A")),
        ("forces.0.lw", 1.0, ("forces.0 has no key 'lw'", "'law'")),
        ("forces.x.law", 1.0, ("forces.x.law: forces has no 'x'",)),
        ("gravity.x", 1.0, ("gravity is no table and no list",)),
        ("programme.frequency", 1.0, ("this scene has no programme",)),
        ("links.legs.lower.limits.0", 1.0, ("this scene has no links.legs.lower.limits",)),
        ("", 1.0, ("a scene has no key ''",)),
        ("links.legs.rod.mass", -1.0, ("changed scene: links[0].rod.mass = -1.0",)),
        ("links.legs.rod.mass", "heavy", ("changed scene: links[0].rod.mass = 'heavy'", "unknown name")),
        ("base.mass", None, ("changed scene: base: a ski needs mass",)),
        (3, 1.0, ("3 is no key path",)),
    ],
)
def test_key_paths_that_lead_nowhere(key: Any, value: Any, texts: tuple[str, ...]) -> None:
    made = by_hand().changed(programme=None, parameters={"A": 1.0})
    with pytest.raises(vlmb.SceneError) as caught:
        made.changed_at({key: value})
    for text in texts:
        assert text in str(caught.value)


def test_names_with_dots_in_the_start_are_one_key() -> None:
    assert scene(PIVOT, [link("legs")]).changed_at({"start.legs.lower": 0.3}).start == {"legs.lower": 0.3}
    with pytest.raises(vlmb.SceneError, match="must be a dict of key paths"):
        scene(SKI, 1).changed_at([("gravity", 1.0)])


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path: Path) -> None:
    text = 'name = "x"\n[base]\nkind = "ski"\nmass = 5.0\ninertia = 0.6\n'
    (tmp_path / "plain.toml").write_bytes(text.encode())
    (tmp_path / "marked.toml").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert vlmb.load_scene(tmp_path / "marked.toml") == vlmb.load_scene(tmp_path / "plain.toml")
