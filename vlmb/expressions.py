"""Text of a scene file -> expressions. The text is data: it is parsed against a whitelist, never run.

An expression is a tree of tuples: ("number", 2.0), ("name", "phi1"), ("sin", tree), ("+", tree, tree, ...).
"""

from __future__ import annotations

import ast
import functools
import keyword
import math
import operator
import re
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from vlmb.errors import ExpressionError, VlmbError, nearest

if TYPE_CHECKING:
    import sympy

Tree = tuple[Any, ...]

MAX_CHARACTERS, MAX_NODES, MAX_DEPTH, MAX_EXPONENT, MAX_FACTORS = 1000, 200, 25, 64, 16
MAX_NUMBER = 1e300
FUNCTIONS: Mapping[str, Callable[..., float]] = MappingProxyType(
    {"sin": math.sin, "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan,
     "atan2": math.atan2, "exp": math.exp, "log": math.log, "sqrt": math.sqrt, "abs": abs, "min": min, "max": max}
)  # fmt: skip
CONSTANTS: Mapping[str, float] = MappingProxyType({"pi": math.pi})
ALLOWED = f"allowed: numbers, names, pi, + - * / **, parentheses, {' '.join(FUNCTIONS)}"

_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**", ast.USub: "neg", ast.UAdd: "+"}
_OPERATIONS: dict[str, Callable[..., float]] = {
    "+": lambda *terms: functools.reduce(operator.add, terms), "*": lambda *factors: math.prod(factors),
    "/": operator.truediv, "neg": operator.neg, "**": math.pow, **FUNCTIONS,
}  # fmt: skip
_FAILURES = (ValueError, ZeroDivisionError, OverflowError)


@dataclass(frozen=True)
class Expression:
    """A checked expression: its text, its variable names (dotted ones flat) and the key path that errors name."""

    text: str
    names: frozenset[str]
    key: str = field(compare=False)
    tree: Tree = field(repr=False)


@dataclass(frozen=True)
class Equation:
    """left = right, with the user's text stripped, and the names of both sides."""

    text: str
    left: Expression
    right: Expression
    names: frozenset[str]


@dataclass(frozen=True, eq=False)
class Law:
    """A law of time: `value(t)`, and `jet(t)` = value, first and second derivative; nan where undefined.

    `expression` has the parameters put in. Derivatives leave out the impulses at kinks of abs, min and max.
    """

    text: str
    value: Callable[[float], float]
    jet: Callable[[float], tuple[float, ...]]
    expression: Expression


def parse(text: str | float, key: str = "expression", allowed: Collection[str] | None = None) -> Expression:
    """Read an expression or a number; parts without names become numbers.

    `key` is the key path that errors name, `allowed` the valid variable names (None: any). Raises ExpressionError.
    """
    if isinstance(text, (int, float)) and not isinstance(text, bool):
        if not abs(text) <= MAX_NUMBER:
            raise _error(key, "number", "too large or not finite", "a finite number is needed")
        return Expression(repr(float(text)), frozenset(), key, ("number", float(text)))
    text = _checked_text(text, key)
    try:
        tree = _build(_syntax(text, key), text, key, allowed)
        depth = _walk(tree, lambda _: 0, lambda _: 0, lambda _, parts: 1 + max(parts))
        names = _walk(tree, lambda name: {name}, lambda _: set(), lambda _, parts: set().union(*parts))
    except RecursionError:
        depth = math.inf
    if depth > MAX_DEPTH:
        raise _error(key, text, f"nested more than {MAX_DEPTH} deep", "shorten it")
    return Expression(text, frozenset(names), key, tree)


def parse_equation(text: str, key: str = "constraint", allowed: Collection[str] | None = None) -> Equation:
    """Read an equation `left = right`. Raises ExpressionError."""
    text = _checked_text(text, key)
    sides = text.split("=")
    if len(sides) != 2 or re.search(r"[<>!:]", text):
        found = "a comparison" if re.search(r"==|[<>!:]", text) else f"{len(sides) - 1} equals signs"
        raise _error(key, text, f"found {found}", "an equation is written with one =, e.g. phi1 = phi0")
    left, right = (parse(side, f"{key} ({text[:60]!a})", allowed) for side in sides)
    return Equation(text, left, right, left.names | right.names)


