"""The scene: what the user writes, as frozen data. No Pinocchio here."""

from __future__ import annotations

import difflib
import keyword
import math
import numbers
import re
import sys
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_origin

import msgspec

from vlmb.errors import SceneError, nearest
from vlmb.expressions import CONSTANTS, FUNCTIONS

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
NAME, MAX_NAME = r"[A-Za-z][A-Za-z0-9_]*", 64
ALLOWED_NAME = f"a name begins with a letter and has letters, digits and _, {MAX_NAME} at most"
Name = Annotated[str, msgspec.Meta(pattern=rf"\A{NAME}\Z", max_length=MAX_NAME)]
Law: TypeAlias = float | str

RESERVED = frozenset({"t", "speed", *FUNCTIONS, *CONSTANTS})
MAX_LINKS = 2000
MAX_DEPTH = 20
TINIEST, LARGEST = 1e-50, 1e50  # sizes of numbers that products of several do not take out of range
MAX_FILE_BYTES = 4_000_000
BASE = "base"
OWN_NAMES = (BASE, "heading", "ski")  # of the base, its direction and its joint
FIXED_STEP = ("euler", "rk4", "gauss")
DEFAULT_STEP = 1e-3  # [s]


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A table of the scene file: unknown keys are refused."""


class Base(_Table, frozen=True, kw_only=True):
    """What link 1 stands on: a hinge on the ground, a ski on the surface, or nothing."""

    kind: Literal["pivot", "ski", "free"]
    mass: NonNegative = 0.0  # [kg], ski; a point mass at the first hinge of a free base
    inertia: NonNegative = 0.0  # [kg m^2], ski: vertical axis through its centre of mass
    com_offset: float = 0.0  # [m], ski: centre of mass ahead of the knife-edge point


class Rod(_Table, frozen=True, kw_only=True):
    """The rigid massive part of a link; thin and uniform unless `com` and `inertia` say otherwise."""

    length: NonNegative  # [m]
    mass: NonNegative  # [kg]
    com: float | None = None  # [m] from the rod's start
    inertia: NonNegative | None = None  # [kg m^2] transverse, about the centre of mass

    @property
    def centre(self) -> float:
        """Distance of the centre of mass from the rod's start [m]; l/2 for the paper's rod."""
        return 0.5 * self.length if self.com is None else self.com

    @property
    def transverse_inertia(self) -> float:
        """Transverse inertia about the centre of mass [kg m^2]; m l^2/12 for the paper's rod, so that (2.4) is m l^2/3."""
        return self.mass * self.length**2 / 12.0 if self.inertia is None else self.inertia


class Segment(_Table, frozen=True, kw_only=True):
    """A massless part of a link: free, fixed, or prescribed by a law of time."""

    length: float | None = None  # [m] start value of a free segment, value of a fixed one
    motion: Literal["free", "fixed", "prescribed"] = "free"
    law: Law | None = None  # [m], prescribed
    stiffness: NonNegative = 0.0  # [N/m]
    damping: NonNegative = 0.0  # [N s/m]
    rest: float | None = None  # [m], default: length
    limits: tuple[float, float] | None = None  # [m], default (0, inf)

    @property
    def bounds(self) -> tuple[float, float]:
        """Limits [m] of the length; (0, inf) unless given."""
        return self.limits or (0.0, math.inf)


class Link(_Table, frozen=True, kw_only=True):
    """One variable-length link: lower massless segment, rod, upper massless segment."""

    rod: Rod
    name: Name = ""
    parent: Name = ""  # "" = the previous link, the base for the first
    parent_point: Literal["tip", "rod_start", "rod_end"] = "tip"
    lower: Segment = Segment(length=0.0, motion="fixed")
    upper: Segment = Segment(length=0.0, motion="fixed")
    tip_mass: NonNegative = 0.0  # [kg]

    def segment(self, which: int) -> Segment:
        """Return the lower (1) or upper (2) segment."""
        return self.lower if which == 1 else self.upper


class Force(_Table, frozen=True, kw_only=True):
    """A generalized force by name and law, or a spring-damper between the directions of two links."""

    on: str | None = None
    law: Law | None = None
    between: tuple[str, str] | None = None
    stiffness: NonNegative = 0.0  # [N m/rad]
    damping: NonNegative = 0.0  # [N m s/rad]
    rest: float = 0.0  # [rad], angle between the two directions


class Programme(_Table, frozen=True, kw_only=True):
    """Servo constraints and the controls that enforce them (paper, section 5)."""

    constraints: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    controls: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    frequency: Positive | tuple[Positive, ...] | None = None  # [rad/s]
    damping_ratio: NonNegative | tuple[NonNegative, ...] = 1.0
    gains: Literal["auto", "none"] | None = None  # none: H = K = 0, errors neither decay nor are checked
    h: tuple[tuple[float, ...], ...] | None = None
    k: tuple[tuple[float, ...], ...] | None = None
    weights: dict[str, Positive] = {}  # R_s of the norm sum R_s u_s^2; default 1/scale^2
    u0: Law | None = None  # the free scalar of (5.6), for one control more than rows
    secondary: tuple[str, ...] = ()  # equations served in the null space, as far as it goes
    secondary_frequency: Positive | None = None  # [rad/s], default: frequency


