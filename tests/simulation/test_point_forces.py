"""Forces at points, springs between points and drag, in both engines: against closed forms and independent integrations."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import simpson, solve_ivp
from scipy.optimize import brentq

import vlmb
from tests.small_scenes import ANY_LENGTH, FIXED, FLYING, PIVOT, SKI, bent, link, scene, table, write_toml
from vlmb.cli import main
from vlmb.system.system import make_system

Array = np.ndarray
both_engines = pytest.mark.parametrize("engine", ["core", "pinocchio"])
POINT_MASS = {"length": 0.4, "mass": 2.0, "com": 0.0, "inertia": 0.02}  # at the start of the rod


def run(made: vlmb.Scene, engine: str, duration: float = 1.0, **options: Any) -> vlmb.Trajectory:
    found = vlmb.simulate(made, duration=duration, engine=engine, **options)
    assert found.status == "finished", found.message
    scale = max(1.0, *(float(np.abs(found[name]).max()) for name in ("kinetic", "potential", "spring", "work")))
    assert np.abs(found["balance"]).max() < 1e-9 * scale and not found.doubts
    return found


def assert_same(one: vlmb.Trajectory, other: vlmb.Trajectory, tolerance: float = 1e-8) -> None:
    for name in one.mechanism.coordinate_names:
        np.testing.assert_allclose(one[name], other[name], rtol=tolerance, atol=tolerance, err_msg=name)


def message_of(simulated: Callable[[], vlmb.Trajectory]) -> str:
    try:
        return simulated().message
    except vlmb.VlmbError as error:
        return str(error)


# Forces at points


@both_engines
def test_components_by_the_frame_of_a_link_are_its_generalized_forces(engine: str) -> None:
    """At the tip of link 1 that stands in A: F along it on its length, F l cos psi on its azimuth, F l on its elevation."""
    leg = link("legs", upper=FIXED)
    start = {"phi1": 0.4, "psi1": 0.7, "phi1_dot": 0.8, "psi1_dot": -0.5}
    at_tip = [{"at": "legs.tip", "frame": "legs", "force": ["40 - 3*xi1_1_dot", "9*cos(2*t)", "-6*psi1_dot"]}]
    named = [
        {"on": "F1_1", "law": "40 - 3*xi1_1_dot"}, {"on": "M_phi1", "law": "9*cos(2*t)*legs.length*cos(psi1)"},
        {"on": "M_psi1", "law": "-6*psi1_dot*legs.length"},
    ]  # fmt: skip
    one = run(scene(PIVOT, [leg], start=start, forces=at_tip), engine)
    other = run(scene(PIVOT, [leg], start=start, forces=named), engine)
    assert_same(one, other)
    work = [sum(each.work_by_force.values())[-1] for each in (one, other)]
    assert work[0] == pytest.approx(work[1], rel=1e-8)


@both_engines
def test_a_force_that_drives_forward_moves_the_whole_mechanism(engine: str) -> None:
    """Momentum along a ski that may only go ahead: M com'' is the force, whatever point of whatever link it is at."""
    made = scene(
        {"kind": "ski", "mass": 5.0, "inertia": 0.6}, [link("legs"), link("trunk")], plane=True, gravity=0.0,
        start={"psi1": 1.2, "psi2": 0.8, "speed": 1.0}, forces=[{"at": "trunk.tip", "force": ["30*sin(t)", 0, "8"]}],
    )  # fmt: skip
    found = run(made, engine)
    mass = 5.0 + 2 * 5.0
    wanted = found["com.x_dot"][0] + 30.0 / mass * (1.0 - np.cos(found.t))
    np.testing.assert_allclose(found["com.x_dot"], wanted, rtol=1e-9)
    assert set(found.controls) == {"R_trunk.tip.x", "R_trunk.tip.z"}
    power = found.controls["R_trunk.tip.x"] * found["trunk.tip.x_dot"]
    np.testing.assert_allclose(found.power("R_trunk.tip.x"), power, atol=1e-8)


@both_engines
def test_snow_and_hinges_carry_what_outer_forces_leave(engine: str) -> None:
    """The normal force makes, with weight and outer forces, the momentum upwards; ball hinges carry no torque."""
    forces = [{"at": "link2.rod_end", "force": ["5*cos(t)", "-8*link2.rod_end.y_dot", "60 + 20*sin(4*t)"]}]
    springs = [{"between": ["link1.rod_start", "link2.tip"], "stiffness": 80.0, "rest": 0.3, "damping": 3.0}]
    made = bent({**SKI, "drag": 0.4}, 2, forces=forces, springs=springs)
    found = run(made, engine, t_eval=np.linspace(0.0, 1.0, 1001))
    mass = 5.0 + 2 * 5.0
    speed = np.linalg.norm([found[f"com.{axis}_dot"] for axis in "xyz"], axis=0)
    outer = found.controls["R_link2.rod_end.z"] - 0.4 * speed * found["com.z_dot"]
    impulse = simpson(found.reactions["normal"] + outer - mass * 9.81, x=found.t)
    assert impulse == pytest.approx(mass * (found["com.z_dot"][-1] - found["com.z_dot"][0]), abs=1e-7)
    size = np.abs(found.hinge_force("link1")).max()
    assert max(np.abs(found.hinge_torque(name)).max() for name in ("link1", "link2")) < 1e-10 * size


@both_engines
def test_a_force_at_a_point_as_a_control(engine: str) -> None:
    made = scene(PIVOT, [link("legs", upper=FIXED)], start={"psi1": 0.7, "phi1_dot": 0.6}, parameters={"z0": 0.7})
    servo = made.changed(
        start={"xi1_1_dot": 0.0}, programme={
            "constraints": ["height: legs.tip.z = z0"], "controls": ["R_legs.tip.z"], "frequency": 8.0,
        },
    )  # fmt: skip
    found = run(servo, engine)
    assert np.abs(found.residuals["height"].position).max() < 1e-8
    assert np.abs(found.controls["R_legs.tip.z"]).max() > 1.0
    by_law = scene(PIVOT, [link("legs", upper=FIXED)], start={"psi1": 0.7, "phi1_dot": 0.6},
                   forces=[{"on": "R_legs.tip.z", "law": "20*sin(3*t)"}])  # fmt: skip
    by_hand = vlmb.simulate(made, duration=1.0, engine=engine, control=lambda t, see: {"R_legs.tip.z": 20.0 * math.sin(3.0 * t)})
    assert_same(run(by_law, engine), by_hand, 1e-7)


@both_engines
def test_the_frame_of_a_link_has_a_pole_across_it_and_none_along(engine: str) -> None:
    def upright(force: list[str]) -> vlmb.Trajectory:
        made = scene(PIVOT, [link("legs")], forces=[{"at": "legs.rod_end", "frame": "legs", "force": force}])
        return vlmb.simulate(made, duration=0.1, engine=engine)

    assert upright(["30", "0", "0"]).status == "finished"
    for across in (["0", "1", "0"], ["0", "0", "1"]):
        said = message_of(lambda force=across: upright(force))
        assert re.search(r"phi1 is used by .*force.*'legs' stands at the pole", said), said


def test_what_is_refused_of_forces_at_points() -> None:
    def refused(words: str, force: dict[str, Any], **changes: Any) -> None:
        with pytest.raises(vlmb.VlmbError, match=words):
            vlmb.check(table(PIVOT, [link("legs", **changes)], start={"psi1": 0.5}, forces=[force]))

    refused(r"forces\[0\].at: unknown point 'leg.tip'.*'legs'", {"at": "leg.tip", "force": [1, 0, 0]})
    refused(r"forces\[0\].at: 'legs' has no point 'top'.*'tip'", {"at": "legs.top", "force": [1, 0, 0]})
    refused(r"forces\[0\].frame = 'snow'.*surface, legs", {"at": "legs.tip", "force": [1, 0, 0], "frame": "snow"})
    refused(r"forces\[0\].force\[1\].*unknown name 'psi2'.*psi1", {"at": "legs.tip", "force": ["1", "psi2", "0"]})
    refused(r"forces\[0\]: a force at a point has `force`", {"at": "legs.tip", "law": "1"})
    refused(r"forces\[0\]: give one of", {"at": "legs.tip", "on": "M_psi1", "force": [1, 0, 0]})
    refused(r"legs.tip ends a free segment that carries no mass.*tip_mass", {"at": "legs.tip", "force": [1, 0, 0]}, tip_mass=None)
    refused(r"forces\[0\].on: unknown force 'R_legs.tip'; .*R_legs.tip.x", {"on": "R_legs.tip", "law": "1"})


# Drag


@both_engines
def test_quadratic_drag_in_closed_form(engine: str) -> None:
    """m w' = -c w^2 of the sleigh's point: w = w0/(1 + c w0 t/m)."""
    base = {"kind": "ski", "mass": 80.0, "inertia": 4.0, "drag": 0.2}
    found = run(scene(base, [], start={"speed": 8.0}), engine, 20.0)
    np.testing.assert_allclose(found["speed"], 8.0 / (1.0 + 0.02 * found.t), rtol=1e-11)
    lost = 40.0 * (64.0 - found["speed"] ** 2)
    np.testing.assert_allclose(found["dissipated"], lost, rtol=1e-9, atol=1e-8)
    assert not list(found.controls)


@both_engines
def test_drag_at_a_point_is_the_force_that_says_so(engine: str) -> None:
    made = bent(SKI, 1)
    speed = "sqrt(" + " + ".join(f"link1.tip.{axis}_dot**2" for axis in "xyz") + ")"
    by_force = made.changed(forces=[{"at": "link1.tip", "force": [f"-0.7*{speed}*link1.tip.{axis}_dot" for axis in "xyz"]}])
    by_drag = made.changed(base={"drag": 0.7, "drag_at": "link1.tip"})
    one, other = run(by_force, engine), run(by_drag, engine)
    assert_same(one, other)
    np.testing.assert_allclose(-one["work"], other["dissipated"], atol=1e-9)
    np.testing.assert_allclose(one.reactions["normal"], other.reactions["normal"], rtol=1e-7)


def test_drag_belongs_to_a_ski() -> None:
    with pytest.raises(vlmb.SceneError, match=r"base: drag .* 'ski'.*\[\[forces\]\] at"):
        scene({**PIVOT, "drag": 0.2}, 1)
    with pytest.raises(vlmb.SceneError, match=r"base.drag_at: unknown point 'legs'"):
        vlmb.check(scene({**SKI, "drag": 0.2, "drag_at": "legs"}, 1))


# Springs between points


def swings(torques: Callable[[Array, Array], Array], inertia: float, t: Array, start: list[float]) -> Array:
    """Two pendulums with coordinates psi (2,): J psi'' = torques(psi, psi')."""

    def rates(_: float, y: Array) -> Array:
        return np.concatenate([y[2:], torques(y[:2], y[2:]) / inertia])

    return solve_ivp(rates, (t[0], t[-1]), [*start, 0.0, 0.0], "DOP853", t, rtol=1e-13, atol=1e-14).y


@both_engines
@pytest.mark.parametrize("rest", [0.0, 0.7])
def test_two_pendulums_and_a_spring_between_their_tips(rest: float, engine: str) -> None:
    """V = g terms + k (l - rest)^2/2 by hand in the elevations, the damper by c l'^2/2."""
    k, c, mass, length, apart = 40.0, 1.5, 2.0, 0.8, 1.0
    rod = {"length": length, "mass": mass}
    posts = [{"name": name, "parent": "base", "anchor": [x, 0.0, 1.0], "rod": rod} for name, x in (("a", -0.5), ("b", 0.5))]
    made = scene(
        PIVOT, posts, plane=True, start={"psi1": -1.0, "psi2": -2.2},
        springs=[{"between": ["a.tip", "b.tip"], "stiffness": k, "damping": c, "rest": rest}],
    )  # fmt: skip

    def torques(psi: Array, rate: Array) -> Array:
        r = np.array([apart, 0.0]) + length * (np.array([np.cos(psi[1]), np.sin(psi[1])]) - [np.cos(psi[0]), np.sin(psi[0])])
        by_a, by_b = -length * np.array([-np.sin(psi[0]), np.cos(psi[0])]), length * np.array([-np.sin(psi[1]), np.cos(psi[1])])
        size = math.hypot(*r)
        slopes = np.array([r @ by_a, r @ by_b]) / size  # of l by psi
        return -(k * (size - rest) + c * slopes @ rate) * slopes - mass * 9.81 * 0.5 * length * np.cos(psi)

    found = run(made, engine, 3.0)
    wanted = swings(torques, mass * length**2 / 3.0, found.t, [-1.0, -2.2])
    np.testing.assert_allclose(found["psi1"], wanted[0], atol=1e-8)
    np.testing.assert_allclose(found["psi2"], wanted[1], atol=1e-8)
    assert found["dissipated"][-1] > 0.05 and found["spring"].max() > 0.1


def on_a_line(springs: list[dict[str, Any]], z: float, speed: float = 0.0) -> vlmb.Scene:
    """A point of 2 kg that moves up and down."""
    leg = {"name": "leg", "rod": POINT_MASS, "lower": {"length": z, "limits": ANY_LENGTH}}
    return scene(PIVOT, [leg], plane=True, start={"psi1": math.pi / 2, "xi1_1_dot": speed}, springs=springs)


@both_engines
def test_a_rope_against_piecewise_exact_motion(engine: str) -> None:
    """Free fall; taut: m e'' = m g - k e - c e' until it would push; free flight again."""
    m, g, k, c, top, rest = 2.0, 9.81, 300.0, 4.0, 3.0, 1.0
    rope = {"between": [[0.0, 0.0, top], "leg.rod_start"], "stiffness": k, "damping": c, "rest": rest, "tension_only": True}
    found = run(on_a_line([rope], 2.5), engine, 1.4)
    taut_at = math.sqrt(2.0 * 0.5 / g)
    rate, sag = c / (2.0 * m), m * g / k
    swing = math.sqrt(k / m - rate**2)
    v0 = g * taut_at

    def longer(s: float) -> tuple[float, float]:
        """e and e' a time s after it became taut."""
        a, b = -sag, (v0 - sag * rate) / swing
        cosine, sine, fading = math.cos(swing * s), math.sin(swing * s), math.exp(-rate * s)
        e = sag + fading * (a * cosine + b * sine)
        return e, fading * ((b * swing - rate * a) * cosine - (a * swing + rate * b) * sine)

    def pull(s: float) -> float:
        return k * longer(s)[0] + c * longer(s)[1]

    half = math.pi / swing
    slack_after = brentq(pull, 0.7 * half, 1.3 * half, xtol=1e-15)
    e1, v1 = longer(slack_after)
    assert e1 > 0.0  # it is still longer than at rest, and does not push

    def height(t: float) -> float:
        if t < taut_at:
            return 2.5 - 0.5 * g * t**2
        if t < taut_at + slack_after:
            return top - rest - longer(t - taut_at)[0]
        s = t - taut_at - slack_after
        return top - rest - e1 - v1 * s - 0.5 * g * s**2

    before = found.t < taut_at + slack_after + (-v1 + math.sqrt(v1**2 - 2.0 * g * e1)) / g  # until it is taut again
    assert before.sum() > 30 and (found.t[before] > taut_at + slack_after).sum() > 10
    np.testing.assert_allclose(found["leg.rod_start.z"][before], [height(t) for t in found.t[before]], atol=1e-9)


@both_engines
def test_a_spring_without_length_goes_through_its_end(engine: str) -> None:
    made = on_a_line([{"between": ["leg.rod_start", [0.0, 0.0, 1.0]], "stiffness": 50.0}], 1.4)
    found = run(made, engine, 3.0)
    sag = 2.0 * 9.81 / 50.0
    np.testing.assert_allclose(found["xi1_1"], 1.0 - sag + (0.4 + sag) * np.cos(5.0 * found.t), atol=1e-9)


@both_engines
@pytest.mark.parametrize("changes", [{"rest": 0.1}, {"damping": 2.0}, {"rest": 0.1, "tension_only": True}])
def test_ends_that_meet_are_named(changes: dict[str, Any], engine: str) -> None:
    spring = {"between": ["leg.rod_start", [0.0, 0.0, 1.0]], "stiffness": 5.0, **changes}
    found = vlmb.simulate(on_a_line([spring], 1.4), engine=engine)
    assert found.status == "stopped"
    assert "springs[0]: leg.rod_start and the fixed place [0.0, 0.0, 1.0] meet" in found.message
    assert found["xi1_1"][-1] == pytest.approx(1.0, abs=1e-6)
    with pytest.raises(vlmb.SingularError, match=r"springs\[0\]: its two ends meet"):
        vlmb.check(on_a_line([spring], 1.0))


@both_engines
def test_a_free_pair_with_a_damper_between_its_links_keeps_its_angular_momentum(engine: str) -> None:
    springs = [
        {"between": ["link1.rod_start", "link2.tip"], "stiffness": 200.0, "damping": 5.0, "rest": 0.4},
        {"between": ["link1.tip", "link2.rod_end"], "damping": 3.0, "stiffness": 90.0, "rest": 0.2, "tension_only": True},
    ]
    made = bent(FLYING, 2, gravity=0.0, springs=springs)
    found = run(made, engine, 2.0, rtol=1e-13, atol=1e-14)
    model = found.mechanism.model
    data = model.createData()
    q, v = found.q, found.v
    moments = np.array([pin.computeCentroidalMomentum(model, data, *pair).angular for pair in zip(q, v, strict=True)])
    np.testing.assert_allclose(moments, moments[0] + 0.0 * moments, rtol=0, atol=1e-12)
    assert found["dissipated"][-1] > 0.1


@both_engines
@pytest.mark.parametrize("base", [FLYING, PIVOT, SKI], ids=lambda base: str(base["kind"]))
@pytest.mark.parametrize(
    "spring",
    [
        {"between": ["link1.rod_start", "link2.tip"], "stiffness": 200.0, "damping": 5.0, "rest": 0.4},
        {"between": ["link1.tip", "link2.rod_end"], "stiffness": 90.0, "damping": 3.0, "rest": 0.45, "tension_only": True},
        {"between": ["link2.tip", [0.3, 0.2, 1.0]], "stiffness": 90.0},
    ],
    ids=["damped", "rope", "to a fixed place"],
)
def test_the_account_of_energy_closes_with_springs(spring: dict[str, Any], base: dict[str, Any], engine: str) -> None:
    """Within 1e-9 J per joule of the largest energy, and of 1 J: what `run` holds every scene of this page to."""
    found = run(bent(base, 2, springs=[spring]), engine, 1.0)
    assert found["spring"].max() > 1.0
    assert np.abs(found["balance"]).max() < 1e-9 * np.abs(found["energy"]).max()


def test_a_scene_with_springs_comes_back_from_a_dict() -> None:
    spring = {"between": ["leg.tip", ["2*a", 0, "a"]], "stiffness": "100*a", "rest": 0.2}
    made = vlmb.Scene.from_dict({**on_a_line([], 1.4).to_dict(), "parameters": {"a": 0.5}, "springs": [spring]})
    assert made.springs[0].between == ("leg.tip", (1.0, 0.0, 0.5)) and made.springs[0].stiffness == 50.0
    assert vlmb.Scene.from_dict(made.to_dict()) == made
    stiffer = made.changed_at({"springs.0.stiffness": 70.0})
    assert stiffer.springs[0].stiffness == 70.0


def test_what_is_refused_of_springs() -> None:
    def refused(words: str, **spring: Any) -> None:
        with pytest.raises(vlmb.VlmbError, match=words):
            vlmb.check(on_a_line([spring], 1.4).changed(start={"psi1": 1.0}))

    refused(r"springs\[0\]: .*stiffness.*or damping", between=["leg.rod_end", [0, 0, 1]])
    refused(r"springs\[0\].between: both ends are fixed", between=[[0, 0, 0], [0, 0, 1]], stiffness=1.0)
    refused(r"springs\[0\].between: 'leg.rod_end' is both ends", between=["leg.rod_end", "leg.rod_end"], stiffness=1.0)
    refused(r"springs\[0\].between\[1\]: unknown point 'arm.tip'", between=["leg.rod_end", "arm.tip"], stiffness=1.0)
    refused(r"unknown key 'springs\[0\].stifness'; did you mean 'stiffness'", between=["leg.rod_end", [0, 0, 1]], stifness=1.0)


def test_nothing_is_added_where_there_are_none() -> None:
    plan = make_system(vlmb.build(bent(SKI, 2))).core_plan
    assert len(plan.plant.force) == 0 and len(plan.plant.tape.root) == 0


ACTING: dict[str, Any] = {
    "name": "all at once", "slope": 0.2, "base": {**SKI, "friction": 0.04, "drag": 0.3, "drag_at": "link1.tip"},
    "links": [link("link1")],
    "forces": [{"at": "link1.tip", "force": ["-2*link1.tip.x_dot", 0, 5.0]}],
    "springs": [
        {"between": ["link1.rod_end", [0.3, 1.0, 2.0]], "stiffness": 50.0, "damping": 2.0, "rest": 0.4, "tension_only": True},
        {"between": ["link1.tip", [2.0, 0.0, 1.0]], "stiffness": 20.0},
    ],
    "start": {"psi1": 1.2, "phi1": 0.3, "speed": 3.0}, "run": {"rtol": 1e-10, "atol": 1e-12},
}  # fmt: skip


def test_info_and_check_tell_what_acts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    checked = vlmb.check(ACTING)
    rod_end = [0.8 * part for part in (math.cos(0.3) * math.cos(1.2), math.sin(0.3) * math.cos(1.2), math.sin(1.2))]
    length = math.dist(rod_end, [0.3, 1.0, 2.0])
    sentences = [
        "forces[0]: at link1.tip, (-2*link1.tip.x_dot, 0, 5) N in the surface frame",
        "springs[0]: link1.rod_end to [0.3, 1.0, 2.0] m, 50 N/m, 2 N s/m, rest 0.4 m, a rope, which never pushes; "
        f"{length:.4g} m at the start",
        "springs[1]: link1.tip to [2.0, 0.0, 1.0] m, 20 N/m, rest 0 m;",
        "base: Coulomb friction 0.04 of the normal force", "base: drag 0.3 kg/m by the velocity of link1.tip",
    ]  # fmt: skip
    for sentence in sentences:
        assert sentence in checked.report
    path = write_toml(tmp_path / "all.toml", ACTING)
    assert main(["info", str(path)]) == 0
    told = capsys.readouterr().out
    for sentence in sentences:
        assert f"  acts                {sentence}" in told
    assert vlmb.check(on_a_line([], 1.0)).acting == ()


@both_engines
def test_all_that_acts_comes_back_from_a_file(engine: str, tmp_path: Path) -> None:
    made = vlmb.Scene.from_dict(ACTING)
    found = run(made, engine, 0.4)
    again = vlmb.load_trajectory(found.save(tmp_path / "run.npz"))
    assert again.scene == made and again.scene.to_dict() == made.to_dict()
    for name in ("x", "psi1", "energy", "dissipated", "balance", "spring"):
        np.testing.assert_array_equal(again[name], found[name])
    for name, values in found.controls.items():
        np.testing.assert_array_equal(again.controls[name], values)
    for name, values in found.reactions.items():
        np.testing.assert_allclose(again.reactions[name], values, rtol=1e-12, atol=1e-12)
    frame = pytest.importorskip("pandas").read_csv(found.save_csv(tmp_path / "run.csv"))
    for column in ("R_link1.tip.x [N]", "R_link1.tip.z [N]", "friction [N]", "normal [N]", "dissipated [J]"):
        assert column in frame.columns
    np.testing.assert_allclose(frame["R_link1.tip.x [N]"], -2.0 * found["link1.tip.x_dot"], rtol=1e-6, atol=1e-9)


DRIVEN = {"motion": "prescribed", "law": "0.3 + 0.06*sin(4*t)"}
BEYOND: dict[str, dict[str, Any]] = {
    "a force": {"forces": [{"at": "b.tip", "force": ["3*cos(2*t)", "-0.5*b.tip.y_dot", 4.0]}]},
    "a spring": {"springs": [{"between": ["b.tip", [0.4, 0.3, 1.2]], "stiffness": 90.0, "damping": 3.0, "rest": 0.2}]},
    "a rope": {"springs": [{"between": ["b.rod_end", [0.0, 0.0, 3.0]], "stiffness": 60.0, "rest": 0.8, "tension_only": True}]},
    "a spring without rest": {"springs": [{"between": ["b.tip", [0.4, 0.3, 1.2]], "stiffness": 90.0}]},
    "drag": {"base": {**SKI, "drag": 0.8, "drag_at": "b.tip"}},
    "a control": {
        "programme": {"constraints": ["b.tip.x - a.hinge.x = 0.6"], "controls": ["R_b.tip.x"], "frequency": 3.0},
    },
    "beside an ideal row": {
        "constraints": ["psi2 = 0.4"], "springs": [{"between": ["b.tip", [0.4, 0.3, 1.2]], "stiffness": 90.0, "damping": 3.0}],
    },
}  # fmt: skip


@pytest.mark.parametrize("base", [PIVOT, SKI], ids=lambda base: str(base["kind"]))
@pytest.mark.parametrize("name", BEYOND)
def test_a_driven_length_carries_what_acts_at_points_beyond_it(name: str, base: dict[str, Any]) -> None:
    """Its force and its work have what a force at a point does as the length moves that point: by both engines, and by energy."""
    keys = {"base": base, **BEYOND[name]}
    if keys["base"]["kind"] != base["kind"]:
        pytest.skip("drag is a ski's")
    start = {"psi1": 1.0, "phi1": 0.4, "psi2": 0.4, "phi2": 1.3, "phi1_dot": 0.3, "psi1_dot": 0.2}
    start |= {"phi0": 0.3, "speed": 1.5} if base["kind"] == "ski" else {}
    links = [link("a", lower=DRIVEN, upper=FIXED), link("b", lower=FIXED, upper=DRIVEN)]
    made = scene(keys.pop("base"), links, start=start, **keys)
    core, other = (vlmb.simulate(made, duration=0.5, engine=engine) for engine in ("core", "pinocchio"))
    for found in (core, other):
        assert found.status == "finished", found.message
        assert np.abs(found["balance"]).max() < 1e-9 * max(1.0, np.abs(found["energy"]).max())
    for force in ("F1_1", "F2_2"):
        theirs = other.controls[force]
        np.testing.assert_allclose(core.controls[force], theirs, rtol=0, atol=1e-7 * np.abs(theirs).max())


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("spring", [True, False])
def test_a_force_beyond_a_driven_length_is_in_its_account(engine: str, spring: bool) -> None:
    driven = {"motion": "prescribed", "law": "0.2 + 0.05*sin(9*t)"}
    acting = {"springs": [{"between": ["leg.tip", [1.0, 0.0, 0.5]], "stiffness": 30.0}]} if spring else {
        "forces": [{"at": "leg.tip", "force": ["3", "0", "5"]}]
    }
    made = vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", "mass": 2.0}, "start": {"psi1": -1.2, "x_dot": 1.0},
        "links": [{"name": "leg", "lower": driven, "rod": {"length": 1.0, "mass": 1.0}}], **acting,
    })
    run = vlmb.simulate(made, 0.5, rtol=1e-11, atol=1e-12, engine=engine)
    assert np.abs(run["balance"]).max() < 1e-9 and abs(run.work_by_force["F1_1"][-1]) > 0.1
