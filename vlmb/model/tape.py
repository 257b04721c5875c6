"""Expressions and equations of one scene -> one tape for the core, and what follows from a row's form alone."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vlmb.core import opcodes as core
from vlmb.core.opcodes import PARAMETER, RATE, SIGNAL, TIME, VALUE, Array, Tape
from vlmb.core.series import WIDTH
from vlmb.errors import ExpressionError
from vlmb.model.forms import Form, RowFacts, form_of, show
from vlmb.model.names import DOT
from vlmb.model.signals import Signals
from vlmb.scene.expressions import Equation, Expression, Tree, apply, failure

MAX_ROWS, MAX_OPERATIONS = 2000, 50_000

_FUNCTIONS = {
    "sin": core.SIN, "cos": core.COS, "tan": core.TAN, "asin": core.ASIN, "acos": core.ACOS, "atan": core.ATAN, "exp": core.EXP,
    "log": core.LOG, "sqrt": core.SQRT, "abs": core.ABS, "sign": core.SIGN, "step": core.STEP,
}  # fmt: skip
_PAIRS = {"atan2": core.ATAN2, "min": core.MIN, "max": core.MAX}
_COMMUTING = {core.ADD, core.MULTIPLY}


class Leaf(NamedTuple):
    """What a name stands for: TIME, PARAMETER `at`, VALUE or RATE of quantity `at`, SIGNAL `at`; `angle`: of an angle."""

    kind: int
    at: int = 0
    angle: bool = False


def leaf_of(name: str, parameters: Mapping[str, int], signals: Signals, lengths: Mapping[str, int]) -> Leaf | None:
    """Return what a name that is no quantity stands for: the time, a parameter, measured data, the length of a spring."""
    plain = name.removesuffix(DOT)
    if name == "t":
        return Leaf(TIME)
    if name in parameters:
        return Leaf(PARAMETER, parameters[name])
    if name in signals:
        return Leaf(SIGNAL, signals[name])
    return Leaf(RATE if name.endswith(DOT) else VALUE, lengths[plain]) if plain in lengths else None


@dataclass(frozen=True)
class CompiledTape:
    """A tape, the names of its leaves, its rows, and the text of each operation for messages."""

    tape: Tape
    names: tuple[str, ...]
    rows: tuple[RowFacts, ...]
    sources: tuple[Tree, ...] = field(repr=False)

    def source(self, operation: int) -> str:
        """Return the text of an operation, or of a leaf (-1 - leaf), as `failing_operation` tells it."""
        return show(self.sources[operation]) if operation >= 0 else self.names[-1 - operation]


def compile_tape(
    roots: Sequence[Expression | Equation], resolve: Callable[[str], Leaf | Tree], pieces: Sequence[Array] = (),
    seen: int | None = None,
) -> CompiledTape:  # fmt: skip
    """Compile expressions (a root each) and equations (left - right) into one tape with common subexpressions shared.

    `resolve` tells what a name stands for: a leaf, or an expression in its place; `pieces` (rows, 7) are given functions of
    time: SIGNAL 3 k + n is derivative n of the one at k. Roots from `seen` on are played with the switches alone: no evaluation
    needs them. Raises ExpressionError: too many rows or operations, or a constant part that has no value.
    """
    if len(roots) > MAX_ROWS:
        raise ExpressionError(f"{len(roots)} equations and laws: at most {MAX_ROWS}; write fewer")
    return _compiled(roots, resolve, pieces, len(roots) if seen is None else seen) if roots else _empty()


@functools.cache
def _empty() -> CompiledTape:
    """Compile the tape of scenes without laws and equations, once."""
    return _compiled((), lambda name: Leaf(VALUE), (), 0)


def _compiled(
    roots: Sequence[Expression | Equation], resolve: Callable[[str], Leaf | Tree], pieces: Sequence[Array], seen: int
) -> CompiledTape:
    builder = _Builder(resolve)
    slots = [builder.root(root) for root in roots[:seen]]
    needed, read = len(builder.code), len(builder.leaves)
    slots += [builder.root(root) for root in roots[seen:]]
    switches = builder.switches()
    rows = [builder.facts(root, slot) for root, slot in zip(roots, slots, strict=True)]
    return _arranged(builder, slots, needed, read, switches, rows, pieces)


class _Builder:
    """Slots in the order of making: leaves and operations mixed; `_arranged` puts them in the tape's order."""

    def __init__(self, resolve: Callable[[str], Leaf | Tree]) -> None:
        self.resolve = resolve
        self.leaf: dict[str, int] = {}
        self.leaves: list[tuple[Leaf, int]] = []
        self.code: list[tuple[int, tuple[int, ...], float, int, Tree]] = []  # operation, operands, constant, slot, source
        self.form: list[Form] = []
        self.known: dict[tuple[int, tuple[int, ...], float], int] = {}
        self.sharing: dict[Tree, int | float] = {}

    def root(self, root: Expression | Equation) -> int:
        """Compile one root; a number becomes a slot as well."""
        key, text = (root.left.key, root.text) if isinstance(root, Equation) else (root.key, root.text)
        try:
            if isinstance(root, Expression):
                return self.slot(self.build(root.tree), root.tree)
            tree: Tree = ("+", root.left.tree, ("neg", root.right.tree))
            return self.slot(self.build(tree), tree)
        except ArithmeticError as error:
            raise failure(key, text, str(error), "change its constants") from None
        except OverflowError:  # pragma: no cover
            raise failure(key, text, "a constant in it is too large", "change its constants") from None

    def name(self, name: str) -> int | float:
        if name not in self.leaf:
            leaf, slot = self.resolve(name), len(self.form)
            if not isinstance(leaf, Leaf):
                return self.build(leaf)
            self.leaf[name] = slot
            self.leaves.append((leaf, slot))
            mine = frozenset({slot})
            if leaf.kind == PARAMETER:
                self.form.append(Form(core.OF_PARAMETERS, mine, angles={}))
            elif leaf.kind in (TIME, SIGNAL):
                self.form.append(Form(core.OF_TIME, mine, angles={}))
            elif leaf.kind == RATE:
                self.form.append(Form(core.OF_STATE, mine, mine, degree=1.0))
            else:
                self.form.append(Form(core.OF_STATE, mine, angles={slot: 1.0} if leaf.angle else None))
        return self.leaf[name]

    def slot(self, part: int | float, source: Tree) -> int:
        """Return the slot of a part; a number gets one."""
        return part if isinstance(part, int) else self.emit(core.CONSTANT, (), part, source)

    def emit(self, code: int, operands: tuple[int, ...], constant: float, source: Tree) -> int:
        """Return the slot of an operation, a new one only if it is not known."""
        if code in _COMMUTING:
            operands = tuple(sorted(operands))
        key = code, operands, constant
        if key not in self.known:
            if len(self.code) >= MAX_OPERATIONS:
                raise ExpressionError(f"the equations and laws have more than {MAX_OPERATIONS} operations; simplify them")
            self.known[key] = len(self.form)
            self.code.append((code, operands, constant, len(self.form), source))
            self.form.append(form_of(code, [self.form[k] for k in operands], constant))
        return self.known[key]

    def build(self, tree: Tree) -> int | float:
        """Compile a tree to a slot (int) or, where it is constant, a number (float)."""
        op, *rest = tree
        if op == "number":
            return float(rest[0])
        if op == "name":
            return self.name(rest[0])
        if tree not in self.sharing:
            self.sharing[tree] = self.operation(tree, op, rest)
        return self.sharing[tree]

    def operation(self, tree: Tree, op: str, rest: Sequence[Tree]) -> int | float:
        if op == "where":
            return self.choice(tree, rest)
        if op == "+":
            return self.sum(tree, rest)
        parts = [self.build(part) for part in rest]
        if all(isinstance(part, float) for part in parts):
            return float(apply(op, [float(part) for part in parts]))
        if op == "*":
            return self.product(tree, parts)
        if op == "neg":
            return self.scaled(self.slot(parts[0], tree), -1.0, tree)
        if op == "/":
            return self.quotient(tree, parts[0], parts[1])
        if op == "**":
            return self.power(tree, self.slot(parts[0], tree), float(parts[1]))
        if op in _PAIRS:
            first, second = (self.slot(part, ("number", part)) for part in parts)
            return self.emit(_PAIRS[op], (first, second), 0.0, tree)
        return self.emit(_FUNCTIONS[op], (self.slot(parts[0], tree),), 0.0, tree)

    def choice(self, tree: Tree, rest: Sequence[Tree]) -> int | float:
        condition = self.build(rest[0])
        if isinstance(condition, float):
            return self.build(rest[1] if condition < 0.0 else rest[2])
        first, second = (self.slot(self.build(part), part) for part in rest[1:])
        return self.emit(core.SELECT, (first, second, condition), 0.0, tree)

    def sum(self, tree: Tree, terms: Sequence[Tree]) -> int | float:
        """Constants last; what depends on parameters or time alone first, so that it is not played at every state."""
        constant, signed = 0.0, list[tuple[int, bool, int]]()
        for term in terms:
            minus = term[0] == "neg"
            part = self.build(term[1] if minus else term)
            if isinstance(part, float):
                constant += -part if minus else part
            elif (opposite := (self.form[part].of, not minus, part)) in signed:
                signed.remove(opposite)
            else:
                signed.append((self.form[part].of, minus, part))
        if not signed:
            return constant
        signed.sort(key=lambda entry: entry[0])
        first = next((k for k, (of, minus, _) in enumerate(signed) if not minus and of == signed[0][0]), 0)
        _, minus, total = signed.pop(first)
        if minus:
            total = self.scaled(total, -1.0, tree)
        for _, minus, part in signed:
            total = self.emit(core.SUBTRACT if minus else core.ADD, (total, part), 0.0, tree)
        return self.emit(core.SHIFT, (total,), constant, tree) if constant != 0.0 else total

    def product(self, tree: Tree, parts: Sequence[int | float]) -> int | float:
        constant = 1.0
        for part in parts:
            constant *= part if isinstance(part, float) else 1.0
        if not abs(constant) < np.inf:
            raise ArithmeticError(f"a constant in it is {constant}")
        if constant == 0.0:  # nothing is named by what is multiplied with 0
            return 0.0
        slots = sorted((part for part in parts if isinstance(part, int)), key=lambda part: self.form[part].of)
        total = slots[0]
        for part in slots[1:]:
            square = part == total
            total = self.emit(core.SQUARE, (part,), 0.0, tree) if square else self.emit(core.MULTIPLY, (total, part), 0.0, tree)
        return self.scaled(total, constant, tree)

    def scaled(self, slot: int, factor: float, tree: Tree) -> int:
        return slot if factor == 1.0 else self.emit(core.SCALE, (slot,), factor, tree)

    def quotient(self, tree: Tree, above: int | float, below: int | float) -> int:
        if isinstance(below, float):
            if below == 0.0:
                raise ArithmeticError("division by 0")
            return self.emit(core.PART, (self.slot(above, tree),), below, tree)
        if isinstance(above, float):
            return self.emit(core.OVER, (below,), above, tree)
        return self.emit(core.DIVIDE, (above, below), 0.0, tree)

    def power(self, tree: Tree, base: int, exponent: float) -> int | float:
        if exponent == 0.0:
            return 1.0
        if exponent == 1.0:
            return base
        if exponent == -1.0:
            return self.emit(core.OVER, (base,), 1.0, tree)
        code = {2.0: core.SQUARE, 0.5: core.SQRT}.get(exponent)
        if code is not None:
            return self.emit(code, (base,), 0.0, tree)
        return self.emit(core.WHOLE_POWER if exponent.is_integer() else core.POWER, (base,), exponent, tree)

    def switches(self) -> list[tuple[int, int, int]]:
        """List (slot, operation, kind) of every argument whose sign decides; makes the slots of those that have none yet."""
        found: dict[tuple[int, int], int] = {}
        for k, (code, operands, constant, _, source) in enumerate(tuple(self.code)):
            for slot, kind in self.arguments(code, operands, constant, source):
                if self.form[slot].of > core.OF_PARAMETERS:
                    found.setdefault((slot, kind), k)
        return [(slot, k, kind) for (slot, kind), k in found.items()]

    def arguments(self, code: int, operands: tuple[int, ...], constant: float, source: Tree) -> list[tuple[int, int]]:
        """List the slots whose change of sign is a kink, a jump, or the end of a domain of one operation."""
        if code in (core.MIN, core.MAX):
            return [(self.emit(core.SUBTRACT, operands, 0.0, source), core.KINK)]
        if code == core.TAN:
            return [(self.emit(core.COS, operands, 0.0, source), core.EDGE)]
        if code in (core.ASIN, core.ACOS):
            square = self.emit(core.SQUARE, operands, 0.0, source)
            return [(self.emit(core.SHIFT, (self.scaled(square, -1.0, source),), 1.0, source), core.EDGE)]
        if code == core.SELECT:
            return [(operands[2], core.JUMP)]
        if code == core.ABS:
            return [(operands[0], core.KINK)]
        if code in (core.SIGN, core.STEP):
            return [(operands[0], core.JUMP)]
        if code == core.ATAN2:
            return [(operands[0], core.CUT)]
        if code == core.DIVIDE:
            return [(operands[1], core.EDGE)]
        ends = code in (core.OVER, core.LOG, core.SQRT, core.POWER) or (code == core.WHOLE_POWER and constant < 0.0)
        return [(operands[0], core.EDGE)] if ends else []

    def facts(self, root: Expression | Equation, slot: int) -> RowFacts:
        form, at = self.form[slot], {slot: k for k, (_, slot) in enumerate(self.leaves)}
        kinds = {self.leaves[at[leaf]][0].kind for leaf in form.leaves}
        return RowFacts(
            text=root.text, names=root.names, leaves=tuple(sorted(at[leaf] for leaf in form.leaves)),
            moves=bool(kinds & {VALUE, RATE}), position=RATE not in kinds, timed=bool(kinds & {TIME, SIGNAL}),
            linear=frozenset(at[leaf] for leaf in form.rates - form.bent),
            homogeneous=bool(form.rates) and not form.bent and form.degree == 1.0,
            angles={at[leaf]: factor for leaf, factor in (form.angles or {}).items()},
        )  # fmt: skip


