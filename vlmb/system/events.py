"""What is looked for along a run: limits of lengths, points on the snow, switches of laws, lines that swap, dependent rows."""

from __future__ import annotations

from typing import NamedTuple

LIMIT, FALL, SWITCH, LINE_UP, DEPENDENT, QUIET, GRIP = range(7)  # kinds of events; QUIET never happens; GRIP: a ski stops, slips
FALLING, BOTH_WAYS, RISING = -1.0, 0.0, 1.0
IN_LINE = 1e-6  # sine of an angle below which two directions line up


class Event(NamedTuple):
    """Something that is looked for: what it is, the way its indicator crosses zero, and the sentence of a run that it ends."""

    kind: int
    direction: float
    name: str
    sentence: str
    which: int = -1  # of a line-up: the spring between points whose ends meet

    @property
    def ends(self) -> bool:
        """Whether it ends a run wherever it happens: a limit, or a fall."""
        return self.kind in (LIMIT, FALL)
