"""A thousand random problems of contacts beside Pinocchio's solver."""

from __future__ import annotations

import pytest

from tests.system.test_cone import random_problems


@pytest.mark.acceptance
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_random_problems(count: int) -> None:
    random_problems(count, 250)
