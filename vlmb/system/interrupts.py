"""Ctrl-C and its like while something must not be torn: noted, and answered at the next place where nothing can be lost.

A run holds them back from its first line to its finished trajectory, and asks between the stages of its start, after every slice
of some hundredths of a second and before it calls a user's control: compiled code and its compiler do not bear exceptions that
come from nowhere. Handlers that a program has set itself stay as they are.
"""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from _signal import default_int_handler, getsignal  # type: ignore[import-not-found]  # `signal` looks up a name for every answer
from _signal import signal as handle
from collections.abc import Iterator
from types import FrameType

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
PATIENCE = 2.0  # [s] an interrupt may stay unanswered before another one goes through at once

_depth = 0  # of holds, one within another
_since: float | None = None  # when the interrupt came that waits


@contextlib.contextmanager
def held() -> Iterator[None]:
    """Hold interrupts back; `asked` tells whether one came. It is forgotten where the outermost hold ends.

    Of the signals those are held that would raise KeyboardInterrupt.
    """
    global _depth
    if not _own():
        yield
        return
    depth = _depth
    ours = [number for number in SIGNALS if getsignal(number) is default_int_handler]
    try:
        _depth = depth + 1
        for number in ours:
            handle(number, _note)
        yield
    finally:
        try:
            if ours:
                _forget()
            for number in ours:
                handle(number, default_int_handler)
        finally:
            _depth = depth


def asked() -> bool:
    """Whether an interrupt waits. Only the thread that gets signals is asked."""
    return _since is not None and _own()


def answer() -> None:
    """Raise KeyboardInterrupt if an interrupt waits. It goes on waiting, for runs around this one."""
    if asked():
        raise KeyboardInterrupt


def _own() -> bool:
    return threading.current_thread() is threading.main_thread()


def _forget() -> None:
    global _since
    _since = None


def _note(number: int, frame: FrameType | None) -> None:
    """Note an interrupt, or raise it: where nothing is held back, and where one has waited for long."""
    global _since
    if not _depth or (_since is not None and time.monotonic() - _since > PATIENCE):
        raise KeyboardInterrupt
    if _since is None:
        _since = time.monotonic()
