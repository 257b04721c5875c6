"""Equations of motion in the paper's coordinates, every term extracted from Pinocchio.

    mass_matrix @ accelerations + bias = generalized forces

A ski has three forms (paper, section 9c): `full` with the multiplier of the knife edge, `chaplygin` after eliminating
y' = x' tan(phi0), and `speed`, whose first velocity is that along the ski. Every finite posture has matrices, poles included.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from vlmb.equations.blocks import HEADING_PRODUCT, Blocks, Coefficients, Kinds, coefficients, mass_matrix
from vlmb.equations.phases import PhaseRows, phase_rows
from vlmb.equations.solver import LinearSystem, Solution, condition_number, solve
from vlmb.errors import SceneError, finite, nearest
from vlmb.model.frozen import Remade
from vlmb.model.layout import Layout
from vlmb.model.mechanism import Mechanism
from vlmb.model.memory import make_data
from vlmb.model.velocity_map import VelocityMap
from vlmb.scene.names import listed
from vlmb.system.ski_contact import SKI

Array = NDArray[np.float64]

FORMS = ("full", "chaplygin", "speed")
DRIFTS = {"chaplygin": "xdot_phi0dot", "speed": "speed_phi0dot"}  # product that the knife edge adds


class Form(NamedTuple):
    """How a form's velocities u make all rates: (x', y') = along u_1, (x'', y'') = along u_1' + drift u_1 u_2; the rest stays.

    Without `along` the velocities are the rates themselves.
    """

    names: tuple[str, ...]
    rows: tuple[str, ...]  # of the base
    along: Array | None = None  # (2,)
    drift: Array | None = None  # (2,)
    off: tuple[int, ...] = (0, 1)  # coordinates that are none of its own: x, y, and z of a ski on the snow

    def rates(self, velocities: Array) -> Array:
        """All rates (N_full,) of velocities (N,)."""
        if self.along is None:
            return velocities
        found = np.insert(velocities[1:], [at - k for k, at in enumerate(self.off)], 0.0)
        found[:2] = self.along * velocities[0]
        return found

    def reduce(self, rows: Array) -> Array:
        """Rows of the form (N, ...) from those of all coordinates (N_full, ...)."""
        if self.along is None:
            return rows
        return np.concatenate([(self.along @ rows[:2])[None], np.delete(rows, self.off, axis=0)])


@dataclass(frozen=True, eq=False)
class EquationsOfMotion(Remade):
    """Equations at one posture and velocity. Matrices are computed when asked for, once, and are read-only."""

    mechanism: Mechanism
    coordinates: Mapping[str, float]
    rates: Mapping[str, float]  # of every coordinate; chaplygin reads x' alone, speed the part along the ski
    form: str
    closed: tuple[str, ...] = ()  # contacts of a phase that hold

    def __repr__(self) -> str:
        return f"<EquationsOfMotion of {self.mechanism.scene.name!r}: form {self.form}; rows {listed(self.names)}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of rows and columns: all coordinates; `chaplygin` has no y, `speed` has that name in place of x and y."""
        return self._reduction.names

    @cached_property
    def mass_matrix(self) -> Array:
        """Mass matrix (N, N) [kg, kg m, kg m^2]."""
        form = self._reduction
        return _frozen(form.reduce(form.reduce(self._full_mass).T).copy())

    @cached_property
    def bias(self) -> Array:
        """Velocity products and gravity (N,) [N, N m]; no springs."""
        chart, form, model, data = self._chart, self._reduction, self.mechanism.model, self._data
        u = self._velocities
        rates = form.rates(u)
        accelerations = chart.products(rates)
        if form.drift is not None:
            extra = np.zeros(len(rates))
            extra[:2] = form.drift * (u[0] * u[1])
            accelerations = accelerations + chart.velocities(extra)
        tau = pin.rnea(model, data, chart.q, chart.velocities(rates), accelerations)
        return _frozen(form.reduce(chart.pull_back(tau)))

    @cached_property
    def condition(self) -> float:
        """Condition number of the mass matrix as it stands, in SI units; above about 1e16 it is rounding, or inf."""
        return condition_number(self.mass_matrix)

    @cached_property
    def blocks(self) -> Blocks:
        """Blocks of (4.1) by (block, row), F G H without their factor 2 and K without g.

        A chain row phi psi xi1 xi2 has shape (links, ...), a row of the base drops that axis; a link column has shape (...,
        links), a base acceleration such as "X", a product of ski rates and K drop that axis. Rows and columns are by link, of
        the links that have the coordinate; `rows` and `columns` name them. The ski adds

            full       rows x y phi0,    columns X Y PHI0,     product phi0dot_phi0dot
            chaplygin  rows x phi0,      columns X PHI0,       products xdot_phi0dot, phi0dot_phi0dot
            speed      rows speed phi0,  columns SPEED PHI0,   products speed_phi0dot, phi0dot_phi0dot

        and a free base rows x y z with columns X Y Z. With `plane` there is no phi; on a ski F and G then multiply phi0'.
        """
        form, c, kinds = self._reduction, self._coefficients, self._kinds
        shift = len(kinds.base) - len(form.rows)
        reduced = {block: self.mass_matrix[:, kinds.places[kind] - shift] for block, kind in kinds.accelerations.items()}
        reduced |= {row.upper(): self.mass_matrix[:, at] for at, row in enumerate(form.rows)}
        reduced |= {block: form.reduce(value) for block, value in c.products.items()}
        if "phi0" in kinds.base:
            reduced[HEADING_PRODUCT] = form.reduce(c.heading)
        if form.drift is not None:
            reduced[DRIFTS[self.form]] = form.reduce(self._full_mass[:, :2] @ form.drift)
        reduced["K"] = form.reduce(c.weight)
        blocks = {}
        for row, at in self._row_places.items():
            for block, value in reduced.items():
                blocks[block, row] = _frozen(np.array(value[at]))
        return blocks

    @property
    def rows(self) -> dict[str, tuple[str, ...]]:
        """Row of the blocks -> coordinate names of its entries."""
        return {row: tuple(np.array(self.names)[np.atleast_1d(at)].tolist()) for row, at in self._row_places.items()}

    @property
    def columns(self) -> dict[str, tuple[str, ...]]:
        """Block -> what its columns multiply: `phi1_ddot`, `2*phi1_dot*psi1_dot`, `g`."""
        names, kinds = self.mechanism.layout.names, self._kinds
        found = {
            block: tuple(f"{names[at]}_ddot" for at in kinds.places[kind]) for block, kind in kinds.accelerations.items()
        }
        found |= {row.upper(): ("speed_dot" if row == "speed" else f"{row}_ddot",) for row in self._reduction.rows}
        for block, (first, second) in kinds.products.items():
            pairs = zip(first, second, strict=True)
            found[block] = tuple(
                f"{names[i]}_dot^2" if i == j else f"2*{names[i]}_dot*{names[j]}_dot" for i, j in pairs
            )
        if "phi0" in kinds.base:
            found[HEADING_PRODUCT] = ("phi0_dot^2",)
        if self.form in DRIFTS:
            found[DRIFTS[self.form]] = (("x_dot" if self.form == "chaplygin" else "speed") + "*phi0_dot",)
        return found | {"K": ("g",)}

    @cached_property
    def phase(self) -> PhaseRows:
        """Rows of the phase, W c'' + w = 0: of contacts that are closed, then of the scene's ideal constraints."""
        if self.form != "full":
            raise SceneError(f"closed: rows of contacts stand over all coordinates: form = 'full', not {self.form!r}")
        return phase_rows(self.mechanism, self.coordinates, self.rates, self._chart, self.closed)

    @cached_property
    def supported_mass_matrix(self) -> Array:
        """B^T A B (n, n): the first closed contact has taken a free base's coordinates out; `phase.supported` names the rest."""
        return _frozen(self.phase.reduction.T @ self.mass_matrix @ self.phase.reduction)

    @cached_property
    def supported_bias(self) -> Array:
        """Velocity products and gravity (n,) of these equations [N, N m]."""
        return _frozen(self.phase.reduction.T @ (self.bias + self.mass_matrix @ self.phase.carried))

    def solve(
        self, forces: ArrayLike | Mapping[str, float] | None = None, known: Mapping[str, float] | None = None
    ) -> Solution:
        """Solve for the accelerations under generalized forces.

        The equations are those of the mechanism with its knife edge and nothing else: springs, forces, constraints and programme
        of the scene are no part of them. A ski that may lift is on the snow where `closed` names it: z'' = 0, and the normal
        force is `F_z`.

        Parameters
        ----------
        forces : (N,) in the order of `names`, or by name of the coordinate (`x`, `phi1`) or of its force (`F_x`, `M_phi1`,
            `F1_1`); those given by name are the full ones, which a form reduces itself. None: no forces.
        known : accelerations by coordinate, required for every prescribed segment; the force that results is returned.

        Returns the accelerations (N,), the knife-edge force [N] of the full form, and the force of each known acceleration.
        Raises SingularError naming the coordinates that move without inertia, SceneError for names and values.
        """
        return solve(self._system, forces, known or {})

    @cached_property
    def _chart(self) -> VelocityMap:
        return VelocityMap(self.mechanism, self.coordinates, self._data)

    @cached_property
    def _data(self) -> Any:
        return make_data(self.mechanism.model)

    @cached_property
    def _kinds(self) -> Kinds:
        return Kinds(self.mechanism.layout)

    @cached_property
    def _full_mass(self) -> Array:
        return mass_matrix(self.mechanism, self._chart, self._data)

    @cached_property
    def _coefficients(self) -> Coefficients:
        return coefficients(self.mechanism, self._chart, self._data, self._full_mass)

    @cached_property
    def _reduction(self) -> Form:
        names = self.mechanism.layout.names
        if self.form == "full":
            return Form(names, self._kinds.base)
        cosine, sine = self._chart.heading
        off = tuple(at for at, name in enumerate(names) if name in ("x", "y", "z"))
        rest = tuple(name for at, name in enumerate(names) if at not in off)
        if self.form == "chaplygin":
            along, drift = np.array([1.0, sine / cosine]), np.array([0.0, 1.0 / cosine**2])
            return Form(("x", *rest), ("x", "phi0"), along, drift, off)
        return Form(("speed", *rest), ("speed", "phi0"), np.array([cosine, sine]), np.array([-sine, cosine]), off)

    @cached_property
    def _velocities(self) -> Array:
        """Velocities (N,) of the form."""
        rates = np.array([self.rates[f"{name}_dot"] for name in self.mechanism.layout.names])
        if self.form == "full":
            return rates
        cosine, sine = self._chart.heading
        first = rates[0] if self.form == "chaplygin" else cosine * rates[0] + sine * rates[1]
        return np.concatenate([[first], np.delete(rates, self._reduction.off)])

    @cached_property
    def _system(self) -> LinearSystem:
        layout, full, at = self.mechanism.layout, np.diag(self._full_mass), self.mechanism.layout.index
        alike = {"speed": "x"} | {f"phi{i + 1}": f"psi{i + 1}" for i in range(len(layout.links))}
        inertias = full[[at[alike.get(name, name)] for name in self.names]]
        edge, on_snow = None, layout.edged or (layout.lifts and SKI in self.closed)
        if on_snow and self.form == "full":
            (cosine, sine), u, row = self._chart.heading, self._velocities, np.zeros(len(self.names))
            row[:2] = -sine, cosine
            edge = row, float(u[2] * (cosine * u[0] + sine * u[1]))
        return LinearSystem(
            layout, self.names, self.mass_matrix, self.bias, self._reduction.reduce, inertias, self.coordinates, edge,
            self.mechanism.warnings, ("z",) if on_snow and "z" in self.names else (),
        )  # fmt: skip

    @property
    def _row_places(self) -> dict[str, Any]:
        """Row of the blocks -> its position among `names`, or positions."""
        shift = len(self._kinds.base) - len(self._reduction.rows)
        places: dict[str, Any] = {row: at for at, row in enumerate(self._reduction.rows)}
        return places | {kind: at - shift for kind, at in self._kinds.places.items()}


