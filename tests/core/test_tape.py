"""The equation tape: values, jets and gradients against mpmath and sympy; switches, domains, bounds, parameters."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time

import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.core.expressions_exact import NAMES, TEXTS, Played, jet_of_branch, jets_of, pruned, slope
from vlmb.core import opcodes, tape
from vlmb.errors import ExpressionError
from vlmb.model.forms import show
from vlmb.model.tape import Leaf, compile_tape
from vlmb.scene.expressions import evaluate, parse, parse_equation


@pytest.mark.parametrize("script", ["expressions_exact", "motions", "springs_exact"])
def test_with_fifty_digits(script: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", f"tests.core.{script}"],
        env=os.environ | {"VLMB_JIT": "0"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "fine\n" and done.returncode == 0, done.stdout + done.stderr


def check(texts: list[str], numbers: list[float], close: float = 1e-9) -> None:
    """Compare jets and gradients of all with mpmath's."""
    t, parameters, measured = numbers[0], numbers[1:3], np.array(numbers[3:12]).reshape(3, 3).tolist()
    played = Played(texts, float)
    out, slopes = played(t, parameters, measured)
    if (np.abs(played.buffers.slots[played.tape.switch[:, 0], 0]) < 1e-9).any():
        return  # at a switch the witness means the middle of both sides
    jets = jets_of(t, parameters, measured)
    with mpmath.workdps(40):
        exact = {name: tuple(mpmath.mpf(number) for number in jet) for name, jet in jets.items()}
        for r, text in enumerate(texts):
            tree = parse(text).tree
            try:
                wanted = jet_of_branch(tree, exact)
            except (ZeroDivisionError, ValueError, TypeError):  # no value, or not real
                continue
            if any(isinstance(number, mpmath.mpc) for number in wanted) or max(abs(number) for number in wanted) > 1e12:
                continue
            scale = 1.0 + max(abs(number) for number in wanted)
            assert max(abs(a - b) for a, b in zip(out[r], wanted, strict=True)) / scale < close, (text, out[r], wanted)
            for k, name in enumerate(played.compiled.names):
                if name in parse(text).names:
                    assert abs(slopes[r, k] - slope(pruned(tree, exact), exact, name)) / scale < 1e4 * close, (text, name)


def test_every_operation_compiled() -> None:
    check(TEXTS, [0.7, 1.3, 0.36, 1.1, 0.4, -0.7, 2.3, -1.2, 0.5, 0.6, 2.1, 1.7], 1e-12)
    codes = {int(code) for code in Played(TEXTS, float).compiled.tape.code[:, 0]}
    assert codes == set(range(opcodes.STEP + 1)), "an operation is not tried"


