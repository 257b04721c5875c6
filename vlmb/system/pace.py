"""How long steps may be, so that none passes over what a law, a prescribed length or an equation does in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vlmb.core import opcodes as op
from vlmb.core.time_scan import time_scale
from vlmb.model.signals import require_span, signals_of
from vlmb.model.tape import Leaf, compile_tape
from vlmb.scene.by_phase import numbers_of, programmes_of
from vlmb.scene.expressions import Equation, Expression, Tree, parse, parse_equation
from vlmb.scene.legs import law_text
from vlmb.scene.names import PHASE_START
from vlmb.scene.rows import rows_of
from vlmb.scene.scene import Scene

Array = NDArray[np.float64]


def longest_steps(scene: Scene, begin: float, end: float) -> Array:
    """Return rows (count, 3) of begin, end, longest step [s] there, in order; none where nothing depends on time.

    Within a step h every part of a law that depends on time alone has h^2 max|f''| <= the range of f over the run. What depends
    on the state is the business of the method.
    """
    signals, roots = signals_of(scene), timed_laws(scene)
    # a length or a row brings in the second derivative of what it names: that is followed as well
    bends = {f"{column.name}_ddot" for root in roots for column in signals.read_by(root.names)}
    roots += [parse(name, "data") for name in sorted(bends)]
    if not roots:
        return np.zeros((0, 3))
    numbers = numbers_of(scene)
    places = {name: at for at, name in enumerate(numbers)}

    def leaf(name: str) -> Leaf:
        if name in places:
            return Leaf(op.PARAMETER, places[name])
        if name in signals:
            return Leaf(op.SIGNAL, signals[name])
        return Leaf(op.TIME) if name == "t" else Leaf(op.VALUE)

    parameters = np.array([float(value) for value in numbers.values()])
    found, until = time_scale(compile_tape(roots, leaf, signals.pieces).tape, parameters, begin, end)
    if until < end:  # too fast from here on to be known
        found = np.vstack([found, [until, end, found[-1, 2]]])
    return np.ascontiguousarray(found)


def timed_laws(scene: Scene) -> list[Expression | Equation]:
    """List the laws and equations that go by the time, or by measured data."""
    own = {"t", *signals_of(scene)}
    return [root for root in laws_of(scene) if root.names & own]


def watched(bounds: Array, scene: Scene, begin: float, end: float, asked: bool) -> Array:
    """Return longest steps no longer than a sample where events of the scene, or the end that is `asked` for, are looked for.

    They may come and go in the motion within a step, and do not make a method shorten it.
    """
    if not (scene.events or asked):
        return bounds
    found = bounds if len(bounds) else np.array([[begin, end, np.inf]])
    return np.column_stack([found[:, :2], np.minimum(found[:, 2], 1.0 / scene.run.samples)])


def require_data(scene: Scene, begin: float, end: float, what: str = "the run") -> None:
    """Raise SceneError where measured data that a scene always reads do not reach over a time [s]; `where` may pass some by."""
    signals = signals_of(scene)
    if signals:
        sides = [part for root in laws_of(scene) for part in ((root.left, root.right) if isinstance(root, Equation) else (root,))]
        require_span(signals, set().union(*(_always(side.tree) for side in sides)), begin, end, what)


def _always(tree: Tree) -> set[str]:
    """Names whose values an expression takes whatever `where` chooses."""
    op, *rest = tree
    if op in ("name", "number"):
        return {rest[0]} if op == "name" else set()
    return set().union(*(_always(part) for part in (rest[:1] if op == "where" else rest)))


def laws_of(scene: Scene) -> list[Expression | Equation]:
    """Read all laws and equations of a scene."""
    found: list[Expression | Equation] = [
        parse(force.law, f"forces[{k}].law") for k, force in enumerate(scene.forces) if force.law is not None
    ]
    found += [parse(law, "force") for force in scene.forces for law in force.force or ()]
    lengths = [segment for link in scene.links for segment in (link.lower, link.upper)]
    found += [parse(segment.law, "law") for segment in lengths if segment.law is not None]
    for _, programme in programmes_of(scene):
        matrices = [matrix or () for matrix in (programme.h, programme.k, programme.border)]
        laws = [law for matrix in matrices for row in matrix for law in row]
        laws += [law for law in (programme.u0, *programme.weights.values()) if law is not None]
        found += [parse(law, "programme") for law in laws]
    found += [parse(law_text(law, "0"), "legs") for leg in scene.legs for law in (leg.reach, leg.attack) if law is not None]
    found += [parse_equation(event.when, f"events[{k}].when") for k, event in enumerate(scene.events)]
    rows = rows_of(scene)
    return [*found, *(parse_equation(row.equation, row.key) for row in (*rows.ideal, *rows.servo, *rows.secondary))]


def names_phase_time(scene: Scene) -> bool:
    """Whether a law or an equation of a scene names `phase_t`."""
    return any(PHASE_START in root.names for root in laws_of(scene))