def _arranged(
    builder: _Builder, roots: Sequence[int], needed: int, read: int, switches: Sequence[tuple[int, int, int]],
    rows: Sequence[RowFacts], pieces: Sequence[Array],
) -> CompiledTape:  # fmt: skip
    """Put leaves first, then operations of parameters, time and state, then those of switches and of what is only seen."""
    form, leaves = builder.form, len(builder.leaves)
    groups = [[k for k in range(needed) if form[builder.code[k][3]].of == of] for of in range(3)]
    order = [*groups[0], *groups[1], *groups[2], *range(needed, len(builder.code))]
    slot = {old: new for new, (_, old) in enumerate(builder.leaves)}
    slot |= {builder.code[k][3]: leaves + place for place, k in enumerate(order)}
    place = {k: at for at, k in enumerate(order)}
    code = np.zeros((len(order), 4), np.int64)
    for at, k in enumerate(order):
        operation, operands = builder.code[k][:2]
        code[at, 0] = operation
        code[at, 1 : 1 + len(operands)] = [slot[operand] for operand in operands]
    ends = np.cumsum([len(group) for group in groups])
    entering, entering_ends = _entering(builder, rows)
    sweep, sweep_ends = _sweeps(code, leaves, [slot[root] for root in roots], int(ends[1]))
    timed = sum(leaf.kind in (TIME, SIGNAL) for leaf, _ in builder.leaves)
    kinds, signal, series = _signals(builder, pieces)
    named = [leaf.at for leaf, _ in builder.leaves if leaf.kind in (VALUE, RATE)]
    first = sorted({leaf.at for leaf, _ in builder.leaves[:read] if leaf.kind in (VALUE, RATE)})
    tape = Tape(
        code=code, constant=np.array([builder.code[k][2] for k in order], float),
        leaf=np.array(kinds, np.int64).reshape(leaves, 2),
        root=np.array([slot[root] for root in roots], np.int64),
        parts=np.array([leaves, *ends, len(order), timed, len(first)], np.int64), sweep=sweep, sweep_ends=sweep_ends,
        used=np.array([*first, *sorted({*named} - {*first})], np.int64),
        entering=entering, entering_ends=entering_ends,
        switch=np.array([(slot[at], place[k], kind, form[at].of) for at, k, kind in switches], np.int64).reshape(-1, 4),
        signal=signal, series=series,
    )  # fmt: skip
    names = sorted(builder.leaf, key=lambda name: builder.leaf[name])
    return CompiledTape(tape, tuple(names), tuple(rows), tuple(builder.code[k][4] for k in order))


