"""Ideal rows that say what an azimuth is: links pass the vertical, begin there, and pass on what they are told."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vlmb
from vlmb.core.jit import COMPILED

BAR = {"rod": {"length": 0.5, "mass": 2.0}}
TIGHT = {"rtol": 1e-9, "atol": 1e-10}
ENGINES = ["core", "pinocchio"] if COMPILED else ["core"]
SKI = {"kind": "ski", "mass": 5.0, "inertia": 0.6}


def scene(rows: list[str], start: dict[str, float], links: str = "a", **keys: Any) -> dict[str, Any]:
    parts = [{"name": name, **BAR} for name in links]
    return {"base": {"kind": "pivot"}, "links": parts, "constraints": rows, "start": start, **keys}


def turned(rate: Callable[[float], float], start: list[float], t: float) -> float:
    """Elevation of a rod in an upright plane that turns: psi'' = -w^2 sin psi cos psi - 3 g cos psi / (2 L)."""

    def rates(t: float, y: Any) -> list[float]:
        return [y[1], -(rate(t) ** 2) * math.sin(y[0]) * math.cos(y[0]) - 1.5 * 9.81 / 0.5 * math.cos(y[0])]

    return float(solve_ivp(rates, (0.0, t), start, "DOP853", rtol=1e-11, atol=1e-12).y[0, -1])


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("row", "rate", "start"), [
    ("phi1 = 0.3*t", lambda t: 0.3, [1.2, 6.0]),
    ("0.9 - a.azimuth + 3*t**2 = 0.9", lambda t: 6.0 * t, [1.2, 6.0]),
    ("2*phi1 = 0.4*sin(5*t)", lambda t: math.cos(5.0 * t), [0.5 * math.pi, 1.0]),
    ("phi1 = 0", lambda t: 0.0, [1.2, 6.0]),
])  # fmt: skip
def test_a_given_azimuth_goes_through_the_vertical(
    row: str, rate: Callable[[float], float], start: list[float], engine: str
) -> None:
    """More than once: the rod goes round. The moment on the azimuth is J d/dt (w cos^2 psi), its power the row's work."""
    found = vlmb.simulate(scene([row], {"psi1": start[0], "psi1_dot": start[1]}), 1.0, engine=engine, **TIGHT)
    assert found.status == "finished" and not found.doubts, found.message
    assert found["psi1"][-1] == pytest.approx(turned(rate, start, 1.0), abs=1e-6)
    assert found["psi1"][-1] > 1.5 * math.pi
    psi, turn, step = found["psi1"], np.array([rate(t) for t in found.t]), 1e-6
    growth = (np.array([rate(t + step) for t in found.t]) - turn) / step
    moment = 2.0 * 0.25 / 3.0 * (growth * np.cos(psi) ** 2 - 2.0 * turn * np.cos(psi) * np.sin(psi) * found["psi1_dot"])
    factor = {"2": 0.5, "0": -1.0}.get(row[0], 1.0)  # of the row's own c
    np.testing.assert_allclose(found.reactions[row], factor * moment, atol=2e-5)
    if row != "phi1 = 0":
        assert np.abs(found["balance"]).max() < 1e-6


