"""Forces at points: given ones, springs along the line between two points, and the drag of the air; each a force and its law.

A force at a point is three generalized forces along the coordinates of its place. A spring pulls along the distance l of its
ends, F = k (l - rest) + c l'; where it has no length and its rest is 0 it acts along l^2/2, which is regular at l = 0. What a
spring stores and what it loses are laws apart, so that the account of energy has both.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import SceneError, nearest
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import AXES, DOT, LOST, STORED, GeneralizedForce, PointEnd
from vlmb.model.quantities import SQUARE, allowed_names
from vlmb.model.reading import Postures
from vlmb.scene.by_phase import NOTHING as NOTHING_CLOSED
from vlmb.scene.by_phase import acts, numbers_of
from vlmb.scene.expressions import Expression, Tree, parse
from vlmb.scene.legs import standing_of, stands
from vlmb.scene.tables import BASE, SURFACE, Force, Place, Spring

Array = NDArray[np.float64]

NOTHING: Tree = ("number", 0.0)


class Acting(NamedTuple):
    """A generalized force and the law that gives it."""

    force: GeneralizedForce
    law: Expression


def scene_forces(mechanism: Mechanism, every: bool = False) -> list[Acting]:
    """Return all forces of a scene that have a law, those of springs between points and of drag last. Raises SceneError.

    With contacts these are the forces that act while all are open; `every`: those of any phase.
    """
    scene, found = mechanism.scene, list[Acting]()
    allowed = allowed_names(mechanism.names, numbers_of(scene), mechanism.signals)
    for index, force in enumerate(scene.forces):
        if not (every or acts(force, NOTHING_CLOSED)):
            continue
        key = f"forces[{index}]"
        if force.on is not None and force.law is not None:
            found.append(Acting(mechanism.names.force(force.on, f"{key}.on"), parse(force.law, f"{key}.law", allowed)))
        elif force.at is not None:
            found += _at_point(mechanism, force, key, allowed)
    for index, spring in enumerate(scene.springs):
        found += _spring(mechanism, spring, f"springs[{index}]")
    for k, leg in enumerate(scene.legs):
        found += _leg(mechanism, k) if leg.law is None and stands(scene, k) else ()
    return [*found, *_drag(mechanism)]


def is_named(force: GeneralizedForce) -> bool:
    """Whether a force is one of the results; springs and drag are in the account of energy alone."""
    return force.kind not in (STORED, LOST)


def _at_point(mechanism: Mechanism, force: Force, key: str, allowed: Collection[str]) -> Iterator[Acting]:
    """Yield the components in the surface frame that are not 0."""
    assert force.at is not None and force.force is not None
    parts = [parse(law, f"{key}.force[{k}]", allowed) for k, law in enumerate(force.force)]
    names = frozenset[str]().union(*(part.names for part in parts))
    trees: Sequence[Tree] = [part.tree for part in parts]
    text = str(force.force)
    if force.frame != SURFACE:
        trees, own = _in_surface_frame(mechanism, force.frame, trees, f"{key}.frame")
        names |= own
    for axis, part, tree in zip(AXES, parts, trees, strict=True):
        acting = mechanism.names.force_at(force.at, axis, f"{key}.at")
        if tree != NOTHING:
            shown = part.text if force.frame == SURFACE else f"{text} by the frame of {force.frame}"
            yield Acting(acting, Expression(shown, names if force.frame != SURFACE else part.names, part.key, tree))


def _in_surface_frame(
    mechanism: Mechanism, frame: str, parts: Sequence[Tree], key: str
) -> tuple[list[Tree], frozenset[str]]:
    """Turn components along a link, in the directions of growing azimuth and elevation, into those of the surface frame.

    F = F_along d + F_azimuthal (-sin phi, cos phi, 0) + F_elevational (-sin psi cos phi, -sin psi sin phi, cos psi). The
    first needs no angles, so that it is regular at the pole.
    """
    layout, names = mechanism.layout, set[str]()
    if frame not in mechanism.names.links:
        raise SceneError(f"{key} = {frame!r:.80}: no such frame; {nearest(frame, [SURFACE, *mechanism.names.links])}")

    def name(of: str) -> Tree:
        names.add(of)
        return "name", of

    def times(*factors: Tree) -> Tree:
        return ("*", *factors)

    along, azimuthal, elevational = parts
    sums: list[list[Tree]] = [[], [], []]
    if along != NOTHING:
        for axis, terms in zip(AXES, sums, strict=True):
            terms.append(times(along, name(f"{frame}.direction.{axis}")))
    if azimuthal != NOTHING or elevational != NOTHING:
        flat = "phi0" if layout.headed else ""
        phi = (name(flat) if flat else NOTHING) if layout.plane else name(f"{frame}.azimuth")
        if azimuthal != NOTHING:
            sums[0].append(("neg", times(azimuthal, ("sin", phi))))
            sums[1].append(times(azimuthal, ("cos", phi)))
        if elevational != NOTHING:
            psi = name(f"{frame}.elevation")
            sums[0].append(("neg", times(elevational, ("sin", psi), ("cos", phi))))
            sums[1].append(("neg", times(elevational, ("sin", psi), ("sin", phi))))
            sums[2].append(times(elevational, ("cos", psi)))
    return [NOTHING if not terms else terms[0] if len(terms) == 1 else ("+", *terms) for terms in sums], frozenset(names)


def _spring(mechanism: Mechanism, spring: Spring, key: str) -> Iterator[Acting]:
    """Yield the force that stores energy, then the one that loses it."""
    ends = tuple(_end(mechanism, place, f"{key}.between[{k}]") for k, place in enumerate(spring.between))
    length, rate, k = ("name", key), ("name", f"{key}{DOT}"), spring.stiffness
    longer: Tree = ("+", length, ("number", -spring.rest)) if spring.rest else length
    slack: Tree = ("+", ("number", spring.rest), ("neg", length))  # below 0 where it is taut
    rope = spring.tension_only and spring.rest > 0.0

    def acting(kind: str, tree: Tree, along: str = "") -> Acting:
        names = frozenset() if along else frozenset({key, f"{key}{DOT}"})
        return Acting(GeneralizedForce(key, kind, coordinate=along, ends=ends), Expression(key, names, key, tree))

    if k and not spring.rest:
        yield acting(STORED, ("number", -k), SQUARE)
    elif k:
        pull: Tree = ("*", ("number", -k), longer)
        yield acting(STORED, ("where", slack, pull, NOTHING) if rope else pull)
    if spring.damping:
        lost: Tree = ("*", ("number", spring.damping), rate)
        if spring.tension_only:  # the whole is never below 0
            lost = ("max", lost, ("*", ("number", -k), longer) if k else NOTHING)
            lost = ("where", slack, lost, NOTHING) if rope else lost
        yield acting(LOST, ("neg", lost))


def _leg(mechanism: Mechanism, k: int) -> Iterator[Acting]:
    """Yield what the spring of a leg that stands pushes on its point with, then its damper."""
    leg, texts, key = mechanism.scene.legs[k], standing_of(mechanism.scene, k), f"legs[{k}]"
    link = -1 if leg.from_ == BASE else mechanism.names.point(leg.from_, key)[0]
    for kind, along in ((STORED, texts.spring), (LOST, texts.damper)):
        for away, name in zip(texts.away, texts.names, strict=True):
            if name and (kind == STORED or leg.damping):
                law = parse(f"({along})*{away}/{texts.length}", key)
                acting = GeneralizedForce(leg.name, kind, link, coordinate=name)
                yield Acting(acting, Expression(f"of the leg {leg.name}", law.names, key, law.tree))


def _end(mechanism: Mechanism, place: Place, key: str) -> PointEnd:
    if isinstance(place, str):
        return mechanism.names.point(place, key)
    x, y, z = map(float, place)
    return x, y, z


def _drag(mechanism: Mechanism) -> Iterator[Acting]:
    """Yield the components of -c |v| v on a ski."""
    base = mechanism.scene.base
    if not base.drag:
        return
    rates: list[Tree] = [("name", f"{base.drag_at}.{axis}{DOT}") for axis in AXES]
    names = frozenset(rate[1] for rate in rates)
    speed: Tree = ("sqrt", ("+", *(("**", rate, ("number", 2.0)) for rate in rates)))
    for axis, rate in zip(AXES, rates, strict=True):
        place = mechanism.names.force_at(base.drag_at, axis, "base.drag_at")
        force = GeneralizedForce("drag", LOST, place.link, coordinate=place.coordinate)
        yield Acting(force, Expression("drag", names, "base.drag", ("*", ("number", -base.drag), speed, rate)))


def singular_lengths(mechanism: Mechanism) -> list[tuple[int, str]]:
    """List the springs, by number, that have no direction where their ends meet, with a sentence for it."""
    found = []
    for index, spring in enumerate(mechanism.scene.springs):
        if spring.damping or spring.rest:
            first, second = (place if isinstance(place, str) else f"the fixed place {list(place)}" for place in spring.between)
            found.append((index, f"springs[{index}]: {first} and {second} meet, where its force has no direction"))
    return found


def lengths_of(mechanism: Mechanism, index: int, seen: Postures) -> Array:
    """Return the lengths (...) [m] of a spring in postures."""
    first, second = (_place(mechanism, place, seen) for place in mechanism.scene.springs[index].between)
    return np.asarray(np.linalg.norm(second - first, axis=-1))


def _place(mechanism: Mechanism, place: Place, seen: Postures) -> Array:
    if isinstance(place, str):
        link, point = mechanism.names.point(place, "springs")
        return seen.position(link, point)
    return np.array(place, float)


def told(mechanism: Mechanism, seen: Postures) -> list[str]:
    """Say, a sentence each, which forces act at points, which springs between points and what a ski takes, in a posture."""
    scene, found = mechanism.scene, list[str]()
    for index, force in enumerate(scene.forces):
        if force.at is not None and force.force is not None:
            laws = ", ".join(f"{law:g}" if isinstance(law, float) else law for law in map(_short, force.force))
            frame = "the surface frame" if force.frame == SURFACE else f"the frame of {force.frame}"
            found.append(f"forces[{index}]: at {force.at}, ({laws}) N in {frame}")
    for index, spring in enumerate(scene.springs):
        first, second = (place if isinstance(place, str) else f"{list(map(float, place))} m" for place in spring.between)
        keys = [f"{spring.stiffness:g} N/m", f"{spring.damping:g} N s/m" if spring.damping else "", f"rest {spring.rest:g} m"]
        keys += ["a rope, which never pushes" if spring.tension_only else ""]
        length = float(lengths_of(mechanism, index, seen))
        found.append(f"springs[{index}]: {first} to {second}, {', '.join(filter(None, keys))}; {length:.4g} m at the start")
    for index, contact in enumerate(scene.contacts):
        rub = {"rough": "rough", 0.0: "smooth"}.get(contact.friction, f"friction {contact.friction}")
        bounce = f", restitution {contact.restitution:g}" if contact.restitution else ""
        found.append(f"contacts[{index}]: {contact.name} at {contact.point} on {contact.surface} = 0, {rub}{bounce}")
    for index, leg in enumerate(scene.legs):
        sprung = f"{leg.stiffness:g} N/m, {leg.damping:g} N s/m, {leg.length or 0.0:g} m at rest"
        pushes = sprung if leg.law is None else f"as long as {_short(leg.law)} m"
        begins = "swings" if leg.foot is None else f"stands at ({leg.foot[0]:g}, {leg.foot[1]:g}) m"
        begins += " and never lands, without an attack," if leg.attack is None else ""
        found.append(f"legs[{index}]: {leg.name} from {leg.from_}, {pushes}; {begins} at the start")
    base = scene.base
    if base.friction:
        by = "the normal force" if base.friction_on == "normal" else "the resultant of normal and edge force"
        found.append(f"base: Coulomb friction {base.friction:g} of {by}")
    if base.lift:
        ratios = "" if base.hold is None else f", its edge holds {base.hold:g} times the normal force"
        found.append(f"base: leaves the snow where it would have to pull{ratios}")
    if base.drag:
        found.append(f"base: drag {base.drag:g} kg/m by the velocity of {base.drag_at}")
    return found


def _short(law: float | str) -> float | str:
    return float(law) if isinstance(law, (int, float)) else law if len(law) <= 60 else f"{law[:57]}..."


def energy_of_springs(mechanism: Mechanism, seen: Postures) -> Array:
    """Return the energy (...) [J] of the springs between points."""
    total = np.zeros(np.shape(seen.heading))
    for index, spring in enumerate(mechanism.scene.springs):
        off = lengths_of(mechanism, index, seen) - spring.rest
        total = total + 0.5 * spring.stiffness * (np.maximum(off, 0.0) if spring.tension_only else off) ** 2
    return total


def outer_forces(
    mechanism: Mechanism, seen: Postures, data: pin.Data, acting: Sequence[tuple[GeneralizedForce, float]]
) -> pin.StdVec_Force:
    """Return what acts on the links at points, in the axes of their joints, for Pinocchio's inverse dynamics.

    These forces do not come through hinges or from the snow. `data` has the placements of the joints, `acting` values of forces.
    """
    found = pin.StdVec_Force([pin.Force.Zero() for _ in range(mechanism.model.njoints)])

    def push(end: PointEnd, force: Array) -> None:
        if len(end) == 2:
            joint = mechanism.layout.links[end[0]].joint
            own = data.oMi[joint].rotation.T @ force
            arm = np.array([float(seen.distance(end[0], end[1])), 0.0, 0.0])
            found[joint] = found[joint] + pin.Force(own, np.cross(arm, own))

    def place(end: PointEnd) -> Array:
        return seen.position(end[0], end[1]) if len(end) == 2 else np.array(end)

    for force, value in acting:
        if force.ends:
            line = place(force.ends[1]) - place(force.ends[0])
            pull = value * (line if force.coordinate == SQUARE else line / max(float(np.linalg.norm(line)), 1e-300))
            push(force.ends[1], pull)
            push(force.ends[0], -pull)
        elif force.kind in ("point", LOST, STORED) and "." in force.coordinate:
            where, _, axis = force.coordinate.rpartition(".")
            vector = value * np.eye(3)[AXES.index(axis)]
            if force.link >= 0:
                push((force.link, where.partition(".")[2]), vector)
                continue
            inertias = list(mechanism.model.inertias)
            mass = sum(inertia.mass for inertia in inertias)
            for joint in range(1, mechanism.model.njoints):
                own = data.oMi[joint].rotation.T @ vector * (inertias[joint].mass / mass)
                found[joint] = found[joint] + pin.Force(own, np.cross(inertias[joint].lever, own))
    return found
