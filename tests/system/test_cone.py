"""Contacts: impacts and modes against closed forms and Pinocchio's solver, and what must not change."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.system.contact_problems import Array, Problem, admm, cross, lost, random_problem, worst
from vlmb.system.cone import Answer, Contact, Grip, Refusal, impact, modes, reactions

ROUGH = math.inf


def answered(found: Answer | Refusal) -> Answer:
    assert isinstance(found, Answer), found
    return found


# Random problems ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_random_problems(count: int) -> None:
    """250 of each have a test of acceptance."""
    random_problems(count, 100)


def random_problems(count: int, many: int) -> None:
    """The law holds to 1e-12; where Pinocchio's solver is exact, velocities agree to 1e-10, and impulses where determined."""
    compared, others = 0, 0
    for seed in range(many):
        problem = random_problem(1000 * count + seed, count)
        found = answered(impact(problem.g, problem.v, problem.contacts))
        assert worst(problem, found.p) < 1e-12, seed
        np.testing.assert_allclose(problem.g @ found.p + problem.v, found.v, atol=1e-12 * np.abs(problem.v).max())
        assert lost(problem, found) > -1e-13 or (problem.mu > 0.0 and problem.restitution > 0.0), seed
        theirs = admm(problem)
        if theirs is None:
            continue
        p = np.zeros(problem.v.size)
        p[: 3 * count] = theirs
        rows = slice(3 * count, None)
        if problem.v.size > 3 * count:
            p[rows] = -np.linalg.solve(problem.g[rows, rows], problem.g[rows, : 3 * count] @ theirs + problem.free[rows])
        if worst(problem, p) > 1e-12:
            continue
        difference = np.abs(problem.g @ p + problem.v - found.v).max() / np.abs(problem.v).max()
        if difference > 1e-10:
            others += 1  # theirs obeys the law to 1e-12 too: the problem has several solutions
            continue
        compared += 1
        if not found.shared:
            np.testing.assert_allclose(p, found.p, atol=1e-9 * max(1.0, np.abs(found.p).max()))
        else:
            assert np.linalg.norm(found.p) <= np.linalg.norm(p) * (1.0 + 1e-9)
            assert float(found.p @ (p - found.p)) >= -1e-9 * float(p @ p)  # the nearest of a convex set to zero
    assert compared >= 0.94 * many and others <= 3


def planar(seed: int, count: int, mu: float, restitution: float) -> tuple[Array, Array, list[Contact]]:
    """Feet of a rigid body in a plane, each with one tangent; three or more share their load, and two do along the ground."""
    rng = np.random.default_rng(seed)
    jacobian = np.vstack([[[1.0, 0.0, -z], [0.0, 1.0, x]] for x, z in rng.normal(size=(count, 2))])
    g = jacobian @ np.diag([1.0, 1.0, 1.0 / rng.uniform(0.1, 1.0)]) @ jacobian.T
    contacts = [Contact(2 * k + 1, (Grip((2 * k,), mu, mu),), restitution) for k in range(count)]
    return g, jacobian @ rng.normal(size=3), contacts


@pytest.mark.parametrize("mu", [0.0, 0.3, 0.8, ROUGH])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_feet_of_a_body_in_a_plane(mu: float, restitution: float) -> None:
    for seed in range(40):
        g, v, contacts = planar(seed, 1 + seed % 4, mu, restitution)
        found = answered(impact(g, v, contacts))
        w = g @ found.p + v
        np.testing.assert_allclose(w, found.v, atol=1e-12 * np.abs(v).max())
        w[1::2] += restitution * v[1::2]
        fast, large = np.abs(v).max(), max(np.abs(found.p).max(), 1e-300)
        along, push = found.p[::2], found.p[1::2]
        assert w[1::2].min() > -1e-12 * fast and push.min() >= 0.0 and np.abs(w[1::2] * push).max() < 1e-12 * fast * large
        if mu < ROUGH:
            assert (np.abs(along) - mu * push).max() < 1e-12 * large
            assert np.abs(along * w[::2] + mu * push * np.abs(w[::2])).max() < 1e-12 * fast * large
        else:
            assert np.all((np.abs(w[::2]) < 1e-12 * fast) | (push < 1e-12 * large))  # what pushes sticks
        if restitution == 0.0:
            assert float(found.p @ (v + found.v)) <= 1e-13 * fast * large


