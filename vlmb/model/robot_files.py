"""Files of robots: the text of a URDF, postures of its srdf, and what of it Pinocchio does not read. They are foreign.

Only files below the folder of the scene or of the package example-robot-data are read; nothing is fetched and no xacro is run.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from vlmb.errors import SceneError, nearest
from vlmb.scene.robots import MAX_URDF, Beside, relative_urdf

PACKAGE, PLACE = "example-robot-data", "cmeel.prefix/share/example-robot-data/robots"
MAX_ELEMENTS = 50_000
FAR = 1e4  # [rad] limits of a joint that turns without end
INSTALL = "pip install vlmb[robots]"


class Tie(NamedTuple):
    """A joint that mimics another one: q = multiplier * q_other + offset."""

    joint: str
    other: str
    multiplier: float
    offset: float


class RobotText(NamedTuple):
    """A URDF as Pinocchio reads it, and what is told of it."""

    xml: str
    folder: Path | None  # where `package://` and relative meshes are looked for
    root: Path | None  # below which they must stay
    endless: frozenset[str]  # joints without limits
    ties: tuple[Tie, ...]
    rubbed: tuple[str, ...]  # joints with damping or friction
    about: str  # path in the package, for postures


@functools.cache
def data_folder() -> Path | None:
    """Return the folder of example-robot-data; None where it is not installed."""
    try:
        found = Path(str(distribution(PACKAGE).locate_file(PLACE)))
    except PackageNotFoundError:
        return None
    return found if found.is_dir() else None


def read_robot(urdf: str, key: str) -> RobotText:
    """Read a URDF: its text, or a path in the package. Raises SceneError naming what is wrong."""
    if urdf.lstrip().startswith("<"):
        folder = urdf.folder if isinstance(urdf, Beside) else None
        return _checked(str.__str__(urdf), key, folder, folder, "")
    relative_urdf(urdf, key)
    root = data_folder()
    where = f"{key} = {urdf!r:.120}"
    if root is None:
        raise SceneError(f"{where}: no such file beside the scene, and {PACKAGE} is not installed: {INSTALL}")
    path = root / urdf
    if not path.is_file():
        known = sorted(str(found.relative_to(root)) for found in root.rglob("*.urdf"))
        alike = {Path(found).stem.lower(): found for found in known}
        close = [alike[stem] for stem in difflib.get_close_matches(Path(urdf).stem.lower(), alike, n=3, cutoff=0.4)]
        hint = f"did you mean {' or '.join(map(repr, close))}?" if close else nearest(urdf, known)
        raise SceneError(f"{where}: no such file beside the scene, nor in {PACKAGE}; {hint}")
    if not path.resolve().is_relative_to(root.resolve()) or path.stat().st_size > MAX_URDF:
        raise SceneError(f"{where}: leads out of {PACKAGE}, or is larger than {MAX_URDF} bytes")
    return _checked(path.read_text(encoding="utf-8", errors="replace"), key, path.parent, root, urdf)


def parse_xml(text: str, key: str) -> ElementTree.Element:
    """Parse XML that defines nothing of its own: no entities, not too many elements. Raises SceneError."""
    if len(text) > MAX_URDF or re.search(r"<!\s*(DOCTYPE|ENTITY)", text, re.I):
        raise SceneError(f"{key}: larger than {MAX_URDF} characters, or with a DOCTYPE; a URDF has none")
    try:
        root = ElementTree.fromstring(text.encode("utf-8"))
    except (ElementTree.ParseError, RecursionError) as error:
        raise SceneError(f"{key}: is no XML: {error}") from None
    if sum(1 for _ in root.iter()) > MAX_ELEMENTS:
        raise SceneError(f"{key}: more than {MAX_ELEMENTS} elements")
    return root


def _tie(name: str, mimic: ElementTree.Element, key: str) -> Tie:
    found = []
    for what, default in (("multiplier", "1"), ("offset", "0")):
        try:
            found.append(float(mimic.get(what, default)))
        except ValueError:
            raise SceneError(f"{key}: {what} = {mimic.get(what)!r:.80} is no number") from None
        if not math.isfinite(found[-1]):
            raise SceneError(f"{key}: {what} = {found[-1]} is not finite")
    return Tie(name, mimic.get("joint", ""), *found)


def _checked(text: str, key: str, folder: Path | None, root: Path | None, about: str) -> RobotText:
    tree = parse_xml(text, key)
    if tree.tag != "robot":
        raise SceneError(f"{key}: its first element is <{tree.tag[:40]}>; a URDF has <robot>")
    if re.search(r"<\s*xacro:", re.sub(r"(?s)<!--.*?-->", "", text)):
        raise SceneError(f"{key}: has xacro in it, which is not run: write its URDF first (xacro robot.xacro > robot.urdf)")
    tree.set("name", tree.get("name") or "robot")
    endless, ties, rubbed = [], [], []
    _in_order(tree, key)
    for joint in tree.iter("joint"):
        name = joint.get("name", "")
        if joint.get("type") == "continuous":  # Pinocchio's own for these has cosine and sine in place of the angle
            joint.set("type", "revolute")
            endless.append(name)
            limit = joint.find("limit")
            if limit is None:
                limit = ElementTree.SubElement(joint, "limit", {"effort": "1e30", "velocity": "1e30"})
            limit.set("lower", repr(-FAR))
            limit.set("upper", repr(FAR))
        for mimic in joint.findall("mimic"):
            ties.append(_tie(name, mimic, f"{key}: joint {name!r:.80}: mimic"))
            joint.remove(mimic)
        dynamics = joint.find("dynamics")
        if dynamics is not None and any(_number(dynamics.get(what, "0")) for what in ("damping", "friction")):
            rubbed.append(name)
    for element in list(tree):
        if element.tag not in ("link", "joint", "material"):
            tree.remove(element)  # transmissions, plugins of simulators: some are damaged, none is read
    for link in tree.iter("link"):
        for what in ("visual", "collision"):  # the mechanics needs none; they are drawn from the text as it was
            for shape in link.findall(what):
                link.remove(shape)
    xml = ElementTree.tostring(tree, encoding="unicode")
    return RobotText(xml, folder, root, frozenset(endless), tuple(ties), tuple(rubbed), about)


def _in_order(tree: ElementTree.Element, key: str) -> None:
    """Refuse what Pinocchio's reader would stumble over without naming it: doubled names, links that form no tree."""
    links = [element.get("name", "") for element in tree.findall("link")]
    joints = [element.get("name", "") for element in tree.findall("joint")]
    for what, names in (("link", links), ("joint", joints)):
        doubled = next((name for name in names if names.count(name) > 1), None)
        if doubled is not None:
            raise SceneError(f"{key}: two {what}s are called {doubled!r:.80}")
    above: dict[str, str] = {}
    for joint in tree.findall("joint"):
        ends = [end.get("link", "") if end is not None else "" for end in (joint.find("parent"), joint.find("child"))]
        for end in ends:
            if end not in links:
                raise SceneError(f"{key}: joint {joint.get('name', '')!r:.80}: no link {end!r:.80}")
        if ends[1] in above:
            raise SceneError(f"{key}: link {ends[1]!r:.80} has two parents; the links of a URDF form a tree")
        above[ends[1]] = ends[0]
    roots = [name for name in links if name not in above]
    if len(roots) != 1:
        raise SceneError(f"{key}: {len(roots)} links have no parent; one root is needed, and links form a tree")
    for numbers in (element.attrib for element in tree.iter() if element.tag in ("mass", "inertia", "origin", "axis", "limit")):
        for name, text in numbers.items():
            for part in text.split():
                value = _number(part)
                if math.isnan(value) or (abs(value) > 1e30):
                    raise SceneError(f"{key}: {name} = {text!r:.80}: must be a finite number")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def postures_of(robot: RobotText) -> dict[str, dict[str, tuple[float, ...]]]:
    """Return the postures of the srdf that stands in the package of a robot: values by joint, by the posture's name."""
    found: dict[str, dict[str, tuple[float, ...]]] = {}
    if not robot.about or robot.root is None:
        return found
    package = robot.root / Path(robot.about).parts[0]
    own = Path(robot.about).stem
    for path in sorted(package.rglob("*.srdf"), key=lambda path: (path.stem != own, not own.startswith(path.stem), str(path))):
        if path.stat().st_size > MAX_URDF:
            continue
        try:
            tree = parse_xml(path.read_text(encoding="utf-8", errors="replace"), path.name)
        except SceneError:
            continue
        for state in tree.iter("group_state"):
            values = {
                joint.get("name", ""): tuple(map(_number, joint.get("value", "").split())) for joint in state.findall("joint")
            }
            found.setdefault(state.get("name", ""), values)
    return found


