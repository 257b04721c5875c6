"""Scenes whose links stand on anchors and hang anywhere along rods, for tests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tests.small_scenes import PIVOT, SKI, Table

BASES: dict[str, Table] = {"pivot": PIVOT, "ski": SKI}


def anchored(base: str, seed: int = 0, **keys: Any) -> Table:
    """A tree on three anchors, its links at tips, ends of rods, and at distances along links whose lower segment is fixed."""
    random = np.random.default_rng([seed, len(base)])

    def segment(free: bool) -> Table:
        length = float(random.uniform(0.1, 0.4))
        if not free:
            return {"length": length, "motion": "fixed"}
        return {"length": length, "stiffness": 900.0, "damping": 7.0, "limits": [-math.inf, math.inf]}

    def link(name: str, lower: bool, upper: bool, **where: Any) -> Table:
        length, mass = float(random.uniform(0.3, 0.7)), float(random.uniform(1.0, 3.0))
        rod = {"length": length, "mass": mass, "com": 0.4 * length, "inertia": 0.05 * mass * length**2}
        tip_mass = float(random.uniform(0.5, 2.0))
        return {"name": name, "rod": rod, "lower": segment(lower), "upper": segment(upper), "tip_mass": tip_mass, **where}

    places = [[float(number) for number in random.uniform(-0.5, 0.5, 3)] for _ in range(2)]
    front = link("front", True, True, parent="base", anchor=places[0])
    back = link("back", False, True, parent="base", anchor=places[1])
    post = link("post", False, False, parent="base")
    reach = back["lower"]["length"]
    top = post["lower"]["length"] + post["rod"]["length"] + 0.5 * post["upper"]["length"]
    links = [
        front,
        link("knee", True, False, parent="front"),
        back,
        link("low", True, True, parent="back", parent_point=0.3 * reach),
        link("side", True, True, parent="back", parent_point=reach + 0.6 * back["rod"]["length"]),
        link("hip", True, False, parent="back", parent_point="tip"),
        post,
        link("flag", True, True, parent="post", parent_point=top),
    ]
    return {"base": BASES[base], "links": links, "slope": 0.2, **keys}
