"""Sub-chains: accelerations of long chains, every link a piece of its own in closed form, all links at once.

A link whose segments have no mass is a bar between two hinges. With its rod (mass m, transverse inertia J) at the distances c
and e from them, L = c + e, its lower hinge has the acceleration h and gives it the force f, its upper one t and g:

    across  f = M_hh h + M_ht t + ...,  g = M_ht h + M_tt t + ...   (at h = t = 0: Coriolis forces)
            M_hh = m (e/L)^2 + J/L^2,  M_ht = m c e/L^2 - J/L^2,  M_tt = m (c/L)^2 + J/L^2
    along   a free segment hands on its spring's force, and the rod moves with the hinge to which the other is fixed;
            where both are fixed, t - h = -L |d'|^2, and the force along the link is an unknown

Unknown are the accelerations, less gravity, of the base and of every link's upper hinge, in the axes of the base and of that
link. Forces in balance there make a banded system, symmetric and positive definite unless a link is fixed on both sides: time
and memory grow with the number of links. The state stays that of the one chain. Spin about a link's axis acts on nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray
from scipy.linalg import blas, lapack

from vlmb.errors import SceneError, SingularError
from vlmb.model.long_chains import obstacle
from vlmb.model.mechanism import Mechanism
from vlmb.system.bars import HEAVY, Bars
from vlmb.system.constrained import SIDEWAYS

Array = NDArray[np.float64]

BACK = np.array([[-2.0], [2.0]])  # -2 d', where d' = omega x d = (0, omega_z, -omega_y) in the axes of a link
PROBES = 12  # solutions to find the weakest motion


def _products() -> tuple[Array, Array]:
    """Make the matrices from products of a quaternion to a rotation, and from products of two vectors to their cross product."""
    rotation, cross = np.zeros((4, 4, 3, 3)), np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross[i, j, k], cross[j, i, k] = 1.0, -1.0
        rotation[k, 3, j, i], rotation[k, 3, i, j] = 2.0, -2.0
        rotation[i, j, i, j] = rotation[i, j, j, i] = 2.0
        for a in range(4):
            rotation[a, a, i, i] = 1.0 if a in (i, 3) else -1.0
    return rotation.reshape(16, 9).T.copy(), cross.reshape(9, 3).T.copy()


ROTATION, CROSS = _products()


class _Blocks(NamedTuple):
    """Views of a banded matrix by blocks: element (row, column) sits at first + row + (width - 1) column."""

    band: Array  # (width, rows), as LAPACK takes it
    diagonal: Array  # (3, n)
    within: Array  # (3, 3, n)
    below: Array  # (3, 3, n - 1): [b, a, i] is in row a of block i + 1, column b of block i
    above: Array  # (3, 3, n - 1): its transpose
    row: Array  # (3, n - 1): the fourth row of a block of four
    column: Array  # (3, n - 1): its transpose


def _blocks(count: int, step: int, width: int, first: int) -> _Blocks:
    """Make a banded matrix of `count` blocks of `step` rows."""
    flat = np.zeros(width * step * (count + 1))  # views reach beyond the last block
    down, right = 1, width - 1

    def view(row: int, column: int, *steps: int, short: int = 1) -> Array:
        shape, jumps = (*([3] * len(steps)), count - short), (*steps, width * step)
        return as_strided(flat[first + row + right * column :], shape, [8 * jump for jump in jumps])

    return _Blocks(
        flat[: width * step * count].reshape(-1, width).T, view(0, 0, width, short=0), view(0, 0, down, right, short=0),
        view(step, 0, right, down), view(0, step, down, right), view(3, 0, right), view(0, 3, down),
    )  # fmt: skip


class SubChains:
    """Accelerations of a chain under its springs, dampers and weight. Holds buffers: one thread at a time.

    Raises SceneError for a scene that is no such chain.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        scene, layout = mechanism.scene, mechanism.layout
        why = obstacle(scene)
        if why is not None:
            raise SceneError(f"the route 'subchains' does not serve {why}; use 'dense'")
        self.mechanism, self.base, self.plane, self.gravity = mechanism, scene.base, layout.plane, np.array(scene.surface_gravity)
        self.bars, count = Bars(mechanism), len(scene.links)
        self.definite = not self.bars.rigid.any()
        self.step = 3 if self.definite else 4  # with the force along a link fixed on both sides
        self.chain = _blocks(count + 1, 3, 6, 0)  # minus the turns, of a matrix with a unit diagonal
        self.system = _blocks(count + 1, 3, 6, 0) if self.definite else _blocks(count + 1, 4, 19, 12)
        if not self.definite:
            at, band = 4 * np.flatnonzero(self.bars.rigid), self.system.band
            band[12, 3::4] = 1.0
            band[12, at + 3], band[11, at + 4], band[13, at + 3] = 0.0, self.bars.firm, self.bars.firm
        self.load = -HEAVY * self.gravity if layout.base == "pivot" else np.zeros(3)
        self.ahead = 0.0  # [m/s^2] gravity along the ski
        # buffers, and views of them
        self.state, self.seen = self.bars.state, np.zeros(len(self.bars.sources))
        sides, spins, turns = np.split(self.seen, np.cumsum([4 * count, 3 * count + 3]))
        self.sides, self.spins = sides.reshape(2, 2, -1), spins.reshape(-1, 3)  # lengths and rates of both segments
        self.rates = self.sides[1]
        self.turns, self.turn = turns.reshape(-1, count), np.zeros((3, 3, count))
        self.turn[1, 1] = 1.0
        self.right, self.loads, self.turning = np.zeros((count + 1, self.step)), np.zeros((3, count)), np.zeros((3, count + 1))
        self.found, self.vdot = np.zeros(5 * count + 6), np.zeros(layout.nv)
        self.balls, self.base_found = self.found[: 3 * count + 3].reshape(3, -1), self.found[-3:]
        self.segments = self.found[3 * count + 3 : -3].reshape(2, -1)

    def springs(self, q: Array, v: Array) -> Array:
        """Forces (nv,) of the segment springs and dampers, F = -k (xi - rest) - c xidot."""
        self._read(q, v)
        self.found.fill(0.0)
        self.segments[...] = self._forces()
        return self.found[self.bars.sinks]

    def dissipation(self) -> float:
        """Power lost in the dampers [W] at the state last evaluated."""
        return float(self.bars.springs[1].ravel().dot(self.rates.ravel() ** 2))

    def accelerations(self, q: Array, v: Array) -> Array:
        """Return vdot (nv,), a buffer, of the whole chain at a normalized q.

        Raises SingularError naming the hinge that can move without inertia.
        """
        self._read(q, v)
        arms, reach, growth, shares, lean = self._assemble()
        bars, turn, rates, turning = self.bars, self.turn, self.rates, self.turning
        omega = blas.dtbsv(5, self.chain.band, self.spins.ravel(), 1, 0, 1, 0, 1).reshape(-1, 3).T[:, 1:].copy()
        back = omega[:0:-1] * BACK
        square = omega[1] * omega[1]
        square += omega[2] * omega[2]
        pull = arms * square
        force = self._forces()
        along = -force
        if bars.hands_on:
            along -= bars.handed_on * force[::-1]
            along += bars.along * pull
        ahead = shares * rates
        drag = bars.mass * (ahead[0] - ahead[1])
        lower = shares[0] * drag
        lower += lean * growth
        drag -= lower
        loads, right = self.loads, self.right.T  # forces of links on their hinges at no acceleration
        loads[0] = along[0]
        np.multiply(back, lower, loads[1:])
        right[:3, 0] = self._base_load(q, v)
        np.negative(along[1], right[0, 1:])
        np.multiply(back, drag, right[1:3, 1:])
        right[:3, :-1] += np.einsum("jki,ki->ji", turn, loads)  # not by BLAS, whose threads would take milliseconds
        if not self.definite:
            np.multiply(self.bars.tied, pull[0] + pull[1], right[3, :-1])
        solution, info = self._solve(self.right.ravel())
        if info:
            if np.isfinite(self.seen).all():
                raise self._singular(info)
            self.vdot.fill(np.nan)
            return self.vdot
        hinges = solution.reshape(-1, self.step).T[:3].copy()
        tips = hinges[:, 1:]
        apart = tips - np.einsum("jki,ji->ki", turn, hinges[:, :-1])  # t - h
        bend = back * growth + apart[1:]
        bend /= reach
        bend -= omega[0] * omega[1:]
        turning[2, 1:] = bend[0]
        np.negative(bend[1], turning[1, 1:])
        self._base_motion(hinges[:, 0], v)
        balls = np.subtract(turning[:, 1:], np.einsum("jki,ji->ki", turn, turning[:, :-1]), self.balls[:, 1:])
        if self.plane:
            np.negative(balls, balls)
        else:
            balls += CROSS.dot((self.spins.T[:, None, 1:] * omega).reshape(9, -1))
        top = tips[0] + pull[1]  # along the link, of a rod that moves with the upper hinge; below: with the lower
        bottom = tips[0] - apart[0] - pull[0]
        rod = bars.lightness * (force[0] - force[1])
        if bars.hands_on:
            rod += bars.with_lower * bottom
            rod += bars.with_upper * top
        np.subtract(rod, bottom, self.segments[0])
        np.subtract(top, rod, self.segments[1])
        return self.found.take(bars.sinks, out=self.vdot, mode="clip")

    def _read(self, q: Array, v: Array) -> None:
        """Gather lengths, rates, spins and turns of all links."""
        size = len(q)
        self.state[:size], self.state[size : size + len(v)] = q, v
        self.state.take(self.bars.sources, out=self.seen, mode="clip")

    def _forces(self) -> Array:
        """Forces (2, n) that push the ends of segments apart."""
        shares = self.bars.springs * self.sides
        force = self.bars.preload - shares[0]
        force -= shares[1]
        return force

    def _assemble(self) -> tuple[Array, Array, Array, Array, Array]:
        """Set up both banded matrices; return c and e (2, n), L and its rate (n,), e/L and c/L (2, n), and J/L^2 (n,)."""
        bars, turn, system = self.bars, self.turn, self.system
        if self.plane:
            np.negative(self.spins, self.spins)
            np.cos(self.turns, turn[0, :1])
            np.sin(self.turns, turn[2, :1])
            np.negative(turn[2, 0], turn[0, 2])
            turn[2, 2] = turn[0, 0]
        else:
            squares = self.turns[:, None] * self.turns
            ROTATION.dot(squares.reshape(16, -1), turn.reshape(9, -1))
        np.negative(turn, self.chain.below)
        sides = self.sides + bars.offsets
        arms, (reach, growth) = sides[0], sides[:, 0] + sides[:, 1]
        shares = arms[::-1] / reach
        lean = bars.inertia / (reach * reach)
        weights = bars.mass * shares
        across = weights * shares
        across += lean
        direction = turn[:, 0]
        np.multiply(direction[:, None], direction * (bars.along[0] - across[0]), system.within[:, :, :-1])
        system.within[:, :, -1] = 0.0
        diagonal = bars.masses.copy()
        diagonal[:, :-1] += across[0]
        diagonal[1:, 1:] += across[1]
        system.diagonal[...] += diagonal
        mutual = weights[0] * shares[1]
        mutual -= lean
        np.multiply(turn[:, 1:], mutual, system.below[:, 1:])
        if self.definite:
            system.band[5, 1::3] = 0.0  # where `within` reaches beyond the band
        else:
            system.above[...] = system.below
            np.multiply(direction, self.bars.tied, system.row)
            system.column[...] = system.row
        return arms, reach, growth, shares, lean

    def _solve(self, right: Array) -> tuple[Array, int]:
        if self.definite:
            _, found, info = lapack.dpbsv(self.system.band, right, 1)
        else:
            _, _, found, info = lapack.dgbsv(6, 6, self.system.band, right)
        return found, info

    def _base_load(self, q: Array, v: Array) -> Array:
        """Force (3,) on the base in its axes; of a ski also what its yaw follows from, v_y' = 0."""
        if self.base.kind != "ski":
            return self.load
        cosine, sine, forward, yaw = q.item(2), q.item(3), v.item(0), v.item(2)
        along, _, down = self.gravity.tolist()
        sideways = yaw * forward + sine * along
        self.ahead, self.turning[2, 0] = cosine * along, -sideways * self.bars.yielding
        self.load[...] = self.bars.lever * yaw * yaw, HEAVY * sideways, -HEAVY * down
        return self.load

    def _base_motion(self, found: Array, v: Array) -> None:
        """Velocities' rates of the base from the acceleration of its hinge, less gravity."""
        if self.base.kind == "free":
            np.add(found, self.gravity, self.base_found)
        elif self.base.kind == "ski":
            self.base_found[0] = found.item(0) + self.ahead + v.item(2) * v.item(SIDEWAYS)
            self.base_found[2] = self.turning[2, 0]

    @np.errstate(all="ignore")
    def conditioning(self, q: Array) -> tuple[float, list[str]]:
        """Condition number of the joint system, of one unit a hinge, and the hinges of its weakest motion."""
        self._read(q, np.zeros_like(self.vdot))
        self._assemble()
        diagonal = self.system.diagonal.T.copy()
        if not np.isfinite(self.system.band).all():
            bad = np.flatnonzero(~np.isfinite(diagonal).all(axis=1))
            return np.inf, [self._place(k) for k in bad[:4]] if np.isfinite(q).all() else ["every coordinate"]
        held = diagonal > 0.5 * HEAVY
        mean = np.where(held, 0.0, diagonal).sum(axis=1) / np.maximum((~held).sum(axis=1), 1)
        units = np.ones((len(diagonal), self.step))
        units[:, :3] = np.sqrt(np.where(held, diagonal, np.maximum(mean, 1e-300)[:, None]))
        if not self.definite:
            units[:-1, 3] = np.where(self.bars.rigid, self.bars.firm / units[:-1, :3].min(axis=1), 1.0)
        motion, growth = np.random.default_rng(0).normal(size=units.size), 0.0
        for _ in range(PROBES):
            motion /= np.linalg.norm(motion)
            motion, info = self._solve(units.ravel() * motion)
            motion *= units.ravel()
            growth = float(np.linalg.norm(motion))
            if info or not np.isfinite(growth):
                return np.inf, [self._place((info - 1 if info else int(np.argmin(np.isfinite(motion)))) // self.step)]
        sizes = np.abs(motion.reshape(-1, self.step)[:, :3]).max(axis=1)
        return growth, [self._place(k) for k in np.argsort(-sizes)[:4] if sizes[k] > 0.5 * sizes.max()]

    def _place(self, block: int) -> str:
        return f"the hinge at the tip of {self.mechanism.layout.links[block - 1].name!r}" if block else "the base"

    def _singular(self, info: int) -> SingularError:
        block = max((info - 1) // self.step, 1)
        name = self.mechanism.layout.links[block - 1].name
        return SingularError(
            f"{self._place(block)} can move without inertia; give {name!r} a tip_mass, or fix a segment there. "
            f"{' '.join(self.mechanism.warnings)}".rstrip()
        )
