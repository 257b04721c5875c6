"""Both engines give the same accelerations, powers and motions of whatever both of them serve."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import ANY_LENGTH, FLYING, PIVOT, SKI, random_state, scene
from vlmb.core import tree as columns
from vlmb.model.coordinates import kinematics
from vlmb.model.names import generalized_forces
from vlmb.system.core_plan import CorePlan
from vlmb.system.engines import make_engine
from vlmb.system.system import System, make_system

MODELS = Path(__file__).resolve().parents[2] / "models"
BASES = {"pivot": PIVOT, "ski": SKI, "flying": FLYING}
WHERE = [(base, plane) for base in BASES for plane in (False, True)]
IDS = [base + " in a plane" * plane for base, plane in WHERE]
LAWS = ("2*sin(3*t + 1)", "1.5 - t", "cos(t)*exp(-t)")


def random_tree(base: str, plane: bool, seed: int, count: int = 6) -> vlmb.Scene:
    """A tree of links of any kind, hung anywhere, with springs between its directions and a law on some of its forces."""
    random = np.random.default_rng([seed, plane, len(base)])

    def segment(name: str) -> dict[str, Any]:
        length = float(random.uniform(0.1, 0.3))
        kind = random.choice(["free", "free", "fixed", "prescribed"])
        if kind == "free":
            damping = float(random.choice([0.0, 7.0]))
            return {"length": length, "stiffness": random.uniform(0.0, 2e3), "damping": damping, "limits": ANY_LENGTH}
        law = {"law": f"{length} + 0.05*sin({random.uniform(1.0, 5.0)}*t + 0.3)"} if kind == "prescribed" else {"length": length}
        return {"motion": kind, **law}

    links: list[dict[str, Any]] = []
    for i in range(count):
        rod = {"length": random.uniform(0.2, 0.6), "mass": random.uniform(0.5, 3.0)}
        rod |= ({}, {"com": 0.1, "inertia": 0.3}, {"com": 0.05})[random.integers(3)]
        link = {"name": f"link{i + 1}", "rod": rod, "lower": segment("lower"), "upper": segment("upper")}
        link["tip_mass"] = random.uniform(0.1, 2.0)
        parent = int(random.integers(-1, i)) if i and base != "flying" else i - 1 - int(random.integers(0, max(i, 1)))
        link["parent"] = f"link{parent + 1}" if parent >= 0 else "base"
        if parent >= 0:
            points = ["tip", "rod_start", "rod_end"]
            link["parent_point"] = str(random.choice(points))
        links.append(link)
    made = scene(BASES[base], links, plane=plane, slope=0.2)
    ends = ["link1", "link2", "link4"] if base == "flying" else ["base", "link2", "heading", "link4"]
    forces: list[dict[str, Any]] = []
    for first, second in zip(ends, [*ends[1:], "link5"], strict=True):
        if "link" in first + second:
            damping = float(random.choice([0.0, 0.8]))
            forces.append({"between": [first, second], "stiffness": 9.0, "damping": damping, "rest": 1.0})
    forces += [
        {"on": name, "law": str(random.choice(LAWS))}
        for name in generalized_forces(vlmb.build(made).layout)
        if random.random() < 0.3 and not _driven(made, name)
    ]
    return scene(BASES[base], links, plane=plane, slope=0.2, forces=forces)


def _driven(made: vlmb.Scene, name: str) -> bool:
    if not (name.startswith("F") and name[1].isdigit()):
        return False
    link, side = (int(part) for part in name[1:].split("_"))
    return (made.links[link - 1].lower, made.links[link - 1].upper)[side - 1].motion != "free"


def in_the_core(plan: CorePlan, q: np.ndarray, v: np.ndarray, vdot: np.ndarray) -> np.ndarray:
    """Rates of the core's velocities: those of the base and of lengths, and d'' of every link."""
    layout, moving = plan.arrays.layout, kinematics(plan.arrays.layout, q, v)
    found = np.zeros(plan.velocities)
    if layout.base == "ski":
        slipping = plan.arrays.tree.shape[columns.BASE_KIND] != columns.SKI
        own = list(range(layout.base_size)) if slipping else [0, 2]  # ahead, sideways, yaw, up
        found[: len(own)] = vdot[own]
    elif layout.base == "free":
        found[[0, 2] if layout.plane else [0, 1, 2]] = vdot[: layout.base_size]
    turns = {-1: np.array([0.0, 0.0, vdot[2] if layout.base == "ski" else 0.0])}
    for row, i in enumerate(plan.arrays.order):
        at = layout.links[i]
        rotation, omega, d = moving.rotations[i], moving.omegas[i], moving.directions[i]

        def own(values: np.ndarray, at: Any = at) -> np.ndarray:
            return np.array([0.0, -values[at.v], 0.0]) if layout.plane else values[at.v : at.v + 3]

        turns[i] = turns[at.parent] + rotation @ own(vdot) + np.cross(omega, rotation @ own(v))
        first = int(plan.arrays.tree.link[row, 3])
        bend = np.cross(turns[i], d) + np.cross(omega, np.cross(omega, d))
        if plan.arrays.upright:  # in the frame of the ski nothing draws outwards
            cosine, sine = q[2:4]
            flat = cosine * d[0] + sine * d[1]
            bend = np.array([cosine * bend[0] + sine * bend[1] + v[2] ** 2 * flat, 0.0, bend[2]])
        found[first : first + 3] = bend
        for number, joint in ((1, at.lower), (2, at.upper)):
            if joint.joint and joint.motion == "free":
                found[plan.arrays.length_at(i, number)[1] - plan.positions] = vdot[joint.v]
    return found


