"""Chains of one to a thousand links are right to the last digits."""

from __future__ import annotations

import pytest

from tests.core.test_links import error_of_chains, right_to_the_last_digits


@pytest.mark.acceptance
def test_up_to_two_hundred_links() -> None:
    right_to_the_last_digits((1, 8), 200)


@pytest.mark.acceptance
def test_a_thousand_links() -> None:
    assert error_of_chains(1000) < 2e-15
