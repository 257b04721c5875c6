"""Every scene in models/ keeps what its [expect] table promises; models/README.md explains the keys."""

from __future__ import annotations

import functools
import math
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import sympy

import vlmb
from tests.reference import exact
from vlmb.scene.rows import rows_of

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"
NAMES = sorted(path.stem for path in MODELS.glob("*.toml"))

Array = np.ndarray[Any, np.dtype[np.float64]]
Check = Callable[[vlmb.Trajectory, Any], None]
CHECKS: dict[str, Check] = {}


@functools.cache
def run(name: str) -> vlmb.Trajectory:
    return vlmb.simulate(MODELS / f"{name}.toml")


def key(check: Check) -> Check:
    """Make a function the check of the key of [expect] with its name."""
    CHECKS[check.__name__] = check
    return check


# ---- the mechanism


@key
def coordinates(trajectory: vlmb.Trajectory, count: int) -> None:
    assert len(trajectory.mechanism.coordinate_names) == count


@key
def degrees_of_freedom(trajectory: vlmb.Trajectory, count: int) -> None:
    """Independent velocities: coordinates less the knife edge and the prescribed lengths; the model's, less the links' spins."""
    scene, mechanism = trajectory.scene, trajectory.mechanism
    prescribed = sum(link.segment(k).motion == "prescribed" for link in scene.links for k in (1, 2))
    edge = scene.base.kind == "ski" and not scene.base.lift  # one that may lift has it in some phases only
    spins = 0 if scene.plane else len(scene.links)
    assert len(mechanism.coordinate_names) - prescribed - edge == count
    assert mechanism.model.nv - spins - prescribed - edge == count


@key
def left_out(trajectory: vlmb.Trajectory, names: list[str]) -> None:
    assert [entry.split(",")[0] for entry in trajectory.mechanism.left_out] == names


@key
def warnings(trajectory: vlmb.Trajectory, words: list[str]) -> None:
    found = trajectory.mechanism.warnings
    assert len(found) == len(words), found
    for word, warning in zip(words, found, strict=True):
        assert word in warning


@key
def total_mass(trajectory: vlmb.Trajectory, mass: float) -> None:
    """Mass in kg, to 1e-3."""
    assert pin.computeTotalMass(trajectory.mechanism.model) == pytest.approx(mass, abs=1e-3)


@key
def body(trajectory: vlmb.Trajectory, segments: dict[str, list[str]]) -> None:
    """Mass, centre of mass and inertia of links agree with the body segments they stand for, to 0.2 %.

    `legs` is a link with its tip mass, `legs.rod` without, `legs.tip` the tip mass alone, `neck+head.rod` two links in line.
    """
    for name, parts in segments.items():
        found, meant = whole(pieces(trajectory.scene, name)), whole(stacked(parts))
        wanted = slice(0, 1 if name.endswith(".tip") else 3)
        assert found[wanted] == pytest.approx(meant[wanted], rel=2e-3), (name, found, meant)


# ---- how the run ends


@key
def status(trajectory: vlmb.Trajectory, word: str) -> None:
    assert trajectory.status == word, trajectory.message


@key
def stops_by(trajectory: vlmb.Trajectory, words: str) -> None:
    assert trajectory.status != "finished" and words in trajectory.message


@key
def stop_time(trajectory: vlmb.Trajectory, bounds: list[float]) -> None:
    """Bounds in s."""
    assert trajectory.t[-1] < trajectory.run.duration and bounds[0] <= trajectory.t[-1] <= bounds[1]


@key
def happens(trajectory: vlmb.Trajectory, events: list[list[Any]]) -> None:
    """Kind, name and bounds [s] of events, in this order; others may stand between them."""
    rest = list(trajectory.events)
    for kind, name, low, high in events:
        while rest and not ((rest[0].kind, rest[0].name) == (kind, name) and low <= rest[0].t <= high):
            rest.pop(0)
        assert rest, (kind, name, low, high, [event[:3] for event in trajectory.events])


@key
def evaluations(trajectory: vlmb.Trajectory, most: int) -> None:
    """At most this many right-hand sides: the method takes the steps it should."""
    assert trajectory.stats["rhs_evaluations"] <= most, trajectory.stats


