"""Accelerations of the core beside those of the generated Pinocchio model."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.core import tree as t
from vlmb.core.links import accelerate
from vlmb.core.scratch import make_scratch
from vlmb.core.tree import Tree
from vlmb.model.coordinates import kinematics
from vlmb.system.system import make_system

BASES: dict[str, dict[str, Any]] = {
    "pivot": {"kind": "pivot"}, "free": {"kind": "free", "mass": 1.5},
    "ski": {"kind": "ski", "mass": 5.0, "inertia": 0.6, "com_offset": 0.1},
}  # fmt: skip
KINDS = {"pivot": t.PIVOT, "free": t.FREE, "ski": t.SKI}
SIZES = {"pivot": (0, 0), "free": (3, 3), "ski": (3, 2)}


def random_scene(base: str, seed: int) -> vlmb.Scene:
    """A tree whose links hang at tips and at ends of rods."""
    random = np.random.default_rng(seed)

    def segment() -> dict[str, Any]:
        if random.random() < 0.4:
            return {"length": random.uniform(0.1, 0.3), "motion": "fixed"}
        return {"length": 0.2, "stiffness": random.uniform(0.0, 2000.0), "damping": 7.0, "limits": [-math.inf, math.inf]}

    links = []
    for i in range(6):
        rod = {"length": random.uniform(0.2, 0.6), "mass": random.uniform(0.5, 3.0), "com": 0.1, "inertia": 0.05}
        link = {"name": f"link{i + 1}", "rod": rod, "lower": segment(), "upper": segment(), "tip_mass": random.uniform(0.1, 2.0)}
        if i:
            link |= {"parent": f"link{random.integers(1, i + 1)}", "parent_point": random.choice(["tip", "rod_start", "rod_end"])}
            link["parent_point"] = str(link["parent_point"])
        links.append(link)
    return vlmb.Scene.from_dict({"base": BASES[base], "links": links, "slope": 0.2})


def arrays(mechanism: vlmb.Mechanism, q: np.ndarray, v: np.ndarray) -> tuple[Tree, np.ndarray, np.ndarray]:
    """Tree, state and given lengths of the core."""
    scene, layout = mechanism.scene, mechanism.layout
    n, (p, w) = len(layout.links), SIZES[layout.base]
    moving = kinematics(layout, q, v)
    ints, real, given = np.zeros((n, 8), np.int64), np.zeros((n, 16)), np.zeros((n, 6))
    where = {link: row for row, link in enumerate(layout.order)} | {-1: -1}
    positions = {"pivot": [], "free": q[:3], "ski": [*q[:2], math.atan2(q[3], q[2])]}[layout.base]
    velocities = {"pivot": [], "free": v[:3], "ski": [v[0], v[2]]}[layout.base]
    positions, velocities = list(positions), list(velocities)
    for row, index in enumerate(layout.order):
        link, at = scene.links[index], layout.links[index]
        on_rod = at.parent >= 0 and at.point != "tip"
        ints[row, :4] = where[at.parent], t.ROD if on_rod else t.TIP, p, w
        real[row, : t.TIP_MASS + 1] = link.rod.length, link.rod.mass, link.rod.centre, link.rod.transverse_inertia, link.tip_mass
        if on_rod:
            ints[where[at.parent], t.ROD_CHILDREN] = 1
            real[row, t.ON_ROD] = 0.0 if at.point == "rod_start" else layout.links[at.parent].rod_length
        positions += list(moving.directions[index])
        velocities += list(moving.direction_rates[index])
        for side, (segment, joint) in enumerate(((link.lower, at.lower), (link.upper, at.upper))):
            if joint.joint and joint.motion == "free":
                ints[row, t.LOWER_FREE + side] = 1
                k = t.K1 + 3 * side
                real[row, k : k + 3] = segment.stiffness, segment.rest_length, segment.damping
                positions.append(q[joint.q])
                velocities.append(v[joint.v])
            else:
                given[row, 3 * side] = joint.length
        p, w = len(positions), len(velocities)
    base = scene.base
    constants = np.array([base.mass, base.inertia, base.com_offset, *scene.surface_gravity])
    return Tree(np.array([KINDS[layout.base], p, w, n, 0, 0]), constants, ints, real), np.array([*positions, *velocities]), given


def from_pinocchio(mechanism: vlmb.Mechanism, q: np.ndarray, v: np.ndarray, vdot: np.ndarray) -> np.ndarray:
    """Rates of the core's velocities: those of the base and of lengths, and d'' of every link."""
    layout, moving = mechanism.layout, kinematics(mechanism.layout, q, v)
    found = {"pivot": [], "free": list(vdot[:3]), "ski": [vdot[0], vdot[2]]}[layout.base]
    turns = {-1: np.zeros(3) if layout.base != "ski" else np.array([0.0, 0.0, vdot[2]])}
    for index in layout.order:
        at = layout.links[index]
        rotation, omega, d = moving.rotations[index], moving.omegas[index], moving.directions[index]
        own = v[at.v : at.v + 3]
        turns[index] = turns[at.parent] + rotation @ vdot[at.v : at.v + 3] + np.cross(omega, rotation @ own)
        found += list(np.cross(turns[index], d) + np.cross(omega, np.cross(omega, d)))
        found += [vdot[joint.v] for joint in (at.lower, at.upper) if joint.joint and joint.motion == "free"]
    return np.array(found)


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("seed", range(5))
def test_accelerations_are_those_of_the_generated_model(base: str, seed: int) -> None:
    mechanism = vlmb.build(random_scene(base, seed))
    random = np.random.default_rng(seed + 100)
    values, rates = {}, {}
    for name in mechanism.coordinate_names:
        values[name] = random.uniform(0.1, 0.4) if name.startswith("xi") else random.uniform(-1.2, 1.2)
        rates[f"{name}_dot"] = random.uniform(-1.5, 1.5)
    if base == "ski":
        speed = rates["x_dot"]
        rates |= {"x_dot": speed * math.cos(values["phi0"]), "y_dot": speed * math.sin(values["phi0"])}
    workspace = make_system(mechanism).workspace()
    y = workspace.pack(mechanism.state(values, rates))
    q, v = workspace.unpack(0.0, y)
    vdot = workspace.rhs(0.0, y)[workspace.nq : workspace.nq + workspace.nv].copy()
    tree, state, given = arrays(mechanism, q, v)
    dy = np.zeros_like(state)
    assert accelerate(tree, state, given, np.zeros(tree.shape[t.VELOCITIES]), dy, make_scratch(tree)) == 0
    right = from_pinocchio(mechanism, q, v, vdot)
    np.testing.assert_allclose(dy[tree.shape[t.POSITIONS] :], right, rtol=0.0, atol=1e-11 * np.abs(right).max())
