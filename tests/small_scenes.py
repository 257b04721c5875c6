"""Small scenes for tests: dicts with the keys of a scene file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

import vlmb

Table = dict[str, Any]

TIGHT = {"rtol": 1e-11, "atol": 1e-12, "fall": False}
SKI = {"kind": "ski", "mass": 5.0, "inertia": 0.6, "com_offset": 0.1}
PIVOT = {"kind": "pivot"}
FLYING = {"kind": "free", "mass": 1.5}
ANY_LENGTH = [-math.inf, math.inf]
FIXED = {"length": 0.2, "motion": "fixed"}
BENT = {"psi1": 0.7, "phi1": 0.4, "psi2": 0.2, "phi2": 1.3, "psi3": 1.1, "phi3": -0.6}  # no two links line up
MOVING = {"phi1_dot": 0.8, "psi1_dot": -0.5, "phi2_dot": -1.1, "psi2_dot": 0.6, "xi1_1_dot": 0.2}


def link(name: str = "", /, **changes: Any) -> Table:
    """A link with two spring legs and a tip mass; a change of None removes the key."""
    table: Table = {
        "name": name,
        "rod": {"length": 0.5, "mass": 3.0},
        "lower": {"length": 0.3, "stiffness": 2000.0, "limits": ANY_LENGTH},
        "upper": {"length": 0.2, "stiffness": 1500.0, "limits": ANY_LENGTH},
        "tip_mass": 2.0,
    }
    return {key: value for key, value in (table | changes).items() if value not in (None, "")}


def table(base: Table = PIVOT, links: Any = 1, **keys: Any) -> Table:
    """A scene as a dict; `links` is a list of links or how many to make."""
    if isinstance(links, int):
        links = [link(f"link{i + 1}") for i in range(links)]
    return {"base": base, "links": links, "run": TIGHT, **keys}


def scene(base: Table = PIVOT, links: Any = 1, **keys: Any) -> vlmb.Scene:
    """A checked scene."""
    return vlmb.Scene.from_dict(table(base, links, **keys))


def bent(base: Table, links: int = 2, **keys: Any) -> vlmb.Scene:
    """A moving scene whose links do not line up."""
    names = {f"link{i + 1}": (f"phi{i + 1}", f"psi{i + 1}") for i in range(links)}
    known = {name for pair in names.values() for name in pair}
    plane = keys.get("plane", False)
    start = {name: value for name, value in (BENT | MOVING).items() if name.removesuffix("_dot") in known | {"xi1_1"}}
    if plane:
        start = {name: value for name, value in start.items() if not name.startswith("phi")}
    if base["kind"] == "ski":
        start |= {"phi0": 0.3, "phi0_dot": 0.9, "speed": 1.7}
    return scene(base, links, **{"start": start, **keys})


def random_state(mechanism: vlmb.Mechanism, seed: int = 0, sideways: bool = True) -> vlmb.State:
    """A state away from the pole and from lined-up links, every link without spin."""
    random = np.random.default_rng(seed)
    values, rates = {}, {}
    for name in mechanism.coordinate_names:
        if name.startswith("psi"):
            values[name] = random.uniform(-1.2, 1.2)
        elif name.startswith("xi"):
            values[name] = random.uniform(0.1, 0.4)
        else:
            values[name] = random.uniform(-3.0, 3.0)
        rates[f"{name}_dot"] = random.uniform(-1.5, 1.5)
    state = mechanism.state(values, rates)
    if not sideways and mechanism.layout.base == "ski":
        along = math.cos(values["phi0"]) * rates["x_dot"] + math.sin(values["phi0"]) * rates["y_dot"]
        rates |= {"x_dot": along * math.cos(values["phi0"]), "y_dot": along * math.sin(values["phi0"])}
        state = mechanism.state(values, rates)
    return state


def write_toml(path: Path, data: Table) -> Path:
    """Write a scene dict as a TOML file."""
    path.write_text("\n".join(f"{key} = {_toml(value)}" for key, value in data.items()) + "\n", encoding="utf-8")
    return path


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(entry) for entry in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(float(value)) if isinstance(value, float) else str(value)
