"""A person in an exoskeleton stands up, shifts the weight, takes a step: models/exoskeleton.toml against Lagrange's equations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import vlmb
from tests.reference.planar import Planar

MODEL = Path(__file__).resolve().parents[2] / "models" / "exoskeleton.toml"
SIDES, G = ("left", "right"), 9.81
MOTORS = tuple(f"T_{side}_{part}_bar" for side in SIDES for part in ("upper", "lower"))
MUSCLES = tuple(f"T_{side}_{part}" for side in SIDES for part in ("thigh", "shank"))
TIES = {"belt": ("frame", None), **{
    f"{side}_{joint}": (f"{side}_{bar}_bar", f"{side}_{limb}")
    for side in SIDES for joint, bar, limb in (("knee", "upper", "thigh"), ("ankle", "lower", "shank"))
}}  # fmt: skip


@pytest.fixture(scope="module")
def run():
    return vlmb.simulate(MODEL)


def phases(run):
    """Return the samples of each phase, and the phase."""
    starts = [0] + [int(np.flatnonzero(run.t == event.t)[-1]) for event in run.events]
    return list(zip(run.phases, [slice(a, b) for a, b in zip(starts, [*starts[1:], len(run.t)], strict=True)], strict=True))


def states(run, at):
    """Return q, v of the paper's coordinates at a sample."""
    names = run.mechanism.coordinate_names
    return np.array([run[name][at] for name in names]), np.array([run[f"{name}_dot"][at] for name in names])


def test_it_stands_up_shifts_its_weight_steps_and_stands(run):
    assert run.status == "finished" and [f"{event.kind} {event.name}" for event in run.events] == ["open right", "touch right"]
    assert [set(phase.closed) for phase in run.phases] == [{"left", "right"}, {"left"}, {"left", "right"}]
    assert run["z"][0] < 0.53 and run["z"][-1] == pytest.approx(0.79, abs=1e-3)
    assert run["right_shank.tip.x"][-1] - run["left_shank.tip.x"][-1] == pytest.approx(0.38, abs=0.01)
    share = run.reactions["right"][:, 2] / (run.reactions["left"][:, 2] + run.reactions["right"][:, 2])
    assert share[0] > 0.2 and share[phases(run)[1][1].start - 1] < 1e-6  # the rear foot carries less and less


def test_errors_of_programmes_decay_as_they_say(run):
    """(5.5), critically damped: z = (z0 + (z0' + w z0) t) exp(-w t), from the first sample of each phase on."""
    largest = 0.0
    for (_, at), programme in zip(phases(run), (run.scene.programmes[k] for k in (0, 1, 0)), strict=True):
        w = np.broadcast_to(np.asarray(programme.frequency, float), len(programme.constraints))
        t = run.t[at] - run.t[at][0]
        for rate, equation in zip(w, programme.constraints, strict=True):
            z, speed = (values[at] for values in run.residuals[equation.partition(": ")[0]])
            assert z == pytest.approx((z[0] + (speed[0] + rate * z[0]) * t) * np.exp(-rate * t), abs=1e-6), equation
            largest = max(largest, np.abs(z).max())
    assert largest > 0.05  # the step leaves the hips behind


def test_feet_stay_where_they_stand_and_straps_hold(run):
    for phase, at in phases(run):
        for side in phase.closed:
            foot = run.position(f"{side}_shank")[at]
            assert np.abs(foot - foot[0])[:, [0, 2]].max() < 1e-9 and np.abs(foot[:, 2]).max() < 1e-9
    for name in run.scene.constraints:
        assert np.abs(run.residuals[name.partition(":")[0]].position).max() < 1e-9, name
    assert np.abs(run.position("left_upper_bar")[:, [0, 2]] - run.position("left_thigh")[:, [0, 2]]).max() < 1e-9


def test_energy_is_accounted_for_through_all_phases(run):
    assert np.abs(run["balance"]).max() < 1e-8 * run["kinetic"].max() + 1e-7
    assert run.work_by_force["impacts"][-1] < 0.0


