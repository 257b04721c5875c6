"""Two rods swinging in a vertical plane, to 30 digits and more: Taylor series of high order.

Elevations psi1, psi2 from the horizontal, D = psi1 - psi2:

    J1 psi1'' + C cos(D) psi2'' + C sin(D) psi2'^2 + g S1 cos(psi1) = 0
    J2 psi2'' + C cos(D) psi1'' - C sin(D) psi1'^2 + g S2 cos(psi2) = 0

The series come from recurrences (products, quotient, sine and cosine of a series) in decimal
arithmetic, so no derivative is approximated; mpmath gives the first sine and cosine. The last terms set the step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from operator import mul
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
State = list[Decimal]


@dataclass(frozen=True)
class TwoRods:
    """Uniform rods (length [m], mass [kg], tip mass [kg]); the second hangs on the first one's end."""

    lengths: tuple[float, float] = (0.5, 0.5)
    masses: tuple[float, float] = (2.0, 2.0)
    tips: tuple[float, float] = (0.0, 0.0)
    gravity: float = 9.81

    def scene(self, psi: Sequence[float], rates: Sequence[float], **keys: Any) -> dict[str, Any]:
        """The same as a scene of the engine, with rigid links."""
        links = [
            {"name": f"link{i + 1}", "rod": {"length": self.lengths[i], "mass": self.masses[i]}, "tip_mass": self.tips[i]}
            for i in range(2)
        ]
        start = {"psi1": psi[0], "psi2": psi[1], "psi1_dot": rates[0], "psi2_dot": rates[1]}
        return {"base": {"kind": "pivot"}, "gravity": self.gravity, "links": links, "start": start, **keys}

    def motion(self, psi: Sequence[Any], rates: Sequence[Any], times: Sequence[float], digits: int = 30) -> list[State]:
        """(psi1, psi2, psi1', psi2') at each time, to about `digits` digits before chaos takes its share."""
        with localcontext(Context(prec=digits + 8)), mpmath.workdps(digits + 8):
            state = [Decimal(value) for value in (*psi, *rates)]
            order, start, found = int(1.2 * digits) + 4, Decimal(0), []
            series, reach = self._series(state, order, digits)
            for time in map(Decimal, times):
                while start + reach < time:
                    state = [_sum(terms, reach) for terms in series]
                    start += reach
                    series, reach = self._series(state, order, digits)
                found.append([_sum(terms, time - start) for terms in series])
            return found

    def positions(self, states: Sequence[State]) -> Array:
        """Far ends (samples, links, 2) [m] of the rods in the plane, horizontal and up."""
        with mpmath.workdps(40):
            turned = [[_sine_and_cosine(angle) for angle in state[:2]] for state in states]
        ends = np.array([[[float(cos), float(sin)] for sin, cos in pair] for pair in turned])
        return np.cumsum(ends * np.array(self.lengths)[:, None], axis=1)

    def energy(self, state: State) -> float:
        """Kinetic and potential energy [J]."""
        psi1, psi2, u, w = map(float, state)
        j1, j2, c, s1, s2 = map(float, self._moments())
        kinetic = j1 * u**2 / 2 + j2 * w**2 / 2 + c * math.cos(psi1 - psi2) * u * w
        return kinetic + self.gravity * (s1 * math.sin(psi1) + s2 * math.sin(psi2))

    def _moments(self) -> tuple[Decimal, ...]:
        """J1, J2, C, S1, S2."""
        (l1, l2), (m1, m2), (e1, e2) = (tuple(map(Decimal, pair)) for pair in (self.lengths, self.masses, self.tips))
        beyond = m2 + e1 + e2
        first, second = (m1 / 3 + beyond) * l1**2, (m2 / 3 + e2) * l2**2
        return first, second, l1 * l2 * (m2 / 2 + e2), l1 * (m1 / 2 + beyond), l2 * (m2 / 2 + e2)

    def _series(self, state: State, order: int, digits: int) -> tuple[list[State], Decimal]:
        """Taylor coefficients of both elevations and both rates, and how far they reach."""
        j1, j2, c, s1, s2 = self._moments()
        g, zero = Decimal(self.gravity), Decimal(0)
        psi, rate = [[state[0]], [state[1]]], [[state[2]], [state[3]]]
        turned = [_sine_and_cosine(angle) for angle in (state[0], state[1], state[0] - state[1])]
        sin, cos = [[pair[0]] for pair in turned], [[pair[1]] for pair in turned]
        slopes: list[State] = [[], [], []]  # n times the n-th coefficient of psi1, psi2 and D, from n = 1
        bent, straight, left, right, whole = [], [], [], [], []  # C sin D, C cos D, two right sides, the determinant
        squares: list[State] = [[], []]
        accelerations: list[State] = [[], []]
        for n in range(order):
            bent.append(c * sin[2][n])
            straight.append(c * cos[2][n])
            for k in (0, 1):
                squares[k].append(_product(rate[k], rate[k]))
            left.append(-_product(bent, squares[1]) - g * s1 * cos[0][n])
            right.append(_product(bent, squares[0]) - g * s2 * cos[1][n])
            whole.append((zero if n else j1 * j2) - _product(straight, straight))
            over = j2 * left[n] - _product(straight, right), j1 * right[n] - _product(straight, left)
            for k in (0, 1):
                accelerations[k].append((over[k] - _product(whole[1:], accelerations[k])) / whole[0])
                psi[k].append(rate[k][n] / (n + 1))
                rate[k].append(accelerations[k][n] / (n + 1))
            for a in range(3):
                slopes[a].append(rate[a][n] if a < 2 else rate[0][n] - rate[1][n])
                sine, cosine = _product(slopes[a], sin[a]), _product(slopes[a], cos[a])
                sin[a].append(cosine / (n + 1))
                cos[a].append(-sine / (n + 1))
        last = max(abs(terms[k]) ** (Decimal(1) / k) for terms in (*psi, *rate) for k in (order - 1, order))
        return [*psi, *rate], Decimal(10) ** (-Decimal(digits + 3) / order) / last


def _product(first: State, second: State) -> Decimal:
    """Last coefficient of a product of two series: sum of first_k second_(n-k)."""
    return sum(map(mul, first, reversed(second)), Decimal(0))


def _sum(terms: State, t: Decimal) -> Decimal:
    value = Decimal(0)
    for term in reversed(terms):
        value = value * t + term
    return value


def _sine_and_cosine(angle: Decimal) -> tuple[Decimal, Decimal]:
    at, digits = mpmath.mpf(str(angle)), mpmath.mp.dps
    return Decimal(mpmath.nstr(mpmath.sin(at), digits + 2)), Decimal(mpmath.nstr(mpmath.cos(at), digits + 2))


def growth_rate(apart: Array, times: Array) -> float:
    """Rate [1/s] at which a distance grows: slope of its logarithm by least squares."""
    return float(np.polyfit(times, np.log(apart), 1)[0])
