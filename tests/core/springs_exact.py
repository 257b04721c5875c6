"""Run as a script with VLMB_JIT=0: forces are minus the derivatives of the energy and of half the power lost."""

from __future__ import annotations

import sys

import mpmath
import numpy as np

from tests.core.motions import BASES, Motion
from vlmb.core import places, springs, tree

LINE = [-1, 0, 0]


def table(motion: Motion, damping: float, stiffness: float) -> springs.AngleSprings:
    pairs = [(0, 1, springs.IN_PLANE if motion.plane else springs.LINKS), (places.NORMAL, 0, springs.ON_BASE)]
    pairs += [(places.HEADING, 1, springs.ON_BASE)]
    constant = [
        [mpmath.mpf(k) * stiffness, mpmath.mpf(c) * damping, mpmath.mpf(r)] for k, c, r in ((3, 2, 0.8), (5, 1, 0), (2, 3, -0.5))
    ]
    return springs.AngleSprings(np.array(pairs, np.int64), np.array(constant, object))


def wrong(motion: Motion) -> list[str]:
    t, shape, bad = mpmath.mpf("0.4"), motion.tree(), []
    y, _, _ = motion.state(t)
    p, nv = int(motion.shape[1]), int(motion.shape[2])
    near = np.array([motion.psi[1](t) - motion.psi[0](t), 0, 0], object)

    elastic = table(motion, 0, 1)
    force = np.zeros(nv, object)
    code, lost = springs.add_springs(elastic, shape, y, near, force)
    power = mpmath.diff(lambda s: springs.springs_energy(elastic, shape, motion.state(s)[0], near), t)
    if code or lost or abs(force @ y[p:] + power) > 1e-30:
        bad.append(f"spring of base {motion.base}: {code} {lost} {force @ y[p:] + power}")

    damped = table(motion, 1, 0)

    def half(v: np.ndarray) -> mpmath.mpf:
        return springs.add_springs(damped, shape, np.array([*y[:p], *v], object), near, np.zeros(nv, object))[1] / 2

    force = np.zeros(nv, object)
    code, lost = springs.add_springs(damped, shape, y, near, force)
    slope = [mpmath.diff(lambda h, k=k: half(y[p:] + h * np.eye(nv, dtype=object)[k]), 0) for k in range(nv)]
    sideways = {int(at) + 1 for at in motion.link[:, tree.AT_V]} if motion.upright else set()  # no velocity at all
    error = max(abs(force[k] + slope[k]) for k in range(nv) if k not in sideways)
    if code or error > 1e-30 or abs(force @ y[p:] + lost) > 1e-30:
        bad.append(f"damper of base {motion.base} plane {motion.plane}: {code} {error} {force @ y[p:] + lost}")
    return bad


def turning_with_the_ski() -> list[str]:
    """A link that turns with the ski loses nothing; on the base no line-up matters to a damper."""
    motion = Motion(tree.SKI, LINE, [False] * 3, 5)
    y = motion.state(mpmath.mpf(0))[0]
    yaw, d = mpmath.mpf("0.7"), np.array([mpmath.mpf("0.6"), 0, mpmath.mpf("0.8")], object)
    at, v = int(motion.link[0, tree.AT_P]), int(motion.shape[1] + motion.link[0, tree.AT_V])
    y[motion.shape[1] + 1], y[at : at + 3], y[v : v + 3] = yaw, d, [0, yaw * d[0], 0]
    damper = springs.AngleSprings(np.array([[places.NORMAL, 0, springs.ON_BASE]]), np.array([[0, 1, 0]], object))
    code, lost = springs.add_springs(damper, motion.tree(), y, np.zeros(1), np.zeros(int(motion.shape[2]), object))
    bad = [f"turning along: {code} {lost}"] if code or abs(lost) > 1e-40 else []
    y[at : at + 3], y[v : v + 3] = [0, 0, 1], [1, 0, 0]
    code, lost = springs.add_springs(damper, motion.tree(), y, np.zeros(1), np.zeros(int(motion.shape[2]), object))
    return bad + ([f"upright: {code} {lost}"] if code or abs(lost - 1) > 1e-40 else [])


if __name__ == "__main__":
    mpmath.mp.dps = 50
    motions = [Motion(base, LINE, [False] * 3, 20 + at) for at, base in enumerate(BASES)]
    motions += [Motion(base, LINE, [False] * 3, 30, plane=True) for base in (tree.SKI, tree.SLIDING)]
    found = [text for motion in motions for text in wrong(motion)] + turning_with_the_ski()
    print("\n".join(found) or "fine")
    sys.exit(bool(found))
