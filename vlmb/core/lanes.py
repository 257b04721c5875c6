"""Four numbers at once: what a recursion does to one load it does to four in the same time, by the processor's wide registers.

Arrays whose last axis is LANES long are handed over as they are; inside a kernel `wide` makes them arrays of wide numbers, which
the functions of the recursion add and multiply as they would numbers. `by_fours` does so with the rows of a table, for sums of
rows. For Python they are arrays of NumPy, and do so, too.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np

from vlmb.core.jit import COMPILED
from vlmb.core.tree import Array

LANES = 4


def wide(array: Array) -> Array:
    """Return an array (..., LANES) as one of wide numbers, with one axis less."""
    return array


def by_fours(table: Array) -> Array:
    """Return a table (rows, LANES k) as one (rows, k) of wide numbers."""
    return table.reshape(len(table), -1, LANES)


def side_by_side(one: float, two: float, three: float, four: float) -> Any:
    """Return a wide number."""
    return np.array([one, two, three, four])


def sum_of(number: Any) -> float:
    """Return the sum of the four of a wide number."""
    return float(number[0] + number[1] + (number[2] + number[3]))


def is_zero(number: Any) -> bool:
    """Tell whether a number is 0, of a wide one all four."""
    zero: Any = number == 0.0
    return bool(zero if isinstance(zero, bool) else zero.all())


def _declare() -> None:
    """Teach numba wide numbers (vectors of LLVM) and arrays of them."""
    from llvmlite import ir
    from numba import types
    from numba.core import cgutils
    from numba.core.typing.templates import AbstractTemplate, ConcreteTemplate, infer_global, signature
    from numba.extending import intrinsic, lower_builtin, models, overload, register_model

    vector = ir.VectorType(ir.DoubleType(), LANES)

    class WideNumber(types.Type):
        def __init__(self) -> None:
            super().__init__(name="WideNumber")

    class WideArray(types.Type):
        def __init__(self, axes: int) -> None:
            self.axes = axes
            super().__init__(name=f"WideArray({axes})")

    number = WideNumber()

    @register_model(WideNumber)
    class NumberModel(models.PrimitiveModel):
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, vector)

    @register_model(WideArray)
    class ArrayModel(models.StructModel):
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, [("data", types.CPointer(types.float64)), ("width", types.intp)])

    @intrinsic
    def widened(typing: Any, array: Any) -> Any:
        kind = WideArray(array.ndim - 1)

        def make(context: Any, builder: Any, call: Any, values: Any) -> Any:
            given = context.make_array(call.args[0])(context, builder, values[0])
            found = cgutils.create_struct_proxy(kind)(context, builder)
            found.data, found.width = given.data, builder.extract_value(given.shape, array.ndim - 2)
            return found._getvalue()

        return kind(array), make

    @overload(wide, strict=False)
    def wide_array(array: Any) -> Any:
        if isinstance(array, types.Array) and array.ndim in (2, 3) and array.layout == "C":
            return lambda array: widened(array)
        return None

    @intrinsic
    def folded(typing: Any, table: Any) -> Any:
        kind = WideArray(2)

        def make(context: Any, builder: Any, call: Any, values: Any) -> Any:
            given = context.make_array(call.args[0])(context, builder, values[0])
            found, width = cgutils.create_struct_proxy(kind)(context, builder), builder.extract_value(given.shape, 1)
            found.data, found.width = given.data, builder.udiv(width, ir.Constant(width.type, LANES))
            return found._getvalue()

        return kind(table), make

    @overload(by_fours, strict=False)
    def folded_table(table: Any) -> Any:
        if isinstance(table, types.Array) and table.ndim == 2 and table.layout == "C":
            return lambda table: folded(table)
        return None

    def place(context: Any, builder: Any, kind: Any, array: Any, axes: Any, index: Any) -> Any:
        """Point at an entry."""
        held = cgutils.create_struct_proxy(kind)(context, builder, value=array)
        if isinstance(axes, types.BaseTuple):
            first, second = (
                context.cast(builder, value, axis, types.intp)
                for value, axis in zip(cgutils.unpack_tuple(builder, index), axes, strict=True)
            )
            at = builder.add(builder.mul(first, held.width), second)
        else:
            at = context.cast(builder, index, axes, types.intp)
        beginning = builder.gep(held.data, [builder.mul(at, ir.Constant(at.type, LANES))])
        return builder.bitcast(beginning, vector.as_pointer())

    def widen(builder: Any, value: Any) -> Any:
        """Put a number into all lanes."""
        if value.type == vector:
            return value
        first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
        return builder.shuffle_vector(first, first, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))

    def fits(kind: Any, index: Any) -> bool:
        integers = index.types if isinstance(index, types.BaseTuple) else (index,)
        return len(integers) == kind.axes and all(isinstance(axis, types.Integer) for axis in integers)

    @infer_global(operator.getitem)
    class GetItem(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if isinstance(args[0], WideArray) and fits(*args):
                return signature(number, *args)
            return None

    @infer_global(operator.setitem)
    class SetItem(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if isinstance(args[0], WideArray) and fits(*args[:2]) and args[2] in (number, types.float64):
                return signature(types.none, *args)
            return None

    def get(context: Any, builder: Any, call: Any, values: Any) -> Any:
        return builder.load(place(context, builder, call.args[0], values[0], call.args[1], values[1]), align=8)

    def put(context: Any, builder: Any, call: Any, values: Any) -> Any:
        at = place(context, builder, call.args[0], values[0], call.args[1], values[1])
        builder.store(widen(builder, values[2]), at, align=8)
        return context.get_dummy_value()

    for axes in (types.Integer, types.BaseTuple):
        lower_builtin(operator.getitem, WideArray, axes)(get)
        for kind in (WideNumber, types.Float):
            lower_builtin(operator.setitem, WideArray, axes, kind)(put)

    both = [signature(number, number, number), signature(number, number, types.float64), signature(number, types.float64, number)]
    doings = {
        operator.add: "fadd", operator.iadd: "fadd", operator.sub: "fsub", operator.isub: "fsub", operator.mul: "fmul",
        operator.truediv: "fdiv",
    }  # fmt: skip
    for symbol, name in doings.items():
        infer_global(symbol)(type(f"Wide_{name}", (ConcreteTemplate,), {"cases": both}))

        def combine(context: Any, builder: Any, call: Any, values: Any, name: str = name) -> Any:
            return getattr(builder, name)(widen(builder, values[0]), widen(builder, values[1]))

        for case in both:
            lower_builtin(symbol, *case.args)(combine)

    infer_global(operator.neg)(type("Wide_neg", (ConcreteTemplate,), {"cases": [signature(number, number)]}))
    lower_builtin(operator.neg, number)(lambda context, builder, call, values: builder.fneg(values[0]))

    @infer_global(abs)
    class Absolute(ConcreteTemplate):
        cases = [signature(number, number)]

    @lower_builtin(abs, number)
    def absolute(context: Any, builder: Any, call: Any, values: Any) -> Any:
        bits = ir.VectorType(ir.IntType(64), LANES)
        without_sign = builder.and_(builder.bitcast(values[0], bits), ir.Constant(bits, [2**63 - 1] * LANES))
        return builder.bitcast(without_sign, vector)

    @intrinsic
    def gathered(typing: Any, one: Any, two: Any, three: Any, four: Any) -> Any:
        def make(context: Any, builder: Any, call: Any, values: Any) -> Any:
            found = ir.Constant(vector, ir.Undefined)
            for lane, value in enumerate(values):
                found = builder.insert_element(found, value, ir.Constant(ir.IntType(32), lane))
            return found

        return number(one, two, three, four), make

    @overload(side_by_side, strict=False)
    def gathered_numbers(one: Any, two: Any, three: Any, four: Any) -> Any:
        return lambda one, two, three, four: gathered(one, two, three, four)

    @intrinsic
    def summed(typing: Any, value: Any) -> Any:
        def make(context: Any, builder: Any, call: Any, values: Any) -> Any:
            one, two, three, four = (
                builder.extract_element(values[0], ir.Constant(ir.IntType(32), lane)) for lane in range(LANES)
            )
            return builder.fadd(builder.fadd(one, two), builder.fadd(three, four))

        return types.float64(value), make

    @overload(sum_of, strict=False)
    def sum_of_number(number: Any) -> Any:
        return (lambda number: summed(number)) if isinstance(number, WideNumber) else None

    @intrinsic
    def all_zero(typing: Any, value: Any) -> Any:
        def ask(context: Any, builder: Any, call: Any, values: Any) -> Any:
            equal = builder.fcmp_ordered("==", values[0], ir.Constant(vector, [0.0] * LANES))
            bits = builder.bitcast(equal, ir.IntType(LANES))
            return builder.icmp_unsigned("==", bits, ir.Constant(ir.IntType(LANES), (1 << LANES) - 1))

        return types.boolean(value), ask

    @overload(is_zero, strict=False)
    def zero_number(number: Any) -> Any:
        if isinstance(number, types.Float):
            return lambda number: number == 0.0
        return (lambda number: all_zero(number)) if isinstance(number, WideNumber) else None


if COMPILED:
    _declare()
