"""The search for a posture that meets rows: Gauss-Newton of least norm, in directions near the pole.

The rows' own Jacobian over v, times the map from rates to v, is that over the coordinates. Near the pole the azimuth of a link
that may turn freely is replaced by b, b' = phi' cos psi: with a = psi the two span the directions around it, the pole among
them. Azimuth and elevation are read again of the direction.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vlmb.core.along import OFF_POLE
from vlmb.errors import SimulationError, SingularError
from vlmb.model.coordinates import POLE, read_angles
from vlmb.model.mechanism import Mechanism
from vlmb.model.velocity_map import VelocityMap
from vlmb.system.constraints import RowValues
from vlmb.system.frames import LinkFrames

Array = NDArray[np.float64]
Posture = dict[str, float]

HELD = 1e-9  # a residual below this counts as zero
ITERATIONS = 60
LEAN = 0.3  # [rad] where the search begins for a link that stands on the pole of what is asked of it
FLAT = 1e-9  # size of a row's gradient that counts as none
FAR = 0.2  # of its range: a value that moved further is told loudly
LONGEST = 1.0  # [rad] that one step turns at most
TURN = math.pi  # [rad] range of an angle


class Rows(Protocol):
    """What a search needs of rows."""

    @property
    def frames(self) -> LinkFrames: ...  # noqa: D102

    @property
    def holonomic(self) -> NDArray[np.bool_]: ...  # noqa: D102

    def values(self, coordinates: Posture, rates: dict[str, float]) -> RowValues: ...  # noqa: D102


class Search(NamedTuple):
    """Where a search begins, and what it may do there."""

    mechanism: Mechanism
    given: Posture  # complete: what was given, or its default

    def range_of(self, name: str) -> float:
        """Return the range of a coordinate: between its limits; without them pi for angles, the link's length for a length."""
        coordinate = self.mechanism.layout.coordinates[self.mechanism.layout.index[name]]
        if coordinate.kind != "xi":
            return 1.0 if coordinate.kind in ("x", "y", "z") else TURN
        low, high = self.mechanism.segment(coordinate).bounds
        if math.isfinite(high - low):
            return high - low
        link = self.mechanism.layout.links[coordinate.link]
        return link.rod_length + abs(link.lower.length) + abs(link.upper.length) or 1.0

    def bounds_of(self, name: str) -> tuple[float, float]:
        """Return the limits [m] of a length; none for anything else."""
        coordinate = self.mechanism.layout.coordinates[self.mechanism.layout.index[name]]
        return self.mechanism.segment(coordinate).bounds if coordinate.kind == "xi" else (-math.inf, math.inf)

    def at_limit(self, posture: Posture) -> bool:
        """Whether a length has been moved to a limit."""
        return any(value != self.given[name] and value in self.bounds_of(name) for name, value in posture.items())

    def far(self, name: str, value: float) -> str:
        """Return why a value is loud: it is at a limit, or moved by more than a fifth of its range; or nothing."""
        moved = abs(value - self.given[name])
        if name.startswith("phi"):
            moved = abs(math.remainder(value - self.given[name], math.tau))
        if moved <= HELD:
            return ""
        if value in self.bounds_of(name):
            return f"at its limit, from {self.given[name]:.6g}"
        return f"far from {self.given[name]:.6g}" if moved > FAR * self.range_of(name) else ""

    def residual(self, chosen: Sequence[Rows], posture: Posture) -> Array:
        """Return what the holonomic rows lack (r,)."""
        return np.concatenate([entry.values(posture, {}).z[entry.holonomic] for entry in chosen])

    def solve(
        self, chosen: Sequence[Rows], free: Collection[str], start: Posture, iterations: int = ITERATIONS
    ) -> tuple[Posture, Array]:
        """Move free coordinates as little as needed from `start`; return where they end, and the residual there."""
        names = list(free)
        limits = np.array([self.bounds_of(name) for name in names]).reshape(-1, 2)
        scale = np.array([self.range_of(name) / TURN if name.startswith("xi") else 1.0 for name in names])
        posture = dict(start)
        angles = np.array([name.startswith(("phi", "psi")) for name in names], dtype=bool)
        error, matrix = self._linear(chosen, posture)
        for _ in range(iterations):
            size = float(np.linalg.norm(error))
            if size < 1e-14:
                break
            here = np.array([posture[name] for name in names])
            tilted = self._tilted(posture, free)
            columns = matrix[:, [self.mechanism.layout.index[name] for name in names]] * scale
            for name, _, cosine in tilted:
                columns[:, names.index(name)] /= cosine
            columns[np.abs(columns).max(axis=1, initial=0.0) < FLAT] = 0.0
            step = _bounded_step(columns, error, here, limits) * scale
            step *= min(1.0, LONGEST / max(LONGEST, float(np.abs(step[angles]).max(initial=0.0))))
            for share in (1.0, 0.5, 0.25, 0.1, 0.02):
                trial = self._moved(posture, names, here + share * step, tilted, limits)
                try:
                    found, slopes = self._linear(chosen, trial)
                except (SingularError, SimulationError):
                    continue
                if np.linalg.norm(found) < size:
                    posture, error, matrix = trial, found, slopes
                    break
                if size < 0.01 * HELD:
                    return posture, error
            else:
                break
        return posture, error

    def off_poles(self, chosen: Sequence[Rows], free: Collection[str], posture: Posture) -> list[str]:
        """Lean links off the pole, to their azimuths: those that a row needs to have a slope, else all. Return their psi."""
        leaned = []
        upright = [name for name in free if name.startswith("psi") and abs(math.cos(posture[name])) < POLE]
        for name in upright:
            flat = self._flat(chosen, free, posture)
            trial = posture | {name: _leaned(posture[name])}
            if (flat & ~self._flat(chosen, free, trial)).any():
                posture[name] = trial[name]
                leaned.append(name)
        return leaned or self._all_off_poles(upright, posture)

    @staticmethod
    def _all_off_poles(upright: list[str], posture: Posture) -> list[str]:
        posture.update({name: _leaned(posture[name]) for name in upright})
        return upright

    def _flat(self, chosen: Sequence[Rows], free: Collection[str], posture: Posture) -> NDArray[np.bool_]:
        """Which rows do not hold, and cannot be helped by a small motion."""
        error, matrix = self._linear(chosen, posture)
        for name, _, cosine in self._tilted(posture, free):
            matrix[:, self.mechanism.layout.index[name]] /= cosine
        slopes = np.abs(matrix[:, [self.mechanism.layout.index[name] for name in free]]).max(axis=1, initial=0.0)
        flat: NDArray[np.bool_] = (np.abs(error) > HELD) & (slopes < FLAT)
        return flat

    def _linear(self, chosen: Sequence[Rows], posture: Posture) -> tuple[Array, Array]:
        """Return what the holonomic rows lack (r,), and its derivatives by all coordinates (r, N)."""
        values = [(entry.values(posture, {}), entry.holonomic) for entry in chosen]
        over_v = np.concatenate([value.jacobian[flags] for value, flags in values])
        back = VelocityMap(self.mechanism, posture, chosen[0].frames.data).pull_back(over_v)
        return np.concatenate([value.z[flags] for value, flags in values]), back

    def _tilted(self, posture: Posture, free: Collection[str]) -> list[tuple[str, str, float]]:
        """Azimuth, elevation and cos psi of the links near the pole whose direction is free."""
        if self.mechanism.layout.plane:
            return []
        found = []
        for at in range(len(self.mechanism.layout.links)):
            phi, psi = f"phi{at + 1}", f"psi{at + 1}"
            if phi in free and psi in free and abs(math.cos(posture[psi])) < OFF_POLE:
                found.append((phi, psi, math.cos(posture[psi])))
        return found

    def _moved(
        self, posture: Posture, names: list[str], point: Array, tilted: list[tuple[str, str, float]], limits: Array
    ) -> Posture:
        clipped = np.clip(point, limits[:, 0], limits[:, 1]) if names else point
        trial = posture | dict(zip(names, clipped.tolist(), strict=True))
        for phi, psi, _ in tilted:
            across, up = trial[phi] - posture[phi], trial[psi] - posture[psi]
            trial[phi], trial[psi] = _turned(posture[phi], posture[psi], across, up)
        return trial


