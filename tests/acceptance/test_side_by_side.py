"""Sixteen runs in as many processes give what they give alone, bit for bit."""

from __future__ import annotations

import pytest

from tests.simulation.test_side_by_side import MANY, in_processes, one


@pytest.mark.acceptance
def test_sixteen_processes() -> None:
    assert in_processes(MANY, [one(number) for number in range(MANY)]) == []
