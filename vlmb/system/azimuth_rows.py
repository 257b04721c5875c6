"""Ideal rows that say what an azimuth is, in a form that has no pole.

    c (s_1 phi_1 + s_2 phi_2) + g = 0,    s = 1 or -1:    c cos psi_1 cos psi_2 sin(s_1 phi_1 + s_2 phi_2 + g/c) = 0

through the components of the directions on the snow, so that a link passes the vertical in the plane that the row gives it. Its
gradient there is the one of the direction across that plane. Both forms say the same where the links are off the vertical.

Of two links the one that stands upright does not tell the plane of the other. So an azimuth that one row gives is put into the
others: `phi1 = 0.3*t` makes `phi2 = phi1` the row `phi2 = 0.3*t`. The new row is r_m - f r_k, and its multiplier counts for both.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce

from vlmb.model.mechanism import Mechanism
from vlmb.scene.expressions import Equation, Expression, Tree, walk

AT_MOST = 2  # links: a row of more loses its slope where several stand upright
DIGITS = 12  # of factors that count as equal
Plane = tuple[Tree, Tree]  # a complex number: its real and its imaginary part


@dataclass(frozen=True)
class AzimuthRow:
    """An equation c (s_1 phi_1 + ...) + g = 0; and the row that holds it: c s by azimuth, g, and how much of which rows it is."""

    equation: Equation = field(repr=False)  # as it is written
    azimuths: dict[str, float]  # s of those that the equation names, a heading among them
    factor: float  # c
    links: dict[str, float]
    rest: tuple[Tree, ...]
    parts: dict[int, float]  # shares of rows, by number
    timed: frozenset[int]  # which of them move with time

    @property
    def names(self) -> frozenset[str]:
        """What g goes by."""
        return frozenset[str]().union(*map(_names, self.rest))


def azimuth_row(mechanism: Mechanism, equation: Equation, number: int) -> AzimuthRow | None:
    """Return what an equation such as `phi1 = 0.3*t`, `phi1 = phi0` or `phi1 - phi2 = x` says; None for any other."""
    links: dict[str, float] = {}
    headings: dict[str, float] = {}
    rest: list[Tree] = []
    for factor, tree in (*_terms(equation.left.tree, 1.0), *_terms(equation.right.tree, -1.0)):
        name = _azimuth(mechanism, tree)
        if name and name != "phi0":
            links[name] = links.get(name, 0.0) + factor
        else:
            headings |= {name: factor} if name else {}
            rest.append(_times(factor, tree))
    scale = next((abs(factor) for factor in links.values()), 0.0)
    if not 0 < len(links) <= AT_MOST or scale == 0.0 or any(abs(factor) != scale for factor in links.values()):
        return None
    named = frozenset[str]().union(*map(_names, rest))
    known = [mechanism.names.find(name) for name in named if name in mechanism.names]
    if any(found.rate or found.kind == "leg" or found.name in links for found in known):
        return None
    moves = frozenset({number}) if named & {"t", *mechanism.signals} else frozenset[int]()
    signs = {name: factor / scale for name, factor in (links | headings).items() if abs(factor) == scale}
    return AzimuthRow(equation, signs, scale, links, tuple(rest), {number: 1.0}, moves)


def with_given_azimuths(mechanism: Mechanism, rows: Sequence[AzimuthRow | None]) -> list[AzimuthRow | None]:
    """Put azimuths that rows give into rows of two links, but for those whose work would then be of two rows.

    A second row that gives an azimuth, and not by the same terms, stays as it is written: both would hold for an upright link.
    """
    found, again = list(rows), True
    while again:
        again = False
        for m, row in enumerate(found):
            if row is None or len(row.links) == 1:
                continue
            for other in found:
                name = next(iter(other.links)) if other is not None and len(other.links) == 1 else ""
                if other is None or name not in row.links or len(row.timed | other.timed) > 1:
                    continue
                kept = {link: factor for link, factor in row.links.items() if link != name}
                read = {mechanism.names.find(read).name for read in other.names if read in mechanism.names}
                if read & kept.keys():
                    continue
                share = -row.links[name] / other.links[name]
                rest = (*row.rest, *(_times(share, tree) for tree in other.rest))
                parts = {at: row.parts.get(at, 0.0) + share * other.parts.get(at, 0.0) for at in row.parts | other.parts}
                found[m] = dataclasses.replace(row, links=kept, rest=rest, parts=parts, timed=row.timed | other.timed)
                again = True
                break
    given: dict[str, AzimuthRow] = {}
    for m, row in enumerate(found):
        if row is None or len(row.links) > 1:
            continue
        other = given.setdefault(next(iter(row.links)), row)
        found[m] = row if _given(other) == _given(row) else None
    return found


def _given(row: AzimuthRow) -> dict[Tree, float]:
    """Return what a row of one link gives its azimuth, as a sum of terms times numbers."""
    (own,), found = row.links.values(), dict[Tree, float]()
    for factor, tree in (term for part in row.rest for term in _terms(part, -1.0 / own)):
        tree, factor = (("number", 1.0), factor * tree[1]) if tree[0] == "number" else (tree, factor)
        found[tree] = found.get(tree, 0.0) + factor
    return {tree: round(factor, DIGITS) for tree, factor in found.items() if round(factor, DIGITS) != 0.0}


def regular_form(mechanism: Mechanism, row: AzimuthRow) -> Expression:
    """Return the imaginary part of the product of the directions on the snow and exp(i g/c), times c."""
    first = next(iter(row.links.values()))
    sides = [_turn(mechanism, name, factor != first) for name, factor in row.links.items()]
    if row.rest:
        angle = _times(1.0 / first, ("+", *row.rest) if len(row.rest) > 1 else row.rest[0])
        sides.append((("cos", angle), ("sin", angle)))
    tree = _times(first, reduce(_product, sides)[1])
    return Expression(row.equation.text, _names(tree), row.equation.left.key, tree)


def _terms(tree: Tree, factor: float) -> list[tuple[float, Tree]]:
    """Return a sum as numbers times terms."""
    op, *rest = tree
    if op == "+":
        return [term for part in rest for term in _terms(part, factor)]
    if op == "neg":
        return _terms(rest[0], -factor)
    if op == "/" and rest[1][0] == "number":
        return _terms(rest[0], factor / rest[1][1])
    numbers = [part[1] for part in rest if part[0] == "number"] if op == "*" else []
    if numbers:
        others = [part for part in rest if part[0] != "number"]
        return _terms(("*", *others) if len(others) > 1 else others[0], factor * math.prod(numbers))
    return [] if op == "number" and rest[0] == 0.0 else [(factor, tree)]


def _azimuth(mechanism: Mechanism, tree: Tree) -> str:
    """Return the coordinate that a term is, if it is an azimuth or the heading; else nothing."""
    name = tree[1] if tree[0] == "name" else ""
    quantity = mechanism.names.find(name) if name in mechanism.names else None
    return quantity.name if quantity and not quantity.rate and quantity.kind in ("phi", "phi0") else ""


def _turn(mechanism: Mechanism, azimuth: str, back: bool) -> Plane:
    """Return a direction's components on the snow, cos psi times cosine and sine of its azimuth; `back`: of minus it."""
    link = mechanism.layout.links[mechanism.names.find(azimuth).link].name
    x: Tree = ("name", f"{link}.direction.x")
    y: Tree = ("name", f"{link}.direction.y")
    return x, (("neg", y) if back else y)


def _product(first: Plane, second: Plane) -> Plane:
    (a, b), (c, d) = first, second
    return ("+", ("*", a, c), ("neg", ("*", b, d))), ("+", ("*", b, c), ("*", a, d))


def _times(factor: float, tree: Tree) -> Tree:
    if factor == 1.0:
        return tree
    return ("neg", tree) if factor == -1.0 else ("*", ("number", factor), tree)


def _names(tree: Tree) -> frozenset[str]:
    return frozenset(walk(tree, lambda name: {name}, lambda _: set(), lambda _, parts: set().union(*parts)))
