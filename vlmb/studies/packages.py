"""Packages that studies need and a run does not."""

from __future__ import annotations

import importlib
from typing import Any

from vlmb.errors import StudyError


def need(name: str) -> Any:
    """Import a package of the extra `studies`. Raises StudyError where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise StudyError(f"this needs {name}, which is not installed: pip install vlmb[studies]") from None
