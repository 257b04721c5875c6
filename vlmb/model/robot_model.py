"""One Pinocchio model of a scene with robots: the ski, robots from their URDFs, links that hang on their frames."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import SceneError, nearest
from vlmb.model.mechanism import build
from vlmb.model.robot_files import RobotText, Tie, postures_of, read_robot
from vlmb.scene.scene import Scene
from vlmb.scene.tables import BASE, Base, Link, Robot

Array = NDArray[np.float64]

ROOT = "root"
HINGES = {"JointModelFreeFlyer": "free", "JointModelPlanar": "planar", "JointModelSpherical": "ball"}
NO_LIMIT = 1e29  # what a URDF says of a joint that has none


@dataclass(frozen=True, eq=False)
class Robots:
    """The model of a scene with robots and what is known of its parts."""

    model: Any
    names: tuple[str, ...]  # of the robots
    texts: tuple[RobotText | None, ...]  # their URDFs; None for a model that was given
    frames: Mapping[str, int]  # by every name a scene may use
    reference: Array  # (nq,) posture of the scene's tables
    given: frozenset[str]  # joints whose start a posture tells
    links: tuple[tuple[str, int], ...]  # links of the scene with the number they count by, 1 for the first
    left_out: tuple[str, ...]
    driven: frozenset[str] = frozenset()  # coordinates that follow laws
    ties: tuple[Tie, ...] = ()  # of joints that mimic others, by the names of the model; one that mimics none has a place


def identifier(name: str) -> str:
    """Return a name as expressions may use it."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return plain if re.match(r"[A-Za-z]", plain) else f"j{plain}"


def assemble(scene: Scene) -> Robots:
    """Make the model. Raises SceneError for files, frames, joints and postures that are not there or not usable."""
    model, left_out, reference = pin.Model(), list[str](), np.zeros(0)
    texts: list[RobotText | None] = []
    ties: list[Tie] = []
    given: set[str] = set()
    model.name, model.gravity.linear = scene.name, np.array(scene.surface_gravity)
    if scene.base.kind == "ski":
        base = scene.base
        ski = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "ski")
        inertia = pin.Inertia(base.mass, np.array([base.com_offset, 0.0, 0.0]), np.diag([0.0, base.inertia, base.inertia]))
        model.appendBodyToJoint(ski, inertia, pin.SE3.Identity())
        model.addFrame(pin.Frame("ski", ski, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME), False)
        reference = pin.neutral(model)
    for number, robot in enumerate(scene.robots):
        key = f"robots[{number}]"
        text = read_robot(robot.urdf, f"{key}.urdf")
        made, posture, told, notes, own = _robot(robot, text, key)
        at = 0 if robot.attach.to == "ground" else frame_id(model, scene, robot.attach.to, f"{key}.attach.to")
        model, reference = _append(model, reference, made, posture, at)
        texts.append(text)
        given |= told
        ties += own
        left_out += notes
    numbers = {link.name: at + 1 for at, link in enumerate(scene.links)}
    every = ((link, which) for link in scene.links for which in (1, 2))
    driven = [f"xi{numbers[link.name]}_{which}" for link, which in every if link.segment(which).motion == "prescribed"]
    links: list[tuple[str, int]] = []
    for root in (link for link in scene.links if link.parent == BASE or link.parent not in numbers):
        sub, lengths, members = _links(scene, root)
        where = frame_id(model, scene, "ski" if root.parent == BASE and scene.base.kind == "ski" else root.parent, "links")
        model, reference = _append(model, reference, sub, lengths, where, root.anchor if root.parent == BASE else None)
        links += [(name, numbers[name]) for name in members]
    if not model.nv:
        raise SceneError("robots: nothing of this scene moves: no joint does; attach a robot by root = 'free', or unlock joints")
    if not model.check(model.createData()):
        raise SceneError("internal: joints are not depth-first; mass matrices would be wrong")  # pragma: no cover
    names = tuple(robot.name for robot in scene.robots)
    return Robots(
        model, names, tuple(texts), frame_names(model, scene.robots), reference, frozenset(given),
        tuple(sorted(links, key=_number)), tuple(left_out), frozenset(driven), tuple(ties),
    )  # fmt: skip


def wrapped(model: Any, name: str) -> Robots:
    """Return a model that was made elsewhere; its joints and frames keep their names."""
    model = pin.Model(model)
    _rename(model, name)
    return Robots(model, (name,), (None,), frame_names(model, (Robot(name=name, urdf="<robot/>"),)), pin.neutral(model),
                  frozenset(), (), ())  # fmt: skip


def _rename(model: Any, robot: str) -> None:
    """Put a robot's name before its joints and frames; a link keeps its name where a joint has the same."""
    for at in range(1, model.njoints):
        model.names[at] = f"{robot}.{identifier(model.names[at])}"
    links = {identifier(frame.name) for frame in model.frames if frame.type == pin.FrameType.BODY}
    taken: set[str] = set()
    for frame in model.frames:
        name = identifier(frame.name)
        if frame.type != pin.FrameType.BODY and name in links:
            name += "_of_joint"
        while name in taken:
            name += "_"
        taken.add(name)
        frame.name = f"{robot}.{name}"


