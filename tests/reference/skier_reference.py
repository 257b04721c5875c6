"""The one-link skier under a programme, in the paper's coordinates: no Pinocchio, no quaternions, no frames.

Lagrange's equations of (x, y, phi0, phi1, psi1, xi1_1) from `symbolic`, the knife edge and, where it is ideal, (8.1) with
multipliers, and section 5 written out by hand:

    M qddot + h = P u + E^T lambda,  E = (-sin phi0, cos phi0, 0, ...), (0, 0, -1, 1, 0, 0),  E qdot = 0
    z = (7.5), (8.1), (8.2), lean;  W = dz/dq;  G = W b,  beta = H z + K z' - chi,  G u = beta of least weighted norm
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tests.reference.symbolic import lagrange_equations

Array = NDArray[np.float64]

NAMES = ("x", "y", "phi0", "phi1", "psi1", "xi1_1")
COORDINATE = {"M_phi0": "phi0", "M_phi1": "phi1", "M_psi1": "psi1", "F1_1": "xi1_1", "F_x": "x"}
CONTROLS = tuple(COORDINATE)
ROWS = ("tan(phi0) = A*k*cos(k*x)", "phi1 = phi0", "(xi1_1 + l1)*sin(psi1) = L + D*sin(w*t)", "psi1 = lean")


@dataclass(frozen=True)
class Skier:
    """A ski of mass m0 and inertia I0 (about A), a uniform rod (l1, m1) on the free length xi1_1, a mass mB above xi1_2."""

    m0: float = 5.0
    inertia: float = 0.6
    l1: float = 0.5
    m1: float = 30.0
    mb: float = 40.0
    upper: float = 0.2  # xi1_2, fixed [m]
    slope: float = 0.1  # [rad]
    amplitude: float = 0.8  # A [m]
    wave: float = 0.6  # k [1/m]
    height: float = 0.75  # L [m]
    swing: float = 0.05  # D [m]
    beat: float = 2.0  # w [rad/s]
    lean: float = 1.2  # [rad]
    frequency: tuple[float, ...] = (4.0, 3.0, 5.0, 6.0)  # [rad/s], one a row
    damping: tuple[float, ...] = (1.0, 0.8, 1.2, 1.0)
    scales: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)  # 1/sqrt(weight), one a control
    controls: tuple[str, ...] = CONTROLS[:4]
    rows: tuple[int, ...] = (0, 1, 2, 3)  # of ROWS
    ideal: bool = False  # (8.1) as an ideal constraint
    start: dict[str, float] = field(
        default_factory=lambda: {"x": 0.1, "y": -0.2, "phi0": 0.35, "phi1": 0.15, "psi1": 1.05, "xi1_1": 0.33}
    )
    rates: dict[str, float] = field(
        default_factory=lambda: {"speed": 4.0, "phi0_dot": 0.2, "phi1_dot": -0.3, "psi1_dot": 0.15, "xi1_1_dot": -0.1}
    )

    @property
    def data(self) -> list[float]:
        """Constants in the order of `symbolic`: gravity, slope, ski, link."""
        rod = [self.l1, self.m1, self.mb, self.l1 / 2.0, self.m1 * self.l1**2 / 12.0]
        return [9.81, self.slope, self.m0, self.inertia, 0.0, *rod]

    def scene(self, **run: Any) -> dict[str, Any]:
        """The same as a scene of the engine."""
        weights = {name: scale**-2 for name, scale in zip(self.controls, self.scales, strict=True)}
        programme = {
            "constraints": [ROWS[k] for k in self.rows], "controls": list(self.controls), "frequency": list(self.frequency),
            "damping_ratio": list(self.damping), "weights": weights,
        }  # fmt: skip
        leg = {
            "name": "legs", "rod": {"length": self.l1, "mass": self.m1}, "lower": {"length": 0.3}, "tip_mass": self.mb,
            "upper": {"length": self.upper, "motion": "fixed"},
        }  # fmt: skip
        return {
            "slope": self.slope, "base": {"kind": "ski", "mass": self.m0, "inertia": self.inertia}, "links": [leg],
            "parameters": {"A": self.amplitude, "k": self.wave, "l1": self.l1, "L": self.height, "D": self.swing,
                           "w": self.beat, "lean": self.lean},
            "start": {**self.start, **self.rates}, "programme": programme, "run": run,
            "constraints": [ROWS[1]] if self.ideal else [],
        }  # fmt: skip


class Reference(NamedTuple):
    """A run: arrays over t, coordinates and controls by name, multipliers, z and z' by row.

    `edge` is positive to the ski's left, `reaction` the moment of (8.1) on phi1, 0 where it is not ideal.
    """

    t: Array
    coordinates: dict[str, Array]
    controls: dict[str, Array]
    edge: Array
    reaction: Array
    z: Array  # (N, r)
    rate: Array  # (N, r)


class _Instant(NamedTuple):
    acceleration: Array
    controls: Array
    multipliers: Array
    z: Array
    rate: Array


def simulate(skier: Skier, times: Array) -> Reference:
    """Integrate by DOP853 to its last digits."""
    phi0, speed = skier.start["phi0"], skier.rates["speed"]
    rates = {**skier.rates, "x_dot": speed * math.cos(phi0), "y_dot": speed * math.sin(phi0)}
    start = [skier.start[name] for name in NAMES] + [rates[f"{name}_dot"] for name in NAMES]

    def rhs(t: float, state: Array) -> Array:
        return np.concatenate([state[6:], _instant(skier, t, state).acceleration])

    found = solve_ivp(rhs, (times[0], times[-1]), start, "DOP853", t_eval=times, rtol=1e-12, atol=1e-13)
    assert found.success, found.message
    now = [_instant(skier, t, state) for t, state in zip(times, found.y.T, strict=True)]
    return Reference(
        times,
        dict(zip(NAMES, found.y[:6], strict=True)),
        dict(zip(skier.controls, np.array([i.controls for i in now]).T, strict=True)),
        np.array([i.multipliers[0] for i in now]),
        np.array([i.multipliers[1] if skier.ideal else 0.0 for i in now]),
        np.array([i.z for i in now]),
        np.array([i.rate for i in now]),
    )


def _instant(skier: Skier, t: float, state: Array) -> _Instant:
    q, v = state[:6], state[6:]
    matrix, h = lagrange_equations(1, True)([*q, skier.upper], [*v, 0.0], skier.data)
    matrix, h = matrix[:6, :6], h[:6]
    held = np.array([[-math.sin(q[2]), math.cos(q[2]), 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0, 0.0, 0.0]])[: 1 + skier.ideal]
    turning = np.array([-v[2] * (math.cos(q[2]) * v[0] + math.sin(q[2]) * v[1]), 0.0])[: len(held)]  # d/dt(E) qdot
    actuated = np.array([[float(COORDINATE[control] == name) for control in skier.controls] for name in NAMES])
    kkt = np.block([[matrix, -held.T], [held, np.zeros((len(held), len(held)))]])
    right = np.zeros((len(kkt), 1 + len(skier.controls)))
    right[:6, 0], right[6:, 0], right[:6, 1:] = -h, -turning, actuated
    answer = np.linalg.solve(kkt, right)
    z, w, curve, motion = (part[list(skier.rows)] for part in _rows(skier, t, q, v))
    rate = w @ v + motion
    gains = np.array(skier.frequency)
    beta = -(gains**2) * z - 2.0 * np.array(skier.damping) * gains * rate - (w @ answer[:6, 0] + curve)
    scales = np.array(skier.scales)
    u = scales * (np.linalg.pinv(w @ answer[:6, 1:] * scales) @ beta)
    whole = answer[:, 0] + answer[:, 1:] @ u
    return _Instant(whole[:6], u, whole[6:], z, rate)


def _rows(skier: Skier, t: float, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
    """z, W, the part of z'' without accelerations, and dz/dt at rest, all by hand."""
    x, _, phi0, phi1, psi1, xi = q
    dx, _, dphi0, _, dpsi1, dxi = v
    a, k, w, length = skier.amplitude, skier.wave, skier.beat, xi + skier.l1
    tangent, secant = math.tan(phi0), 1.0 / math.cos(phi0) ** 2
    sin, cos = math.sin(psi1), math.cos(psi1)
    wave = skier.swing * math.sin(w * t)
    z = np.array([tangent - a * k * math.cos(k * x), phi1 - phi0, length * sin - skier.height - wave, psi1 - skier.lean])
    jacobian = np.zeros((4, 6))
    jacobian[0, 0], jacobian[0, 2] = a * k**2 * math.sin(k * x), secant
    jacobian[1, 2], jacobian[1, 3] = -1.0, 1.0
    jacobian[2, 4], jacobian[2, 5] = length * cos, sin
    jacobian[3, 4] = 1.0
    curve = np.zeros(4)
    curve[0] = 2.0 * secant * tangent * dphi0**2 + a * k**3 * math.cos(k * x) * dx**2
    curve[2] = 2.0 * dxi * dpsi1 * cos - length * sin * dpsi1**2 + w**2 * wave
    motion = np.array([0.0, 0.0, -skier.swing * w * math.cos(w * t), 0.0])
    return z, jacobian, curve, motion
