"""Rows that name forces of contacts: which foot carries what.

Forces follow from controls, lambda = lambda_0 - L u, so that a row which is linear in them is one of controls. Such rows serve as
secondary ones: c_0 + sum c_k lambda_k = 0 with c of the motion.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from vlmb.errors import SceneError
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import AXES
from vlmb.model.quantities import allowed_names
from vlmb.scene.by_phase import keyed, names_forces, numbers_of, programme_at
from vlmb.scene.expressions import Equation, Expression, Tree, failure, fold, parse_equation, walk
from vlmb.scene.rows import read_row
from vlmb.scene.tables import Programme
from vlmb.system.contacts import PhaseContacts
from vlmb.system.surface import PLAIN

ZERO: Tree = ("number", 0.0)
ONE: Tree = ("number", 1.0)


class NamedForce(NamedTuple):
    """A force of a contact in a row."""

    contact: str
    axis: int  # x, y, z
    factor: Expression  # it is multiplied by this


class ForceRow(NamedTuple):
    """A row that names forces."""

    rest: Equation  # without them, = 0
    forces: tuple[NamedForce, ...]


def force_rows(mechanism: Mechanism) -> dict[str, ForceRow]:
    """Return the rows of the programme that name forces, by their keys. Raises SceneError, ExpressionError."""
    found = {}
    for key, part in keyed(programme_at(mechanism.scene)):
        for k, text in enumerate(part.secondary):
            if names_forces(text):
                found[f"{key}.secondary[{k}]"] = _read(mechanism, part, text, f"{key}.secondary[{k}]")
    return found


def places_of(contacts: PhaseContacts | None) -> dict[tuple[str, int], int]:
    """Return the ideal rows that hold contacts, by name and axis; what slides or rests on others has none but its normal."""
    found = dict[tuple[str, int], int]()
    for point, _, at, count in () if contacts is None else contacts.closed:
        normal = point.plain
        if normal is not None and count:
            across = [axis for axis in range(3) if axis != normal and point.names[axis]]
            found |= {(point.name, axis): at + k for k, axis in enumerate([normal, *across][:count])}
    return found


def _read(mechanism: Mechanism, programme: Programme, text: str, key: str) -> ForceRow:
    row, scene = read_row(text, key), mechanism.scene
    axes = [axis for axis in AXES if not (scene.plane and axis == "y")]
    forces = {
        f"{contact.name}.force.{axis}": (contact.name, AXES.index(axis))
        for contact in scene.contacts if contact.surface.strip() in PLAIN for axis in axes
    }  # fmt: skip
    allowed = {*forces, *allowed_names(mechanism.names, numbers_of(scene), mechanism.signals)}
    equation = parse_equation(row.equation, key, allowed)
    for name in sorted(equation.names & forces.keys()):
        if programme.closed.count(forces[name][0]) == 0:
            raise SceneError(
                f"{key} = {text!r:.120}: names {name!r}, and its programme may act while {forces[name][0]!r} is open; add it to "
                "`closed`"
            )
    rest, factors = _split(fold("-", [equation.left.tree, equation.right.tree]), forces.keys(), equation.text, key)
    named = tuple(NamedForce(*forces[name], _expression(tree, equation.text, key)) for name, tree in factors.items())
    left = _expression(rest, equation.text, key)
    return ForceRow(Equation(equation.text, left, _expression(ZERO, "0", key), left.names), named)


def _expression(tree: Tree, text: str, key: str) -> Expression:
    names: set[str] = walk(tree, lambda name: {name}, lambda _: set(), lambda _, parts: set().union(*parts))
    return Expression(text, frozenset(names), key, tree)


def _split(tree: Tree, forces: Collection[str], text: str, key: str) -> tuple[Tree, dict[str, Tree]]:
    """Split a tree that is linear in forces into what stands beside them and the factor of each. Raises ExpressionError."""
    op, *rest = tree
    if op == "name":
        return (ZERO, {rest[0]: ONE}) if rest[0] in forces else (tree, {})
    if op == "number":
        return tree, {}
    parts = [_split(part, forces, text, key) for part in rest]
    carrying = [k for k, (_, factors) in enumerate(parts) if factors]
    if not carrying:
        return tree, {}
    if op == "neg":
        return _of(op, parts, [0])
    if op == "+":
        return _of(op, parts, range(len(parts)))
    if op == "where" and carrying[0] > 0:
        names = dict.fromkeys(name for _, factors in parts for name in factors)
        chosen = {name: fold(op, [rest[0], *(factors.get(name, ZERO) for _, factors in parts[1:])]) for name in names}
        return fold(op, [rest[0], *(beside for beside, _ in parts[1:])]), chosen
    if (op == "*" and len(carrying) == 1) or (op == "/" and carrying == [0]):
        beside, factors = parts[carrying[0]]

        def times(inner: Tree) -> Tree:
            return fold(op, [inner if k == carrying[0] else part for k, part in enumerate(rest)])

        return (ZERO if beside == ZERO else times(beside)), {name: times(factor) for name, factor in factors.items()}
    raise failure(key, text, "is not linear in forces of contacts", "they may be added, and multiplied by what the motion gives")


def _of(op: str, parts: Sequence[tuple[Tree, Mapping[str, Tree]]], which: Collection[int]) -> tuple[Tree, dict[str, Tree]]:
    """Apply a sum, or a sign, to both halves."""
    names = dict.fromkeys(name for k in which for name in parts[k][1])
    factors = {name: fold(op, [parts[k][1][name] for k in which if name in parts[k][1]]) for name in names}
    return fold(op, [parts[k][0] for k in which]), factors
