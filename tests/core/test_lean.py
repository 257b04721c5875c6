"""How the core is compiled: what is another meanwhile is there in this numba, and is as it was afterwards."""

import numpy as np
import pytest

from vlmb.core import jit
from vlmb.core.lean import _changes, _hash, _is_equal, lean

pytestmark = pytest.mark.skipif(not jit.COMPILED, reason="nothing is compiled")


def test_all_that_is_changed_is_there_and_comes_back() -> None:
    changes = list(_changes())
    before = [vars(owner)[name] for owner, name, _ in changes]
    with lean():
        meanwhile = [vars(owner)[name] for owner, name, _ in changes]
    assert all(one is not other for one, other in zip(meanwhile, before, strict=True))
    assert [vars(owner)[name] for owner, name, _ in changes] == before


def test_options_are_compared_and_hashed_as_numba_does() -> None:
    from numba.core.compiler import Flags

    usual, said, other = Flags(), Flags(), Flags()
    said.no_cpython_wrapper, other.boundscheck = Flags.options["no_cpython_wrapper"].default, True
    for one in (usual, said, other):
        assert _hash(one) == hash(one)
        for two in (usual, said, other):
            assert _is_equal(one, two) == (one == two)
            assert (_hash(one) == _hash(two)) or one != two
    assert _is_equal(usual, said) and not _is_equal(said, other)
    assert _is_equal(usual, 1) is NotImplemented


def test_text_put_into_two_kernels_and_twice_into_one_stays_its_own() -> None:
    @jit.kernel(copied=True)
    def part(values: np.ndarray, i: int) -> np.ndarray:
        total = 0.0
        for value in values[i:]:
            total += value
        values[i] = total
        return values[i:]

    @jit.kernel
    def twice(values: np.ndarray) -> float:
        return float(part(part(values, 1), 1)[0])

    @jit.kernel
    def once(values: np.ndarray) -> float:
        return float(part(values, 0)[0])

    assert twice(np.arange(4.0)) == 5.0  # 0 1 2 3: 0 6 2 3, and of 6 2 3: 6 5 3
    assert once(np.arange(4.0)) == 6.0


def test_what_only_kernels_call_is_called_by_two_of_them() -> None:
    @jit.inner
    def part(x: float) -> float:
        return 2.0 * x

    @jit.kernel
    def first(x: float) -> float:
        return part(x) + 1.0

    @jit.kernel
    def second(x: float) -> float:
        return part(part(x))

    assert first(3.0) == 7.0 and second(3.0) == 12.0