def evaluate(expression: Expression, values: Mapping[str, float]) -> float:
    """Return the value for named values. Raises ExpressionError: a value is missing, or the result is not finite."""
    _require(expression, values, "value")
    try:
        result = float(_walk(expression.tree, values.__getitem__, float, _apply))
        if math.isfinite(result):
            return result
        problem = f"its value is {result}"
    except ArithmeticError as error:
        problem = str(error)
    where = ", ".join(f"{name} = {values[name]}" for name in sorted(expression.names)[:8])
    raise _error(expression.key, expression.text, f"{problem} at {where}", "change the values or the text")


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
            raise _error(expression.key, expression.text, f"{op!r} in it leaves the range of real numbers")
        if result.is_Mul and len(result.args) > MAX_FACTORS:  # second derivatives would take minutes
            raise _error(expression.key, expression.text, f"more than {MAX_FACTORS} factors", "simplify the product")
        exact = {n: sympy.Float(n) for n in numbers if n.is_Rational and max(abs(n.p), n.q) > 10**5}
        return result.xreplace(exact) if exact else result

    def number(value: float) -> Any:
        half = value % 0.5 == 0.0 and abs(value) < 1e5  # so that x**0.5 is a square root
        return sympy.Rational(int(2 * value), 2) if half else sympy.Float(value)

    _require(expression, symbols, "symbol")
    return _walk(expression.tree, symbols.__getitem__, number, operation)


def second_order(
    expressions: Sequence[sympy.Expr], variables: Sequence[sympy.Symbol]
) -> tuple[list[dict[int, sympy.Expr]], list[dict[tuple[int, int], sympy.Expr]]]:
    """Return the nonzero gradients {i: d/dx_i} and Hessians {(i, j): d2/dx_i dx_j, i <= j}, one each per expression."""
    places = {variable: index for index, variable in enumerate(variables)}

    def slopes(expression: Any, first: int) -> dict[int, Any]:
        indices = sorted(places[x] for x in expression.free_symbols if places.get(x, -1) >= first)
        return {i: slope for i in indices if (slope := expression.diff(variables[i])) != 0}

    gradients = [slopes(expression, 0) for expression in expressions]
    return gradients, [{(i, j): s for i, g in each.items() for j, s in slopes(g, i).items()} for each in gradients]


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
        except _FAILURES:
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


def time_law(text: str | float, parameters: Mapping[str, float], key: str) -> Law:
    """Read a law of time in `t` and the parameters; sympy is imported by the first `jet` of a law that moves.

    Raises ExpressionError.
    """
    given = parse(text, key, {"t", *parameters})
    known = {name: parse(parameters[name], f"parameters.{name}", ()).tree for name in given.names - {"t"}}
    try:
        tree = _walk(given.tree, lambda name: known.get(name, ("name", name)), lambda value: ("number", value), _fold)
    except ArithmeticError as error:
        raise _error(key, given.text, str(error), "change the text or the parameters") from None
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


def _error(key: str, text: str, problem: str, advice: str = ALLOWED) -> ExpressionError:
    return ExpressionError(f"{key} = {text if len(text) <= 120 else text[:117] + '...'!a}: {problem}; {advice}")


def _require(expression: Expression, given: Mapping[str, Any], kind: str) -> None:
    for name in sorted(expression.names - set(given)):
        raise _error(expression.key, expression.text, f"no {kind} for {name!r}", nearest(name, given))


def _checked_text(text: object, key: str) -> str:
    if not isinstance(text, str):
        raise _error(key, type(text).__name__, "found neither text nor a number")
    if len(text) > MAX_CHARACTERS:
        raise _error(key, text, f"{len(text)} characters", f"at most {MAX_CHARACTERS}; shorten it")
    # ASCII alone: Python reads look-alike letters as one name. A # would hide what follows.
    for strange in re.findall(r"[^ -~\t\r\n]|[#\\;]", text):
        raise _error(key, text, f"found the character {strange!a}")
    if not text.strip():
        raise _error(key, text, "found nothing")
    return text.strip()


