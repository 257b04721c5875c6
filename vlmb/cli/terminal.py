"""The terminal that a command is given on and prints to: options that swallow files; any alphabet, or none at all."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TextIO, cast

from vlmb.errors import nearest


class Steady:
    """A stream for messages: where its terminal is gone nothing is written, and what is told there goes on."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write a text if it can be written."""
        with contextlib.suppress(OSError, ValueError):
            self.stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Send what was written on its way."""
        with contextlib.suppress(OSError, ValueError):
            self.stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextlib.contextmanager
def printable() -> Iterator[None]:
    """Let every text be printed: what a terminal has no letter for as its number, and nothing where a stream is closed.

    Files that are opened later must not become the output of this process: closed streams lead nowhere.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    before = sys.stdout, sys.stderr
    with contextlib.ExitStack() as stack:
        for name, stream in zip(("stdout", "stderr"), before, strict=True):
            if stream is None:
                setattr(sys, name, stack.enter_context(Path(os.devnull).open("w", encoding="utf-8")))
            elif isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
                stream.reconfigure(errors="backslashreplace")
                stack.callback(stream.reconfigure, errors="strict")
        sys.stderr = cast(TextIO, Steady(sys.stderr))
        try:
            yield
        finally:
            sys.stdout, sys.stderr = before


def parsed(parser: argparse.ArgumentParser, arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read a command line: options of many names leave files to their command, and a wrong option names the nearest one."""
    args, others = parser.parse_known_args(arguments)
    own = parser.commands[args.command]  # type: ignore[attr-defined]
    if others:
        known = [option for action in own._actions for option in action.option_strings]
        hints = [nearest(entry.partition("=")[0], known) for entry in others if entry.startswith("-")]
        own.error(f"unrecognized arguments: {' '.join(others)}" + "".join(f"; {hint}" for hint in hints[:1]))
    if args.settle is not None:
        args.settle(args, own)
    return args


def apart(files: list[str], names: list[str] | None) -> tuple[list[str], list[str] | None]:
    """Take files out of a list of names that swallowed them."""
    swallowed = [entry for entry in names or [] if "=" not in entry and Path(entry).suffix in (".npz", ".toml")]
    return files + swallowed, names and [entry for entry in names if entry not in swallowed]
