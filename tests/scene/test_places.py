"""Anchors and numeric places along a parent: what a scene may say, and what is refused by name."""

from __future__ import annotations

from typing import Any

import pytest

import vlmb
from tests.small_scenes import FIXED, FLYING, PIVOT, SKI, Table, link, table

FREE = {"length": 0.3}
LAW = {"motion": "prescribed", "law": "0.3 + 0.1*sin(t)"}


def hung(point: Any, **parent: Any) -> Table:
    """A link `arm` at a place of a link `trunk`, whose rod is 0.5 m long behind a fixed segment of 0.2 m."""
    return table(PIVOT, [link("trunk", **{"lower": FIXED, "upper": FIXED} | parent), link("arm", parent_point=point)])


REFUSED: dict[str, tuple[Table, tuple[str, ...]]] = {
    "anchor on a free base": (
        table(FLYING, [link("leg", anchor=[0.1, 0.0, 0.0])]), ("links[0].anchor", "free base is a point", "'leg'", "parent_point")
    ),
    "anchor on a link": (
        table(PIVOT, [link("leg"), link("arm", anchor=[0.1, 0.0, 0.0])]),
        ("links[1].anchor", "'arm' hangs on 'leg'", "parent = 'base'"),
    ),
    "aside on a base": (table(PIVOT, [link("leg", aside=0.1)], plane=True), ("links[0].aside", "a part of `anchor`")),
    "aside in space": (table(PIVOT, [link("leg"), link("arm", aside=0.1)]), ("links[1].aside", "a plane that does not turn")),
    "aside on a ski": (table(SKI, [link("leg"), link("arm", aside=0.1)], plane=True), ("links[1].aside", "pivot or a free base")),
    "anchor of two numbers": (table(SKI, [link("leg", anchor=[0.1, 0.0])]), ("links[0].anchor", "length 3")),
    "anchor with a text": (table(SKI, [link("leg", anchor=[0.1, "wide", 0.0])]), ("links[0].anchor[1]", "'wide'")),
    "anchor that is not finite": (table(SKI, [link("leg", anchor=[float("nan"), 0.0, 0.0])]), ("links[0].anchor[0]", "finite")),
    "a distance along a ski": (
        table(SKI, [link("leg", parent_point=0.2)]), ("links[0].parent_point", "anchor = [ahead, left, up]")
    ),
    "a distance along the ground": (
        table(PIVOT, [link("leg", parent_point=0.2)]), ("links[0].parent_point", "anchor = [x, y, z]")
    ),
    "a distance along a free base": (table(FLYING, [link("leg", parent_point=0.2)]), ("links[0].parent_point", "remove it")),
    "beyond the tip": (hung(0.91), ("links[1].parent_point", "0.91 m", "'trunk'", "0 to 0.9 m")),
    "before the hinge": (hung(-0.01), ("links[1].parent_point", "-0.01 m", "0 to 0.9 m")),
    "on a free upper segment": (hung(0.75, upper=FREE), ("links[1].parent_point", "ends at 0.7 m", "free segment", "'tip'")),
    "on a prescribed upper segment": (hung(0.75, upper=LAW), ("links[1].parent_point", "prescribed segment", "'tip'")),
    "behind a free lower segment": (
        hung(0.4, lower=FREE), ("links[1].parent_point", "lower segment of 'trunk' is free", "'rod_start', 'rod_end' or 'tip'")
    ),
    "behind a prescribed lower segment": (
        hung(0.4, lower=LAW), ("links[1].parent_point", "lower segment of 'trunk' is prescribed")
    ),
    "a wrong word": (hung("knee"), ("links[1].parent_point", "'knee'", "tip, rod_start, rod_end, or a number")),
    "an unknown parameter": (hung("2*L"), ("links[1].parent_point", "'L'")),
    "an engine": (table(run={"engine": "casadi"}), ("run.engine", "'casadi'", "auto, core, pinocchio")),
    "no longest step": (table(run={"max_step": 0.0}), ("run.max_step", "> 0")),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_places_that_mean_nothing(case: str) -> None:
    data, texts = REFUSED[case]
    with pytest.raises(vlmb.SceneError) as caught:
        vlmb.Scene.from_dict(data)
    for text in texts:
        assert text in str(caught.value)


@pytest.mark.parametrize("point", [0, 0.1, 0.2, 0.45, 0.7, 0.9, "tip", "rod_start", "rod_end"])
def test_places_on_a_link(point: Any) -> None:
    scene = vlmb.Scene.from_dict(hung(point))
    assert scene.links[1].parent_point == point
    assert vlmb.Scene.from_dict(scene.to_dict()) == scene


def test_places_and_anchors_may_be_expressions() -> None:
    links = [link("trunk", lower=FIXED, anchor=["wide", 0.0, "-wide/2"]), link("arm", parent_point="2*wide")]
    scene = vlmb.Scene.from_dict(table(SKI, links, parameters={"wide": 0.2, "tip": 0.3}))
    assert scene.links[0].anchor == (0.2, 0.0, -0.1) and scene.links[1].parent_point == 0.4
    assert scene.to_dict()["links"][0]["anchor"] == ("wide", 0.0, "-wide/2")
    wider = scene.changed_at({"parameters.wide": 0.3, "links.trunk.anchor.1": 0.05})
    assert wider.links[0].anchor == (0.3, 0.05, -0.15) and wider.links[1].parent_point == pytest.approx(0.6)
    assert scene.changed_at({"links.arm.parent_point": "tip"}).links[1].parent_point == "tip"  # a word, not the parameter
    with pytest.raises(vlmb.SceneError, match=r"links\.arm\.parent_point is no table"):
        scene.changed_at({"links.arm.parent_point.x": 0.3})


def test_an_argument_overrides_the_run() -> None:
    run = vlmb.simulate(table(PIVOT, 1, start={"psi1": 0.3}), duration=0.1, engine="auto", max_step=0.05).run
    assert run.engine == "auto" and run.max_step == 0.05
    with pytest.raises(vlmb.SceneError, match=r"run\.engine = 'fast': allowed: auto, core, pinocchio"):
        vlmb.simulate(table(PIVOT, 1), engine="fast")
