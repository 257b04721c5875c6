"""The person: links that are named after parts of a body look like one, with clothes that move with the links' own points.

Legs that are one link have knees that bend as the link gets shorter; links that stand for both legs are drawn as two; what
rides on the last link is a trunk with a head and arms. Sizes are those of a body of the links' mass and length.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.model.mechanism import Mechanism
from vlmb.model.reading import Postures
from vlmb.scene.tables import Link
from vlmb.views import appearance, shapes, walking
from vlmb.views.appearance import Look, look_of
from vlmb.views.shapes import Mesh

Array = NDArray[np.float64]

MASS = 73.0  # [kg] of a body of scale 1; what follows is in m for it
SHANK, THIGH, ANKLE = 0.4403, 0.4222, 0.10
STANCE, SHOULDER = 0.075, 0.2  # half of what lies between two legs, two shoulders
TRUNK, WIDE, DEEP = 0.132, 1.3, 0.78  # radius of a trunk, and how it is wide and flat
HEAD, NECK = 0.105, 0.05
SLACK = 1.04  # of straight legs over the longest that they get
SIDEWAYS = 0.97  # a link that points to the side more than this has no side of its own


class Part(NamedTuple):
    """What a link is drawn with, in its own frame (x along the link, y to the left, z backwards); None: nothing."""

    rod: Mesh | None
    lower: Mesh  # of unit length
    upper: Mesh
    mass: Mesh | None
    mass_colour: str
    worn: tuple[Worn, ...] = ()


class Worn(NamedTuple):
    """A piece of clothing, on a part of the link ("", "rod", "rod/mass"), on the "ski", or in the surface frame (None)."""

    on: str | None
    name: str
    shape: Mesh
    colour: str
    position: Array
    rotation: Array


class Person(NamedTuple):
    """Which links are parts of a body, its size, and the frames of these links with y to the body's left."""

    scale: float
    looks: dict[int, Look]
    left: Array  # (N, 3)
    rotations: dict[int, Array]  # (N, 3, 3)
    paired: frozenset[int]  # links that stand for both legs, or both arms
    arms: dict[int, tuple[list[Array], Array]]  # where arms that are links are worn: starts (N, 3), rotation (N, 3, 3)


def person_of(mechanism: Mechanism, seen: Postures, rotations: Array) -> Person | None:
    """Find the person in a mechanism; None where no link is a leg or a trunk."""
    links, order = mechanism.scene.links, mechanism.layout.order
    looks = {i: look for i in order if (look := look_of(links[i].name)).part}
    if not any(look.part in ("body", "legs", "limb", "trunk") for look in looks.values()):
        return None
    mass = sum(links[i].rod.mass + links[i].tip_mass for i in looks)
    standing = [i for i in looks if looks[i].part in ("legs", "limb")]
    on_ski = mechanism.layout.on_snow and not any(_sided(links[i].name) for i in standing)
    paired = frozenset(i for i in looks if _plural(links[i].name) or (on_ski and i in standing))
    tall = sum(float(np.max(seen.distance(i, "rod_end"))) for i in standing if not _sided(links[i].name))
    by_mass = (mass / MASS) ** (1.0 / 3.0)
    scale = float(np.clip(by_mass, 0.8 * tall / 0.9, 1.25 * tall / 0.9)) if tall else by_mass
    left = _left(mechanism, seen, [links[i].name for i in looks])
    turned = {i: _upright(seen.directions[:, i], left, rotations[:, i]) for i in looks if looks[i].part not in ("arm", "pole")}
    return Person(scale, looks, left, turned, paired, _arms(mechanism, seen, looks, turned, rotations, scale))


def stands_on_legs(person: Person, seen: Postures) -> bool:
    """Whether legs hang from its hips; a pelvis is where they do."""
    return any(look.part == "legs" and walking.hangs(seen, i) for i, look in person.looks.items())


def part_of(person: Person, mechanism: Mechanism, seen: Postures, i: int) -> Part | None:
    """Return what a link is drawn with; None: as a link that is no part of a body."""
    if i not in person.looks or person.looks[i].part not in MAKERS:
        return None
    return MAKERS[person.looks[i].part](person, mechanism, seen, i)


def crowns(person: Person, mechanism: Mechanism, seen: Postures) -> list[Array]:
    """Where heads (N, 3) end that stand above the last link of a body."""
    layout, found = mechanism.layout, []
    for i, look in person.looks.items():
        last = not any(layout.links[k].parent == i and person.looks[k].part in ("trunk", "neck", "head") for k in person.looks)
        if last and look.part in ("legs", "trunk", "head") and not (look.part == "legs" and walking.hangs(seen, i)):
            above = 0.13 if look.part == "head" or (mechanism.scene.links[i].tip_mass and look.part == "trunk") else 0.47
            found.append(seen.position(i, "tip") + above * person.scale * seen.directions[:, i])
    return found


