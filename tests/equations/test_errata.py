"""Each erratum of docs/errata.md: the printed form fails against the derivation, the correct one passes."""

from __future__ import annotations

import dataclasses
import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb.equations.closed_form as cf
from tests.reference.chain_cases import Array, Case, make_case, mismatch, reference, reference_form
from tests.reference.symbolic import energies, squared_speed

ROOT = Path(__file__).parents[2]
ONE = make_case(1, False, seed=50, tips="none", uniform=True)
TWO = make_case(2, False, seed=51, tips="none", uniform=True)
TWO.q[[0, 1, 4, 5]] = 0.5, 0.7, -0.6, -0.9  # no term of (3.2), (3.3) is small
SKIER = make_case(1, True, seed=52, uniform=True)
LONG_SKIER = make_case(3, True, seed=53, tips="last", uniform=True)


def assert_erratum(printed: Any, correct: Any, derived: Any) -> None:
    """Hold that the correct form is the derived one and the printed form is not."""
    assert mismatch(correct, derived) < 1e-12
    assert mismatch(printed, derived) > 1e-3


def unpack(case: Case) -> tuple[cf.ChainParameters, cf.ChainState]:
    return case.parameters(), case.state()


def chaplygin_row(name: str) -> float:
    """Left side of one row of the skier with one link, derived."""
    matrix, h = reference_form(SKIER, "chaplygin")
    row = ("x", "phi0", "phi1", "psi1", "xi1_1", "xi1_2").index(name)
    return float(matrix[row] @ SKIER.a[1:] + h[row])


def test_2_5() -> None:
    p, s = unpack(ONE)
    m, xi, length = p.rod_mass[0], s.xi[0, 0], p.rod_length[0]
    zeta = m * length**2 / 3 + m * xi + m * xi**2  # l_1 lost
    printed = 0.5 * (m * s.xi_dot[0, 0] ** 2 + zeta * (s.psi_dot[0] ** 2 + (s.phi_dot[0] * np.cos(s.psi[0])) ** 2))
    assert_erratum(printed, cf.eq_2_5(p, s), energies(1, False)(ONE.q, ONE.v, ONE.data)[0])


@pytest.mark.parametrize("fault", ["plus", "lost 0", "lost 1", "lost 2", "lost 3"])
def test_3_2(fault: str) -> None:
    p, s = unpack(TWO)
    x = 0.3
    c1, c2 = np.cos(s.psi)
    s1, s2 = np.sin(s.psi)
    cos, sin = np.cos(s.phi[0] - s.phi[1]), np.sin(s.phi[0] - s.phi[1])
    length, rate, arm = s.xi[0].sum() + p.rod_length[0], s.xi_dot[0].sum(), s.xi[1, 0] + x
    line = [
        arm * s.psi_dot[1] * length * s.phi_dot[0] * sin * c1 * s2,
        -arm * s.psi_dot[1] * rate * cos * c1 * s2,
        arm * s.psi_dot[1] * rate * s1 * c2,
        rate * s.xi_dot[1, 0] * s1 * s2,
    ]
    correct = cf.eq_3_2(p, s, x)
    error = -2 * line[1] if fault == "plus" else -line[int(fault[-1])]
    assert_erratum(correct + 2 * error, correct, squared_speed(2, 2)(TWO.q, TWO.v, TWO.data, x))


def test_3_3() -> None:
    p, s = unpack(TWO)
    matrix, h = reference(TWO)
    correct = cf.eq_3_3(p, s, TWO.a[:7])
    first = -p.rod_mass[1] * (s.xi[0].sum() + p.rod_length[0]) * np.sin(s.phi[0] - s.phi[1])
    first *= np.cos(s.psi[0]) * np.cos(s.psi[1]) * TWO.a[0]
    assert_erratum(correct - 2 * first, correct, matrix[6] @ TWO.a + h[6])


def test_eight_equations() -> None:
    matrix, h = reference(TWO)
    assert matrix.shape == (8, 8)
    assert np.linalg.matrix_rank(matrix) == 7
    assert np.abs(matrix[7]).max() == np.abs(h[7]) == 0
    p = cf.chain_parameters(TWO.parameters().rod_length, TWO.parameters().rod_mass)
    assert cf.coordinate_names(p)[-1] == "xi2_1"
    assert np.linalg.matrix_rank(cf.mass_matrix(p, TWO.state())) == len(cf.coordinate_names(p)) == 7


