"""What makes a run doubtful, in sentences: energy that does not add up, forces passed over, equations that do not hold.

A doubt is a contradiction in what was recorded. That there is none proves nothing: what acts between two samples and was never
asked for leaves no trace.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vlmb.scene.scene import Scene
from vlmb.scene.tables import DEFAULT_STEP, Run
from vlmb.simulation.histories import held_along, slopes_along
from vlmb.simulation.methods import find_method
from vlmb.simulation.motion import Motion
from vlmb.simulation.unseen import passed_between
from vlmb.system.pace import longest_steps
from vlmb.system.system import System

Array = NDArray[np.float64]

COARSE = 1e-2  # an error of this share is large, whatever was asked for
BEYOND = 1e4  # tolerances by which the error of a run grows at most; hard cases reach some hundreds
AT_REST = 1e-3  # of the other energies: the least kinetic energy that errors are compared with
AROUND = 6  # intervals around a sample that show how smooth a motion is
NEAR = 8  # samples before and after one that show how well slopes are known
OUTSTANDING = 50.0  # times the spread of the slopes around it


class Doubtful(Protocol):
    """A run that can be looked through."""

    def looked_through(self) -> tuple[str, ...]: ...  # noqa: D102


class Doubts:
    """The field of a run that looks it through when it is first asked for, unless it was given; by itself ()."""

    def __get__(self, run: Doubtful | None, kind: type | None = None) -> tuple[str, ...]:
        """Look through a run, once."""
        if run is None:
            return ()
        try:
            with np.errstate(all="ignore"):  # what is not finite is found and named
                found = run.looked_through()
        except Exception as error:  # the samples are there, whatever becomes of what is computed of them
            found = (f"the run could not be looked through: {type(error).__name__}: {error}",)
        run.__dict__["doubts"] = found
        return found

    @staticmethod
    def ask_later(run: Doubtful) -> None:
        """Have a run of now looked through when it is asked for its doubts."""
        del run.__dict__["doubts"]


def doubts_of(
    system: System, motion: Motion, inputs: Array, energies: Mapping[str, Array], turns: Collection[float] = ()
) -> tuple[str, ...]:
    """Return every doubt about the samples of a run.

    inputs (N, S): recorded forces from outside; energies (N,) by name; turns [s]: where the run began anew
    """
    run, written = system.run, system.forces.written
    own = {"t", *system.mechanism.scene.parameters, *system.mechanism.signals} if written else set()
    found = [*of_energy(energies, run), *of_steps(system.mechanism.scene, run, motion.t), *of_poles(system, motion)]
    seen = inputs.shape[1] or any(law.names - own for law in written)  # laws of time are looked through before
    if seen and not system.points:  # forces of contacts jump
        names = system.forces.inputs or ()
        found += of_slopes(motion.t, *slopes_along(system, motion, inputs), run, dict(zip(names, inputs.T, strict=True)))
    if not found and not system.points and find_method(run.method).adaptive:
        found += passed_between(system, motion, energies["kinetic"], share_allowed(run), turns)
    held = held_along(system, motion)
    return (*found, *(of_rows(held, largest(motion.coordinates[1]), run) if held else ()))


def of_poles(system: System, motion: Motion) -> list[str]:
    """Say where a link passed the vertical while an equation that is not taken in its regular form names its azimuth."""
    found, names, layout = [], system.mechanism.names, system.mechanism.layout
    for row in system.constraints.info if system.constraints else ():
        read = {names.find(name).name for name in row.names if name in names} if row.unbounded else set()
        for name in sorted(read & set(layout.names)):
            if not name.startswith("phi") or name == "phi0":
                continue
            side = np.cos(motion.coordinates[0][:, layout.index[name] + 1])
            passed = np.flatnonzero(side[1:] * side[:-1] < 0.0)
            if len(passed):
                found.append(
                    f"near t = {motion.t[passed[0] + 1]:.6g} s a link passed the vertical, where {name} of {row.text!r} has no "
                    "value, and what holds it no bound; write the equation with the link's direction.x and .y, and use a hinge "
                    "torque T_<link>"
                )
    return found


def share_allowed(run: Run) -> float:
    """Return what share of its size a quantity that should be kept may change by the end of a run."""
    return min(COARSE, BEYOND * run.rtol) if find_method(run.method).adaptive else COARSE


def of_energy(energies: Mapping[str, Array], run: Run) -> list[str]:
    """Say by how much the energy does not add up, where that is more than the method explains."""
    off, kinetic = largest(energies["balance"]), largest(energies["kinetic"])
    if off <= share_allowed(run) * kinetic:
        return []
    others = sum(largest(energies[name]) for name in ("potential", "spring", "work", "dissipated"))
    if off <= share_allowed(run) * max(kinetic, AT_REST * others):
        return []
    share = off / max(kinetic, 1e-300)
    return [f"the energy is off by {off:.2g} J, {share:.1g} of the largest kinetic energy: {remedy(run)}"]


def of_steps(scene: Scene, run: Run, t: Array) -> list[str]:
    """Say where fixed steps are longer than what a law does in time takes: they may pass over it; t (N,) are the samples."""
    if find_method(run.method).adaptive or not t[-1] > t[0]:
        return []
    bounds = longest_steps(scene, float(t[0]), float(t[-1]))
    step = run.step or DEFAULT_STEP
    if not len(bounds) or step <= bounds[:, 2].min():
        return []
    first, _, bound = bounds[int(np.argmin(bounds[:, 2]))]
    return [
        f"near t = {first:.6g} s a law varies within {bound:.2g} s, and steps of {step:g} s may pass over that; shorten them, or "
        "take an adaptive method"
    ]


def of_rows(residuals: Mapping[str, tuple[Array | None, Array]], rates: float, run: Run) -> list[str]:
    """Say which equations do not hold: position and velocity errors by name; `rates` is the largest of the motion."""
    allowed, found = share_allowed(run), []
    for name, (position, velocity) in residuals.items():
        off, slip = 0.0 if position is None else largest(position), largest(velocity)
        if not (off <= allowed and slip <= allowed * max(rates, 1.0)):
            by = f"its rate by {slip:.2g} /s" if off <= allowed else f"by {off:.2g}"
            gain = "; give run.gain [1/s] a value near 5" if not run.gain else ""
            found.append(f"{name} does not hold: it is off {by}; {remedy(run)}{gain}")
    return found


def of_slopes(t: Array, y: Array, slopes: Array, run: Run, forces: Mapping[str, Array]) -> list[str]:
    """Say where something acts at a sample that the motion around it shows nothing of.

    y, slopes (N, m): what is integrated, and its rates with the recorded forces; forces (N,) by name.
    """
    at = passed_over(t, y, slopes, run, np.array([*forces.values()]).T if forces else slopes)
    if at is None:
        return []
    acting = "a law gives a force that stands out"
    if forces:
        name = max(forces, key=lambda each: _far(forces[each], at))
        acting = f"the control gives {name} = {forces[name][at]:.4g}"
    return [
        f"at t = {t[at]:.6g} s {acting}, and the motion around shows nothing of it: the steps passed over it; set max_step [s] "
        "to less than the time for which it acts"
    ]


def remedy(run: Run) -> str:
    """Say what makes a run more exact."""
    if not find_method(run.method).adaptive:
        return f"the step of {run.step or DEFAULT_STEP:g} s is too long for this motion; shorten it, or take an adaptive method"
    if share_allowed(run) == COARSE:
        return f"rtol {run.rtol:g} is too loose for this motion; tighten rtol and atol"
    return f"that is more than rtol {run.rtol:g} explains; tighten rtol and atol, or set max_step [s], and compare"


def passed_over(t: Array, y: Array, slopes: Array, run: Run, causes: Array) -> int | None:
    """Return the sample whose slopes stand out most from how y moves around it; None where none does.

    causes (N, k): one must stand out as well; a force that jumps at a sample and stays is a switch.

    Near every sample the changes of y from sample to sample are slopes too. A force that the steps followed changes those next to
    it; one that they passed over leaves all as they were, and only the slope at its own sample differs. Motion that samples
    are too few for does so at many samples, and is no reason for doubt. Where samples are denser than the longest step a
    force may cover some: they are thinned out until it does not.
    """
    if len(t) <= 2 * AROUND:
        return None
    mean = np.diff(y, axis=0) / np.diff(t)[:, None]
    beside = np.stack([mean[[0, *range(len(mean))]], mean[[*range(len(mean)), -1]]])  # before and after every sample
    widest, spacing, found = run.max_step or 1.0 / run.samples, float(np.median(np.diff(t))), []
    stride = 1
    while len(t) // stride > 2 * AROUND and (stride == 1 or spacing * stride <= 4.0 * widest):
        for first in range(stride):
            part = slice(first, None, stride)
            excess = outstanding(t[part], y[part], slopes[part], beside[:, part], run)
            excess[~alone(causes[part]).any(axis=1)] = 0.0
            at = int(np.argmax(excess))
            if excess[at] > 1.0:
                found.append((float(excess[at]), first + stride * at))
        stride *= 4
    return max(found)[1] if found else None


def outstanding(t: Array, y: Array, slopes: Array, beside: Array, run: Run) -> Array:
    """Return how far the slopes (N, m) at every sample stand out, over what counts (N,); 0 where those beside it have moved."""
    count, steps = len(t), np.diff(t)[:, None]
    first = np.clip(np.arange(count) - AROUND // 2, 0, count - 1 - AROUND)
    around = sliding_window_view(np.diff(y, axis=0) / steps, AROUND, axis=0)[first]  # (N, m, AROUND)
    own = np.isin(np.arange(count)[:, None] - first[:, None] - np.arange(AROUND), (0, 1))[:, None, :]  # next to the sample
    low, high = np.where(own, np.inf, around).min(axis=2), np.where(own, -np.inf, around).max(axis=2)
    spread = high - low
    error = 10.0 * (run.atol + run.rtol * np.abs(y)) / steps[np.minimum(np.arange(count), count - 2)]
    moved = np.maximum(low - beside, beside - high).max(axis=0) > spread + error
    off = np.maximum(np.maximum(low - slopes, slopes - high), 0.0)
    near = np.pad(np.nan_to_num(off), ((NEAR, NEAR), (0, 0)), mode="reflect")
    usual = np.median(sliding_window_view(near, 2 * NEAR + 1, axis=0), axis=2)
    excess = np.where(alone(slopes), off / (OUTSTANDING * (spread + usual) + error), 0.0)
    return np.where(moved.any(axis=1), 0.0, np.nan_to_num(excess).max(axis=1))


def alone(values: Array) -> NDArray[np.bool_]:
    """Tell which values (N, m) lie far from the two before and the two after them; none at the ends, where it may stay so."""
    padded = np.pad(values, ((2, 2), (0, 0)), constant_values=np.nan)
    count = len(values)
    others = np.array([padded[at : at + count] for at in (0, 1, 3, 4)])
    low, high = np.fmin.reduce(others), np.fmax.reduce(others)
    far: NDArray[np.bool_] = np.maximum(low - values, values - high) > 3.0 * (high - low)
    far[[0, -1]] = False
    return far


def _far(values: Array, at: int) -> float:
    """Distance of a value from the usual one, over the largest."""
    far = abs(values[at] - np.nanmedian(values)) / max(float(np.nanmax(np.abs(values))), 1e-300)
    return float(np.nan_to_num(far))


def largest(values: Array) -> float:
    """Largest size among the values; infinite where one is not finite."""
    size = float(np.maximum.reduce(np.abs(values), axis=None, initial=0.0))
    return size if math.isfinite(size) else math.inf
