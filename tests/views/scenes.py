"""Scenes that are looked at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

MODELS = Path(__file__).resolve().parents[2] / "models"
SKIER: dict[str, Any] = {
    "name": "skier", "slope": 0.3, "base": {"kind": "ski", "mass": 5.0, "inertia": 0.6},
    "links": [{
        "name": "legs", "rod": {"length": 0.5, "mass": 30.0}, "tip_mass": 40.0,
        "lower": {"length": 0.25, "stiffness": 9e3, "rest": 0.3}, "upper": {"length": 0.2, "stiffness": 9e3, "rest": 0.25},
    }],
    "start": {"phi0": 0.4, "phi1": 0.4, "psi1": 1.5, "speed": 6.0}, "run": {"duration": 0.5},
}  # fmt: skip
TREE: dict[str, Any] = {
    "name": "tree", "base": {"kind": "free", "mass": 1.0},
    "links": [
        {"name": "trunk", "rod": {"length": 0.5, "mass": 3.0}, "tip_mass": 1.0,
         "upper": {"motion": "prescribed", "law": "0.2 + 0.05*sin(6*t)"}},
        {"name": "left", "parent": "trunk", "parent_point": "rod_end", "rod": {"length": 0.3, "mass": 1.0}, "tip_mass": 0.5,
         "lower": {"length": 0.2, "stiffness": 100.0}},
        {"name": "right", "parent": "trunk", "parent_point": "rod_start", "rod": {"length": 0.3, "mass": 1.0}, "tip_mass": 0.5},
    ],
    "start": {"psi1": 1.2, "psi2": 0.3, "phi2": 1.5, "psi3": 0.2, "phi3": -1.5, "z": 1.0, "phi1_dot": 2.0},
    "run": {"duration": 0.5, "fall": False},
}  # fmt: skip
