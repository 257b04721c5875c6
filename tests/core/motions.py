"""Mechanisms that move as smooth functions of time say, with 50 digits: the state, v' and the given lengths at any t.

Run as a script with VLMB_JIT=0 it checks rate, drift and row of every kind of quantity, and exits with what is wrong.
"""

from __future__ import annotations

import itertools
import sys
from functools import cache
from typing import Any

import mpmath
import numpy as np

from vlmb.core import places, tree
from vlmb.core import quantities as q

Number = Any
BASES = {tree.PIVOT: (0, 0), tree.FREE: (3, 3), tree.SKI: (3, 2), tree.SLIDING: (3, 3)}  # positions and velocities


class Wave:
    """c + a sin(w t + p), with derivatives."""

    def __init__(self, rng: np.random.Generator, middle: float, size: float) -> None:
        self.c, self.a = mpmath.mpf(middle), mpmath.mpf(size)
        self.w, self.p = (mpmath.mpf(float(number)) for number in rng.uniform(0.5, 2.5, 2))

    def __call__(self, t: Number, order: int = 0) -> Number:
        phase = self.w * t + self.p + order * mpmath.pi / 2
        return (self.c if order == 0 else 0) + self.a * self.w**order * mpmath.sin(phase)


class Motion:
    """A mechanism with links hanging on tips and rods, some segments given, in a motion; d and u carry errors on purpose."""

    def __init__(self, base: int, parents: list[int], on_rod: list[bool], seed: int, plane: bool = False) -> None:
        rng = self.rng = np.random.default_rng(seed)
        self.base, n = base, len(parents)
        self.plane, self.known = plane, {}
        self.free = rng.integers(0, 2, (n, 2)).astype(bool)
        self.size = BASES[base]
        link, real = np.zeros((n, 8), np.int64), rng.uniform(0.3, 1.5, (n, 16))
        p, v = self.size
        for i in range(n):
            link[i, :6] = parents[i], int(on_rod[i]), p, v, *self.free[i]
            p, v = p + 3 + int(self.free[i].sum()), v + 3 + int(self.free[i].sum())
        constants = np.array([3.0, 0.4, 0.2, 0.0, 0.0, -9.81])
        if base == tree.FREE:
            constants[2] = 0.0
        if base in (tree.PIVOT, tree.FREE):
            real[:, tree.ANCHOR :] *= base == tree.PIVOT
        real[link[:, tree.PARENT] >= 0, tree.ANCHOR :] = 0.0  # links on links hang where they are, not aside
        if base == tree.PIVOT:
            constants[:3] = 0.0
        self.upright = plane and base in (tree.SKI, tree.SLIDING)
        self.shape = np.array([base, p, v, n, self.upright, 0], np.int64)
        self.link, self.real, self.constants = link, real, constants
        self.place = [Wave(rng, 0.3, 1.0) for _ in range(3)]
        self.yaw, self.ahead, self.left = Wave(rng, 0.4, 0.8), Wave(rng, 2.0, 1.0), Wave(rng, 0.1, 0.5)
        self.phi = [Wave(rng, 0.3, 1.0) for _ in range(n)]
        self.psi = [Wave(rng, 0.4, 0.6) for _ in range(n)]
        self.lengths = [[Wave(rng, 0.4, 0.2), Wave(rng, 0.5, 0.2)] for _ in range(n)]
        self.stretch, self.slant = rng.uniform(0.9, 1.1, n), rng.uniform(-0.1, 0.1, n)

    def tree(self, exact: bool = True) -> tree.Tree:
        if not exact:
            return tree.Tree(self.shape, self.constants, self.link, self.real)
        exactly = np.vectorize(mpmath.mpf, otypes=[object])
        return tree.Tree(self.shape, exactly(self.constants), self.link, exactly(self.real))

    def azimuth(self, i: int, t: Number, order: int = 0) -> Number:
        if not self.plane:
            return self.phi[i](t, order)
        steers = self.base in (tree.SKI, tree.SLIDING)
        return self.yaw(t, order) if steers else mpmath.mpf(0)

    def direction(self, i: int, t: Number) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """d, d', d'' by the chain rule, in the frame that the state has them in."""
        f, f1, f2 = (mpmath.mpf(0) if self.upright else self.azimuth(i, t, order) for order in range(3))
        s, s1, s2 = (self.psi[i](t, order) for order in range(3))
        cf, sf, cs, ss = mpmath.cos(f), mpmath.sin(f), mpmath.cos(s), mpmath.sin(s)
        d = np.array([cf * cs, sf * cs, ss], object)
        side, up = np.array([-sf, cf, mpmath.mpf(0)], object), np.array([-cf * ss, -sf * ss, cs], object)
        flat = np.array([cf, sf, mpmath.mpf(0)], object)
        d1 = f1 * cs * side + s1 * up
        d2 = (f2 * cs - 2 * f1 * s1 * ss) * side - f1**2 * cs * flat + s2 * up - s1**2 * d
        return d, d1, d2

    def state(self, t: Number) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """y (np + nv,), v' (nv,), given (n, 6)."""
        if t not in self.known:
            self.known[t] = self.made(t)
        return self.known[t]

    def made(self, t: Number) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        p: list[Number] = []
        v: list[Number] = []
        a: list[Number] = []
        given = np.zeros((len(self.link), 6), object)
        if self.base == tree.FREE:
            p, v, a = ([wave(t, order) for wave in self.place] for order in range(3))
        elif self.base != tree.PIVOT:
            p = [self.place[0](t), self.place[1](t), self.yaw(t)]
            v, a = [self.ahead(t)], [self.ahead(t, 1)]
            if self.base == tree.SLIDING:
                v, a = [*v, self.left(t)], [*a, self.left(t, 1)]
            v, a = [*v, self.yaw(t, 1)], [*a, self.yaw(t, 2)]
        for i in range(len(self.link)):
            d, u, d2 = self.direction(i, t)
            stretch, slant = mpmath.mpf(float(self.stretch[i])), mpmath.mpf(float(self.slant[i]))
            w = d2 - (d2 @ d) * d
            p, v, a = [*p, *(stretch * d)], [*v, *(u + slant * d)], [*a, *(w - (u @ u) * d + slant * u)]
            for side in range(2):
                jet = [self.lengths[i][side](t, order) for order in range(3)]
                if self.free[i, side]:
                    p, v, a = [*p, jet[0]], [*v, jet[1]], [*a, jet[2]]
                else:
                    given[i, 3 * side : 3 * side + 3] = jet
        return np.array([*p, *v], object), np.array(a, object), given

    def velocity(self, t: Number) -> np.ndarray:
        """A's velocity in the surface frame: what x' and y' of a ski are, though its waves x(t), y(t) say other."""
        h = np.array([mpmath.cos(self.yaw(t)), mpmath.sin(self.yaw(t)), mpmath.mpf(0)], object)
        n = np.array([-h[1], h[0], mpmath.mpf(0)], object)
        return self.ahead(t) * h + (self.left(t) if self.base == tree.SLIDING else 0) * n