@pytest.mark.parametrize("count", [6, 8, 12])
def test_many_feet(count: int) -> None:
    """More modes than are looked through: the guess leads there, or the most sticking mode is it."""
    for seed in range(8):
        problem = random_problem(77 * count + seed, count)
        found = answered(impact(problem.g, problem.v, problem.contacts))
        assert worst(problem, found.p) < 1e-12


def test_two_skis_of_a_rigid_body_share_their_edges() -> None:
    """Edge and length of each are bounded by one normal force; SciPy's minimum over the same set is no smaller."""
    from scipy.optimize import minimize

    jacobian = np.vstack([np.hstack([np.eye(3), cross(np.array([0.2, side, -0.9]))]) for side in (0.2, -0.2)])
    mass = np.diag([80.0, 80.0, 80.0, 12.0, 11.0, 2.0])
    contacts = [Contact(3 * k + 2, (Grip((3 * k + 1,), 0.8, 0.6), Grip((3 * k,), 0.05, 0.05))) for k in range(2)]
    g = jacobian @ np.linalg.solve(mass, jacobian.T)
    target = np.array([12.0, 200.0, 350.0, 12.0, 60.0, 450.0])
    wanted = g @ target
    found = answered(modes(g, -wanted, contacts))
    assert found.shared and found.slipping == ((False, False),) * 2 and np.all(found.v == 0.0)
    bounds = [
        {"type": "ineq", "fun": lambda p, k=k, row=row, mu=mu, sign=sign: mu * p[3 * k + 2] + sign * p[3 * k + row]}
        for k in range(2)
        for row, mu in ((0, 0.05), (1, 0.8))
        for sign in (1.0, -1.0)
    ]
    assert all(bound["fun"](found.p) > -1e-9 for bound in bounds)  # type: ignore[operator]
    null = np.linalg.svd(jacobian.T)[2][np.linalg.matrix_rank(jacobian) :]
    least = minimize(
        lambda z: 0.5 * float(np.sum((target + null.T @ z) ** 2)),
        np.zeros(len(null)),
        constraints=[{"type": "ineq", "fun": lambda z, f=bound["fun"]: f(target + null.T @ z)} for bound in bounds],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 300},
    )
    assert np.linalg.norm(found.p) <= np.linalg.norm(target + null.T @ least.x) * (1.0 + 1e-9)
    np.testing.assert_allclose(g @ found.p, wanted, rtol=1e-10)


def test_restitution_with_friction_may_raise_the_energy() -> None:
    """Kane's example: with e^2 > 1 - G_nt^2/(G_nn G_tt) a sticking impact gains. The answer says so by its impulses."""
    g = np.array([[1.0, 0.8], [0.8, 1.0]])
    v = np.array([-0.8, -1.0])  # the velocity of least energy for this v_n
    contact = [Contact(1, (Grip((0,), ROUGH, ROUGH),), 0.9)]
    found = answered(impact(g, v, contact))
    np.testing.assert_allclose(found.v, [0.0, 0.9], atol=1e-15)
    energy = [0.5 * float(w @ np.linalg.solve(g, w)) for w in (v, found.v)]
    assert energy[1] > energy[0]
    assert -0.5 * float(found.p @ (v + found.v)) == pytest.approx(energy[0] - energy[1], rel=1e-13)
    still = answered(impact(g, v, [contact[0]._replace(restitution=0.0)]))
    assert -0.5 * float(still.p @ (v + still.v)) == pytest.approx(energy[0], rel=1e-13)


# Rods and bodies of closed form ---------------------------------------------------------------------------------------


