"""How long steps may be, so that none passes over what a law, a prescribed length or an equation does in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vlmb.core import opcodes as op
from vlmb.core.time_scan import time_scale
from vlmb.model.tape import Leaf, compile_tape
from vlmb.scene.expressions import Equation, Expression, parse, parse_equation
from vlmb.scene.rows import rows_of
from vlmb.scene.scene import Scene

Array = NDArray[np.float64]


def longest_steps(scene: Scene, begin: float, end: float) -> Array:
    """Return rows (count, 3) of begin, end, longest step [s] there, in order; none where nothing depends on time.

    Within a step h every part of a law that depends on time alone has h^2 max|f''| <= the range of f over the run. What depends
    on the state is the business of the method.
    """
    roots = [root for root in _of_scene(scene) if "t" in root.names]
    if not roots:
        return np.zeros((0, 3))
    places = {name: at for at, name in enumerate(scene.parameters)}

    def leaf(name: str) -> Leaf:
        if name in places:
            return Leaf(op.PARAMETER, places[name])
        return Leaf(op.TIME) if name == "t" else Leaf(op.VALUE)

    parameters = np.array([float(value) for value in scene.parameters.values()])
    found, until = time_scale(compile_tape(roots, leaf).tape, parameters, begin, end)
    if until < end:  # too fast from here on to be known
        found = np.vstack([found, [until, end, found[-1, 2]]])
    return np.ascontiguousarray(found)


def _of_scene(scene: Scene) -> list[Expression | Equation]:
    """Read all laws and equations of a scene."""
    found: list[Expression | Equation] = [
        parse(force.law, f"forces[{k}].law") for k, force in enumerate(scene.forces) if force.law is not None
    ]
    found += [parse(law, "force") for force in scene.forces for law in force.force or ()]
    lengths = [segment for link in scene.links for segment in (link.lower, link.upper)]
    found += [parse(segment.law, "law") for segment in lengths if segment.law is not None]
    if scene.programme is not None and scene.programme.u0 is not None:
        found.append(parse(scene.programme.u0, "programme.u0"))
    rows = rows_of(scene)
    return [*found, *(parse_equation(row.equation, row.key) for row in (*rows.ideal, *rows.servo, *rows.secondary))]
