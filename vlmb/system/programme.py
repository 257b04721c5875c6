"""Programme control (section 5): controls u that make the programme constraints hold, errors decaying by (5.5).

With vdot = a + b u and rows z'' = W vdot + drift:  G = W b,  beta = H z + K z' - (W a + drift),  G u = beta.
u = u_nu + Z w: u_nu is the solution of least weighted norm, R^-1 G^T (G R^-1 G^T)^-1 beta (5.6), and Z spans ker G.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np
import scipy
from numpy.typing import NDArray

from vlmb.errors import SceneError, SingularError, nearest
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import GeneralizedForce
from vlmb.scene.by_phase import keyed, programme_at, programmes_of
from vlmb.scene.tables import DEFAULT_STEP, FIXED_STEP, Programme, Run
from vlmb.system.constraints import Constraint
from vlmb.system.gains import VARY, MovingGains, fixed_number, gain_matrices, stability_report

Array = NDArray[np.float64]

RANK = 1e-9  # relative size below which a direction of G counts as uncontrolled
SMALLEST = 1e-5  # of G in the scales of the controls [1/s^2]: RANK times this is rounding
MANY = 8  # controls that are named
WEAK = 1e-3  # of the smallest singular value at the start: where a run fails, this is why


@dataclass(frozen=True, eq=False)
class ProgrammePlan:
    """What is known of a programme before any motion: its controls, gains and law."""

    texts: tuple[str, ...]  # of the rows
    names: tuple[str, ...]  # of the controls
    scales: Array  # (S,) of the controls
    holonomic: NDArray[np.bool_]
    h: Array  # (r, holonomic rows)
    k: Array  # (r, r)
    decay: str  # how errors decay
    moving: MovingGains  # what of it the motion gives
    second_holonomic: NDArray[np.bool_]
    second_h: Array
    second_k: Array

    def gains(self) -> tuple[Array, Array]:
        """Return H and K of (5.5) over all rows, r x r: columns of H for velocity rows are 0."""
        return _spread(self.h, self.holonomic), self.k

    def secondary_gains(self) -> tuple[Array, Array]:
        """Return the same for the secondary rows."""
        return _spread(self.second_h, self.second_holonomic), self.second_k


def make_plan(
    mechanism: Mechanism, programme: Programme, rows: Sequence[Constraint], second: Sequence[Constraint], run: Run,
    moving: MovingGains,
) -> ProgrammePlan:  # fmt: skip
    """Choose gains and check them. Raises SceneError for too few controls, and for gains under which errors would grow."""
    scene = mechanism.scene
    acting = control_channels(mechanism)
    names = tuple(channel.name for channel in acting)
    if len(rows) > len(acting):
        raise SceneError(
            f"programme: {len(rows)} rows need at least as many controls; there are {len(acting)} "
            f"({', '.join(names)}); name more of {', '.join(mechanism.names.forces)}"
        )
    step = (run.step or DEFAULT_STEP) if run.method in FIXED_STEP else None
    holonomic = np.array([row.holonomic for row in rows], dtype=bool)
    h, k = united_gains(keyed(programme), holonomic, own_rate(mechanism), step, scene.parameters)
    decay = united_decay(programme, holonomic, h, k, moving, run.method, step)
    check_border(programme, len(rows), len(acting))
    second_holonomic = np.array([row.holonomic for row in second], dtype=bool)
    second_h = second_k = np.zeros((0, 0))
    if second:
        given = [(key, secondary_gains_of(part)) for key, part in keyed(programme) if part.secondary]
        second_h, second_k = united_gains(given, second_holonomic, own_rate(mechanism), step, {})
        for at in np.flatnonzero([row.of_forces for row in second]):
            second_k[at, at] = -1.0  # what such a row asks for, it has at once
    return ProgrammePlan(
        tuple(row.text for row in rows), names, control_scales(mechanism, acting), holonomic, h, k, decay, moving,
        second_holonomic, second_h, second_k,
    )  # fmt: skip


def _parts(
    programmes: Sequence[tuple[str, Programme]], holonomic: NDArray[np.bool_]
) -> list[tuple[Programme, list[bool], slice, slice]]:
    """List the parts of a programme with which of their rows are of positions, and their rows and columns in K and H."""
    found, row, column = [], 0, 0
    for _, part in programmes:
        flags = holonomic[row : row + len(part.constraints)].tolist()
        found.append((part, flags, slice(row, row + len(flags)), slice(column, column + sum(flags))))
        row, column = row + len(flags), column + sum(flags)
    return found


def united_decay(
    programme: Programme, holonomic: NDArray[np.bool_], h: Array, k: Array, moving: MovingGains, method: str, step: float | None
) -> str:
    """Say how errors decay under programmes that act at once. Raises SceneError where they would grow."""
    if any(entry.kind in ("h", "k") for entry in moving.entries):
        return VARY
    parts = _parts(keyed(programme), holonomic)
    told = [stability_report(h[n, m], k[n, n], flags, method, step or 0.0, part.gains) for part, flags, n, m in parts]
    return "; ".join(dict.fromkeys(told))


def united_gains(
    programmes: Sequence[tuple[str, Programme]], holonomic: NDArray[np.bool_], rate: float, step: float | None,
    parameters: Mapping[str, float],
) -> tuple[Array, Array]:  # fmt: skip
    """Return H (r, m) and K (r, r) of (5.5) of programmes that act at once: blocks of each."""
    h, k = np.zeros((len(holonomic), int(holonomic.sum()))), np.zeros((len(holonomic), len(holonomic)))
    for part, flags, rows, columns in _parts(programmes, holonomic):
        h[rows, columns], k[rows, rows] = gain_matrices(part, flags, rate, step, parameters)
    return h, k


def check_border(programme: Programme, rows: int, controls: int) -> None:
    """Refuse u0 and a border that do not make u_tau of (5.6) one vector."""
    spare, border = controls - rows - 1, programme.border
    if programme.u0 is None:
        if border:
            raise SceneError("programme.border: its rows belong to u0 of (5.6), and there is none; give u0 or drop them")
        return
    if programme.secondary:
        raise SceneError("programme.u0: `secondary` takes what the rows leave free, and u0 does too; drop one of them")
    if spare < 0 or len(border) != max(spare, 0) or any(len(row) != controls for row in border):
        need = "no `border`" if not spare else f"`border` with {spare} rows of {controls} entries"
        need = need if spare >= 0 else "a control more"
        found = f"; found {len(border)} rows of {', '.join(str(len(row)) for row in border)} entries" if border else ""
        raise SceneError(
            f"programme.u0: u_tau of (5.6) is one vector for one control more than rows and border; here are {controls} controls "
            f"and {rows} rows: it needs {need}{found}; or use `secondary`"
        )


class ProgrammeControl:
    """The controls of a programme along a motion, and what of it was lost. The rows are evaluated by the constraint solver."""

    def __init__(self, plan: ProgrammePlan) -> None:
        self.plan, self.texts, self.names, self.scales = plan, plan.texts, plan.names, plan.scales
        self.control_matrix = np.zeros((len(self.texts), len(self.names)))  # G of the last solution, in the controls' scales
        self.side = 0.0  # sign of det G at the last accepted sample, where G is square
        self.repeating = False  # whether rows repeated each other, or an ideal constraint, in the last solution
        self.grip = 0.0  # smallest singular value of G at the first accepted sample

    def solve(self, g: Array, beta: Array, behind: Sequence[float] | Array = ()) -> Array:
        """Return u over its scales with G u = beta, by G in these scales; secondary rows stand below those of the programme.

        What the rows leave free goes to u0 or to the secondary rows: with as many controls as all rows together this is one
        system. `behind` are the values of what the motion gives; weights among them change the scales of this instant. Raises
        SingularError naming rows and controls where the programme cannot be met.
        """
        moving, ratios = self.plan.moving, np.ones(len(self.names))
        for k, entry in enumerate(moving.entries, moving.first_entry):
            if entry.kind == "weights":
                if not behind[k] > 0.0:
                    raise moving.failure(k, behind[k])
                ratios[entry.column] = behind[k] ** -0.5 / self.scales[entry.column]
        u = self._share_out(g * ratios, beta)
        if moving.free is not None:
            scales, border = self.scales * ratios, np.array(behind[len(moving.laws) - sum(map(len, moving.border)) :])
            below = border.reshape(-1, len(scales)) * scales
            u = u + behind[0] / scales.prod() * cross(np.vstack([self.control_matrix, below]))
        return np.asarray(u * ratios)

    def _share_out(self, g: Array, beta: Array) -> Array:
        """Return the least u over the scales of this instant; what the rows leave free goes to the secondary rows."""
        count = len(self.texts)
        self.control_matrix = g[:count]
        if count < len(g):
            if len(g) <= g.shape[1]:
                u = _least(g, beta)
                if u is not None:
                    return u
            u = self.least(g[:count], beta[:count])
            null = self.null_space(g[:count])
            return u + null @ np.linalg.lstsq(g[count:] @ null, beta[count:] - g[count:] @ u, rcond=RANK)[0]
        return self.least(g, beta)

    def accept(self) -> None:
        """Refuse a sample beyond a posture where as many controls as rows lose their effect: det G changes its sign there."""
        self.grip = self.grip or float(np.linalg.svd(self.control_matrix, compute_uv=False)[-1])
        if self.control_matrix.shape[0] != self.control_matrix.shape[1] or self.repeating:
            self.side = 0.0
            return
        side = float(np.sign(np.linalg.det(self.control_matrix)))
        if self.side * side < 0.0:
            raise turned_side(self.plan)
        self.side = side or self.side

    def least(self, g: Array, beta: Array) -> Array:
        """Return u_nu of (5.6) over its scales: the solution of G u = beta with the least weighted norm.

        Redundant rows that agree are met; SingularError where rows ask for what the controls cannot give.
        """
        answer = _least(g, beta)
        self.repeating = answer is None
        return self._least_deficient(g, beta) if answer is None else answer

    @property
    def report(self) -> str:
        """Say how errors decay, and how the rows of the last solution depend on each other."""
        if not self.repeating:
            return self.plan.decay
        rank = self.rank(self.control_matrix)[0]
        return f"{self.plan.decay}; {len(self.texts)} rows of rank {rank}: others, or ideal constraints, hold the rest already"

    @property
    def controllable(self) -> str:
        """Say how errors decay and what the controls reach at the last solution."""
        rank, condition = self.rank(self.control_matrix)
        return f"programme: {self.report}; G has rank {rank} for {len(self.texts)} rows, condition {condition:.4g} at the start"

    def weakness(self) -> str:
        """Say which rows the controls have nearly lost since the start; nothing where they have not."""
        return weakness(self.plan, self.control_matrix, self.grip)

    def _least_deficient(self, g: Array, beta: Array) -> Array:
        if not (np.isfinite(g).all() and np.isfinite(beta).all()):
            return np.full(g.shape[1], np.nan)  # the dynamics name the row without a value
        g = np.where(np.abs(g) < RANK * SMALLEST, 0.0, g)
        answer = np.linalg.lstsq(g, beta, rcond=RANK)[0]
        error = np.abs(g @ answer - beta)
        if error.max() > 1e-6 * max(1.0, np.abs(beta).max()):
            raise out_of_reach(self.plan, g, beta)
        return np.asarray(answer, dtype=np.float64)

    def null_space(self, g: Array) -> Array:
        """Return Z (S, S - r): an orthonormal basis of ker G, both in the scales of the controls."""
        return np.linalg.qr(g.T, mode="complete")[0][:, len(g) :]

    def rank(self, g: Array) -> tuple[int, float]:
        """Return rank and condition number of G in the scales of the controls."""
        singular = np.linalg.svd(g, compute_uv=False)
        rank = int((singular > RANK * max(singular[0], SMALLEST)).sum())
        return rank, float(singular[0] / singular[-1]) if singular[-1] > 0.0 else float("inf")

    def strengths(self, g: Array) -> tuple[float, float]:
        """Return the largest and the smallest singular value of G in the scales of the controls."""
        singular = np.linalg.svd(g, compute_uv=False)
        return float(singular[0]), float(singular[-1])


def turned_side(plan: ProgrammePlan) -> SingularError:
    """Make the error of a step over a posture where as many controls as rows lose their effect."""
    return SingularError(
        f"programme: the motion went through a posture where {', '.join(plan.names)} have no effect on "
        f"{', '.join(map(repr, plan.texts))} (det G changed its sign): from there on it is not the programme's; add one"
    )


def out_of_reach(plan: ProgrammePlan, g: Array, beta: Array) -> SingularError:
    """Make the error of rows that ask for what the controls cannot give."""
    g = np.where(np.abs(g) < RANK * SMALLEST, 0.0, g)
    answer, _, rank, singular = np.linalg.lstsq(g, beta, rcond=RANK)
    error = np.abs(g @ answer - beta)
    rows = [repr(plan.texts[k]) for k in sorted(np.argsort(-error)[:3]) if error[k] > 0.1 * error.max()]
    more = f" and {len(plan.names) - MANY} more" if len(plan.names) > MANY else ""
    return SingularError(
        f"programme: {', '.join(rows)} cannot be met here by {', '.join(plan.names[:MANY])}{more} (rank {rank} of {len(beta)} "
        f"rows, smallest singular value {singular[-1]:.1e}; {weak_rows(plan, g)}): add a control that moves it, or drop a row "
        "that contradicts another"
    )


def weakness(plan: ProgrammePlan, g: Array, grip: float) -> str:
    """Say which rows the controls have nearly lost, G's smallest singular value beside `grip`; nothing where they have not."""
    if not np.isfinite(g).all() or np.linalg.svd(g, compute_uv=False)[-1] > WEAK * grip:
        return ""
    return f"; the programme is nearly singular there: {weak_rows(plan, g)}, by {', '.join(plan.names)}"