def _legs(person: Person, mechanism: Mechanism, seen: Postures, i: int) -> Part:
    """Draw both legs, or one, with knees, about a strut that is the link; on the last link all that rides on it."""
    link, b = mechanism.scene.links[i], person.scale
    if walking.hangs(seen, i):
        return _hanging(person, mechanism, seen, i)
    children = [k for k in person.looks if mechanism.layout.links[k].parent == i]
    pair = i in person.paired
    strut = shapes.bellows(0.028 * b)
    hips = seen.distance(i, "tip" if children else "rod_end")
    clothes = _bent(link, hips, b, pair)
    if mechanism.layout.on_snow and mechanism.layout.links[i].parent < 0:
        clothes += (_boots(b, pair, np.asarray(mechanism.layout.links[i].anchor)),)
    pelvis = shapes.ellipsoid(0.1 * b, 1.35, 0.95)
    if children or not link.tip_mass:
        mass: Mesh | None = pelvis if link.tip_mass else None
        colour = appearance.TROUSERS
        if not link.tip_mass:
            clothes += (_worn("rod", "pelvis", pelvis, appearance.TROUSERS, (link.rod.length, 0.0, 0.0)),)
    else:
        colour = appearance.JACKET
        mass = shapes.moved(shapes.torso(0.46 * b, TRUNK * b, WIDE, DEEP), (-0.27 * b, 0.0, 0.0))
        clothes += (_worn("rod", "pelvis", pelvis, appearance.TROUSERS, (link.rod.length, 0.0, 0.0)),)
        clothes += _head("rod/mass", b, 0.36 * b) + _own_arms("rod/mass", b, 0.14 * b)
    rod = shapes.limb(link.rod.length, 0.032 * b) if link.rod.length > 0.0 else None
    waist = strut if children else shapes.bellows(0.62 * TRUNK * b, WIDE, DEEP)
    return Part(rod, strut, waist, mass, colour, clothes)


def _hanging(person: Person, mechanism: Mechanism, seen: Postures, i: int) -> Part:
    """Draw a leg that hangs from the hip, about a thin strut that is the link."""
    link, b = mechanism.scene.links[i], person.scale
    side = walking.aside(link.name, mechanism.layout.plane) * b
    reach = seen.distance(i, "tip") - walking.ANKLE * b
    thigh, shank, knee, upper, lower = walking.bent(reach, walking.whole(reach), THIGH / (SHANK + THIGH))
    hip = np.array([0.0, side, 0.0])
    tip = seen.position(i, "tip") + side * person.left
    ahead = np.cross(person.left, [0.0, 0.0, 1.0])
    flat = np.stack([ahead, person.left, np.broadcast_to([0.0, 0.0, 1.0], ahead.shape)], axis=2)
    above = shapes.join([shapes.limb(thigh, 0.072 * b), shapes.ball(0.075 * b)])
    clothes = (
        Worn("", "thigh", above, appearance.TROUSERS, np.broadcast_to(hip, knee.shape), _about_left(upper[:, 0], upper[:, 2])),
        Worn("", "shank", shapes.limb(shank, 0.05 * b), appearance.TROUSERS, hip + knee, _about_left(lower[:, 0], lower[:, 2])),
        Worn(None, f"{link.name}/shoe", walking.shoe(b), appearance.BOOTS, tip, flat),
    )
    rod = shapes.limb(link.rod.length, 0.02 * b) if link.rod.length > 0.0 else None
    strut, foot = shapes.bellows(0.018 * b), shapes.ball(0.03 * b) if link.tip_mass else None
    return Part(rod, strut, strut, foot, appearance.BOOTS, clothes)


def _bent(link: Link, hips: Array, b: float, pair: bool) -> tuple[Worn, ...]:
    """Shanks and thighs between the ankle and the hip, `hips` (N,) from the hinge, with the knee in front."""
    low = np.minimum(ANKLE * b, 0.3 * hips)
    reach = hips - low
    whole = SLACK * float(reach.max())
    shank, thigh = whole * SHANK / (SHANK + THIGH), whole * THIGH / (SHANK + THIGH)
    reach = np.clip(reach, 1.02 * abs(shank - thigh) + 1e-6, None)
    cosine = np.clip((shank**2 + reach**2 - thigh**2) / (2.0 * shank * reach), -1.0, 1.0)
    sine = np.sqrt(1.0 - cosine**2)
    zero = np.zeros(len(hips))
    ankle = np.stack([low, zero, zero], axis=1)
    knee = ankle + shank * np.stack([cosine, zero, -sine], axis=1)
    to_hip = (np.stack([hips, zero, zero], axis=1) - knee) / thigh
    lower = _paired(shapes.limb(shank, 0.05 * b), pair, b)
    upper = _paired(shapes.join([shapes.limb(thigh, 0.072 * b), shapes.ball(0.06 * b)]), pair, b)
    return (
        Worn("", "shank", lower, appearance.TROUSERS, ankle, _about_left(cosine, -sine)),
        Worn("", "thigh", upper, appearance.TROUSERS, knee, _about_left(to_hip[:, 0], to_hip[:, 2])),
    )


