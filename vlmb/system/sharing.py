"""Feet that share a load: which of them carry it, so that each pushes, and the least admissible forces of all.

Where the rows of some closed contacts follow from those of others, forces are not determined, and the least ones may pull. Then
some of the contacts carry nothing: they stay closed without rows, since the others hold them where they are. A contact opens only
where no such choice is left.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.system.contacts import HELD, SLIDING, ContactPoint, Footing
from vlmb.system.least_reactions import Part, least, part_of

Array = NDArray[np.float64]

RANK = 1e-9  # of the largest singular value: below it rows follow from others
MOST = 8  # contacts among which is chosen
OFF = 1e-7  # of the accelerations without contacts: what those who carry may leave


class Across(NamedTuple):
    """What a closed contact does in some of the directions over its surface."""

    rows: tuple[int, ...]  # in G
    hold: float  # most of |friction| over the normal force, where it does not slide
    slide: tuple[float, ...] = ()  # friction for a unit of normal force, where it does


class Foot(NamedTuple):
    """A closed contact: its rows in G, and its friction."""

    normal: int
    across: tuple[Across, ...]

    @property
    def held(self) -> tuple[int, ...]:
        """Rows over its surface in which it does not slide."""
        return tuple(row for part in self.across if not part.slide for row in part.rows)

    @property
    def kept(self) -> tuple[int, ...]:
        """Rows that it holds at 0."""
        return (self.normal, *self.held)

    def pushes(self, count: int) -> Array:
        """Return what each unknown pushes on (count, unknowns): the normal force, with what slides, then what holds."""
        found = np.eye(count)[:, list(self.kept)]
        for part in self.across:
            if part.slide:
                found[list(part.rows), 0] = part.slide
        return found


def foot_of(point: ContactPoint, footing: Footing, frame: Array, normal: int) -> Foot:
    """Return a closed contact as a foot; `frame` has its axes across, then its normal, the last of these rows of G."""
    across = tuple(range(normal - len(frame) + 1, normal))
    if point.edge is not None:
        ratios, holds = (footing.towards[1], footing.towards[0]), (point.edge.hold, point.edge.friction)
        parts = zip(across, holds, ratios, strict=False)
        return Foot(normal, tuple(Across((row,), hold, (-ratio,) if ratio else ()) for row, hold, ratio in parts))
    if point.smooth or footing.state == SLIDING:
        ratio, way = 0.0 if point.smooth else point.coefficient, frame[:-1] @ np.array(footing.towards)
        return Foot(normal, (Across(across, ratio, tuple((-ratio * way).tolist())),))
    return Foot(normal, (Across(across, point.at_rest),))


def carrying_again(point: ContactPoint, before: Footing, t: float, place: Array, plane: bool) -> Footing:
    """Return the footing of a contact that rested on others, and carries from now on; a ski stands or slides as it did."""
    if point.edge is not None:
        return before._replace(state=SLIDING if before.towards[1] else HELD)
    return point.footing_at(SLIDING if point.smooth else HELD, t, place, plane)


def carrying(g: Array, a: Array, feet: Mapping[int, Foot], idle: Collection[int], light: float) -> frozenset[int] | None:
    """Return contacts that carry what all do, each pushing more than `light` [N]; None where there are none such.

    Their normal forces are determined. Of sets of a size that with the least forces is taken, of sizes the largest.

    g, a : of all rows, accelerations by forces and without them; idle : those that must not carry
    """
    names, count = [k for k in feet if k not in idle], len(a)
    every = sorted({row for foot in feet.values() for row in foot.kept})
    size = float(np.abs(a[every]).max(initial=0.0))
    rank = _rank(g[np.ix_(every, every)])
    for left_out in range(min(len(names), MOST)):
        best: tuple[float, frozenset[int]] | None = None
        for dropped in itertools.combinations(names, left_out):
            chosen = [k for k in names if k not in dropped]
            rows = sorted({row for k in chosen for row in feet[k].kept})
            if _rank(g[np.ix_(rows, rows)]) < rank:
                continue
            unknowns, kept = np.hstack([feet[k].pushes(count) for k in chosen]), [row for k in chosen for row in feet[k].kept]
            if not _determined(g[kept] @ unknowns, [kept.index(feet[k].normal) for k in chosen]):
                continue
            y = np.linalg.lstsq((g @ unknowns)[rows], -a[rows], rcond=RANK)[0]
            p = unknowns @ y
            if np.abs((g @ p + a)[every]).max() <= OFF * size and all(_pushes(p, feet[k], light) for k in chosen):
                found = float(p @ p), frozenset(chosen)
                best = found if best is None or found[0] < best[0] else best
        if best is not None:
            return best[1]
    return None


def let_go(g: Array, feet: Mapping[int, Foot], carriers: Collection[int], resting: Collection[int]) -> set[int]:
    """Return those that rest on others, but not on these carriers alone: where they cannot carry themselves they open."""
    rows = sorted({row for k in carriers for row in feet[k].kept})
    more = {k: sorted({*rows, *feet[k].kept}) for k in resting}
    return {k for k in resting if _rank(g[np.ix_(more[k], more[k])]) > _rank(g[np.ix_(rows, rows)])}


def _rank(matrix: Array) -> int:
    values = np.linalg.svd(matrix, compute_uv=False) if matrix.size else np.zeros(0)
    return int((values > RANK * values[:1].max(initial=0.0)).sum())


def _determined(matrix: Array, normals: list[int]) -> bool:
    """Whether normal forces, by their unknowns, follow from the rows: nothing else may choose between them."""
    _, values, right = np.linalg.svd(matrix)
    idle = right[(values > RANK * values[0]).sum() :]
    return not idle.size or float(np.abs(idle[:, normals]).max()) < math.sqrt(RANK)


def _pushes(p: Array, foot: Foot, light: float) -> bool:
    push = float(p[foot.normal])
    holding = [part for part in foot.across if not (part.slide or math.isinf(part.hold))]
    return push > light and all(float(np.linalg.norm(p[list(part.rows)])) <= part.hold * push for part in holding)


def least_shares(jacobian: Array, pushed: Array, feet: Sequence[Foot]) -> Array | None:
    """Return the least admissible forces (rows,) that push as forces over velocities (nv,) do; None where there are none.

    jacobian : (rows, nv) of the rows of all feet
    """
    count, columns, parts, first = len(jacobian), [], list[Part](), 0
    for foot in feet:
        unknowns = foot.pushes(count)
        columns.append(unknowns)
        # rough: what is across follows the normal without a bound
        bound = [part for part in foot.across if not (part.slide or math.isinf(part.hold))]
        places = [tuple(first + 1 + foot.held.index(row) for row in part.rows) for part in bound]
        parts.append(part_of(first, [(part.hold, own) for part, own in zip(bound, places, strict=True)]))
        first += unknowns.shape[1]
    unknowns = np.hstack(columns)
    y = least(jacobian.T @ unknowns, pushed, parts)
    return None if y is None else np.asarray(unknowns @ y)