def weak_rows(plan: ProgrammePlan, g: Array) -> str:
    """Say which rows the controls act on least."""
    left = np.linalg.svd(g)[0][:, -1]
    return "the controls do not act on " + " and ".join(repr(plan.texts[k]) for k in np.flatnonzero(np.abs(left) > 0.3))


def _least(g: Array, beta: Array) -> Array | None:
    """Solve G u = beta by LU, by QR for the least u of more controls than rows; None where pivots show rows that repeat."""
    rows, controls = g.shape
    if rows == controls:
        factor, _, answer, info = scipy.linalg.lapack.dgesv(g, beta)
    else:
        factor, answer, info = scipy.linalg.lapack.dgels(g, np.concatenate([beta, np.zeros(controls - rows)]))
    least = min(map(abs, factor.diagonal().tolist()))
    return None if info or not least > RANK * max(float(np.abs(g).max()), SMALLEST) else answer


def _spread(h: Array, holonomic: NDArray[np.bool_]) -> Array:
    whole = np.zeros((len(holonomic), len(holonomic)))
    whole[:, holonomic] = h
    return whole


def control_channels(mechanism: Mechanism) -> tuple[GeneralizedForce, ...]:
    """Return the channels a programme's controls act through; SceneError for unknown or repeated names."""
    found = list[GeneralizedForce]()
    for key, part in keyed(programme_at(mechanism.scene)):
        for k, name in enumerate(part.controls):
            if part.controls.count(name) > 1:
                raise SceneError(f"{key}.controls: {name!r} is named twice")
            found.append(mechanism.names.force(name, f"{key}.controls[{k}]"))
    return tuple(found)


