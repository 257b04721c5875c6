"""Equations of motion of links on anchors and anywhere along rods: those of mass points, in every form and block by block."""

from __future__ import annotations

import math

import numpy as np
import pytest

import vlmb
from tests.anchored import anchored
from tests.equations.test_equations import FORMS, assert_close, from_blocks
from tests.reference.equation_cases import random_posture, random_rates
from tests.reference.particles import Particles


@pytest.mark.parametrize("plane", [False, True])
@pytest.mark.parametrize("base", ["pivot", "ski"])
def test_equations_are_those_of_mass_points(base: str, plane: bool) -> None:
    table = anchored(base, plane=plane, gravity=3.7)
    mechanism, particles = vlmb.build(table), Particles(table)
    assert mechanism.coordinate_names == particles.names
    rng = np.random.default_rng(21)
    for _ in range(3):
        coordinates, rates = random_posture(mechanism, rng), random_rates(mechanism, rng)
        matrix, bias = particles.equations(coordinates, rates)
        eom = vlmb.equations_of_motion(mechanism, coordinates, rates)
        assert_close(eom.mass_matrix, matrix)
        assert_close(eom.bias, bias)


@pytest.mark.parametrize("plane", [False, True])
@pytest.mark.parametrize("form", FORMS["ski"])
def test_the_ski_turns_every_link_in_every_form(form: str, plane: bool) -> None:
    """x = B u, x'' = B u' + b: the form's equations are B^T (M B u' + M b + bias), and its blocks have every term of them."""
    table = anchored("ski", plane=plane, gravity=3.7)
    mechanism, particles = vlmb.build(table), Particles(table)
    rng = np.random.default_rng(22)
    coordinates = random_posture(mechanism, rng)
    rates = random_rates(mechanism, rng, coordinates)
    matrix, bias = particles.equations(coordinates, rates)
    basis, bend = np.eye(len(bias)), np.zeros(len(bias))
    c, s, turn = math.cos(coordinates["phi0"]), math.sin(coordinates["phi0"]), rates["phi0_dot"]
    if form != "full":
        basis = np.delete(basis, 1, axis=1)
    if form == "chaplygin":
        basis[1, 0], bend[1] = s / c, rates["x_dot"] * turn / c**2
    elif form == "speed":
        speed = c * rates["x_dot"] + s * rates["y_dot"]
        basis[:2, 0], bend[:2] = (c, s), (-s * speed * turn, c * speed * turn)
    eom = vlmb.equations_of_motion(mechanism, coordinates, rates, form)
    assert_close(eom.mass_matrix, basis.T @ matrix @ basis)
    assert_close(eom.bias, basis.T @ (bias + matrix @ bend))
    heading = eom.names.index("phi0")
    assert (np.abs(eom.mass_matrix[heading, heading + 1 :]) > 1e-3).sum() > len(mechanism.layout.links)
    put_together = from_blocks(eom)
    assert_close(put_together[0], eom.mass_matrix, 1e-14)
    assert_close(put_together[1], eom.bias, 1e-13)