def test_hinge_moments() -> None:
    def rotation(phi: float, psi: float) -> Array:
        """Turn by psi about the horizontal hinge axis, then by phi about the vertical one."""
        c, s = np.cos(phi), np.sin(phi)
        lift = [[np.cos(psi), 0, -np.sin(psi)], [0, 1, 0], [np.sin(psi), 0, np.cos(psi)]]
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array(lift)

    def spin(phi: float, psi: float, d_phi: float, d_psi: float) -> Array:
        """Angular velocity for given rates of the angles, by differences."""
        h = 1e-5
        ahead, behind = rotation(phi + h * d_phi, psi + h * d_psi), rotation(phi - h * d_phi, psi - h * d_psi)
        w = (ahead - behind) / (2 * h) @ rotation(phi, psi).T
        return np.array([w[2, 1], w[0, 2], w[1, 0]])

    lower, upper = (0.4, 0.7), (1.5, -0.3)
    vertical, horizontal = spin(*upper, 1, 0), spin(*upper, 0, 1)  # axes of the hinge at link 2
    np.testing.assert_allclose(vertical, [0, 0, 1], atol=1e-9)
    # A moment 1 on link 2 is a moment -1 on link 1.
    assert -vertical @ spin(*lower, 1, 0) == pytest.approx(-1, abs=1e-8)  # not 0, as printed
    assert -vertical @ spin(*lower, 0, 1) == pytest.approx(0, abs=1e-8)
    assert -horizontal @ spin(*lower, 0, 1) == pytest.approx(-np.cos(1.5 - 0.4), abs=1e-8)  # neither 0 nor -1
    assert -horizontal @ spin(*lower, 1, 0) == pytest.approx(0, abs=1e-8)


@pytest.mark.parametrize(
    ("reading", "first_n"), [("delta in last product", 3), ("square bracket", 2), ("anti-Kronecker 1", 2)]
)
def test_4_2(reading: str, first_n: int) -> None:
    for n in (1, 2, 3, 4):
        case = make_case(n, False, seed=54, tips="none", uniform=True)
        p, s = unpack(case)
        derived = reference(case)[0][::4, ::4]
        m, rod, lower, upper = p.rod_mass, p.rod_length, s.xi[:, 0], s.xi[:, 1]
        length = rod + lower + upper
        printed = np.zeros((n, n))
        for i in range(n):
            for j in range(i, n):
                delta, bar = float(i == j), 0.0 if i == j else 0.5
                after = m[j + 1 :].sum()
                if reading == "anti-Kronecker 1":
                    bar = 1 - delta
                first, rods, last = (
                    rod[i] + lower[i] + (1 - delta) * upper[i],
                    m[j] * (bar * rod[j] + lower[j]),
                    length[j],
                )
                if reading == "delta in last product":
                    last *= delta
                inner = (
                    first * (rods + last * after)
                    if reading == "square bracket"
                    else first * rods + length[i] * last * after
                )
                printed[i, j] = printed[j, i] = delta * m[i] * rod[i] ** 2 / 3 + inner
        printed *= np.cos(s.phi[:, None] - s.phi) * np.outer(np.cos(s.psi), np.cos(s.psi))
        correct = cf.eq_4_2(p, s)
        if n < first_n:
            assert mismatch(printed, derived) < 1e-12
        else:
            assert_erratum(printed, correct, derived)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_number_of_coordinates(n: int) -> None:
    pivoted = make_case(n, False, seed=55, tips="none", uniform=True)
    assert len(pivoted.q) == 4 * n
    assert np.linalg.matrix_rank(reference(pivoted)[0]) == 4 * n - 1
    skier = make_case(n, True, seed=55, tips="last", uniform=True)
    assert np.linalg.matrix_rank(reference(skier)[0]) == 4 * n + 3
    assert np.linalg.matrix_rank(reference_form(skier, "chaplygin")[0]) == 4 * n + 2
    bare = cf.chain_parameters(np.ones(n), 1.0)
    loaded = cf.chain_parameters(np.ones(n), 1.0, np.arange(n) == n - 1)
    counts = [len(cf.coordinate_names(p, form)) for p, form in ((bare, "pivot"), (loaded, "full"), (loaded, "speed"))]
    assert counts == [4 * n - 1, 4 * n + 3, 4 * n + 2]


