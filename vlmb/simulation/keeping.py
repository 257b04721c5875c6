"""A run and its files as one: from the first sample to the last file nothing that comes from outside loses what was computed."""

from __future__ import annotations

import contextlib
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from vlmb.errors import OutputError, VlmbError
from vlmb.simulation.trajectory import Trajectory
from vlmb.system import interrupts

ENDINGS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


class Kept(NamedTuple):
    """A run that is on the disk."""

    trajectory: Trajectory
    written: list[Path]
    ended: bool  # it was asked to end, before or after its last sample
    said: tuple[str, ...]  # what could not be written, and where it is instead
    error: BaseException | None  # what went through the run


def keep(run: Callable[[], Trajectory], folder: Path) -> Kept:
    """Run, and write run.npz and run.csv into a folder; Ctrl-C ends the run and lets it be written, as do `ended_by_signals`.

    Raises KeyboardInterrupt where one comes before the first sample: nothing is written then.
    """
    with interrupts.held():
        error: Exception | None = None
        try:
            trajectory = run()
        except Exception as raised:
            found = getattr(raised, "trajectory", None)
            if not isinstance(found, Trajectory):
                raise
            trajectory, error = found, raised
        if trajectory.status == "interrupted" and trajectory.t[-1] <= trajectory.t0:
            raise KeyboardInterrupt
        written, said = _written(trajectory, folder)
        return Kept(trajectory, written, interrupts.asked() or trajectory.status == "interrupted", said, error)


def _written(trajectory: Trajectory, folder: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Save a run; where its folder takes nothing, in one for passing files."""
    try:
        written, said = [trajectory.save(folder / "run.npz")], []
    except OutputError as error:
        spare = Path(tempfile.mkdtemp(prefix="vlmb-")) / "run.npz"
        try:
            written = [trajectory.save(spare)]
        except OutputError as other:
            spare.parent.rmdir()
            raise OutputError(f"{error}; nor in another place: {other}") from None
        said = [f"{error}; this run is in {spare}"]
    try:
        written.append(trajectory.save_csv(folder / "run.csv"))
    except VlmbError as error:
        said.append(str(error))
    except KeyboardInterrupt:
        said.append(f"interrupted before {folder / 'run.csv'} was written; the run is in {written[0]}")
    return written, tuple(said)


@contextlib.contextmanager
def ended_by_signals() -> Iterator[None]:
    """Take what asks this process to end as Ctrl-C is taken; what a parent ignores stays ignored."""
    own = threading.current_thread() is threading.main_thread()
    ours = [number for number in ENDINGS if own and signal.getsignal(number) is signal.SIG_DFL]
    try:
        for number in ours:
            signal.signal(number, signal.default_int_handler)
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)
