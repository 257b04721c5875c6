"""Numbers that carry their derivatives, and functions of any numbers: floats, these, and those of mpmath.

A jet is a value with its derivatives by n numbers that were chosen before; what is computed of jets has the derivatives that
calculus gives it, exact but for rounding. Comparisons look at the value; two are equal only if their derivatives are as well, so
that what is 0 here but not beside it is not passed by.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Numbers = NDArray[Any]  # of floats, or of objects


class Jet:
    """A value and its derivatives (n,), which nobody changes; with an array of numbers it is taken with each of them."""

    __slots__ = ("slopes", "value")
    __array_ufunc__ = None  # numpy leaves arithmetic with floats of its own to this class
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, value: float, slopes: Array) -> None:
        self.value, self.slopes = value, slopes

    def __repr__(self) -> str:
        return f"Jet({self.value!r}, {self.slopes!r})"

    def __add__(self, other: Any) -> Any:
        if type(other) is Jet:
            return Jet(self.value + other.value, self.slopes + other.slopes)
        if type(other) is np.ndarray:
            return beside(self, operator.add, other)
        return Jet(self.value + other, self.slopes)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        if type(other) is Jet:
            return Jet(self.value - other.value, self.slopes - other.slopes)
        if type(other) is np.ndarray:
            return beside(self, operator.sub, other)
        return Jet(self.value - other, self.slopes)

    def __rsub__(self, other: Any) -> Any:
        if type(other) is np.ndarray:
            return beside(-self, operator.add, other)
        return Jet(other - self.value, -self.slopes)

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.slopes)

    def __mul__(self, other: Any) -> Any:
        if type(other) is Jet:
            return Jet(self.value * other.value, self.slopes * other.value + self.value * other.slopes)
        if type(other) is np.ndarray:
            return beside(self, operator.mul, other)
        return Jet(self.value * other, self.slopes * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if type(other) is np.ndarray:
            return beside(self, operator.truediv, other)
        if type(other) is Jet:
            value = _quotient(self.value, other.value)
            return Jet(value, (self.slopes - value * other.slopes) * _quotient(1.0, other.value))
        return Jet(_quotient(self.value, other), self.slopes * _quotient(1.0, other))

    def __rtruediv__(self, other: Any) -> Any:
        if type(other) is np.ndarray:
            return beside(1.0 / self, operator.mul, other)
        value = _quotient(other, self.value)
        return Jet(value, (-value * _quotient(1.0, self.value)) * self.slopes)

    def __pow__(self, exponent: float) -> Jet:
        return Jet(self.value**exponent, exponent * self.value ** (exponent - 1) * self.slopes)

    def __abs__(self) -> Jet:
        return self if self.value >= 0.0 else -self

    def __lt__(self, other: Any) -> bool:
        return bool(self.value < value_of(other))

    def __le__(self, other: Any) -> bool:
        return bool(self.value <= value_of(other))

    def __gt__(self, other: Any) -> bool:
        return bool(self.value > value_of(other))

    def __ge__(self, other: Any) -> bool:
        return bool(self.value >= value_of(other))

    def __eq__(self, other: object) -> bool:
        if type(other) is Jet:
            return bool(self.value == other.value and (self.slopes == other.slopes).all())
        return bool(self.value == other and not self.slopes.any())


def beside(jet: Jet, operation: Callable[[Any, Any], Any], numbers: Numbers) -> Any:
    """Return what an operation makes of a jet and each of some numbers."""
    return as_numbers([operation(jet, number) for number in numbers.tolist()])


def value_of(number: Any) -> Any:
    """Return a number without derivatives."""
    return number.value if type(number) is Jet else number


def jets(x: Array) -> Numbers:
    """Return numbers (n,) with derivatives by themselves."""
    return as_numbers([Jet(value, row) for value, row in zip(x.tolist(), np.eye(len(x)), strict=True)])


def as_numbers(numbers: Sequence[Any]) -> Numbers:
    """Return an array of numbers: of floats, or of objects where one is no float."""
    plain = all(isinstance(number, float) for number in numbers)
    found = np.empty(len(numbers), np.float64 if plain else object)
    found[:] = numbers
    return found


def derivatives(function: Callable[[Numbers], Numbers], x: Array) -> Array:
    """Return the derivatives (m, n) of a function of x (n,), which is called once, with jets."""
    with np.errstate(all="ignore"):
        found = function(jets(x))
    return slopes_of(found, len(x))


def slopes_of(numbers: Numbers, count: int) -> Array:
    """Return the derivatives (m, count) of numbers (m,), 0 of those that are no jets."""
    found = np.zeros((len(numbers), count))
    for row, number in zip(found, numbers, strict=True):
        if type(number) is Jet:
            row[:] = number.slopes
    return found


# Functions of any numbers, nan outside their domain


def _quotient(x: Any, y: Any) -> Any:
    try:
        return x / y
    except ZeroDivisionError:
        return math.nan if not x else math.copysign(math.inf, x)


def _plainly(name: str, *numbers: Any) -> Any:
    """Call a function of floats, or of mpmath's numbers, which bring their own."""
    owner = next((number.context for number in numbers if hasattr(number, "context")), math)
    try:
        found = getattr(owner, name)(*numbers)
    except (ValueError, ZeroDivisionError, OverflowError):
        return math.nan
    return math.nan if getattr(found, "imag", 0) != 0 else found


