"""Equal chains at drawn postures, and their accelerations by mass points and Lagrange's equations in extended precision."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vlmb
from vlmb.core import tree as t
from vlmb.core.tree import Tree
from vlmb.model.layout import Layout
from vlmb.model.mechanism import Mechanism

Array = NDArray[Any]
LONG = np.longdouble
BASES: dict[str, dict[str, Any]] = {
    "pivot": {"kind": "pivot"},
    "ski": {"kind": "ski", "mass": 5.0, "inertia": 0.6, "com_offset": 0.05},
}
ROD, MASS, TIP = 0.2, 1.0, 0.5  # [m], [kg], [kg]
LEG = {"length": 0.1, "stiffness": 4e3, "limits": [-math.inf, math.inf]}
SPREAD = {"x": (0.0, 1.0), "y": (0.0, 1.0), "phi": (0.0, 1.0), "psi": (0.0, 0.6), "xi": (0.1, 0.02)}  # middle, half width
SPEED = 2.0  # [m/s] of the ski


def chain(base: str, links: int) -> vlmb.Scene:
    """A chain of equal links with spring legs."""
    link = {"rod": {"length": ROD, "mass": MASS}, "lower": LEG, "upper": LEG, "tip_mass": TIP}
    return vlmb.Scene.from_dict({"base": BASES[base], "links": [link] * links, "run": {"fall": False}})


def core_chain(base: str, n: int) -> tuple[Tree, Array]:
    """The same chain as arrays of the core, and a state in motion."""
    random, ski = np.random.default_rng(n), base == "ski"
    p, v = (3, 2) if ski else (0, 0)
    link, real = np.zeros((n, 8), np.int64), np.zeros((n, 16))
    spring = (LEG["stiffness"], LEG["length"], 0.0)
    for i in range(n):
        link[i] = i - 1, t.TIP, p + 5 * i, v + 5 * i, 1, 1, 0, 1
        real[i, : t.ON_ROD] = ROD, MASS, ROD / 2, MASS * ROD**2 / 12, TIP, *spring, *spring
    own = [BASES["ski"][key] for key in ("mass", "inertia", "com_offset")]
    tree = Tree(np.array([t.SKI if ski else t.PIVOT, p + 5 * n, v + 5 * n, n, 0]), np.array([*own, 0.0, 0.0, -9.81]), link, real)
    y = 0.3 * random.normal(size=p + v + 10 * n)
    for i in range(n):
        d = random.normal(size=3)
        y[p + 5 * i : p + 5 * i + 3] = d / np.linalg.norm(d)
        y[p + 5 * i + 3 : p + 5 * i + 5] = random.uniform(0.05, 0.15, 2)
    return tree, y


def posture(mechanism: Mechanism, seed: int) -> vlmb.State:
    """A bent, moving state without sideways slip; links far from the pole and from each other's line."""
    random = np.random.default_rng(seed)
    values: dict[str, float] = {}
    rates: dict[str, float] = {}
    for name in mechanism.coordinate_names:
        middle, width = SPREAD[name.rstrip("0123456789_")]
        values[name] = middle + random.uniform(-width, width)
        rates[f"{name}_dot"] = random.uniform(-0.5, 0.5)
    if "phi0" in values:
        rates |= {"x_dot": SPEED * math.cos(values["phi0"]), "y_dot": SPEED * math.sin(values["phi0"])}
    return mechanism.state(values, rates)


def largest_error(found: tuple[Array, Array], exact: tuple[Array, Array]) -> float:
    """Largest error of direction and length accelerations, each over its largest."""
    return max(float(np.abs(ours - true).max() / np.abs(true).max()) for ours, true in zip(found, exact, strict=True))


def core_measured(layout: Layout, state: vlmb.State, vdot: Array) -> tuple[Array, Array]:
    """Accelerations of directions (n, 3) and lengths (n, 2) of the core's solution, whose velocities are rates of both."""
    first = 2 if layout.base == "ski" else 0
    links = np.array(vdot[first : first + 5 * len(layout.links)]).reshape(-1, 5)
    return links[:, :3], links[:, 3:]


