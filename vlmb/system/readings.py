"""Equations, laws and forces as Pinocchio's state gives them: compiled for the core, read through the link frames.

The core reads quantities of its own state; vlmb/core/joints.py makes that of (q, v), and takes rows back to Pinocchio's
velocities. A prescribed length is a velocity there, so it is free in the tree that is read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vlmb.core import packed, rows
from vlmb.core import quantities as core
from vlmb.core import tree as of
from vlmb.core.opcodes import RATE, VALUE
from vlmb.core.packed import Packed, pack, tape_parts
from vlmb.errors import SingularError, VlmbError
from vlmb.model.arrays import Arrays, make_arrays
from vlmb.model.coordinates import POLE
from vlmb.model.laws import parameter_values, prepared
from vlmb.model.layout import Layout
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import GeneralizedForce
from vlmb.model.quantities import QuantityTable
from vlmb.model.tape import CompiledTape, compile_tape
from vlmb.scene.by_phase import numbers_of, programmes_of
from vlmb.scene.expressions import Equation, Expression

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

NEXT_TO_POLE = 0.05  # cosine of an elevation: what goes by an azimuth grows beyond bounds near there


@dataclass(frozen=True, eq=False)
class Readings:
    """A tape, the quantities that it reads and those that forces act along. Nothing in it changes; see `buffers`."""

    layout: Layout
    arrays: Arrays
    table: QuantityTable = field(repr=False)
    compiled: CompiledTape = field(repr=False)
    parameters: Array = field(repr=False)
    forces: tuple[GeneralizedForce, ...]
    packed: Packed = field(repr=False)

    @property
    def integers(self) -> Integers:
        """What kernels take first."""
        return self.packed.integers

    def buffers(self) -> Array:
        """Return what kernels take second: constants, and room to write; one for each thread."""
        return self.packed.reals.copy()

    def read(self, root: int) -> frozenset[int]:
        """Quantities that a root reads, by number."""
        leaves = self.compiled.tape.leaf[list(self.compiled.rows[root].leaves)]
        return frozenset(int(at) for kind, at in leaves if kind in (VALUE, RATE))

    def obstacle(self, buffers: Array, roots: Iterable[int]) -> VlmbError | None:
        """Say which quantity, of those that some roots read, had no value at the last evaluation: an azimuth at the pole."""
        table = list(self.table.rows)
        for k in sorted(frozenset[int]().union(*map(self.read, roots))):
            kind, row = table[k][:2]
            if kind == core.AZIMUTH and self._flat(buffers, row) < POLE:
                return no_azimuth(self.layout, self.arrays.order[row])
            if kind == core.BETWEEN and not np.isfinite(buffers[int(self.integers[2 * packed.MEASURED]) + 3 * k + 1]):
                return ends_meet(self.table.labels[k])
        return None

    def _flat(self, buffers: Array, row: int) -> float:
        at = int(self.integers[2 * packed.STATE]) + int(self.arrays.tree.link[row, of.AT_P])
        return float(np.hypot(*buffers[at : at + 2]))


def no_azimuth(layout: Layout, i: int) -> SingularError:
    """Make the error of an equation that reads an azimuth at the pole."""
    name = layout.links[i].name
    return SingularError(
        f"phi{i + 1} is used by an equation, a force or a control while link {name!r} stands at the pole (|cos psi| < {POLE:g}), "
        f"where it has no azimuth; write the equation with {name}.direction.x and .y, and use a hinge torque T_{name}"
    )


def beside_pole(mechanism: Mechanism, coordinates: Mapping[str, float]) -> str:
    """Say which links stand next to the pole while the scene goes by azimuths, or rows by elevations; "" where none does."""
    scene, found = mechanism.scene, []
    rows = [text for _, programme in programmes_of(scene) for text in (*programme.constraints, *programme.controls)]
    written = " ".join([*scene.constraints, *rows])
    said = " ".join([*map(str, scene.forces), written])
    for i, link in enumerate(mechanism.layout.links):
        if mechanism.layout.plane or abs(math.cos(coordinates.get(f"psi{i + 1}", 0.0))) >= NEXT_TO_POLE:
            continue
        if named := re.search(rf"\b(M_)?phi{i + 1}(_dot)?\b|\b{link.name}\.azimuth", said):
            found.append(
                f". Link {link.name!r} stands next to the pole, where what goes by {named[0]} grows without bound: use a hinge "
                f"torque T_{link.name}, or {link.name}.direction.x and .y"
            )
        elif named := re.search(rf"\bpsi{i + 1}\b|\b{link.name}\.elevation\b", written):
            found.append(
                f". Link {link.name!r} stands next to the pole, where {named[0]} has no rate in most directions: let equations "
                f"name {link.name}.direction.x and .y, or set plane = true"
            )
    return "".join(found)


def ends_meet(name: str) -> SingularError:
    """Make the error of a spring between points without a length."""
    return SingularError(
        f"{name}: its two ends meet, where a spring with a rest length or a damper has no direction; start elsewhere, or take "
        "rest = 0 without damping"
    )


def no_direction(force: GeneralizedForce, layout: Layout) -> SingularError:
    """Make the error of a force that has no direction: M_phi at its pole, a hinge torque between directions in line."""
    if force.ends:
        return ends_meet(force.name)
    if force.kind == "hinge":
        return SingularError(
            f"T_{layout.links[force.link].name}: the link and its parent line up, where this hinge torque has no axis; "
            "bend the hinge at the start, or use M_psi or a spring between directions"
        )
    return SingularError(
        f"{force.name}: link {force.link + 1} stands at the pole (|cos psi| < {POLE:g}), where the torque "
        "M_phi / cos(psi) is unbounded; use a hinge torque T_<link> or an equation for the link's direction"
    )


def make_readings(
    mechanism: Mechanism, roots: Sequence[Expression | Equation], forces: Sequence[GeneralizedForce] = (),
    scales: Sequence[float] | None = None, rows: int | None = None, of_forces: Collection[int] = (),
) -> Readings:  # fmt: skip
    """Compile equations and laws (roots) and forces with their scales for Pinocchio's state. Raises ExpressionError.

    rows : how many roots are rows, the others are read by value; None: all; of_forces: which of them name forces
    """
    scene, layout = mechanism.scene, mechanism.layout
    arrays = make_arrays(scene, layout, sliding=True, driven=True)
    table = QuantityTable(mechanism.names, arrays, tuple(numbers_of(scene)), mechanism.signals)
    along = [table.along(force) for force in forces]  # first: laws of springs name what they act along
    compiled = compile_tape(roots, table.resolve, table.signals.pieces)
    parameters = parameter_values(numbers_of(scene))
    quantities, count = table.made(), len(table.rows)
    links, velocities = len(layout.links), arrays.velocities
    parts = tape_parts(compiled.tape, prepared(compiled, parameters, roots), parameters) | {
        packed.KIND: quantities.kind, packed.TREE_SHAPE: arrays.tree.shape, packed.LINK: arrays.tree.link,
        packed.JOINT_SHAPE: np.array([layout.plane, layout.base_size]), packed.JOINT: _joints(arrays),
        packed.FORM: np.array(
            [form_of_row(row.position, row.angle, k in of_forces) for k, row in enumerate(compiled.rows[:rows])], np.int64
        ),
        packed.LEVELS: table.levels(), packed.ALONG: np.array(along, np.int64),
        packed.OFFSET: quantities.offset, packed.SHARE: quantities.share, packed.BASE: arrays.tree.base,
        packed.REAL: arrays.tree.real, packed.GIVEN: arrays.given,
        packed.SCALE: np.ones(len(forces)) if scales is None else np.array(scales, float),
        packed.MEASURED: np.zeros(3 * count), packed.REFERENCE: np.zeros(2 * count),
        packed.STATE: np.zeros(arrays.positions + velocities), packed.BEND: np.zeros(velocities),
        packed.SPIN: np.zeros(6 * links), packed.MOMENT: np.zeros(3 * links), packed.ROW: np.zeros(velocities),
        packed.CARRIED: np.zeros(layout.nv), packed.RESIDUAL: np.zeros(3 * len(roots)),
    }  # fmt: skip
    return Readings(layout, arrays, table, compiled, parameters, tuple(forces), pack(parts))


def form_of_row(position: bool, angle: bool, of_forces: bool = False) -> int:
    """Return the form of a row as the core has it."""
    return rows.OF_FORCES if of_forces else rows.OF_ANGLES if angle else rows.OF_POSITIONS if position else rows.OF_VELOCITIES


def _joints(arrays: Arrays) -> Integers:
    """Where hinges and lengths stand in Pinocchio's q and v, by the core's rows."""
    found = np.full((len(arrays.order), 6), -1, np.int64)
    for row, i in enumerate(arrays.order):
        link = arrays.layout.links[i]
        found[row] = link.q, link.v, link.lower.q, link.lower.v, link.upper.q, link.upper.v
    return found