@key
def repairs(trajectory: vlmb.Trajectory, words: list[str]) -> None:
    """Words of each value that the start fills in for the equations, and of each error it leaves."""
    assert len(trajectory.adjustments) == len(words), trajectory.adjustments
    for word, repair in zip(words, trajectory.adjustments, strict=True):
        assert word in repair


# ---- the programme


@key
def residuals(trajectory: vlmb.Trajectory, tolerances: dict[str, float]) -> None:
    """Largest error of equations, of their rate where they have rates alone."""
    for text, tolerance in tolerances.items():
        assert np.abs(error_of(trajectory, text)).max() <= tolerance, (text, np.abs(error_of(trajectory, text)).max())


@key
def residuals_at_end(trajectory: vlmb.Trajectory, tolerances: dict[str, float]) -> None:
    for text, tolerance in tolerances.items():
        assert abs(error_of(trajectory, text)[-1]) <= tolerance, (text, error_of(trajectory, text)[-1])


@key
def programme_decay(trajectory: vlmb.Trajectory, tolerance: float) -> None:
    """Largest deviation of (z, z'/w) from critically damped decay, over the length of that vector at the start."""
    programme = trajectory.scene.programme
    assert programme is not None and isinstance(programme.frequency, float) and programme.damping_ratio == 1.0
    t, w = trajectory.t, programme.frequency
    start, errors = [], []
    for row in rows_of(trajectory.scene).servo:
        z, rate = trajectory.residuals[row.name]
        assert z is not None
        push = rate[0] + w * z[0]
        decayed = (z[0] + push * t) * np.exp(-w * t), (rate[0] - w * push * t) * np.exp(-w * t)
        start += [z[0], rate[0] / w]
        errors += [z - decayed[0], (rate - decayed[1]) / w]
    assert np.linalg.norm(start) > 1e-3
    error = np.abs(errors).max() / np.linalg.norm(start)
    assert error <= tolerance, error


@key
def conditioning(trajectory: vlmb.Trajectory, most: float) -> None:
    """Condition number of G at any time."""
    assert trajectory.conditions.min() >= 1.0 and trajectory.conditions.max() <= most, trajectory.conditions.max()


@key
def half_turns(trajectory: vlmb.Trajectory, least: int) -> None:
    """Changes of side of the curve a ski goes through."""
    side = np.sign(trajectory["phi0_dot"])
    assert np.count_nonzero(side[1:] * side[:-1] < 0.0) >= least


@key
def passes(trajectory: vlmb.Trajectory, marks: dict[str, list[float]]) -> None:
    """A quantity has [value, earliest s, latest s] when it first passes the value, counted from its start."""
    for name, (value, early, late) in marks.items():
        from_mark = quantity_of(trajectory, name) - value
        passed = np.flatnonzero(from_mark * from_mark[0] <= 0.0)
        assert len(passed) and early <= trajectory.t[passed[0]] <= late, (name, trajectory.t[passed[:1]])


@key
def power(trajectory: vlmb.Trajectory, bounds: dict[str, list[float]]) -> None:
    """[low, high] of the power of controls in W; its integral is the work."""
    for name, (low, high) in bounds.items():
        values = trajectory.power(name)
        assert low <= values.min() and values.max() <= high, (name, values.min(), values.max())
        work = np.trapezoid(values, trajectory.t)
        assert work == pytest.approx(trajectory.work_by_force[name][-1], abs=2e-3 * np.trapezoid(np.abs(values), trajectory.t))


# ---- invariants


@key
def energy_drift(trajectory: vlmb.Trajectory, tolerance: float) -> None:
    """Largest error of the energy balance over the largest kinetic energy."""
    assert np.abs(trajectory["balance"]).max() <= tolerance * trajectory["kinetic"].max()


@key
def knife_edge_velocity(trajectory: vlmb.Trajectory, tolerance: float) -> None:
    """Tolerance in m/s."""
    assert np.abs(trajectory.residuals["knife_edge"].velocity).max() <= tolerance


@key
def angular_momentum_z(trajectory: vlmb.Trajectory, tolerance: float) -> None:
    """Change of the angular momentum about the vertical through the origin, over its value."""
    _, momentum = momenta(trajectory)
    assert np.abs(momentum[:, 2] - momentum[0, 2]).max() <= tolerance * abs(momentum[0, 2])


