"""What acceptance tests share: the folder for their tables. All of them are slow."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def results(pytestconfig: pytest.Config) -> Path:
    """Folder for tables, by default results/acceptance; `--results` names another one."""
    return pytestconfig.rootpath / str(pytestconfig.getoption("--results"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let `-m "not slow"`, which replaces the project's `-m "not acceptance"`, leave out acceptance tests too."""
    for item in items:
        if item.get_closest_marker("acceptance"):
            item.add_marker("slow")
