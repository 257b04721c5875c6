"""Playing a tape: values, derivatives along the motion (jets), and the gradient of a root over the leaves.

An operation f(x, z) of slots with x', x'', z', z'':
    f'  = f_x x' + f_z z'
    f'' = f_x x'' + f_z z'' + f_xx x'^2 + 2 f_xz x' z' + f_zz z'^2
The gradient runs backwards over the operations of one root, so that its cost does not grow with the number of leaves.

At a switch the side counts that its operation takes there: abs is x from 0 on, min and max take the first of two equals,
step is 1 from 0 on, sign(0) is 0; no derivative has an impulse. Outside a domain there is nan.
"""

from __future__ import annotations

from vlmb.core import opcodes as op
from vlmb.core.jit import kernel
from vlmb.core.opcodes import Array, Buffers, Tape
from vlmb.core.scalars import NAN, acos, asin, atan, atan2, cos, exp, finite, log, quotient, sin, sqrt, tan


@kernel
def power(x: float, exponent: float) -> float:
    """Return x^e for x >= 0; nan where it is infinite or not real."""
    if x > 0.0:
        return x**exponent
    return 0.0 * x if x == 0.0 and exponent > 0.0 else NAN


@kernel
def whole_power(x: float, exponent: int) -> float:
    """Return x^n for a whole n; nan where it is infinite."""
    return NAN if x == 0.0 and exponent < 0 else x**exponent


@kernel
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


@kernel
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


@kernel
def unary_slopes(code: int, x: float, f: float, c: float) -> tuple[float, float]:
    """Return f'(x) and f''(x) of an operation of one slot with its value f."""
    if code == op.SHIFT:
        return 1.0, 0.0
    if code == op.SCALE:
        return c, 0.0
    if code == op.PART:
        return 1.0 / c, 0.0
    if code == op.OVER:
        slope = -quotient(f, x)
        return slope, -2.0 * quotient(slope, x)
    if code == op.SQUARE:
        return 2.0 * x, 2.0
    if code in (op.WHOLE_POWER, op.POWER):
        return power_slopes(x, f, c)
    if code == op.ABS:
        return (1.0, 0.0) if x >= 0.0 else (-1.0, 0.0)
    if code in (op.CONSTANT, op.SIGN, op.STEP):
        return 0.0, 0.0
    return function_slopes(code, x, f)


@kernel
def power_slopes(x: float, f: float, exponent: float) -> tuple[float, float]:
    """Return e x^(e - 1) and e (e - 1) x^(e - 2) for e other than 0, 1, 2."""
    if x == 0.0:
        return (0.0 if exponent > 1.0 else NAN), (0.0 if exponent > 2.0 else NAN)
    slope = exponent * f / x
    return slope, (exponent - 1.0) * slope / x


@kernel
def function_slopes(code: int, x: float, f: float) -> tuple[float, float]:
    """Return f'(x) and f''(x) of an elementary function with its value f."""
    if code == op.SIN:
        return cos(x), -f
    if code == op.COS:
        return -sin(x), -f
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


@kernel
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


@kernel
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


@kernel
def selects_first(condition: float) -> bool:
    """Tell which operand op.SELECT takes."""
    return condition < 0.0


@kernel
def read_leaves(tape: Tape, t: float, parameters: Array, measured: Array, signals: Array, slots: Array) -> None:
    """Fill the leaves of `slots`.

    parameters (any,); measured (quantities, 3) value, rate and second derivative; signals (any, 3) functions of time with two
    derivatives. A op.RATE leaf knows one derivative: its second is left 0.
    """
    for k in range(tape.parts[op.LEAVES]):
        kind, at = tape.leaf[k, 0], tape.leaf[k, 1]
        if kind == op.VALUE:
            slots[k, 0], slots[k, 1], slots[k, 2] = measured[at, 0], measured[at, 1], measured[at, 2]
        elif kind == op.RATE:
            slots[k, 0], slots[k, 1], slots[k, 2] = measured[at, 1], measured[at, 2], 0.0
        elif kind == op.TIME:
            slots[k, 0], slots[k, 1], slots[k, 2] = t, 1.0, 0.0
        elif kind == op.PARAMETER:
            slots[k, 0], slots[k, 1], slots[k, 2] = parameters[at], 0.0, 0.0
        elif kind == op.SIGNAL:
            slots[k, 0], slots[k, 1], slots[k, 2] = signals[at, 0], signals[at, 1], signals[at, 2]


