"""Print what playing a tape and evaluating rows cost: a script, not a test."""

from __future__ import annotations

import sys
import time

import numpy as np
from against_today import Vocabulary, forms, make_state, make_tree

from vlmb.coordinates import make_state as pinocchio_state
from vlmb.core import rows, tape
from vlmb.core.jit import kernel
from vlmb.core.opcodes import LEAVES, PARAMETERS_END, ROOTS_END, make_buffers
from vlmb.core.quantities import measure_these
from vlmb.expressions import parse_equation
from vlmb.mechanism import build
from vlmb.model_tape import compile_tape
from vlmb.scene import load_scene


@kernel
def many_jets(compiled, buffers, count):
    for _ in range(count):
        tape.play_jets(compiled, buffers, compiled.parts[PARAMETERS_END], compiled.parts[ROOTS_END])


@kernel
def many_values(compiled, buffers, count):
    for _ in range(count):
        tape.play_values(compiled, buffers, compiled.parts[PARAMETERS_END], compiled.parts[ROOTS_END])


@kernel
def many_gradients(compiled, buffers, count):
    for _ in range(count):
        for r in range(compiled.root.shape[0]):
            tape.gradient(compiled, buffers, r, False)


@kernel
def many_measures(table, these, shape, y, given, near, measured, count):
    for _ in range(count):
        measure_these(table, these, shape, y, given, near, measured)


@kernel
def many_rows(compiled, buffers, table, shape, form, y, given, near, parameters, signals, measured, out, matrix, count):
    for _ in range(count):
        rows.evaluate_rows(compiled, buffers, table, shape, form, 0.7, y, given, near, parameters, signals, measured, out, matrix)


def timed(function, *arguments, count=1000):
    function(*arguments, 1)
    best = np.inf
    for _ in range(200):
        begin = time.perf_counter()
        function(*arguments, count)
        best = min(best, time.perf_counter() - begin)
    return best / count * 1e9


for name in sys.argv[1:] or ("skier_slalom", "skier_slalom_whole_body"):
    scene = load_scene(f"models/{name}.toml")
    mechanism = build(scene)
    coordinates = {n: float(scene.start.get(n, 0.3)) for n in mechanism.layout.names}
    state = pinocchio_state(mechanism.layout, coordinates, {f"{n}_dot": 0.3 for n in coordinates})
    shape, given = make_tree(mechanism)
    vocabulary = Vocabulary(mechanism)
    begin = time.perf_counter()
    made = compile_tape([parse_equation(text) for text in scene.programme.constraints], vocabulary)
    print(f"{name}: text to tape {1e3 * (time.perf_counter() - begin):.2f} ms")
    compiled, table = made.tape, vocabulary.table(shape)
    now = make_state(mechanism, shape, state.q, state.v)
    parameters, signals = np.array(list(scene.parameters.values())), np.zeros((0, 3))
    out, matrix = np.zeros((len(made.rows), 3)), np.zeros((len(made.rows), len(now.v)))
    buffers, measured, near = make_buffers(compiled), np.zeros((len(vocabulary.known), 3)), vocabulary.reference(coordinates)
    begin = time.process_time()
    tape.prepare(compiled, buffers, parameters)
    print(f"  first prepare {time.process_time() - begin:.2f} s CPU")
    begin = time.process_time()
    arguments = compiled, buffers, table, shape, forms(made), now.y, given, near, parameters, signals, measured, out, matrix
    rows.evaluate_rows(*arguments[:5], 0.7, *arguments[5:])
    print(f"  first evaluate_rows {time.process_time() - begin:.2f} s CPU")
    played = int(compiled.parts[ROOTS_END] - compiled.parts[PARAMETERS_END])
    swept = int((compiled.sweep_ends[:, 1] - compiled.sweep_ends[:, 0]).sum())
    print(f"  {len(made.rows)} rows, {compiled.parts[LEAVES]} leaves, {played} of {len(compiled.code)} operations, {swept} swept")
    total = timed(many_values, compiled, buffers)
    print(f"  values    {total:8.0f} ns, {total / played:5.1f} an operation")
    total = timed(many_jets, compiled, buffers)
    print(f"  jets      {total:8.0f} ns, {total / played:5.1f} an operation")
    total = timed(many_gradients, compiled, buffers)
    print(f"  gradients {total:8.0f} ns, {total / swept:5.1f} an operation")
    total = timed(many_measures, table, compiled.used, shape, now.y, given, near, measured)
    print(f"  quantities{total:8.0f} ns, {total / len(compiled.used):5.1f} each")
    total = timed(many_rows, *arguments)
    print(f"  all rows  {total:8.0f} ns")
