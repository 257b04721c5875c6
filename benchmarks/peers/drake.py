"""Drake: a continuous MultibodyPlant with universal and prismatic joints, its error-controlled Runge-Kutta of order 5.

No knife edge: a continuous plant has no nonholonomic constraints. Springs are `PrismaticSpring` elements.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from peers.chain import Chain, Leg, Outcome, Run, UnsupportedError, read_chain, two_angles
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, PrismaticJoint, PrismaticSpring, SpatialInertia, UnitInertia, UniversalJoint
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

SETTINGS = tuple(10.0 ** -(k / 2) for k in range(6, 25))  # target accuracy; a looser one counts as 1e-3
LONGEST = 0.1  # [s] a first step of the whole duration is never recovered from
TURN = RotationMatrix(np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]))  # the joint's x and y: the body's z and -y


def prepare(scene: dict[str, Any], duration: float) -> dict[str, tuple[tuple[float, ...], Run]]:
    """Build the plant and the simulator; return a run of an accuracy."""
    chain = read_chain(scene)
    if chain.on_ski:
        raise UnsupportedError("no nonholonomic constraints in a continuous plant, so no knife edge")
    plant, tips = build(chain)
    simulator = Simulator(plant)
    ResetIntegratorFromFlags(simulator, "runge_kutta5", LONGEST)
    integrator, context = simulator.get_mutable_integrator(), simulator.get_mutable_context()
    angles = two_angles(chain)

    def run(accuracy: float) -> Outcome:
        context.SetTime(0.0)
        for i, (link, (a, b, a_dot, b_dot)) in enumerate(zip(chain.links, angles, strict=True)):
            joint = plant.GetJointByName(f"universal{i}")
            joint.set_angles(context, [a, b])
            joint.set_angular_rates(context, [a_dot, b_dot])
            for name, leg in ((f"lower{i}", link.lower), (f"upper{i}", link.upper)):
                if leg.free:
                    slide = plant.GetJointByName(name)
                    slide.set_translation(context, leg.start)
                    slide.set_translation_rate(context, leg.rate)
        integrator.Reset()  # else it begins with the last run's step
        integrator.set_maximum_step_size(LONGEST)
        integrator.set_target_accuracy(accuracy)
        simulator.Initialize()
        integrator.ResetStatistics()
        simulator.AdvanceTo(duration)
        points = [np.zeros(3), *(plant.EvalBodyPoseInWorld(context, body) @ place for body, place in tips)]
        return Outcome(np.array(points), integrator.get_num_derivative_evaluations(), integrator.get_num_steps_taken())

    return {"Drake RK5": (SETTINGS, run)}


def build(chain: Chain) -> tuple[Any, list[tuple[Any, Any]]]:
    """Describe the chain: a massless body carries each lower slider; return the plant, and body and place of each tip."""
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector(np.array(chain.gravity))
    body, x, tips = plant.world_body(), 0.0, []

    def slide(name: str, leg: Leg, body: Any, x: float, inertia: Any) -> tuple[Any, float]:
        child = plant.AddRigidBody(name, inertia)
        joint = plant.AddJoint(
            PrismaticJoint(name, _frame(plant, body, x, RotationMatrix()), child.body_frame(), np.array([1.0, 0.0, 0.0]))
        )
        plant.AddForceElement(PrismaticSpring(joint, leg.rest, leg.stiffness))
        return child, 0.0

    def point(mass: float) -> Any:
        return SpatialInertia(mass, np.zeros(3), UnitInertia(0.0, 0.0, 0.0))

    for i, link in enumerate(chain.links):
        ratio = link.inertia / link.mass
        centred = UnitInertia(0.0, ratio, ratio)

        def rod(offset: float, link: Any = link, centred: Any = centred) -> Any:
            place = np.array([offset + link.com, 0.0, 0.0])
            return SpatialInertia(link.mass, place, centred.ShiftFromCenterOfMass(place))

        first = SpatialInertia.Zero() if link.lower.free else rod(link.lower.start)
        child = plant.AddRigidBody(f"link{i}", first)
        plant.AddJoint(UniversalJoint(f"universal{i}", _frame(plant, body, x, TURN), _frame(plant, child, 0.0, TURN)))
        body, x = child, link.lower.start
        if link.lower.free:
            body, x = slide(f"lower{i}", link.lower, body, 0.0, rod(0.0))
        x += link.length
        if link.upper.free:
            body, x = slide(f"upper{i}", link.upper, body, x, point(link.tip_mass))
        else:
            x += link.upper.start
            if link.tip_mass:
                child = plant.AddRigidBody(f"tip{i}", point(link.tip_mass))
                plant.WeldFrames(_frame(plant, body, x, RotationMatrix()), child.body_frame())
        tips.append((body, np.array([x, 0.0, 0.0])))
    plant.Finalize()
    return plant, tips


def _frame(plant: Any, body: Any, x: float, turn: Any) -> Any:
    frame = FixedOffsetFrame(f"{body.name()}_{plant.num_frames()}", body, RigidTransform(turn, np.array([x, 0.0, 0.0])))
    return plant.AddFrame(frame)
