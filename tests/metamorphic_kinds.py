"""Random scenes of kinds of their own for tests/metamorphic.py: contacts, singular starts, programmes with controls to spare."""

from __future__ import annotations

import math

import numpy as np

from tests.metamorphic import DURATION, TIGHT, Scene, Words, make, ordered


def contacts(seed: int, words: Words) -> Scene:
    """Links on a free base that are thrown at the ground: they bounce, slip or stay."""
    dice = np.random.default_rng([seed, 3])
    big, heavy, slow = words.length, words.mass, words.time
    plane, count, c, s = bool(dice.random() < 0.5), int(dice.integers(1, 3)), math.cos(words.turn), math.sin(words.turn)
    along, aside, down = float(dice.uniform(-1.0, 1.0)), 0.0 if plane else float(dice.uniform(-1.0, 1.0)), 0.3
    links, feet, start = [], [], {"z": 1.0 * big, "z_dot": -down * big / slow}
    start["x_dot"] = (c * along - s * words.mirror * aside) * big / slow
    if not plane:
        start["y_dot"] = (s * along + c * words.mirror * aside) * big / slow
    for name in "ab"[:count]:
        length, mass = dice.uniform(0.6, 0.85), dice.uniform(0.5, 2.0)
        links.append({
            "name": name, "parent": "base", "rod": {"length": float(length) * big, "mass": float(mass) * heavy},
            "tip_mass": 0.2 * heavy,
        })  # fmt: skip
        start[f"{name}.elevation"] = -0.5 * math.pi + float(dice.uniform(0.2, 0.6)) * (1.0 if name == "a" else -1.0)
        start[f"{name}.elevation_dot"] = float(dice.uniform(-1.0, 1.0)) / slow
        if not plane:
            start[f"{name}.azimuth"] = words.mirror * float(dice.uniform(-1.0, 1.0)) + words.turn
            start[f"{name}.azimuth_dot"] = words.mirror * float(dice.uniform(-1.0, 1.0)) / slow
        friction: float | str = [0.0, 0.3, 0.8, "rough"][int(dice.integers(4))]
        bouncing = 0.4 if friction == 0.0 and count == 1 else 0.0
        feet.append({"name": f"foot_{name}", "point": f"{name}.tip", "friction": friction, "restitution": bouncing})
    start["a.elevation"] += words.nudge
    scene: Scene = {
        "plane": plane, "base": {"kind": "free", "mass": 1.5 * heavy}, "links": ordered(links, words.order), "contacts": feet,
        "start": start, "gravity": 9.81,
    }  # fmt: skip
    return _run(scene, words)


def singular(seed: int, words: Words) -> Scene:
    """A parallelogram that starts in line, where its rows lose their independence; its rates tell the branch."""
    dice = np.random.default_rng([seed, 4])
    big, heavy, slow = words.length, words.mass, words.time
    bar, coupler = dice.uniform(0.6, 1.2, 2).tolist()
    mass = dice.uniform(0.5, 2.0, 3).tolist()
    rate = float(dice.choice([-1.0, 1.0]) * dice.uniform(1.5, 4.0)) / slow + words.nudge / slow
    length = {"p0": bar, "c1": coupler, "p1": bar}
    links = [
        {"name": name, "parent": parent, "rod": {"length": length[name] * big, "mass": mass[k] * heavy}}
        for k, (name, parent) in enumerate((("p0", "base"), ("c1", "p0"), ("p1", "base")))
    ]
    links[2]["anchor"] = [coupler * big, 0.0, 0.0]
    rates = {"p0.elevation_dot": rate, "p1.elevation_dot": rate, "c1.elevation_dot": 0.0}
    scene: Scene = {
        "plane": True, "base": {"kind": "pivot"}, "links": ordered(links, words.order), "gravity": 9.81,
        "start": rates | {f"{name}.elevation": 0.0 for name in length},
        "constraints": [f"c1.tip.{axis} = p1.tip.{axis}" for axis in "xz"],
    }  # fmt: skip
    return _run(scene, words)


def spared(seed: int, words: Words) -> Scene:
    """Three links under a programme of one row: two controls and the free scalar, or three and a row of the border."""
    dice = np.random.default_rng([seed, 5])
    big, heavy, slow = words.length, words.mass, words.time
    bordered, torque, inertia = bool(dice.random() < 0.5), heavy * big, heavy * big**2
    links, start = [], {}
    for k, name in enumerate("abc"):
        length, mass = dice.uniform([0.3, 0.5], [0.7, 2.0]).tolist()
        parent = "base" if not k else "abc"[int(dice.integers(0, k))]
        links.append({"name": name, "parent": parent, "rod": {"length": length * big, "mass": mass * heavy}})
        start |= {f"{name}.elevation": float(dice.uniform(-1.0, 1.0)), f"{name}.elevation_dot": float(dice.uniform(-1, 1)) / slow}
        start |= {f"{name}.azimuth": words.mirror * float(dice.uniform(-1.0, 1.0)) + words.turn}
    first, at = start["a.elevation"], f"(t - {words.shift!r})/{slow!r}"
    start["b.elevation"] += words.nudge
    listed = ordered(links, words.order)
    number = {link["name"]: k for k, link in enumerate(listed, 1)}
    used = "abc" if bordered else "ab"
    programme: Scene = {
        "constraints": [f"a.elevation = {first - 0.05!r} + 0.2*sin(2*{at})"], "controls": [f"M_psi{number[n]}" for n in used],
        "frequency": 4.0 / slow, "u0": f"{0.005 * torque * inertia!r}*(sin(3*{at}) + b.elevation)",
    }  # fmt: skip
    if bordered:
        programme["border"] = [[round(float(entry), 2) for entry in dice.uniform(-1.0, 1.0, 2)] + ["0.5*cos(b.elevation)"]]
    scene: Scene = {
        "plane": False, "base": {"kind": "pivot"}, "links": listed, "start": start, "programme": programme, "gravity": 9.81,
    }  # fmt: skip
    return _run(scene, words)


def _run(scene: Scene, words: Words) -> Scene:
    slow = words.time
    options = {"gain": 5.0 / slow, "duration": DURATION * slow, "samples": 60.0 / slow, **TIGHT, **dict(words.run), "fall": False}
    options["atol"] *= min(1.0, words.length)
    return {**scene, "run": options}


KINDS = {
    "every kind of base, link and force": make, "contacts": contacts, "singular starts": singular, "controls to spare": spared,
}  # fmt: skip
