"""Laws of time: their value, their derivatives, and where they are not smooth."""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from vlmb.scene.expressions import FAILURES, OPERATIONS, Expression, Tree, failure, fold, parse, walk
from vlmb.scene.symbolic import compile_scalar, to_sympy


@dataclass(frozen=True, eq=False)
class Law:
    """A law of time: `value(t)`, and `jet(t)` = value, first and second derivative; nan where undefined.

    `expression` has the parameters put in. Derivatives leave out the impulses at kinks of abs, min and max.
    """

    text: str
    value: Callable[[float], float]
    jet: Callable[[float], tuple[float, ...]]
    expression: Expression


def time_law(text: str | float, parameters: Mapping[str, float], key: str) -> Law:
    """Read a law of time in `t` and the parameters; sympy is imported by the first `jet` of a law that moves.

    Raises ExpressionError.
    """
    given = parse(text, key, {"t", *parameters})
    known = {name: parse(parameters[name], f"parameters.{name}", ()).tree for name in given.names - {"t"}}
    try:
        tree = walk(given.tree, lambda name: known.get(name, ("name", name)), lambda value: ("number", value), fold)
    except ArithmeticError as error:
        raise failure(key, given.text, str(error), "change the text or the parameters") from None
    expression = Expression(given.text, given.names & {"t"}, key, tree)
    if tree[0] == "number":
        return Law(given.text, lambda t: tree[1], lambda t: (tree[1], 0.0, 0.0), expression)

    @functools.cache
    def derivatives() -> Callable[..., tuple[float, ...]]:
        import sympy

        t = sympy.Symbol("t", real=True)
        law = to_sympy(expression, {"t": t})
        return compile_scalar([law, law.diff(t), law.diff(t, 2)], [t])

    return Law(given.text, _of_time(tree), lambda t: derivatives()(t), expression)


def law_breaks(law: Law, start: float, end: float) -> tuple[float, ...]:
    """Return the times in (start, end) where abs, min, max or atan2 switch, or a denominator, sqrt, log passes 0.

    Found as sign changes between samples (1 ms apart; 10^4 to 10^5 of them), then bisected to the last digit. Not found:
    two switches between neighbouring samples, poles of tan, asin and acos at +-1, arguments that touch 0 and return.
    """
    count = int(min(max(1e4, 1e3 * (end - start)), 1e5))
    found: list[float] = []
    for switch in set(_switches(law.expression.tree)) if start < end else ():
        function = _of_time(switch)
        before, last, zeros = math.nan, start, []
        for index in range(count + 1):
            time = start + (end - start) * index / count
            value = function(time)
            if value == 0.0:
                zeros.append(time)
                continue
            if before < 0.0 < value or value < 0.0 < before:
                found.append(zeros[len(zeros) // 2] if zeros else _bisect(function, last, time))
            before, last, zeros = value, time, []
    found.sort()
    near = 1e-12 * max(abs(start), abs(end))  # two switches may see one kink with different last digits
    return tuple(time for before, time in zip([-math.inf, *found], found, strict=False) if time - before > near)


def law_jump(law: Law, t: float) -> tuple[float, float]:
    """Return the jumps of a law's value and first derivative across t; nan where a side is undefined.

    Each side is continued to t by its jet from 1e-7 max(1, |t|) away; another break nearer than that spoils it.
    """
    step = 1e-7 * max(1.0, abs(t))
    (low, low1, low2), (high, high1, high2) = law.jet(t - step), law.jet(t + step)
    value = high - low - step * (high1 + low1 - 0.5 * step * (high2 - low2))
    return value, high1 - low1 - step * (high2 + low2)


def _of_time(tree: Tree) -> Callable[[float], float]:
    """Make a function of t, nan outside the tree's domain."""

    def operation(op: str, parts: list[Callable[[float], float]]) -> Callable[[float], float]:
        pairs: dict[str, Callable[..., float]] = {"+": operator.add, "*": operator.mul} if len(parts) == 2 else {}
        function, first, second = pairs.get(op, OPERATIONS[op]), parts[0], parts[-1]
        if len(parts) > 2:
            return lambda t: function(*[part(t) for part in parts])
        return (lambda t: function(first(t))) if len(parts) == 1 else (lambda t: function(first(t), second(t)))

    inner: Callable[[float], float] = walk(tree, lambda _: lambda t: t, lambda value: lambda t: value, operation)

    def value(t: float) -> float:
        try:
            return inner(t)
        except FAILURES:
            return math.nan

    return value


def _switches(tree: Tree) -> Iterator[Tree]:
    """Yield the subtrees whose change of sign is a kink, a jump or a pole."""
    op, *rest = tree
    if op in ("abs", "sqrt", "log", "atan2", "/"):
        yield rest[op == "/"]
    if op in ("min", "max"):
        yield ("+", rest[0], ("neg", rest[1]))
    for part in rest if op not in ("name", "number") else ():
        yield from _switches(part)


def _bisect(function: Callable[[float], float], low: float, high: float) -> float:
    rising = function(high) > 0.0
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (low, middle) if (function(middle) >= 0.0) == rising else (middle, high)
    return high
