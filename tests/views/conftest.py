"""Runs that are looked at, and the browser that looks."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import vlmb
from tests.views.browser import Browser, find_browser
from tests.views.scenes import MODELS, SKIER, TREE


@pytest.fixture(scope="session")
def skier() -> vlmb.Trajectory:
    """A skier of one link, half a second."""
    return vlmb.simulate(vlmb.Scene.from_dict(SKIER))


@pytest.fixture(scope="session")
def tree() -> vlmb.Trajectory:
    """A flying trunk with two arms, half a second."""
    return vlmb.simulate(vlmb.Scene.from_dict(TREE))


@pytest.fixture(scope="session")
def slalom() -> vlmb.Trajectory:
    """A controlled skier of one link."""
    return vlmb.simulate(MODELS / "skier_slalom.toml", duration=1.5)


@pytest.fixture(scope="session")
def whole() -> vlmb.Trajectory:
    """A controlled skier with a whole body."""
    return vlmb.simulate(MODELS / "skier_slalom_whole_body.toml", duration=0.5)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A Chromium without a screen; tests that need it are skipped where there is none."""
    if find_browser() is None:
        pytest.skip("no Chromium is installed (Debian: apt install chromium), so no page can be looked at")
    try:
        made = Browser()
    except (RuntimeError, OSError) as error:
        pytest.skip(f"the Chromium here does not start ({error}), so no page can be looked at")
    with made:
        yield made
