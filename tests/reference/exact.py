"""Motions known in closed form, as functions of time; numpy and scipy alone.

Each function returns a dict of arrays over `t`, keyed as the scene's coordinates (`x`, `phi0`, `phi1`, `psi1`,
`xi1_1`), their rates (`phi1_dot`) and forces, so that entries compare directly with those of a run.
Azimuth phi, elevation psi from the surface, gravity (g sin(slope), 0, -g cos(slope)); units m, rad, s, kg, N.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

Array = npt.NDArray[np.float64]
Law = Callable[[float], tuple[float, float, float]]
Solution = dict[str, Array]


def cumulative(function: Callable[[float], float], t: npt.ArrayLike) -> Array:
    """Integral of a function from t[0] to each t, by adaptive quadrature between neighbours."""
    times = np.asarray(t, dtype=float)
    pieces = [quad(function, a, b, epsabs=1e-14, epsrel=1e-13)[0] for a, b in pairwise(times)]
    return np.concatenate([[0.0], np.cumsum(pieces)])


def skate(
    t: npt.ArrayLike,
    mass: float,
    slope: float,
    yaw_rate: float,
    heading: float = 0.0,
    speed: float = 0.0,
    gravity: float = 9.81,
) -> Solution:
    r"""Skate on a slope, centre of mass over the edge: from rest and heading 0 a cycloid without net descent.

    With G = g sin(slope), phi0 = heading + w t:  speed' = G cos(phi0),  N = m (speed w + G sin(phi0)), so from rest
    x = G sin^2(wt)/(2 w^2),  y = G (wt - sin(2wt)/2)/(2 w^2),  N = 2 m G sin(wt).

    Parameters
    ----------
    yaw_rate : w [rad/s], not zero; it stays what it is. speed : along the ski at t = 0 [m/s].
    """
    t, w, force = np.asarray(t, dtype=float), yaw_rate, gravity * math.sin(slope)
    phi = heading + w * t
    rest = speed - force * math.sin(heading) / w
    along = rest + force * np.sin(phi) / w
    x = rest * (np.sin(phi) - math.sin(heading)) / w + force / (2 * w**2) * (np.sin(phi) ** 2 - math.sin(heading) ** 2)
    y = -rest * (np.cos(phi) - math.cos(heading)) / w
    y += force / w**2 * (w * t / 2.0 - (np.sin(2.0 * phi) - math.sin(2.0 * heading)) / 4.0)
    return {
        "x": x,
        "y": y,
        "phi0": phi,
        "x_dot": along * np.cos(phi),
        "y_dot": along * np.sin(phi),
        "phi0_dot": np.full_like(t, w),
        "speed": along,
        "knife_edge": mass * (along * w + force * np.sin(phi)),
    }


def sleigh(t: npt.ArrayLike, mass: float, inertia: float, com_offset: float, speed: float, yaw_rate: float) -> Solution:
    r"""Chaplygin's sleigh on a level surface, from heading 0 at the origin, centre of mass a > 0 ahead of the edge.

    With J = I + m a^2:  speed = U tanh(s),  phi0' = W / cosh(s),  s = kappa t + s0,  U^2 m = J W^2,  kappa = m a U / J;
    N = m (speed phi0' + a phi0'').

    Parameters
    ----------
    inertia : about the centre of mass. speed, yaw_rate : at t = 0, yaw_rate not zero.
    """
    t = np.asarray(t, dtype=float)
    whole = inertia + mass * com_offset**2
    top = math.sqrt(speed**2 + whole / mass * yaw_rate**2)
    spin = math.copysign(top * math.sqrt(mass / whole), yaw_rate)
    kappa, shift = mass * com_offset * top / whole, math.atanh(speed / top)

    def heading(time: npt.ArrayLike) -> Array:
        s = kappa * np.asarray(time) + shift
        return 2.0 * spin / kappa * (np.arctan(np.tanh(s / 2.0)) - math.atan(math.tanh(shift / 2.0)))

    s = kappa * t + shift
    along, turn, phi = top * np.tanh(s), spin / np.cosh(s), heading(t)
    turning = -spin * kappa * np.tanh(s) / np.cosh(s)

    def part(function: Callable[[float], float]) -> Array:
        return cumulative(lambda time: top * math.tanh(kappa * time + shift) * function(float(heading(time))), t)

    return {
        "x": part(math.cos),
        "y": part(math.sin),
        "phi0": phi,
        "x_dot": along * np.cos(phi),
        "y_dot": along * np.sin(phi),
        "phi0_dot": turn,
        "speed": along,
        "knife_edge": mass * (along * turn + com_offset * turning),
    }


def programmed_length(
    t: npt.ArrayLike,
    law: Law,
    azimuth_rate: float,
    azimuth: float = 0.0,
    tip_mass: float = 1.0,
    rod_mass: float = 0.0,
    rod_length: float = 0.0,
) -> Solution:
    r"""Level link (psi1 = 0, no gravity) whose lower segment follows a law xi(t): angular momentum is kept.

    J(xi) phi1' = h with J = m (xi^2 + xi l + l^2/3) + m_tip (xi + l)^2;  for a mass alone l^2 phi' = h, so
    phi = phi_0 + h int dt / l^2.  Servo force F = (m + m_tip) xi'' - (m (xi + l/2) + m_tip (xi + l)) phi'^2;
    its work is the gain of kinetic energy.

    Parameters
    ----------
    law : t -> (xi, rate, acceleration). azimuth_rate : phi1' at t[0]. The upper segment is fixed at length 0.
    """
    times = np.asarray(t, dtype=float)

    def inertia(xi: float) -> float:
        return rod_mass * (xi**2 + xi * rod_length + rod_length**2 / 3.0) + tip_mass * (xi + rod_length) ** 2

    momentum = inertia(law(float(times[0]))[0]) * azimuth_rate
    xi, rate, acceleration = np.array([law(float(time)) for time in times]).T
    phi_rate = momentum / np.array([inertia(value) for value in xi])
    first = rod_mass * (xi + rod_length / 2.0) + tip_mass * (xi + rod_length)
    kinetic = 0.5 * momentum * phi_rate + 0.5 * (rod_mass + tip_mass) * rate**2
    return {
        "phi1": azimuth + cumulative(lambda time: momentum / inertia(law(time)[0]), times),
        "psi1": np.zeros_like(times),
        "xi1_1": xi,
        "phi1_dot": phi_rate,
        "psi1_dot": np.zeros_like(times),
        "xi1_1_dot": rate,
        "force": (rod_mass + tip_mass) * acceleration - first * phi_rate**2,
        "work": kinetic - kinetic[0],
        "kinetic": kinetic,
    }


def conical_spring_pendulum(
    mass: float, stiffness: float, natural_length: float, angle: float, gravity: float = 9.81
) -> dict[str, float]:
    r"""Mass on a spring going round at a constant angle to the downward vertical.

    r = l0 + m g / (k cos(angle)),  rate^2 = g / (r cos(angle)).  Returns `length` (= `xi1_1`), `psi1`, `phi1_dot`.
    """
    length = natural_length + mass * gravity / (stiffness * math.cos(angle))
    return {
        "length": length,
        "xi1_1": length,
        "psi1": angle - math.pi / 2.0,
        "phi1_dot": math.sqrt(gravity / (length * math.cos(angle))),
    }


def conical_rod_pendulum(
    stiffness: float,
    natural_length: float,
    angle: float,
    rod_mass: float,
    rod_length: float,
    tip_mass: float = 0.0,
    gravity: float = 9.81,
) -> dict[str, float]:
    r"""The same with a uniform rod between the spring (lower segment) and the mass, upper segment of length 0.

    J w^2 cos(angle) = g S,  (m + m_tip) g cos(angle) + S w^2 sin^2(angle) = k (xi - l0): one equation for xi.
    """
    cos, sin = math.cos(angle), math.sin(angle)

    def rate_squared(xi: float) -> tuple[float, float]:
        first = rod_mass * (xi + rod_length / 2.0) + tip_mass * (xi + rod_length)
        second = rod_mass * (xi**2 + xi * rod_length + rod_length**2 / 3.0) + tip_mass * (xi + rod_length) ** 2
        return gravity * first / (second * cos), first

    def residual(xi: float) -> float:
        square, first = rate_squared(xi)
        pull = (rod_mass + tip_mass) * gravity * cos + first * square * sin**2
        return pull - stiffness * (xi - natural_length)

    high = natural_length + 1.0
    while residual(high) > 0.0:
        high *= 2.0
    xi = brentq(residual, natural_length, high, xtol=1e-15, rtol=8.9e-16)
    return {"xi1_1": xi, "psi1": angle - math.pi / 2.0, "phi1_dot": math.sqrt(rate_squared(xi)[0])}


def pendulum(
    t: npt.ArrayLike,
    first_moment: float,
    inertia: float,
    amplitude: float | None = None,
    bottom_rate: float | None = None,
    gravity: float = 9.81,
) -> Solution:
    r"""Plane pendulum, J theta'' = -g S sin(theta), theta from the downward vertical; psi1 = theta - pi/2, phi1 kept.

    From rest at the amplitude: sin(theta/2) = k sn(w t + K, k), k = sin(amplitude/2), w^2 = g S / J.
    From the bottom with a rate: k = rate/(2 w); k < 1 as above without K, k > 1 turns over the top, through the poles:
    theta = 2 am(rate t / 2, 1/k); k = 1 sin(theta/2) = tanh(w t).

    Parameters
    ----------
    first_moment : S = sum m r [kg m]. inertia : J about the hinge [kg m^2]. One of amplitude and bottom_rate.
    """
    t = np.asarray(t, dtype=float)
    w = math.sqrt(gravity * first_moment / inertia)
    if (amplitude is None) == (bottom_rate is None):
        raise ValueError("give either amplitude or bottom_rate")
    if bottom_rate is not None and abs(bottom_rate) > 2.0 * w:
        k = bottom_rate / (2.0 * w)
        _, _, dn, am = ellipj(bottom_rate * t / 2.0, 1.0 / k**2)
        theta, rate = 2.0 * am, bottom_rate * dn
    elif bottom_rate is not None and abs(bottom_rate) == 2.0 * w:
        theta = 2.0 * np.arcsin(np.tanh(w * t)) * math.copysign(1.0, bottom_rate)
        rate = bottom_rate / np.cosh(w * t)
    else:
        k = math.sin(amplitude / 2.0) if amplitude is not None else (bottom_rate or 0.0) / (2.0 * w)
        sn, cn, _, _ = ellipj(w * t + (ellipk(k**2) if amplitude is not None else 0.0), k**2)
        theta, rate = 2.0 * np.arcsin(k * sn), 2.0 * k * w * cn
    return {"theta": theta, "theta_dot": rate, "psi1": theta - math.pi / 2.0, "psi1_dot": rate}


def rod_moments(length: float, mass: float, offset: float = 0.0, tip_mass: float = 0.0) -> tuple[float, float]:
    """First moment S and inertia J about the hinge of a uniform rod `offset` from it with a mass at its far end."""
    far = offset + length
    first = mass * (offset + length / 2.0) + tip_mass * far
    return first, mass * (offset**2 + offset * length + length**2 / 3.0) + tip_mass * far**2


def parabola(
    t: npt.ArrayLike, position: npt.ArrayLike, velocity: npt.ArrayLike, gravity: float = 9.81, slope: float = 0.0
) -> Array:
    """Centre of mass of anything that flies, (N, 3)."""
    t = np.asarray(t, dtype=float)[:, None]
    pull = gravity * np.array([math.sin(slope), 0.0, -math.cos(slope)])
    path: Array = np.asarray(position, dtype=float) + np.asarray(velocity, dtype=float) * t + 0.5 * pull * t**2
    return path


def free_link(
    t: npt.ArrayLike,
    phi: float,
    psi: float,
    phi_rate: float,
    psi_rate: float,
    com_distance: float,
    hinge: npt.ArrayLike = (0.0, 0.0, 0.0),
    hinge_velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
    gravity: float = 9.81,
    slope: float = 0.0,
) -> Solution:
    r"""One rigid link in free flight: torque-free about its centre of mass, which falls.

    Any link here has equal transverse inertias and no spin, so its direction turns in one plane at one rate:
    d = d_0 cos(W t) + (d_0'/W) sin(W t), W = |d_0'|.  Returns `direction`, `hinge`, `center_of_mass`, (N, 3) each.
    """
    t = np.asarray(t, dtype=float)
    start = np.array([math.cos(phi) * math.cos(psi), math.sin(phi) * math.cos(psi), math.sin(psi)])
    rate = phi_rate * np.array([-start[1], start[0], 0.0])
    rate += psi_rate * np.array([-math.cos(phi) * math.sin(psi), -math.sin(phi) * math.sin(psi), math.cos(psi)])
    spin = float(np.linalg.norm(rate))
    angle = spin * t[:, None]
    turned = start * np.cos(angle) + (rate / spin if spin else rate) * np.sin(angle)
    com = parabola(
        t,
        np.asarray(hinge, dtype=float) + com_distance * start,
        np.asarray(hinge_velocity, dtype=float) + com_distance * rate,
        gravity,
        slope,
    )
    return {"direction": turned, "center_of_mass": com, "hinge": com - com_distance * turned}


def vertical_oscillator(
    t: npt.ArrayLike,
    mass: float,
    stiffness: float,
    rest: float,
    length: float,
    rate: float = 0.0,
    damping: float = 0.0,
    up: bool = True,
    gravity: float = 9.81,
) -> Solution:
    r"""Link straight up (psi1 = pi/2) or down on its lower segment's spring: m xi'' = -k (xi - rest) - c xi' -+ m g.

    Parameters
    ----------
    mass : everything beyond the spring. length, rate : xi1_1 and its rate at t = 0. damping : below critical.
    """
    t = np.asarray(t, dtype=float)
    middle = rest - (mass * gravity if up else -mass * gravity) / stiffness
    decay = damping / (2.0 * mass)
    w = math.sqrt(stiffness / mass - decay**2)
    a, b = length - middle, (rate + decay * (length - middle)) / w
    wave, slope = a * np.cos(w * t) + b * np.sin(w * t), w * (b * np.cos(w * t) - a * np.sin(w * t))
    return {"xi1_1": middle + np.exp(-decay * t) * wave, "xi1_1_dot": np.exp(-decay * t) * (slope - decay * wave)}
