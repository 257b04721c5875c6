"""Random mechanisms and states as the arrays of the core."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vlmb.core import tree as t
from vlmb.core.tree import Array, Tree

UPRIGHT_SKI, UPRIGHT_SLIDING = -1, -2  # kinds beside those of a base: links stay in upright planes along the ski
UPRIGHT_KINDS = {UPRIGHT_SKI: t.SKI, UPRIGHT_SLIDING: t.SLIDING}
BASE_SIZES = {t.PIVOT: (0, 0), t.FREE: (3, 3), t.SKI: (3, 2), t.SLIDING: (3, 3), t.LIFTED: (4, 4)}
STIFFNESS, REST, DAMPING = 900.0, 0.25, 7.0


class Link(NamedTuple):
    """What a test chooses of a link; the rest is random."""

    parent: int = -1
    on_rod: bool = False
    lower_free: bool = True
    upper_free: bool = True
    rod_mass: bool = True
    tip_mass: bool = True


class Case(NamedTuple):
    """A mechanism in motion under forces."""

    tree: Tree
    y: Array
    given: Array
    force: Array


def make(kind: int, links: Sequence[Link], seed: int = 0, anchors: bool = True, raw: bool = False) -> Case:
    """Make a random case; with `raw`, directions have any length and rates a part along them."""
    random = np.random.default_rng(seed)
    n, upright, kind = len(links), kind in UPRIGHT_KINDS, UPRIGHT_KINDS.get(kind, kind)
    p, v = BASE_SIZES[kind]
    ints, real, given = np.zeros((n, 8), np.int64), np.zeros((n, 16)), np.zeros((n, 6))
    for i, chosen in enumerate(links):
        place = t.ROD if chosen.on_rod and chosen.parent >= 0 else t.TIP
        ints[i] = chosen.parent, place, p, v, chosen.lower_free, chosen.upper_free, False, chosen.tip_mass
        p, v = p + 3 + chosen.lower_free + chosen.upper_free, v + 3 + chosen.lower_free + chosen.upper_free
        length, mass = random.uniform(0.2, 0.6), random.uniform(0.5, 3.0) * chosen.rod_mass
        real[i, : t.TIP_MASS] = length, mass, length * random.uniform(0.2, 0.8), mass * length**2 * random.uniform(0.0, 0.1)
        real[i, t.TIP_MASS] = random.uniform(0.3, 2.0) * chosen.tip_mass
        real[i, t.K1 : t.ON_ROD] = [STIFFNESS, REST, DAMPING] * 2
        if place == t.ROD:
            real[i, t.ON_ROD] = real[chosen.parent, t.LENGTH] * random.uniform(-0.1, 1.1)
            ints[chosen.parent, t.ROD_CHILDREN] = 1
        elif chosen.parent >= 0:
            ints[chosen.parent, t.TIP_LOAD] = 1
        elif anchors and kind in (t.SKI, t.SLIDING):
            real[i, t.ANCHOR : t.ANCHOR + 3] = random.uniform(-0.5, 0.5, 3)
        given[i] = random.uniform(0.1, 0.4), *random.normal(size=2), random.uniform(0.1, 0.4), *random.normal(size=2)
    ahead = 0.0 if kind == t.LIFTED else 0.1  # there the centre of the ski, and all hinges, are at A
    base = np.array([random.uniform(1.0, 5.0), 0.6, ahead, *random.normal(size=3) * 6.0])
    y = random.normal(size=p + v)
    for row in ints:
        at, rate = row[t.AT_P], p + row[t.AT_V]
        if upright:
            y[at + 1] = y[rate + 1] = 0.0
        d = y[at : at + 3] / np.linalg.norm(y[at : at + 3])
        if not raw:
            y[rate : rate + 3] -= (y[rate : rate + 3] @ d) * d
            y[at : at + 3] = d
        free = row[t.LOWER_FREE] + row[t.UPPER_FREE]
        y[at + 3 : at + 3 + free] = random.uniform(0.1, 0.4, free)
    tree = Tree(np.array([kind, p, v, n, upright, 0]), base, ints, real)
    return Case(tree, y, given, in_plane(tree, random.normal(size=v) * 5.0))


def chain(n: int, kind: int = t.PIVOT, seed: int = 0, **changes: bool) -> Case:
    """Make a chain of links of one kind."""
    return make(kind, [Link(i - 1, **changes) for i in range(n)], seed)


def tidy(kind: int, links: Sequence[Link]) -> list[Link]:
    """Give every motion an inertia: masses where a segment is free, and none of a rod between two free ones left out."""
    made = []
    for i, link in enumerate(links):
        rod_mass = link.rod_mass or (link.lower_free and link.upper_free)
        made.append(link._replace(
            parent=min(link.parent, i - 1), rod_mass=rod_mass, tip_mass=link.tip_mass or link.upper_free or not rod_mass
        ))  # fmt: skip
    return made


def in_plane(tree: Tree, forces: Array) -> Array:
    """Take out of generalized forces (..., velocities) what would push a direction out of its upright plane."""
    forces = np.array(forces)
    if tree.shape[t.UPRIGHT]:
        forces[..., tree.link[:, t.AT_V] + 1] = 0.0
    return forces


def case_of(text: list[object]) -> Case:
    """Make a case again from what `request` kept of it."""
    kind, links, seed = text
    return make(kind, [Link(*link) for link in links], seed)  # type: ignore[arg-type, attr-defined]
