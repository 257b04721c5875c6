"""Text of a scene file -> expressions. The text is data: it is parsed against a whitelist, never run.

An expression is a tree of tuples: ("number", 2.0), ("name", "phi1"), ("sin", tree), ("+", tree, tree, ...). A comparison
becomes a difference: ("where", tree, u, v) is u where the tree is negative, else v.
"""

from __future__ import annotations

import ast
import functools
import keyword
import math
import operator
import re
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from vlmb.errors import ExpressionError, nearest
from vlmb.scene.names import PHASE_START, PHASE_TIME, why_not

Tree = tuple[Any, ...]

MAX_CHARACTERS, MAX_NODES, MAX_DEPTH, MAX_EXPONENT = 1000, 200, 25, 64
MAX_NUMBER = 1e300
FUNCTIONS: Mapping[str, Callable[..., float]] = MappingProxyType(
    {"sin": math.sin, "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan,
     "atan2": math.atan2, "exp": math.exp, "log": math.log, "sqrt": math.sqrt, "abs": abs, "min": min, "max": max,
     "sign": lambda x: float(x > 0.0) - float(x < 0.0), "step": lambda x: float(x >= 0.0),
     "where": lambda below, first, second: first if below < 0.0 else second}
)  # fmt: skip
CONSTANTS: Mapping[str, float] = MappingProxyType({"pi": math.pi})
ALLOWED = f"allowed: numbers, names, pi, + - * / **, parentheses, {' '.join(FUNCTIONS)}"

# a < b and its kin: whether the difference is b - a, and whether `where` then takes its second value below 0.
_COMPARISONS = {ast.Lt: (False, False), ast.Gt: (True, False), ast.GtE: (False, True), ast.LtE: (True, True)}
_COMPARE = "where(a < b, u, v) is u where a < b, else v; its first argument is one <, <=, > or >="
_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**", ast.USub: "neg", ast.UAdd: "+"}
OPERATIONS: dict[str, Callable[..., float]] = {
    "+": lambda *terms: functools.reduce(operator.add, terms), "*": lambda *factors: math.prod(factors),
    "/": operator.truediv, "neg": operator.neg, "**": math.pow, **FUNCTIONS,
}  # fmt: skip
FAILURES = (ValueError, ZeroDivisionError, OverflowError)


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


def parse(text: str | float, key: str = "expression", allowed: Collection[str] | None = None) -> Expression:
    """Read an expression or a number; parts without names become numbers.

    `key` is the key path that errors name, `allowed` the valid variable names (None: any). Raises ExpressionError.
    """
    if isinstance(text, (int, float)) and not isinstance(text, bool):
        if not abs(text) <= MAX_NUMBER:
            raise failure(key, "number", "too large or not finite", "a finite number is needed")
        return Expression(repr(float(text)), frozenset(), key, ("number", float(text)))
    text = _checked_text(text, key)
    return _remembered(text, key) if allowed is None else _read(text, key, allowed)


@functools.lru_cache(maxsize=1024)
def _remembered(text: str, key: str) -> Expression:
    """Read text whose names may be any: a run asks for the same ones several times, and the next run again."""
    return _read(text, key, None)


def _read(text: str, key: str, allowed: Collection[str] | None) -> Expression:
    try:
        tree = _build(_syntax(text, key), text, key, allowed)
        depth = walk(tree, lambda _: 0, lambda _: 0, lambda _, parts: 1 + max(parts))
        names = walk(tree, lambda name: {name}, lambda _: set(), lambda _, parts: set().union(*parts))
    except RecursionError:
        depth = math.inf
    if depth > MAX_DEPTH:
        raise failure(key, text, f"nested more than {MAX_DEPTH} deep", "shorten it")
    return Expression(text, frozenset(names), key, tree)


def parse_equation(text: str, key: str = "constraint", allowed: Collection[str] | None = None) -> Equation:
    """Read an equation `left = right`. Raises ExpressionError."""
    text = _checked_text(text, key)
    sides = re.split(r"(?<![<>=!])=(?!=)", text)
    outside = re.sub(r"(?s)\bwhere\s*\(.*", "", text)  # comparisons within where are looked at when its side is read
    if len(sides) != 2 or re.search(r"==|[!:]", text) or re.search(r"[<>]", outside):
        found = "a comparison" if re.search(r"==|[<>!:]", text) else f"{len(sides) - 1} equals signs"
        raise failure(key, text, f"found {found}", "an equation is written with one =, e.g. phi1 = phi0")
    left, right = (parse(side, f"{key} ({text[:60]!a})", allowed) for side in sides)
    return Equation(text, left, right, left.names | right.names)