def grown(children: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    one = st.sampled_from(["sin", "cos", "atan", "exp", "abs", "sign", "step"])
    return st.one_of(
        st.tuples(children, st.sampled_from("+-*/"), children).map(lambda p: f"({p[0]} {p[1]} {p[2]})"),
        st.tuples(one, children).map(lambda p: f"{p[0]}({p[1]})"),
        st.tuples(children, st.sampled_from(["2", "3", "-1", "0.5", "-2"])).map(lambda p: f"({p[0]})**{p[1]}"),
        st.tuples(st.sampled_from(["min", "max", "atan2"]), children, children).map(lambda p: f"{p[0]}({p[1]}, {p[2]})"),
        st.tuples(children, st.sampled_from(["<", "<=", ">", ">="]), children, children, children).map(
            lambda p: f"where({p[0]} {p[1]} {p[2]}, {p[3]}, {p[4]})"
        ),
    )


names = st.sampled_from([*NAMES, "2", "0.7"])
small = st.floats(-3.0, 3.0).map(lambda x: round(x, 3) + 0.0137)  # off the switches at round numbers


@settings(max_examples=60, deadline=None)
@given(st.recursive(names, grown, max_leaves=10), st.lists(small, min_size=12, max_size=12))
def test_random_expressions(text: str, numbers: list[float]) -> None:
    try:
        parse(text)
        check([text], [numbers[0], 1.3, 0.36, *numbers[3:]])  # no ties of parameters: they are no switches
    except (ExpressionError, OverflowError):
        pass


@settings(max_examples=25, deadline=None)
@given(st.recursive(st.sampled_from(["x", "y", "t", "3"]), lambda c: st.one_of(
    st.tuples(c, st.sampled_from("+-*"), c).map(lambda p: f"({p[0]} {p[1]} {p[2]})"), c.map(lambda p: f"sin({p})"),
    c.map(lambda p: f"(1 + ({p})**2)**-1"), c.map(lambda p: f"exp(-({p})**2)")), max_leaves=8))  # fmt: skip
def test_derivatives_of_sympy(text: str) -> None:
    x, y, t = sympy.symbols("x y t", real=True)
    formula = sympy.sympify(text, locals={"x": x, "y": y, "t": t})
    jet = {"x": (0.3, 0.7, -0.4), "y": (-0.8, 0.2, 0.9), "t": (0.5, 1.0, 0.0)}
    s = sympy.Symbol("s")
    along = formula.subs(
        {n: a + b * s + c * s**2 / 2 for n, (a, b, c) in zip((x, y, t), jet.values(), strict=True)}, simultaneous=True
    )
    wanted = [float(sympy.diff(along, s, order).subs(s, 0)) for order in range(3)]
    out, _ = Played([text], float)(0.5, [0.0, 0.0], [list(jet["x"]), list(jet["y"]), [0.0] * 3])
    np.testing.assert_allclose(out[0], wanted, rtol=1e-11, atol=1e-11)


def played_at(text: str, **values: float) -> np.ndarray:
    measured = [[values.get(name, 0.0), 1.0, 0.0] for name in "xyz"]
    return Played([text], float)(values.get("t", 0.0), [values.get("A", 0.0), 0.0], measured)[0][0]


@pytest.mark.parametrize(
    "text, wanted",
    [("abs(x)", [0, 1, 0]), ("sign(x)", [0, 0, 0]), ("step(x)", [1, 0, 0]), ("min(x, 2*x)", [0, 1, 0]),
     ("max(2*x, x)", [0, 2, 0]),
     ("where(x < 0, 5, x)", [0, 1, 0]), ("where(x <= 0, 5*x, x)", [0, 5, 0]), ("where(x > 0, 5, -x)", [0, -1, 0]),
     ("where(x >= 0, 7*x, 1)", [0, 7, 0]), ("x**3", [0, 0, 0]), ("x**4", [0, 0, 0]), ("x**2.5", [0, 0, 0])],
)  # fmt: skip
def test_sides_at_switches(text: str, wanted: list[float]) -> None:
    np.testing.assert_array_equal(played_at(text, x=0.0), wanted)


@pytest.mark.parametrize(
    "text, failing",
    [("1 + log(x - 3)", "log(x - 3)"), ("sqrt(x)*2", "sqrt(x)"), ("y/(x + 1)", "y/(x + 1)"), ("asin(x - 2) + y", "asin(x - 2)"),
     ("exp(1000*y)*x", "exp(1000*y)"), ("(x + 1)**-2", "(x + 1)**-2"), ("x**1.5 + y", "x**1.5"), ("min(log(x), y)", "log(x)"),
     ("where(y < 0, 1, log(x))", "log(x)"), ("2/(1 + x)", "2/(1 + x)"), ("atan2(y - 2, x + 1)", "atan2(y - 2, x + 1)")],
)  # fmt: skip
def test_the_failing_operation_is_named(text: str, failing: str) -> None:
    played = Played([text], float)
    out, _ = played(0.0, [0.0, 0.0], [[-1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    assert not np.isfinite(out).all()
    found = tape.failing_operation(played.tape, played.buffers, 0, 2)
    assert played.compiled.source(found) == failing


def test_where_takes_nothing_from_the_other_side() -> None:
    np.testing.assert_allclose(played_at("where(x < 1, x**2, sqrt(x - 1))", x=0.5), [0.25, 1.0, 2.0])
    assert evaluate(parse("where(x < 1, x**2, sqrt(x - 1))"), {"x": 0.5}) == 0.25
    assert math.isnan(played_at("where(log(x) < 1, 1, 2)", x=-1.0)[0])


def test_parameters_change_without_compiling_and_are_played_apart() -> None:
    played = Played(["A*k**2*sin(k*x)", "x*A*k + 3*t*A"], float)
    parts = played.tape.parts
    assert parts[opcodes.PARAMETERS_END] == 3 and parts[opcodes.TIME_END] - parts[opcodes.PARAMETERS_END] == 2
    for a in (1.0, 2.5):
        out, _ = played(0.5, [a, 0.4], [[1.1, 0.3, 0.2], [0, 0, 0], [0, 0, 0]])
        np.testing.assert_allclose(out[:, 0], [a * 0.16 * math.sin(0.44), 1.1 * a * 0.4 + 1.5 * a], rtol=1e-14)


def test_shared_and_bounded() -> None:
    begin = time.perf_counter()
    made = compile_tape(
        [parse_equation("(phi1+psi1+xi1_1+t)**64 = 1"), parse("sin(xi1_1 + phi1) + sin(phi1 + xi1_1)")], angle_or_length
    )
    assert time.perf_counter() - begin < 0.05
    assert len(made.tape.code) == 3 + 1 + 1 + 3
    with pytest.raises(ExpressionError, match="at most 2000"):
        compile_tape([parse("t")] * 2001, angle_or_length)
    long = [parse("+".join(f"sin({k + 25 * n}*t)" for k in range(25))) for n in range(1250)]
    with pytest.raises(ExpressionError, match="more than 50000 operations"):
        compile_tape(long, angle_or_length)
    with pytest.raises(ExpressionError, match="division by 0"):
        compile_tape([parse("t/0")], angle_or_length)


def angle_or_length(name: str) -> Leaf:
    if name == "t":
        return Leaf(opcodes.TIME)
    if name in ("A", "k"):
        return Leaf(opcodes.PARAMETER, "Ak".index(name))
    plain = name.removesuffix("_dot")
    at = ["phi0", "phi1", "psi1", "xi1_1", "speed"].index(plain)
    return Leaf(opcodes.VALUE if plain == name and name != "speed" else opcodes.RATE, at, at < 3)


@pytest.mark.parametrize(
    "text, position, angle, working, linear",
    [("phi1 = phi0", True, True, False, []), ("phi1 - psi1 = A*t", True, True, True, []),
     ("2*phi1 = phi0", True, False, False, []),
     ("2*phi1 - phi1 = 0.3", True, True, False, []), ("phi1 = xi1_1", True, False, False, []),
     ("sin(phi1) = 0", True, False, False, []),
     ("phi0_dot = 0.2*speed", False, False, False, ["phi0_dot", "speed"]), ("phi0_dot = 0.2", False, False, True, ["phi0_dot"]),
     ("phi0_dot*speed = phi1", False, False, True, []), ("abs(speed) = phi0_dot", False, False, True, ["phi0_dot"]),
     ("speed*sin(phi1)/A + t*phi0_dot = 0", False, False, False, ["speed", "phi0_dot"]),
     ("speed**2/phi0_dot = 0", False, False, True, []),
     ("where(phi1 < 0, speed, 2*speed) = 0", False, False, False, ["speed"]), ("A = t", True, False, True, [])],
)  # fmt: skip
def test_what_a_row_is(text: str, position: bool, angle: bool, working: bool, linear: list[str]) -> None:
    made = compile_tape([parse_equation(text)], angle_or_length)
    row = made.rows[0]
    assert (row.position, row.angle, row.working) == (position, angle, working)
    assert {made.names[k] for k in row.linear} == set(linear)
    assert row.moves == (text != "A = t")


@pytest.mark.parametrize("text", [*TEXTS, "-(x + y)*-z", "x - (y - z)", "x/(y*z)", "(-x)**2", "-x**2", "x - -y"])
def test_texts_of_trees_mean_the_same(text: str) -> None:
    values = {name: 0.3 + 0.4 * k for k, name in enumerate(NAMES)} | {"x": -0.7}
    shown = show(parse(text).tree)
    try:
        wanted = evaluate(parse(text), values)
    except ExpressionError:
        return
    assert evaluate(parse(shown), values) == pytest.approx(wanted, rel=1e-12)
