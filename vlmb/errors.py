"""The errors of vlmb: each says what was found, where, what is allowed and what to do."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Any


class VlmbError(ValueError):
    """Base of all errors that vlmb raises on purpose."""


class SceneError(VlmbError):
    """A scene has a key, value or combination that is not allowed."""


class ExpressionError(SceneError):
    """An expression in a scene cannot be read, or has no finite value."""


class SingularError(VlmbError):
    """Equations cannot be solved: a singular mass matrix, dependent rows, a generalized force at its pole."""


class SimulationError(VlmbError):
    """A motion cannot be continued: a non-finite value, a step that collapses."""


class TrajectoryError(VlmbError):
    """A stored trajectory cannot be read, or does not have what was requested."""


class StudyError(VlmbError):
    """A study cannot be made or resumed: its folder holds another study, or the motion that is sought does not exist."""


class OutputError(VlmbError, OSError):
    """A file cannot be written; what was there before is unchanged."""


def nearest(name: str, valid: Iterable[str]) -> str:
    """Say which valid names come nearest to a wrong one, or list the valid ones when none is near."""
    names = [str(entry) for entry in valid]
    close = difflib.get_close_matches(str(name), names, n=3, cutoff=0.5)
    if close:
        return "did you mean " + " or ".join(repr(entry) for entry in close) + "?"
    shown = ", ".join(names[:40]) + (f", ... ({len(names)} in all)" if len(names) > 40 else "")
    return f"valid names: {shown or 'none'}"


def finite(what: str, value: Any) -> float:
    """Return a value as a float; SceneError where it is no finite number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise SceneError(f"{what} = {value!r}: must be a number") from None
    if not math.isfinite(number):
        raise SceneError(f"{what} = {number}: must be finite")
    return number