def _syntax(text: str, key: str) -> ast.expr:
    """Read text by Python's own grammar, bounded; nothing is run."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            root = ast.parse(re.sub(r"\s", " ", text), mode="eval").body
    except (SyntaxError, Warning, ValueError, RecursionError, MemoryError) as error:
        words = set(re.findall(r"\w+", text)) & set(keyword.kwlist)
        hint = f"{min(words)!r} cannot be a name; " if words else "an expression has no =; " if "=" in text else ""
        raise _error(key, text, f"not an expression ({getattr(error, 'msg', error)})", hint + ALLOWED) from None
    if sum(isinstance(node, ast.expr) for node in ast.walk(root)) > MAX_NODES:
        raise _error(key, text, f"more than {MAX_NODES} terms", "shorten it")
    return root


def _build(root: ast.expr, text: str, key: str, allowed: Collection[str] | None) -> Tree:
    """Turn Python's syntax tree into ours; whatever is not listed here is refused."""

    def refuse(problem: str, advice: str = ALLOWED) -> ExpressionError:
        return _error(key, text, problem, advice)

    def source(node: ast.expr) -> str:
        return repr(text[node.col_offset : node.end_col_offset])

    def variable(name: str) -> Tree:
        if name in CONSTANTS:
            return ("number", CONSTANTS[name])
        if name in FUNCTIONS:
            raise refuse(f"{name} is a function", f"write {name}(...)")
        if not re.fullmatch(r"[A-Za-z]\w*(\.[A-Za-z]\w*)*", name) or name.lower() in ("nan", "inf", "infinity"):
            raise refuse(f"{name!r} is no number or name", f"each part of a name begins with a letter; {ALLOWED}")
        if allowed is not None and name not in allowed:
            raise refuse(f"unknown name {name!r}", nearest(name, sorted({*allowed, *CONSTANTS, *FUNCTIONS})))
        return ("name", name)

    def call(name: str, node: ast.Call) -> Tree:
        if name not in FUNCTIONS:
            hint = nearest(name.rpartition(".")[2], FUNCTIONS)
            raise refuse(f"{name!r} is not a function", f"{hint}; multiplication is written *")
        least, most = {"atan2": (2, 2), "min": (2, MAX_NODES), "max": (2, MAX_NODES)}.get(name, (1, 1))
        if node.keywords or not least <= len(node.args) <= most:
            wanted = f"{least} or more" if most > least else least
            raise refuse(f"found {source(node)}", f"{name} takes {wanted} argument(s) and no keywords")
        parts = [build(part) for part in node.args]
        if most > 2:  # min and max in pairs, so that every switch is one difference
            return functools.reduce(lambda left, right: _fold(name, [left, right]), parts)
        return _fold(name, parts)

    def build(node: ast.expr) -> Tree:
        if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool):
            if abs(node.value) > MAX_NUMBER:
                raise refuse("a number in it is too large")
            return ("number", float(node.value))
        if isinstance(node, (ast.Name, ast.Attribute)):
            return variable(ast.unparse(node))
        if isinstance(node, ast.Call):
            return call(ast.unparse(node.func), node)
        if isinstance(node, ast.UnaryOp) and type(node.op) in _OPERATORS:
            return _fold(_OPERATORS[type(node.op)], [build(node.operand)])
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            left, right = build(node.left), build(node.right)
            literal = node.right.operand if isinstance(node.right, ast.UnaryOp) else node.right
            plain = isinstance(literal, ast.Constant) and abs(right[1]) <= MAX_EXPONENT
            if isinstance(node.op, ast.Pow) and not plain:
                raise refuse(f"an exponent is a plain number, at most {MAX_EXPONENT}", "write a**b as exp(b*log(a))")
            return _fold(_OPERATORS[type(node.op)], [left, right])
        kind = type(getattr(node, "value", None) if isinstance(node, ast.Constant) else getattr(node, "op", node))
        hints = [hint for mark, hint in {"^": "a power is **; ", "==": "equality is =; "}.items() if mark in text]
        raise refuse(f"found {source(node)} ({kind.__name__})", "".join(hints) + ALLOWED)

    try:
        return build(root)
    except ArithmeticError as error:
        raise refuse(str(error), "change its constants") from None


def _fold(op: str, parts: list[Tree]) -> Tree:
    """Make a node; a number when all parts are. Sums and products stay flat. Raises ArithmeticError."""
    if op == "-":
        op, parts = "+", [parts[0], _fold("neg", parts[1:])]
    if op in ("+", "*") and parts[0][0] == op:
        parts = [*parts[0][1:], *parts[1:]]
    if any(part[0] != "number" for part in parts):
        return (op, *parts) if len(parts) > 1 or op != "+" else parts[0]
    value = _apply(op, [part[1] for part in parts])
    if not math.isfinite(value):
        raise ArithmeticError(f"a constant in it is {value}")
    return ("number", value)


def _apply(op: str, values: list[float]) -> float:
    try:
        return _OPERATIONS[op](*values)
    except _FAILURES:
        shown = f" {op} ".join(map(str, values)) if op in ("/", "**") else f"{op}({', '.join(map(str, values))})"
        raise ArithmeticError(f"{shown} is not a finite real number") from None


def _walk(
    tree: Tree, name: Callable[[str], Any], number: Callable[[float], Any], operation: Callable[[str, list[Any]], Any]
) -> Any:
    """Rebuild a tree bottom-up from what its names, numbers and operations become."""
    op, *rest = tree
    if op in ("name", "number"):
        return (name if op == "name" else number)(rest[0])
    return operation(op, [_walk(part, name, number, operation) for part in rest])


def _of_time(tree: Tree) -> Callable[[float], float]:
    """Make a function of t, nan outside the tree's domain."""

    def operation(op: str, parts: list[Callable[[float], float]]) -> Callable[[float], float]:
        pairs: dict[str, Callable[..., float]] = {"+": operator.add, "*": operator.mul} if len(parts) == 2 else {}
        function, first, second = pairs.get(op, _OPERATIONS[op]), parts[0], parts[-1]
        if len(parts) > 2:
            return lambda t: function(*[part(t) for part in parts])
        return (lambda t: function(first(t))) if len(parts) == 1 else (lambda t: function(first(t), second(t)))

    inner: Callable[[float], float] = _walk(tree, lambda _: lambda t: t, lambda value: lambda t: value, operation)

    def value(t: float) -> float:
        try:
            return inner(t)
        except _FAILURES:
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


def _sign(x: float) -> float:
    return float((x > 0.0) - (x < 0.0))


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
