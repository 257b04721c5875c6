"""Phases and events as plain data of a file, and back, looked at before anything is made of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from vlmb.model.frozen import read_only
from vlmb.scene.names import has_controls
from vlmb.simulation.phases import KINDS, Event, Stretch
from vlmb.system.contacts import AWAY, HELD, OPEN, RESTING, SLIDING, STANDING, Footing

STATES, MODES = (OPEN, AWAY, HELD, SLIDING, STANDING, RESTING), (OPEN, HELD, SLIDING)
MOST = 1_000_000  # of either


def phases_as_data(stretches: Sequence[Stretch], events: Sequence[Event]) -> dict[str, Any]:
    """Return what a file keeps of phases and events; nothing of a run without any."""
    found: dict[str, Any] = {}
    if stretches:
        found["phases"] = [[s.start, s.end, [_kept(at) for at in s.footings], s.first, s.last, s.quiet] for s in stretches]
    if stretches or events:
        found["events"] = [
            [
                e.t, e.kind, e.name, list(e.contacts), {n: p.tolist() for n, p in e.impulses.items()}, e.lost, dict(e.modes),
                e.several, *([e.early] if e.early else []),
            ]
            for e in events
        ]
    return found


def phases_from_data(data: Mapping[str, Any], names: Sequence[str], count: int) -> tuple[tuple[Stretch, ...], tuple[Event, ...]]:
    """Read phases and events of a run of `count` samples with contacts of these names. Raises ValueError, TypeError, KeyError."""
    if not names:
        data = {"phases": [], "events": data.get("events", [])}
    phases, events = data["phases"], data["events"]
    if not (isinstance(phases, list) and isinstance(events, list) and bool(names) <= len(phases) <= MOST and len(events) <= MOST):
        raise ValueError("no lists")
    found, at = [], 0
    for start, end, footings, first, last, quiet in phases:
        if (first, len(footings)) != (at, len(names)) or not first <= last <= count:
            raise ValueError("samples of phases do not follow each other")
        at = int(last)
        made = tuple(map(_footing, footings))
        found.append(Stretch(_number(start), _number(end), made, int(first), at, bool(quiet)))
    if names and at != count:
        raise ValueError("phases do not cover all samples")
    return tuple(found), tuple(_event(entry, names) for entry in events)


def _kept(at: Footing) -> list[Any]:
    return [*at] if at.planted else [*at[:-1]]


def _footing(entry: Sequence[Any]) -> Footing:
    state, place, first, second, since, gap, towards, *planted = entry
    if state not in STATES or planted not in ([], [True]) or (planted and state != HELD):
        raise ValueError(f"state {state!r:.40}")
    x, one, other, way = map(_vector, (place, first, second, towards))
    return Footing(state, x, one, other, _number(since), _number(gap), way, bool(planted))


def _event(entry: Sequence[Any], names: Sequence[str]) -> Event:
    t, kind, name, contacts, impulses, lost, modes, *others = entry  # older files say nothing of the last two
    several, early = others[:1] == [True], others[1] if len(others) > 1 else 0.0
    known = {name, *contacts, *impulses, *modes}
    if kind not in KINDS or not isinstance(name, str) or has_controls(name) or not known - {name} <= {*names}:
        raise ValueError(f"event {kind!r:.40} of {name!r:.40}")
    if not {*modes.values()} <= {*MODES}:
        raise ValueError("modes of an event")
    pushed = {n: read_only(np.array(_vector(p))) for n, p in impulses.items()}
    shown = MappingProxyType(dict(modes))
    made = Event(_number(t), kind, name, tuple(contacts), MappingProxyType(pushed), _number(lost), shown)
    return made._replace(several=several, early=_number(early))


def _vector(values: Sequence[Any]) -> tuple[float, float, float]:
    x, y, z = map(_number, values)
    return x, y, z


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{value!r:.40} where a number belongs")
    return float(value)