@pytest.mark.parametrize("method", ["dop853", "adams"])
def test_a_programme_that_holds_an_azimuth_ends_at_the_vertical_or_says_that_it_passed(method: str) -> None:
    """Its control has no bound there: steps that miss the vertical leave an error that no tolerance takes away."""
    held = {"constraints": ["phi1 = 0.3*t"], "controls": ["M_phi1"], "frequency": 5.0}
    found = vlmb.simulate(scene([], {"psi1": 0.2, "psi1_dot": 8.0}, programme=held), 1.0, method=method, **TIGHT)
    assert "vertical" in " ".join(found.doubts) if found.status == "finished" else "at the pole" in found.message
    other = {**held, "constraints": ["a.azimuth = 0.3*t"]}
    again = vlmb.simulate(scene([], {"psi1": 0.2, "psi1_dot": 8.0}, programme=other), 1.0, method=method, **TIGHT)
    assert (again.status, len(again.doubts)) == (found.status, len(found.doubts))
    low = vlmb.simulate(scene([], {"psi1": -0.5, "psi1_dot": 1.0}, programme=held), 0.2, method=method, **TIGHT)
    assert low.status == "finished" and not low.doubts


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("base", "rows", "plain", "start"), [
    ({"kind": "pivot"}, ["phi1 = 0.5*t", "phi2 = phi1"], ["phi1 = 0.5*t", "phi2 = 0.5*t"], {"psi2": 1.2, "psi2_dot": 5.0}),
    ({"kind": "pivot"}, ["phi1 - phi2 = 0.3", "phi2 = 0.4*t"], ["phi1 = 0.3 + 0.4*t", "phi2 = 0.4*t"], {"psi1": 1.2}),
    (SKI, ["phi2 = phi1", "phi1 = phi0"], ["phi2 = phi0", "phi1 = phi0"], {"psi2": 0.9, "speed": 3.0, "phi0_dot": 0.9}),
])  # fmt: skip
def test_a_link_that_stands_upright_passes_on_what_its_azimuth_is(
    base: dict[str, Any], rows: list[str], plain: list[str], start: dict[str, float], engine: str
) -> None:
    """Written in two ways it is one motion; the moments and the work are those of the rows as they are written."""
    found, same = (vlmb.simulate(scene(r, start, "ab", base=base), 0.3, engine=engine, **TIGHT) for r in (rows, plain))
    assert found.status == same.status == "finished", found.message
    np.testing.assert_allclose(found.position("b", "tip"), same.position("b", "tip"), atol=1e-7)
    through = found.reactions[rows[0] if "phi2" in rows[0] else rows[1]]
    moments = sum(same.reactions[row] for row in plain)
    if base == SKI:
        np.testing.assert_allclose(found.reactions["phi1 = phi0"], moments, atol=1e-6)
    else:
        driven = next(row for row in rows if "t" in row)
        own = {row: same.reactions[row] for row in plain}
        np.testing.assert_allclose(found.reactions[driven], sum(own.values()), atol=1e-5)
        assert np.abs(found["balance"]).max() < 1e-6
        assert set(found.work_by_force) & set(rows) == {driven}
    assert np.abs(through).max() > 1e-3


@pytest.mark.parametrize(("given", "psi"), [(0.3 + math.pi, 1.2), (0.5, 0.5 * math.pi), (-2.0, 0.5 * math.pi)])
def test_an_azimuth_that_is_given_otherwise_is_turned_and_told(given: float, psi: float) -> None:
    """Half a turn off the sine of the row vanishes as well, and at the vertical everywhere."""
    found = vlmb.check(scene(["phi1 = 0.3"], {"phi1": given, "psi1": psi, "psi1_dot": -1.0}))
    assert math.remainder(found.start.coordinates["phi1"] - 0.3, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert found.start.rates["psi1_dot"] == -1.0
    assert any("phi1 = " in text and "given" in text for text in found.start.adjustments)


@pytest.mark.parametrize("rows", [
    ["phi1 = 0.1", "phi1 = 0.2"], ["phi1 = 0.1*t", "phi1 = 0.2*t"], ["phi1 = phi2", "phi1 = phi2 + 0.2"],
    ["phi1 = 0.1", "phi2 = phi1", "phi2 = 0.3"],
])  # fmt: skip
@pytest.mark.parametrize("start", [{}, {"psi1": 0.5, "psi2": 0.3}])
def test_azimuths_that_contradict_each_other_do_not_stand_a_link_upright(rows: list[str], start: dict[str, float]) -> None:
    """There all of them would hold."""
    with pytest.raises(vlmb.SceneError, match=r"no posture|no rates"):
        vlmb.simulate(scene(rows, start, "ab"), 0.1)
