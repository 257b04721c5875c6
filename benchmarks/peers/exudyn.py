"""EXUDYN: a kinematic tree in minimal coordinates, its explicit DOPRI5 with automatic steps.

Two revolute joints and the sliders of each link; springs are the position gains of the joints. The explicit solvers take no
constraints, so a ski runs with generalized alpha and fixed steps: the knife edge is a rolling disc that holds sideways alone.
"""

from __future__ import annotations

from typing import Any

import exudyn as exu
import numpy as np
from exudyn.itemInterface import (
    MarkerBodyRigid,
    MarkerKinematicTreeRigid,
    NodeGenericODE2,
    ObjectGround,
    ObjectJointRollingDisc,
    ObjectKinematicTree,
)
from peers.chain import Array, Chain, Outcome, Run, UnsupportedError, read_chain, two_angles

SETTINGS = tuple(10.0 ** -(k / 2) for k in range(4, 25))  # relative tolerance; the absolute one a tenth of it
STEPS = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5)  # [s] on a ski
LINKS = 8


def prepare(scene: dict[str, Any], duration: float) -> dict[str, tuple[tuple[float, ...], Run]]:
    """Assemble the tree; return a run of a tolerance, on a ski of a step."""
    chain = read_chain(scene)
    if len(chain.links) > LINKS:
        raise UnsupportedError(f"set up for {LINKS} links: 50 take half a minute a run at the loosest tolerance")
    container = exu.SystemContainer()
    system = container.AddSystem()
    node = build(chain, system)
    system.Assemble()
    settings = exu.SimulationSettings()
    settings.solutionSettings.writeSolutionToFile = False
    integration = settings.timeIntegration
    integration.endTime = duration
    integration.verboseMode = 0

    def solve(kind: Any, steps: int | None) -> Outcome:
        if not system.SolveDynamic(settings, solverType=kind):
            raise ArithmeticError("the solver gave up")
        return Outcome(points(chain, system.GetNodeOutput(node, exu.OutputVariableType.Coordinates)), None, steps)

    def adaptive(rtol: float) -> Outcome:
        integration.relativeTolerance, integration.absoluteTolerance = rtol, 0.1 * rtol
        return solve(exu.DynamicSolverType.DOPRI5, None)

    def fixed(step: float) -> Outcome:
        count = integration.numberOfSteps = round(duration / step)
        return solve(exu.DynamicSolverType.GeneralizedAlpha, count)

    if chain.on_ski:
        integration.generalizedAlpha.spectralRadius = 1.0  # damps nothing
        integration.newton.relativeTolerance, integration.newton.absoluteTolerance = 1e-10, 1e-12
        return {"EXUDYN generalized alpha": (STEPS, fixed)}
    integration.automaticStepSize = True
    integration.numberOfSteps = round(duration / 0.1)  # the longest step: 0.1 s
    return {"EXUDYN DOPRI5": (SETTINGS, adaptive)}


def build(chain: Chain, system: Any) -> Any:
    """Add the tree and the knife edge; return the tree's node. Massless bodies carry what has no mass between joints."""
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

    if chain.on_ski:
        joint(exu.JointType.PrismaticX, chain.x, chain.speed * np.cos(chain.phi0), 0.0)
        joint(exu.JointType.PrismaticY, chain.y, chain.speed * np.sin(chain.phi0), 0.0)
        joint(exu.JointType.RevoluteZ, chain.phi0, chain.phi0_dot, 0.0)
        load(chain.ski_mass, chain.com_offset, chain.ski_inertia)
    ski = len(kinds) - 1
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
    tree = system.AddObject(
        ObjectKinematicTree(
            nodeNumber=node, jointTypes=kinds, linkParents=list(range(-1, count - 1)),
            jointTransformations=exu.Matrix3DList([np.eye(3)] * count), jointOffsets=exu.Vector3DList(offsets),
            linkInertiasCOM=exu.Matrix3DList(inertias), linkCOMs=exu.Vector3DList(centres), linkMasses=masses,
            jointPositionOffsetVector=rests, jointPControlVector=gains, gravity=list(chain.gravity),
        )
    )  # fmt: skip
    if chain.on_ski:
        ground = system.AddMarker(MarkerBodyRigid(bodyNumber=system.AddObject(ObjectGround())))
        edge = system.AddMarker(MarkerKinematicTreeRigid(objectNumber=tree, linkNumber=ski))
        sideways = {"constrainedAxes": [1, 0, 0], "discAxis": [0.0, 1.0, 0.0]}
        system.AddObject(ObjectJointRollingDisc(markerNumbers=[ground, edge], discRadius=1.0, **sideways))
    return node


def points(chain: Chain, coordinates: Array) -> Array:
    """Points (1 + n, 3) from the angles and lengths."""
    found, turned, left = [np.zeros(3)], np.eye(3), iter(coordinates)
    if chain.on_ski:
        found = [np.array([next(left), next(left), 0.0])]
        heading = next(left)
        c, s = np.cos(heading), np.sin(heading)
        turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    for link in chain.links:
        a, b = next(left), -next(left)
        ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
        turned = turned @ np.array([[ca * cb, -sa, -ca * sb], [sa * cb, ca, -sa * sb], [sb, 0.0, cb]])
        length = link.length + sum(next(left) if leg.free else leg.start for leg in (link.lower, link.upper))
        found.append(found[-1] + length * turned[:, 0])
    return np.array(found)