@kernel
def play_values(tape: Tape, buffers: Buffers, begin: int, end: int) -> None:
    """Play the operations begin <= k < end for their values alone; the leaves are filled."""
    slots, leaves = buffers.slots, tape.parts[op.LEAVES]
    for k in range(begin, end):
        code, a, b = tape.code[k, op.OPERATION], tape.code[k, op.FIRST], tape.code[k, op.SECOND]
        if code >= op.UNARY:
            slots[leaves + k, 0] = unary_value(code, slots[a, 0], tape.constant[k])
        elif code == op.SELECT:
            condition = slots[tape.code[k, op.CONDITION], 0]
            chosen = a if selects_first(condition) else b
            slots[leaves + k, 0] = slots[chosen, 0] if condition == condition else NAN
        else:
            slots[leaves + k, 0] = binary_value(code, slots[a, 0], slots[b, 0])


@kernel
def play_jets(tape: Tape, buffers: Buffers, begin: int, end: int) -> None:
    """Play the operations begin <= k < end for values, both derivatives along the motion, and the slopes of each."""
    slots, slopes, leaves = buffers.slots, buffers.slopes, tape.parts[op.LEAVES]
    for k in range(begin, end):
        code, a, b, o = tape.code[k, op.OPERATION], tape.code[k, op.FIRST], tape.code[k, op.SECOND], leaves + k
        x, x1, x2 = slots[a, 0], slots[a, 1], slots[a, 2]
        if code >= op.UNARY:
            f = unary_value(code, x, tape.constant[k])
            slope, bend = unary_slopes(code, x, f, tape.constant[k])
            slopes[k, 0] = slope
            slots[o, 0], slots[o, 1], slots[o, 2] = f, slope * x1, slope * x2 + bend * x1 * x1
        elif code == op.SELECT:
            select_jet(slots, slopes, k, o, a, b, slots[tape.code[k, op.CONDITION], 0])
        else:
            z, z1, z2 = slots[b, 0], slots[b, 1], slots[b, 2]
            f = binary_value(code, x, z)
            fx, fz, fxx, fxz, fzz = binary_slopes(code, x, z, f)
            slopes[k, 0], slopes[k, 1] = fx, fz
            slots[o, 0], slots[o, 1] = f, fx * x1 + fz * z1
            slots[o, 2] = fx * x2 + fz * z2 + fxx * x1 * x1 + 2.0 * fxz * x1 * z1 + fzz * z1 * z1


@kernel
def select_jet(slots: Array, slopes: Array, k: int, o: int, a: int, b: int, condition: float) -> None:
    """Copy the jet of the chosen operand; the other one may be nan."""
    first = selects_first(condition)
    chosen = a if first else b
    slopes[k, 0], slopes[k, 1] = (1.0, 0.0) if first else (0.0, 1.0)
    for j in range(3):
        slots[o, j] = slots[chosen, j] if condition == condition else NAN


