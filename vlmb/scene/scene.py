"""The scene: what the user writes, as frozen data. No Pinocchio here."""

from __future__ import annotations

import keyword
import math
import numbers
import re
import sys
from pathlib import Path
from typing import Annotated, Any

import msgspec

from vlmb.errors import SceneError, nearest
from vlmb.scene.explain import explain
from vlmb.scene.expressions import CONSTANTS, FUNCTIONS
from vlmb.scene.tables import BASE, Base, Force, Link, Name, NonNegative, Programme, Run, Segment, Table

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

RESERVED = frozenset({"t", "speed", *FUNCTIONS, *CONSTANTS})
MAX_LINKS = 2000
MAX_DEPTH = 20
TINIEST, LARGEST = 1e-50, 1e50  # sizes of numbers that products of several do not take out of range
MAX_FILE_BYTES = 4_000_000
OWN_NAMES = (BASE, "heading", "ski")  # of the base, its direction and its joint


class Scene(Table, frozen=True, kw_only=True):
    """A whole scene. Coordinates refer to the snow surface; gravity is tilted by `slope` along +x."""

    name: str = "scene"
    gravity: NonNegative = 9.81  # [m/s^2]
    slope: Annotated[float, msgspec.Meta(gt=-1.5707, lt=1.5707)] = 0.0  # [rad]
    plane: bool = False
    base: Base
    links: tuple[Link, ...] = ()
    constraints: tuple[str, ...] = ()
    start: dict[str, float] = {}
    parameters: dict[Name, float] = {}
    forces: tuple[Force, ...] = ()
    programme: Programme | None = None
    run: Run = Run()
    expect: dict[str, Any] = {}  # what the shipped models promise; read by the tests alone

    @staticmethod
    def from_dict(data: dict[str, Any], source: str = "scene") -> Scene:
        """Check a dict with the keys of a scene file and freeze it.

        Raises SceneError with the source, the key path, what was found and what is allowed.
        """
        if not isinstance(data, dict):
            raise SceneError(f"{source}: a scene is a table of keys, not a {type(data).__name__}")
        data = _plain(data, source, "")
        try:
            scene = msgspec.convert(data, Scene)
        except msgspec.ValidationError as error:
            raise SceneError(f"{source}: {explain(str(error), data, Scene)}") from None
        scene = msgspec.structs.replace(scene, links=_named(scene.links, source))
        _check(scene, source)
        return scene

    def to_dict(self) -> dict[str, Any]:
        """Return the scene as plain data that `from_dict` reads back to an equal scene."""
        return msgspec.to_builtins(self)

    def changed(self, **keys: Any) -> Scene:
        """Return this scene with keys changed: tables are laid over its own, key by key; lists and values replace, None removes.

        scene.changed(name="faster", start={"speed": 9.0}, programme=None). Raises SceneError as `from_dict` does.
        """
        data = self.to_dict()
        for key, value in keys.items():
            merged = isinstance(value, dict) and isinstance(data.get(key), dict)
            data[key] = {**data[key], **value} if merged else value
        return Scene.from_dict({key: value for key, value in data.items() if value is not None}, "changed scene")

    @property
    def surface_gravity(self) -> tuple[float, float, float]:
        """Gravity in the surface frame [m/s^2]: g (sin slope, 0, -cos slope)."""
        return (self.gravity * math.sin(self.slope), 0.0, -self.gravity * math.cos(self.slope))


def load_scene(path: str | Path) -> Scene:
    """Read a scene file (TOML). It is data: nothing in it is run.

    Raises SceneError naming the file and what to change.
    """
    if not isinstance(path, (str, Path)):
        raise SceneError(f"{path!r:.80}: must be the path of a scene file")
    path = Path(path)
    try:
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
        if len(content) > MAX_FILE_BYTES:
            raise SceneError(f"{path}: larger than {MAX_FILE_BYTES} bytes; this is not a scene file")
        data = tomllib.loads(content.decode("utf-8"))
    except FileNotFoundError:
        raise SceneError(f"{path}: no such scene file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SceneError(f"{path}: not a TOML file: {error}") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None
    except SceneError:
        raise
    except ValueError as error:
        raise SceneError(f"{str(path)!r}: cannot be read: {error}") from None
    return Scene.from_dict(data, str(path))


def _plain(value: Any, source: str, key: str, depth: int = 0) -> Any:
    """Copy data with plain numbers (NumPy's too); refuse what is not data, not finite, too large or too deep."""
    if isinstance(value, (dict, list, tuple)) and depth > MAX_DEPTH:
        raise SceneError(f"{source}: {key[:80]}...: nested more than {MAX_DEPTH} deep")
    if isinstance(value, dict):
        for name in value:
            if not isinstance(name, str):
                raise SceneError(f"{source}: {key or 'scene'}: {name!r:.80} is no key: keys are text")
        return {name: _plain(entry, source, f"{key}.{name}" if key else name, depth + 1) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry, source, f"{key}[{index}]", depth + 1) for index, entry in enumerate(value)]
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, numbers.Integral):
        if abs(int(value)) > 2**63:
            raise SceneError(f"{source}: {key}: this whole number is too large")
        return int(value)
    if isinstance(value, numbers.Real):
        number = float(value)
        if math.isnan(number) or (math.isinf(number) and not re.search(r"limits\[\d\]$", key)):
            raise SceneError(f"{source}: {key} = {number}: must be a finite number")
        if math.isfinite(number) and number != 0.0 and not TINIEST <= abs(number) <= LARGEST:
            raise SceneError(f"{source}: {key} = {number:g}: between {TINIEST:g} and {LARGEST:g} in size, or 0")
        return number
    raise SceneError(f"{source}: {key} = {value!r:.80}: a scene has numbers, texts, lists and tables, no {type(value).__name__}")