def test_5_6() -> None:
    p, s = SKIER.parameters([[True, False]]), SKIER.state()
    amplitude, wave, height = 0.8, 0.6, 0.7
    rod = p.rod_length[0]
    q = np.array([s.x, s.phi0, s.phi[0], s.psi[0], s.xi[0, 0]])
    v = np.array([s.x_dot, s.phi0_dot, s.phi_dot[0], s.psi_dot[0], s.xi_dot[0, 0]])
    s = dataclasses.replace(s, xi_dot=np.array([[v[4], 0.0]]))

    def z(q: Array) -> Array:
        """(7.5) and (8.2)."""
        path = np.tan(q[1]) - amplitude * wave * np.cos(wave * q[0])
        return np.array([path, (q[4] + rod) * np.sin(q[3]) - height])

    def w(q: Array) -> Array:
        path = [amplitude * wave**2 * np.sin(wave * q[0]), 1 / np.cos(q[1]) ** 2, 0, 0, 0]
        return np.array([path, [0, 0, 0, (q[4] + rod) * np.cos(q[3]), np.sin(q[3])]])

    matrix, h = cf.mass_matrix(p, s, "chaplygin"), cf.bias(p, s, "chaplygin")
    a = np.linalg.solve(matrix, -h)
    b = np.linalg.solve(matrix, np.eye(5)[:, [1, 4, 3]])  # controls on phi_0, xi_11, psi_1
    g = w(q) @ b
    step = 1e-5
    chi = w(q) @ a + (w(q + step * v) - w(q - step * v)) @ v / (2 * step)
    stiffness, damping = -9.0 * np.eye(2), -6.0 * np.eye(2)
    wanted = stiffness @ z(q) + damping @ (w(q) @ v)

    def rate_of_z_dot(u: Array) -> Array:
        """Second derivative of z along the motion, by differences of z alone."""
        step, acceleration = 1e-4, a + b @ u
        ahead, behind = (z(q + side * step * v + step**2 / 2 * acceleration) for side in (1, -1))
        return np.asarray((ahead - 2 * z(q) + behind) / step**2)

    assert mismatch(rate_of_z_dot(np.linalg.pinv(g) @ (wanted - chi)), wanted) < 1e-5
    assert mismatch(rate_of_z_dot(np.linalg.pinv(g) @ wanted), wanted) > 1e-2
    u_tau = np.cross(g[0], g[1])  # S = r + 1: the paper's determinant
    assert np.abs(g @ u_tau).max() < 1e-12 * np.abs(g).max() * np.abs(u_tau).max()


def test_7_2() -> None:
    p, s = unpack(SKIER)
    both = s.xi[0].sum()
    rotation = s.psi_dot[0] ** 2 + (s.phi_dot[0] * np.cos(s.psi[0])) ** 2
    correct = cf.eq_7_2(p, s)
    misplaced = p.rod_length[0] + both**2 - (p.rod_length[0] + both) ** 2
    printed = correct + 0.5 * p.tip_mass[0] * misplaced * rotation
    assert_erratum(printed, correct, energies(1, True)(SKIER.q, SKIER.v, SKIER.data)[0])


def test_7_4() -> None:
    amplitude, wave, x, x_dot, h = 0.8, 0.6, 1.3, 2.5, 1e-6
    slope = amplitude * wave * np.cos(wave * x)

    def y(t: float) -> float:
        return float(amplitude * np.sin(wave * (x + x_dot * t)))

    y_dot = (y(h) - y(-h)) / (2 * h)
    assert slope * x_dot == pytest.approx(y_dot, rel=1e-8)
    assert abs(slope - y_dot) > 0.1


