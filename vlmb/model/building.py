"""Building: a mechanism of whatever is given, of links alone or with robots."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vlmb.model import mechanism
from vlmb.model.frozen import Remade
from vlmb.model.mechanism import Mechanism
from vlmb.scene.scene import Scene, as_scene

if TYPE_CHECKING:
    from vlmb.model.robot_mechanism import RobotMechanism


def build(what: Scene | str | Path | Mapping[str, Any] | Any, name: str = "robot") -> Mechanism | RobotMechanism:
    """Generate the mechanism of a scene: of a Scene, the path of a scene file or a dict with its keys; or wrap a pinocchio.Model.

    A model that is wrapped is one robot called `name`, fixed to the ground as it is. Raises SceneError where the scene has a
    motion without mass, and for robots whose files, frames or joints are not there or not usable.
    """
    if isinstance(what, (Remade, Mechanism)):
        from vlmb.model.robot_mechanism import RobotMechanism

        if isinstance(what, (Mechanism, RobotMechanism)):
            return what
    if is_model(what):
        from vlmb.model.robot_mechanism import RobotMechanism

        model: Any = what
        robot = {"name": name, "urdf": "<robot/>"}
        scene = Scene.from_dict({"name": model.name or name, "base": {"kind": "pivot"}, "robots": [robot]})
        return _looked_at(RobotMechanism(scene, model))
    scene = as_scene(what)
    if scene.robots:
        from vlmb.model.robot_mechanism import RobotMechanism

        return _looked_at(RobotMechanism(scene))
    return mechanism.build(scene)


def _looked_at(made: RobotMechanism) -> RobotMechanism:
    """Return a mechanism whose model and names are there: what is wrong with them is said now."""
    made.names.entries  # noqa: B018
    made.table  # noqa: B018
    return made


def is_model(what: Any) -> bool:
    """Whether something is a pinocchio.Model."""
    return type(what).__name__ == "Model" and type(what).__module__.startswith("pinocchio")