def equations_of_motion(
    mechanism: Mechanism,
    coordinates: Mapping[str, float],
    rates: Mapping[str, float] | None = None,
    form: str = "full",
    closed: Sequence[str] = (),
) -> EquationsOfMotion:
    """Return the equations of motion at a posture.

    Parameters
    ----------
    coordinates : every coordinate by name [m, rad].
    rates : by name with `_dot` [m/s, rad/s]; missing ones are 0. A ski's `speed` may stand for x_dot and y_dot.
    form : `full`, or on a ski also `chaplygin` or `speed`; of a ski that may lift these two are on the snow, without z.
    closed : contacts that hold, of the phase whose rows `phase` gives; "ski" is one that may lift, on the snow.

    Raises SceneError naming a missing, unknown or non-finite coordinate and its link.
    """
    layout = mechanism.layout
    allowed = FORMS if layout.headed else FORMS[:1]
    if form not in allowed:
        where = "" if form not in FORMS else f" of a {layout.base!r} base"
        raise SceneError(f"unknown form {form!r}{where}; allowed: {', '.join(allowed)}")
    posture = complete_posture(mechanism, coordinates)
    moving = all_rates(mechanism, posture, rates or {})
    if layout.lifts and form != "full" and (posture["z"] or moving["z_dot"]):
        off = f"z = {posture['z']:g} m, z_dot = {moving['z_dot']:g} m/s"
        raise SceneError(f"form {form!r} is that of a ski on the snow: {off}; set both to 0, or take form = 'full'")
    return EquationsOfMotion(mechanism, posture, moving, form, tuple(closed))


