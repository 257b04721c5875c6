"""Expressions -> sympy, and sympy -> scalar functions of Python floats: exact derivatives, compiled once a scene."""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from graphlib import TopologicalSorter
from typing import TYPE_CHECKING, Any

from vlmb.errors import VlmbError
from vlmb.scene.expressions import FAILURES, MAX_FACTORS, MAX_NUMBER, Expression, failure, require, walk

if TYPE_CHECKING:
    import sympy


def to_sympy(expression: Expression, symbols: Mapping[str, sympy.Expr]) -> sympy.Expr:
    """Build the sympy expression node by node; symbols should be real. abs, min and max have no impulses at kinks.

    sympy may cancel: x/x is 1. Raises ExpressionError: a symbol is missing, or what cancelling leaves is not real.
    """
    import sympy

    functions: dict[str, Callable[..., Any]] = {
        "+": sympy.Add, "*": sympy.Mul, "/": operator.truediv, "neg": operator.neg, "**": operator.pow, **_kinks(),
    }  # fmt: skip

    def operation(op: str, parts: list[Any]) -> Any:
        result = (functions.get(op) or getattr(sympy, op))(*parts)
        # Cancelling makes constants the parser never saw, as in ((x + x)**64/x**64)**64: bounded here, node by node.
        numbers = result.atoms(sympy.Number, type(sympy.zoo), type(sympy.I))
        if any(number.is_real is not True or abs(number) > MAX_NUMBER for number in numbers):
            raise failure(expression.key, expression.text, f"{op!r} in it leaves the range of real numbers")
        if result.is_Mul and len(result.args) > MAX_FACTORS:  # second derivatives would take minutes
            raise failure(expression.key, expression.text, f"more than {MAX_FACTORS} factors", "simplify the product")
        exact = {n: sympy.Float(n) for n in numbers if n.is_Rational and max(abs(n.p), n.q) > 10**5}
        return result.xreplace(exact) if exact else result

    def number(value: float) -> Any:
        half = value % 0.5 == 0.0 and abs(value) < 1e5  # so that x**0.5 is a square root
        return sympy.Rational(int(2 * value), 2) if half else sympy.Float(value)

    require(expression, symbols, "symbol")
    return walk(expression.tree, symbols.__getitem__, number, operation)


def compile_scalar(
    outputs: Sequence[sympy.Expr], arguments: Sequence[sympy.Symbol], steps: Mapping[sympy.Symbol, sympy.Expr] | None = None
) -> Callable[..., tuple[float, ...]]:
    """Compile expressions to one scalar function of Python floats; common subexpressions are shared.

    `steps` are intermediate results that outputs and other steps use, in any order; those nobody uses are left out.
    All outputs are nan where one is outside its domain (log of 0, overflow). DiracDelta, an impulse, is 0.
    """
    import sympy

    outputs, steps = [sympy.sympify(output, strict=True) for output in outputs], dict(steps or {})
    unknown = set().union(*(each.free_symbols for each in (*outputs, *steps.values()))) - {*arguments, *steps}
    if unknown:
        raise VlmbError(f"cannot compile: {sorted(map(str, unknown))} are no arguments; add them to {list(arguments)}")
    plain = [  # so that no name of a scene file enters the generated source
        {symbol: sympy.Symbol(f"{letter}{k}", **symbol.assumptions0) for k, symbol in enumerate(symbols)}
        for letter, symbols in (("a", arguments), ("s", steps))
    ]
    names = plain[0] | plain[1]
    steps = {names[symbol]: steps[symbol].xreplace(names) for symbol in _needed(outputs, steps)}
    outputs = [output.xreplace(names) for output in outputs]

    def is_power(node: Any) -> bool:  # ** would answer a negative base by a complex number, math.pow raises
        return node.is_Pow and node.exp.is_Number and not node.exp.is_Integer and abs(node.exp) != sympy.S.Half

    def share(expressions: Any) -> tuple[Any, Any]:
        power = sympy.Function("pow")
        pairs, reduced = sympy.cse([each.replace(is_power, lambda n: power(*n.args)) for each in (*expressions, *steps.values())])
        made = dict([*pairs, *zip(steps, reduced[len(expressions) :], strict=True)])
        results = tuple(reduced[: len(expressions)])
        return [(symbol, made[symbol]) for symbol in _needed(results, made)], results

    helpers = {"Sign": _sign, "Heaviside": lambda x, _: 0.5 + 0.5 * _sign(x), "DiracDelta": lambda *_: 0.0}
    try:
        function = sympy.lambdify(list(plain[0].values()), tuple(outputs), [helpers, "math"], cse=share)
    except (RecursionError, MemoryError, SyntaxError):
        raise VlmbError("these expressions, or their derivatives, are too long to compile; simplify them") from None
    undefined = (math.nan,) * len(outputs)

    def compiled(*values: float) -> tuple[float, ...]:
        try:
            return function(*values)
        except FAILURES:
            return undefined

    return compiled


def _needed(outputs: Sequence[Any], steps: Mapping[Any, Any]) -> list[Any]:
    """List the symbols of the steps that outputs rest on, each after those it rests on itself."""
    needs: dict[Any, Any] = {}
    waiting = [symbol for output in outputs for symbol in output.free_symbols & steps.keys()]
    while waiting:
        symbol = waiting.pop()
        if symbol not in needs:
            needs[symbol] = steps[symbol].free_symbols & steps.keys()
            waiting += needs[symbol]
    return list(TopologicalSorter(needs).static_order())


def _sign(x: float) -> float:
    return float(x > 0.0) - float(x < 0.0)  # of numpy's numbers too


@functools.cache
def _kinks() -> dict[str, Any]:
    """Make abs, min and max for sympy, with sign as slope; its own need real arguments and yield DiracDelta."""
    import sympy

    def function(name: str, slope: Callable[..., Any]) -> Any:
        return type(name, (sympy.Function,), {"fdiff": lambda self, index=1: slope(2 * index - 3, *self.args)})

    sign = function("Sign", lambda *_: sympy.S.Zero)
    smaller = function("Min", lambda side, a, b: (1 + side * sign(a - b)) / 2)
    larger = function("Max", lambda side, a, b: (1 - side * sign(a - b)) / 2)
    return {"abs": function("Abs", lambda _, a: sign(a)), "min": smaller, "max": larger}