def evaluate(expression: Expression, values: Mapping[str, float]) -> float:
    """Return the value for named values. Raises ExpressionError: a value is missing, or the result is not finite."""
    require(expression, values, "value")
    try:
        result = float(_value(expression.tree, values))
        if math.isfinite(result):
            return result
        problem = f"its value is {result}"
    except ArithmeticError as error:
        problem = str(error)
    where = ", ".join(f"{name} = {values[name]}" for name in sorted(expression.names)[:8])
    raise failure(expression.key, expression.text, f"{problem} at {where}", "change the values or the text")


def _value(tree: Tree, values: Mapping[str, float]) -> float:
    """Return a tree's value; of `where` the branch taken alone is looked at."""
    op, *rest = tree
    if op == "number":
        return rest[0]
    if op == "name":
        return values[rest[0]]
    if op == "where":
        return _value(rest[1] if _value(rest[0], values) < 0.0 else rest[2], values)
    return apply(op, [_value(part, values) for part in rest])


def failure(key: str, text: str, problem: str, advice: str = ALLOWED) -> ExpressionError:
    """Return the error that names a key, its text, what is wrong with it and what to do."""
    return ExpressionError(f"{key} = {text if len(text) <= 120 else text[:117] + '...'!a}: {problem}; {advice}")


def require(expression: Expression, given: Mapping[str, Any], kind: str) -> None:
    """Raise ExpressionError where a name of the expression is not given."""
    for name in sorted(expression.names - set(given)):
        raise failure(expression.key, expression.text, f"no {kind} for {name!r}", nearest(name, given))


def _checked_text(text: object, key: str) -> str:
    if not isinstance(text, str):
        raise failure(key, type(text).__name__, "found neither text nor a number")
    if len(text) > MAX_CHARACTERS:
        raise failure(key, text, f"{len(text)} characters", f"at most {MAX_CHARACTERS}; shorten it")
    # ASCII alone: Python reads look-alike letters as one name. A # would hide what follows.
    for strange in re.findall(r"[^ -~\t\r\n]|[#\\;]", text):
        raise failure(key, text, f"found the character {strange!a}")
    if not text.strip():
        raise failure(key, text, "found nothing")
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
        number = re.fullmatch(r"\s*([-+]?\d[\d.]*(?:[eE][-+]?\d+)?)\s*[A-Za-z][\w/^*]*(?:\s?[A-Za-z/^*\d]+)*\s*", text)
        if number:
            hint = f"numbers stand without their unit: {number[1]} (m, rad, s, kg, N); "
        raise failure(key, text, f"not an expression ({getattr(error, 'msg', error)})", hint + ALLOWED) from None
    if sum(isinstance(node, ast.expr) for node in ast.walk(root)) > MAX_NODES:
        raise failure(key, text, f"more than {MAX_NODES} terms", "shorten it")
    return root