def complete_posture(mechanism: Mechanism, coordinates: Mapping[str, float]) -> dict[str, float]:
    """Check that every coordinate is there and finite; SceneError names the one that is not, and its link."""
    layout = mechanism.layout
    coordinates = mechanism.names.canonical(coordinates, "coordinates")
    for name in coordinates:
        if name not in layout.index:
            why = next((f"left out of this scene: {text}" for text in mechanism.left_out if text.startswith(f"{name},")), "")
            if layout.plane and str(name).startswith("phi"):
                why = "with plane = true the links have no azimuth of their own"
            raise SceneError(f"unknown coordinate {name!r}; {why or nearest(name, layout.names)}")
    missing = [name for name in layout.names if name not in coordinates]
    if missing:
        raise SceneError(f"missing coordinates: {', '.join(_owned(layout, name) for name in missing)}; a posture needs them all")
    return {name: finite(_owned(layout, name), coordinates[name]) for name in layout.names}


def all_rates(mechanism: Mechanism, posture: Mapping[str, float], rates: Mapping[str, float]) -> dict[str, float]:
    """Return every rate by name, 0 where it is missing, a ski's speed as x_dot and y_dot; SceneError names a wrong one."""
    layout, rates = mechanism.layout, mechanism.names.canonical(rates, "rates")
    known = mechanism.names.known[len(layout.names) :]
    for name in rates:
        if name not in known:
            raise SceneError(f"unknown rate {name!r}; {nearest(name, known)}")
    given = {name: finite(_owned(layout, name), value) for name, value in rates.items()}
    if "speed" in given:
        if "x_dot" in given or "y_dot" in given:
            raise SceneError("speed: give either speed or x_dot and y_dot, not both")
        speed, heading = given.pop("speed"), posture["phi0"]
        given |= {"x_dot": speed * math.cos(heading), "y_dot": speed * math.sin(heading)}
    return dict.fromkeys(known[: len(layout.names)], 0.0) | given


def _owned(layout: Layout, name: str) -> str:
    """Name a coordinate or rate with the link it belongs to."""
    at = layout.index.get(name.removesuffix("_dot"), -1)
    link = layout.coordinates[at].link if at >= 0 else -1
    return f"{name} of {layout.links[link].name!r}" if link >= 0 else f"{name} of the {layout.base}"


def _frozen(value: Array) -> Array:
    value.flags.writeable = False
    return value
