"""Numbers that a scene writes as expressions of its parameters: `stiffness = "2*k"`, `start.speed = "V"`."""

from __future__ import annotations

import functools
import types
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

import msgspec

from vlmb.errors import SceneError, nearest
from vlmb.scene.expressions import Expression, evaluate, failure, parse
from vlmb.scene.tables import Table

Path = tuple[str | int, ...]


class Written(float):
    """The value of an expression of parameters: a float that keeps its text, so that a changed parameter reaches it."""

    text: str

    def __new__(cls, value: float, text: str) -> Written:
        """Make a number with its text."""
        made = super().__new__(cls, value)
        made.text = text
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return Written, (float(self), self.text)


def as_written(table: Any) -> Any:
    """Return a table as plain data, its expressions as texts."""
    return msgspec.to_builtins(table, enc_hook=lambda number: number.text)


def as_numbers(table: Any) -> Any:
    """Return a table as plain data, its expressions as their values."""
    return msgspec.to_builtins(table, enc_hook=float)


class Shape(NamedTuple):
    """What may stand at a key: a number, a list or a table by name of such, one of the tables with fixed keys."""

    number: bool = False
    items: Shape | None = None
    values: Shape | None = None
    table: type[Table] | None = None
    words: tuple[str, ...] = ()  # texts that may stand there too, and are no expressions


OTHER = Shape()  # texts, choices, true or false, what the tests read


@functools.cache
def shape_of(kind: Any) -> Shape:
    """Return the shape of a field by its annotation; where a text may stand, a text is meant and no expression."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return shape_of(arguments[0])
    if origin in (Union, types.UnionType):
        parts = [shape_of(part) for part in arguments]
        number = any(part.number for part in parts) and str not in arguments
        items = next((part.items for part in parts if part.items), None)
        values = next((part.values for part in parts if part.values), None)
        words = tuple(word for part in arguments if get_origin(part) is Literal for word in get_args(part))
        return Shape(number, items, values, next((part.table for part in parts if part.table), None), words)
    if origin is tuple:
        return Shape(items=shape_of(arguments[0]))
    if origin is dict:
        return Shape(values=shape_of(arguments[1]))
    if isinstance(kind, type) and issubclass(kind, Table):
        return Shape(table=kind)
    return Shape(number=True) if kind is float else OTHER


@functools.cache
def keys_of(table: type[Table]) -> Mapping[str, Shape]:
    """Return the keys of a table and what may stand there."""
    return {field.encode_name: shape_of(field.type) for field in msgspec.structs.fields(table)}


def key_of(path: Path) -> str:
    """Return a path as errors name it: `links[0].lower.stiffness`."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")


def resolve(data: dict[str, Any], root: type[Table]) -> tuple[dict[str, Any], dict[Path, Written]]:
    """Put numbers in place of expressions in plain data; return what was written, by path, as well.

    Raises SceneError or ExpressionError naming the key for an unknown name, a ring of parameters, a value that is not finite.
    """
    given = data.get("parameters")
    found: dict[Path, Written] = {}
    values = _parameters(given, found) if isinstance(given, dict) else {}

    def walk(value: Any, shape: Shape, path: Path) -> Any:
        if isinstance(value, str) and shape.number and not _word(value, shape, values):
            if path not in found:
                found[path] = Written(_value(parse(value, key_of(path)), values, given), value)
            return float(found[path])
        if isinstance(value, dict) and (shape.table or shape.values):
            keys = keys_of(shape.table) if shape.table else {}
            return {name: walk(entry, keys.get(name, shape.values or OTHER), (*path, name)) for name, entry in value.items()}
        if isinstance(value, list) and shape.items:
            return [walk(entry, shape.items, (*path, at)) for at, entry in enumerate(value)]
        return value

    return walk(data, Shape(table=root), ()), found


def _word(text: str, shape: Shape, values: Mapping[str, float]) -> bool:
    """Whether a text is a word, right or wrong, where words may stand beside numbers."""
    return text in shape.words or bool(shape.words and text.isidentifier() and text not in values)


def _parameters(given: Mapping[str, Any], found: dict[Path, Written]) -> dict[str, float]:
    """Return the values of parameters, of expressions of other ones too."""
    texts = {name: parse(value, f"parameters.{name}") for name, value in given.items() if isinstance(value, str)}
    values = {
        name: float(value) for name, value in given.items() if isinstance(value, (int, float)) and not isinstance(value, bool)
    }
    try:
        order = list(TopologicalSorter({name: text.names & texts.keys() for name, text in texts.items()}).static_order())
    except CycleError as error:
        ring = " -> ".join(error.args[1][::-1][:10])
        raise SceneError(f"parameters: {ring}: parameters that need each other in a ring have no value") from None
    for name in order:
        number = Written(_value(texts[name], values, given), given[name])
        values[name] = found["parameters", name] = number
    return values


def _value(expression: Expression, values: Mapping[str, float], given: Any) -> float:
    """Evaluate an expression of parameters; name what is not one."""
    for name in sorted(expression.names - values.keys()):
        if isinstance(given, dict) and name in given:
            raise SceneError(f"parameters.{name} = {given[name]!r:.80}: must be a number")
        hint = nearest(name, values) if values else "this scene has none"
        advice = f"a number is needed, or an expression of parameters; {hint}"
        raise failure(expression.key, expression.text, f"unknown name {name!r}", advice)
    return evaluate(expression, values)


def put(whole: Any, path: Path, value: Any) -> Any:
    """Return frozen data with one entry replaced."""
    if not path:
        return value
    first: Any = path[0]
    if isinstance(whole, Table):
        return msgspec.structs.replace(whole, **{first: put(getattr(whole, first), path[1:], value)})
    if isinstance(whole, dict):
        return {**whole, first: put(whole[first], path[1:], value)}
    return (*whole[:first], put(whole[first], path[1:], value), *whole[first + 1 :])