@key
def angular_momentum(trajectory: vlmb.Trajectory, tolerance: float) -> None:
    """Change of the angular momentum vector about the centre of mass, over its length."""
    momentum, _ = momenta(trajectory)
    assert np.abs(momentum - momentum[0]).max() <= tolerance * np.linalg.norm(momentum[0])


@key
def center_of_mass(trajectory: vlmb.Trajectory, tolerance: float) -> None:
    """[m] from the parabola of free flight."""
    position, velocity = mass_centre(trajectory)
    scene = trajectory.scene
    path = exact.parabola(trajectory.t, position[0], velocity[0], scene.gravity, scene.slope)
    assert np.abs(position - path).max() <= tolerance


@key
def closed_form(trajectory: vlmb.Trajectory, solutions: dict[str, float]) -> None:
    """Largest deviation from an exact solution, each quantity over the larger of 1 and its largest value."""
    for name, tolerance in solutions.items():
        for quantity, expected in SOLUTIONS[name](trajectory).items():
            error = np.abs(quantity_of(trajectory, quantity) - expected).max()
            assert error <= tolerance * max(1.0, np.abs(expected).max()), quantity


# ---- phases


@key
def events(trajectory: vlmb.Trajectory, wanted: dict[str, Any]) -> None:
    """The first events, and the last one where it is named, with their times [s]."""
    pairs = [(f"{event.kind} {event.name}", event.t) for event in trajectory.events]
    for (words, time), (text, t) in zip(wanted["first"], pairs, strict=False):
        assert words == text and t == pytest.approx(time, abs=wanted["within"]), (text, t)
    assert len(pairs) >= len(wanted["first"])
    if "last" in wanted:
        assert wanted["last"] == [pairs[-1][0], pytest.approx(pairs[-1][1], abs=wanted["within"])]


@key
def lowest_gap(trajectory: vlmb.Trajectory, least: float) -> None:
    """No point of a contact is lower [m] at any sample, but where its `when` has refused it."""
    assert trajectory.lowest_gaps and min(trajectory.lowest_gaps.values()) >= least, trajectory.lowest_gaps


@key
def lost(trajectory: vlmb.Trajectory, bounds: dict[str, list[float]]) -> None:
    """What impacts and friction have taken by the end [J]."""
    for name, (low, high) in bounds.items():
        assert low <= -trajectory.work_by_force[name][-1] <= high, (name, trajectory.work_by_force[name][-1])


# ---- plausible ranges


@key
def within(trajectory: vlmb.Trajectory, bounds: dict[str, list[float]]) -> None:
    for name, (low, high) in bounds.items():
        values = quantity_of(trajectory, name)
        assert low <= values.min() and values.max() <= high, (name, values.min(), values.max())


@key
def at_end(trajectory: vlmb.Trajectory, bounds: dict[str, list[float]]) -> None:
    for name, (low, high) in bounds.items():
        assert low <= quantity_of(trajectory, name)[-1] <= high, (name, quantity_of(trajectory, name)[-1])


@key
def spans(trajectory: vlmb.Trajectory, ranges: dict[str, float]) -> None:
    """Largest less smallest value is at least this: the scene does show the motion."""
    for name, least in ranges.items():
        assert np.ptp(quantity_of(trajectory, name)) >= least, (name, np.ptp(quantity_of(trajectory, name)))


@key
def crosses_vertical(trajectory: vlmb.Trajectory, links: list[str]) -> None:
    """The link's elevation passes pi/2, the pole of its angles."""
    for name in links:
        i = [link.name for link in trajectory.scene.links].index(name)
        from_pole = trajectory[f"psi{i + 1}"] - math.pi / 2
        assert from_pole.min() < -0.01 and from_pole.max() > 0.01


# ---- helpers of the checks


def quantity_of(trajectory: vlmb.Trajectory, name: str) -> Array:
    for known in (trajectory.controls, trajectory.reactions):
        if name in known:
            return known[name]
    return error_of(trajectory, name) if name in trajectory.residuals else trajectory[name]


def error_of(trajectory: vlmb.Trajectory, text: str) -> Array:
    position, velocity = trajectory.residuals[text]
    return velocity if position is None else position


