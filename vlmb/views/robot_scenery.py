"""What is drawn of robots: the meshes of their URDFs, once each, on bodies that move; without any, boxes of inertia."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import SceneError
from vlmb.model.robot_files import Drawn, drawn_shapes
from vlmb.model.robot_mechanism import RobotMechanism
from vlmb.model.robot_model import identifier
from vlmb.simulation.robot_trajectory import RobotTrajectory
from vlmb.views import appearance, shapes
from vlmb.views.bodies import Body
from vlmb.views.meshes import box, load_mesh
from vlmb.views.sampling import at_times, smooth
from vlmb.views.shapes import Mesh
from vlmb.views.visual_model import Scenery, draw_ground, draw_link, draw_ski, draw_ways

Array = NDArray[np.float64]

FPS = 30.0  # frames a second of a page, at most: so many bodies move
PLAIN = "#b9c0c8"  # where a URDF tells no colour
BOXED = "#8fa3b8"  # boxes of inertia
WIDE = 4.0  # of a board, times a ski
TRAIL_SECONDS = 2.0
MARGIN = 1.3  # of a view around the meshes
FACES = 50_000  # of all meshes of a robot


class Seen:
    """Where the points of links are, as `visual_model` asks for them."""

    def __init__(self, mechanism: RobotMechanism, places: dict[str, Array]) -> None:
        self.names, self.places = [link.name for link in mechanism.scene.links], places

    def position(self, link: int, point: str) -> Array:
        """Return the places (N, 3) of a point."""
        return self.places[f"{self.names[link]}.{point}"]

    def distance(self, link: int, point: str) -> Array:
        """Return its distances (N,) from the hinge."""
        found: Array = np.linalg.norm(self.position(link, point) - self.position(link, "hinge"), axis=1)
        return found


def of_robot_state(mechanism: RobotMechanism, state: tuple[Any, Any]) -> Scenery:
    """Return the scenery of one posture."""
    return _build(mechanism, np.zeros(1), np.asarray(state[0], float)[None])


def of_robot_run(trajectory: RobotTrajectory, fps: float) -> Scenery:
    """Return the scenery of a motion at `fps` frames a second, at most FPS."""
    return of_robot_samples(trajectory.mechanism, trajectory.t, trajectory.q, fps)


def of_robot_samples(mechanism: RobotMechanism, t: Array, q: Array, fps: float = FPS) -> Scenery:
    """Return the scenery of samples q (N, nq) at t (N,) [s]."""
    if len(t) < 2:
        return _build(mechanism, np.zeros(1), np.asarray(q[:1], float))
    when = np.linspace(t[0], t[-1], max(2, round((t[-1] - t[0]) * min(fps, FPS))) + 1)
    return _build(mechanism, when, at_times(mechanism.model, t, q, when))


def _build(mechanism: RobotMechanism, t: Array, q: Array) -> Scenery:
    model, scene = mechanism.model, mechanism.scene
    data = pin.Data(model)
    turns, places = np.zeros((model.njoints, len(q), 3, 3)), np.zeros((model.njoints, len(q), 3))
    points = {name: np.zeros((len(q), 3)) for name in mechanism.frames if name.partition(".")[0] in mechanism.names.link_numbers}
    for i, row in enumerate(q):
        pin.framesForwardKinematics(model, data, row)
        for joint in range(model.njoints):
            turns[joint, i], places[joint, i] = data.oMi[joint].rotation, data.oMi[joint].translation
        for name, values in points.items():
            values[i] = data.oMf[mechanism.frames[name]].translation
    size = max(1e-3, float(np.ptp(places[1:, 0], axis=0).max()))
    bodies: list[Body] = []
    on_ski = scene.on_snow
    if on_ski:
        base = places[1]
        for body in draw_ski(scene, base, turns[1]):
            wide = np.array([1.0, WIDE if body.path == "ski" else 1.0, 1.0])
            bodies.append(Body(body.path, body.shape, body.colour, body.position, body.rotation, wide))
        bodies += draw_ways(base, size, None)
    drawn: list[tuple[int, Mesh]] = []
    for number, robot in enumerate(scene.robots):
        parts = _parts(mechanism, number)
        drawn += [(joint, mesh) for joint, own in parts.items() for mesh in own.values()]
        for joint in sorted(parts):
            path = f"robots/{robot.name}/{identifier(model.names[joint].partition('.')[2] or 'base')}"
            where = (places[joint], turns[joint]) if joint else (np.zeros(3), np.eye(3))
            for at, (colour, mesh) in enumerate(parts[joint].items()):
                bodies.append(Body(path, mesh, colour, *where) if not at else Body(f"{path}/part{at}", mesh, colour))
    seen = Seen(mechanism, points)
    for number, link in enumerate(scene.links):
        hinge = model.getJointId(link.name)
        bodies += draw_link(link, number, seen, turns[hinge], size)
    if not on_ski and len(t) > 1:
        last = max(range(model.njoints), key=lambda joint: float(np.ptp(places[joint], axis=0).max()))
        trail = shapes.Lines(np.stack([places[last][:-1], places[last][1:]], axis=1))
        bodies.append(Body("trail", trail, appearance.TRAIL, grows=True, keeps=TRAIL_SECONDS, shadow=False))
    moves = on_ski or bool(mechanism.roots)
    joints = np.moveaxis(places[1:] if moves else places, 0, 1)
    everything = np.concatenate([joints, *(values[:, None] for values in points.values())], axis=1)
    ground = draw_ground(everything, size, on_ski)
    centre = 0.5 * (everything.min(axis=1) + everything.max(axis=1))
    focus = smooth(centre) if moves else np.broadcast_to(everything.reshape(-1, 3).mean(axis=0), centre.shape)
    first = [mesh.vertices @ turns[joint, 0].T + places[joint, 0] if joint else mesh.vertices for joint, mesh in drawn]
    whole = np.concatenate([everything[0], *first])  # heads and hands are beyond their joints
    focus = focus + (0.5 * (whole.min(axis=0) + whole.max(axis=0)) - centre[0] if moves else 0.0)
    radius = float(np.linalg.norm(everything - focus[:, None], axis=2).max()) + 0.2 * size
    radius = max(radius, MARGIN * float(np.linalg.norm(whole - focus[0], axis=1).max()))
    return Scenery(scene.name, t, scene.slope, tuple(bodies), ground, np.array(focus), radius)


def _parts(mechanism: RobotMechanism, number: int) -> dict[int, dict[str, Mesh]]:
    """Return the shapes of a robot by joint and colour, each in its joint's frame."""
    model, robot = mechanism.model, mechanism.scene.robots[number]
    pieces: dict[int, dict[str, list[Mesh]]] = {}
    drawn: list[Drawn] = []
    if mechanism.given is None:
        try:
            drawn = drawn_shapes(robot.urdf)
        except SceneError:
            drawn = []
    loaded: dict[tuple[Any, ...], Mesh | None] = {}
    most = int(np.clip(FACES / max(1, sum(shape.kind == "mesh" for shape in drawn)), 500, 4000))
    for shape in drawn:
        frame = mechanism.frames.get(f"{robot.name}.{identifier(shape.link)}")
        key = (shape.kind, shape.sizes, shape.file)
        if key not in loaded:
            loaded[key] = _mesh(shape, most)
        mesh = loaded[key]
        if frame is None or mesh is None:
            continue
        joint, place = int(model.frames[frame].parentJoint), model.frames[frame].placement
        own = place * pin.SE3(pin.rpy.rpyToMatrix(*shape.place[3:]), np.array(shape.place[:3]))
        moved = Mesh(mesh.vertices @ own.rotation.T + own.translation, mesh.faces, mesh.flat)
        pieces.setdefault(joint, {}).setdefault(shape.colour or PLAIN, []).append(moved)
    if not pieces:
        for joint in range(1, model.njoints):
            inertia = model.inertias[joint]
            if model.names[joint].partition(".")[0] == robot.name and inertia.mass > 0.0:
                pieces[joint] = {BOXED: [inertia_box(inertia)]}
    return {joint: {colour: shapes.join(group) for colour, group in by.items()} for joint, by in pieces.items()}


def inertia_box(inertia: Any) -> Mesh:
    """Return the box of even density that has an inertia: its sides from the principal moments."""
    moments, axes = np.linalg.eigh(inertia.inertia)
    sides = np.sqrt(np.maximum(6.0 / inertia.mass * (moments.sum() - 2.0 * moments), 1e-6))
    axes = axes * np.sign(np.linalg.det(axes))
    made = box(*sides.tolist())
    return Mesh(made.vertices @ axes.T + inertia.lever, made.faces, True)


def _mesh(shape: Drawn, most: int) -> Mesh | None:
    """Return a shape as triangles in its own frame."""
    if shape.kind == "box" and len(shape.sizes) == 3:
        return box(*shape.sizes)
    if shape.kind == "sphere":
        return shapes.ball(shape.sizes[0])
    if shape.kind == "cylinder":
        length, radius = shape.sizes
        lying = shapes.tube(radius)
        x, y, z = lying.vertices.T
        return Mesh(np.column_stack([-z, y, (x - 0.5) * length]), lying.faces, True)
    return load_mesh(shape.file, shape.sizes, most) if shape.file is not None else None
