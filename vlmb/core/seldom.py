"""What a compiler cannot know of branches: which ones few scenes take.

The code of a run is several times as large as what a processor keeps at hand. What is marked stands apart from what every scene
plays, so that the latter lies close together.
"""

from __future__ import annotations

from typing import Any

from vlmb.core.jit import COMPILED


def seldom() -> None:
    """Say that few scenes, or few steps, come by here; does nothing else."""


def _declare() -> None:
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic, overload

    @intrinsic
    def cold(typing: Any) -> Any:
        def mark(context: Any, builder: Any, call: Any, values: Any) -> Any:
            nothing = ir.InlineAsm(ir.FunctionType(ir.VoidType(), []), "", "", side_effect=True)
            set.add(builder.call(nothing, []).attributes, "cold")  # llvmlite's own list of attributes lacks it
            return context.get_dummy_value()

        return types.none(), mark

    @overload(seldom, strict=False)
    def marked() -> Any:
        return lambda: cold()


if COMPILED:
    _declare()