def _number(entry: tuple[str, int]) -> int:
    return entry[1]


def _robot(robot: Robot, text: RobotText, key: str) -> tuple[Any, Array, set[str], list[str], list[Tie]]:
    """Return the model of one robot with its names, its posture, the joints that it tells, what was left out, and ties."""
    roots = {"free": pin.JointModelFreeFlyer, "planar": pin.JointModelPlanar}
    try:
        if robot.attach.root == "fixed":
            model = pin.buildModelFromXML(text.xml)
        else:
            model = pin.buildModelFromXML(text.xml, roots[robot.attach.root](), ROOT)
    except Exception as error:
        raise SceneError(f"{key}.urdf: Pinocchio cannot read it: {' '.join(str(error).split())[:300]}") from None
    posture, told = _posture(robot, text, model, key)
    locked = []
    for name in robot.locked:
        if not model.existJointName(name) or name == ROOT:
            raise SceneError(f"{key}.locked: no joint {name!r:.80}; {nearest(name, list(model.names)[1:])}")
        locked.append(model.getJointId(name))
    notes = [f"{robot.name}: {len(locked)} joints are locked"] if locked else []
    free = [tie for tie in text.ties if model.existJointName(tie.joint) and tie.joint not in robot.locked]
    ties = [_tie(tie, robot, model, posture) for tie in free]
    lost = [tie.joint for tie in ties if tie.other and not model.existJointName(tie.other)]
    for tie in ties:
        if tie.joint not in told | set(lost):
            other = float(_values(model, tie.other, posture)[0]) if tie.other else 0.0
            _set(model, tie.joint, posture, np.array([tie.multiplier * other + tie.offset]))
    for what, every in (("damping and friction", text.rubbed), ("the tie of joints that mimic unknown ones", lost)):
        names = [name for name in every if model.existJointName(name) and name not in robot.locked]
        if names:
            notes.append(f"{robot.name}: {what} of the URDF ({', '.join(names[:3])}{', ...' if len(names) > 3 else ''})")
    if locked:
        kept = [name for name in list(model.names)[1:] if name not in robot.locked]
        values = {name: _values(model, name, posture) for name in kept}
        model = pin.buildReducedModel(model, locked, posture)
        posture = pin.neutral(model)
        for name in kept:
            _set(model, name, posture, values[name])
    inertias = np.array([inertia.mass for inertia in model.inertias])
    if not np.isfinite(inertias).all() or (inertias < 0.0).any():
        raise SceneError(f"{key}.urdf: a mass of it is negative or not finite")
    _rename(model, robot.name)
    _add_points(model, robot, key)
    kept_ties = [
        tie._replace(joint=_named(robot, tie.joint), other=tie.other and _named(robot, tie.other))
        for tie in ties
        if tie.joint not in lost
    ]
    return model, posture, {_named(robot, name) for name in told}, notes, kept_ties


def _named(robot: Robot, joint: str) -> str:
    """Return the name of a robot's joint in the model of a scene."""
    return f"{robot.name}.{identifier(joint)}"


def _tie(tie: Tie, robot: Robot, model: Any, posture: Array) -> Tie:
    """Return a tie; one to a locked joint as a place."""
    if tie.other not in robot.locked:
        return tie
    return Tie(tie.joint, "", 0.0, tie.multiplier * float(_values(model, tie.other, posture)[0]) + tie.offset)


def _add_points(model: Any, robot: Robot, key: str) -> None:
    """Add frames at points of a robot's frames. Raises SceneError for one whose frame is none, or whose name is taken."""
    for name, (on, *at) in robot.points.items():
        whole, where = f"{robot.name}.{identifier(robot.aliases.get(on, on))}", f"{key}.points.{name}"
        if not model.existFrame(whole):
            known = [frame.name.partition(".")[2] for frame in model.frames]
            raise SceneError(f"{where}: no frame {on!r:.80}; {nearest(on, known)}")
        if model.existFrame(f"{robot.name}.{name}") or name in robot.aliases:
            raise SceneError(f"{where}: the robot has a frame of this name already; choose another")
        frame = model.frames[model.getFrameId(whole)]
        place = frame.placement * pin.SE3(np.eye(3), np.array(at))
        model.addFrame(pin.Frame(f"{robot.name}.{name}", frame.parentJoint, 0, place, pin.FrameType.OP_FRAME), False)