class Run(_Table, frozen=True, kw_only=True):
    """How to integrate; every key can be overridden by an argument of `simulate`."""

    duration: Positive = 5.0  # [s]
    method: Literal["euler", "rk4", "gauss", "dop853", "adams", "bdf", "radau"] = "adams"
    rtol: Annotated[float, msgspec.Meta(ge=3e-14)] = 1e-8  # smaller ones are beyond double precision
    atol: Positive = 1e-10
    step: Positive | None = None  # [s], fixed-step methods
    samples: Positive = 60.0  # output samples per second when no t_eval is given
    knife_edge: Literal["reduction", "multiplier", "projection"] = "reduction"
    gain: NonNegative = 5.0  # [1/s], Baumgarte gain of ideal rows and of the knife edge as a multiplier
    fall: bool = True  # stop when a point of a link reaches the snow


class Scene(_Table, frozen=True, kw_only=True):
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
            raise SceneError(f"{source}: {_explain(str(error), data)}") from None
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


WORDS = {"object": "table", "array": "list", "str": "text", "int": "number", "float": "number", "bool": "true or false"}


def _explain(message: str, data: dict[str, Any]) -> str:
    """Turn a validation message into one that names the key path, the value found and the nearest valid key."""
    text, _, path = message.partition(" - at `key` in `$" if " - at `key` in `$" in message else " - at `$")
    path = path.rstrip("`").lstrip(".")
    if " - at `key` in `$" in message:  # the name of a parameter
        wrong = next((name for name in _lookup(data, path) if not re.fullmatch(NAME, name) or len(name) > MAX_NAME), "?")
        return f"{path}: {wrong!r:.80} is no name: {ALLOWED_NAME}"
    unknown = re.match(r"Object contains unknown field `(.*)`", text)
    if unknown:
        valid = _keys_of(path)
        close = difflib.get_close_matches(unknown[1], valid, n=1, cutoff=0.5)
        hint = f"did you mean {close[0]!r}? " if close else ""
        where = f"{path}.{unknown[1]}" if path else unknown[1]
        return f"unknown key {where!r:.200}; {hint}allowed here: {', '.join(valid)}"
    missing = re.match(r"Object missing required field `(.*)`", text)
    if missing:
        where = f"{path}.{missing[1]}" if path else missing[1]
        return f"missing key {where!r}"
    if path.endswith("[...]"):  # one of a table's values: find which
        path = path.removesuffix("[...]")
        parent, _, key = path.rpartition(".")
        kind = next(field.type for field in msgspec.structs.fields(_type_at(parent)) if field.name == key)
        path = next((f"{path}.{name}" for name, entry in _lookup(data, path).items() if not _fits({name: entry}, kind)), path)
    found = repr(_lookup(data, path))
    found = found if len(found) <= 120 else found[:117] + "..."
    if "enum" in text:
        return f"{path} = {found}: allowed: {'pivot, ski, free' if path == 'base.kind' else _choices_of(path)}"
    if "regex" in text or "length <=" in text:
        return f"{path} = {found}: {ALLOWED_NAME}"
    text = re.sub(r"`([^`]*)`", _in_words, text)
    return f"{path or 'scene'} = {found}: {text[0].lower()}{text[1:]}"


def _in_words(match: re.Match[str]) -> str:
    return " or ".join(WORDS.get(word, word) for word in match[1].split(" | ") if word != "null")


def _fits(value: Any, kind: Any) -> bool:
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return False
    return True


def _type_at(path: str) -> Any:
    """Return the table type or field annotation at a key path such as `links[0].rod`."""
    current: Any = Scene
    tables = {"base": Base, "links": Link, "rod": Rod, "lower": Segment, "upper": Segment,
              "forces": Force, "programme": Programme, "run": Run}  # fmt: skip
    for part in filter(None, re.split(r"[.\[\]]+", re.sub(r"\[(\.\.\.|\d+)\]", "", path))):
        current = tables.get(part, part)
    return current


def _keys_of(path: str) -> list[str]:
    table = _type_at(path)
    return [field.name for field in msgspec.structs.fields(table)] if isinstance(table, type) else []


def _choices_of(path: str) -> str:
    parent, _, key = path.rpartition(".")
    table = _type_at(parent)
    if not isinstance(table, type):
        return ""
    for field in msgspec.structs.fields(table):
        if field.name == key:
            kinds = [field.type, *getattr(field.type, "__args__", ())]  # a Literal, or a union with one
            choices = next((kind.__args__ for kind in kinds if get_origin(kind) is Literal), ())
            return ", ".join(map(str, choices))
    return ""


def _lookup(data: Any, path: str) -> Any:
    try:
        for part in filter(None, re.split(r"[.\[\]]+", path)):
            data = data[int(part)] if isinstance(data, (list, tuple)) else data[part]
    except (KeyError, IndexError, ValueError, TypeError):
        return "?"
    return data


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
    low, high = segment.limits or (0.0, math.inf)
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
