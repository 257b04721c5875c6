"""What follows from the form of an expression alone: what it depends on, how rates and angles enter it; and its text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vlmb.core import opcodes as core
from vlmb.scene.expressions import Tree


@dataclass(frozen=True)
class RowFacts:
    """What is known of a root before any motion; for an equation the root is left - right."""

    text: str
    names: frozenset[str]
    leaves: tuple[int, ...]  # those it uses, by index
    moves: bool  # it names a value or a rate of the mechanism
    position: bool  # it names no rate
    timed: bool  # it names the time or a signal
    linear: frozenset[int]  # leaves of rates that it is linear in
    homogeneous: bool  # of degree one in the rates
    angles: Mapping[int, float]  # it is a sum of these leaves times these numbers, and of what the state does not change; or none

    @property
    def angle(self) -> bool:
        """Whether its value is a difference of angles, to be wrapped."""
        return self.position and bool(self.angles) and all(abs(factor) == 1.0 for factor in self.angles.values())

    @property
    def working(self) -> bool:
        """Whether as an ideal constraint it does work: it moves with time, or asks for a rate."""
        return self.timed if self.position else not self.homogeneous


@dataclass(frozen=True)
class Form:
    """What is known of a slot: `of` (parameters, time, state), its leaves, how rates and angles enter."""

    of: int
    leaves: frozenset[int] = frozenset()
    rates: frozenset[int] = frozenset()
    bent: frozenset[int] = frozenset()  # rates that enter other than linearly
    degree: float | None = 0.0  # of homogeneity in the rates; None: not homogeneous
    angles: Mapping[int, float] | None = None  # None: not such a sum


def form_of(code: int, parts: Sequence[Form], constant: float) -> Form:
    """What is known of an operation from what is known of its operands."""
    of = max((part.of for part in parts), default=core.OF_PARAMETERS)
    leaves = frozenset[int]().union(*(part.leaves for part in parts))
    rates = frozenset[int]().union(*(part.rates for part in parts))
    return Form(of, leaves, rates, _bent(code, parts, rates), _degree(code, parts, constant), _angles(code, parts, constant))


def _bent(code: int, parts: Sequence[Form], rates: frozenset[int]) -> frozenset[int]:
    """Rates that enter an operation other than linearly."""
    known = frozenset[int]().union(*(part.bent for part in parts))
    if code in (core.ADD, core.SUBTRACT, core.SHIFT, core.SCALE, core.PART):
        return known
    if code == core.MULTIPLY and not (parts[0].rates and parts[1].rates):
        return known
    if code == core.DIVIDE and not parts[1].rates:
        return known
    if code == core.SELECT and not parts[2].rates:
        return known
    return rates


def _degree(code: int, parts: Sequence[Form], constant: float) -> float | None:
    """Degree in the rates that an operation is homogeneous of."""
    degrees = [part.degree for part in parts]
    if not any(part.rates for part in parts):
        return 0.0
    known = [degree for degree in degrees if degree is not None]
    if len(known) < len(degrees):
        return None
    if code in (core.ADD, core.SUBTRACT):
        return known[0] if known[0] == known[1] else None
    if code == core.MULTIPLY:
        return known[0] + known[1]
    if code == core.DIVIDE:
        return known[0] - known[1]
    if code in (core.SCALE, core.PART):
        return known[0]
    if code == core.SELECT and not parts[2].rates and known[0] == known[1]:
        return known[0]
    exponent = {core.SQUARE: 2.0, core.OVER: -1.0, core.WHOLE_POWER: constant}.get(code)
    return None if exponent is None else exponent * known[0]


def _angles(code: int, parts: Sequence[Form], constant: float) -> Mapping[int, float] | None:
    """An operation as a sum of angles times numbers; empty where the state does not change it, None where it is no such sum."""
    sums = [part.angles for part in parts]
    if all(entry is not None and not entry for entry in sums):
        return {}
    if code not in (core.ADD, core.SUBTRACT, core.SHIFT, core.SCALE, core.PART) or any(entry is None for entry in sums):
        return None
    known = [entry or {} for entry in sums]
    if code in (core.ADD, core.SUBTRACT):
        sign = 1.0 if code == core.ADD else -1.0
        total = dict(known[0])
        for leaf, factor in known[1].items():
            total[leaf] = total.get(leaf, 0.0) + sign * factor
        return {leaf: factor for leaf, factor in total.items() if factor != 0.0}
    scale = {core.SHIFT: 1.0, core.SCALE: constant}.get(code, 1.0 / constant if constant else 0.0)
    return {leaf: scale * factor for leaf, factor in known[0].items() if scale}


def show(tree: Tree) -> str:
    """Return the text of a tree."""
    op, *rest = tree
    if op in ("name", "number"):
        return rest[0] if op == "name" else f"{rest[0]:g}"
    parts = [show(part) for part in rest]
    if op == "where":
        return f"where({parts[0]} < 0, {parts[1]}, {parts[2]})"
    if op == "neg":
        return f"-{parts[0]}" if rest[0][0] != "+" else f"-({parts[0]})"
    if op == "+":
        return parts[0] + "".join(f" - {part[1:]}" if part.startswith("-") else f" + {part}" for part in parts[1:])
    if op in ("*", "/", "**"):
        loose = ("+", "neg") if op == "*" else ("+", "neg", "*", "/", "**")
        return op.join(f"({part})" if term[0] in loose else part for part, term in zip(parts, rest, strict=True))
    return f"{op}({', '.join(parts)})"