def test_7_7() -> None:
    p, s = unpack(SKIER)
    k1, k2 = p.rod_mass[0] + p.tip_mass[0], p.tip_mass[0]
    tan, c, sin_psi = np.tan(s.phi0), np.cos(s.psi[0]), np.sin(s.psi[0])
    cos_phi, sin_phi = np.cos(s.phi[0]), np.sin(s.phi[0])
    alpha, beta = sin_phi * tan + cos_phi, cos_phi * tan - sin_phi
    lower, upper = s.xi_dot[0] * s.psi_dot[0]
    derived, correct = chaplygin_row("x"), cf.eq_7_7(p, s, SKIER.a[1:])
    stretch = k1 * SKIER.a[5] + k2 * SKIER.a[6]
    printed = correct - alpha * c * stretch - (sin_phi * tan - cos_phi) * c * stretch
    assert_erratum(printed, correct, derived)
    turning = -2 * alpha * sin_psi * (k1 * lower + k2 * upper)
    for first, second in itertools.product((c, sin_psi), repeat=2):
        misprint = -2 * k1 * (sin_phi * tan - cos_phi) * first * lower - 2 * k2 * beta * second * upper
        assert_erratum(correct - turning + misprint, correct, derived)
    heavy = reference(SKIER, gravity=0.0)[1][:3]
    np.testing.assert_array_equal(heavy, reference(SKIER)[1][:3])  # no weight in the rows of the ski: no theta g


def test_7_8() -> None:
    moment = 7.0

    def angular_momentum(q: Array, v: Array) -> float:
        """About the vertical through the origin: momenta in the direction of a common turn."""
        turn = np.array([-q[1], q[0], 1, 1, 0, 0, 0])
        case = dataclasses.replace(SKIER, q=q, v=v)
        return float(turn @ cf.mass_matrix(case.parameters(), case.state(), "full") @ v)

    def rate(force: Array) -> float:
        """Time derivative of the angular momentum without a knife edge, hence without outer moments."""
        matrix, h = reference(SKIER)
        a, step = np.linalg.solve(matrix, force - h), 1e-4
        ends = [
            angular_momentum(SKIER.q + side * step * SKIER.v + step**2 / 2 * a, SKIER.v + side * step * a)
            for side in (1, -1)
        ]
        return (ends[0] - ends[1]) / (2 * step)

    assert rate(moment * np.array([0, 0, -1, 1, 0, 0, 0])) == pytest.approx(0, abs=1e-4)
    assert rate(moment * np.array([0, 0, 0, 1, 0, 0, 0])) == pytest.approx(moment, abs=1e-4)
    matrix, h = reference_form(SKIER, "chaplygin")
    assert np.linalg.solve(matrix, -h)[1] == pytest.approx(0, abs=1e-12)  # as printed, without moments
    assert cf.eq_7_8(*unpack(SKIER), SKIER.a[1:]) == pytest.approx(chaplygin_row("phi0"), rel=1e-12)


def rod_top_forces(force: Array) -> Array:
    """Generalized forces of a force at D on (x, y, phi1, psi1, xi11, xi12), by differences of its position."""
    rod = SKIER.parameters().rod_length[0]

    def top(q: Array) -> Array:
        x, y, phi, psi, lower, _ = q
        d = np.array([np.cos(phi) * np.cos(psi), np.sin(phi) * np.cos(psi), np.sin(psi)])
        position: Array = np.array([x, y, 0]) + (lower + rod) * d
        return position

    q, h = np.delete(SKIER.q, 2), 1e-6
    return np.array([(top(q + h * e) - top(q - h * e)) @ force / (2 * h) for e in np.eye(6)])


def test_forces_at_the_rod_top() -> None:
    p, s = unpack(SKIER)
    rx, ry, rz = force = np.array([1.3, -0.8, 2.1])
    arm, tan = s.xi[0, 0] + p.rod_length[0], np.tan(s.phi0)
    c, sp, cos, sin = np.cos(s.psi[0]), np.sin(s.psi[0]), np.cos(s.phi[0]), np.sin(s.phi[0])
    derived = rod_top_forces(force)
    along = rx * cos * c + ry * sin * c + rz * sp
    correct = [arm * c * (-rx * sin + ry * cos), arm * (-(rx * cos + ry * sin) * sp + rz * c), along, 0]
    np.testing.assert_allclose(derived[2:], correct, atol=1e-8)
    assert derived[0] + tan * derived[1] == pytest.approx(rx + ry * tan)  # (7.7)
    assert abs(arm * (rx * sin + ry * cos) - derived[2]) > 1e-2  # (7.9)
    for one, other in itertools.product(force, repeat=2):  # (7.10), any indices
        assert abs(arm * (one * sp + other * c) - derived[3]) > 1e-2
    assert abs(derived[4]) > 1e-2  # (7.11) prints nothing


