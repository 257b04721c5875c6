"""A bar on two feet rattles: infinitely many impacts end at a time, and then it lies. Beside its own equations, by SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import vlmb
from tests.metamorphic import Words
from tests.metamorphic_kinds import contacts
from tests.simulation.test_phases import balanced
from tests.simulation.walkers import TIGHT
from vlmb.simulation.resting import SOON, Strikes, ends_now

G, MU = 9.81, 0.2
MASS, INERTIA, FOOT = 3.0, 2.0 * 0.25 + 0.16 / 12.0, 0.2  # balls of 1 kg at 0.5 m from the middle, feet at 0.2 m
START = (0.5, 0.0215, 0.1, 2.0, 0.0, 0.0)  # x, z of the middle, angle, and their rates


def rattled() -> tuple[float, float]:
    """Return when the impacts of a bar that slides end, and how fast it slides then.

    Feet by -1 and 1. Impacts until they approach with 1e-6 m/s, the rest by Aitken's extrapolation.
    """

    def push(side, y):  # acceleration of a foot away from the ground by a unit of its normal force, and what that turns
        turned = side * FOOT * (np.cos(y[2]) + MU * np.sin(y[2])) / INERTIA
        return 1.0 / MASS + side * FOOT * np.cos(y[2]) * turned, turned

    def rates(t, y, side):
        share, turned = push(side, y)
        normal = (G + side * FOOT * np.sin(y[2]) * y[5] ** 2) / share if side else 0.0
        return [*y[3:], -MU * normal / MASS, normal / MASS - G, turned * normal]

    def height(side, y):
        return y[1] + side * FOOT * np.sin(y[2])

    def rate(side, y):
        return y[4] + side * FOOT * np.cos(y[2]) * y[5]

    t, y, stands, told = 0.0, np.array(START), 0, []
    while True:
        ends = [lambda t, y, stands, side=side: height(side, y) + (side == stands) for side in (-1, 1)]
        for end in ends:
            end.terminal, end.direction = True, -1.0
        longest = 0.1 * abs(rate(-stands, y)) / G if stands else 0.01  # an event is seen where steps are shorter than a flight
        how = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-16, "max_step": longest}
        found = solve_ivp(rates, (t, t + 1.0), y, events=ends, args=(stands,), **how)
        assert found.status == 1
        t, y, struck = found.t[-1], found.y[:, -1], -1 if found.t_events[0].size else 1
        share, turned = push(struck, y)
        p, speed = -rate(struck, y) / share, -rate(struck, y)
        y[3:] += p * np.array([-MU / MASS, 1.0 / MASS, turned])
        assert stands == 0 or rate(stands, y) > 0.0  # the other end is lifted
        y[1] -= height(struck, y)
        stands = struck
        if struck == 1:
            told.append((t, y[3]))
            if speed < 1e-6:
                break
    a, b, c = np.array(told[-3:])
    end, slides = c - (c - b) ** 2 / ((c - b) - (b - a))
    return float(end), float(slides)


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
def test_a_bar_that_rattles_lies_where_its_impacts_end(engine, tmp_path):
    x, z, angle, x_dot, z_dot, rate = START
    bar = {
        "name": "bar", "lower": {"length": 0.3, "motion": "fixed"}, "rod": {"length": 0.4, "mass": 1.0},
        "upper": {"length": 0.3, "motion": "fixed"}, "tip_mass": 1.0,
    }  # fmt: skip
    run = vlmb.simulate({
        "plane": True, "base": {"kind": "free", "mass": 1.0}, "links": [bar],
        "start": {
            "psi1": angle, "x": x - 0.5 * np.cos(angle), "z": z - 0.5 * np.sin(angle), "x_dot": x_dot, "z_dot": z_dot,
            "psi1_dot": rate,
        },
        "contacts": [{"name": name, "point": f"bar.rod_{which}", "friction": MU} for name, which in (
            ("left", "start"), ("right", "end"),
        )],
        "run": {**TIGHT, "duration": 0.7, "fall": False},
    }, engine=engine)  # fmt: skip
    end, slides = rattled()
    last = run.events[-1]
    assert run.status == "finished" and run.phases[-1].closed == run.phases[-1].slipping == ("left", "right")
    assert 15 < len(run.events) < 40 and last.kind == "touch" and not any(event.early for event in run.events[:-1])
    assert 0.0 < end - last.t <= last.early < SOON and "contacts rest where" in run.summary()
    assert run["com.x_dot"][-1] == pytest.approx(slides - MU * G * (0.7 - end), abs=1e-9)
    assert run["psi1"][-1] == pytest.approx(0.0, abs=1e-11) and balanced(run) and min(run.lowest_gaps.values()) > -1e-9
    assert np.diff(run.work_by_force["impacts"]).max() < 1e-9
    assert vlmb.load_trajectory(run.save(tmp_path / "run.npz")).events[-1].early == last.early


def test_cycles_that_do_not_shrink_have_no_end():
    strikes = Strikes()
    for t, left, right in ((0.0, 8e-7, 4e-7), (4e-7, 4e-7, 4e-7), (6e-7, 2e-7, 4e-7)):
        strikes.note(t, {0: left, 1: right})
    assert strikes.left([0]) == pytest.approx(2e-7) and ends_now(strikes.left([0]), 2e-7)
    assert strikes.left([1]) == strikes.left([0, 1]) == strikes.left([2]) == np.inf and not ends_now(np.inf, 4e-7)
    assert not ends_now(1e-5, 2e-6) and not ends_now(1e-6, 2e-6) and ends_now(1e-7, 5e-6)


def test_what_begins_to_slide_with_a_speed_of_rounding_does_so_once():
    """Adams' method leaves a held foot with such a speed; it later turns back."""
    kinds = ["touch", "slip", "slip"]
    runs = [vlmb.simulate(contacts(93, Words(run=(("method", method),)))) for method in ("dop853", "adams")]
    for run in runs:
        assert run.status == "finished" and [event.kind for event in run.events] == kinds and balanced(run)
    assert [event.t for event in runs[0].events] == pytest.approx([event.t for event in runs[1].events], abs=1e-7)
    assert runs[0]["x"][-1] == pytest.approx(runs[1]["x"][-1], abs=1e-8)


def test_a_foot_that_turns_as_it_stops_comes_to_rest():
    """Along each new direction it stops sooner than along the one before; it would turn for ever."""
    run = vlmb.simulate(contacts(197, Words()))
    stops = [event for event in run.events if event.t > 0.4]
    assert run.status == "finished" and balanced(run)
    assert stops[-1].kind == "stick" and stops[-1].t - stops[0].t < 1e-8 and len(stops) <= 6
    assert np.abs(run.position("b", "tip")[run.t > 0.43] - run.position("b", "tip")[-1]).max() < 1e-8
