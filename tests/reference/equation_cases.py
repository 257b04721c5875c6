"""Random mechanisms and postures, given both to Pinocchio and to the closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import vlmb
from vlmb.equations.closed_form import ChainParameters, ChainState, chain_parameters, chain_state

Table = dict[str, Any]


def random_scene(
    n: int, base: str = "ski", seed: int = 0, tips: str = "all", odd: bool = True, fixed: float = 0.0
) -> Table:
    """A chain as a scene dict.

    `tips` is all, last or none; `odd` gives a slope, a com_offset, and rods with given com and inertia; `fixed` is
    the share of segments that are fixed.
    """
    rng = np.random.default_rng([n, seed, len(base), len(tips), odd, fixed > 0.0])

    def segment() -> Table:
        length = float(rng.uniform(0.1, 0.6))
        return {"length": length, "motion": "fixed"} if rng.random() < fixed else {"length": length}

    links = []
    for i in range(n):
        rod = {"length": float(rng.uniform(0.3, 1.0)), "mass": float(rng.uniform(1.0, 5.0))}
        if odd and i % 2 == 0:
            rod["com"] = float(rod["length"] * rng.uniform(0.2, 0.8))
            rod["inertia"] = float(rod["mass"] * rod["length"] ** 2 * rng.uniform(0.02, 0.1))
        tip = float(rng.uniform(0.5, 3.0)) if tips == "all" or (tips == "last" and i == n - 1) else 0.0
        links.append({"rod": rod, "lower": segment(), "upper": segment(), "tip_mass": tip})
    table: Table = {"base": {"kind": base}, "links": links, "slope": float(rng.uniform(-0.5, 0.5)) if odd else 0.0}
    if base == "ski":
        table["base"] |= {"mass": float(rng.uniform(2.0, 6.0)), "inertia": float(rng.uniform(0.3, 1.0))}
        table["base"]["com_offset"] = float(rng.uniform(0.1, 0.4)) if odd else 0.0
    return table


def closed_parameters(table: Table) -> ChainParameters:
    """Constants of a chain scene for the closed forms."""
    links, base = table["links"], table["base"]
    rods = [link["rod"] for link in links]
    last = len(links) - 1
    present = [
        [
            link[side].get("motion") != "fixed" and (side == "lower" or i < last or link["tip_mass"] > 0.0)
            for side in ("lower", "upper")
        ]
        for i, link in enumerate(links)
    ]
    return chain_parameters(
        [rod["length"] for rod in rods],
        [rod["mass"] for rod in rods],
        [link["tip_mass"] for link in links],
        rod_com=[rod.get("com", rod["length"] / 2) for rod in rods],
        rod_inertia=[rod.get("inertia", rod["mass"] * rod["length"] ** 2 / 12) for rod in rods],
        present=np.array(present).reshape(-1, 2),
        ski_mass=base.get("mass", 0.0),
        ski_inertia=base.get("inertia", 0.0),
        com_offset=base.get("com_offset", 0.0),
        slope=table["slope"],
    )


def closed_state(table: Table, coordinates: dict[str, float], rates: dict[str, float] | None = None) -> ChainState:
    """The same state for the closed forms."""
    lengths = [[link[side]["length"] for side in ("lower", "upper")] for link in table["links"]]
    return chain_state(len(lengths), coordinates, rates, np.array(lengths).reshape(-1, 2))


def random_posture(mechanism: vlmb.Mechanism, rng: np.random.Generator) -> dict[str, float]:
    """Coordinates with |psi|, |phi0| < 1.2."""
    values = {}
    for name in mechanism.coordinate_names:
        low, high = (0.1, 0.6) if name.startswith("xi") else (-1.2, 1.2)
        if name.startswith("phi") and name != "phi0":
            low, high = -math.pi, math.pi
        values[name] = float(rng.uniform(low, high))
    return values


def random_rates(
    mechanism: vlmb.Mechanism, rng: np.random.Generator, coordinates: dict[str, float] | None = None
) -> dict[str, float]:
    """Rates of every coordinate; given the posture, those of a ski obey the knife edge."""
    rates = {f"{name}_dot": float(rng.uniform(-2.0, 2.0)) for name in mechanism.coordinate_names}
    if coordinates is not None and mechanism.layout.base == "ski":
        rates["y_dot"] = rates["x_dot"] * math.tan(coordinates["phi0"])
    return rates
