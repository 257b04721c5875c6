"""Coefficients of the equations of motion in the paper's coordinates, read off Pinocchio one term at a time.

    A phi'' + B psi'' + sum C_a xi_a'' + D phi'^2 + E psi'^2 + 2 sum F_a phi' xi_a' + 2 G phi' psi' + 2 sum H_a psi' xi_a' + g K

Accelerations come from CRBA. The bias is a quadratic form h(c') of the rates, so each velocity product follows from inverse
dynamics (RNEA) at unit rates: h(e_j) is the coefficient of c_j'^2 and (h(e_j + e_k) - h(e_j) - h(e_k)) / 2 that of
2 c_j' c_k'. In absolute angles no product couples two links, so seven evaluations a link give every block. K is inverse
dynamics at rest under unit gravity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.model.layout import Layout
from vlmb.model.mechanism import Mechanism
from vlmb.model.velocity_map import VelocityMap

Array = NDArray[np.float64]
Blocks = dict[tuple[str, str], Array]

ACCELERATIONS = {"A": "phi", "B": "psi", "C1": "xi1", "C2": "xi2"}  # block -> the acceleration it multiplies
PRODUCTS = {  # block -> the two rates it multiplies; those of unlike rates carry a factor 2 in (4.1)
    "D": ("phi", "phi"),
    "E": ("psi", "psi"),
    "F1": ("phi", "xi1"),
    "F2": ("phi", "xi2"),
    "G": ("phi", "psi"),
    "H1": ("psi", "xi1"),
    "H2": ("psi", "xi2"),
}
HEADING_PRODUCT = "phi0dot_phi0dot"


@dataclass(frozen=True)
class Kinds:
    """Which coordinates, columns and products a mechanism has.

    With `plane` the links have no azimuth of their own: rows and blocks of phi are left out, and on a ski F and G multiply the
    ski's phi0' instead, which turns the plane.
    """

    layout: Layout

    @cached_property
    def base(self) -> tuple[str, ...]:
        """Coordinates of the base."""
        return tuple(coordinate.name for coordinate in self.layout.coordinates if coordinate.link < 0)

    @cached_property
    def places(self) -> dict[str, NDArray[np.intp]]:
        """Positions of the coordinates phi, psi, xi1, xi2 (phi not in a plane), link by link."""
        kinds = ("psi", "xi1", "xi2") if self.layout.plane else ("phi", "psi", "xi1", "xi2")
        found: dict[str, list[int]] = {kind: [] for kind in kinds}
        for at, coordinate in enumerate(self.layout.coordinates):
            if coordinate.link >= 0:
                found[coordinate.kind + (str(coordinate.segment) if coordinate.segment else "")].append(at)
        return {kind: np.array(at, dtype=np.intp) for kind, at in found.items()}

    @cached_property
    def accelerations(self) -> dict[str, str]:
        """Blocks of accelerations of the links: block -> kind."""
        return {block: kind for block, kind in ACCELERATIONS.items() if kind in self.places}

    @cached_property
    def products(self) -> dict[str, tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """Blocks of velocity products: block -> positions of the two rates, column by column."""
        found = {}
        for block, (first, second) in PRODUCTS.items():
            columns = self.places.get(second)
            if columns is None or (block == "D" and self.layout.plane):
                continue
            if first in self.places:
                links = [self.layout.coordinates[at].link for at in columns]
                by_link = {self.layout.coordinates[at].link: at for at in self.places[first]}
                found[block] = np.array([by_link[link] for link in links], dtype=np.intp), columns
            elif "phi0" in self.base:
                found[block] = np.full(len(columns), self.base.index("phi0"), dtype=np.intp), columns
        return found


@dataclass(frozen=True)
class Coefficients:
    """Every coefficient as a column over all coordinates (N, ...), before rows are chosen or a form reduces them."""

    products: dict[str, Array]  # block -> (N, columns)
    heading: Array  # (N,) of phi0'^2
    weight: Array  # (N,) of g


def mass_matrix(mechanism: Mechanism, chart: VelocityMap, data: Any) -> Array:
    """Mass matrix S^T M S (N, N), M by CRBA.

    LOCAL convention: its digits do not depend on how far from the origin the mechanism is. A ski's heading moves the ski and the
    anchors on it alone, while CRBA would subtract the whole mechanism's inertia from itself; its row is inverse dynamics at unit
    acceleration.
    """
    layout = mechanism.layout
    crba = pin.crba(mechanism.model, data, chart.q, pin.Convention.LOCAL)
    mass = chart.pull_back(chart.pull_back(crba).T)
    mass = 0.5 * (mass + mass.T)
    if layout.headed:
        unit = np.zeros(len(layout.names))
        unit[layout.index["phi0"]] = 1.0
        tau = pin.rnea(_weightless(mechanism), data, chart.q, np.zeros(layout.nv), chart.velocities(unit))
        mass[2] = mass[:, 2] = chart.pull_back(tau)
    return mass


def coefficients(mechanism: Mechanism, chart: VelocityMap, data: Any, mass: Array) -> Coefficients:
    """Extract every velocity product and the weight at a posture whose mass matrix is known."""
    weightless = _weightless(mechanism)
    layout, kinds = mechanism.layout, Kinds(mechanism.layout)
    size, unit = len(layout.names), _unit_length(mechanism)

    def bias(rates: Array) -> Array:
        """Velocity products (N, columns) at rates (columns, N)."""
        pairs = zip(chart.velocities(rates), chart.products(rates), strict=True)
        tau = [pin.rnea(weightless, data, chart.q, v, a) for v, a in pairs]
        return chart.pull_back(np.array(tau).reshape(-1, layout.nv)).T

    def unit_rates(*places: NDArray[np.intp]) -> Array:
        rates = np.zeros((len(places[0]), size))
        for at in places:
            rates[np.arange(len(at)), at] = [unit if layout.coordinates[k].kind == "xi" else 1.0 for k in at]
        return rates

    squares = np.zeros((size, size))  # column j: the coefficient of c_j'^2; that of a length is zero, it is straight
    turning = [at for at, coordinate in enumerate(layout.coordinates) if coordinate.kind in ("phi0", "phi", "psi")]
    squares[:, turning] = bias(unit_rates(np.array(turning, dtype=np.intp)))
    found = {}
    for block, (first, second) in kinds.products.items():
        if np.array_equal(first, second):
            found[block] = squares[:, first]
            continue
        scale = unit if block[0] in "FH" else 1.0
        found[block] = (bias(unit_rates(first, second)) - squares[:, first] - squares[:, second]) / (2.0 * scale)
    heading = squares[:, layout.index["phi0"]] if "phi0" in layout.index else np.zeros(size)
    up = np.array([-math.sin(mechanism.scene.slope), 0.0, math.cos(mechanism.scene.slope)])
    weightless.gravity.linear = -up
    weight = chart.pull_back(pin.rnea(weightless, data, chart.q, np.zeros(layout.nv), np.zeros(layout.nv)))
    if layout.headed:  # on it gravity acts as a uniform acceleration of the surface does
        weight[:3] = mass[:3, :2] @ up[:2]
    return Coefficients(found, heading, weight)


def _weightless(mechanism: Mechanism) -> Any:
    model = pin.Model(mechanism.model)
    model.gravity.linear = np.zeros(3)
    return model


def _unit_length(mechanism: Mechanism) -> float:
    """Power of two [m] near the links' size: a length's unit rate must move masses about as fast as 1 rad/s does."""
    lengths = [link.rod_length + abs(link.lower.length) + abs(link.upper.length) for link in mechanism.layout.links]
    mean = sum(lengths) / len(lengths) if lengths else 0.0
    return 2.0 ** round(math.log2(mean)) if 0.0 < mean < math.inf else 1.0