def control_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of the controls of all programmes, whenever they act."""
    names = mechanism.names
    found = (names.force(name, f"{key}.controls") for key, part in programmes_of(mechanism.scene) for name in part.controls)
    return tuple(dict.fromkeys(force.name for force in found))


def cross(g: Array) -> Array:
    """Return u_tau of (5.6): the generalized cross product of S - 1 rows, G and the border below it; G u_tau = 0."""
    controls = g.shape[1]
    return np.array([(-1.0) ** s * np.linalg.det(np.delete(g, s, axis=1)) for s in range(controls)])


def own_rate(mechanism: Mechanism) -> float:
    """Rate [rad/s] of a mechanism's own motion, for gains = "auto": sqrt(g / total length), or the fastest start rate."""
    scene = mechanism.scene
    length = total_length(mechanism)
    falling = (max(scene.gravity, 1e-3) / length) ** 0.5 if length > 0.0 else 1.0
    turning = [abs(value) for name, value in scene.start.items() if name.endswith("_dot") and name.startswith(("phi", "psi"))]
    return max([falling, 1.0, *turning])


def total_length(mechanism: Mechanism) -> float:
    """Longest way [m] from the base to a tip at the start lengths."""
    layout = mechanism.layout
    lengths = [0.0]
    for i in range(len(layout.links)):
        path = [layout.links[k] for k in layout.path(i)]
        lengths.append(sum(link.lower.length + link.rod_length + link.upper.length for link in path))
    return max(lengths)


