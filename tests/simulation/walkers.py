"""Scenes of walkers for tests."""

from __future__ import annotations

import numpy as np

import vlmb

TIGHT = {"rtol": 1e-11, "atol": 1e-12}


COMPASS = (0.218668802939, -0.323388558059, -1.092383589884, -0.377373948907)


def compass(duration=7.2, state=COMPASS, **run):
    """Make the compass gait of Goswami, Thuilot and Espiau, after an impact; its left leg stands."""
    stance, swing, rate, other = state
    slope = np.radians(3.0)
    a = stance + slope
    leg = {"parent": "base", "rod": {"length": 1.0, "mass": 5.0, "com": 0.5, "inertia": 0.0}}
    return vlmb.Scene.from_dict({
        "plane": True, "slope": slope, "base": {"kind": "free", "mass": 10.0},
        "links": [{"name": "left", **leg}, {"name": "right", **leg}],
        "contacts": [
            {"name": "l", "point": "left.tip", "when": "left.tip.x > right.tip.x + 0.1"},
            {"name": "r", "point": "right.tip", "when": "right.tip.x > left.tip.x + 0.1"},
        ],
        "start": {
            "x": -np.sin(a), "z": np.cos(a), "psi1": a - np.pi / 2, "psi2": swing + slope - np.pi / 2,
            "x_dot": -rate * np.cos(a), "z_dot": -rate * np.sin(a), "psi1_dot": rate, "psi2_dot": other,
        },
        "run": {**TIGHT, "duration": duration, "fall": False, **run},
    })


def wheel(spokes=8, slope=0.08, duration=5.0, speed=1.2, mass=0.01):
    """Make a rimless wheel: a hub of 1 kg, spokes of 1 m, each with a contact. It begins on the spoke behind."""
    half = np.pi / spokes
    names = [f"s{k}" for k in range(spokes)]
    start = {f"psi{k + 1}": -np.pi / 2 + half + 2 * half * k for k in range(spokes)}
    start |= {f"psi{k + 1}_dot": -speed for k in range(spokes)}
    hub = np.array([-np.sin(half), np.cos(half)])
    return vlmb.Scene.from_dict({
        "plane": True, "slope": slope, "base": {"kind": "free", "mass": 1.0},
        "links": [{"name": name, "parent": "base", "rod": {"length": 1.0, "mass": mass}} for name in names],
        "constraints": [f"psi{k + 1} = psi1 + {2 * half * k!r}" for k in range(1, spokes)],
        "contacts": [{"point": f"{name}.tip"} for name in names],
        "start": start | {"x": hub[0], "z": hub[1], "x_dot": speed * hub[1], "z_dot": -speed * hub[0]},
        "run": {**TIGHT, "duration": duration, "fall": False},
    })


def simplest(beta, duration=4.0, theta=0.20031090054425, rate=-0.19983247300495):
    """Make the simplest walker on a slope of 0.009, with feet of mass beta; its left leg stands."""
    slope = 0.009
    swing, swing_rate = 2 * theta, (1 - np.cos(2 * theta)) * rate
    d = np.array([-np.sin(theta), np.cos(theta)])  # from the foot to the hip
    leg = {"parent": "base", "rod": {"length": 1.0, "mass": 0.0}, "tip_mass": beta}
    return vlmb.Scene.from_dict({
        "plane": True, "slope": slope, "gravity": 1.0, "base": {"kind": "free", "mass": 1.0},
        "links": [{"name": "left", **leg}, {"name": "right", **leg}],
        "contacts": [
            {"name": "l", "point": "left.tip", "when": "left.tip.x > right.tip.x + 0.1"},
            {"name": "r", "point": "right.tip", "when": "right.tip.x > left.tip.x + 0.1"},
        ],
        "start": {
            "x": d[0], "z": d[1], "psi1": theta - np.pi / 2, "psi2": theta - swing - np.pi / 2,
            "x_dot": -rate * np.cos(theta), "z_dot": -rate * np.sin(theta), "psi1_dot": rate, "psi2_dot": rate - swing_rate,
        },
        "run": {**TIGHT, "duration": duration, "fall": False},
    })