def _leaned(psi: float) -> float:
    return psi - math.copysign(LEAN, math.sin(psi))


def _turned(phi: float, psi: float, across: float, up: float) -> tuple[float, float]:
    """Return the angles of a direction turned by `up` along u_psi and `across` along u_phi [rad], near those that it had."""
    angle = math.hypot(across, up)
    if across == 0.0:
        return phi, psi + up
    cp, sp, ce, se = math.cos(phi), math.sin(phi), math.cos(psi), math.sin(psi)
    along, share = math.cos(angle), math.sin(angle) / angle
    x = along * cp * ce - share * (across * sp + up * cp * se)
    y = along * sp * ce + share * (across * cp - up * sp * se)
    z = along * se + share * up * ce
    near = read_angles((x, y, z), (phi, psi))
    if abs(ce) > POLE or abs(near[0] - phi) < POLE:
        return near
    first = read_angles((x, y, z))  # on the pole the azimuth meant nothing
    return phi + math.remainder(first[0] - phi, math.tau), first[1]


def _bounded_step(matrix: Array, error: Array, here: Array, limits: Array) -> Array:
    """Return the least step that makes the linear rows zero; what stands at a limit does not move beyond it."""
    open_ = np.ones(len(here), dtype=bool)
    step = np.zeros(len(here))
    for _ in range(len(here) + 1):
        step[:] = 0.0
        step[open_] = np.linalg.lstsq(matrix[:, open_], -error, rcond=1e-8)[0]
        held = open_ & (((here <= limits[:, 0]) & (step < 0.0)) | ((here >= limits[:, 1]) & (step > 0.0)))
        if not held.any():
            break
        open_ &= ~held
    return step
