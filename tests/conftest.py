"""What all tests share."""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Say where acceptance tests put their tables."""
    parser.addoption("--results", default="results/acceptance", help="folder for the tables of acceptance tests")
