"""The map from the paper's rates to Pinocchio's velocities at a posture, regular at the poles.

    v = S c',    vdot = S c'' + (products of rates),    Q = S^T tau

A link has the frame (d, u_phi, u_psi) with u_phi = (-sin phi, cos phi, 0), u_psi = dd/dpsi, and turns without spin about d.
In its own frame

    omega    = (0, -psi', phi' cos psi),
    omegadot = (0, -psi'', phi'' cos psi) - (0, phi'^2 sin psi cos psi, 2 phi' psi' sin psi),

and its ball joint on the parent p has the velocity omega_i - R^T omega_p and the acceleration
omegadot_i - R^T omegadot_p + omega_i x R^T omega_p, where R is the rotation from parent to link. It is Pinocchio's own, so that
the parent's turning leaves the link's direction alone to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.model.coordinates import make_state
from vlmb.model.layout import segment_of
from vlmb.model.mechanism import Mechanism

Array = NDArray[np.float64]


class VelocityMap:
    """S at one posture, never formed; `coordinates` must be complete and finite. `data` is scratch space for a moment."""

    def __init__(self, mechanism: Mechanism, coordinates: Mapping[str, float], data: Any) -> None:
        layout = self.layout = mechanism.layout
        self.q = make_state(layout, coordinates).q
        heading = coordinates["phi0"] if layout.base == "ski" else 0.0
        self.heading = float(np.cos(heading)), float(np.sin(heading))
        n, index = len(layout.links), layout.index
        parents = np.array([link.parent for link in layout.links], dtype=np.intp)
        self.inner = np.flatnonzero(parents >= 0)  # links that hang on a link,
        self.outer = parents[self.inner]  # and those they hang on
        self.roots = np.flatnonzero(parents < 0)
        self.hinges = np.array([link.v for link in layout.links], dtype=np.intp)
        self.psi = np.array([index[f"psi{i + 1}"] for i in range(n)], dtype=np.intp)
        xi = [at for at, coordinate in enumerate(layout.coordinates) if coordinate.kind == "xi"]
        self.psi_outer: Any = (..., self.psi[self.outer])
        self.xi = np.array(xi, dtype=np.intp)
        self.slides = np.array([segment_of(layout, layout.coordinates[at]).v for at in xi], dtype=np.intp)
        if layout.plane:
            return
        self.phi = np.array([index[f"phi{i + 1}"] for i in range(n)], dtype=np.intp)
        self.phi_outer: Any = (..., self.phi[self.outer])
        self.balls = self.hinges[:, None] + np.arange(3)  # (n, 3)
        angles = np.array([coordinates[f"psi{i + 1}"] for i in range(n)], dtype=float)
        self.cos_psi, self.sin_psi = np.cos(angles), np.sin(angles)
        pin.forwardKinematics(mechanism.model, data, self.q)
        turns = [data.liMi[link.joint].rotation for link in layout.links]
        self.from_parent = np.array(turns).reshape(n, 3, 3)  # R^T = its transpose takes the parent's components to the link's

    def velocities(self, rates: Array) -> Array:
        """S c' (..., nv) of rates (..., N)."""
        layout, out = self.layout, np.zeros((*rates.shape[:-1], self.layout.nv))
        if layout.base == "ski":
            (cosine, sine), x, y = self.heading, rates[..., 0], rates[..., 1]
            out[..., 0], out[..., 1], out[..., 2] = cosine * x + sine * y, cosine * y - sine * x, rates[..., 2]
            out[..., 3 : layout.base_size] = rates[..., 3 : layout.base_size]
        else:
            out[..., : layout.base_size] = rates[..., : layout.base_size]
        out[..., self.slides] = rates[..., self.xi]
        if layout.plane:
            out[..., self.hinges] = rates[..., self.psi]
            out[..., self.hinges[self.inner]] -= rates[..., self.psi[self.outer]]
        else:
            omega = self._omega(rates)
            out[..., self.balls] = omega - self._of_parent(omega, self._yaw(rates))
        return out

    def products(self, rates: Array) -> Array:
        """Part of vdot (..., nv) that is quadratic in the rates (..., N): vdot when all coordinate accelerations are 0."""
        layout, out = self.layout, np.zeros((*rates.shape[:-1], self.layout.nv))
        if layout.base == "ski":
            (cosine, sine), x, y, turn = self.heading, rates[..., 0], rates[..., 1], rates[..., 2]
            out[..., 0], out[..., 1] = turn * (cosine * y - sine * x), -turn * (cosine * x + sine * y)
        if not layout.plane:
            omega, phi, psi = self._omega(rates), rates[..., self.phi], rates[..., self.psi]
            growth = np.zeros_like(omega)
            growth[..., 1] = -(phi**2) * self.sin_psi * self.cos_psi
            growth[..., 2] = -2.0 * phi * psi * self.sin_psi
            before = self._of_parent(omega, self._yaw(rates))
            out[..., self.balls] = growth - self._of_parent(growth, None) + np.cross(omega, before)
        return out

    def pull_back(self, tau: Array) -> Array:
        """S^T tau (..., N): forces on the coordinates from forces on the velocities (..., nv)."""
        layout, out = self.layout, np.zeros((*tau.shape[:-1], len(self.layout.names)))
        if layout.base == "ski":
            (cosine, sine), forward, left = self.heading, tau[..., 0], tau[..., 1]
            out[..., 0], out[..., 1], out[..., 2] = cosine * forward - sine * left, sine * forward + cosine * left, tau[..., 2]
            out[..., 3 : layout.base_size] = tau[..., 3 : layout.base_size]
        else:
            out[..., : layout.base_size] = tau[..., : layout.base_size]
        out[..., self.xi] = tau[..., self.slides]
        if layout.plane:
            out[..., self.psi] = tau[..., self.hinges]
            np.subtract.at(out, self.psi_outer, tau[..., self.hinges[self.inner]])
            return out
        moments = tau[..., self.balls]  # (..., n, 3)
        on_parent = np.einsum("iab,...ib->...ia", self.from_parent, moments)
        out[..., self.phi] = self.cos_psi * moments[..., 2]
        out[..., self.psi] = -moments[..., 1]
        np.subtract.at(out, self.phi_outer, self.cos_psi[self.outer] * on_parent[..., self.inner, 2])
        np.add.at(out, self.psi_outer, on_parent[..., self.inner, 1])
        if layout.base == "ski":
            out[..., 2] -= on_parent[..., self.roots, 2].sum(axis=-1)
        return out

    def _omega(self, rates: Array) -> Array:
        """Angular velocities of the links in their own frames (..., n, 3)."""
        omega = np.zeros((*rates.shape[:-1], len(self.layout.links), 3))
        omega[..., 1], omega[..., 2] = -rates[..., self.psi], self.cos_psi * rates[..., self.phi]
        return omega

    def _yaw(self, rates: Array) -> Array | None:
        return rates[..., 2] if self.layout.base == "ski" else None

    def _of_parent(self, vectors: Array, yaw: Array | None) -> Array:
        """Vectors of the parents in the frames of the links (..., n, 3); of a ski (0, 0, yaw), of another base 0."""
        before = np.zeros_like(vectors)
        before[..., self.inner, :] = vectors[..., self.outer, :]
        if yaw is not None:
            before[..., self.roots, 2] = yaw[..., None]
        return np.einsum("iba,...ib->...ia", self.from_parent, before)
