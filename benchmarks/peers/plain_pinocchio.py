"""The baseline: a plain Pinocchio loop with quaternions, and solve_ivp with SciPy's DOP853.

What one writes first: a model joint by joint, springs by index arrays, `aba`, the tangent map times v; the knife edge of a ski as
a row of a linear system with its multiplier. No buffers, no tuning.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from peers.chain import Array, Chain, Outcome, Run, read_chain
from scipy.integrate import solve_ivp

SETTINGS = tuple(10.0 ** -(k / 2) for k in range(4, 25))  # rtol; atol a tenth of it
SAMPLED = 60.0  # [1/s]


def prepare(scene: dict[str, Any], duration: float) -> dict[str, tuple[tuple[float, ...], Run]]:
    """Build the model; return runs of a tolerance that give the end alone, and samples."""
    chain = read_chain(scene)
    model, tips, springs = build(chain)
    data = model.createData()
    q0, v0 = start(chain, model)
    nq, nv = model.nq, model.nv
    at_q, at_v, stiffness, rest = (np.array(column) for column in zip(*springs, strict=True)) if springs else ([], [], 0.0, 0.0)
    at_q, at_v = np.asarray(at_q, dtype=int), np.asarray(at_v, dtype=int)

    def accelerations(q: Array, v: Array, tau: Array) -> Array:
        if not chain.on_ski:
            return pin.aba(model, data, q, v, tau)
        system = np.zeros((nv + 1, nv + 1))
        system[:nv, :nv] = pin.crba(model, data, q)
        system[nv, 1] = system[1, nv] = 1.0  # the planar joint's velocity is in the ski's own axes: v[1] is sideways
        load = np.append(tau - pin.nonLinearEffects(model, data, q, v), 0.0)
        return np.linalg.solve(system, load)[:nv]

    def rhs(t: float, y: Array) -> Array:
        q, v = pin.normalize(model, y[:nq]), y[nq:]
        tau = np.zeros(nv)
        tau[at_v] = -stiffness * (q[at_q] - rest)
        return np.concatenate([pin.tangentMap(model, q) @ v, accelerations(q, v, tau)])

    def run(rtol: float, times: Sequence[float] = (duration,)) -> Outcome:
        y0 = np.concatenate([q0, v0])
        answer = solve_ivp(rhs, (0.0, duration), y0, method="DOP853", rtol=rtol, atol=0.1 * rtol, t_eval=times)
        if not answer.success:
            raise ArithmeticError(answer.message)
        pin.framesForwardKinematics(model, data, pin.normalize(model, answer.y[:nq, -1]))
        points = [data.oMi[1].translation if chain.on_ski else np.zeros(3)]
        points += [data.oMf[tip].translation for tip in tips]
        return Outcome(np.array(points), int(answer.nfev), None)

    often = np.linspace(0.0, duration, round(SAMPLED * duration) + 1).tolist()
    return {"plain loop": (SETTINGS, run), "plain loop, sampled": (SETTINGS, lambda rtol: run(rtol, often))}


def build(chain: Chain) -> tuple[Any, list[int], list[tuple[int, int, float, float]]]:
    """Build ball joint, slider, rod, slider, link by link; return the model, frames of the tips, springs (q, v, k, rest)."""
    model = pin.Model()
    model.gravity.linear = np.array(chain.gravity)
    joint, place, springs, tips = 0, pin.SE3.Identity(), [], []
    if chain.on_ski:
        joint = model.addJoint(0, pin.JointModelPlanar(), place, "ski")
        inertia = pin.Inertia(chain.ski_mass, np.array([chain.com_offset, 0.0, 0.0]), np.diag([1.0, 1.0, chain.ski_inertia]))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    for i, link in enumerate(chain.links):
        joint = model.addJoint(joint, pin.JointModelSpherical(), place, f"ball{i}")
        place = pin.SE3.Identity()

        def slide(leg: Any, name: str, joint: int, place: Any) -> tuple[int, Any]:
            if not leg.free:
                return joint, place * pin.SE3(np.eye(3), np.array([leg.start, 0.0, 0.0]))
            joint = model.addJoint(joint, pin.JointModelPX(), place, name)
            springs.append((model.joints[joint].idx_q, model.joints[joint].idx_v, leg.stiffness, leg.rest))
            return joint, pin.SE3.Identity()

        joint, place = slide(link.lower, f"lower{i}", joint, place)
        rod = pin.Inertia(link.mass, np.array([link.com, 0.0, 0.0]), link.inertia * np.eye(3))  # ball joints never spin it
        model.appendBodyToJoint(joint, rod, place)
        place = place * pin.SE3(np.eye(3), np.array([link.length, 0.0, 0.0]))
        joint, place = slide(link.upper, f"upper{i}", joint, place)
        if link.tip_mass:
            model.appendBodyToJoint(joint, pin.Inertia(link.tip_mass, np.zeros(3), np.zeros((3, 3))), place)
        tips.append(model.addFrame(pin.Frame(f"tip{i}", joint, place, pin.FrameType.OP_FRAME)))
    return model, tips, springs


def start(chain: Chain, model: Any) -> tuple[Array, Array]:
    """Configuration and velocity at the start."""
    q, v = pin.neutral(model), np.zeros(model.nv)
    before, spin, at = np.eye(3), np.zeros(3), 1
    if chain.on_ski:
        before, spin = pin.utils.rotate("z", chain.phi0), np.array([0.0, 0.0, chain.phi0_dot])
        q[:4] = chain.x, chain.y, np.cos(chain.phi0), np.sin(chain.phi0)
        v[:3] = chain.speed, 0.0, chain.phi0_dot
        at = 2
    for link in chain.links:
        turned, omega, ball = link.rotation(), link.omega(), model.joints[at]
        q[ball.idx_q : ball.idx_q + 4] = pin.Quaternion(before.T @ turned).coeffs()
        v[ball.idx_v : ball.idx_v + 3] = turned.T @ (omega - spin)
        before, spin, at = turned, omega, at + 1
        for leg in (link.lower, link.upper):
            if leg.free:
                q[model.joints[at].idx_q], v[model.joints[at].idx_v] = leg.start, leg.rate
                at += 1
    return q, v