def total_mass(mechanism: Mechanism) -> float:
    """Mass [kg] of all."""
    scene = mechanism.scene
    return scene.base.mass + sum(link.rod.mass + link.tip_mass for link in scene.links)


def control_scales(mechanism: Mechanism, given: Sequence[GeneralizedForce]) -> Array:
    """1/sqrt(R_s): a given weight R_s [1/N^2, 1/(N m)^2], or the scale m g (forces), m g L (moments), as for one that varies."""
    scene = mechanism.scene
    programme = programme_at(scene)
    weights = programme.weights if programme else {}
    names = [channel.name for channel in given]
    fixed = dict[str, float]()
    for name, text in weights.items():
        key = f"programme.weights.{name}"
        if name not in names:
            raise SceneError(f"{key}: not one of the controls; {nearest(name, names)}")
        value = fixed_number(text, key, scene.parameters)
        if value is not None:
            if not value > 0.0:
                raise SceneError(f"{key} = {text!r:.80}: a weight is above 0")
            fixed[name] = value
    force = total_mass(mechanism) * (scene.gravity or 9.81)
    moment = force * (total_length(mechanism) or 1.0)
    scales = [fixed[c.name] ** -0.5 if c.name in fixed else (moment if c.unit == "N m" else force) for c in given]
    return np.array(scales)


def secondary_gains_of(programme: Programme) -> Programme:
    """Return a programme whose rows are the secondary ones of another."""
    frequency = programme.secondary_frequency or programme.frequency
    gains: Literal["auto"] | None = None if frequency is not None else "auto"
    made = msgspec.structs.replace(programme, constraints=programme.secondary, frequency=frequency, gains=gains)
    return msgspec.structs.replace(made, damping_ratio=1.0, h=None, k=None)