def accelerations(system: System, state: vlmb.State, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rates of the core's velocities, and powers: by the core, and by Pinocchio."""
    read = system.mechanism.coordinates(state)
    branch = [read[name] for name in system.mechanism.layout.names]
    core = make_engine(system, branch, engine="core")
    plan, workspace = system.core_plan, system.workspace(branch=branch)
    rates = workspace.rhs(t, workspace.pack(state)).copy()
    q, v = workspace.unpack(t, workspace.pack(state))
    ours = core.evaluate(t, core.pack(state))
    first, last = plan.positions, plan.positions + plan.velocities
    theirs = in_the_core(plan, q, v, rates[workspace.nq : workspace.nq + workspace.nv])
    return ours[first:last], theirs, ours[last:], rates[workspace.nq + workspace.nv :]


@pytest.mark.parametrize(("base", "plane"), WHERE, ids=IDS)
@pytest.mark.parametrize("seed", range(8))
def test_accelerations_and_powers_agree(base: str, plane: bool, seed: int) -> None:
    made = random_tree(base, plane, seed)
    mechanism = vlmb.build(made)
    system = make_system(mechanism)
    assert system.engine == "core"
    for draw in range(3):
        state = random_state(mechanism, draw, sideways=False)
        condition = system.workspace().diagnostics.conditioning(state.q)[0]
        ours, theirs, power, expected = accelerations(system, state, 0.3)
        bound = max(1e-11, 1e-15 * condition)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=bound * np.abs(theirs).max())
        np.testing.assert_allclose(power, expected, rtol=0, atol=10.0 * bound * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("name", sorted(path.stem for path in MODELS.glob("*.toml")))
def test_shipped_models_agree_at_random_states(name: str) -> None:
    mechanism = vlmb.build(vlmb.load_scene(MODELS / f"{name}.toml"))
    system = make_system(mechanism)
    for draw in range(20):
        state = random_state(mechanism, draw, sideways=False)
        condition = system.workspace().diagnostics.conditioning(state.q)[0]
        ours, theirs, _, _ = accelerations(system, state, 0.3)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=max(1e-11, 1e-15 * condition) * np.abs(theirs).max())


@pytest.mark.parametrize(("base", "plane"), WHERE, ids=IDS)
def test_motions_agree(base: str, plane: bool) -> None:
    made = random_tree(base, plane, 2)
    start = {f"psi{i + 1}": 0.9 - 0.35 * i for i in range(6)} | {"psi1_dot": 0.7, "psi4": 1.1, "psi2": 0.8}  # not in line soon
    if not plane:
        start |= {f"phi{i + 1}": 0.8 * i for i in range(6)} | {"phi2_dot": -0.6}
    made = vlmb.Scene.from_dict({**made.to_dict(), "start": start})
    times = np.linspace(0.0, 0.2, 5)
    core, other = (vlmb.simulate(made, t_eval=times, duration=0.2, engine=engine) for engine in ("core", "pinocchio"))
    assert core.status == other.status, core.message + other.message
    assert core.stats["engine"] == "core" and other.stats["engine"] == "pinocchio"
    assert core.status == "finished", core.message
    for i in range(6):
        np.testing.assert_allclose(core.position(f"link{i + 1}"), other.position(f"link{i + 1}"), rtol=0, atol=1e-8)
    scale = max(1.0, float(np.abs(core["energy"]).max()))
    for name in ("energy", "work", "dissipated", "balance"):
        np.testing.assert_allclose(core[name], other[name], rtol=0, atol=1e-8 * scale)
    for name, values in core.controls.items():
        np.testing.assert_allclose(values, other.controls[name], rtol=0, atol=1e-6 * max(1.0, np.abs(values).max()))


def test_an_unknown_engine_is_refused() -> None:
    with pytest.raises(vlmb.VlmbError, match="engine"):
        vlmb.simulate(scene(PIVOT, 1), engine="steam", duration=0.1)


@pytest.mark.parametrize("plane", [False, True])
def test_a_control_sees_and_does_the_same_in_both(plane: bool) -> None:
    start = {"psi1": 1.1, "psi2": 0.6, "speed": 2.0, "phi0_dot": 0.4, **({} if plane else {"phi2": 0.5})}
    made = scene(SKI, 2, plane=plane, start=start)

    def control(t: float, view: Any) -> dict[str, float]:
        return {"M_psi1": -30.0 * (view["psi1"] - 1.0) - 4.0 * view["psi1_dot"], "F2_1": 5.0 * math.sin(3.0 * t), "M_phi0": 0.3}

    runs = [vlmb.simulate(made, control=control, duration=0.5, engine=engine) for engine in ("core", "pinocchio")]
    for name in ("psi1", "psi2", "phi0", "x", "work"):
        np.testing.assert_allclose(runs[0][name], runs[1][name], rtol=0, atol=1e-8)
    for name in ("M_psi1", "F2_1", "M_phi0"):
        np.testing.assert_allclose(runs[0].controls[name], runs[1].controls[name], rtol=0, atol=1e-6)
