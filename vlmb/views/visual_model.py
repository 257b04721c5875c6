"""The scenery: what is drawn of a mechanism and how it moves, as pure data for the browser and for stills.

Bodies have paths such as "links/legs/rod/upper"; one moves with the body its path hangs on. Everything is in the surface
frame, which the viewer tilts by the slope, so that gravity points down. Solids have the volume of their mass in water.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.model.coordinates import kinematics
from vlmb.model.mechanism import Mechanism
from vlmb.model.memory import make_data
from vlmb.model.reading import Postures, postures
from vlmb.scene.scene import Scene
from vlmb.scene.tables import Base, Link, Segment
from vlmb.simulation.trajectory import Trajectory
from vlmb.views import appearance, shapes
from vlmb.views.appearance import look_of
from vlmb.views.bodies import Body
from vlmb.views.person import Part, Person, crowns, part_of, person_of, stands_on_legs
from vlmb.views.phase_scenery import draw_footprints, draw_forces, draw_legs, told_events
from vlmb.views.reference_path import course
from vlmb.views.sampling import at_times, smooth
from vlmb.views.shapes import Mesh
from vlmb.views.ties import draw_ties

Array = NDArray[np.float64]

VIEW_FROM = (-0.62, -1.0, 0.42)  # direction from what is looked at to the camera
TRAIL_SECONDS = 1.5  # of the way of a tip
AHEAD = 20.0  # [s] of the way of a programme that a start posture shows
MAX_FRAMES = 200_000
DENSITY = 1000.0  # [kg/m^3], of what masses are drawn as


@dataclass(frozen=True)
class Ground:
    """The plane z = height of the surface frame that is drawn."""

    centre: tuple[float, float]
    half: float  # [m] half the side
    height: float
    spacing: float  # [m] of the lines
    snow: bool


@dataclass(frozen=True)
class Scenery:
    """All bodies over frames t (N,) [s], the ground, and what a camera should look at (N, 3), with its radius [m]."""

    name: str
    t: Array
    slope: float
    bodies: tuple[Body, ...]
    ground: Ground
    focus: Array
    radius: float
    events: tuple[tuple[float, str], ...] = ()  # of contacts: time [s] and words

    @property
    def turn(self) -> Array:
        """Rotation about y that turns the surface frame so that gravity points down: the fall line descends along +x."""
        cosine, sine = math.cos(self.slope), math.sin(self.slope)
        return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])

    def poses(self, frame: int) -> dict[str, Array]:
        """4 x 4 matrices of all bodies in the surface frame at a frame."""
        found: dict[str, Array] = {}
        for body in self.bodies:
            parent = body.path.rpartition("/")[0]
            found[body.path] = found.get(parent, np.eye(4)) @ body.pose(frame)
        return found

    def frame_at(self, time: float) -> int:
        """Return the frame nearest to a time [s]."""
        return int(np.argmin(np.abs(self.t - time)))


def of_state(mechanism: Mechanism, state: tuple[Any, Any], arrows: bool = False) -> Scenery:
    """Return the scenery of one posture."""
    q, v = np.asarray(state[0], float), np.asarray(state[1], float)
    times = np.linspace(0.0, min(mechanism.scene.run.duration, AHEAD), round(AHEAD / 0.01))
    programme = _programme(mechanism, times, np.full(len(times), v[0]), q)
    return _build(mechanism, np.zeros(1), q[None], arrows, None, programme)


def of_trajectory(trajectory: Trajectory, fps: float = 60.0, arrows: bool = False, programme: Any = None) -> Scenery:
    """Return the scenery of a motion at `fps` frames a second, at fewer where that were more than MAX_FRAMES.

    `programme` (n, 2) [m] is drawn as a dashed way; default: the course that the scene's programme prescribes, if it does.
    """
    edge = None
    if arrows and trajectory.mechanism.layout.on_snow and len(trajectory) > 1:
        edge = trajectory.reactions["knife_edge"]
    phased = trajectory if trajectory.stretches else None
    return of_samples(trajectory.mechanism, trajectory.t, trajectory.q, trajectory.v, fps, arrows, edge, programme, phased)


def of_samples(
    mechanism: Mechanism, t: Array, q: Array, v: Array, fps: float = 60.0, arrows: bool = False, edge: Array | None = None,
    programme: Any = None, phased: Trajectory | None = None,
) -> Scenery:  # fmt: skip
    """Return the scenery of samples (q, v) at t (N,) [s], with the knife edge's force (N,) [N] for its arrow.

    phased : the run, where contacts and legs are drawn
    """
    if len(t) < 2:
        return of_state(mechanism, (q[0], v[0]), arrows)
    frames = max(2, round(min((t[-1] - t[0]) * fps, MAX_FRAMES)) + 1)
    when = np.linspace(t[0], t[-1], frames)
    if programme is None:
        programme = _programme(mechanism, t, v[:, 0], q[0])
    edge = None if edge is None else np.interp(when, t, edge)
    return _build(mechanism, when, at_times(mechanism.model, t, q, when), arrows, edge, programme, phased)


def _programme(mechanism: Mechanism, t: Array, speed: Array, q: Array) -> Array | None:
    """The way a programme prescribes from a configuration on."""
    if not mechanism.layout.on_snow:
        return None
    return course(mechanism.scene, t, speed, (float(q[0]), float(q[1]), math.atan2(q[3], q[2])))


def _build(
    mechanism: Mechanism, t: Array, q: Array, arrows: bool, edge: Array | None, programme: Any, phased: Trajectory | None = None
) -> Scenery:
    layout, scene = mechanism.layout, mechanism.scene
    seen = postures(scene, layout, q)
    rotations = kinematics(layout, q, np.zeros((len(q), layout.nv))).rotations
    size = _size(mechanism)
    bodies: list[Body] = []
    base, person = seen.place, person_of(mechanism, seen, rotations)
    if layout.on_snow:
        heading = _about_z(q[:, 2], q[:, 3])
        bodies += draw_ski(scene, base, heading)
        bodies += _bindings(mechanism, size)
        bodies += draw_ways(base, size, programme)
    elif layout.base == "free" and scene.base.mass and not (person and stands_on_legs(person, seen)):
        bodies.append(Body("base", shapes.ball(_ball_radius(scene.base.mass, size)), appearance.MASS, base))
    hinges = [seen.position(i, "hinge") for i in layout.order]
    tips = [seen.position(i, "tip") for i in layout.order]
    for i in layout.order:
        part = part_of(person, mechanism, seen, i) if person else None
        frame = person.rotations.get(i, rotations[:, i]) if person else rotations[:, i]
        bodies += draw_link(scene.links[i], i, seen, frame, size, person, part)
    bodies += draw_ties(mechanism, seen, size)
    heads = crowns(person, mechanism, seen) if person else []
    legs, feet = draw_legs(phased, t, seen, size) if phased else ([], [])
    bodies += legs
    everything = np.stack([base, *hinges, *tips, *heads, *feet], axis=1)
    ground = draw_ground(everything, size, layout.on_snow)
    if layout.base == "pivot":
        below = float(np.mean(everything[..., 2])) > 0.0
        cone = shapes.cone(0.09 * size, 0.05 * size)
        shape = cone if below else shapes.turned_over(cone)
        anchors = dict.fromkeys(link.anchor for link in layout.links if link.parent < 0)
        for number, anchor in enumerate(anchors):
            name = f"stand{number + 1}" if number else "stand"
            bodies.insert(number, Body(name, shape, appearance.STAND, np.array(anchor)))
    if not layout.on_snow and tips and len(t) > 1:
        trail = shapes.Lines(np.stack([tips[-1][:-1], tips[-1][1:]], axis=1))
        bodies.append(Body("trail", trail, appearance.TRAIL, grows=True, keeps=TRAIL_SECONDS, shadow=False))
    if phased:
        bodies += draw_footprints(phased, t, size, ground.height)
    if arrows:
        bodies += _arrows(mechanism, q, size, edge, ground.height)
    if arrows and phased:
        bodies += draw_forces(phased, t, seen, 0.35 * size, _weight(scene))
    centre = 0.5 * (everything.min(axis=1) + everything.max(axis=1))
    focus = np.broadcast_to(everything.reshape(-1, 3).mean(axis=0), centre.shape) if layout.base == "pivot" else centre
    radius = float(np.linalg.norm(everything - focus[:, None], axis=2).max()) + 0.25 * size
    if layout.on_snow:
        radius = max(radius, float(np.linalg.norm(base - focus, axis=1).max()) + 0.5 * _ski_length(scene.base))
    if layout.base != "pivot":
        focus = smooth(focus)
    events = tuple(told_events(phased)) if phased else ()
    return Scenery(scene.name, t, scene.slope, tuple(bodies), ground, np.array(focus), max(radius, 0.6 * size), events)


def draw_link(
    link: Link, number: int, seen: Postures | Any, frame: Array, size: float, person: Person | None = None,
    part: Part | None = None,
) -> list[Body]:  # fmt: skip
    """Lower segment, rod, upper segment, hinge and point mass of a link, and what it wears."""
    look = look_of(link.name, number)
    length = link.rod.length
    volume = max(link.rod.mass, 1e-9) / DENSITY
    low, high = 0.012 * size, max(0.75 * length, 0.012 * size)
    radius = look.thickness * float(np.clip(math.sqrt(volume / (math.pi * max(length, 1e-9))), low, high))
    thin = max(0.35 * radius, 0.008 * size)
    if part is None:
        rod = shapes.limb(length, radius) if length > 0.0 else None
        mass = shapes.ball(_ball_radius(link.tip_mass, size)) if link.tip_mass else None
        part = Part(rod, shapes.bellows(thin), shapes.bellows(0.85 * thin), mass, appearance.MASS)
    else:
        thin = 0.02 * person.scale if person else thin
    path = f"links/{link.name}"
    lower = seen.distance(number, "rod_start")
    upper = seen.distance(number, "tip") - seen.distance(number, "rod_end")
    colour = look.colour if look.part else appearance.HINGE
    bodies = [Body(path, shapes.ball(1.15 * thin), colour, seen.position(number, "hinge"), frame)]
    if np.any(lower != 0.0):
        bodies.append(Body(f"{path}/lower", *_segment(link.lower, part.lower, thin), scale=_along(lower, 1.0)))
    bodies.append(Body(f"{path}/rod", part.rod, look.colour, position=_along(lower, 0.0)))
    if np.any(upper != 0.0):
        at = np.array([length, 0.0, 0.0])
        made = _segment(link.upper, part.upper, 0.8 * thin)
        bodies.append(Body(f"{path}/rod/upper", *made, position=at, scale=_along(upper, 1.0)))
    if part.mass is not None:
        bodies.append(Body(f"{path}/rod/mass", part.mass, part.mass_colour, position=_along(length + upper, 0.0)))
    for worn in part.worn:
        on = {None: "person", "ski": "ski", "": path}.get(worn.on, f"{path}/{worn.on}")
        name = f"{worn.name}_{link.name}" if worn.on == "ski" else worn.name
        bodies.append(Body(f"{on}/{name}", worn.shape, worn.colour, worn.position, worn.rotation))
    return bodies


def _segment(segment: Segment, sleeve: Mesh, thin: float) -> tuple[Mesh, str]:
    """A sleeve for a segment that changes its length, a plain tube for one that does not."""
    return (shapes.tube(thin), appearance.TELESCOPE) if segment.motion == "fixed" else (sleeve, appearance.STRETCH)


def draw_ski(scene: Scene, base: Array, heading: Array) -> list[Body]:
    """The ski along its way."""
    length, offset = _ski_length(scene.base), scene.base.com_offset
    bodies = [Body("ski", shapes.ski(length), appearance.SKI, base, heading)]
    centre = np.array([offset, 0.0, 0.02 * length])
    if not (scene.links or scene.robots) or offset:
        ball = shapes.ball(min(_ball_radius(scene.base.mass, 1.0), 0.05 * length))
        bodies.append(Body("ski/mass", ball, appearance.MASS, centre))
    return bodies


def _bindings(mechanism: Mechanism, size: float) -> list[Body]:
    """Bars from the ski to the anchors of links that do not stand in A."""
    bodies, half = [], 0.45 * _ski_length(mechanism.scene.base)
    for link in mechanism.layout.links:
        if link.parent >= 0 or not any(link.anchor):
            continue
        foot = np.array([np.clip(link.anchor[0], -half, half), 0.0, 0.0])
        way = np.array(link.anchor) - foot
        length = float(np.linalg.norm(way))
        if length > 0.0:
            scale = np.array([length, 1.0, 1.0])
            tube = shapes.tube(0.012 * size)
            bodies.append(Body(f"ski/binding_{link.name}", tube, appearance.HINGE, foot, _towards(way / length), scale))
    return bodies


def _towards(direction: Array) -> Array:
    """Return a rotation (3, 3) that takes x to a direction."""
    side = np.cross([0.0, 0.0, 1.0] if abs(direction[2]) < 0.9 else [0.0, 1.0, 0.0], direction)
    side /= np.linalg.norm(side)
    return np.column_stack([direction, side, np.cross(direction, side)])


def _ski_length(base: Base) -> float:
    return float(np.clip(math.sqrt(12.0 * base.inertia / base.mass), 0.7, 2.0))


def draw_ways(base: Array, size: float, programme: Any) -> list[Body]:
    """The track left behind and the way of a programme."""
    bodies = []
    if len(base) > 1:
        bodies.append(Body("track", shapes.ribbon(base[:, :2], 0.05 * size, 0.004), appearance.TRACK, grows=True, shadow=False))
    if programme is not None:
        way = shapes.dashes(np.asarray(programme, float), 0.03 * size, 0.006, 0.3 * size)
        bodies.append(Body("programme", way, appearance.PROGRAMME, shadow=False))
    return bodies


def _arrows(mechanism: Mechanism, q: Array, size: float, edge: Array | None, floor: float) -> list[Body]:
    """Gravity at the centre of mass and the edge force on the ski, to one scale; neither goes through the ground."""
    model, data, scene = mechanism.model, make_data(mechanism.model), mechanism.scene
    down = np.array(scene.surface_gravity)
    weight = _weight(scene)
    bodies, reach = [], 0.7 * size
    if weight > 0.0:
        centre = np.array([pin.centerOfMass(model, data, row) for row in q])
        down = down / np.linalg.norm(down)
        if down[2] < 0.0:
            room = (centre[:, 2] - floor) / -down[2]
            reach = float(np.clip(0.9 * np.median(room), 0.3 * size, 0.7 * size))
            centre = centre - np.maximum(reach + 0.02 * size - room, 0.0)[:, None] * down
        side = np.cross([0.0, 1.0, 0.0], down)
        turned = np.column_stack([down, [0.0, 1.0, 0.0], -side])
        bodies.append(Body("gravity", shapes.arrow(reach), appearance.GRAVITY, centre, turned, shadow=False, in_front=True))
    if edge is not None:
        left = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        share = edge / max(weight, 1e-9)
        scale = np.repeat(np.where(np.abs(share) < 1e-4, 1e-4, share)[:, None], 3, axis=1)
        at = np.array([0.0, 0.0, 0.07 * reach * max(1.0, float(np.abs(share).max()))])  # its head stays above the snow
        arrow = shapes.arrow(reach)
        bodies.append(Body("ski/edge_force", arrow, appearance.EDGE_FORCE, at, left, scale, shadow=False, in_front=True))
    return bodies


def _weight(scene: Scene) -> float:
    return scene.gravity * (scene.base.mass + sum(link.rod.mass + link.tip_mass for link in scene.links))


def draw_ground(everything: Array, size: float, on_snow: bool) -> Ground:
    """The ground below all places (N, any, 3) of a motion."""
    low = everything.reshape(-1, 3).min(axis=0)
    high = everything.reshape(-1, 3).max(axis=0)
    on_ground = on_snow or (low[2] > -0.02 * size and everything[..., 2].mean() > 0.1 * size)
    centre = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2)
    reach = float(max(high[:2] - low[:2])) / 2 + 40.0 * size
    spacing = 10.0 ** round(math.log10(0.7 * size))
    spacing *= 2.0 ** max(0, math.ceil(math.log2(reach / spacing / 80.0)))
    return Ground(centre, reach, 0.0 if on_ground else float(low[2]) - 0.25 * size, spacing, on_snow)


def _size(mechanism: Mechanism) -> float:
    """Return a length [m] typical of the mechanism: its longest branch at the start lengths."""
    layout = mechanism.layout
    lengths = [link.lower.length + link.rod_length + link.upper.length for link in layout.links]
    legs = [leg.length or 1.0 for leg in mechanism.scene.legs]
    return max([*(sum(lengths[k] for k in layout.path(i)) for i in range(len(lengths))), *legs], default=0.0) or 1.0


def _ball_radius(mass: float, size: float) -> float:
    radius = (0.75 * mass / (math.pi * DENSITY)) ** (1 / 3)
    return float(np.clip(radius, 0.02 * size, 0.14 * size)) if size else radius


def _along(values: Array, others: float) -> Array:
    """Vectors (N, 3) with values along x; never exactly 0 where they are scales."""
    found = np.full((len(values), 3), others)
    found[:, 0] = np.where(np.abs(values) < 1e-6, 1e-6, values) if others else values
    return found


def _about_z(cosine: Array, sine: Array) -> Array:
    turned = np.zeros((len(cosine), 3, 3))
    turned[:, 0, 0] = turned[:, 1, 1] = cosine
    turned[:, 1, 0], turned[:, 0, 1], turned[:, 2, 2] = sine, -sine, 1.0
    return turned