@kernel
def gradient(tape: Tape, buffers: Buffers, root: int, complete: bool) -> None:
    """Write the derivatives of a root by the leaves into adjoint[:leaves], after `play_jets`.

    By leaves of the state alone; `complete`: by time and parameters too.
    """
    adjoint, slopes, leaves = buffers.adjoint, buffers.slopes, tape.parts[op.LEAVES]
    for slot in range(adjoint.shape[0]):
        adjoint[slot] = 0.0
    adjoint[tape.root[root]] = 1.0
    last = tape.sweep_ends[root, 2] if complete else tape.sweep_ends[root, 1]
    for j in range(tape.sweep_ends[root, 0], last):
        k = tape.sweep[j]
        weight = adjoint[leaves + k]
        if weight == 0.0:  # where op.SELECT passed by, slopes may be nan
            continue
        adjoint[tape.code[k, op.FIRST]] += weight * slopes[k, 0]
        if tape.code[k, op.OPERATION] < op.UNARY:
            adjoint[tape.code[k, op.SECOND]] += weight * slopes[k, 1]


@kernel
def prepare(tape: Tape, buffers: Buffers, parameters: Array) -> None:
    """Play what depends on parameters alone: once for a run, before anything else."""
    for k in range(tape.parts[op.LEAVES]):
        if tape.leaf[k, 0] == op.PARAMETER:
            buffers.slots[k, 0], buffers.slots[k, 1], buffers.slots[k, 2] = parameters[tape.leaf[k, 1]], 0.0, 0.0
    play_jets(tape, buffers, 0, tape.parts[op.PARAMETERS_END])


@kernel
def values(tape: Tape, buffers: Buffers, out: Array) -> int:
    """Play for the values of all roots, `out` (roots,), after `prepare` and `read_leaves`; return 1 + the first not finite."""
    play_values(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.ROOTS_END])
    bad = 0
    for r in range(tape.root.shape[0] - 1, -1, -1):
        out[r] = buffers.slots[tape.root[r], 0]
        if not finite(out[r]):
            bad = r + 1
    return bad


@kernel
def jets(tape: Tape, buffers: Buffers, out: Array) -> int:
    """Play for value and two derivatives of all roots, `out` (roots, 3); return 1 + the first root that is not finite."""
    play_jets(tape, buffers, tape.parts[op.PARAMETERS_END], tape.parts[op.ROOTS_END])
    bad = 0
    for r in range(tape.root.shape[0] - 1, -1, -1):
        slot = tape.root[r]
        out[r, 0], out[r, 1], out[r, 2] = buffers.slots[slot, 0], buffers.slots[slot, 1], buffers.slots[slot, 2]
        if not finite(out[r, 0] + out[r, 1] + out[r, 2]):
            bad = r + 1
    return bad


@kernel
def failing_operation(tape: Tape, buffers: Buffers, root: int, order: int) -> int:
    """Return the operation where a root's value (order 0) or a derivative up to `order` first fails; -1 - leaf for a leaf.

    That is the one which is not finite while all that it uses is.
    """
    slots, leaves = buffers.slots, tape.parts[op.LEAVES]
    slot = tape.root[root]
    while slot >= leaves:
        k = slot - leaves
        deeper = -1
        for column in (op.CONDITION, op.SECOND, op.FIRST):
            if uses(tape, slots, k, column) and not finite_jet(slots, tape.code[k, column], order):
                deeper = tape.code[k, column]
        if deeper < 0:
            return k
        slot = deeper
    return -1 - slot


@kernel
def uses(tape: Tape, slots: Array, k: int, column: int) -> bool:
    """Tell whether an operation takes the operand of a column now."""
    code = tape.code[k, op.OPERATION]
    if code == op.SELECT:
        if column == op.CONDITION:
            return True
        return selects_first(slots[tape.code[k, op.CONDITION], 0]) == (column == op.FIRST)
    if code == op.CONSTANT:
        return False
    return column == op.FIRST or (column == op.SECOND and code < op.UNARY)


@kernel
def finite_jet(slots: Array, slot: int, order: int) -> bool:
    """Tell whether a slot's value and derivatives up to `order` are finite."""
    total = 0.0
    for j in range(order + 1):
        total += slots[slot, j] - slots[slot, j]
    return total == 0.0