def mass_centre(trajectory: vlmb.Trajectory) -> tuple[Array, Array]:
    """Position and velocity (N, 3) of the centre of mass."""
    model = trajectory.mechanism.model
    data = pin.Data(model)
    both = []
    for q, v in zip(trajectory.q, trajectory.v, strict=True):
        pin.centerOfMass(model, data, q, v)
        both.append((data.com[0].copy(), data.vcom[0].copy()))
    positions, velocities = zip(*both, strict=True)
    return np.array(positions), np.array(velocities)


def momenta(trajectory: vlmb.Trajectory) -> tuple[Array, Array]:
    """Angular momenta (N, 3) about the centre of mass and about the origin."""
    model = trajectory.mechanism.model
    data = pin.Data(model)
    own = np.array(
        [pin.computeCentroidalMomentum(model, data, q, v).angular for q, v in zip(trajectory.q, trajectory.v, strict=True)]
    )
    position, velocity = mass_centre(trajectory)
    return own, own + pin.computeTotalMass(model) * np.cross(position, velocity)


def _skate(trajectory: vlmb.Trajectory) -> exact.Solution:
    scene, start = trajectory.scene, trajectory.scene.start
    return exact.skate(
        trajectory.t,
        scene.base.mass,
        scene.slope,
        start["phi0_dot"],
        start.get("phi0", 0.0),
        start.get("speed", 0.0),
        scene.gravity,
    )


def _sleigh(trajectory: vlmb.Trajectory) -> exact.Solution:
    base, start = trajectory.scene.base, trajectory.scene.start
    assert trajectory.scene.slope == 0.0 and "phi0" not in start
    return exact.sleigh(trajectory.t, base.mass, base.inertia, base.com_offset, start["speed"], start["phi0_dot"])


def _conical_spring_pendulum(trajectory: vlmb.Trajectory) -> dict[str, Array]:
    scene, (link,) = trajectory.scene, trajectory.scene.links
    angle = scene.start["psi1"] + math.pi / 2
    steady = exact.conical_spring_pendulum(link.tip_mass, link.lower.stiffness, link.lower.length or 0.0, angle, scene.gravity)
    del steady["length"]
    return {name: np.full(len(trajectory), value) for name, value in steady.items()}


def _programmed_length(trajectory: vlmb.Trajectory) -> exact.Solution:
    scene, (link,) = trajectory.scene, trajectory.scene.links
    assert scene.gravity == 0.0 and scene.start["psi1"] == 0.0
    text, t = sympy.sympify(link.lower.law, locals=dict(scene.parameters)), sympy.Symbol("t")
    jets = [sympy.lambdify(t, sympy.diff(text, t, order)) for order in range(3)]

    def law(time: float) -> tuple[float, float, float]:
        return jets[0](time), jets[1](time), jets[2](time)

    solution = exact.programmed_length(
        trajectory.t, law, scene.start["phi1_dot"], 0.0, link.tip_mass, link.rod.mass, link.rod.length
    )
    solution["F1_1"] = solution.pop("force")
    return solution


SOLUTIONS: dict[str, Callable[[vlmb.Trajectory], dict[str, Array]]] = {
    "skate": _skate,
    "sleigh": _sleigh,
    "conical_spring_pendulum": _conical_spring_pendulum,
    "programmed_length": _programmed_length,
}

# de Leva (1996), table 4, men of 73.0 kg and 1.741 m: mass [% of the body], length [m], centre of mass [% of the length
# from the end nearer the head; arms: the shoulder], radii of gyration about the two transverse axes [% of the length]
BODY_MASS = 73.0
DE_LEVA = {
    "head": (6.94, 0.2429, 50.02, 30.3, 31.5),
    "upper_trunk": (15.96, 0.2421, 50.66, 50.5, 32.0),
    "middle_trunk": (16.33, 0.2155, 45.02, 48.2, 38.3),
    "lower_trunk": (11.17, 0.1457, 61.15, 61.5, 55.1),
    "upper_arm": (2.71, 0.2817, 57.72, 28.5, 26.9),
    "forearm": (1.62, 0.2689, 45.74, 27.6, 26.5),
    "hand": (0.61, 0.0862, 79.00, 62.8, 51.3),
    "thigh": (14.16, 0.4222, 40.95, 32.9, 32.9),
    "shank": (4.33, 0.4403, 43.95, 25.1, 24.6),
    "foot": (1.37, 0.2581, 44.15, 25.7, 24.5),
}
ARM = ("upper_arm", "forearm", "hand")


