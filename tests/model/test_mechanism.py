"""The generated model: joints with a purpose only, depth-first, and every motion with inertia."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vlmb
import vlmb.model.mechanism
from tests.small_scenes import BENT, FIXED, FLYING, PIVOT, SKI, TIGHT, Table, bent, link, random_state, scene, table
from vlmb.model.memory import make_data
from vlmb.simulation.checking import check

BARE = {"tip_mass": None, "upper": None}


def joints(mechanism: vlmb.Mechanism) -> list[str]:
    return list(mechanism.model.names)[1:]


# Joints with a purpose -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 5])
def test_coordinates_of_the_paper(n: int) -> None:
    """4n - 1 for the pivoted chain without a last tip mass, 4n + 3 for the skier."""
    links = [link(f"link{i + 1}") for i in range(n - 1)]
    pivot = vlmb.build(scene(PIVOT, [*links, link(f"link{n}", tip_mass=None)]))
    ski = vlmb.build(scene(SKI, [*links, link(f"link{n}")]))
    each = [[f"phi{i}", f"psi{i}", f"xi{i}_1", f"xi{i}_2"] for i in range(1, n + 1)]
    names = list(itertools.chain(*each))
    assert list(pivot.coordinate_names) == names[:-1]
    assert len(pivot.coordinate_names) == 4 * n - 1
    assert list(ski.coordinate_names) == ["x", "y", "phi0", *names]
    assert len(ski.coordinate_names) == 4 * n + 3
    assert pivot.model.nv == 5 * n - 1  # a ball joint has the spin besides
    assert ski.model.nv == 5 * n + 3


def test_fixed_segments_and_hanging_nothing_make_no_joint() -> None:
    mechanism = vlmb.build(scene(PIVOT, [link("legs", lower=FIXED), link("trunk", lower=None, tip_mass=None)]))
    assert joints(mechanism) == ["legs", "legs.upper", "trunk"]
    assert list(mechanism.coordinate_names) == ["phi1", "psi1", "xi1_2", "phi2", "psi2"]
    first, second, third = mechanism.left_out
    assert first == "xi1_1, the lower segment of 'legs': fixed at 0.2 m"
    assert second.startswith("xi2_1, the lower segment of 'trunk': fixed at 0 m")
    assert third == "xi2_2, the upper segment of 'trunk': nothing hangs on it; drawn with its length 0.2 m"
    full = vlmb.build(scene(PIVOT, [link("legs"), link("trunk")]))
    assert full.left_out == ()
    assert joints(full) == ["legs", "legs.lower", "legs.upper", "trunk", "trunk.lower", "trunk.upper"]


@pytest.mark.parametrize("point", ["tip", "rod_start", "rod_end"])
def test_only_what_hangs_on_the_tip_needs_the_upper_segment(point: str) -> None:
    links = [link("legs", tip_mass=None), link("arm", parent_point=point, **BARE)]
    mechanism = vlmb.build(scene(PIVOT, links))
    assert ("xi1_2" in mechanism.coordinate_names) == (point == "tip")
    assert any("nothing hangs" in entry and "'legs'" in entry for entry in mechanism.left_out) == (point != "tip")


def test_a_prescribed_segment_that_carries_nothing_is_a_coordinate() -> None:
    mechanism = vlmb.build(scene(PIVOT, [link("a", tip_mass=None, upper={"motion": "prescribed", "law": "0.3 + 0.1*t"})]))
    assert "xi1_2" in mechanism.coordinate_names and not mechanism.left_out
    state = mechanism.state({"phi1": 0.1, "psi1": 0.2, "xi1_1": 0.3, "xi1_2": 0.4}, {"xi1_2_dot": 0.1})
    assert mechanism.postures(state).distance(0, "tip") == pytest.approx(0.3 + 0.5 + 0.4)


def test_bases() -> None:
    assert joints(vlmb.build(scene(SKI, [])))[0] == "ski"
    assert vlmb.build(scene(SKI, [])).coordinate_names == ("x", "y", "phi0")
    assert vlmb.build(scene(FLYING, 1)).coordinate_names[:3] == ("x", "y", "z")
    assert vlmb.build(scene(FLYING, 1, plane=True)).coordinate_names == ("x", "z", "psi1", "xi1_1", "xi1_2")
    plane = vlmb.build(scene(PIVOT, 2, plane=True))
    assert plane.coordinate_names == ("psi1", "xi1_1", "xi1_2", "psi2", "xi2_1", "xi2_2")
    assert plane.model.nv == 6
    assert not any("Spherical" in joint.shortname() for joint in plane.model.joints)


def test_masses_and_gravity() -> None:
    mechanism = vlmb.build(scene(SKI, 2, slope=0.3))
    assert pin.computeTotalMass(mechanism.model) == pytest.approx(5.0 + 2 * 5.0, rel=1e-15)
    np.testing.assert_allclose(
        mechanism.model.gravity.linear, [9.81 * math.sin(0.3), 0.0, -9.81 * math.cos(0.3)], rtol=1e-15, atol=1e-15
    )


# Depth-first order ---------------------------------------------------------------------------------------------------

TREE = [
    link("legs", parent="base"),
    link("arm", parent="legs", parent_point="rod_end", upper=FIXED),
    link("trunk", parent="legs", lower=FIXED),
    link("hand", parent="arm", parent_point="rod_start", rod={"length": 0.3, "mass": 1.0}),
]


def mass_matrix_by_rnea(mechanism: vlmb.Mechanism, q: np.ndarray) -> np.ndarray:
    model, data, zero = mechanism.model, make_data(mechanism.model), np.zeros(mechanism.model.nv)
    bias = pin.rnea(model, data, q, zero, zero).copy()
    return np.column_stack([pin.rnea(model, data, q, zero, unit) - bias for unit in np.eye(model.nv)])


@pytest.mark.parametrize("order", list(itertools.permutations(range(4))), ids=lambda order: "".join(map(str, order)))
def test_any_order_in_the_file_gives_depth_first_joints(order: tuple[int, ...]) -> None:
    mechanism = vlmb.build(scene(SKI, [TREE[k] for k in order]))
    model = mechanism.model
    assert model.check(make_data(mechanism.model))
    for joint in range(1, model.njoints):  # a subtree is one run of joints: what crba relies on
        below = sorted(k for k in range(1, model.njoints) if joint in list(model.supports[k]))
        assert below == list(range(joint, joint + len(below)))
    state = random_state(mechanism, 3)
    crba = np.array(pin.crba(model, make_data(mechanism.model), state.q, pin.Convention.WORLD))
    crba = np.triu(crba) + np.triu(crba, 1).T
    reference = mass_matrix_by_rnea(mechanism, state.q)
    np.testing.assert_allclose(crba, reference, rtol=0, atol=1e-13 * np.abs(reference).max())
    np.testing.assert_allclose(reference, reference.T, rtol=0, atol=1e-13 * np.abs(reference).max())


def test_crba_fills_the_whole_symmetric_matrix() -> None:
    """The engine reads columns of data.M directly, both triangles."""
    mechanism = vlmb.build(scene(SKI, TREE))
    state = random_state(mechanism, 5)
    mass = np.array(pin.crba(mechanism.model, make_data(mechanism.model), state.q, pin.Convention.WORLD))
    assert np.array_equal(mass, mass.T)


def test_the_order_in_the_file_names_the_coordinates() -> None:
    mechanism = vlmb.build(scene(PIVOT, [TREE[3], TREE[2], TREE[0], TREE[1]]))
    assert [entry.name for entry in mechanism.layout.links] == ["hand", "trunk", "legs", "arm"]
    assert mechanism.layout.order[0] == 2
    values = {name: 0.1 * k for k, name in enumerate(mechanism.coordinate_names)}
    values |= {"psi3": 0.9, "phi3": 0.4}
    tip = mechanism.position(mechanism.state(values), "legs", "rod_start")
    reach = values["xi3_1"]
    expected = reach * np.array([math.cos(0.4) * math.cos(0.9), math.sin(0.4) * math.cos(0.9), math.sin(0.9)])
    np.testing.assert_allclose(tip, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("n", [60])
def test_long_chains_are_built_without_recursion(n: int) -> None:
    mechanism = vlmb.build(scene(PIVOT, n))
    assert mechanism.model.check(make_data(mechanism.model))
    assert len(mechanism.coordinate_names) == 4 * n


# Motions without inertia ---------------------------------------------------------------------------------------------

MASSLESS: dict[str, Table] = {
    "a link without mass": table(PIVOT, [link("ghost", rod={"length": 0.5, "mass": 0.0}, tip_mass=None)]),
    "a branch without mass": table(
        PIVOT, [link("a"), link("ghost", rod={"length": 0.5, "mass": 0.0}, tip_mass=None), link("c", parent="a")]
    ),
    "all mass in the hinge": table(
        PIVOT, [link("ghost", rod={"length": 0.0, "mass": 0.0}, lower={"length": 0.0, "motion": "fixed"}, upper=None)]
    ),
    "two segments in series without mass between": table(PIVOT, [link("ghost", rod={"length": 0.5, "mass": 0.0})]),
    "a child in the hinge of a massless rod": table(
        PIVOT,
        [
            link("ghost", rod={"length": 0.5, "mass": 0.0}, lower={"length": 0.0, "motion": "fixed"}, **BARE),
            link("child", parent="ghost", parent_point="rod_start"),
        ],
    ),
    "a flying hinge on a free segment": table({"kind": "free"}, [link("ghost")]),
}  # fmt: skip


@pytest.mark.parametrize("case", MASSLESS)
def test_motions_without_inertia_are_named_before_the_run(case: str) -> None:
    with pytest.raises(vlmb.SceneError) as caught:
        vlmb.build(vlmb.Scene.from_dict(MASSLESS[case]))
    assert "ghost" in str(caught.value)
    assert "mass" in str(caught.value)


def straight(**upper: Any) -> Table:
    """Two links with free segments at a massless hinge."""
    return table(PIVOT, [link("thigh", tip_mass=None, **upper), link("shin")], run={**TIGHT, "duration": 1.0})


def test_straight_legs_are_warned_of() -> None:
    mechanism = vlmb.build(vlmb.Scene.from_dict(straight()))
    (warning,) = mechanism.warnings
    for text in ("'thigh'", "'shin'", "singular", "tip_mass"):
        assert text in warning
    assert vlmb.build(scene(PIVOT, [link("thigh"), link("shin")])).warnings == ()
    assert vlmb.build(vlmb.Scene.from_dict(straight(upper=FIXED))).warnings == ()
    prescribed = {"motion": "prescribed", "law": "0.2"}
    assert vlmb.build(vlmb.Scene.from_dict(straight(upper=prescribed))).warnings == ()
    third = [link("thigh", tip_mass=None), link("shin", lower=FIXED), link("other", parent="thigh")]
    assert vlmb.build(scene(PIVOT, third)).warnings == ()


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("folded", [False, True])
def test_straight_legs_are_an_error_at_run_time(engine: str, folded: bool) -> None:
    start = {"psi1": 0.3, "phi1": 0.2, "psi2": -0.3 if folded else 0.3, "phi2": 0.2 + math.pi * folded}
    made = vlmb.Scene.from_dict({**straight(), "start": start})
    try:
        trajectory = vlmb.simulate(made, engine=engine)
    except vlmb.SingularError as error:
        message = str(error)
    else:
        assert trajectory.status == "failed"
        assert np.isfinite(trajectory.q).all()
        assert np.isfinite(trajectory.v).all()
        message = trajectory.message
    assert "singular" in message
    assert "thigh" in message


@pytest.mark.parametrize("psi", [0.3, 1.1, -0.7, math.pi / 2])
@pytest.mark.parametrize("folded", [False, True])
def test_a_start_with_straight_legs_is_refused(psi: float, folded: bool) -> None:
    """Whatever the last digits of the matrix: that a factorization happens to pass is no answer."""
    start = {"psi1": psi, "phi1": 0.2, "psi2": -psi if folded else psi, "phi2": 0.2 + math.pi * folded}
    with pytest.raises(vlmb.SingularError, match="thigh"):
        check(vlmb.Scene.from_dict({**straight(), "start": start}))


def test_falling_through_a_straight_leg_ends_with_a_sentence_or_is_accurate() -> None:
    """A planar motion that must pass the lined-up posture: a named failure with the part so far, or a balanced account."""
    start = {"psi1": -1.4, "psi2": -1.7, "psi1_dot": -1.0, "psi2_dot": 1.5}
    made = vlmb.Scene.from_dict({**straight(), "plane": True, "start": start, "run": {"duration": 1.0, "fall": False}})
    trajectory = vlmb.simulate(made)
    assert len(trajectory) >= 1
    assert np.isfinite(trajectory["energy"]).all()
    if trajectory.status == "failed":
        assert "straight" in trajectory.message or "singular" in trajectory.message
    else:
        assert np.abs(trajectory["balance"]).max() < 1e-4 * trajectory["kinetic"].max()


def test_two_flying_links_on_a_massless_hinge() -> None:
    """Free lower segments of both: the same straight leg."""
    mechanism = vlmb.build(scene({"kind": "free"}, [link("left"), link("right", parent="base")]))
    assert any("'left'" in warning and "'right'" in warning for warning in mechanism.warnings)
    assert vlmb.build(scene(FLYING, [link("left"), link("right", parent="base")])).warnings == ()
    one_fixed = [link("left"), link("right", parent="base", lower=FIXED)]
    assert vlmb.build(scene({"kind": "free"}, one_fixed)).warnings == ()


# The spin of a thin rod ----------------------------------------------------------------------------------------------


def spun(monkeypatch: pytest.MonkeyPatch, ratio: float, made: vlmb.Scene) -> vlmb.Trajectory:
    monkeypatch.setattr(vlmb.model.mechanism, "AXIAL_RATIO", ratio)
    times = np.linspace(0.0, 1.0, 11)
    return vlmb.simulate(made, duration=1.0, t_eval=times, method="dop853", rtol=1e-13, atol=1e-13)


SPIN_SCENES = {
    "pivot": bent(PIVOT, 2),
    "ski": bent(SKI, 2, slope=0.1),
    "flying": bent(FLYING, 2),
    "forces": bent(
        SKI, 2,
        forces=[
            {"on": "M_psi1", "law": "3*sin(2*t)"}, {"on": "M_phi2", "law": 1.5}, {"on": "T_link2", "law": "2*cos(t)"},
            {"between": ["link1", "link2"], "stiffness": 8.0, "damping": 0.5, "rest": 0.4},
        ],
    ),
    "prescribed": scene(
        PIVOT, [link("link1", upper={"motion": "prescribed", "law": "0.2 + 0.05*sin(5*t)"}), link("link2", lower=FIXED)],
        start={name: value for name, value in BENT.items() if name[-1] in "12"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SPIN_SCENES)
def test_results_do_not_depend_on_the_axial_inertia(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    made = SPIN_SCENES[name]
    first = spun(monkeypatch, 1.0, made)
    assert first.status == "finished", first.message
    for ratio in (0.01, 100.0):
        other = spun(monkeypatch, ratio, made)
        for entry in ("link1", "link2"):
            for axis in "xyz":
                direction = f"{entry}.direction.{axis}"
                np.testing.assert_allclose(other[direction], first[direction], rtol=0, atol=1e-10)
            np.testing.assert_allclose(other.position(entry), first.position(entry), rtol=0, atol=1e-9)
        np.testing.assert_allclose(other["energy"], first["energy"], rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", SPIN_SCENES)
def test_links_never_spin(name: str) -> None:
    """omega_i . d_i stays zero: no torque has a part along a link."""
    from vlmb.model.coordinates import kinematics

    trajectory = vlmb.simulate(SPIN_SCENES[name], duration=1.0)
    motion = kinematics(trajectory.mechanism.layout, trajectory.q, trajectory.v)
    assert np.abs(np.sum(motion.omegas * motion.directions, axis=-1)).max() < 1e-9


# Memory --------------------------------------------------------------------------------------------------------------


def test_a_model_that_does_not_fit_is_refused_before_it_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vlmb.model.memory, "_available_memory", lambda: 2**20)
    monkeypatch.setattr(vlmb.model.memory.pin, "Data", lambda model: pytest.fail("Data was allocated"))
    with pytest.raises(vlmb.VlmbError, match=r"50 velocities need about 0\.0 GiB.*use fewer links"):
        vlmb.simulate(scene(PIVOT, 10), duration=0.01, engine="pinocchio")
    assert vlmb.simulate(scene(PIVOT, 10), duration=0.01).status == "finished"


@pytest.mark.parametrize("available", [0, 2**40])
def test_a_model_that_fits_or_cannot_be_judged_is_made(available: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vlmb.model.memory, "_available_memory", lambda: available)
    assert vlmb.build(scene(PIVOT, 3)).model.nv == 15


def test_memory_of_this_machine_is_known_or_zero() -> None:
    assert vlmb.model.memory._available_memory() >= 0
    assert vlmb.model.memory.data_bytes(250) == pytest.approx(0.5e9, rel=0.01)
    assert vlmb.model.memory.data_bytes(500) == pytest.approx(4e9, rel=0.01)


# State and coordinates -----------------------------------------------------------------------------------------------

ROUND_TRIPS = {
    "pivot": vlmb.build(scene(PIVOT, 2)),
    "ski": vlmb.build(scene(SKI, TREE)),
    "flying": vlmb.build(scene(FLYING, 2)),
    "plane": vlmb.build(scene(SKI, 2, plane=True)),
}
angle = st.floats(-20.0, 20.0)
number = st.floats(-5.0, 5.0)


@settings(max_examples=60, deadline=None)
@given(data=st.data(), name=st.sampled_from(sorted(ROUND_TRIPS)))
def test_coordinates_come_back_on_their_own_branch(data: st.DataObject, name: str) -> None:
    """psi beyond the vertical and phi over many turns, read `near` where they are."""
    mechanism = ROUND_TRIPS[name]
    values = {at: data.draw(angle if at.startswith("p") else number, label=at) for at in mechanism.coordinate_names}
    rates = {f"{at}_dot": data.draw(number, label=f"{at}_dot") for at in mechanism.coordinate_names}
    near = {at: value + data.draw(st.floats(-0.3, 0.3)) for at, value in values.items()}
    read = mechanism.coordinates(mechanism.state(values, rates), near)
    for at, value in values.items():
        steepness = 1.0
        if not mechanism.layout.plane and at[:3] in ("phi", "psi") and at != "phi0":
            steepness = abs(math.cos(values["psi" + at[3:]]))
            if steepness < 0.1:
                continue
        assert read[at] == pytest.approx(value, abs=1e-12 / steepness**2)
        assert read[f"{at}_dot"] == pytest.approx(rates[f"{at}_dot"], abs=1e-11 / steepness**2)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), name=st.sampled_from(sorted(ROUND_TRIPS)))
def test_reading_and_writing_again_keeps_the_state(seed: int, name: str) -> None:
    """Without `near` the branch may differ, the state does not: directions and their rates come back."""
    from vlmb.model.coordinates import kinematics

    mechanism = ROUND_TRIPS[name]
    state = random_state(mechanism, seed)
    read = mechanism.coordinates(state)
    values = {at: read[at] for at in mechanism.coordinate_names}
    again = mechanism.state(values, {f"{at}_dot": read[f"{at}_dot"] for at in values})
    first, second = (kinematics(mechanism.layout, *each) for each in (state, again))
    np.testing.assert_allclose(second.directions, first.directions, rtol=0, atol=1e-13)
    np.testing.assert_allclose(second.direction_rates, first.direction_rates, rtol=0, atol=1e-11)


def test_positions_are_the_papers() -> None:
    """(2.2): the tip is at (xi1 + l + xi2) d."""
    mechanism = vlmb.build(scene(SKI, 2))
    values = {"x": 1.0, "y": -2.0, "phi0": 0.7, "phi1": 0.3, "psi1": 2.1, "xi1_1": 0.2, "xi1_2": 0.4}
    values |= {"phi2": 1.5, "psi2": -0.4, "xi2_1": 0.1, "xi2_2": 0.3}
    state = mechanism.state(values)

    def along(phi: float, psi: float) -> np.ndarray:
        return np.array([math.cos(phi) * math.cos(psi), math.sin(phi) * math.cos(psi), math.sin(psi)])

    knee = np.array([1.0, -2.0, 0.0]) + 1.1 * along(0.3, 2.1)
    np.testing.assert_allclose(mechanism.position(state, "link1", "tip"), knee, rtol=0, atol=1e-14)
    np.testing.assert_allclose(mechanism.position(state, "link2", "hinge"), knee, rtol=0, atol=1e-14)
    np.testing.assert_allclose(mechanism.position(state, "link2", "rod_end"), knee + 0.6 * along(1.5, -0.4), rtol=0, atol=1e-14)
    np.testing.assert_allclose(mechanism.position(state, "link2", "tip"), knee + 0.9 * along(1.5, -0.4), rtol=0, atol=1e-14)


def test_errors_of_state_and_position() -> None:
    mechanism = vlmb.build(scene(PIVOT, 1))
    good = dict.fromkeys(mechanism.coordinate_names, 0.3)
    cases: list[tuple[dict[str, Any], dict[str, Any] | None, str]] = [
        ({"phi1": 0.1}, None, "missing coordinates psi1, xi1_1, xi1_2"),
        ({**good, "psi2": 0.1}, None, "unknown coordinate 'psi2'.*'psi1'"),
        ({**good, "psi1": math.nan}, None, "psi1 = nan"),
        ({**good, "psi1": math.inf}, None, "psi1 = inf"),
        ({**good, "psi1": "up"}, None, "psi1 = 'up'"),
        ({**good, "psi1": None}, None, "psi1 = None"),
        (good, {"psi1": 1.0}, "unknown rate 'psi1'.*'psi1_dot'"),
        (good, {"psi2_dot": 1.0}, "unknown rate 'psi2_dot'"),
        (good, {"psi1_dot": math.nan}, "psi1_dot = nan"),
    ]
    for values, rates, text in cases:
        with pytest.raises(vlmb.SceneError, match=text):
            mechanism.state(values, rates)
    state = mechanism.state(good)
    for link_name, point in (("link2", "tip"), ("link1", "knee")):
        with pytest.raises(vlmb.SceneError, match=r"link1\.rod_end"):
            mechanism.position(state, link_name, point)


def test_position_of_a_configuration_off_the_sphere() -> None:
    """q from a driver is normalized only to rounding; positions do not depend on its norm."""
    mechanism = vlmb.build(scene(SKI, 1))
    state = random_state(mechanism, 4)
    longer = state.q.copy()
    longer[2:4] *= 1.5
    longer[mechanism.layout.links[0].q :][:4] *= 0.5
    expected = mechanism.position(state, "link1")
    np.testing.assert_allclose(mechanism.position((longer, state.v), "link1"), expected, rtol=0, atol=1e-14)