def _limb(person: Person, mechanism: Mechanism, seen: Postures, i: int) -> Part:
    """Draw a shin or a thigh, or both; its segments as sleeves at ankle and knee."""
    link, b, layout = mechanism.scene.links[i], person.scale, mechanism.layout
    pair = i in person.paired
    upper = re.search("thigh", link.name, re.IGNORECASE) is not None
    radius = (0.072 if upper else 0.052) * b
    rod = _paired(shapes.limb(link.rod.length, radius), pair, b) if link.rod.length > 0.0 else None
    sleeves = [_paired(shapes.bellows(share * radius), pair, b) for share in (1.02 if upper else 0.8, 0.9)]
    joint = shapes.ellipsoid(0.095 * b, 1.5, 1.0) if upper else _paired(shapes.ball(0.056 * b), pair, b)
    clothes: tuple[Worn, ...] = ()
    if layout.on_snow and layout.links[i].parent < 0:
        clothes += (_boots(b, pair, np.asarray(layout.links[i].anchor)),)
    return Part(rod, sleeves[0], sleeves[1], joint if link.tip_mass else None, appearance.TROUSERS, clothes)


def _trunk(person: Person, mechanism: Mechanism, seen: Postures, i: int) -> Part:
    """Draw a trunk, or a block of it; on the uppermost block shoulders, and what no link stands for: arms, a head."""
    link, b, layout = mechanism.scene.links[i], person.scale, mechanism.layout
    children = [k for k in person.looks if layout.links[k].parent == i]
    blocks = [person.looks[k].part for k in children]
    top = "trunk" not in blocks
    below = layout.links[i].parent >= 0 and getattr(person.looks.get(layout.links[i].parent), "part", "") == "trunk"
    length, radius = link.rod.length, TRUNK * b
    rod = None
    if length > 0.0:
        rod = (shapes.torso(length, radius, WIDE, DEEP) if top
               else shapes.barrel(length, 0.93 * radius, WIDE, DEEP))  # fmt: skip
    waist = shapes.bellows((0.9 if below else 0.8) * radius, WIDE, DEEP)
    clothes: tuple[Worn, ...] = ()
    if any(person.looks[k].part == "legs" and walking.hangs(seen, k) for k in children):
        clothes += (_worn("rod", "pelvis", shapes.ellipsoid(0.11 * b, 1.25, 0.95), appearance.TROUSERS),)
    if top and not any(part == "arm" for part in blocks):
        clothes += _own_arms("rod", b, length - 0.06 * b)
    mass, colour = None, appearance.JACKET
    if top and "head" not in blocks and "neck" not in blocks:
        if link.tip_mass:
            mass, colour = shapes.ellipsoid(HEAD * b, 0.85, 0.98), appearance.SKIN
            clothes += _helmet("rod/mass", b, 0.0)
        else:
            clothes += _head("rod", b, length + 0.17 * b)
    elif link.tip_mass:
        mass = shapes.ellipsoid((0.5 if top else 0.8) * radius, 1.2, 0.9)
    above = shapes.bellows(NECK * b) if top else shapes.bellows(0.8 * radius, WIDE, DEEP)
    return Part(rod, waist, above, mass, colour, clothes)


def _whole(person: Person, mechanism: Mechanism, seen: Postures, i: int) -> Part:
    """Draw a person on one link: legs along its lower segment where that has a length, trunk, head and arms along its rod."""
    link, b = mechanism.scene.links[i], person.scale
    trunk, hips, strut = min(link.rod.length, 0.56 * b), seen.distance(i, "rod_start"), shapes.bellows(0.028 * b)
    pelvis = shapes.ellipsoid(0.1 * b, 1.35, 0.95)
    clothes = (_worn("rod", "pelvis", pelvis, appearance.TROUSERS), *_head("rod", b, trunk + 0.17 * b))
    clothes += _own_arms("rod", b, trunk - 0.06 * b)
    if hips.max() > 0.3 * b:
        clothes += _bent(link, hips, b, True)
    if mechanism.layout.on_snow and mechanism.layout.links[i].parent < 0:
        clothes += (_boots(b, True, np.asarray(mechanism.layout.links[i].anchor)),)
    rod = shapes.torso(trunk, TRUNK * b, WIDE, DEEP) if trunk > 0.0 else None
    return Part(rod, strut, strut, shapes.ball(NECK * b) if link.tip_mass else None, appearance.SKIN, clothes)


