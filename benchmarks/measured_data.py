"""Measured data: how good accelerations of noisy recordings are, by how they are smoothed, and what reading and smoothing cost.

Usage: python benchmarks/measured_data.py

The recording is a wave of 1 Hz and 0.05 m with errors of 1 mm (normal, independent), 5 s long, with a hole from 2.3 to 2.44 s.
Beside the quintic spline stands the cubic smoothing spline of scipy, whose acceleration is 0 at both ends, as that of a sine is.
"""

from __future__ import annotations

from typing import Any

from common import interleaved, micro, table, write_report

# isort: split
import numpy as np
from scipy.interpolate import make_smoothing_spline

import vlmb
from vlmb.model.signals import make_signal
from vlmb.model.smoothing import smoothed
from vlmb.scene.tables import Smoothing

RECORDINGS = 50
ARM: dict[str, Any] = {
    "base": {"kind": "pivot"}, "plane": True, "links": [{"name": "arm", "rod": {"length": 1.0, "mass": 2.0}}],
    "start": {"psi1": -1.2}, "run": {"duration": 4.0, "samples": 100.0},
}  # fmt: skip


def rms(values: Any) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def recording(rate: float, phase: float, seed: int, seconds: float = 5.0) -> tuple[Any, Any]:
    """Return times and samples, without those in the hole."""
    t = np.arange(int(seconds * rate) + 1) / rate
    y = 0.05 * np.sin(2.0 * np.pi * t + phase) + 1e-3 * np.random.default_rng(seed).normal(size=len(t))
    kept = (t < 2.295) | (t > 2.445)
    return t[kept], y[kept]


def errors(rate: float, phase: float, smooth: Any) -> list[float]:
    """Median errors: acceleration everywhere, off the ends [m/s^2], place in the hole [m]."""
    times = np.linspace(0.0, 5.0, 2001)
    place, inner, hole = np.sin(2.0 * np.pi * times + phase), (times > 0.5) & (times < 4.5), (times > 2.29) & (times < 2.45)
    found = []
    for seed in range(RECORDINGS):
        t, y = recording(rate, phase, seed)
        if smooth == "cubic":
            spline = make_smoothing_spline(t, y)
            values, bends = spline(times), spline(times, 2)
        else:
            curve = make_signal("y", "m", t, y, smooth, 0.2, "y")
            values, bends = curve.values(times), curve.values(times, 2)
        off = bends + 0.05 * (2.0 * np.pi) ** 2 * place
        found.append([rms(off), rms(off[inner]), float(np.abs(values - 0.05 * place)[hole].max())])
    return [float(value) for value in np.median(found, axis=0)]


def inverse_errors() -> dict[str, float]:
    """Error of a torque of 6 N m by inverse dynamics over its rms, median and worst."""
    run = vlmb.simulate({**ARM, "forces": [{"on": "M_psi1", "law": "6*sin(4*t)"}]})
    wanted, shares = 6.0 * np.sin(4.0 * run.t), []
    for seed in range(RECORDINGS):
        seen = run["psi1"] + 2e-3 * np.random.default_rng(seed).normal(size=len(run.t))
        seen[150:165] = np.nan
        found = vlmb.inverse(ARM, {"time": run.t, "psi1": seen})
        off = np.interp(run.t, found.t, found.controls["M_psi1"]) - wanted
        shares.append(rms(off[30:-30]) / rms(wanted))
    return {"median": float(np.median(shares)), "worst": max(shares)}


def costs() -> dict[str, float]:
    """Seconds to smooth, by the number of samples."""
    found = {}
    for count in (100, 1_000, 10_000, 100_000):
        t, y = recording(1000.0, 0.0, 1, count / 1000.0)
        found[str(len(t))] = interleaved({"smooth": lambda t=t, y=y: smoothed(t, y)}, 3, 1)["smooth"]  # type: ignore[misc]
    return found


def evaluations() -> dict[str, float]:
    """Seconds of a right-hand side in a compiled run: a swing with a given length by formula, and by data."""
    mechanisms = {name: vlmb.build(f"models/{name}.toml") for name in ("pumping", "recorded_pumping")}
    count = {name: vlmb.simulate(made).stats["rhs_evaluations"] for name, made in mechanisms.items()}
    best = dict.fromkeys(mechanisms, np.inf)
    for _ in range(20):
        for name, made in mechanisms.items():
            best[name] = min(best[name], vlmb.simulate(made).stats["cpu_time"] / count[name])
    return {name: float(value) for name, value in best.items()}


def main() -> None:
    """Measure everything and write the report."""
    ways: dict[str, Any] = {
        "quintic, cross-validation (auto)": "auto", "quintic, sigma = 1 mm": Smoothing(sigma=1e-3),
        "quintic, through all samples (none)": "none", "cubic, cross-validation (scipy)": "cubic",
    }  # fmt: skip
    waves = {"sine, 100 Hz": (100.0, 0.0), "cosine, 100 Hz": (100.0, 0.5 * np.pi), "sine, 250 Hz": (250.0, 0.0)}
    accuracy = {wave: {name: errors(*of, smooth) for name, smooth in ways.items()} for wave, of in waves.items()}
    inverse, cost, speed = inverse_errors(), costs(), evaluations()
    rows = [
        (wave, name, f"{everywhere:.3g}", f"{inside:.3g}", f"{1e3 * hole:.2g}")
        for wave, entries in accuracy.items() for name, (everywhere, inside, hole) in entries.items()
    ]  # fmt: skip
    parts = [
        "# Measured data",
        "A wave of 1 Hz and 0.05 m (its acceleration is 1.4 m/s^2 rms) with errors of 1 mm, 15 samples missing at 100 Hz: median "
        f"of {RECORDINGS} recordings. A cubic spline has no acceleration at its ends, where a sine has none and a cosine the "
        "largest; for the cosine scipy's search for the best smoothing ends at a straight line.",
        table(("wave", "curve", "acceleration, m/s^2 rms", "0.5 s off the ends", "place in the hole, mm"), rows),
        "Inverse dynamics of an arm that a torque of 6 N m drives, angles to 2 mrad, 100 Hz, 15 samples missing: the torque is "
        f"off by {100 * inverse['median']:.1f} % rms in the median, {100 * inverse['worst']:.1f} % at worst.",
        table(("samples", "time to smooth, ms"), [(count, f"{1e3 * seconds:.3g}") for count, seconds in cost.items()]),
        f"A right-hand side of the pumped swing takes {micro(speed['pumping'])} us by its formula and "
        f"{micro(speed['recorded_pumping'])} us by its recording, in a run with all that runs do.",
    ]
    data = {"accuracy": accuracy, "inverse": inverse, "smoothing": cost, "evaluation": speed}
    write_report("measured_data", parts, data)


if __name__ == "__main__":
    main()
