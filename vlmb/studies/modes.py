"""Modes as motions: how a mechanism swings about a steady motion in one of its modes, as large as can be seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import StudyError, finite
from vlmb.model.arrays import pinocchio_states
from vlmb.model.mechanism import Mechanism
from vlmb.scene.names import listed
from vlmb.studies.chart import Chart

Array = NDArray[np.float64]

GROWS = 1e-8  # of the largest eigenvalue: a growth that is some
SIZE = 0.3  # [rad], or of a length: the largest deviation that is shown
TURNS, SAMPLES, USUAL = 3, 60, 2.0  # periods that are shown, samples in each, and how long one takes that does not swing [s]
SHORT, LONG = 0.2, 10.0  # [s] periods that are shown as they are
SLIGHT = 1e-6  # of a mode: what of it is none of postures


@dataclass(frozen=True, eq=False)
class Mode:
    """A mode as a motion about a steady posture, seen by who goes along: it neither grows nor decays, to first order.

    `vlmb.view.picture`, `play` and `export_html` take it: a picture has the steady posture, and paler both ends of the swing.
    `shape` are the deviations by name, the largest 1; q (N, nq), v (N, nv) are Pinocchio's at t (N,) [s]; `ends` (2, nq).
    """

    number: int
    value: complex
    label: str
    shape: dict[str, complex]
    mechanism: Mechanism
    t: Array
    q: Array
    v: Array
    ends: Array
    middle: Array  # (nq,)

    @property
    def told(self) -> str:
        """How it goes on, in words."""
        if self.label:
            return f"mode {self.number}: {self.label}"
        rate, turning = self.value.real, abs(self.value.imag)
        rate *= abs(rate) > GROWS * max(1.0, abs(self.value))
        grows = f"grows with {rate:.3g} 1/s" if rate > 0.0 else f"decays with {-rate:.3g} 1/s" if rate < 0.0 else "stays"
        return f"mode {self.number}: {grows}" + (f", swings with {turning:.3g} rad/s" if turning else "")

    def __repr__(self) -> str:
        largest = sorted(self.shape, key=lambda name: -abs(self.shape[name]))[:4]
        return f"<{self.told[0].upper()}{self.told[1:]}; most in {listed(largest)}>"


def mode_about(
    chart: Chart, directions: Array, number: int, value: complex, label: str, shape: dict[str, complex], size: float = SIZE
) -> Mode:
    """Return the motion of a mode about the origin of a chart, as large as `size` [rad], or of a length.

    directions : (n, m) how all numbers of the chart follow from the independent ones that `shape` names. Raises StudyError for
    a mode that moves no posture.
    """
    size, count = finite("size", size), len(chart.positions)
    every = directions @ np.array(list(shape.values()))
    moved = every[:count] * _weights(chart)
    if np.abs(moved).max(initial=0.0) <= SLIGHT * np.abs(every / chart.scales).max():
        names = listed([name for name, part in shape.items() if abs(part) > SLIGHT])
        raise StudyError(f"mode {number} moves no posture: it is one of {names} alone")
    turned = every[:count] * np.exp(-0.5j * np.angle((moved**2).sum())) * size / np.abs(moved).max()
    turning = abs(value.imag)
    period = math.tau / turning if turning and SHORT <= math.tau / turning <= LONG else USUAL
    angles = np.linspace(0.0, math.tau * TURNS, TURNS * SAMPLES + 1)
    x = chart.numbers(chart.origin)

    def placed(angle: float) -> Array:
        return chart.placed(x + np.append((turned * np.exp(1j * angle)).real, np.zeros(len(x) - count)))

    states = np.array([*map(placed, angles), placed(0.0), placed(math.pi), chart.placed(x)])
    q, v = pinocchio_states(chart.system.core_plan.postures(np.full(len(states), chart.t), states))
    t = period * angles / math.tau
    return Mode(number, value, label, shape, chart.system.mechanism, t, q[:-3], v[:-3], q[-3:-1], q[-1])


def _weights(chart: Chart) -> Array:
    """Return what deviations of positions are measured by: angles by how far they move a link, lengths by themselves."""
    found = 1.0 / chart.scales[: len(chart.positions)]
    for at, entry in enumerate(chart.positions):
        if entry.kind == "azimuth":
            found[at] = abs(math.cos(chart.elevation(entry.link)))
    return found