def rod(angle: float, side: float = -1.0) -> Array:
    """G (tangent, normal) of the lower end of a uniform rod, m = l = 1, at an angle from the floor; `side` of its end."""
    x, z = side * 0.5 * math.cos(angle), -0.5 * math.sin(angle)
    return np.array([[1.0 + 12.0 * z * z, -12.0 * x * z], [-12.0 * x * z, 1.0 + 12.0 * x * x]])


FALLING = np.array([0.0, -2.0])


def test_a_rod_on_a_smooth_floor() -> None:
    for grips in ((), (Grip((0,), 0.0, 0.0),)):
        contact = Contact(0 if not grips else 1, grips, 0.5)
        g, v = (rod(0.7), FALLING) if grips else (rod(0.7)[1:, 1:], FALLING[1:])
        found = answered(impact(g, v, [contact]))
        assert found.p[-1] == pytest.approx(1.08894870037899, rel=1e-14)
        assert -0.5 * float(found.p @ (v + found.v)) == pytest.approx(0.54447435018950, rel=1e-13)
        assert found.v[-1] == pytest.approx(1.0, rel=1e-15) and found.closed == (True,) and not found.several


@pytest.mark.parametrize("mu", [0.5, 0.658415209, 0.658415209160, 0.8, ROUGH])
def test_a_rod_on_a_rough_floor(mu: float) -> None:
    found = answered(impact(rod(0.7), FALLING, [Contact(1, (Grip((0,), mu, mu),))]))
    if mu > 0.6584152091595:
        np.testing.assert_allclose(found.p, [0.7390873, 1.12252464], rtol=1e-8)
        np.testing.assert_allclose(found.p, -np.linalg.solve(rod(0.7), FALLING), rtol=1e-14)
        assert found.slipping == ((False,),) and np.all(found.v == 0.0)
    else:
        push = 2.0 / (rod(0.7)[1, 1] + mu * rod(0.7)[1, 0])
        np.testing.assert_allclose(found.p, [mu * push, push], rtol=1e-14)
        assert found.slipping == ((True,),) and found.v[0] < 0.0


@pytest.mark.parametrize("mu", [1.4, 2.0])
def test_a_rod_that_no_friction_allows(mu: float) -> None:
    """Painleve: 1 + 3 cos(a) (cos(a) - mu sin(a)) < 0 of a rod that slides with its body behind, and gravity pulls it down."""
    for angle in (0.9, 1.1, 1.2):
        number = 1.0 + 3.0 * math.cos(angle) * (math.cos(angle) - mu * math.sin(angle))
        found = modes(rod(angle), np.array([0.0, -9.81]), [Contact(1, (Grip((0,), mu, mu, (-1.0,)),))])
        if number > 0.0:
            assert answered(found).p[1] == pytest.approx(9.81 / number, rel=1e-13)
            continue
        assert isinstance(found, Refusal) and found.why == "friction" and found.contact == 0
        assert found.number == pytest.approx(number, rel=1e-13)
        trailing = answered(modes(rod(angle), np.array([0.0, -9.81]), [Contact(1, (Grip((0,), mu, mu, (1.0,)),))]))
        assert trailing.p[0] == pytest.approx(-mu * trailing.p[1], rel=1e-15)
        stopped = answered(impact(rod(angle), np.array([-1.0, 0.0]), [Contact(1, (Grip((0,), mu, mu),))]))
        assert stopped.several and np.all(stopped.v == 0.0) and stopped.p[0] > 0.0  # an impact without an approach may stop it
    assert 1.0 + 3.0 * math.cos(1.1) * (math.cos(1.1) - mu * math.sin(1.1)) < 0.0  # was met above


def test_several_modes_and_the_most_sticking_one() -> None:
    """A rod at rest that friction may hold, though it would leave without it."""
    g = np.array([[1.0, 0.9], [0.9, 1.0]])
    force = np.array([-1.2, 1.0])
    found = answered(modes(g, -g @ force, [Contact(1, (Grip((0,), 1.5, 1.5),))]))
    assert (-g @ force)[1] > 0.0 and found.several and found.slipping == ((False,),)
    np.testing.assert_allclose(found.p, force, rtol=1e-14)
    only = answered(modes(g, -g @ force, [Contact(1, (Grip((0,), 1.1, 1.1),))]))
    assert only.closed == (False,) and not only.several and np.all(only.p == 0.0)


