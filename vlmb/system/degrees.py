"""Angles that look like degrees: said, not refused, since a turn more or less is the same posture."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Protocol

from vlmb.errors import ExpressionError, SceneError
from vlmb.scene.by_phase import programmes_of
from vlmb.scene.expressions import evaluate, parse, parse_equation
from vlmb.scene.scene import Scene

DECIMAL = 10.0  # from here on a number with one decimal is no likely angle in radians either


class Quantity(Protocol):
    """What is asked of a quantity."""

    @property
    def unit(self) -> str:
        """Its unit."""
        ...


class Names(Protocol):
    """What is asked of the names of a mechanism, of links or robots."""

    def find(self, name: str) -> Quantity:
        """Return the quantity of a name; SceneError where there is none."""
        ...


def in_degrees(scene: Scene, names: Names) -> list[str]:
    """Say which angles of a scene look like degrees, with their keys: whole numbers of more than a turn."""
    return [
        f"{key} is {value / math.tau:.3g} turns: angles are in radians, and {value:g} degrees are {math.radians(value):.4g}"
        for key, value in _angles(scene, names)
        if _looks_like_degrees(value)
    ]


def _looks_like_degrees(value: float) -> bool:
    """Whether a number is of more than a turn, and whole, or has one decimal."""
    return abs(value) > math.tau and (value.is_integer() or (abs(value) > DECIMAL and round(value, 1) == value))


def _angles(scene: Scene, names: Names) -> Iterator[tuple[str, float]]:
    """Yield the angles that a scene gives as numbers, each with what it is called; of the start those that look like degrees."""
    for name, value in scene.start.items():
        if _looks_like_degrees(float(value)) and _is_angle(names, name):
            yield f"start.{name} = {value:g}", float(value)
    for text in (*scene.constraints, *(text for _, programme in programmes_of(scene) for text in programme.constraints)):
        yield from _of_row(scene, names, text)
    for index, force in enumerate(scene.forces):
        if force.between is not None:
            yield f"forces[{index}].rest = {force.rest:g}", force.rest
    for index, leg in enumerate(scene.legs):
        for key, law in (("attack", leg.attack), ("heading", leg.heading)):
            for value in () if law is None else _number(law, scene.parameters):
                yield f"legs[{index}].{key} = {value:g}", value


def _of_row(scene: Scene, names: Names, text: str) -> Iterator[tuple[str, float]]:
    """Yield the value of an equation between an angle and a number."""
    try:
        equation = parse_equation(text)
    except ExpressionError:
        return
    for angle, other in ((equation.left, equation.right), (equation.right, equation.left)):
        name = angle.text.strip()
        if angle.names == {name} and _is_angle(names, name):
            for value in _number(other.text, scene.parameters):
                yield f"constraint {text!r}: {value:g}", value


def _number(law: str | float, parameters: Mapping[str, float]) -> Iterator[float]:
    """Yield the value of a law that is a number; of a law of time that at its beginning."""
    try:
        yield float(evaluate(parse(law), {**parameters, "t": 0.0}))
    except ExpressionError:
        return


def _is_angle(names: Names, name: str) -> bool:
    try:
        return names.find(name).unit == "rad"
    except SceneError:
        return False
