"""Ever smaller masses at a hinge between free segments: through a straight line each needs a passage of its own."""

from __future__ import annotations

import pytest

from tests.simulation.test_massless import SMALL, limit_of_small_masses


@pytest.mark.acceptance
@pytest.mark.parametrize("plane", [True, False], ids=["plane", "space"])
@pytest.mark.parametrize("small", [1e-4, 1e-5, SMALL])
def test_the_motion_is_the_limit_of_ever_smaller_masses(small: float, plane: bool) -> None:
    limit_of_small_masses("hinged", plane, small)
