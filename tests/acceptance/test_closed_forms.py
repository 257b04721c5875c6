"""Blocks of one to a hundred links beside the closed forms, at a hundred postures each."""

from __future__ import annotations

import pytest

from tests.equations.test_equations import check_against_closed_form, random_scene


@pytest.mark.acceptance
@pytest.mark.parametrize(("n", "postures"), [(1, 102), (2, 102), (3, 102), (5, 102), (10, 102), (20, 30), (50, 15)])
@pytest.mark.parametrize("tips", ["all", "last", "none"])
@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_blocks_equal_the_closed_forms(base: str, tips: str, n: int, postures: int) -> None:
    check_against_closed_form(random_scene(n, base, tips=tips), postures, seed=1)


@pytest.mark.acceptance
def test_a_hundred_links() -> None:
    check_against_closed_form(random_scene(100, "ski", fixed=0.8), 6, seed=4)