def _signals(
    builder: _Builder, pieces: Sequence[Array]
) -> tuple[list[tuple[int, int]], np.ndarray, np.ndarray]:
    """Return the leaves, kind and which one, with given functions numbered as they are used; where those stand; their pieces."""
    used: dict[int, int] = {}  # of `pieces`, and where they begin
    parts: list[Array] = []
    signals: list[tuple[int, int, int]] = []
    read = []
    for leaf, _ in builder.leaves:
        at = leaf.at
        if leaf.kind == SIGNAL:
            which, order = divmod(leaf.at, 3)
            if which not in used:
                used[which] = sum(map(len, parts))
                parts.append(pieces[which])
            at = len(signals)
            signals.append((used[which], used[which] + len(pieces[which]) - 1, order))
        read.append((leaf.kind, at))
    series = np.ascontiguousarray(np.concatenate(parts)) if parts else np.zeros((0, WIDTH))
    return read, np.array(signals, np.int64).reshape(-1, 3), series


def _sweeps(code: np.ndarray, leaves: int, roots: Sequence[int], state: int) -> tuple[np.ndarray, np.ndarray]:
    """List the operations of each root, last first; those from `state` on, of the state, come first by themselves."""
    sweep: list[int] = []
    ends = np.zeros((len(roots), 3), np.int64)
    for r, root in enumerate(roots):
        seen, waiting = set[int](), [root - leaves]
        while waiting:
            k = waiting.pop()
            if k >= 0 and k not in seen:
                seen.add(k)
                operands = () if code[k, 0] == core.CONSTANT else code[k, 1:4] if code[k, 0] == core.SELECT else code[k, 1:3]
                waiting += [int(operand) - leaves for operand in (operands[:1] if code[k, 0] >= core.UNARY else operands)]
        ordered = sorted(seen, reverse=True)
        ends[r] = len(sweep), len(sweep) + sum(k >= state for k in ordered), len(sweep) + len(ordered)
        sweep += ordered
    return np.array(sweep, np.int64), ends


def _entering(builder: _Builder, rows: Sequence[RowFacts]) -> tuple[np.ndarray, np.ndarray]:
    """List the leaves that the rows over the velocities are made of."""
    kinds = [leaf.kind for leaf, _ in builder.leaves]
    chosen = [[k for k in row.leaves if kinds[k] == (VALUE if row.position else RATE)] for row in rows]
    ends = np.cumsum([0, *map(len, chosen)])
    return np.array([k for row in chosen for k in row], np.int64), np.column_stack([ends[:-1], ends[1:]]).astype(np.int64)
