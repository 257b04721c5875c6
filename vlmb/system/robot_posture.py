"""The programme and the posture of a robot in the accelerations of its joints: exact, and with small matrices only.

Where every control is a joint's own, the rows and the equations of motion without a control leave of all accelerations

    C vdot = d,   C = (J; W; L M_U),   L J_U^T = 0,

with U the velocities that have no control. Of these vdot the one whose joints come nearest to the posture is a
projection. Then the forces follow: multipliers from the rows U, and among those that load what is welded without moving it the
least controls.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Array = NDArray[np.float64]

RANK = 1e-9  # relative size below which a direction counts as none
UPPER = np.triu(np.ones((400, 400)))  # as many velocities without a control as there may be


class Space(Protocol):
    """What of a workspace is read and written here."""

    nv: int
    eliminated: int
    first_control: int
    posed_v: NDArray[np.intp]
    posed_weights: Array
    scales: Array
    values: Array
    multipliers: Array


class JointSpace:
    """What of a workspace stands where. `solve` answers None where it has no answer: the controls then say why."""

    def __init__(self, space: Space, controls: NDArray[np.intp]) -> None:
        """`controls` (S,) are the velocities of the joints that the controls act in."""
        self.space, self.controls = space, controls
        every = set(range(space.nv))
        self.others = np.array(sorted(every - set(controls.tolist())), np.intp)  # U
        self.posed = space.posed_v
        self.rest = np.array(sorted(every - set(self.posed.tolist())), np.intp)
        assert max(len(self.others), len(self.rest)) < len(UPPER)
        self.flexible = 1.0 / space.posed_weights**2

    def solve(self, mass: Array, b: Array, rows: Array, wanted: Array, back: Array) -> Array | None:
        """Return vdot; leaves controls and multipliers. `back` (joints,) is what the posture asks of its joints."""
        space, others, rest, posed, e = self.space, self.others, self.rest, self.posed, self.space.eliminated
        held = rows[:e]
        factor, pivots, tau, _, _ = lapack.dgeqp3(held[:, others].T)
        sizes = np.abs(factor.diagonal())
        rank = int((sizes > RANK * max(float(sizes[0]), 1e-300)).sum()) if e else 0
        whole = np.zeros((len(others), len(others)), order="F")
        whole[:, : len(sizes)] = factor[:, : len(sizes)]
        turn, _, info = lapack.dorgqr(whole, tau, lwork=32 * len(others))
        loose = turn[:, rank:].T  # motions of U that nothing holds
        every = np.concatenate([rows, loose.dot(mass[others])])
        asked = np.concatenate([wanted, loose.dot(b[others])])
        moved, count = every[:, posed], len(rest)
        second, reflections, _, info = lapack.dgeqrf(every[:, rest])
        if len(every) < count or not np.abs(second.diagonal()).min(initial=1.0) > RANK:
            return None
        both = np.zeros((len(every), len(every)), order="F")
        both[:, :count] = second
        basis, _, info = lapack.dorgqr(both, reflections, lwork=32 * len(every))
        left = basis[:, count:].T
        rows_on_joints = left.dot(moved)
        spread = rows_on_joints * self.flexible
        _, share, info = lapack.dposv(spread.dot(rows_on_joints.T), left.dot(asked) - rows_on_joints.dot(back))
        if info:
            return None
        joints = back + share.dot(spread)
        found = upward(second[:count]).dot(basis[:, :count].T.dot(asked - moved.dot(joints)))
        vdot = np.empty(space.nv)
        vdot[posed], vdot[rest] = joints, found
        self.share_out(mass.dot(vdot) - b, held, turn, factor, pivots - 1, rank)
        return vdot

    def share_out(self, force: Array, held: Array, turn: Array, factor: Array, order: Array, rank: int) -> None:
        """Write multipliers and controls that make up `force` (nv,) together: the least controls over their scales."""
        space, scales = self.space, self.space.scales
        e = space.eliminated
        u = force[self.controls]
        if e:
            solve, first = upward(factor[:rank, :rank]), order[:rank]
            multipliers = np.zeros(e)
            multipliers[first] = solve.dot(turn[:, :rank].T.dot(force[self.others]))
            on_controls = held[:, self.controls]
            if rank < e:  # reactions that load what is held, and move nothing
                idle = np.zeros((e, e - rank))
                idle[first] = -solve.dot(factor[:rank, rank:e])
                idle[order[rank:], np.arange(e - rank)] = 1.0
                loads = idle.T.dot(on_controls) / scales
                over = (u - multipliers.dot(on_controls)) / scales
                _, most, info = lapack.dposv(loads.dot(loads.T), loads.dot(over))
                if not info:
                    multipliers += idle.dot(most)
            space.multipliers = multipliers
            u = u - multipliers.dot(on_controls)
        space.values[space.first_control :] = u


def upward(triangle: Array) -> Array:
    """Return the inverse of an upper triangle; what stands below it is passed over. For so few rows no thread is started."""
    size = len(triangle)
    found, _ = lapack.dtrtri(triangle * UPPER[:size, :size])
    return np.asarray(found, dtype=np.float64)
