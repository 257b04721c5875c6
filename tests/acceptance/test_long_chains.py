"""Chains of a thousand links are right to the last digits."""

from __future__ import annotations

import pytest

from tests.core.test_links import error_of_chains


@pytest.mark.acceptance
def test_a_thousand_links() -> None:
    assert error_of_chains(1000) < 2e-15
