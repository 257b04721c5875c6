"""Ctrl-C and SIGTERM: from the first sample to the last file nothing is lost, and no earlier result is damaged."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.interrupting import (
    PACKAGE,
    PHASED,
    SHORT,
    interrupted_at,
    last_passes,
    lines_of,
    moments,
    require_kept,
    signalled,
    usual_signals,
)
from tests.small_scenes import PIVOT, SKI, bent, write_toml
from vlmb.cli import main, models
from vlmb.system import interrupts

COMMAND = ["run", "short.toml", "--no-plots", "--quiet", "-o", "out"]
STRIDE = 32  # of the lines that are tried here; all of them in scripts/acceptance


@pytest.fixture
def out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Path:
    """A folder with a scene and an earlier result."""
    monkeypatch.chdir(tmp_path)
    write_toml(tmp_path / "short.toml", SHORT)
    assert main([*COMMAND, "--duration", "0.1"]) == 0
    capsys.readouterr()
    return tmp_path / "out"


def own(lines: list[tuple[str, int]]) -> list[int]:
    """Numbers of the lines that begin and end a command."""
    names = [file.removeprefix(PACKAGE) for file, _ in lines]
    return [at for at, name in enumerate(names, 1) if name.startswith("cli/") or name == "simulation/keeping.py"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # a file that was being opened
@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM], ids=["SIGINT", "SIGTERM"])
def test_an_interrupt_at_any_line_of_a_run(first: int, sent: int, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    earlier = (out / "run.npz").read_bytes()
    lines = lines_of(COMMAND)
    kept = 0
    for number in last_passes(lines)[8 * first + 4 * (sent == signal.SIGTERM) :: STRIDE]:
        (out / "run.npz").write_bytes(earlier)
        try:
            outcome = interrupted_at(number, COMMAND, capsys, sent)
        except KeyboardInterrupt:  # before the command has begun to look for it, or after it is done
            assert number in own(lines), lines[number - 1]
            vlmb.load_trajectory(out / "run.npz")
            continue
        require_kept(out, earlier, outcome)
        kept += outcome.under_way
    assert kept > 5  # so many runs were interrupted after their first sample


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_at_lines_of_a_run_in_phases(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_toml(out.parent / "short.toml", PHASED)
    earlier, lines, kept = (out / "run.npz").read_bytes(), lines_of(COMMAND), 0
    for number in last_passes(lines)[5::100]:
        (out / "run.npz").write_bytes(earlier)
        try:
            outcome = interrupted_at(number, COMMAND, capsys)
        except KeyboardInterrupt:
            assert number in own(lines), lines[number - 1]
            continue
        require_kept(out, earlier, outcome)
        kept += outcome.under_way
    assert kept > 10


@pytest.mark.parametrize("number", range(6))
def test_a_signal_at_any_moment(number: int, tmp_path: Path) -> None:
    """Readable files with all samples so far; before the first sample a message, and the earlier result whole."""
    sent, after = moments(6)[number]
    (tmp_path / "out").mkdir()
    earlier = vlmb.simulate(bent(PIVOT, 1), duration=0.1).save(tmp_path / "out" / "run.npz").read_bytes()
    process, stdout, stderr = signalled(tmp_path, sent, after)
    now = (tmp_path / "out" / "run.npz").read_bytes()
    run = vlmb.load_trajectory(tmp_path / "out" / "run.npz")
    assert not list((tmp_path / "out").glob(".vlmb-*"))
    if now != earlier:
        assert run.scene.name == "slow" and run.status == "interrupted" and process.returncode == 1
        assert "interrupted at t =" in stdout and (tmp_path / "out" / "run.csv").exists()
        assert len(run) > 0.9 * 1000 * run.t[-1] / 40.0
    elif "in main" in stderr or "vlmb run" in stderr:
        assert "interrupted; earlier results are as they were" in stderr and "Traceback" not in stderr
    else:  # Python itself was ended before vlmb began, maybe within the import of a compiled module
        assert process.returncode in (-sent, 130) or (process.returncode == 1 and "KeyboardInterrupt" in stderr)


def test_an_interrupt_within_an_import_is_told(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def lazily(args: Any) -> int:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as signalled:
            raise error from signalled

    monkeypatch.setattr(models, "execute", lazily)
    error: Exception = ImportError("initialization failed")
    assert main(["models"]) == 1 and "vlmb models: interrupted" in capsys.readouterr().err
    error = ValueError("a mistake, not an interrupt")
    with pytest.raises(ValueError, match="a mistake"):
        main(["models"])


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_an_interrupt_within_a_slow_control_is_answered_before_the_next_call(engine: str) -> None:
    calls: list[float] = []

    def control(t: float, view: Any) -> dict[str, float]:
        calls.append(t)
        if len(calls) == 60:
            signal.raise_signal(signal.SIGINT)
        return {"M_psi1": 0.1}

    with usual_signals():
        run = vlmb.simulate(bent(PIVOT, 1), duration=5.0, control=control, engine=engine)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert run.status == "interrupted" and len(calls) == 60 and 0 < len(run) < 200
    assert np.isfinite(run.controls["M_psi1"][:-1]).all()


def test_an_interrupt_within_a_compiled_method_is_no_system_error() -> None:
    """Sent to the process by another thread: it comes while Pinocchio computes, where an exception would be one of C's."""
    found = []
    with usual_signals():
        for number in range(8):
            timer = threading.Timer(0.01 + 0.005 * number, os.kill, (os.getpid(), signal.SIGINT))
            timer.start()
            found.append(vlmb.simulate(bent(PIVOT, 3), duration=60.0, engine="pinocchio"))
            timer.join()
    assert {run.status for run in found} == {"interrupted"} and all(np.isfinite(run["psi1"]).all() for run in found)


