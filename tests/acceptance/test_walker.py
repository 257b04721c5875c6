"""Ten steps of the walker of figure 3: every phase as asked, and ten times faster than real time."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

import pytest

import vlmb
from tests.simulation import test_walker as first_steps

pytestmark = pytest.mark.acceptance

WALKER = Path(__file__).resolve().parents[2] / "models" / "figure_walker.toml"
WHOLE = 11.0  # s


@pytest.mark.parametrize("check", [
    first_steps.test_errors_of_every_phase_decay_as_they_should, first_steps.test_forces_are_those_of_equations_by_hand,
    first_steps.test_feet_neither_sink_nor_slip_and_energy_is_accounted_for,
])  # fmt: skip
def test_all_phases_of_ten_steps(check):
    check(partial(first_steps.walks, WHOLE))


def test_ten_steps_are_ten_times_faster_than_real_time():
    scene = vlmb.load_scene(WALKER)
    run, seconds = vlmb.simulate(scene), []
    for _ in range(3):
        began = time.process_time()
        vlmb.simulate(scene)
        seconds.append(time.process_time() - began)
    assert sum(event.kind == "touch" for event in run.events) == 10 and run["x"][-1] > 5.9
    assert run.t[-1] > 10.0 * min(seconds)
