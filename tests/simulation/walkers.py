"""Scenes of walkers for tests."""

from __future__ import annotations

import numpy as np

import vlmb

TIGHT = {"rtol": 1e-11, "atol": 1e-12}


def compass(slope=np.radians(3.0), duration=7.2, **run):
    """Make the compass gait of Goswami, Thuilot and Espiau, after an impact; its left leg stands."""
    stance, swing, rate, other = 0.218668802939, -0.323388558059, -1.092383589884, -0.377373948907
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


def wheel(spokes=8, slope=0.08, duration=6.0, speed=1.6):
    """Make McGeer's rimless wheel: a mass on rigid spokes without mass, each with a contact. Begins on the spoke behind."""
    half = np.pi / spokes
    links, contacts = [], []
    for k in range(spokes):
        links.append({"name": f"s{k}", "parent": "base", "rod": {"length": 1.0, "mass": 0.0}})
        contacts.append({"point": f"s{k}.tip"})
    angles = [-np.pi / 2 + half - 2 * half * k for k in range(spokes)]
    return links, contacts, angles, speed, slope, duration
