"""The scene: what the user writes, as frozen data. No Pinocchio here."""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from vlmb.errors import SceneError
from vlmb.scene.by_phase import programmes_of
from vlmb.scene.complete import complete
from vlmb.scene.explain import BASE_HINT, unknown_key
from vlmb.scene.keys import changed_data
from vlmb.scene.names import listed
from vlmb.scene.recorded import take_in
from vlmb.scene.renumbered import renumbered
from vlmb.scene.robots import take_in_robots
from vlmb.scene.rows import rows_of
from vlmb.scene.shipped import scene_file
from vlmb.scene.tables import Link, SceneTables
from vlmb.scene.written import as_written

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MAX_FILE_BYTES, MAX_TABLES = 1_500_000, 30_000
NESTED = re.compile(rb"(?:\.[ \t]*[\w\"'-]{1,64}[ \t]*){20}")  # a key of twenty parts and more: reading takes the square of them


class Scene(SceneTables, frozen=True, kw_only=True):
    """A whole scene, complete and checked. Coordinates refer to the snow surface; gravity is tilted by `slope` along +x.

    Made of the tables, `Scene(base=Base(kind="pivot"), links=[Link(rod=Rod(length=1.0, mass=2.0))])`, or of dicts with the
    same keys. A number may be an expression of `parameters`, as text: the scene then holds its value, and `to_dict` its text.
    Raises SceneError with the key path, what was found and what is allowed.
    """

    def __post_init__(self) -> None:
        tables = complete({name: getattr(self, name) for name in self.__struct_fields__})
        for name in self.__struct_fields__:
            msgspec.structs.force_setattr(self, name, getattr(tables, name))

    @staticmethod
    def from_dict(data: Mapping[str, Any], source: str = "scene", folder: str | os.PathLike[str] = ".") -> Scene:
        """Check a dict with the keys of a scene file and freeze it; files of measured data are looked for in `folder`.

        Raises SceneError with the source, the key path, what was found and what is allowed.
        """
        if not isinstance(data, Mapping):
            raise SceneError(f"{source}: a scene is a table of keys, not a {type(data).__name__}")
        known = Scene.__struct_fields__
        for key in data:
            if not isinstance(key, str):
                raise SceneError(f"{source}: scene: {key!r:.80} is no key: keys are text")
            if key not in known:
                raise SceneError(f"{source}: {unknown_key('', key, known)}")
        if "base" not in data:
            raise SceneError(f"{source}: missing key 'base': {BASE_HINT}")
        try:
            given = dict(data)
            for key, taken in (("data", take_in), ("robots", take_in_robots)):
                if given.get(key):
                    given[key] = taken(given[key], Path(folder))
            return Scene(**given)
        except SceneError as error:
            raise type(error)(f"{source}: {error}") from None

    def to_dict(self) -> dict[str, Any]:
        """Return the scene as plain data, expressions as written, that `from_dict` reads back to an equal scene."""
        data: dict[str, Any] = as_written(self)
        return data

    def changed(self, **keys: Any) -> Scene:
        """Return this scene with keys changed: tables are laid over its own, key by key; lists and values replace, None removes.

        scene.changed(name="faster", start={"speed": 9.0}, programme=None). Raises SceneError as `from_dict` does.
        """
        data = self.to_dict()
        for key, value in keys.items():
            merged = isinstance(value, dict) and isinstance(data.get(key), dict)
            data[key] = {**data[key], **value} if merged else value
        return Scene.from_dict({key: value for key, value in data.items() if value is not None}, "changed scene")

    def changed_at(self, changes: Mapping[str, Any]) -> Scene:
        """Return this scene with values changed at key paths; links by name or position, None removes.

        scene.changed_at({"links.legs.lower.stiffness": 1e4, "start.speed": 7.0, "forces.0.law": "20*t"}).
        Raises SceneError naming the path and the nearest valid key, and as `from_dict` does.
        """
        numbers = renumbered(self, changes) if isinstance(changes, Mapping) else None
        if numbers is not None:
            return with_values(self, numbers)
        return Scene.from_dict(changed_data(self, changes), "changed scene")

    @property
    def on_snow(self) -> bool:
        """Whether the base is a ski."""
        return self.base.kind == "ski"

    @property
    def surface_gravity(self) -> tuple[float, float, float]:
        """Gravity in the surface frame [m/s^2]: g (sin slope, 0, -cos slope)."""
        return (self.gravity * math.sin(self.slope), 0.0, -self.gravity * math.cos(self.slope))

    def __eq__(self, other: object) -> bool:
        return self.to_dict() == other.to_dict() if isinstance(other, Scene) else NotImplemented

    def __hash__(self) -> int:
        return hash(_hashable(self.to_dict()))

    def __reduce__(self) -> tuple[Any, ...]:
        return Scene.from_dict, (self.to_dict(),)

    def __copy__(self) -> Scene:
        return self

    def __deepcopy__(self, memo: Any) -> Scene:
        return self

    def __repr__(self) -> str:
        rows = rows_of(self)
        links = [f"{link.name} ({self._coordinates_of(link)})" for link in self.links]
        parts = [f"{self.base.kind} base", *([f"links (coordinates) {listed(links)}"] if links else [])]
        for what, entries in (("ideal rows", rows.ideal), ("programme", rows.servo), ("secondary", rows.secondary)):
            parts += [f"{what} {listed([row.name for row in entries])}"] if entries else []
        controls = tuple(dict.fromkeys(name for _, each in programmes_of(self) for name in each.controls))
        parts += [f"controls {listed(controls)}"] if controls else []
        parts += [f"robots {listed([robot.name for robot in self.robots])}"] if self.robots else []
        parts += [f"data {listed([entry.name for entry in self.data])}"] if self.data else []
        parts += [f"{len(self.forces)} force{'s' * (len(self.forces) > 1)}"] if self.forces else []
        return f"<Scene {self.name!r}: {'; '.join(parts)}>"

    def _coordinates_of(self, link: Link) -> int:
        """Count a link's coordinates: angles, and segments that move; a free upper one only where something hangs on it."""
        carries = link.tip_mass or any(child.parent == link.name and child.parent_point == "tip" for child in self.links)
        upper = link.upper.motion == "prescribed" or (bool(carries) and link.upper.motion == "free")
        return (1 if self.plane else 2) + (link.lower.motion != "fixed") + upper


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene file (TOML), or a model that comes with vlmb by its name. It is data: nothing in it is run.

    Raises SceneError naming the file and what to change.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise SceneError(f"{path!r:.80}: must be the path of a scene file")
    try:
        path = scene_file(path)
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
        if len(content) > MAX_FILE_BYTES:
            raise SceneError(f"{path}: larger than {MAX_FILE_BYTES} bytes; this is not a scene file")
        if NESTED.search(content) or content.count(b"\n[") > MAX_TABLES:
            raise SceneError(f"{path}: a key of more than 20 parts, or more than {MAX_TABLES} tables; this is not a scene file")
        data = tomllib.loads(content.decode("utf-8-sig") + "\n")  # with a byte order mark or without
    except FileNotFoundError:
        raise SceneError(f"{path}: no such scene file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SceneError(f"{path}: {_not_toml(content, error)}") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None
    except SceneError:
        raise
    except ValueError as error:
        raise SceneError(f"{str(path)!r}: cannot be read: {error}") from None
    return Scene.from_dict(data, str(path), path.parent)


def _not_toml(content: bytes, error: Exception) -> str:
    """Say why a file is no scene file: a stored run, a text without quotes, or what the reader says."""
    if content.startswith(b"PK"):
        return "a stored run, not a scene file: read it with load_trajectory, or replay it with `vlmb run`"
    place = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
    if not place:
        return f"not a TOML file: {error}"
    line = content.decode("utf-8-sig").splitlines()[int(place[1]) - 1]
    value, where = line.partition("=")[2].partition("#")[0].strip(), f"not a TOML file: line {place[1]}:"
    bare = re.match(r"[A-Za-z_][\w.]*", line[int(place[2]) - 1 :])
    if str(error).startswith("Cannot overwrite a value"):
        return f"{where} {line.partition('=')[0].strip()!r:.80} is given twice; keep one"
    if re.fullmatch(r"-?\d+,\d+", value):
        return f"{where} {value}: a decimal point is meant: {value.replace(',', '.')}"
    if value in ("True", "False"):
        return f"{where} {value} is written {value.lower()}"
    if str(error).startswith("Invalid value") and bare and value != bare[0] and re.match(r"[\w.]+[*/+(-]", value):
        return f"{where} an expression needs quotes: \"{value}\""
    if str(error).startswith("Invalid value") and bare:
        return f"{where} {bare[0]} needs quotes: a text is written \"{bare[0]}\""
    return f"not a TOML file: {error}"


def as_scene(what: Any) -> Scene:
    """Return the scene that is meant: a Scene itself, the path of a scene file, or a dict with its keys.

    Raises SceneError for anything else, and as `load_scene` and `from_dict` do.
    """
    if isinstance(what, Scene):
        return what
    if isinstance(what, (str, os.PathLike)):
        return load_scene(what)
    if isinstance(what, Mapping):
        return Scene.from_dict(what)
    foreign = type(what).__module__.startswith("pinocchio")
    found = f"a {type(what).__name__} of Pinocchio, which has no scene," if foreign else f"{what!r:.80}"
    raise SceneError(f"{found}: must be a Scene, the path of a scene file, or a dict with its keys")


def _hashable(value: Any) -> Any:
    """Turn plain data into tuples and sets that equal each other where the data do."""
    if isinstance(value, dict):
        return frozenset((name, _hashable(entry)) for name, entry in value.items())
    return tuple(map(_hashable, value)) if isinstance(value, (list, tuple)) else value


def with_values(scene: Scene, changes: Mapping[str, object]) -> Scene:
    """Return a completed scene with other values of its keys. It is not completed again: no user sees it."""
    made: Scene = msgspec.Struct.__copy__(scene)  # type: ignore[attr-defined]
    for name, value in changes.items():
        msgspec.structs.force_setattr(made, name, value)
    return made
