"""Measured data as functions of time: a smoothing spline through each column, and what is known of how good it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vlmb.core import series
from vlmb.errors import SceneError
from vlmb.model.smoothing import FEWEST, Smooth, evaluate, smoothed
from vlmb.scene.scene import Scene
from vlmb.scene.tables import Column, Data, Smoothing
from vlmb.scene.tables import Smooth as Wanted

Array = NDArray[np.float64]

ENDINGS = ("", "_dot", "_ddot")  # of the names of a column: its value and two derivatives
HOLE = 1.5  # of the usual spacing: a longer one is a hole
KEPT = 8  # scenes whose curves are remembered


@dataclass(frozen=True, eq=False)
class Signal:
    """A column of measured data as a curve."""

    name: str  # mocap.knee
    unit: str
    time: Array = field(repr=False)  # (N,) [s] of its samples
    samples: Array = field(repr=False)
    curve: Smooth = field(repr=False)
    smooth: str  # how it was smoothed, in words
    holes: tuple[tuple[float, float], ...]  # [s] from, to

    @property
    def span(self) -> tuple[float, float]:
        """The times [s] of its first and last sample."""
        return float(self.time[0]), float(self.time[-1])

    @property
    def ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The times [s] near both ends where derivatives rest on samples of one side."""
        (begin, end), reach = self.span, self.curve.reach
        return (begin, begin + reach), (end - reach, end)

    @property
    def report(self) -> str:
        """What was measured, how far the curve leaves it, how fast it turns, and where it is not to be trusted."""
        (begin, end), count, unit = self.span, len(self.time), f" {self.unit}" if self.unit else ""
        rate = 1.0 / float(np.median(np.diff(self.time)))
        acceleration = np.abs(self.values(self.time, 2))
        parts = [f"{self.name}: {count} samples from {begin:.6g} to {end:.6g} s, about {rate:.4g} Hz"]
        if self.holes:
            longest = max(self.holes, key=lambda hole: hole[1] - hole[0])
            many = f"{len(self.holes)} hole{'s' * (len(self.holes) > 1)} bridged, the longest"
            parts.append(f"{many} from {longest[0]:.6g} to {longest[1]:.6g} s")
        parts.append(f"{self.smooth}: residual {self.curve.residual:.3g}{unit} rms")
        parts.append(f"acceleration up to {acceleration.max():.4g}{unit}/s^2, {np.sqrt(np.mean(acceleration**2)):.4g} rms")
        parts.append(f"its ends, {self.curve.reach:.2g} s each, rest on samples of one side: accelerations are doubtful there")
        return "; ".join(parts)

    def values(self, times: Array, order: int = 0) -> Array:
        """Return the curve or a derivative of it (N,) at times (N,); nan outside the data."""
        total = evaluate(self.curve.pieces, times, order)
        slack = series.SLACK * (self.span[1] - self.span[0])
        return np.where((times < self.span[0] - slack) | (times > self.span[1] + slack), np.nan, total)