def test_rough_ground_neither_pushes_nor_holds() -> None:
    """Where sticking would pull: at rest the contact opens; at an impact friction is the limit of much of it."""
    g, contact = np.array([[1.0, 0.9], [0.9, 1.0]]), [Contact(1, (Grip((0,), ROUGH, ROUGH),))]
    up = answered(modes(g, np.array([0.1, 0.5]), contact))
    assert up.closed == (False,) and np.all(up.p == 0.0)
    assert isinstance(modes(g, np.array([-2.0, -0.5]), contact), Refusal)
    found = answered(impact(g, np.array([-2.0, -0.5]), contact))
    much = answered(impact(g, np.array([-2.0, -0.5]), [Contact(1, (Grip((0,), 1e7, 1e7),))]))
    np.testing.assert_allclose(found.p, [0.5 / 0.9, 0.0], rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(much.p, found.p, atol=1e-6)


def test_a_grip_that_holds_more_than_it_rubs() -> None:
    """A block of 1 kg pulled sideways: it holds up to hold N and, once it lets go, rubs with slip N against its acceleration."""
    for pull, slips in ((2.9, False), (3.1, True)):
        grip = Grip((0, 1), 0.3, 0.2)
        way = np.array([math.cos(0.4), math.sin(0.4)])
        found = answered(modes(np.eye(3), np.array([*(pull * way), -10.0]), [Contact(2, (grip,))]))
        assert found.slipping == ((slips,),)
        np.testing.assert_allclose(found.p, [*(-(2.0 if slips else pull) * way), 10.0], rtol=1e-14)


def test_slip_in_a_coupled_plane_is_along_its_own_acceleration() -> None:
    g = np.array([[1.5, 0.4, 0.2], [0.4, 0.9, -0.3], [0.2, -0.3, 1.1]])
    found = answered(modes(g, np.array([6.0, 1.0, -10.0]), [Contact(2, (Grip((0, 1), 0.4, 0.3),))]))
    friction, slip = found.p[:2], found.v[:2]
    np.testing.assert_allclose(friction, -0.3 * found.p[2] * slip / np.linalg.norm(slip), rtol=1e-13)
    assert found.slipping == ((True,),) and not found.several


# A ski ----------------------------------------------------------------------------------------------------------------


def test_a_ski_lands_across_its_edge() -> None:
    """80 kg, 10 m/s, 0.2 rad off, 3 m/s down: holds with 0.8, skids with less; friction along it is its own."""
    v = np.array([10.0 * math.cos(0.2), 10.0 * math.sin(0.2), -3.0])
    edge, along = Grip((1,), 0.8, 0.6), Grip((0,), 0.1, 0.1)
    carved = answered(impact(np.eye(3) / 80.0, v, [Contact(2, (edge,))]))
    assert isinstance(impact(np.eye(3) / 80.0, v, [Contact(2, (edge._replace(rows=(0, 1)),))]), Answer)
    assert carved.slipping == ((False,),)
    assert carved.p[1] == pytest.approx(-158.935464636, rel=1e-11) and carved.p[2] == pytest.approx(240.0)
    v_carved = answered(impact(np.eye(3) / 80.0, v, [Contact(2, (edge, Grip((0,), 0.0, 0.0)))]))
    assert v_carved.v[0] == pytest.approx(9.80066577841242, rel=1e-14)
    assert -0.5 * float(v_carved.p @ (v + v_carved.v)) == pytest.approx(517.878011994, rel=1e-11)
    skidded = answered(impact(np.eye(3) / 80.0, v, [Contact(2, (edge._replace(hold=0.6, slip=0.5), along))]))
    assert skidded.slipping == ((True, True),)
    np.testing.assert_allclose(skidded.p, [-24.0, -120.0, 240.0], rtol=1e-13)
    both = answered(modes(np.eye(3), np.array([0.05, -0.5, -1.0]), [Contact(2, (edge, along))]))
    assert both.slipping == ((False, False),)
    np.testing.assert_allclose(both.p, [-0.05, 0.5, 1.0], rtol=1e-13)


# Feet that share a load -----------------------------------------------------------------------------------------------


CORNERS = [(0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5)]


def table(load: float, x: float, y: float, push: float = 0.0) -> tuple[Array, Array, list[Contact]]:
    """A table of 10 kg on four feet, loaded at (x, y) and pushed along x at the height of its centre of mass, 0.5 m."""
    jacobian = np.vstack([np.hstack([np.eye(3), cross(np.array([*corner, -0.5]))]) for corner in CORNERS])
    mass = np.diag([10.0, 10.0, 10.0, 1.0, 1.2, 2.0])
    force = np.array([push, 0.0, -98.1 - load, -load * y, load * x, 0.0])
    contacts = [Contact(3 * k + 2, (Grip((3 * k, 3 * k + 1), 0.8, 0.8),)) for k in range(4)]
    return jacobian @ np.linalg.solve(mass, jacobian.T), jacobian @ np.linalg.solve(mass, force), contacts


def test_a_skier_falls_on_hands_beside_the_ski() -> None:
    """Two points that may slip any way and a ski that skids and slides: nine rows, of fewer velocities. Seventy bodies."""
    for seed in range(70):
        dice = np.random.default_rng(seed)
        jacobian = dice.normal(size=(9, int(dice.integers(6, 10))))
        v = jacobian @ dice.normal(size=jacobian.shape[1])
        first, second, hold, along = dice.uniform([0.2, 0.2, 0.3, 0.05], [0.9, 0.9, 0.8, 0.2]).tolist()
        ski = Contact(8, (Grip((6,), hold, hold), Grip((7,), along, along)))
        contacts = [Contact(2, (Grip((0, 1), first, first),)), Contact(5, (Grip((3, 4), second, second),)), ski]
        for row in (2, 5, 8):
            if v[row] > 0.0 and dice.random() < 0.7:
                jacobian[row], v[row] = -jacobian[row], -v[row]
        found = answered(impact(jacobian @ jacobian.T, v, contacts))
        np.testing.assert_allclose(jacobian @ (jacobian.T @ found.p) + v, found.v, atol=1e-11)
        for normal, grips, _ in contacts:
            push, away = found.p[normal], found.v[normal]
            assert push >= 0.0 and away >= 0.0 and push * away < 1e-11, seed
            for rows, most, slip, _ in grips:
                pull, slides = found.p[list(rows)], found.v[list(rows)]
                assert np.linalg.norm(pull) <= most * push + 1e-11, seed
                assert pull @ slides == pytest.approx(-slip * push * np.linalg.norm(slides), abs=1e-10), seed


def test_a_loaded_corner_lifts_no_foot() -> None:
    """Least norm alone would pull at the foot across; the least admissible reactions leave it at zero, and nothing opens."""
    g, a, contacts = table(1000.0, 0.49, 0.49)
    found = answered(modes(g, a, contacts))
    assert found.closed == (True,) * 4 and found.shared and np.all(found.v == 0.0)
    assert found.p[11] == pytest.approx(0.0, abs=1e-9)  # unconstrained it would be 24.525 - 235.1
    assert found.p[2::3].sum() == pytest.approx(1098.1, rel=1e-12)
    moments = np.array(CORNERS).T @ found.p[2::3]
    np.testing.assert_allclose(moments, [490.0, 490.0], rtol=1e-11)
    np.testing.assert_allclose(found.p[[5, 8]], found.p[5], rtol=1e-10)
    held = reactions(g, a, contacts, found.closed, found.slipping)
    assert held is not None
    np.testing.assert_array_equal(held.p, found.p)


def test_an_even_load_is_shared_evenly() -> None:
    found = answered(modes(*table(0.0, 0.0, 0.0)))
    np.testing.assert_allclose(found.p[2::3], 24.525, rtol=1e-12)
    pushed = answered(modes(*table(0.0, 0.0, 0.0, push=20.0)))
    assert not any(slips for (slips,) in pushed.slipping)
    assert pushed.p[0::3].sum() == pytest.approx(-20.0, rel=1e-12)
    np.testing.assert_allclose(pushed.p[2::3], [29.525, 29.525, 19.525, 19.525], rtol=1e-12)


def test_a_load_on_a_corner_and_beyond() -> None:
    """At the corner of a table without weight one foot bears all; beyond it the table tips and feet open."""
    g, a, contacts = table(1000.0, 0.5, 0.5)
    weight = table(0.0, 0.0, 0.0)[1]
    found = answered(modes(g, a - weight, contacts))
    np.testing.assert_allclose(found.p[2::3], [1000.0, 0.0, 0.0, 0.0], atol=1e-7)
    g, a, contacts = table(1000.0, 0.6, 0.6)
    assert reactions(g, a, contacts, (True,) * 4, ((False,),) * 4) is None
    tipped = answered(modes(g, a, contacts))
    assert not all(tipped.closed) and tipped.v[11] > 0.0


def test_a_table_that_slides_and_turns_lifts_no_foot() -> None:
    """Each foot slides its own way; the foot across the load bears nothing, the others what the balance asks, and all stay."""
    g, a, contacts = table(1000.0, 0.45, 0.45)
    ways = [np.array([1.0 - 0.8 * y, 0.8 * x]) for x, y in CORNERS]
    sliding = [
        contact._replace(grips=(Grip(contact.grips[0].rows, 0.1, 0.1, tuple((way / np.linalg.norm(way)).tolist())),))
        for contact, way in zip(contacts, ways, strict=True)
    ]
    found = answered(modes(g, a, sliding))
    assert found.closed == (True,) * 4 and found.shared
    push = found.p[2::3]
    assert push.min() >= 0.0 and push.sum() == pytest.approx(1098.1, rel=1e-12) and push[3] < 1e-9 * push[0]
    for k, way in enumerate(ways):
        np.testing.assert_allclose(found.p[3 * k : 3 * k + 2], -0.1 * push[k] * way / np.linalg.norm(way), rtol=1e-12, atol=1e-12)
    moments = np.array([[y for _, y in CORNERS], [-x for x, _ in CORNERS]]) @ push
    friction = found.p.reshape(4, 3)[:, :2].sum(axis=0)  # at 0.5 m below the middle
    load = np.array([-450.0, 450.0])
    np.testing.assert_allclose(moments + load, [-0.5 * friction[1], 0.5 * friction[0]], rtol=1e-9)


def test_a_rigid_body_on_many_sliding_feet() -> None:
    """Impulses are not determined, nor the motion, which friction turns; one that keeps the law is found."""
    problem = random_problem(77 * 6 + 6, 6)
    found = answered(impact(problem.g, problem.v, problem.contacts))
    assert worst(problem, found.p) < 1e-12 and all(slips for (slips,) in found.slipping)


@pytest.mark.parametrize("restitution", [0.0, 0.3])
def test_feet_dropped_symmetrically_stay_symmetric(restitution: float) -> None:
    """Also for an elastic lander whose feet slide outwards, each against its own sliding."""
    jacobian = np.array([[1.0, 0.0, 0.4, 0.3], [0.0, 1.0, -0.5, 0.0], [1.0, 0.0, 0.4, -0.3], [0.0, 1.0, 0.5, 0.0]])
    g = jacobian @ np.diag([0.5, 0.5, 2.0, 3.0]) @ jacobian.T
    contacts = [Contact(2 * k + 1, (Grip((2 * k,), 0.3, 0.3),), restitution) for k in range(2)]
    found = answered(impact(g, jacobian @ np.array([0.0, -1.5, 0.0, 2.0]), contacts))
    assert found.p[0] == pytest.approx(-found.p[2], rel=1e-13) and found.p[1] == pytest.approx(found.p[3], rel=1e-13)
    assert found.v[1] == pytest.approx(found.v[3], rel=1e-13) and found.v[0] == pytest.approx(-found.v[2], rel=1e-13)


# What cannot be ---------------------------------------------------------------------------------------------------------


def test_refusals() -> None:
    smooth = [Contact(0)]
    assert impact(np.array([[0.0]]), np.array([-1.0]), smooth) == Refusal("prescribed", 0)
    held = np.array([[1.0, 1.0], [1.0, 1.0]])  # an ideal row holds the same velocity
    found = impact(held, np.array([-1.0, 0.0]), smooth)
    assert isinstance(found, Refusal) and found.why in ("prescribed", "rows")
    contradicting = impact(np.ones((3, 3)), np.array([1.0, 0.0, 0.5]), smooth)
    assert isinstance(contradicting, Refusal) and contradicting.why == "rows"


def test_slow_approaches_do_not_bounce() -> None:
    for speed, after in ((9e-7, 0.0), (2e-6, 1e-6)):
        found = answered(impact(np.eye(1), np.array([-speed]), [Contact(0, (), 0.5)]))
        assert found.v[0] == pytest.approx(after, abs=1e-20)


def test_answers_are_read_only_and_problems_stay() -> None:
    problem = random_problem(3, 3)
    g, v = problem.g.copy(), problem.v.copy()
    found = answered(impact(problem.g, problem.v, problem.contacts))
    assert not found.p.flags.writeable and not found.v.flags.writeable
    np.testing.assert_array_equal(problem.g, g)
    np.testing.assert_array_equal(problem.v, v)


# What must not change -----------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 3), factor=st.floats(1e-4, 1e4), mass=st.floats(1e-3, 1e3))
def test_velocities_and_masses_scale(seed: int, count: int, factor: float, mass: float) -> None:
    problem = random_problem(seed, count)
    one = answered(impact(problem.g, problem.v, problem.contacts))
    other = answered(impact(problem.g / mass, problem.v * factor, problem.contacts))
    if one.several or not same_modes(one, other):
        return
    np.testing.assert_allclose(other.p, one.p * factor * mass, atol=1e-9 * factor * mass * max(1.0, np.abs(one.p).max()))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), angle=st.floats(-3.0, 3.0))
