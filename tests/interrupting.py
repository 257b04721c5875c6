"""Interrupts sent to `vlmb run`: at numbered lines of its code, and as signals to a process at any moment."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import pytest

import vlmb
from tests.small_scenes import PIVOT, Table, link, write_toml
from vlmb.cli import main
from vlmb.simulation.loop import Loop

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = str(ROOT / "vlmb") + os.sep
SHORT: Table = {
    "name": "short", "base": PIVOT, "links": [link("leg")], "start": {"psi1": 0.4, "phi1": 0.2},
    "run": {"duration": 0.2, "rtol": 1e-8, "samples": 10},
}  # fmt: skip
PHASED: Table = {
    "name": "short", "plane": True, "base": {"kind": "free", "mass": 1.0}, "start": {"z": 0.05, "x_dot": 0.5},
    "contacts": [{"point": "base", "friction": 0.3, "restitution": 0.5}],
    "run": {"duration": 0.15, "rtol": 1e-8, "samples": 10},
}  # fmt: skip
SLOW = SHORT | {"name": "slow", "run": {"duration": 40.0, "method": "rk4", "step": 1e-6, "samples": 1000}}


class Outcome(NamedTuple):
    """What became of a run that was interrupted."""

    under_way: bool  # steps had been taken
    code: int
    err: str


@contextlib.contextmanager
def usual_signals() -> Iterator[None]:
    """Handle SIGINT as a program in a terminal does, also where pytest runs in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def lines_of(arguments: list[str]) -> list[tuple[str, int]]:
    """Return the lines of vlmb that a command runs through, in their order: file and number."""
    found: list[tuple[str, int]] = []

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        if not frame.f_code.co_filename.startswith(PACKAGE):
            return None
        if event == "line":
            found.append((frame.f_code.co_filename, frame.f_lineno))
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        assert main(arguments) == 0
    finally:
        sys.settrace(before)
    return found


def last_passes(lines: list[tuple[str, int]]) -> list[int]:
    """Return where each line comes last."""
    return sorted({line: number for number, line in enumerate(lines, 1)}.values())


def interrupted_at(number: int, arguments: list[str], capsys: pytest.CaptureFixture[str], sent: int = signal.SIGINT) -> Outcome:
    """Run a command that gets a signal as it comes to the line of that number."""
    count, under_way, slice_of = 0, False, Loop._slice
    taken: list[bool] = []

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal count
        if not frame.f_code.co_filename.startswith(PACKAGE):
            return None
        if event == "line":
            count += 1
            if count == number:
                sys.settrace(None)
                if signal.getsignal(sent) is not signal.SIG_DFL:  # it would end this process, whatever vlmb does
                    taken.append(under_way)
                    signal.raise_signal(sent)
        return trace

    def noting(self: Loop) -> int:
        nonlocal under_way
        code = slice_of(self)
        under_way = True
        return code

    before = sys.gettrace()
    with usual_signals(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(Loop, "_slice", noting)
        sys.settrace(trace)
        try:
            code = main(arguments)
        finally:
            sys.settrace(before)
    return Outcome(taken == [True], code, capsys.readouterr().err)


def require_kept(folder: Path, earlier: bytes, outcome: Outcome) -> None:
    """Fail where a run was lost, an earlier result damaged, or something is left lying about."""
    now = (folder / "run.npz").read_bytes()
    run = vlmb.load_trajectory(folder / "run.npz")
    assert run.status in ("finished", "interrupted")
    assert not list(folder.glob(".vlmb-*"))
    if outcome.under_way:
        assert now != earlier and len(run) >= 1
    if now == earlier:
        assert outcome.code == 1 and "interrupted" in outcome.err and "Traceback" not in outcome.err


def signalled(folder: Path, sent: int, after: float) -> tuple[subprocess.Popen[str], str, str]:
    """Start a slowed `vlmb run` in a folder and send it a signal after some seconds [s]."""
    write_toml(folder / "slow.toml", SLOW)
    usual = "import signal as s, sys\ns.signal(s.SIGINT, s.default_int_handler)\ns.signal(s.SIGTERM, s.SIG_DFL)"
    program = f"{usual}\nfrom vlmb.cli import main\nsys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", program, "run", "slow.toml", "--no-plots", "--quiet", "-o", "out"]
    here = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(command, cwd=folder, env=here, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(after)
    process.send_signal(sent)
    out, err = process.communicate(timeout=60)
    return process, out, err


def moments(count: int, seed: int = 0) -> list[tuple[int, float]]:
    """Signals and when they are sent [s]: from before the first line to the middle of a run."""
    draw = random.Random(seed)
    return [((signal.SIGINT, signal.SIGTERM)[k % 2], draw.uniform(0.05, 2.5)) for k in range(count)]
