"""Laws of the motion between the samples of a run: what one does on a way narrower than a step, which no step asked it for.

Along the cubics through the samples a law that reads the motion is one of time, whose narrow features are found as those of
any law of time. There its work, by quadrature, is beside the work that the run recorded: a force that the steps passed over has
done none. Where it lacks, the part between the two samples is run again with steps that are short enough: that decides.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Collection, Container, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core.calls import begin
from vlmb.core.driver import DONE, FIRST_STEP_SIZE, make_driver
from vlmb.core.opcodes import PARAMETER, SIGNAL, TIME
from vlmb.core.packed import pack, tape_parts
from vlmb.core.time_scan import time_scale
from vlmb.errors import VlmbError
from vlmb.model.laws import Law, parameter_values, prepared
from vlmb.model.tape import CompiledTape, Leaf, compile_tape
from vlmb.scene.by_phase import numbers_of
from vlmb.scene.expressions import Equation, Expression, Tree, parse
from vlmb.simulation.motion import Motion
from vlmb.system.core_engine import CoreEngine
from vlmb.system.engines import make_engine
from vlmb.system.point_forces import is_named
from vlmb.system.system import System

Array = NDArray[np.float64]

BENDING = {"exp", "atan", "atan2"}  # with quotients and high powers what may be narrow in one place alone
NARROW = 0.25  # of an interval between samples: what varies within less of it is looked at
MOST = 100_000  # times at which a law is looked at
TRIES = 3  # parts that are run again
MISSED, COUNTS = 0.5, 1e-5  # of the work by quadrature, and of the kinetic energy: work that is not there


class _Along(NamedTuple):
    """Quantities along a run as functions of time."""

    t: Array
    pieces: list[Array]  # measured data first
    places: dict[str, int]


class _Lack(NamedTuple):
    """What is not there, by its size: the time [s] where it should be, the sample before, times (n,) of steps that see it."""

    size: float
    t: float
    sample: int
    steps: Array


def passed_between(
    system: System, motion: Motion, kinetic: Array, allowed: float, turns: Collection[float] = ()
) -> list[str]:
    """Say which laws and equations did something between samples that the motion knows nothing of.

    kinetic (N,) [J]; allowed: share of the largest velocity by which a run may be off; turns [s]: where it began anew, and the
    motion through the samples beside is not smooth
    """
    if not (system.forces.channels or system.constraints):
        return []
    t, names = motion.t, system.mechanism.names
    acting: dict[str, list[Expression]] = {}
    for force, law in zip(system.forces.channels, system.forces.laws, strict=False):
        if is_named(force) and force.coordinate:
            acting.setdefault(force.name, []).append(law)
    asked = [(f"the law {laws[0].text!r} of {name}", laws, name) for name, laws in acting.items()]
    for force, law in zip(system.forces.channels, system.forces.laws, strict=False):
        if is_named(force) and not force.coordinate:  # what a hinge torque acts along has no rate among the quantities
            asked.append((f"the law {law.text!r} of {force.name}", [law], ""))
    info = system.constraints.info if system.constraints else ()
    rows = [_difference(root) for root in system.constraints.roots[: len(info)]] if system.constraints else []
    asked += [(f"the equation {row.text!r}", [root], "") for row, root in zip(info, rows, strict=True) if not row.of_forces]
    asked = [entry for entry in asked if any(_bends(law.tree, names) for law in entry[1])]
    if not asked or len(t) < 3 or not (np.diff(t) > 0.0).all():
        return []
    found = []
    if not _any_narrow(system, motion, [law for _, together, _ in asked for law in together]):
        return []
    for what, laws, name in asked:
        at = None
        with contextlib.suppress(VlmbError):
            if name:
                lacks = _missed(system, motion, name, laws, float(kinetic.max()), turns)
            else:
                lacks = _varied(system, motion, laws[0], turns)
            at = next((lack.t for lack in lacks[:TRIES] if _ends_elsewhere(system, motion, lack, allowed)), None)
        if at is not None:
            found.append(
                f"near t = {at:.6g} s {what} does something on a way that the steps passed over, and the motion shows nothing of "
                "it; set max_step [s] to less than the time for which it does"
            )
    return found


def _any_narrow(system: System, motion: Motion, laws: Sequence[Expression]) -> bool:
    """Whether any of several laws, looked at together, varies within a part of an interval between samples."""
    with contextlib.suppress(VlmbError):
        compiled, parameters = _compiled(system, _along(system, motion, {name for law in laws for name in law.names}), laws)
        steps = time_scale(compiled.tape, parameters, motion.t[0], motion.t[-1]).steps
        return bool(steps[:, 2].min() < NARROW * float(np.diff(motion.t).max()))
    return True


def _difference(row: Equation | Expression) -> Expression:
    """Return left - right of an equation."""
    if isinstance(row, Expression):
        return row
    return Expression(row.text, row.names, row.left.key, ("+", row.left.tree, ("neg", row.right.tree)))


def _missed(
    system: System, motion: Motion, name: str, laws: Sequence[Expression], kinetic: float, turns: Collection[float]
) -> list[_Lack]:
    """Return where work of a force lacks in what was recorded, the largest first."""
    rate = parse(f"{next(force.coordinate for force in system.forces.channels if force.name == name)}_dot")
    along = _along(system, motion, {read for law in (*laws, rate) for read in law.names})
    t, (*acting, speed) = motion.t, [_law(system, along, law) for law in (*laws, rate)]
    recorded = np.diff(motion.work[:, system.work_names.index(name)])
    found = []
    for k, steps, nodes in _narrow(t, acting, turns):
        power = sum(law.values(nodes) for law in acting) * speed.values(nodes)
        work = float(np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(nodes)))
        lacks = abs(work - recorded[k])
        if lacks > COUNTS * kinetic and abs(recorded[k]) < (1.0 - MISSED) * abs(work):
            found.append(_Lack(lacks, float(nodes[int(np.argmax(np.abs(power)))]), k, steps))
    return sorted(found, key=lambda lack: -lack.size)


def _varied(system: System, motion: Motion, row: Expression, turns: Collection[float]) -> list[_Lack]:
    """Return where an equation leaves, between two samples, what it is at them, the furthest first."""
    law, found = _law(system, _along(system, motion, row.names), row), []
    for k, steps, nodes in _narrow(motion.t, [law], turns):
        values = law.values(nodes)
        off = np.abs(values - np.interp(nodes, nodes[[0, -1]], values[[0, -1]]))
        found.append(_Lack(float(off.max()), float(nodes[int(np.argmax(off))]), k, steps))
    return sorted(found, key=lambda lack: -lack.size)


def _narrow(t: Array, laws: Sequence[Law], turns: Collection[float]) -> Iterator[tuple[int, Array, Array]]:
    """Yield intervals between samples in which laws vary on a narrow way: the first sample, times of steps, and more between."""
    steps = np.concatenate([time_scale(law.compiled.tape, law.parameters, t[0], t[-1]).steps for law in laws])
    looked, short = 0, steps[steps[:, 2] < NARROW * float(np.diff(t).max())]
    for k in sorted({int(at) for first, last, _ in short for at in _reached(t, first, last)}):
        inside = steps[(steps[:, 0] < t[k + 1]) & (steps[:, 1] > t[k])]
        h = t[k + 1] - t[k]
        if not inside[:, 2].min(initial=h) < NARROW * h or any(t[k] <= turn <= t[k + 1] for turn in turns):
            continue
        edges = np.unique(np.clip(np.concatenate([inside[:, :2].ravel(), t[k : k + 2]]), t[k], t[k + 1]))
        middles = 0.5 * (edges[1:] + edges[:-1])
        own = [float(inside[(inside[:, 0] <= at) & (inside[:, 1] >= at), 2].min(initial=h)) for at in middles.tolist()]
        parts = np.maximum(1, np.ceil(np.diff(edges) / own)).astype(int)
        looked += 4 * int(parts.sum())
        if looked > MOST:
            return
        pieces = list(zip(edges[:-1].tolist(), edges[1:].tolist(), parts.tolist(), strict=True))
        yield k, _times(pieces, 1), _times(pieces, 4)


def _times(pieces: Sequence[tuple[float, float, int]], many: int) -> Array:
    """Return the ends of parts of pieces of time, each part again in as many."""
    inside = (np.linspace(begins, ends, many * parts + 1)[1:] for begins, ends, parts in pieces)
    return np.concatenate([[pieces[0][0]], *inside])


def _ends_elsewhere(system: System, motion: Motion, lack: _Lack, allowed: float) -> bool:
    """Whether short steps from a sample come to other velocities at the next than the run did."""
    k = lack.sample
    many = len(motion.branch) > 1
    engine = make_engine(system, motion.branch[k if many else 0], None, motion.engine)
    if many and isinstance(engine, CoreEngine):
        engine.take_branch(motion.branch[k])
    driver = make_driver("dop853", motion.states.shape[1], rtol=system.run.rtol, atol=system.run.atol)
    driver.point[:] = motion.states[k]
    for start, end in itertools.pairwise(lack.steps.tolist()):
        driver.real[FIRST_STEP_SIZE] = end - start
        begin(driver, start, end)
        if engine.run(driver, np.zeros((0, 3)), np.inf) != DONE:
            return False
    off = np.abs(driver.point - motion.states[k + 1])[engine.velocities]
    return float(off.max()) > allowed * float(np.abs(motion.states[:, engine.velocities]).max())


def _reached(t: Array, begin: float, end: float) -> Iterable[int]:
    """Intervals between samples that a stretch of time has a part of."""
    first, last = np.searchsorted(t, [begin, end], side="right") - 1
    return range(max(int(first), 0), min(int(last) + 1, len(t) - 1))


def _along(system: System, motion: Motion, names: Collection[str]) -> _Along:
    """Put cubics through the quantities that names are, or are the rates of."""
    mechanism = system.mechanism
    signals = mechanism.signals
    along = _Along(motion.t, list(signals.pieces), {})
    for name in sorted(names):
        if name not in mechanism.names or name in signals:
            continue
        quantity = mechanism.names.find(name)
        plain = quantity.name.removesuffix("_dot")
        if plain not in along.places:
            value = motion.postures.read(mechanism.names.find(plain), *motion.coordinates)
            slopes = (
                np.gradient(value, motion.t)
                if quantity.kind == "speed"
                else motion.postures.read(mechanism.names.find(f"{plain}_dot"), *motion.coordinates)
            )
            along.places[plain] = 3 * len(along.pieces)
            along.pieces.append(_cubics(motion.t, value, slopes))
        along.places[name] = along.places[plain] + (quantity.rate and quantity.kind != "speed")
    return along


def _cubics(t: Array, value: Array, slopes: Array) -> Array:
    """Return pieces (N, 7) of a function with values and slopes (N,) at samples: where one begins, and its coefficients."""
    h, found = np.diff(t), np.zeros((len(t), 7))
    mean = np.diff(value) / h
    found[:, 0] = t
    found[:-1, 1], found[:-1, 2] = value[:-1], slopes[:-1]
    found[:-1, 3] = (3.0 * mean - 2.0 * slopes[:-1] - slopes[1:]) / h
    found[:-1, 4] = (slopes[:-1] + slopes[1:] - 2.0 * mean) / h**2
    return found


def _compiled(system: System, along: _Along, laws: Sequence[Expression]) -> tuple[CompiledTape, Array]:
    """Compile laws along a run as laws of time; return their tape, and the parameters."""
    numbers, signals = numbers_of(system.mechanism.scene), system.mechanism.signals
    places: Mapping[str, int] = {name: at for at, name in enumerate(numbers)}

    def leaf(name: str) -> Leaf:
        if name == "t":
            return Leaf(TIME)
        if name in places:
            return Leaf(PARAMETER, places[name])
        return Leaf(SIGNAL, signals[name] if name in signals else along.places[name])

    return compile_tape(laws, leaf, along.pieces), parameter_values(numbers)


def _law(system: System, along: _Along, law: Expression) -> Law:
    """Compile a law along a run as one of time."""
    compiled, parameters = _compiled(system, along, [law])
    buffers = prepared(compiled, parameters, [law])
    return Law(law.text, law, compiled, parameters, pack(tape_parts(compiled.tape, buffers, parameters)))


def _bends(tree: Tree, motion: Container[str]) -> bool:
    """Whether an expression may do something on a narrow way and nothing elsewhere; what switches is located anyway."""
    op, *rest = tree
    if op in ("name", "number"):
        return False
    steep = rest if op in BENDING else rest[1:] if op == "/" else rest[:1] if op == "**" and not 0.0 <= rest[1][1] <= 4.0 else []
    return any(_reads(part, motion) for part in steep) or any(_bends(part, motion) for part in rest)


def _reads(tree: Tree, motion: Container[str]) -> bool:
    op, *rest = tree
    return rest[0] in motion if op == "name" else op != "number" and any(_reads(part, motion) for part in rest)