def test_7_10() -> None:
    p, s = unpack(SKIER)
    vartheta = p.tip_mass[0] * (s.xi[0].sum() + p.rod_length[0])
    correct = cf.eq_7_10(p, s, SKIER.a[1:])
    assert_erratum(correct - p.gravity * vartheta * np.cos(s.psi[0]), correct, chaplygin_row("psi1"))


def test_7_11() -> None:
    p, s = unpack(SKIER)
    correct = cf.eq_7_11(p, s, SKIER.a[1:])
    assert_erratum(correct - p.gravity * p.tip_mass[0] * np.sin(s.psi[0]), correct, chaplygin_row("xi1_1"))


def test_form_4_1() -> None:
    still, moving = SKIER.v.copy(), SKIER.v.copy()
    still[[0, 2]] = moving[[0]] = 0.0
    cases = [dataclasses.replace(SKIER, v=v) for v in (SKIER.v, moving, still)]
    both, turning, neither = (reference_form(case, "chaplygin")[1] for case in cases)
    np.testing.assert_allclose(turning, neither, atol=1e-12)  # phi0_dot alone does nothing
    extra = (both - neither) / (SKIER.v[0] * SKIER.v[2])
    assert np.abs(extra[[0, 2, 3, 4, 5]]).min() > 1e-3  # each row of (7.7), (7.9)-(7.12)
    blocks = cf.equation_blocks(*unpack(SKIER), "chaplygin")
    rows = ("x", "phi0", "phi", "psi", "xi1", "xi2")
    stated = np.concatenate([np.atleast_1d(blocks["xdot_phi0dot", row]) for row in rows])
    np.testing.assert_allclose(stated, extra, rtol=1e-11, atol=1e-11)


def long_skier_matrix(case: Case = LONG_SKIER) -> Array:
    """Derived mass matrix of (x, phi_0, phi_1, ..., phi_n)."""
    rows = [0, 1, *range(2, 2 + 4 * case.n, 4)]
    return reference_form(case, "chaplygin")[0][np.ix_(rows, rows)]


def test_7_13() -> None:
    p, s = unpack(LONG_SKIER)
    derived = long_skier_matrix()
    assert derived.shape == (LONG_SKIER.n + 2, LONG_SKIER.n + 2)  # printed: n
    assert mismatch(cf.eq_7_13(p, s), derived) < 1e-12
    pattern = np.abs(derived) > 1e-9
    expected = np.ones_like(pattern)
    expected[1, :] = expected[:, 1] = False
    expected[1, 1] = True
    np.testing.assert_array_equal(pattern, expected)
    elsewhere = LONG_SKIER.q.copy()
    elsewhere[0] += 2.0
    np.testing.assert_array_equal(long_skier_matrix(dataclasses.replace(LONG_SKIER, q=elsewhere)), derived)


def test_7_14() -> None:
    p, s = unpack(LONG_SKIER)
    derived, correct = long_skier_matrix(), cf.eq_7_14(p, s)
    masses, m_b, sec2 = p.ski_mass + p.rod_mass.sum(), p.tip_mass[-1], 1 / np.cos(s.phi0) ** 2
    many = masses + (p.n + 1) * m_b
    for printed in (many, many * sec2, masses + m_b):
        assert_erratum(printed, correct[0], derived[0, 0])
    assert_erratum(1.0, correct[1], derived[1, 1])


def test_7_15() -> None:
    derived, correct = long_skier_matrix(), cf.eq_7_15(*unpack(LONG_SKIER))
    printed = correct.copy()
    printed[LONG_SKIER.n - 2 :] = 0.0  # j = 3..n leaves the last two out
    assert_erratum(printed, correct, derived[0, 2:])


