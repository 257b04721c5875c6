"""Sensitivities through events: against closed forms, right up to the event; what has no derivative is refused by name.

Walkers, runners, skis that land and lengths that bounce are in tests/acceptance.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import vlmb
from vlmb.core.jit import COMPILED
from vlmb.errors import StudyError

pytestmark = pytest.mark.skipif(not COMPILED, reason="too slow in plain Python")

G = 9.81


def ball(**start: float) -> vlmb.Scene:
    floor = {"name": "floor", "point": "base", "friction": 0.0, "restitution": 0.8}
    base = {"kind": "free", "mass": 2.0}
    return vlmb.Scene.from_dict({"plane": True, "base": base, "contacts": [floor], "start": {"z": 1.0, "x_dot": 0.5, **start}})


def bounced(t: float, count: int, height: complex, share: complex) -> complex:
    """Height of a ball that fell from a height and has bounced count times."""
    if not count:
        return height - 0.5 * G * t * t
    landed, speed = (2.0 * height / G) ** 0.5, share * (2.0 * G * height) ** 0.5
    for _ in range(count - 1):
        landed, speed = landed + 2.0 * speed / G, share * speed
    return speed * (t - landed) - 0.5 * G * (t - landed) ** 2


def test_a_ball_bounces_as_in_closed_form_right_up_to_its_impacts() -> None:
    first = math.sqrt(2.0 / G)
    second = first * (1.0 + 2.0 * 0.8)
    t = np.array([0.2, first - 1e-9, first + 1e-8, 0.5, second - 1e-7, second + 1e-5, 1.5, 2.0])
    counts = [0, 0, 1, 1, 1, 2, 2, 3]
    found = vlmb.sensitivities(ball(), ["start.z", "contacts.0.restitution"], ["z", "z_dot"], t_eval=t)
    tiny = 1e-200j
    by_height = [bounced(at, count, 1.0 + tiny, 0.8).imag / 1e-200 for at, count in zip(t, counts, strict=True)]
    by_share = [bounced(at, count, 1.0, 0.8 + tiny).imag / 1e-200 for at, count in zip(t, counts, strict=True)]
    for exact, row in zip((by_height, by_share), found["z"].values, strict=True):
        np.testing.assert_allclose(row, exact, atol=1e-10 * np.abs(exact).max())
    rates = found["z_dot"].sel(parameter="start.z").values
    assert np.abs(rates[:2]).max() < 1e-9 and rates[2] == pytest.approx(0.9 * math.sqrt(2.0 * G), rel=1e-9)  # e v'/2 + g T'
    assert found.attrs["error"] < 1e-9


def test_a_ski_stops_where_its_speed_takes_it() -> None:
    base = {"kind": "ski", "mass": 20.0, "inertia": 1.0, "friction": 0.2}
    scene = vlmb.Scene.from_dict({"base": base, "start": {"speed": 1.5}, "run": {"duration": 1.2}})
    t, slows = np.array([0.3, 1.5 / (0.2 * G) + 1e-6, 1.2]), 0.2 * G
    found = vlmb.sensitivities(scene, ["start.speed", "base.friction"], ["x", "x_dot"], t_eval=t)
    np.testing.assert_allclose(found["x"].values[0], [0.3, 1.5 / slows, 1.5 / slows], rtol=1e-9)
    np.testing.assert_allclose(found["x"].values[1], [-G * 0.045, *[-1.125 * G / slows**2] * 2], rtol=1e-9)
    np.testing.assert_allclose(found["x_dot"].values, [[1.0, 0.0, 0.0], [-G * 0.3, 0.0, 0.0]], atol=1e-9)


def swinging(t: float, phase: int, start: complex, late: complex) -> complex:
    """Length of a spring that is pushed with 3 N from `late` on, and with 5 N more while it grows: phases 0, 1, 2."""
    omega, middle = math.sqrt(150.0), 0.3 + 2.0 * G / 300.0
    begin, length, rate, push = 0.0 + 0.0j, start, 0.0 + 0.0j, 0.0
    for now in range(phase + 1):
        a, b = length - middle - push / 300.0, rate / omega
        if now == phase:
            return middle + push / 300.0 + a * np.cos(omega * (t - begin)) + b * np.sin(omega * (t - begin))
        span = late if now == 0 else (np.arctan(b / a) + (math.pi if (b / a).real < 0.0 else 0.0)) / omega
        length = middle + push / 300.0 + a * np.cos(omega * span) + b * np.sin(omega * span)
        rate = omega * (b * np.cos(omega * span) - a * np.sin(omega * span))
        begin, push = begin + span, push + (3.0 if now == 0 else 5.0)
    raise AssertionError


def test_a_switch_by_the_state_and_a_break_whose_time_is_a_number() -> None:
    force = {"on": "F1_1", "law": "5*step(xi1_1_dot) + 3*step(t - late)"}
    link = {"name": "legs", "rod": {"length": 0.0, "mass": 0.0}, "lower": {"length": 0.3, "stiffness": 300.0}, "tip_mass": 2.0}
    scene = vlmb.Scene.from_dict({
        "base": {"kind": "pivot"}, "plane": True, "links": [link], "forces": [force], "parameters": {"late": 0.2},
        "start": {"psi1": -math.pi / 2, "xi1_1": 0.4}, "run": {"duration": 0.4},
    })  # fmt: skip
    switched = vlmb.simulate(scene, rtol=1e-12, atol=1e-14).events[0].t
    t = np.array([0.1, 0.2 - 1e-6, 0.2 + 1e-6, switched - 1e-7, switched + 1e-7, 0.4])
    phases, tiny = [0, 0, 1, 1, 2, 2], 1e-200j
    found = vlmb.sensitivities(scene, ["start.xi1_1", "parameters.late"], ["xi1_1"], t_eval=t)
    for row, (start, late) in zip(found["xi1_1"].values, ((0.4 + tiny, 0.2), (0.4, 0.2 + tiny)), strict=True):
        exact = [swinging(at, phase, start, late).imag / 1e-200 for at, phase in zip(t, phases, strict=True)]
        np.testing.assert_allclose(row, exact, atol=1e-9 * np.abs(exact).max())


def test_what_grazes_is_refused_by_name() -> None:
    middle = 0.3 + 2.0 * G / 300.0
    lowest = 2.0 * middle - 0.34
    leg = {"length": 0.3, "stiffness": 300.0, "limits": [0.1, lowest - 1e-13], "at_limit": "bounce"}
    link = {"name": "legs", "rod": {"length": 0.0, "mass": 0.0}, "lower": leg, "tip_mass": 2.0}
    start = {"psi1": -math.pi / 2, "xi1_1": 0.34}
    scene = vlmb.Scene.from_dict({"base": {"kind": "pivot"}, "links": [link], "start": start, "run": {"duration": 0.5}})
    with pytest.raises(StudyError, match=r"bounce legs\.lower\.max at t = 0\.2565\d* s .* it grazes"):
        vlmb.sensitivities(scene, ["start.xi1_1"], ["xi1_1"])
    assert vlmb.sensitivities(scene, ["start.xi1_1"], ["xi1_1"], t_eval=[0.1, 0.2]).attrs["error"] < 1e-9  # before it


def test_what_comes_together_is_refused_by_name_where_it_parts() -> None:
    feet = [{"name": name, "point": name, "friction": 0.0, "restitution": 0.5} for name in ("base", "rod.tip")]
    scene = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 1.0}, "links": [{"name": "rod", "rod": {"length": 1.0, "mass": 0.5}}],
        "contacts": feet, "start": {"z": 0.2, "psi1": 0.0}, "run": {"duration": 0.3},
    })  # fmt: skip
    with pytest.raises(StudyError, match=r"contact base, contact rod\.tip come together at t = 0\.2019\d* s"):
        vlmb.sensitivities(scene, ["start.psi1"], ["z"])
    found = vlmb.sensitivities(scene, ["start.z"], ["z"], t_eval=[0.1, 0.3])
    landed = math.sqrt(0.4 / G)
    exact = bounced(0.3, 1, 0.2 + 1e-200j, 0.5).imag / 1e-200
    assert landed < 0.3 and found["z"].values[0] == pytest.approx([1.0, exact], rel=1e-9)
