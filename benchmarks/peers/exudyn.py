"""EXUDYN: a kinematic tree in minimal coordinates, its explicit DOPRI5 with automatic steps.

Two revolute joints and the sliders of each link; springs are the position gains of the joints. No knife edge: its explicit
solvers take no constraints, and its implicit ones are not set up here.
"""

from __future__ import annotations

from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree
from peers.chain import Array, Chain, Outcome, Run, UnsupportedError, read_chain, two_angles

SETTINGS = tuple(10.0 ** -(k / 2) for k in range(4, 25))  # relative tolerance; the absolute one a tenth of it


def prepare(scene: dict[str, Any], duration: float) -> dict[str, tuple[tuple[float, ...], Run]]:
    """Assemble the tree; return a run of a tolerance."""
    chain = read_chain(scene)
    if chain.on_ski:
        raise UnsupportedError("its explicit solvers take no constraints, thus no knife edge; implicit ones are not set up here")
    container = exu.SystemContainer()
    system = container.AddSystem()
    node = build(chain, system)
    system.Assemble()
    settings = exu.SimulationSettings()
    settings.solutionSettings.writeSolutionToFile = False
    settings.timeIntegration.endTime = duration
    settings.timeIntegration.automaticStepSize = True
    settings.timeIntegration.numberOfSteps = round(duration / 0.1)  # the longest step: 0.1 s
    settings.timeIntegration.verboseMode = 0

    def run(rtol: float) -> Outcome:
        settings.timeIntegration.relativeTolerance = rtol
        settings.timeIntegration.absoluteTolerance = 0.1 * rtol
        if not system.SolveDynamic(settings, solverType=exu.DynamicSolverType.DOPRI5):
            raise ArithmeticError("the solver gave up")
        return Outcome(points(chain, system.GetNodeOutput(node, exu.OutputVariableType.Coordinates)), None, None)

    return {"EXUDYN DOPRI5": (SETTINGS, run)}


def build(chain: Chain, system: Any) -> Any:
    """Add the tree; return its node. Massless links carry the first angle and the first slider of each rod."""
    kinds, masses, centres, inertias, offsets, gains, rests = [], [], [], [], [], [], []
    values: list[float] = []
    rates: list[float] = []
    x = 0.0

    def joint(kind: Any, value: float, rate: float, offset: float, gain: float = 0.0, rest: float = 0.0) -> None:
        kinds.append(kind)
        values.append(value)
        rates.append(rate)
        offsets.append([offset, 0.0, 0.0])
        gains.append(gain)
        rests.append(rest)
        masses.append(0.0)
        centres.append([0.0, 0.0, 0.0])
        inertias.append(np.zeros((3, 3)))

    def load(mass: float, centre: float, transverse: float) -> None:
        masses[-1], centres[-1] = mass, [centre, 0.0, 0.0]
        inertias[-1] = np.diag([0.0, transverse, transverse])

    for link, (a, b, a_dot, b_dot) in zip(chain.links, two_angles(chain), strict=True):
        joint(exu.JointType.RevoluteZ, a, a_dot, x)
        joint(exu.JointType.RevoluteY, -b, -b_dot, 0.0)
        x = 0.0 if link.lower.free else link.lower.start
        if link.lower.free:
            joint(exu.JointType.PrismaticX, link.lower.start, link.lower.rate, 0.0, link.lower.stiffness, link.lower.rest)
        if link.tip_mass and not link.upper.free:
            raise UnsupportedError("written for masses that hang on springs")
        load(link.mass, x + link.com, link.inertia)
        x += link.length
        if link.upper.free:
            joint(exu.JointType.PrismaticX, link.upper.start, link.upper.rate, x, link.upper.stiffness, link.upper.rest)
            load(link.tip_mass, 0.0, 0.0)
            x = 0.0
        else:
            x += link.upper.start
    count = len(kinds)
    node = system.AddNode(
        NodeGenericODE2(
            numberOfODE2Coordinates=count, referenceCoordinates=[0.0] * count,
            initialCoordinates=values, initialCoordinates_t=rates,
        )
    )  # fmt: skip
    system.AddObject(
        ObjectKinematicTree(
            nodeNumber=node, jointTypes=kinds, linkParents=list(range(-1, count - 1)),
            jointTransformations=exu.Matrix3DList([np.eye(3)] * count), jointOffsets=exu.Vector3DList(offsets),
            linkInertiasCOM=exu.Matrix3DList(inertias), linkCOMs=exu.Vector3DList(centres), linkMasses=masses,
            jointPositionOffsetVector=rests, jointPControlVector=gains, gravity=list(chain.gravity),
        )
    )  # fmt: skip
    return node


def points(chain: Chain, coordinates: Array) -> Array:
    """Points (1 + n, 3) from the angles and lengths."""
    found, turned, left = [np.zeros(3)], np.eye(3), iter(coordinates)
    for link in chain.links:
        a, b = next(left), -next(left)
        ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
        turned = turned @ np.array([[ca * cb, -sa, -ca * sb], [sa * cb, ca, -sa * sb], [sb, 0.0, cb]])
        length = link.length + sum(next(left) if leg.free else leg.start for leg in (link.lower, link.upper))
        found.append(found[-1] + length * turned[:, 0])
    return np.array(found)