def test_matrices_and_forces_of_each_phase_are_those_of_lagrange(run):
    """M, h to 1e-12; accelerations and reactions from them, ties and feet; feet push what weight and inertia ask for."""
    scene, planar = run.scene, Planar(run.scene)
    assert tuple(planar.names) == run.mechanism.coordinate_names
    weight = G * sum(link.rod.mass + link.tip_mass for link in scene.links)
    forces = {name: planar.control(name) for name in scene.programmes[0].controls}
    for phase, samples in phases(run):
        at = samples.start + (samples.stop - samples.start) // 2
        q, v = states(run, at)
        mass, bias = planar.equations(q, v)
        equations = vlmb.equations_of_motion(
            run.mechanism, dict(zip(planar.names, q, strict=True)), {f"{n}_dot": r for n, r in zip(planar.names, v, strict=True)}
        )
        assert equations.mass_matrix == pytest.approx(mass, abs=1e-12 * np.abs(mass).max())
        assert equations.bias == pytest.approx(bias, abs=1e-12 * weight)
        rows, drift = [], []
        for bar, limb in TIES.values():
            tied = planar.jet(planar.way(bar, "tip"), q, v)
            on = planar.jet(planar.way(limb, "tip") if limb else [], q, v)
            rows.append(tied.rows - on.rows)
            drift.append(tied.drift - on.drift)
        for side in phase.closed:
            foot = planar.jet(planar.way(f"{side}_shank", "tip"), q, v)
            rows.append(foot.rows)
            drift.append(foot.drift)
        j, size = np.vstack(rows), len(q)
        applied = planar.springs(q, v) + sum(run.controls[name][at] * force for name, force in forces.items())
        whole = np.block([[mass, -j.T], [j, np.zeros((len(j), len(j)))]])
        found = np.linalg.solve(whole, np.concatenate([applied - bias, -np.concatenate(drift)]))
        a, multipliers = found[:size], found[size:].reshape(-1, 2)
        told = [[run.reactions[f"{name}_{axis}"][at] for axis in "xz"] for name in TIES]
        told += [run.reactions[side][at, [0, 2]] for side in phase.closed]
        assert multipliers == pytest.approx(np.array(told), abs=1e-7 * weight)
        inertia = sum(m * (jet.rows @ a + jet.drift)[1] for m, _, way, _ in planar.bodies() for jet in [planar.jet(way, q, v)])
        feet = sum(run.reactions[side][at, 2] for side in SIDES)
        assert feet == pytest.approx(weight + inertia, rel=1e-8)


def test_motors_and_muscles_share_by_weight(run):
    """u_s = R_s^-1 times the same: motors take `share`, muscles the rest; with share to 1 muscles do nothing."""
    for motor, muscle in zip(MOTORS, MUSCLES, strict=True):
        assert run.controls[motor] == pytest.approx(4.0 * run.controls[muscle], abs=1e-6)
        assert np.abs(run.controls[motor]).max() > 50.0
    most = 1.0 - 1e-9
    alone = vlmb.simulate(run.scene.changed(parameters={"share": most}), duration=0.05)
    for motor, muscle in zip(MOTORS, MUSCLES, strict=True):
        assert np.abs(alone.controls[muscle]).max() < 1e-6
        assert alone.controls[motor][0] == pytest.approx(run.controls[motor][0] / run.scene.parameters["share"], rel=1e-7)


def test_both_engines_agree(run):
    other = vlmb.simulate(MODEL, engine="pinocchio", duration=0.05)
    core = vlmb.simulate(MODEL, duration=0.05)
    for name in ("z", "psi1", "left_knee_x", "T_left_upper_bar", "F8_1"):
        pair = [each.reactions[name] if name in each.reactions else each.controls[name] if name in each.controls else each[name]
                for each in (core, other)]  # fmt: skip
        assert pair[0] == pytest.approx(pair[1], abs=1e-6)


def test_what_a_motor_does_is_named_and_counted(run):
    """Its power is its moment times the rate of its hinge; its work is in the account."""
    rate = run["left_lower_bar.elevation_dot"] - run["left_upper_bar.elevation_dot"]
    assert run.power("T_left_lower_bar") == pytest.approx(run.controls["T_left_lower_bar"] * rate, abs=1e-9)
    for name in (*MOTORS, "F8_1"):
        assert name in run.work_by_force and name in run.summary()
    assert "left_knee_x" in run.summary()