@dataclass(frozen=True, eq=False)
class Signals(Mapping[str, int]):
    """The measured data of a scene: what each name is to a tape, 3 k + n for derivative n of column k."""

    columns: tuple[Signal, ...] = ()
    places: Mapping[str, int] = field(default_factory=dict)

    @property
    def pieces(self) -> Sequence[Array]:
        """The polynomials of every column."""
        return [column.curve.pieces for column in self.columns]

    def __getitem__(self, name: str) -> int:
        return self.places[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.places)

    def __len__(self) -> int:
        return len(self.places)

    def unit(self, name: str) -> str:
        """Return the unit of a name."""
        k, order = divmod(self.places[name], 3)
        unit = self.columns[k].unit
        return unit if not order else f"{unit or '1'}/s{'^2' * (order == 2)}"

    def along(self, name: str, times: Array) -> Array:
        """Return what a name is (N,) at times (N,); nan outside the data."""
        k, order = divmod(self.places[name], 3)
        return self.columns[k].values(times, order)

    def at(self, names: Iterable[str], t: float) -> dict[str, float]:
        """Return what names are at a time, of the nearest one where it lies outside the data."""
        found = {}
        for name in self.places.keys() & set(names):
            k, order = divmod(self.places[name], 3)
            begin, end = self.columns[k].span
            found[name] = float(self.columns[k].values(np.array([min(max(t, begin), end)]), order)[0])
        return found

    def reach(self, text: str) -> str:
        """Say how far the data reach that a law or an equation names: beyond, they have no value."""
        named = [column for column in self.columns if column.name in text]
        return "".join(f"; {column.name} has data from {column.span[0]:.6g} to {column.span[1]:.6g} s" for column in named)

    def read_by(self, names: Iterable[str]) -> tuple[Signal, ...]:
        """Return the columns that names are read of."""
        return tuple(self.columns[k] for k in sorted({self.places[name] // 3 for name in names if name in self.places}))


NONE = Signals()
_known: dict[int, tuple[tuple[Data, ...], Signals]] = {}


def signals_of(scene: Scene) -> Signals:
    """Return the measured data of a scene as curves. Raises SceneError for holes that are too long, and for too few samples."""
    if not scene.data:
        return NONE
    kept = _known.get(id(scene.data))
    if kept is None:
        columns = [_signal(data, name, f"data[{at}]") for at, data in enumerate(scene.data) for name in data.columns]
        places = {f"{column.name}{end}": 3 * k + n for k, column in enumerate(columns) for n, end in enumerate(ENDINGS)}
        kept = scene.data, Signals(tuple(columns), places)
        _known[id(scene.data)] = kept
        for old in list(_known)[:-KEPT]:
            _known.pop(old, None)
    return kept[1]


def _signal(data: Data, name: str, key: str) -> Signal:
    column = data.columns[name]
    assert isinstance(column, Column) and column.values is not None and isinstance(data.time, tuple)
    time, samples = np.array(data.time, float), np.array(column.values, float)
    there = ~np.isnan(samples)
    return make_signal(
        f"{data.name}.{name}", column.unit or "", time[there], samples[there],
        data.smooth if column.smooth is None else column.smooth, data.gap, f"{key}.columns.{name}",
    )  # fmt: skip


def make_signal(name: str, unit: str, time: Array, samples: Array, smooth: Wanted, gap: float, key: str) -> Signal:
    """Put a curve through samples (N,) at ascending times (N,). Raises SceneError naming `key`."""
    if len(time) < FEWEST:
        raise SceneError(f"{key}: {len(time)} samples; a curve with two derivatives needs {FEWEST} at least")
    spacing = np.diff(time)
    usual = float(np.median(spacing))
    holes = [(float(time[k]), float(time[k + 1])) for k in np.flatnonzero(spacing > HOLE * usual)]
    for begin, end in holes:
        if end - begin > gap * (1.0 + 1e-9):
            long = f"no sample from t = {begin:.6g} to {end:.6g} s, a hole of {end - begin:.3g} s"
            advice = "cut the data there, or raise `gap` if a curve across it may be trusted"
            raise SceneError(f"{key}: {long}: longer than gap = {gap:g} s; {advice}")
    sigma = smooth.sigma if isinstance(smooth, Smoothing) else 0.0 if smooth == "none" else None
    curve = _smoothed(time.tobytes(), samples.tobytes(), sigma)
    how = "through all samples" if sigma == 0.0 else "smoothed by cross-validation" if sigma is None else "smoothed by sigma"
    return Signal(name, unit, time, samples, curve, how, tuple(holes))


@lru_cache(maxsize=64)
def _smoothed(time: bytes, samples: bytes, sigma: float | None) -> Smooth:
    """Smooth samples, once."""
    return smoothed(np.frombuffer(time), np.frombuffer(samples), sigma)


def require_span(signals: Signals, names: Iterable[str], begin: float, end: float, what: str) -> None:
    """Raise SceneError where data that are named do not reach over a time [s]."""
    for column in signals.read_by(names):
        first, last = column.span
        slack = series.SLACK * (last - first)
        if begin < first - slack or end > last + slack:
            raise SceneError(
                f"{what} from t = {begin:.9g} to {end:.9g} s needs {column.name}, whose data reach from {first:.9g} to "
                f"{last:.9g} s; begin and end within (`simulate` has t0 and duration), or take something else there by `where`"
            )
