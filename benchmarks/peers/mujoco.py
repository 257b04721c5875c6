"""MuJoCo: ball joint and sliders, its Runge-Kutta of order 4 with fixed steps, all steps in one compiled call.

No knife edge: MuJoCo has no nonholonomic rows. Springs are joint stiffness, as its documentation has them.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from peers.chain import Chain, Leg, Outcome, Run, UnsupportedError, read_chain

STEPS = (5e-2, 2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5)  # [s]


def prepare(scene: dict[str, Any], duration: float) -> dict[str, tuple[tuple[float, ...], Run]]:
    """Compile the model; return a run of a step."""
    chain = read_chain(scene)
    if chain.on_ski:
        raise UnsupportedError("no nonholonomic constraints, so no knife edge")
    mujoco.set_mju_user_warning(lambda text: None)  # else its warnings of long steps go to a file
    spec, springs = build(chain)
    model = spec.compile()
    data = mujoco.MjData(model)
    tips = [model.site(f"tip{i}").id for i in range(len(chain.links))]

    def run(step: float) -> Outcome:
        count = round(duration / step)
        model.opt.timestep = duration / count
        mujoco.mj_resetData(model, data)
        before, spin = np.eye(3), np.zeros(3)
        for i, link in enumerate(chain.links):
            turned, omega = link.rotation(), link.omega()
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(before.T @ turned).ravel())
            data.joint(f"ball{i}").qpos[:] = quaternion
            data.joint(f"ball{i}").qvel[:] = turned.T @ (omega - spin)
            before, spin = turned, omega
        for name, leg in springs.items():
            data.joint(name).qpos[0], data.joint(name).qvel[0] = leg.start, leg.rate
        mujoco.mj_step(model, data, nstep=count)
        mujoco.mj_kinematics(model, data)
        points = np.vstack([np.zeros(3), data.site_xpos[tips]])
        if not np.isfinite(points).all() or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise ArithmeticError("unstable: MuJoCo reset the state")
        return Outcome(points, 4 * count, count)

    return {"MuJoCo RK4": (STEPS, run)}


def build(chain: Chain) -> tuple[Any, dict[str, Leg]]:
    """Describe the chain; a body for each slider that carries a mass."""
    spec, springs = mujoco.MjSpec(), {}
    spec.option.gravity = chain.gravity
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    spec.compiler.boundmass = 0.0
    body, x = spec.worldbody, 0.0
    for i, link in enumerate(chain.links):
        body = body.add_body(pos=[x, 0.0, 0.0])
        body.add_joint(name=f"ball{i}", type=mujoco.mjtJoint.mjJNT_BALL)
        body.mass, body.inertia, body.explicitinertial = link.mass, [link.inertia] * 3, True
        offset = 0.0
        if link.lower.free:
            _slide(body, f"lower{i}", link.lower)
            springs[f"lower{i}"] = link.lower
        else:
            offset = link.lower.start
        body.ipos = [offset + link.com, 0.0, 0.0]
        x = offset + link.length
        if link.upper.free:
            body = body.add_body(pos=[x, 0.0, 0.0])
            _slide(body, f"upper{i}", link.upper)
            springs[f"upper{i}"] = link.upper
            _tip_mass(body, link.tip_mass)
            x = 0.0
        else:
            x += link.upper.start
            if link.tip_mass:
                body = body.add_body(pos=[x, 0.0, 0.0])
                _tip_mass(body, link.tip_mass)
                x = 0.0
        body.add_site(name=f"tip{i}", pos=[x, 0.0, 0.0])
    return spec, springs


def _slide(body: Any, name: str, leg: Leg) -> None:
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0], stiffness=leg.stiffness, springref=leg.rest)


def _tip_mass(body: Any, mass: float) -> None:
    body.mass, body.inertia, body.explicitinertial = mass, [1e-14] * 3, True
    body.ipos = [0.0, 0.0, 0.0]  # left unset, the compiler puts the centre at the body's own offset