class Drawn(NamedTuple):
    """A shape of a URDF's link: a box, cylinder or sphere by its sizes [m], or a mesh file."""

    link: str
    kind: str  # box | cylinder | sphere | mesh
    sizes: tuple[float, ...]  # of a mesh its scales
    place: tuple[float, ...]  # x y z [m] roll pitch yaw [rad] in the link's frame
    colour: str  # #rrggbb, "" where the URDF tells none
    file: Path | None = None


def drawn_shapes(urdf: str) -> list[Drawn]:
    """Return what a URDF draws: its visuals, of links without any their collision shapes. Raises SceneError as `read_robot`.

    A mesh that is not there, or not below the folder that it may be in, is left out.
    """
    robot = read_robot(urdf, "urdf")
    text = str.__str__(urdf) if not robot.about else (robot.root or Path()).joinpath(robot.about).read_text("utf-8", "replace")
    tree = parse_xml(text, "urdf")
    named = {entry.get("name", ""): _colour(entry) for entry in tree.findall("material")}
    found: list[Drawn] = []
    for link in tree.findall("link"):
        for what in ("visual", "collision"):
            shapes = [_drawn(link.get("name", ""), shape, robot, named) for shape in link.findall(what)]
            found += [shape for shape in shapes if shape is not None]
            if any(shapes):
                break
    return found