def kinds(motion: Motion) -> list[tuple[tuple[int, int, int, int], float]]:
    """Every kind of quantity that makes sense for the mechanism."""
    n, axes = len(motion.link), range(3)
    steers = motion.base in (tree.SKI, tree.SLIDING)
    found: list[tuple[tuple[int, int, int, int], float]] = [((q.BASE_PLACE, 0, axis, 0), 0.0) for axis in axes]
    if steers:
        found += [((q.YAW, 0, 0, 0), 0.0), ((q.SPEED, 0, 0, 0), 0.0)]
        found += [((q.DIRECTION, places.HEADING, axis, 0), 0.0) for axis in axes]
    if motion.base == tree.SLIDING:
        found += [((q.SPEED, 0, 1, 0), 0.0)]
    for i in range(n):
        found += [((q.AZIMUTH, i, 0, 0), 0.0), ((q.ELEVATION, i, 0, 0), 0.0)]
        found += [((q.DIRECTION, i, axis, 0), 0.0) for axis in axes]
        for (along, offset), axis in itertools.product(((1, 0.7), (3, 0.9), (0, 0.35)), axes):
            found.append(((q.POINT, i, axis, along), offset))
        found += [((q.DISTANCE, i, 0, along), 0.2) for along in range(4)]
        found += [((q.ANGLE, places.NORMAL, i, 0), 0.0), ((q.ANGLE, places.HEADING, i, 0), 0.0)]
        found += [((q.ANGLE, k, i, 0), 0.0) for k in range(i)] if not motion.plane else []
        if motion.plane:
            found += [((q.PLANE_ELEVATION, i, 0, 0), 0.0)]
            found += [((q.PLANE_ANGLE, k, i, 0), 0.0) for k in (places.HEADING, places.NORMAL, *range(i))]
    found += [((q.CENTRE_OF_MASS, 0, axis, 0), 0.0) for axis in axes]
    return found