@pytest.mark.parametrize("fault", ["no length", "next mass", "next rod"])
def test_7_16(fault: str) -> None:
    p, s = unpack(LONG_SKIER)
    m, rod, lower, upper, m_b = p.rod_mass, p.rod_length, s.xi[:, 0], s.xi[:, 1], p.tip_mass[-1]
    length, both = rod + lower + upper, lower + upper
    after, next_rod = np.array([m[1] + m[2], m[2], 0.0]), rod
    if fault == "next mass":
        after = np.array([m[1], m[2], 0.0])
    if fault == "next rod":
        next_rod = np.array([rod[1], rod[2], 0.0])
    zeta = m * rod**2 / 3 + m * lower * (rod + lower) + m_b * (rod + both) ** 2
    zeta += (next_rod * (2 * both + rod) + both**2) * after
    first = m * (lower + rod / 2) + length * after + m_b * length
    half = np.triu(np.outer(np.ones(3) if fault == "no length" else length, first), 1)
    printed = (np.diag(zeta) + half + half.T) * np.cos(s.phi[:, None] - s.phi)
    printed *= np.outer(np.cos(s.psi), np.cos(s.psi))
    assert_erratum(printed, cf.eq_7_16(p, s), long_skier_matrix()[2:, 2:])


def standing(n: int, tips: str) -> Case:
    """Skier at rest, all links vertical."""
    case = make_case(n, True, seed=56, tips=tips, uniform=True)
    case.q[4::4] = np.pi / 2
    case.v[:] = 0.0
    return case


def test_upper_length_is_not_held() -> None:
    p, s = unpack(standing(1, "all"))
    keep = [0, 1, 3, 4, 5]  # without the azimuth, which is undefined here
    matrix, h = cf.mass_matrix(p, s, "chaplygin")[np.ix_(keep, keep)], cf.bias(p, s, "chaplygin")[keep]
    carried = p.gravity * (p.rod_mass[0] + p.tip_mass[0])
    a = np.linalg.solve(matrix, np.array([0, 0, 0, carried, 0.0]) - h)
    assert a[3] + a[4] == pytest.approx(-p.gravity)  # m_B falls freely although F_11 carries all of the weight


@pytest.mark.parametrize("n", [1, 2, 3])
def test_vertical_links(n: int) -> None:
    case = standing(n, "all")
    assert np.linalg.matrix_rank(reference(case)[0], tol=1e-9) == 4 * n + 3 - n
    assert np.linalg.matrix_rank(cf.mass_matrix(*unpack(case), "full"), tol=1e-9) == 4 * n + 3 - n


@pytest.mark.parametrize("n", [2, 3])
def test_straight_legs(n: int) -> None:
    case = make_case(n, True, seed=57, tips="last", uniform=True)
    case.q[3::4], case.q[4::4] = 0.4, 0.9
    assert np.linalg.matrix_rank(reference(case)[0], tol=1e-9) == 4 * n + 3 - (n - 1)
    cured = make_case(n, True, seed=57, tips="all", uniform=True)
    cured.q[3::4], cured.q[4::4] = 0.4, 0.9
    assert np.linalg.matrix_rank(cf.mass_matrix(*unpack(cured), "full"), tol=1e-9) == 4 * n + 3


def test_8_2_at_the_vertical() -> None:
    responses = []
    for psi in (np.pi / 2, 1.0):
        case = standing(1, "all")
        case.q[4] = psi
        p, s = unpack(case)
        keep = [0, 1, 3, 4, 5]  # without the azimuth, which is undefined at the vertical
        matrix = cf.mass_matrix(p, s, "chaplygin")[np.ix_(keep, keep)]
        a = np.linalg.solve(matrix, [0, 0, 1.0, 0, 0])  # a moment M_1psi
        responses.append((s.xi[0, 0] + p.rod_length[0]) * np.cos(psi) * a[2] + np.sin(psi) * a[3])
    assert abs(responses[0]) < 1e-12
    assert abs(responses[1]) > 1e-2


def test_the_page_names_these_tests() -> None:
    page = (ROOT / "docs" / "errata.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(test_\w+)`", page))
    here = {name for name in globals() if name.startswith("test_") and "_the_page" not in name}
    assert named == here


def test_the_links_of_the_page_lead_somewhere() -> None:
    page = (ROOT / "docs" / "errata.md").read_text(encoding="utf-8")
    headings = re.findall(r"^#+ (.*)$", page, flags=re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    links = re.findall(r"\]\(#([^)]*)\)", page)
    assert len(links) > 15
    assert set(links) <= anchors
