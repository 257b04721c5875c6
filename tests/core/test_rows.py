"""Rows of equations in the core against today's engine: residual, rate, drift and row."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from against_today import Vocabulary, forms, make_state, make_tree

from vlmb.constraints import Rows
from vlmb.coordinates import make_state as pinocchio_state
from vlmb.core import rows, tape
from vlmb.core.opcodes import make_buffers
from vlmb.expressions import parse_equation
from vlmb.frames import LinkFrames
from vlmb.mechanism import build
from vlmb.model_tape import compile_tape
from vlmb.scene import load_scene

MORE = [
    "phi1 - phi0 = 0.2*t", "psi1_dot = -speed*abs(x_dot) + t", "xi1_1*xi1_2_dot**2 = min(legs.tip.x, y) + atan2(y, x)",
    "legs.rod_end.z**-2 + sqrt(2 + sin(legs.tip.y)) = legs.length/exp(psi1/3)", "phi1_dot*psi1_dot = phi0_dot",
]  # fmt: skip


@pytest.mark.parametrize("name", ["skier_slalom", "skier_slalom_whole_body", "more"])
def test_rows_agree_with_todays_engine(name: str) -> None:
    scene = load_scene(f"models/{'skier_slalom' if name == 'more' else name}.toml")
    texts = MORE if name == "more" else list(scene.programme.constraints)
    mechanism = build(scene)
    rng, layout = np.random.default_rng(1), mechanism.layout
    coordinates = {n: float(scene.start.get(n, 0.3)) + rng.normal(0.0, 0.2) for n in layout.names}
    state = pinocchio_state(layout, coordinates, {f"{n}_dot": rng.normal() for n in layout.names})
    q, v, near = state.q, state.v.copy(), np.array([coordinates[n] for n in layout.names])
    v[1] = 0.3
    frames = LinkFrames(mechanism)
    todays = Rows(mechanism, frames, [(text, f"row {k}", False) for k, text in enumerate(texts)])
    pin.crba(mechanism.model, mechanism.data, q, pin.Convention.WORLD)
    old = todays.evaluate(0.7, q, v, near)

    shape, given = make_tree(mechanism)
    vocabulary = Vocabulary(mechanism)
    compiled = compile_tape([parse_equation(text) for text in texts], vocabulary)
    table = vocabulary.table(shape)
    now = make_state(mechanism, shape, q, v)
    parameters = np.array(list(scene.parameters.values()))
    out, matrix = np.zeros((len(texts), 3)), np.zeros((len(texts), len(now.v)))
    buffers, measured = make_buffers(compiled.tape), np.zeros((len(vocabulary.known), 3))
    tape.prepare(compiled.tape, buffers, parameters)
    found = rows.evaluate_rows(
        compiled.tape, buffers, table, shape, forms(compiled), 0.7, now.y, given, vocabulary.reference(coordinates), parameters,
        np.zeros((0, 3)), measured, out, matrix,
    )  # fmt: skip
    assert found == (0, 0)
    scale = 1.0 + np.abs(old.drift)
    np.testing.assert_allclose(out[:, 0], old.z, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(out[:, 1], old.rate, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(matrix @ now.change, old.jacobian, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose((out[:, 2] + matrix @ now.drift) / scale, old.drift / scale, rtol=1e-12, atol=1e-12)
    assert [row.position for row in compiled.rows] == [info.holonomic for info in todays.info]
    assert [row.angle for row in compiled.rows] == [info.angle for info in todays.info]
    assert [row.working for row in compiled.rows] == [info.working for info in todays.info]