def mechanisms() -> list[Motion]:
    """All kinds of base, with trees; in space and in the upright plane of the heading."""
    parents, on_rod = [-1, 0, 1, -1], [False, False, True, False]
    found = [Motion(base, parents, on_rod, 3 + at) for at, base in enumerate(BASES)]
    return [
        *found,
        Motion(tree.SKI, parents, on_rod, 11, plane=True),
        Motion(tree.SLIDING, parents, on_rod, 13, plane=True),
        Motion(tree.PIVOT, [-1, 0], [False, False], 12, plane=True),
    ]


def measured(motion: Motion, table: q.Quantities, k: int, t: Number, made: tree.Tree, near: np.ndarray) -> np.ndarray:
    y, _, given = motion.state(t)
    out = np.zeros((len(table.kind), 3), object)
    code = q.measure(table, k, made, y, given, near, out)
    assert code == 0, (table.kind[k], code)
    return out[k]


def reference(motion: Motion, table: q.Quantities, t: Number) -> np.ndarray:
    """The angles themselves, a little off."""
    near = np.zeros((len(table.kind), 2), object)
    for k, (kind, link, other, _) in enumerate(table.kind):
        if kind in (q.AZIMUTH, q.ELEVATION):
            near[k] = motion.azimuth(link, t) + 0.1, motion.psi[link](t) - 0.1
        elif kind == q.PLANE_ELEVATION:
            near[k, 1] = motion.psi[link](t) + 1
        elif kind == q.PLANE_ANGLE:
            near[k, 1] = motion.psi[other](t) - (motion.psi[link](t) if link >= 0 else 0)
    return near


def wrong(motion: Motion, t: Number, close: float = 1e-30) -> list[str]:
    """List the quantities whose rate, drift or row do not belong to their values."""
    entries = kinds(motion)
    made = motion.tree()
    table = q.make_quantities(made, [kind for kind, _ in entries], [mpmath.mpf(offset) for _, offset in entries])
    near = cache(lambda s: reference(motion, table, s))
    found = cache(lambda k, s: measured(motion, table, k, s, made, near(s)))  # both derivatives look at the same instants
    y, a, given = motion.state(t)
    v, bad = y[motion.shape[1] :], []
    steers = motion.base in (tree.SKI, tree.SLIDING)
    for k, (kind, _) in enumerate(entries):
        out, row = found(k, t), np.zeros(len(v), object)
        code = q.add_row(table, k, made, y, given, near(t), mpmath.mpf(1), row)
        slope, bend = (mpmath.diff(lambda s, k=k, o=order: found(k, s)[o], t) for order in range(2))
        if steers and kind[0] in (q.BASE_PLACE, q.POINT, q.CENTRE_OF_MASS):  # the knife edge moves A, not the waves of the place
            axis = kind[2]
            slope += motion.velocity(t)[axis] - (motion.place[axis](t, 1) if axis < 2 else 0)
        if kind[0] == q.SPEED:
            slope = out[1]
        still = given * np.array([1, 0, 0, 1, 0, 0])  # the rate is L v where lengths that are given do not change
        free = np.zeros((len(table.kind), 3), object)
        q.measure(table, k, made, y, still, near(t), free)
        errors = [abs(out[1] - slope), abs(free[k, 1] - row @ v), abs(out[2] + row @ a - bend)]
        if code != 0 or max(errors) > close:
            bad.append(f"base {motion.base} plane {motion.plane} kind {kind}: {[mpmath.nstr(error, 3) for error in errors]}")
    return bad


if __name__ == "__main__":
    mpmath.mp.dps = 50
    found = [text for motion in mechanisms() for text in wrong(motion, mpmath.mpf("0.37"))]
    print("\n".join(found) or "fine")
    sys.exit(bool(found))