def _posture(robot: Robot, text: RobotText, model: Any, key: str) -> tuple[Array, set[str]]:
    """Return the posture (nq,) of a robot, a table over the neutral one, and the joints that it tells."""
    posture = pin.neutral(model)
    values: Mapping[str, Sequence[float]] = {}
    if isinstance(robot.posture, str):
        if robot.posture:
            known = postures_of(text)
            if robot.posture not in known:
                advice = nearest(robot.posture, known) if known else "its srdf tells none; give a table {joint = value}"
                raise SceneError(f"{key}.posture = {robot.posture!r:.80}: no such posture; {advice}")
            values = {("" if name == "root_joint" else name): value for name, value in known[robot.posture].items()}
            values = {(name or ROOT): value for name, value in values.items()}
            values = {name: value for name, value in values.items() if model.existJointName(name)}
    else:
        values = {name: (value,) for name, value in robot.posture.items()}
        for name in values:
            if not model.existJointName(name):
                raise SceneError(f"{key}.posture: no joint {name!r:.80}; {nearest(name, list(model.names)[1:])}")
    told = set()
    for name, given in values.items():
        size = model.joints[model.getJointId(name)].nq
        if len(given) != size:
            if isinstance(robot.posture, str):
                continue  # a root of another kind
            raise SceneError(f"{key}.posture.{name}: this joint has no single value")
        _set(model, name, posture, given)
        told.add(name)
    return pin.normalize(model, posture), told


def _values(model: Any, name: str, q: Array) -> Array:
    joint = model.joints[model.getJointId(name)]
    return np.array(q[joint.idx_q : joint.idx_q + joint.nq])


def _set(model: Any, name: str, q: Array, values: Sequence[float] | Array) -> None:
    joint = model.joints[model.getJointId(name)]
    q[joint.idx_q : joint.idx_q + joint.nq] = values


def _append(
    model: Any, reference: Array, sub: Any, posture: Array, frame: int, anchor: Sequence[float] | None = None
) -> tuple[Any, Array]:
    """Return a model with another one on one of its frames, and the postures of both."""
    own = {name: _values(model, name, reference) for name in list(model.names)[1:]}
    own |= {name: _values(sub, name, posture) for name in list(sub.names)[1:]}
    gravity = model.gravity
    place = pin.SE3(np.eye(3), np.array(anchor)) if anchor is not None else pin.SE3.Identity()
    made = pin.appendModel(model, sub, frame, place)
    made.name, made.gravity = model.name, gravity
    q = pin.neutral(made)
    for name, values in own.items():
        _set(made, name, q, values)
    return made, q


def frame_id(model: Any, scene: Scene, name: str, key: str) -> int:
    """Return a frame of the model by the name of a scene; ground is that of the world. Raises SceneError."""
    if name in ("ground", BASE):
        return 0
    frames = frame_names(model, scene.robots)
    if name not in frames:
        raise SceneError(f"{key}: no frame {name!r:.80}; {nearest(name, frames)}")
    return int(frames[name])


def frame_names(model: Any, robots: Sequence[Robot]) -> dict[str, int]:
    """Return frames by name: `ski`, `talos.left_sole_link`, its alias `talos.left_foot`; plain too where there is one robot."""
    found: dict[str, int] = {}
    for at, frame in enumerate(model.frames):
        if frame.type != pin.FrameType.JOINT or frame.name not in found:
            found.setdefault(frame.name, at)
    for at, frame in enumerate(model.frames):
        if frame.type == pin.FrameType.BODY:
            found[frame.name] = at  # a link and a joint of one name: the link
    for number, robot in enumerate(robots):
        for alias, name in robot.aliases.items():
            whole = f"{robot.name}.{identifier(name)}"
            if whole in found:
                found[f"{robot.name}.{alias}"] = found[whole]
            elif any(frame.startswith(f"{robot.name}.") for frame in found):
                known = [frame.partition(".")[2] for frame in found if frame.startswith(f"{robot.name}.")]
                raise SceneError(f"robots[{number}].aliases.{alias}: no frame {name!r:.80}; {nearest(name, known)}")
    if len(robots) == 1:
        prefix = f"{robots[0].name}."
        for name, at in list(found.items()):
            if name.startswith(prefix):
                found.setdefault(name.removeprefix(prefix), at)
    return found


def _links(scene: Scene, root: Link) -> tuple[Any, Array, list[str]]:
    """Return the model of a link with all that hangs on it, its lengths at the start, and the names of these links."""
    members, names = [msgspec.structs.replace(root, parent=BASE, anchor=None)], {root.name}
    for link in scene.links:  # parents may stand behind their children
        names |= _below(scene, link, root.name)
    members += [link for link in scene.links if link.name in names and link.name != root.name]
    base, data = Base(kind="pivot"), scene.data
    sub = build(Scene(name="links", base=base, links=tuple(members), parameters=scene.parameters, data=data))
    model = pin.Model(sub.model)
    q = pin.neutral(model)
    for index in sub.layout.links:
        for segment in (index.lower, index.upper):
            if segment.joint:
                q[segment.q] = segment.length
    return model, q, [link.name for link in members]


def _below(scene: Scene, link: Link, root: str) -> set[str]:
    """Return a link's name where it hangs on the root, by way of others."""
    by_name, way = {entry.name: entry for entry in scene.links}, link
    while way.parent in by_name:
        way = by_name[way.parent]
        if way.name == root:
            return {link.name}
    return set()