def test_an_interrupt_of_a_run_within_a_control_ends_both() -> None:
    inner: list[vlmb.Trajectory] = []

    def control(t: float, view: Any) -> dict[str, float]:
        if t > 0.1 and not inner:
            inner.append(vlmb.simulate(bent(PIVOT, 1), duration=0.3, progress=lambda at: signal.raise_signal(signal.SIGINT)))
        return {"M_psi1": 0.1}

    with usual_signals():
        run = vlmb.simulate(bent(PIVOT, 1), duration=1.0, control=control)
    assert run.status == "interrupted" and 0.05 < run.t[-1] < 0.3
    assert inner[0].status in ("interrupted", "finished")


def test_whoever_asks_again_after_two_seconds_is_answered_at_once() -> None:
    with usual_signals(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(interrupts, "PATIENCE", 0.05)
        reached = []
        with pytest.raises(KeyboardInterrupt), interrupts.held():  # noqa: PT012
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            reached.append("nothing yet")
            time.sleep(0.1)
            signal.raise_signal(signal.SIGINT)
        assert reached and not interrupts.asked()


def test_handlers_of_others_stay() -> None:
    seen: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    try:
        run = vlmb.simulate(bent(PIVOT, 1), duration=0.2, progress=lambda t: signal.raise_signal(signal.SIGINT))
        assert run.status == "finished" and len(seen) > 100
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        run = vlmb.simulate(bent(PIVOT, 1), duration=0.2, progress=lambda t: signal.raise_signal(signal.SIGINT))
        assert run.status == "finished"
    finally:
        signal.signal(signal.SIGINT, before)


def test_what_cannot_be_looked_through_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> tuple[str, ...]:
        raise MemoryError("no room")

    monkeypatch.setattr("vlmb.simulation.trajectory.doubts_of", broken)
    run = vlmb.simulate(bent(PIVOT, 1), duration=0.2)
    assert run.status == "finished" and len(run) == 201
    assert run.doubts == ("the run could not be looked through: MemoryError: no room",)


def test_an_error_of_the_terminal_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Gone:
        """A terminal that was closed."""

        def isatty(self) -> bool:
            return True

        def write(self, text: str) -> int:
            raise OSError(5, "Input/output error")

        def flush(self) -> None:
            raise OSError(5, "Input/output error")

    monkeypatch.chdir(tmp_path)
    write_toml(tmp_path / "short.toml", SHORT)
    monkeypatch.setattr(sys, "stderr", Gone())
    assert main(["run", "short.toml", "--no-plots", "-o", "out"]) == 0
    assert len(vlmb.load_trajectory(tmp_path / "out" / "run.npz")) == 201


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("call", [3, 100, 333])
def test_the_forces_of_an_interrupted_control_are_those_that_acted_or_nan(call: int, engine: str) -> None:
    """Never 0: controls, power and reactions are not known at the same samples, and the message says so."""
    calls: list[float] = []

    def control(t: float, view: Any) -> dict[str, float]:
        calls.append(t)
        if len(calls) == call:
            signal.raise_signal(signal.SIGINT)
        return {"M_psi1": 1.0 + t}

    with usual_signals():
        run = vlmb.simulate(bent(SKI, 1), duration=5.0, control=control, engine=engine, t_eval=np.linspace(0.0, 5.0, 1001))
    unknown = np.isnan(run.controls["M_psi1"])
    np.testing.assert_allclose(run.controls["M_psi1"][~unknown], 1.0 + run.t[~unknown], rtol=1e-12)
    for values in (run.reactions["knife_edge"], run.power("M_psi1"), run.hinge_force("link1")[:, 0]):
        assert np.array_equal(np.isnan(values), unknown)
    assert run.status == "interrupted" and unknown.any() == ("not known" in run.message)