def _function(name: str, slope: Callable[[Any, Any], Any]) -> Callable[[Any], Any]:
    """Make a function of one number, whose derivative is slope(x, f)."""

    def function(x: Any) -> Any:
        if type(x) is Jet:
            value = _plainly(name, x.value)
            return Jet(value, slope(x.value, value) * x.slopes)
        return _plainly(name, x)

    function.__doc__ = f"Return {name}(x)."
    return function


sin = _function("sin", lambda x, f: math.cos(x))
cos = _function("cos", lambda x, f: -math.sin(x))
tan = _function("tan", lambda x, f: 1.0 + f * f)
asin = _function("asin", lambda x, f: _quotient(1.0, math.sqrt((1.0 - x) * (1.0 + x))))
acos = _function("acos", lambda x, f: -_quotient(1.0, math.sqrt((1.0 - x) * (1.0 + x))))
atan = _function("atan", lambda x, f: 1.0 / (1.0 + x * x))
sinh = _function("sinh", lambda x, f: math.cosh(x))
cosh = _function("cosh", lambda x, f: math.sinh(x))
tanh = _function("tanh", lambda x, f: 1.0 - f * f)
exp = _function("exp", lambda x, f: f)
log = _function("log", lambda x, f: _quotient(1.0, x))


def sqrt(x: Any) -> Any:
    """Return the root of x; that of 0 has derivatives 0 where x has, and else infinite ones."""
    if type(x) is not Jet:
        return _plainly("sqrt", x)
    value = _plainly("sqrt", x.value)
    if value == 0.0:
        return Jet(value, np.where(x.slopes == 0.0, 0.0, np.copysign(math.inf, x.slopes)))
    return Jet(value, x.slopes * (0.5 / value))


def atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y)."""
    if type(x) is not Jet and type(y) is not Jet:
        return _plainly("atan2", y, x)
    a, b = value_of(y), value_of(x)
    part = _quotient(1.0, a * a + b * b)
    across: Any = part * b * y.slopes if type(y) is Jet else 0.0
    along: Any = part * a * x.slopes if type(x) is Jet else 0.0
    return Jet(math.atan2(a, b), across - along)


def hypot(x: Any, y: Any) -> Any:
    """Return the length of (x, y)."""
    return sqrt(x * x + y * y) if type(x) is Jet or type(y) is Jet else _plainly("hypot", x, y)


def floor(x: Any) -> Any:
    """Return the largest whole number up to x."""
    return _plainly("floor", value_of(x))


def reciprocal(x: Any) -> Any:
    """Return 1 / x, and 0 at 0, where a kernel is about to return a fault."""
    return 1.0 / x if value_of(x) != 0 else 0.0 * x


def least_squares(a: Numbers, m: int, n: int, b: Numbers, columns: int, cut: float, x: Numbers) -> None:
    """Write into X (n, columns) the least X with the least squares of A X - B, as the core's `least_squares` does.

    Its rotations end when rounding is left of the values, derivatives may not have come so far. With P the inverse that gives
    the least X, of a rank that does not change, X' = P (B' - A' X) + P P^T A'^T (B - A X) + (1 - P A) A'^T P^T X.
    """
    matrix, right = _values(a[:m, :n]), _values(b[:m, :columns])
    inverse = np.linalg.pinv(matrix, rcond=cut)
    best = inverse @ right
    x[:n, :columns] = best
    count = next((len(e.slopes) for part in (a[:m, :n], b[:m, :columns]) for e in part.flat if type(e) is Jet), 0)
    if not count:
        return
    moved = slopes_of(a[:m, :n].ravel(), count).reshape(m, n, count)
    pushed = slopes_of(b[:m, :columns].ravel(), count).reshape(m, columns, count)
    left, outside = right - matrix @ best, np.eye(n) - inverse @ matrix
    for k in range(count):
        by = inverse @ (pushed[..., k] - moved[..., k] @ best) + inverse @ inverse.T @ moved[..., k].T @ left
        pushed[:, :, k] = 0.0
        by += outside @ moved[..., k].T @ inverse.T @ best
        for i in range(n):
            for j in range(columns):
                slopes = x[i, j].slopes if type(x[i, j]) is Jet else np.zeros(count)
                slopes[k] = by[i, j]
                x[i, j] = Jet(float(best[i, j]), slopes)


def _values(numbers: Numbers) -> Array:
    return np.array([value_of(number) for number in numbers.flat], float).reshape(numbers.shape)