def reference(mechanism: Mechanism, state: vlmb.State) -> tuple[Array, Array]:
    """Accelerations of directions (n, 3) and lengths (n, 2) from mass points and Lagrange's equations, extended precision.

    r_p = r_A + sum_k s_pk d_k, d_k'' = -|d_k'|^2 d_k + a_k b_k + c_k (d_k x b_k); unknown a, c, both xi'' of every link,
    and for a ski the accelerations along its heading and in yaw.
    """
    layout, n, ski = mechanism.layout, len(mechanism.layout.links), mechanism.layout.base == "ski"
    d, omega = directions(layout, state)
    rate = np.cross(omega, d)
    lengths = np.array([[state.q[e.lower.q], state.q[e.upper.q]] for e in layout.links], dtype=LONG)
    speeds = np.array([[state.v[e.lower.v], state.v[e.upper.v]] for e in layout.links], dtype=LONG)
    side = np.cross(d, np.array([0, 0, 1], dtype=LONG))
    side /= np.sqrt(np.sum(side**2, axis=1))[:, None]
    up = np.cross(d, side)
    first = 2 if ski else 0
    size = first + 4 * n
    gravity = np.array([0, 0, -LONG(mechanism.scene.gravity)], dtype=LONG)
    matrix, load = np.zeros((size, size), dtype=LONG), np.zeros(size, dtype=LONG)

    def add(mass: float, jacobian: Array, bias: Array) -> None:
        columns = np.flatnonzero(jacobian.any(axis=0))
        part = jacobian[:, columns]
        matrix[np.ix_(columns, columns)] += LONG(mass) * part.T.dot(part)
        load[columns] += LONG(mass) * part.T.dot(gravity - bias)

    jacobian, bias = np.zeros((3, size), dtype=LONG), np.zeros(3, dtype=LONG)
    if ski:
        base = BASES["ski"]
        norm = np.sqrt(LONG(state.q[2]) ** 2 + LONG(state.q[3]) ** 2)
        ahead = np.array([LONG(state.q[2]) / norm, LONG(state.q[3]) / norm, 0], dtype=LONG)
        left = np.array([-ahead[1], ahead[0], 0], dtype=LONG)
        speed, yaw, offset = LONG(state.v[0]), LONG(state.v[2]), LONG(base["com_offset"])
        jacobian[:, 0], bias = ahead, speed * yaw * left
        centre = jacobian.copy()
        centre[:, 1] = offset * left
        add(base["mass"], centre, bias - offset * yaw**2 * ahead)
        matrix[1, 1] += LONG(base["inertia"])
    for i in range(n):
        at = first + 4 * i

        rod = LONG(ROD)
        points = [(LONG(MASS) / 6, LONG(0), 1), (4 * LONG(MASS) / 6, rod / 2, 1), (LONG(MASS) / 6, rod, 1)]
        for mass, where, segments in (*points, (TIP, rod + lengths[i, 1], 2)):  # the tip last: it carries the next link
            along = lengths[i, 0] + where
            moved, rest = jacobian.copy(), bias - along * np.sum(rate[i] ** 2) * d[i]
            moved[:, at], moved[:, at + 1] = along * side[i], along * up[i]
            for which in range(segments):
                moved[:, at + 2 + which] = d[i]
                rest = rest + 2 * speeds[i, which] * rate[i]
            add(mass, moved, rest)
        jacobian, bias = moved, rest
        load[at + 2 : at + 4] -= LONG(LEG["stiffness"]) * (lengths[i] - LONG(LEG["length"]))
    u = cholesky_solve(matrix, load)[first:].reshape(n, 4)
    turning = -np.sum(rate**2, axis=1)[:, None] * d + u[:, :1] * side + u[:, 1:2] * up
    return turning, u[:, 2:]


def directions(layout: Layout, state: vlmb.State) -> tuple[Array, Array]:
    """Directions and angular velocities (n, 3) of a chain's links, extended precision."""
    rotations, omega = _rotations(layout, state)
    return rotations[:, :, 0], omega


def measured(layout: Layout, state: vlmb.State, vdot: Array) -> tuple[Array, Array]:
    """Accelerations of directions (n, 3) and lengths (n, 2) of a solution vdot."""
    rotations, omega = _rotations(layout, state)
    turning = np.zeros(3, dtype=LONG)
    before = np.zeros(3, dtype=LONG)
    if layout.base == "ski":
        turning[2], before[2] = vdot[2], state.v[2]
    found = []
    for i, entry in enumerate(layout.links):
        relative = rotations[i].dot(state.v[entry.v : entry.v + 3].astype(LONG))
        turning = turning + rotations[i].dot(vdot[entry.v : entry.v + 3].astype(LONG)) + np.cross(before, relative)
        d = rotations[i][:, 0]
        found.append(np.cross(turning, d) + np.cross(omega[i], np.cross(omega[i], d)))
        before = omega[i]
    return np.array(found), np.array([[vdot[e.lower.v], vdot[e.upper.v]] for e in layout.links], dtype=LONG)


def _rotations(layout: Layout, state: vlmb.State) -> tuple[Array, Array]:
    rotation, omega = np.eye(3, dtype=LONG), np.zeros(3, dtype=LONG)
    if layout.base == "ski":
        norm = np.sqrt(LONG(state.q[2]) ** 2 + LONG(state.q[3]) ** 2)
        cosine, sine = LONG(state.q[2]) / norm, LONG(state.q[3]) / norm
        rotation[:2, :2] = [[cosine, -sine], [sine, cosine]]
        omega[2] = state.v[2]
    rotations, omegas = [], []
    for entry in layout.links:
        quaternion = state.q[entry.q : entry.q + 4].astype(LONG)
        x, y, z, w = quaternion / np.sqrt(np.sum(quaternion**2))
        local = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ],
            dtype=LONG,
        )
        rotation = rotation.dot(local)
        omega = omega + rotation.dot(state.v[entry.v : entry.v + 3].astype(LONG))
        rotations.append(rotation)
        omegas.append(omega)
    return np.array(rotations), np.array(omegas)


def cholesky_solve(matrix: Array, load: Array) -> Array:
    """Solve a symmetric positive definite system in the precision of its numbers."""
    lower, size = matrix.copy(), len(load)
    x = load.copy()
    for k in range(size):
        lower[k, k] = np.sqrt(lower[k, k])
        lower[k + 1 :, k] /= lower[k, k]
        lower[k + 1 :, k + 1 :] -= np.outer(lower[k + 1 :, k], lower[k + 1 :, k])
    for k in range(size):
        x[k] = (x[k] - lower[k, :k].dot(x[:k])) / lower[k, k]
    for k in reversed(range(size)):
        x[k] = (x[k] - lower[k + 1 :, k].dot(x[k + 1 :])) / lower[k, k]
    return x