def whole(points: list[tuple[float, float, float]]) -> tuple[float, float, float]:
    """Mass, centre and inertia about it of masses, places and inertias on one line."""
    mass = sum(m for m, _, _ in points)
    centre = sum(m * at for m, at, _ in points) / mass
    return mass, centre, sum(own + m * (at - centre) ** 2 for m, at, own in points)


def pieces(scene: vlmb.Scene, name: str) -> list[tuple[float, float, float]]:
    """Rods and tip masses of links in line at the lengths of the scene, as (mass, distance from the first hinge, inertia)."""
    which, _, part = name.partition(".")
    points: list[tuple[float, float, float]] = []
    at = 0.0
    for link in (link for one in which.split("+") for link in scene.links if link.name == one):
        start = at + (link.lower.length or 0.0)
        at = start + link.rod.length + (link.upper.length or 0.0)
        points += [(link.rod.mass, start + link.rod.centre, link.rod.transverse_inertia), (link.tip_mass, at, 0.0)]
    assert len(points) == 2 * len(which.split("+")) and part in ("", "rod", "tip"), name
    return points[-1:] if part == "tip" else points[:-1] if part == "rod" else points


def stacked(parts: list[str]) -> list[tuple[float, float, float]]:
    """Body segments one on another, from the ankle or the hip upwards, or from the shoulder along the arm.

    `2 shank` is both sides, a number an empty length [m]; after `bent 0.87` lengths are 0.87 of the table's; `arms`
    (both, whole) sit at the centre of the segment before them.
    """
    points: list[tuple[float, float, float]] = []
    at, scale = 0.0, 1.0
    for part in parts:
        count, _, name = part.rpartition(" ")
        if count == "bent":
            scale = float(name)
        elif name == "arms":
            mass = 2.0 * sum(DE_LEVA[arm][0] for arm in ARM) / 100.0 * BODY_MASS
            points.append((mass, points[-1][1], 0.0))
        elif re.fullmatch(r"[\d.]+", name):
            at += float(name)
        else:
            percent, length, centre, sagittal, transverse = DE_LEVA[name]
            mass, length = float(count or 1) * percent / 100.0 * BODY_MASS, scale * length
            squared = (sagittal**2 + transverse**2) / 2.0 / 1e4 * length**2
            share = centre / 100.0 if name in ARM else 1.0 - centre / 100.0
            points.append((mass, at + share * length, mass * squared))
            at += length
    return points


# ---- the tests


def promises(trajectory: vlmb.Trajectory) -> dict[str, Any]:
    """[expect] of a scene; what it leaves out means a finished run without warnings."""
    return {"warnings": [], "repairs": [], "status": "finished", **trajectory.scene.expect}


def enforce(trajectory: vlmb.Trajectory, expect: dict[str, Any]) -> None:
    unknown = set(expect) - set(CHECKS)
    assert not unknown, f"[expect] has keys without a check: {sorted(unknown)}; known: {', '.join(CHECKS)}"
    for name, value in expect.items():
        CHECKS[name](trajectory, value)


@pytest.mark.parametrize("name", NAMES)
def test_model_keeps_its_promises(name: str) -> None:
    trajectory = run(name)
    assert {"coordinates", "degrees_of_freedom"} <= set(trajectory.scene.expect)
    assert np.isfinite(trajectory.q).all() and np.isfinite(trajectory.v).all()
    enforce(trajectory, promises(trajectory))


@pytest.mark.parametrize("name", NAMES)
def test_model_says_what_it_is(name: str) -> None:
    text = (MODELS / f"{name}.toml").read_text()
    assert text.startswith("# ") and text.count("\n#") >= 2
    assert vlmb.load_scene(MODELS / f"{name}.toml").name != "scene"
    row = re.search(rf"^\| \[?`?{name}\.toml.*$", (MODELS / "README.md").read_text(), re.M)
    assert row, f"{name}.toml has no row in models/README.md"
    count, freedom = re.findall(r"\| (\d+) ", row[0])
    expect = vlmb.load_scene(MODELS / f"{name}.toml").expect
    assert (int(count), int(freedom)) == (expect["coordinates"], expect["degrees_of_freedom"])


