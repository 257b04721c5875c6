"""What acts in some phases only: programmes and forces with `closed` and `open`, and the union of the programmes that act."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Sequence

from vlmb.errors import SceneError, nearest
from vlmb.scene.names import CONTACT_FORCE, PHASE_START
from vlmb.scene.tables import Force, Programme, SceneTables

NOTHING: frozenset[str] = frozenset()


class United(Programme, frozen=True, kw_only=True):
    """Programmes that act at once, as one: rows, controls and weights of all; gains are those of its parts."""

    parts: tuple[Programme, ...] = ()
    keys: tuple[str, ...] = ()  # where each stands in the scene


def keyed(programme: Programme | None) -> list[tuple[str, Programme]]:
    """List the parts of a programme with where they stand in the scene; of one that is not united itself."""
    if isinstance(programme, United):
        return list(zip(programme.keys, programme.parts, strict=True))
    return [] if programme is None else [("programme", programme)]


def programmes_of(scene: SceneTables) -> list[tuple[str, Programme]]:
    """List all programmes of a scene, whenever they act, with where they stand in it."""
    return [*keyed(scene.programme), *((f"programmes[{k}]", each) for k, each in enumerate(scene.programmes))]


def is_conditional(entry: Programme | Force) -> bool:
    """Whether something acts in some phases only."""
    return bool(entry.closed or entry.open)


def acts(entry: Programme | Force, closed: Collection[str]) -> bool:
    """Whether something acts while these contacts are closed, and no others."""
    return all(name in closed for name in entry.closed) and not any(name in closed for name in entry.open)


def goes_by_phase(scene: SceneTables) -> bool:
    """Whether programmes or forces of a scene act in some phases only."""
    own = scene.programme is not None and is_conditional(scene.programme)
    return bool(scene.programmes) or own or any(map(is_conditional, scene.forces))


def goes_by_modes(scene: SceneTables) -> bool:
    """Whether controls depend on which contacts are held: they are more than the rows, or rows name forces of contacts."""
    return bool(scene.closing) and any(
        len(each.controls) != len(each.constraints) + len(each.secondary) or any(map(names_forces, each.secondary))
        for _, each in programmes_of(scene)
    )


def names_forces(text: str) -> bool:
    """Whether a row names the force of a contact."""
    return re.search(CONTACT_FORCE, text) is not None


def acting(scene: SceneTables, closed: Collection[str]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return what acts while these contacts are closed: programmes by key, forces by number."""
    programmes = tuple(key for key, programme in programmes_of(scene) if acts(programme, closed))
    return programmes, tuple(k for k, force in enumerate(scene.forces) if acts(force, closed))


def programme_at(scene: SceneTables, closed: Collection[str] = NOTHING) -> Programme | None:
    """Return the programme that acts while these contacts are closed: that of the scene, or all that act, united.

    Raises SceneError where two of them have the same control or row.
    """
    if not scene.programmes and not (scene.programme is not None and is_conditional(scene.programme)):
        return scene.programme
    found = [entry for entry in programmes_of(scene) if acts(entry[1], closed)]
    for k, second in enumerate(found):
        for first in found[:k]:
            both = _in_both(first[1], second[1])
            if both:
                names = ", ".join(sorted(closed)) or "nothing"
                raise SceneError(f"{_at_once(first[0], second[0], both)} with {names} closed; {ADVICE}")
    return _united(found) if found else None


ADVICE = "let `closed` and `open` tell them apart"


def _at_once(first: str, second: str, both: str) -> str:
    return f"{first} and {second} have {both} both, and act at once"


def _united(found: Sequence[tuple[str, Programme]]) -> United:
    parts = [part for _, part in found]
    alone = parts[0] if len(parts) == 1 else None  # u0 and its border take all that rows leave: see `check_phases`
    return United(
        constraints=tuple(row for part in parts for row in part.constraints),
        controls=tuple(name for part in parts for name in part.controls),
        secondary=tuple(row for part in parts for row in part.secondary),
        weights={name: weight for part in parts for name, weight in part.weights.items()},
        u0=alone.u0 if alone else None, border=alone.border if alone else (),
        parts=tuple(parts), keys=tuple(key for key, _ in found),
    )  # fmt: skip


def _in_both(first: Programme, second: Programme) -> str:
    """Name a control or a row that two programmes have; nothing where there is none."""
    for what in ("controls", "constraints"):
        rows = [{text.strip() for text in getattr(each, what)} for each in (first, second)]
        for text in sorted(rows[0] & rows[1]):
            return f"the {'control' if what == 'controls' else 'row'} {text!r:.80}"
    return ""


def _exclude(first: Programme, second: Programme) -> bool:
    return bool({*first.closed} & {*second.open} or {*first.open} & {*second.closed})


def _implies(first: Programme, second: Programme) -> bool:
    return {*second.closed} <= {*first.closed} and {*second.open} <= {*first.open}


def check_phases(scene: SceneTables, refuse: Callable[[str, str], None]) -> None:
    """Refuse conditions that name no contact, and programmes that cannot act beside each other."""
    if scene.programme is not None and scene.programmes:
        refuse("programmes", "[programme] and [[programmes]] are two ways to write the same; put all into [[programmes]]")
    contacts = scene.closing
    forces = [(f"forces[{k}]", force) for k, force in enumerate(scene.forces)]
    entries: list[tuple[str, Programme | Force]] = [*programmes_of(scene), *forces]
    for key, entry in entries:
        for which in ("closed", "open"):
            for name in getattr(entry, which):
                if not contacts:
                    refuse(f"{key}.{which}", "this scene has no contacts, so that nothing in it opens or closes")
                if name not in contacts:
                    refuse(f"{key}.{which}", f"no contact {name!r:.80}; {nearest(name, contacts)}")
        for name in {*entry.closed} & {*entry.open}:
            refuse(key, f"{name!r:.80} is never closed and open at once")
        if isinstance(entry, Force) and entry.between is not None and is_conditional(entry):
            refuse(key, "a spring between two directions stores energy and acts always; write its torque as a law of T_")
    for first, second in _pairs(programmes_of(scene)):
        if _exclude(first[1], second[1]):
            continue
        both = _in_both(first[1], second[1])
        if both and (_implies(first[1], second[1]) or _implies(second[1], first[1])):
            refuse(second[0], f"{_at_once(first[0], second[0], both)}; {ADVICE}")
        for key, entry in (first, second):
            if entry.u0 is not None:
                refuse(f"{key}.u0", f"it takes what the rows leave, and {first[0]} and {second[0]} may act at once; {ADVICE}")


def _pairs(entries: Sequence[tuple[str, Programme]]) -> Iterator[tuple[tuple[str, Programme], tuple[str, Programme]]]:
    for k, second in enumerate(entries):
        for first in entries[:k]:
            yield first, second


def numbers_of(scene: SceneTables) -> dict[str, float]:
    """Return the numbers that equations and laws may name: the parameters, and when the phase began, which `phase_t` goes by."""
    began = {PHASE_START: 0.0} if scene.closing and PHASE_START not in scene.parameters else {}
    return {**scene.parameters, **began}
