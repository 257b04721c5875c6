"""Robots in a scene: what their tables may say, and the text of a URDF that stands beside the scene."""

from __future__ import annotations

import stat
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from vlmb.errors import SceneError
from vlmb.scene.by_phase import programmes_of
from vlmb.scene.tables import BOUNCE, Robot, SceneTables

MAX_URDF = 5_000_000  # characters
MAX_ROBOTS = 20


class Beside(str):
    """The text of a URDF that was read beside a scene, and the folder that its meshes may be in. A stored scene has the text."""

    __slots__ = ("folder",)
    folder: Path

    @property
    def text(self) -> str:
        """The text alone."""
        return str.__str__(self)


def frame_owner(name: str) -> str:
    """Return what a frame is of: `talos` of talos.left_foot; nothing where no dot says it."""
    owner, dot, _ = name.partition(".")
    return owner if dot else ""


def take_in_robots(entries: Any, folder: Path) -> Any:
    """Return `robots` of a scene with the text of every URDF that stands beside it or below.

    Paths of the package example-robot-data stay. What is no list is left to those who check the scene. Raises SceneError.
    """
    if not isinstance(entries, (list, tuple)):
        return entries
    return [_taken(entry, f"robots[{at}].urdf", folder) for at, entry in enumerate(entries)]


def _taken(entry: Any, key: str, folder: Path) -> Any:
    if isinstance(entry, Robot):
        entry = {name: getattr(entry, name) for name in Robot.__struct_fields__}
    name = entry.get("urdf") if isinstance(entry, Mapping) else None
    if type(name) is not str or name.lstrip().startswith("<"):
        return entry
    relative_urdf(name, key)
    try:
        path, root = (folder / name).resolve(), folder.resolve()
        if not path.exists():
            return entry
        if not path.is_relative_to(root):
            raise SceneError(f"{key} = {name!r:.120}: leads out of the scene's folder; put the file beside the scene file")
        found = path.stat()
        if not stat.S_ISREG(found.st_mode) or found.st_size > MAX_URDF:
            raise SceneError(f"{key} = {name!r:.120}: must be a file of at most {MAX_URDF} bytes")
        text = Beside(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError:
        raise SceneError(f"{key} = {name!r:.120}: is no text in UTF-8") from None
    except (OSError, RuntimeError, ValueError) as error:
        raise SceneError(f"{key} = {name!r:.120}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    text.folder = path.parent
    return {**entry, "urdf": text}


def relative_urdf(name: str, key: str) -> None:
    """Refuse what is no path of a URDF below a folder. Raises SceneError."""
    path = Path(name)
    if not name or "\0" in name or path.is_absolute() or ".." in path.parts or path.suffix.lower() != ".urdf":
        raise SceneError(
            f"{key} = {name!r:.120}: must be a .urdf by a relative path: beside the scene file or below, or one of "
            "example-robot-data, such as ur_description/urdf/ur5_robot.urdf; xacro is not run: write its URDF first"
        )


def check_robots(scene: SceneTables, refuse: Callable[[str, str], None]) -> None:
    """Refuse what the types alone cannot, as far as it is known before a URDF is read."""
    if not scene.robots:
        for key, given in (("welds", scene.welds), ("edges", scene.edges)):
            if given:
                refuse(key, f"{key} need [[robots]]")
        for key, programme in programmes_of(scene):
            if programme.limits or programme.posture:
                refuse(key, "limits and posture belong to scenes with [[robots]]; here secondary rows serve")
        return
    if len(scene.robots) > MAX_ROBOTS:
        refuse("robots", f"{len(scene.robots)} robots; at most {MAX_ROBOTS}")
    if scene.plane:
        refuse("plane", "robots move in space; remove plane = true")
    if scene.base.kind == "free":
        refuse("base.kind", "a scene with robots stands on 'pivot' (the ground) or 'ski'; a robot flies by attach.root = 'free'")
    names = [robot.name for robot in scene.robots]
    for index, robot in enumerate(scene.robots):
        key, to = f"robots[{index}]", robot.attach.to
        if to == "ski" and scene.base.kind != "ski":
            refuse(f"{key}.attach.to", "this scene has no ski: base.kind = 'ski' makes one")
        if to not in ("ski", "ground") and frame_owner(to) not in names[:index]:
            refuse(f"{key}.attach.to", f"{to!r:.80}: must be 'ground', 'ski', or a frame of a robot before it, such as arm.tool0")
    for index, force in enumerate(scene.forces):
        if force.between is not None:
            refuse(f"forces[{index}]", "springs between two directions are not there in scenes with robots; use [[springs]]")
    if any(link.segment(which).at_limit == BOUNCE for link in scene.links for which in (1, 2)):
        refuse("links", "at_limit = 'bounce' is there for scenes of links alone")
    if scene.legs:
        refuse("legs", "massless legs are there for scenes of links alone; take the robot's own")
    if scene.run.engine == "core":
        refuse("run.engine", "scenes with robots run on 'pinocchio' ('auto')")