def test_axes_in_the_ground_do_not_matter(seed: int, angle: float) -> None:
    """Turned tangents, and contacts in another order, give the same motion."""
    problem = random_problem(seed, 2)
    one = answered(impact(problem.g, problem.v, problem.contacts))
    turn = np.eye(problem.v.size)
    turn[:2, :2] = [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
    turn = turn[[3, 4, 5, 0, 1, 2, *range(6, problem.v.size)]]
    turned = Problem(turn @ problem.g @ turn.T, turn @ problem.v, problem.mu, problem.restitution, 2)
    other = answered(impact(turned.g, turned.v, turned.contacts))
    assert one.several == other.several
    np.testing.assert_allclose(turn @ one.v, other.v, atol=1e-9 * np.abs(problem.v).max())


@settings(max_examples=60, deadline=None)
@given(
    first=st.tuples(*[st.floats(0.1, 1.5)] * 2), angle=st.floats(0.2, 1.4), mu=st.floats(0.0, 1.2), speed=st.floats(-3.0, 3.0)
)
def test_a_rod_keeps_the_law_at_any_angle(first: tuple[float, float], angle: float, mu: float, speed: float) -> None:
    g, v = rod(angle), np.array([speed, -first[0]])
    found = answered(impact(g, v, [Contact(1, (Grip((0,), mu, mu),), 0.0)]))
    assert found.v[1] >= 0.0 and found.p[1] >= 0.0 and abs(found.v[1] * found.p[1]) < 1e-12
    assert abs(found.p[0]) <= mu * found.p[1] + 1e-12
    assert abs(found.p[0] * found.v[0] + mu * found.p[1] * abs(found.v[0])) < 1e-11 * (1.0 + abs(speed)) * (1.0 + found.p[1])
    assert -0.5 * float(found.p @ (v + found.v)) >= -1e-13


def same_modes(one: Answer, other: Answer) -> bool:
    return one.closed == other.closed and one.slipping == other.slipping