def test_every_key_is_explained() -> None:
    explained = re.findall(r"^\| `(\w+)` \|", (MODELS / "README.md").read_text(), re.M)
    assert set(explained) == set(CHECKS)


# a promise of each kind that the model in question breaks
BROKEN: dict[str, tuple[str, Any]] = {
    "coordinates": ("one_link", 4),
    "events": ("slip_runner", {"first": [["touch leg", 0.0517]], "within": 1e-6}),
    "lowest_gap": ("jumper", 1e-3),
    "lost": ("jumper", {"impacts": [0.0, 161.0]}),
    "degrees_of_freedom": ("skate_on_slope", 3),
    "left_out": ("one_link", []),
    "warnings": ("straight_legs", []),
    "total_mass": ("one_link", 2.01),
    "body": ("skier_two_links", {"legs": ["2 shank", "2 thigh"]}),
    "status": ("straight_legs", "finished"),
    "stops_by": ("one_link", "finished"),
    "stop_time": ("one_link", [0.0, 10.0]),
    "evaluations": ("one_link", 100),
    "repairs": ("skier_paper", []),
    "residuals": ("skier_paper", {"tan(phi0) = A*k*cos(k*x)": 1e-6}),
    "residuals_at_end": ("skier_paper_balanced", {"tan(phi0) = A*k*cos(k*x)": 1e-8}),
    "programme_decay": ("skier_paper_balanced", 1e-5),
    "conditioning": ("skier_paper", 10.0),
    "half_turns": ("skier_slalom", 15),
    "passes": ("skier_paper", {"psi1": [1.4, 0.5, 1.0]}),
    "power": ("skier_slalom", {"F1_1": [-600.0, 0.0]}),
    "energy_drift": ("one_link", 1e-16),
    "knife_edge_velocity": ("skier_one_link", -1.0),
    "angular_momentum_z": ("one_link", 1e-17),
    "angular_momentum": ("one_link", 1e-3),
    "center_of_mass": ("one_link", 1e-3),
    "closed_form": ("skate_on_slope", {"skate": 1e-17}),
    "happens": ("skate_lets_go", [["stick", "ski", 2.9, 3.0], ["slip", "ski", 0.7, 0.8]]),
    "within": ("one_link", {"xi1_1": [0.0, 0.3]}),
    "at_end": ("one_link", {"t": [0.0, 9.0]}),
    "spans": ("one_link", {"t": 11.0}),
    "crosses_vertical": ("one_link", ["arm"]),
}


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_every_key_can_fail(name: str) -> None:
    model, wrong = BROKEN[name]
    with pytest.raises(AssertionError):
        enforce(run(model), {name: wrong})


def test_unknown_key_fails() -> None:
    with pytest.raises(AssertionError, match="energy_drfit"):
        enforce(run("one_link"), {"energy_drfit": 1e-9})


def test_unlisted_warning_fails() -> None:
    expect = {name: value for name, value in run("straight_legs").scene.expect.items() if name != "warnings"}
    with pytest.raises(AssertionError):
        enforce(run("straight_legs"), {"warnings": [], **expect})


def make_chain(*arguments: str) -> str:
    done = subprocess.run([sys.executable, str(ROOT / "scripts" / "make_chain"), *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_chain_is_what_make_chain_writes() -> None:
    assert make_chain("8") == (MODELS / "chain.toml").read_text()


@pytest.mark.parametrize("links", [1, 2, 20])
@pytest.mark.parametrize("base", ["pivot", "free"])
def test_make_chain_writes_any_length(links: int, base: str, tmp_path: Path) -> None:
    path = tmp_path / "chain.toml"
    path.write_text(make_chain(str(links), "--base", base))
    trajectory = vlmb.simulate(path, duration=0.5)
    assert len(trajectory.scene.links) == links
    enforce(trajectory, promises(trajectory))


@pytest.mark.parametrize("arguments", [["0"], ["many"], ["3", "--base", "ski"], []])
def test_make_chain_refuses(arguments: list[str]) -> None:
    done = subprocess.run([sys.executable, str(ROOT / "scripts" / "make_chain"), *arguments], capture_output=True, text=True)
    assert done.returncode == 2 and "usage" in done.stderr and not done.stdout