def _build(root: ast.expr, text: str, key: str, allowed: Collection[str] | None) -> Tree:
    """Turn Python's syntax tree into ours; whatever is not listed here is refused."""

    def refuse(problem: str, advice: str = ALLOWED) -> ExpressionError:
        return failure(key, text, problem, advice)

    def source(node: ast.expr) -> str:
        return repr(text[node.col_offset : node.end_col_offset])

    def variable(name: str) -> Tree:
        if name in CONSTANTS:
            return ("number", CONSTANTS[name])
        if name in FUNCTIONS:
            raise refuse(f"{name} is a function", f"write {name}(...)")
        if name == PHASE_TIME and (allowed is None or PHASE_START in allowed):
            return fold("-", [("name", "t"), ("name", PHASE_START)])
        if not re.fullmatch(r"[A-Za-z]\w*(\.[A-Za-z]\w*)*", name) or name.lower() in ("nan", "inf", "infinity"):
            raise refuse(f"{name!r} is no number or name", f"each part of a name begins with a letter; {ALLOWED}")
        if allowed is not None and name not in allowed:
            raise refuse(f"unknown name {name!r}", why_not(name) or nearest(name, sorted({*allowed, *CONSTANTS, *FUNCTIONS})))
        return ("name", name)

    def choice(node: ast.Call) -> Tree:
        if node.keywords or len(node.args) != 3:
            raise refuse(f"found {source(node)}", _COMPARE)
        test = node.args[0]
        if not isinstance(test, ast.Compare) or len(test.ops) != 1 or type(test.ops[0]) not in _COMPARISONS:
            raise refuse(f"found {source(test)} as the first argument of where", _COMPARE)
        turned, negated = _COMPARISONS[type(test.ops[0])]
        sides = [build(test.left), build(test.comparators[0])]
        branches = [build(part) for part in node.args[1:]]
        below = fold("-", sides[::-1] if turned else sides)
        return fold("where", [below, *(branches[::-1] if negated else branches)])

    def call(name: str, node: ast.Call) -> Tree:
        if name not in FUNCTIONS:
            hint = nearest(name.rpartition(".")[2], FUNCTIONS)
            raise refuse(f"{name!r} is not a function", f"{hint}; multiplication is written *")
        if name == "where":
            return choice(node)
        least, most = {"atan2": (2, 2), "min": (2, MAX_NODES), "max": (2, MAX_NODES)}.get(name, (1, 1))
        if node.keywords or not least <= len(node.args) <= most:
            wanted = f"{least} or more" if most > least else least
            raise refuse(f"found {source(node)}", f"{name} takes {wanted} argument(s) and no keywords")
        parts = [build(part) for part in node.args]
        if most > 2:  # min and max in pairs, so that every switch is one difference
            return functools.reduce(lambda left, right: fold(name, [left, right]), parts)
        return fold(name, parts)

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
            return fold(_OPERATORS[type(node.op)], [build(node.operand)])
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            left, right = build(node.left), build(node.right)
            literal = node.right.operand if isinstance(node.right, ast.UnaryOp) else node.right
            plain = isinstance(literal, ast.Constant) and abs(right[1]) <= MAX_EXPONENT
            if isinstance(node.op, ast.Pow) and not plain:
                raise refuse(f"an exponent is a plain number, at most {MAX_EXPONENT}", "write a**b as exp(b*log(a))")
            return fold(_OPERATORS[type(node.op)], [left, right])
        kind = type(getattr(node, "value", None) if isinstance(node, ast.Constant) else getattr(node, "op", node))
        if isinstance(node, ast.Compare):
            hint = "equality is =; " if "==" in text else ""
            raise refuse(f"found the comparison {source(node)} (Compare)", f"{hint}{_COMPARE}; {ALLOWED}")
        hints = [hint for mark, hint in {"^": "a power is **; ", "==": "equality is =; "}.items() if mark in text]
        raise refuse(f"found {source(node)} ({kind.__name__})", "".join(hints) + ALLOWED)

    try:
        return build(root)
    except ArithmeticError as error:
        raise refuse(str(error), "change its constants") from None


def fold(op: str, parts: list[Tree]) -> Tree:
    """Make a node; a number when all parts are. Sums and products stay flat. Raises ArithmeticError."""
    if op == "-":
        op, parts = "+", [parts[0], fold("neg", parts[1:])]
    if op in ("+", "*") and parts[0][0] == op:
        parts = [*parts[0][1:], *parts[1:]]
    if any(part[0] != "number" for part in parts):
        return (op, *parts) if len(parts) > 1 or op != "+" else parts[0]
    value = apply(op, [part[1] for part in parts])
    if not math.isfinite(value):
        raise ArithmeticError(f"a constant in it is {value}")
    return ("number", value)


def apply(op: str, values: list[float]) -> float:
    """Return the value of an operation. Raises ArithmeticError where it is not a finite real number."""
    try:
        return OPERATIONS[op](*values)
    except FAILURES:
        shown = f" {op} ".join(map(str, values)) if op in ("/", "**") else f"{op}({', '.join(map(str, values))})"
        raise ArithmeticError(f"{shown} is not a finite real number") from None


def walk(
    tree: Tree, name: Callable[[str], Any], number: Callable[[float], Any], operation: Callable[[str, list[Any]], Any]
) -> Any:
    """Rebuild a tree bottom-up from what its names, numbers and operations become."""
    op, *rest = tree
    if op in ("name", "number"):
        return (name if op == "name" else number)(rest[0])
    return operation(op, [walk(part, name, number, operation) for part in rest])
