"""What each operation of a tape does to numbers: its value, slopes and bends; nan outside its domain."""

from __future__ import annotations

from vlmb.core import opcodes as op
from vlmb.core.jit import inner, kernel
from vlmb.core.scalars import NAN, acos, asin, atan, atan2, cos, exp, log, quotient, sin, sqrt, tan


@inner
def power(x: float, exponent: float) -> float:
    """Return x^e for x >= 0; nan where it is infinite or not real."""
    if x > 0.0:
        return x**exponent
    return 0.0 * x if x == 0.0 and exponent > 0.0 else NAN


@inner
def whole_power(x: float, exponent: int) -> float:
    """Return x^n for a whole n; nan where it is infinite."""
    return NAN if x == 0.0 and exponent < 0 else x**exponent


@inner
def unary_value(code: int, x: float, c: float) -> float:
    """Return f(x) of an operation of one slot with its constant c."""
    if code == op.SHIFT:
        return x + c
    if code == op.SCALE:
        return c * x
    if code == op.PART:
        return x / c
    if code == op.OVER:
        return quotient(c, x)
    if code == op.CONSTANT:
        return c
    if code == op.SQUARE:
        return x * x
    if code == op.WHOLE_POWER:
        return whole_power(x, int(c))
    if code == op.POWER:
        return power(x, c)
    if code == op.ABS:
        return abs(x)
    if code == op.SIGN:
        return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else 0.0 * x)
    if code == op.STEP:
        return 1.0 if x >= 0.0 else (0.0 if x < 0.0 else NAN)
    return function_value(code, x)


@inner
def function_value(code: int, x: float) -> float:
    """Return f(x) of an elementary function."""
    if code == op.SIN:
        return sin(x)
    if code == op.COS:
        return cos(x)
    if code == op.TAN:
        return tan(x)
    if code == op.EXP:
        return exp(x)
    if code == op.LOG:
        return log(x) if x > 0.0 else NAN
    if code == op.SQRT:
        return sqrt(x) if x >= 0.0 else NAN
    if code == op.ATAN:
        return atan(x)
    if not abs(x) <= 1.0:
        return NAN
    return asin(x) if code == op.ASIN else acos(x)


@kernel(inline=True)
def unary_jet(code: int, x: float, c: float) -> tuple[float, float, float]:
    """Return f(x), f'(x) and f''(x) of an operation of one slot with its constant c."""
    if code == op.SHIFT:
        return x + c, 1.0, 0.0
    if code == op.SCALE:
        return c * x, c, 0.0
    if code == op.PART:
        return x / c, 1.0 / c, 0.0
    if code == op.SQUARE:
        return x * x, 2.0 * x, 2.0
    if code == op.SIN:
        f, slope = sin(x), cos(x)
        return f, slope, -f
    if code == op.COS:
        f, slope = cos(x), -sin(x)
        return f, slope, -f
    f = unary_value(code, x, c)
    slope, bend = unary_slopes(code, x, f, c)
    return f, slope, bend


@inner
def unary_slopes(code: int, x: float, f: float, c: float) -> tuple[float, float]:
    """Return f'(x) and f''(x) of the other operations of one slot with its value f."""
    if code == op.OVER:
        slope = -quotient(f, x)
        return slope, -2.0 * quotient(slope, x)
    if code in (op.WHOLE_POWER, op.POWER):
        return power_slopes(x, f, c)
    if code == op.ABS:
        return (1.0, 0.0) if x >= 0.0 else (-1.0, 0.0)
    if code in (op.CONSTANT, op.SIGN, op.STEP):
        return 0.0, 0.0
    return function_slopes(code, x, f)


@inner
def power_slopes(x: float, f: float, exponent: float) -> tuple[float, float]:
    """Return e x^(e - 1) and e (e - 1) x^(e - 2) for e other than 0, 1, 2."""
    if x == 0.0:
        return (0.0 if exponent > 1.0 else NAN), (0.0 if exponent > 2.0 else NAN)
    slope = exponent * f / x
    return slope, (exponent - 1.0) * slope / x


@inner
def function_slopes(code: int, x: float, f: float) -> tuple[float, float]:
    """Return f'(x) and f''(x) of an elementary function other than sine and cosine with its value f."""
    if code == op.TAN:
        slope = 1.0 + f * f
        return slope, 2.0 * f * slope
    if code == op.EXP:
        return f, f
    if code == op.LOG:
        slope = quotient(1.0, x)
        return slope, -slope * slope
    if code == op.SQRT:
        slope = quotient(0.5, f)
        return slope, -0.5 * quotient(slope, x)
    if code == op.ATAN:
        slope = 1.0 / (1.0 + x * x)
        return slope, -2.0 * x * slope * slope
    square = quotient(1.0, (1.0 - x) * (1.0 + x))
    slope = sqrt(square) if code == op.ASIN else -sqrt(square)
    return slope, x * slope * square


@inner
def binary_value(code: int, x: float, z: float) -> float:
    """Return f(x, z) of an operation of two slots."""
    if code == op.ADD:
        return x + z
    if code == op.SUBTRACT:
        return x - z
    if code == op.MULTIPLY:
        return x * z
    if code == op.DIVIDE:
        return quotient(x, z)
    if code == op.ATAN2:
        return atan2(x, z)
    if code == op.MIN:
        return x if x <= z else (z if z < x else NAN)
    return x if x >= z else (z if z > x else NAN)


@inner
def binary_slopes(code: int, x: float, z: float, f: float) -> tuple[float, float, float, float, float]:
    """Return f_x, f_z, f_xx, f_xz, f_zz of an operation of two slots with its value f."""
    if code == op.ADD:
        return 1.0, 1.0, 0.0, 0.0, 0.0
    if code == op.SUBTRACT:
        return 1.0, -1.0, 0.0, 0.0, 0.0
    if code == op.MULTIPLY:
        return z, x, 0.0, 1.0, 0.0
    if code == op.DIVIDE:
        part = quotient(1.0, z)
        return part, -f * part, 0.0, -part * part, 2.0 * f * part * part
    if code == op.ATAN2:
        part = quotient(1.0, x * x + z * z)
        along, across = z * part, x * part
        bend = 2.0 * along * across
        return along, -across, -bend, across * across - along * along, bend
    first = x <= z if code == op.MIN else x >= z
    return (1.0, 0.0, 0.0, 0.0, 0.0) if first else (0.0, 1.0, 0.0, 0.0, 0.0)
