"""Initial-value problems with known solutions."""

from __future__ import annotations

import numpy as np

E = 0.5  # eccentricity of the orbit


def oscillator(t, y):
    return np.array([y[1], -y[0]])


def oscillator_at(t):
    return np.array([np.cos(t), -np.sin(t)])


def kepler(t, y):
    r3 = (y[0] ** 2 + y[1] ** 2) ** 1.5
    return np.array([y[2], y[3], -y[0] / r3, -y[1] / r3])


def kepler_at(t):
    """Kepler's equation u - e sin u = t by Newton's method."""
    u = t
    for _ in range(60):
        u -= (u - E * np.sin(u) - t) / (1.0 - E * np.cos(u))
    b, r = np.sqrt(1.0 - E * E), 1.0 - E * np.cos(u)
    return np.array([np.cos(u) - E, b * np.sin(u), -np.sin(u) / r, b * np.cos(u) / r])


def ball(t, y):
    return np.array([y[1], -9.81])