def _neck(person: Person, mechanism: Mechanism, seen: Postures, i: int) -> Part:
    link, b = mechanism.scene.links[i], person.scale
    rod = shapes.limb(link.rod.length, NECK * b) if link.rod.length > 0.0 else None
    tube = shapes.bellows(0.9 * NECK * b)
    return Part(rod, tube, tube, shapes.ball(0.9 * NECK * b) if link.tip_mass else None, appearance.SKIN)


def _skull(person: Person, mechanism: Mechanism, seen: Postures, i: int) -> Part:
    b, middle = person.scale, 0.5 * mechanism.scene.links[i].rod.length
    head = shapes.moved(shapes.ellipsoid(HEAD * b, 0.85, 0.98), (middle, 0.0, 0.0))
    tube = shapes.bellows(0.9 * NECK * b)
    return Part(head, tube, tube, None, appearance.SKIN, _helmet("rod", b, middle))


def _arm(person: Person, mechanism: Mechanism, seen: Postures, i: int) -> Part | None:
    """Draw an arm that is a link: the link thin, and the arm beside the trunk."""
    if i not in person.arms:
        return None
    link, b = mechanism.scene.links[i], person.scale
    starts, rotation = person.arms[i]
    length = float(seen.distance(i, "tip").max())
    sleeve, glove = shapes.limb(length, 0.043 * b), shapes.moved(shapes.ball(0.05 * b), (length, 0.0, 0.0))
    clothes = []
    for k, start in enumerate(starts):
        name = link.name + "_too" * k
        clothes.append(Worn(None, name, sleeve, appearance.SLEEVES, start, rotation))
        if not any(mechanism.layout.links[child].parent == i for child in person.arms):
            clothes.append(Worn(None, f"{name}/glove", glove, appearance.BOOTS, np.zeros(3), np.eye(3)))
    thin = shapes.limb(link.rod.length, 0.02 * b) if link.rod.length > 0.0 else None
    tube = shapes.bellows(0.02 * b)
    return Part(thin, tube, tube, shapes.ball(0.03 * b) if link.tip_mass else None, appearance.SLEEVES, tuple(clothes))


MAKERS = {"body": _whole, "legs": _legs, "limb": _limb, "trunk": _trunk, "neck": _neck, "head": _skull, "arm": _arm}


def _head(on: str, b: float, height: float) -> tuple[Worn, ...]:
    neck = shapes.moved(shapes.limb(0.16 * b, NECK * b), (height - 0.2 * b, 0.0, 0.0))
    head = shapes.moved(shapes.ellipsoid(HEAD * b, 0.85, 0.98), (height, 0.0, 0.0))
    skin = _worn(on, "head", shapes.join([neck, head]), appearance.SKIN)
    return (skin, *_helmet(on, b, height))


def _helmet(on: str, b: float, height: float) -> tuple[Worn, ...]:
    """Return a helmet and goggles about a head; they show where the face is."""
    helmet = shapes.moved(shapes.ellipsoid(1.04 * HEAD * b, 0.92, 0.98), (height + 0.035 * b, 0.0, 0.02 * b))
    goggles = shapes.moved(shapes.ellipsoid(0.06 * b, 1.2, 0.65), (height + 0.005 * b, 0.0, -0.078 * b))
    return _worn(on, "helmet", helmet, appearance.HELMET), _worn(on, "goggles", goggles, appearance.GOGGLES)


def _own_arms(on: str, b: float, height: float) -> tuple[Worn, ...]:
    """Return arms of a trunk that has no links for them: a skier's, bent forwards."""
    sleeves, gloves = [], []
    for side in (1.0, -1.0):
        shoulder = np.array([height, side * SHOULDER * b, 0.0])
        elbow = shoulder + b * np.array([-0.25, 0.07 * side, -0.04])
        hand = elbow + b * np.array([-0.03, 0.0, -0.25])
        sleeves += [shapes.between(shoulder, elbow, 0.05 * b), shapes.between(elbow, hand, 0.041 * b)]
        gloves.append(shapes.moved(shapes.ball(0.05 * b), (hand[0], hand[1], hand[2])))
    return (_worn(on, "arms", shapes.join(sleeves), appearance.SLEEVES),
            _worn(on, "gloves", shapes.join(gloves), appearance.BOOTS))  # fmt: skip