def _colour(material: ElementTree.Element | None) -> str:
    colour = None if material is None else material.find("color")
    numbers = [] if colour is None else [_number(part) for part in colour.get("rgba", "").split()]
    if len(numbers) < 3 or not all(0.0 <= value <= 1.0 for value in numbers[:3]):
        return ""
    return "#" + "".join(f"{round(255 * value):02x}" for value in numbers[:3])


def _drawn(link: str, shape: ElementTree.Element, robot: RobotText, named: dict[str, str]) -> Drawn | None:
    material, origin, geometry = shape.find("material"), shape.find("origin"), shape.find("geometry")
    colour = _colour(material) or named.get("" if material is None else material.get("name", ""), "")
    place = [0.0] * 6
    if origin is not None:
        for at, key in ((0, "xyz"), (3, "rpy")):
            numbers = [_number(part) for part in origin.get(key, "0 0 0").split()]
            if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
                return None
            place[at : at + 3] = numbers
    for kind, keys in (("box", ("size",)), ("cylinder", ("length", "radius")), ("sphere", ("radius",)), ("mesh", ("scale",))):
        made = None if geometry is None else geometry.find(kind)
        if made is None:
            continue
        texts = " ".join(made.get(key, "1 1 1" if kind == "mesh" else "nan") for key in keys)
        sizes = tuple(_number(part) for part in texts.split())
        if not all(0.0 < abs(size) < 1e6 for size in sizes):
            return None
        file = mesh_file(made.get("filename", ""), robot) if kind == "mesh" else None
        return None if kind == "mesh" and file is None else Drawn(link, kind, sizes, tuple(place), colour, file)
    return None


def mesh_file(name: str, robot: RobotText) -> Path | None:
    """Return a mesh of a URDF below the folder that its files must be in; None where there is none."""
    if robot.root is None or robot.folder is None or "\0" in name:
        return None
    plain = name.removeprefix("package://").removeprefix("model://").removeprefix("file://")
    if not plain or Path(plain).is_absolute() or ".." in Path(plain).parts or "://" in plain:
        return None
    parts = Path(plain).parts
    if name.startswith("package://"):
        tries = [robot.root.joinpath(*parts[k:]) for k in range(min(3, len(parts)))]
    else:
        tries = [robot.folder / plain, robot.root / plain]
    root = robot.root.resolve()
    return next((path for path in tries if path.is_file() and path.resolve().is_relative_to(root)), None)