def _named(links: tuple[Link, ...], source: str) -> tuple[Link, ...]:
    """Give every link its name and parent, spelled out."""
    if len(links) > MAX_LINKS:
        raise SceneError(f"{source}: links: {len(links)} links; at most {MAX_LINKS}")
    named: list[Link] = []
    for index, link in enumerate(links):
        name = link.name or f"link{index + 1}"
        parent = link.parent or (named[-1].name if named else BASE)
        named.append(msgspec.structs.replace(link, name=name, parent=parent))
    places: dict[str, int] = {}
    for index, link in enumerate(named):
        key = f"links[{index}]"
        if link.name in OWN_NAMES:
            raise SceneError(f"{source}: {key}.name = {link.name!r}: this name is the base's own; choose another")
        if link.name in places:
            raise SceneError(f"{source}: {key}.name = {link.name!r}: links[{places[link.name]}] has this name already")
        places[link.name] = index
    for index, link in enumerate(named):
        if link.parent != BASE and link.parent not in places:
            where = f"{source}: links[{index}].parent = {link.parent!r}"
            raise SceneError(f"{where}: no such link; {nearest(link.parent, [BASE, *places])}")
    rooted = {BASE}
    for index, link in enumerate(named):
        way: dict[str, None] = {}
        while link.name not in rooted:
            if link.name in way:
                ring = ", ".join(list(way)[:10])
                raise SceneError(f"{source}: links[{index}].parent: the parents form a ring through {ring}; links form a tree")
            way[link.name] = None
            if link.parent == BASE:
                break
            link = named[places[link.parent]]
        rooted.update(way)
    return tuple(named)


def _check(scene: Scene, source: str) -> None:
    """Refuse what the types alone cannot: combinations."""

    def refuse(key: str, why: str) -> None:
        raise SceneError(f"{source}: {key}: {why}")

    for name in scene.parameters:
        if name in RESERVED or keyword.iskeyword(name):
            refuse(f"parameters.{name}", "this name has a meaning of its own in expressions; choose another")
    base = scene.base
    if base.kind == "ski":
        if not base.mass > 0.0 or not base.inertia > 0.0:
            refuse("base", "a ski needs mass > 0 [kg] and inertia > 0 [kg m^2]")
    elif base.inertia or base.com_offset or (base.mass and base.kind == "pivot"):
        refuse("base", f"inertia and com_offset belong to kind = 'ski', mass to 'ski' and 'free'; remove them from {base.kind!r}")
    if base.kind != "ski" and not scene.links:
        refuse("links", f"a {base.kind!r} base needs at least one link")
    for index, link in enumerate(scene.links):
        key = f"links[{index}]"
        if link.rod.length == 0.0 and link.rod.com is None and link.rod.mass > 0.0 and link.rod.inertia is None:
            refuse(f"{key}.rod", "a rod of length 0 with mass is a point: use tip_mass, or give com and inertia")
        for which, segment in (("lower", link.lower), ("upper", link.upper)):
            _check_segment(segment, f"{key}.{which}", refuse)
    for index, force in enumerate(scene.forces):
        key = f"forces[{index}]"
        if (force.on is None) == (force.between is None):
            refuse(key, "give either `on` and `law` (a force) or `between` (a spring between two directions)")
        if force.on is not None and (force.law is None or force.stiffness or force.damping or force.rest):
            refuse(key, "a force has the keys `on` and `law` only")
        if force.between is not None and force.law is not None:
            refuse(key, "a spring between directions has no `law`; it has stiffness, damping and rest")
        if force.between is not None and not (force.stiffness or force.damping):
            refuse(key, "a spring between directions needs stiffness or damping > 0")


def _check_segment(segment: Segment, key: str, refuse: Any) -> None:
    low, high = segment.bounds
    if not low < high:
        refuse(f"{key}.limits", f"must be [low, high] with low < high, not {list(segment.limits or ())}")
    if segment.motion == "prescribed":
        if segment.law is None:
            refuse(key, "motion = 'prescribed' needs a law, e.g. law = \"0.2 + 0.05*sin(6*t)\"")
        if segment.length is not None or segment.stiffness or segment.damping or segment.rest is not None:
            refuse(key, "a prescribed segment has motion, law and limits only: the law gives its length, the force is the result")
        return
    if segment.law is not None:
        refuse(f"{key}.law", f"a law needs motion = 'prescribed', not {segment.motion!r}")
    length = segment.length
    if length is None:
        refuse(f"{key}.length", f"a {segment.motion} segment needs a length [m]")
    if segment.motion == "fixed" and (segment.stiffness or segment.damping or segment.rest is not None or segment.limits):
        refuse(key, "a fixed segment has motion and length only; a spring needs motion = 'free'")
    if length is not None and not low <= length <= high:
        refuse(f"{key}.length", f"{length} is outside limits [{low}, {high}]")