def _boots(b: float, pair: bool, anchor: Array) -> Worn:
    """Return boots that stand on the ski; they point along it."""
    boot = shapes.moved(shapes.boot(0.28 * b, 0.1 * b, 0.05 * b), (-0.09 * b, 0.0, 0.0))
    if pair:
        boot = shapes.join([shapes.moved(boot, (0.0, side * 0.6 * STANCE * b, 0.0)) for side in (1.0, -1.0)])
    return Worn("ski", "boots", boot, appearance.BOOTS, anchor, np.eye(3))


def _paired(mesh: Mesh, pair: bool, b: float) -> Mesh:
    return shapes.join([shapes.moved(mesh, (0.0, side * STANCE * b, 0.0)) for side in (1.0, -1.0)]) if pair else mesh


def _worn(on: str, name: str, shape: Mesh, colour: str, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Worn:
    return Worn(on, name, shape, colour, np.array(at), np.eye(3))


def _sided(name: str) -> bool:
    return re.search(r"left|right|front|back|rear|(^|_)[lr](_|$)", name, re.IGNORECASE) is not None


def _plural(name: str) -> bool:
    return re.search(r"legs|arms|shins|shanks|thighs|calves|hands", name, re.IGNORECASE) is not None


def _left(mechanism: Mechanism, seen: Postures, names: list[str]) -> Array:
    """The body's left (N, 3): the ski's, along the board where feet stand one behind the other, else that of a walk along x."""
    heading = seen.heading + (0.5 * np.pi if not any(re.search("front", name) for name in names) else 0.0)
    return np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], axis=-1)


def _upright(along: Array, left: Array, otherwise: Array) -> Array:
    """Frames (N, 3, 3) with x along a link and y to the left; `otherwise` where the link itself points there."""
    side = np.einsum("ij,ij->i", along, left)
    if np.abs(side).max() > SIDEWAYS:
        return otherwise
    across = left - side[:, None] * along
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([along, across, np.cross(along, across)], axis=2)


def _about_left(cosine: Array, back: Array) -> Array:
    """Rotations (N, 3, 3) about y that take x to (cosine, 0, back)."""
    turned = np.zeros((len(cosine), 3, 3))
    turned[:, 0, 0] = turned[:, 2, 2] = cosine
    turned[:, 2, 0], turned[:, 0, 2], turned[:, 1, 1] = back, -back, 1.0
    return turned


def _arms(
    mechanism: Mechanism, seen: Postures, looks: dict[int, Look], turned: dict[int, Array], rotations: Array, b: float
) -> dict[int, tuple[list[Array], Array]]:
    """Where arms are worn that are links of a trunk: from its shoulder on, and never into the trunk."""
    found: dict[int, tuple[list[Array], Array]] = {}
    sides: dict[int, float] = {}
    links, layout = mechanism.scene.links, mechanism.layout
    for i in layout.order:
        parent = layout.links[i].parent
        if i not in looks or looks[i].part != "arm" or parent not in looks:
            continue
        if looks[parent].part == "trunk":
            named = re.search("right|(^|_)r(_|$)", links[i].name, re.IGNORECASE)
            taken = [sides[k] for k in sides if layout.links[k].parent == parent]
            sides[i] = -1.0 if named or (taken and taken[0] > 0.0 and not re.search("left", links[i].name)) else 1.0
            trunk = turned[parent]
            both = (sides[i], -sides[i]) if _plural(links[i].name) else (sides[i],)
            starts = [seen.position(i, "hinge") + side * SHOULDER * b * trunk[:, :, 1] for side in both]
        elif parent in found:
            sides[i] = sides[parent]
            trunk = next(turned[k] for k in _up(mechanism, parent) if k in turned)
            way = seen.distance(parent, "tip")[:, None] * found[parent][1][:, :, 0]
            starts = [start + way for start in found[parent][0]]
        else:
            continue
        along = seen.directions[:, i]
        across = trunk[:, :, 1]
        if not _plural(links[i].name):
            inwards = np.minimum(sides[i] * np.einsum("ij,ij->i", along, across) - 0.06, 0.0)
            along = along - sides[i] * inwards[:, None] * across
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        found[i] = starts, _upright(along, across, rotations[:, i])
    return found


def _up(mechanism: Mechanism, i: int) -> list[int]:
    """A link and all below it, downwards."""
    chain: list[int] = []
    while i >= 0:
        chain.append(i)
        i = mechanism.layout.links[i].parent
    return chain
