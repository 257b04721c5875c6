"""How the core is compiled: by numba, without what costs time here and gives nothing."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any


@contextlib.contextmanager
def lean() -> Iterator[None]:
    """Compile without what makes code longer and slower here; numba's lock is to be held, as it reads all this meanwhile.

    What a numba has under no such name stays as it is.
    """
    with contextlib.ExitStack() as stack:
        for owner, name, value in _changes():
            if name in vars(owner):
                stack.callback(setattr, owner, name, vars(owner)[name])
                setattr(owner, name, value)
        yield


def _changes() -> Iterator[tuple[Any, str, Any]]:
    """Name what is another while the core is compiled: where, its name, its value."""
    import numba
    from numba.core import codegen, inline_closurecall, targetconfig
    from numba.cpython import slicing
    from numba.np import arrayobj

    yield numba.config, "LOOP_VECTORIZE", 0  # loops here are short: vectorized they take a fifth more of the compiling
    yield arrayobj, "fix_integer_index", _index
    yield slicing, "fix_slice", _end
    yield inline_closurecall.InlineWorker, "inline_function", _inline
    yield targetconfig.TargetConfig, "__hash__", _hash
    yield targetconfig.TargetConfig, "__eq__", _is_equal
    library, compiler = codegen.CPUCodeLibrary, codegen.JITCPUCodegen
    yield library, "_finalize_final_module", _finished(library._finalize_final_module)
    yield compiler, "set_env", _with_environment(compiler.set_env)


def _index(context: Any, builder: Any, kind: Any, index: Any, _: Any) -> Any:
    """Take an index as it is: kernels count from 0 on.

    numba, which cannot know that, adds the length of an axis to every index below 0. The mode with checks of bounds finds those.
    """
    from numba.core import types

    return context.cast(builder, index, kind, types.intp)


def _end(builder: Any, part: Any, length: Any) -> None:
    """Let a part of an array end where the array does, as one without a named end does."""
    part.stop = builder.select(builder.icmp_signed("<", part.stop, length), part.stop, length)


def _inline(worker: Any, caller: Any, block: Any, i: int, function: Any, arg_typs: Any = None) -> Any:
    """Put a kernel's text into another's.

    numba copies that text twice, and with every block of it the names of the whole: a sixth of all compiling. Here it is made
    for this one place.
    """
    from numba.core import inline_closurecall

    text = worker.run_untyped_passes(function)
    before = inline_closurecall.copy
    inline_closurecall.copy = SimpleNamespace(deepcopy=lambda part: part)
    try:
        return worker.inline_ir(caller, block, i, text, function.__code__.co_freevars, arg_typs=arg_typs)
    finally:
        inline_closurecall.copy = before


@functools.cache
def _hash_of(kind: Any) -> int:
    return hash(tuple(sorted(kind.options)))


def _hash(flags: Any) -> int:
    """Hash a kernel's options by their names, as numba does, which sorts them anew whenever it looks for a function."""
    return _hash_of(flags.__class__)


def _is_equal(flags: Any, others: Any) -> Any:
    """Compare options that are set; numba asks for all of them, each by a function of its own."""
    if not isinstance(others, type(flags)) or flags.options is not others.options:
        return NotImplemented
    ours, theirs, options = flags._values, others._values, flags.options
    for name in {**ours, **theirs}:
        usual = options[name].default
        if ours.get(name, usual) != theirs.get(name, usual):
            return False
    return True


def _is_part(library: Any) -> bool:
    """Say whether a library is one that only kernels call, compiled now: they hold its code themselves.

    A kernel that is loaded for a part of another one comes with its machine code.
    """
    from numba.core.targetconfig import ConfigStack

    loaded = getattr(library, "_compiled_object", library) is not None
    return not loaded and getattr(ConfigStack.top_or_none(), "no_cpython_wrapper", False) is True


def _finished(finish: Callable[[Any], None]) -> Callable[[Any], None]:
    def finish_library(library: Any) -> None:
        """Write machine code for kernels; of their parts numba needs no more than the text."""
        if _is_part(library):
            library._finalize_dynamic_globals()
            library._verify_declare_only_symbols()
            library._finalized = True
        else:
            finish(library)

    return finish_library


def _with_environment(set_environment: Callable[[Any, str, Any], None]) -> Callable[[Any, str, Any], None]:
    def set_if_there(compiler: Any, name: str, environment: Any) -> None:
        """Tell machine code where its environment is, if there is machine code."""
        if compiler._engine.get_global_value_address(name):
            set_environment(compiler, name, environment)

    return set_if_there
