"""Rows of equations in the core against today's engine: residual, rate, drift and row."""

from __future__ import annotations

import numpy as np
import pytest

from tests.core.against_today import Vocabulary, forms, make_state, make_tree
from vlmb.core import opcodes as op
from vlmb.core import rows, tape
from vlmb.core.opcodes import make_buffers
from vlmb.core.quantities import ELEVATION, add_accelerations, measure_these
from vlmb.model.coordinates import make_state as pinocchio_state
from vlmb.model.mechanism import build
from vlmb.model.tape import compile_tape
from vlmb.scene.expressions import parse, parse_equation
from vlmb.scene.rows import rows_of
from vlmb.scene.scene import load_scene
from vlmb.system.constraints import ConstraintSet
from vlmb.system.frames import LinkFrames

MORE = [
    "phi1 - phi0 = 0.2*t", "psi1_dot = -speed*abs(x_dot) + t", "xi1_1*xi1_2_dot**2 = min(legs.tip.x, y) + atan2(y, x)",
    "legs.rod_end.z**-2 + sqrt(2 + sin(legs.tip.y)) = legs.length/exp(psi1/3)", "phi1_dot*psi1_dot = phi0_dot",
]  # fmt: skip


@pytest.mark.parametrize("name", ["skier_slalom", "skier_slalom_whole_body", "more"])
def test_rows_agree_with_todays_engine(name: str) -> None:
    scene = load_scene(f"models/{'skier_slalom' if name == 'more' else name}.toml")
    texts = MORE if name == "more" else [row.equation for row in rows_of(scene).servo]
    mechanism = build(scene)
    rng, layout = np.random.default_rng(1), mechanism.layout
    coordinates = {n: float(scene.start.get(n, 0.3)) + rng.normal(0.0, 0.2) for n in layout.names}
    state = pinocchio_state(layout, coordinates, {f"{n}_dot": rng.normal() for n in layout.names})
    q, v, near = state.q, state.v.copy(), np.array([coordinates[n] for n in layout.names])
    v[1] = 0.3
    frames = LinkFrames(mechanism)
    todays = ConstraintSet(mechanism, [(text, f"row {k}", False) for k, text in enumerate(texts)])
    frames.update(q)
    old = todays.evaluate(frames, 0.7, q, v, near)

    shape, given = make_tree(mechanism)
    vocabulary = Vocabulary(mechanism)
    compiled = compile_tape([parse_equation(text) for text in texts], vocabulary)
    table = vocabulary.table(shape)
    now = make_state(mechanism, shape, q, v)
    parameters = np.array(list(scene.parameters.values()))
    out, matrix = np.zeros((len(texts), 3)), np.zeros((len(texts), len(now.v)))
    buffers, measured = make_buffers(compiled.tape), np.zeros((len(vocabulary.known), 3))
    tape.prepare(compiled.tape, buffers, parameters)
    reference = vocabulary.reference(coordinates)
    assert measure_these(table, compiled.tape.used, shape, now.y, given, reference, measured) == 0
    tape.read_leaves(compiled.tape, 0.7, parameters, measured, buffers.slots)
    tape.play_jets(compiled.tape, buffers, compiled.tape.parts[op.PARAMETERS_END], compiled.tape.parts[op.ROOTS_END])
    for r, form in enumerate(forms(compiled)):
        rows.write_residual(compiled.tape, buffers, r, form, r, out)
        assert rows.write_row(compiled.tape, buffers, table, shape, r, now.y, given, reference, matrix[r]) == 0
    assert np.isfinite(out).all()
    scale = 1.0 + np.abs(old.drift)
    np.testing.assert_allclose(out[:, 0], old.z, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(out[:, 1], old.rate, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(matrix @ now.change, old.jacobian, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose((out[:, 2] + matrix @ now.drift) / scale, old.drift / scale, rtol=1e-12, atol=1e-12)
    assert [row.position for row in compiled.rows] == [info.holonomic for info in todays.info]
    assert [row.angle for row in compiled.rows] == [info.angle for info in todays.info]
    assert [row.working for row in compiled.rows] == [info.working for info in todays.info]


def test_laws_and_switches_see_the_state() -> None:
    scene = load_scene("models/skier_slalom.toml")
    mechanism = build(scene)
    layout, rng = mechanism.layout, np.random.default_rng(4)
    coordinates = {n: rng.uniform(0.2, 0.6) for n in layout.names}
    state = pinocchio_state(layout, coordinates, {f"{n}_dot": rng.normal() for n in layout.names})
    shape, given = make_tree(mechanism)
    vocabulary = Vocabulary(mechanism)
    compiled = compile_tape(
        [parse("-100*psi1 - 20*psi1_dot"), parse("-0.2*speed*abs(speed) + step(legs.tip.z - t)"), parse("min(psi1_dot, A)")],
        vocabulary,
    )
    table, now = vocabulary.table(shape), make_state(mechanism, shape, state.q, state.v)
    parameters, out, count = np.array(list(scene.parameters.values())), np.zeros(3), len(vocabulary.known)
    buffers, measured, near = make_buffers(compiled.tape), np.zeros((count, 3)), vocabulary.reference(coordinates)
    tape.prepare(compiled.tape, buffers, parameters)
    assert measure_these(table, compiled.tape.used, shape, now.y, given, near, measured) == 0
    tape.read_leaves(compiled.tape, 0.7, parameters, measured, buffers.slots)
    assert tape.values(compiled.tape, buffers, out) == 0
    speed, psi, psi_rate = now.v[0], coordinates["psi1"], measured[list(vocabulary.known).index(((ELEVATION, 0, 0, 0), 0.0)), 1]
    height = mechanism.position(state, "legs", "tip")[2]
    wanted = [-100 * psi - 20 * psi_rate, -0.2 * speed * abs(speed) + float(height >= 0.7), min(psi_rate, parameters[0])]
    np.testing.assert_allclose(out, wanted, rtol=1e-13)

    change = rng.normal(size=len(now.v))
    row, found = np.zeros(len(now.v)), np.zeros((len(compiled.tape.switch), 2))
    assert add_accelerations(table, compiled.tape.used, shape, now.y, given, near, change, row, measured) == 0
    rows.evaluate_switches(compiled.tape, buffers, 0.7, parameters, measured, found)
    arguments_of = {compiled.source(int(k)): found[n] for n, k in enumerate(compiled.tape.switch[:, 1])}
    np.testing.assert_allclose(arguments_of["abs(speed)"], [speed, change[0]], rtol=1e-13)
    assert arguments_of["step(legs.tip.z - t)"][0] == pytest.approx(height - 0.7, rel=1e-13)
    assert arguments_of["min(psi1_dot, A)"][0] == pytest.approx(psi_rate - parameters[0], rel=1e-13)
