"""The walker of figure 3: programmes by phase, weight that passes from foot to foot, and a hop without support."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import vlmb
from tests.reference.planar_walker import ORDER, forces_of, walker

MODELS = Path(__file__).resolve().parents[2] / "models"
ENGINES = ("core", "pinocchio")
FIRST = 3.2  # s: standing, a step with each foot, and into the third


@cache
def walks(until: float = FIRST) -> vlmb.Trajectory:
    """The walker's first steps."""
    return vlmb.simulate(MODELS / "figure_walker.toml", duration=until)


@cache
def hops() -> vlmb.Trajectory:
    """A hop."""
    return vlmb.simulate(MODELS / "figure_walker_hops.toml")


def samples_of(run: vlmb.Trajectory, phase: vlmb.Phase) -> slice:
    """Samples of a phase; an event has two of its time, the first of which is of the phase before."""
    begins, ends = np.searchsorted(run.t, phase.start, side="right") - 1, np.searchsorted(run.t, phase.end, side="left") + 1
    return slice(max(int(begins), 0), int(ends))


@pytest.mark.parametrize("run", [walks, hops])
def test_errors_of_every_phase_decay_as_they_should(run):
    run, seen = run(), 0
    for phase in run.phases:
        own = samples_of(run, phase)
        closed = {*phase.closed}
        acting = next(each for each in run.scene.programmes if {*each.closed} <= closed and not {*each.open} & closed)
        w, t = acting.frequency, run.t[own] - run.t[own][0]
        for text in acting.constraints:
            z, rate = run.residuals[text.partition(":")[0]]
            z, rate = z[own], rate[own]
            exact = (z[0] + (rate[0] + w * z[0]) * t) * np.exp(-w * t)
            assert np.abs(z - exact).max() < 1e-6, (text, phase)
            seen += np.abs(z[0]) > 1e-5
    assert seen > 2 and len(run.phases) >= 3


@pytest.mark.parametrize("run", [walks, hops])
def test_forces_are_those_of_equations_by_hand(run):
    """What the feet push follows from the controls by another text of the equations; in sum it is weight and inertia."""
    run, weight = run(), 73.0 * 9.81
    for phase in run.phases:
        own = samples_of(run, phase)
        for k in range(own.start + 1, own.stop - 1, 7):
            c, rates = (np.array([run[f"{name}{dot}"][k] for name in ORDER]) for dot in ("", "_dot"))
            by_hand = walker(run.scene, c, rates)
            given = forces_of(run.scene, c, rates, {name: values[k] for name, values in run.controls.items()})
            rows = np.vstack([by_hand.feet[name].jacobian for name in phase.closed] + [np.zeros((0, len(c)))])
            drift = np.concatenate([by_hand.feet[name].drift for name in phase.closed] + [np.zeros(0)])
            square = np.block([[by_hand.mass, -rows.T], [rows, np.zeros((len(rows), len(rows)))]])
            found = np.linalg.solve(square, np.concatenate([given - by_hand.bias, -drift]))
            pushes = found[len(c) :].reshape(-1, 2)
            for name, (up, ahead) in zip(phase.closed, pushes, strict=True):
                assert run.reactions[name][k] == pytest.approx([ahead, 0.0, up], abs=1e-8 * weight)
            inertia = by_hand.mass[1] @ found[: len(c)] + by_hand.bias[1]
            assert sum(run.reactions[name][k][2] for name in ("left", "right")) == pytest.approx(inertia, abs=1e-8 * weight)


@pytest.mark.parametrize("run", [walks, hops])
def test_feet_neither_sink_nor_slip_and_energy_is_accounted_for(run):
    run = run()
    assert np.abs(run["balance"]).max() < 1e-8 * run["kinetic"].max() + 1e-8
    for phase in run.phases:
        own = samples_of(run, phase)
        for name in phase.closed:
            assert np.ptp(run[f"{name}_leg.tip.x"][own]) < 1e-9 and np.abs(run[f"{name}_leg.tip.z"][own]).max() < 1e-9
            assert run.reactions[name][own][:, 2].min() > -1e-6
    assert not run.phases[1].slipping and run.status == "finished"


def test_the_weight_passes_from_foot_to_foot():
    """Secondary rows: the foot behind pushes along its leg, as far as it is loaded, until both come to nothing."""
    run = walks()
    kinds = [(event.kind, event.name) for event in run.events]
    assert kinds == [("open", "right"), ("touch", "right"), ("open", "left"), ("touch", "left"), ("open", "right")]
    phase = run.phases[2]
    own = samples_of(run, phase)
    force, at = run.reactions["left"][own], run["x"][own] - run["left_leg.tip.x"][own]
    assert phase.closed == ("left", "right") and force[0, 2] > 500.0 and abs(force[-1]).max() < 1e-3
    assert force[:, 0] == pytest.approx(force[:, 2] * at / run.scene.parameters["height"], abs=1e-6)


def test_both_engines_walk_alike():
    """Through the first step: both feet, one foot, both feet."""
    core, other = (vlmb.simulate(MODELS / "figure_walker.toml", t_eval=[0.0, 1.5, 1.9], engine=name) for name in ENGINES)
    assert [event.t for event in other.events] == pytest.approx([event.t for event in core.events], abs=1e-8)
    assert len(core.events) == 2 and len(core) == len(other)
    for name in ("x", "x_dot", "psi3", "xi3_2"):
        assert other[name] == pytest.approx(core[name], abs=1e-7)
    for name in ("left", "right"):
        assert other.reactions[name] == pytest.approx(core.reactions[name], abs=1e-4)


def test_a_row_of_forces_says_what_is_wrong_with_it():
    scene = vlmb.load_scene(MODELS / "figure_walker.toml").to_dict()
    both = scene["programmes"][2]

    def refused(row: str, alone: bool = False, **changes: object) -> str:
        others = [] if alone else scene["programmes"][:2]
        data = {**scene, "programmes": [*others, {**both, "secondary": [row], **changes}]}
        with pytest.raises(vlmb.VlmbError) as error:
            vlmb.simulate(vlmb.Scene.from_dict(data), duration=0.1)
        return str(error.value)

    assert "not linear in forces" in refused("left.force.x*right.force.z = 1")
    assert "not linear in forces" in refused("abs(left.force.x) = 1")
    assert "did you mean 'left.force.z'" in refused("left.force.y = 0")
    assert "may act while 'right' is open; add it to `closed`" in refused("right.force.z = 0", alone=True, closed=["left"])
    rows = [*both["constraints"][:3], "left.force.z = 300"]
    primary = vlmb.Scene.from_dict({**scene, "programmes": [{**both, "constraints": rows}]})
    with pytest.raises(vlmb.VlmbError, match=r"left\.force\.z"):
        vlmb.simulate(primary, duration=0.1)
