"""Expressions: hostile text is refused, values and derivatives agree with independent evaluation."""

from __future__ import annotations

import dataclasses
import math
import re
import subprocess
import sys
import time

import mpmath
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from vlmb.errors import ExpressionError, SceneError, VlmbError
from vlmb.scene.expressions import FUNCTIONS, evaluate, parse, parse_equation
from vlmb.scene.laws import law_breaks, law_jump, time_law
from vlmb.scene.symbolic import compile_scalar, to_sympy

X, Y = sympy.symbols("x y", real=True)
PYTHON = {**FUNCTIONS, "pi": math.pi, "__builtins__": {}}
MPMATH = {name: getattr(mpmath, name) for name in FUNCTIONS if hasattr(mpmath, name)} | {"abs": abs, "pi": mpmath.pi}

HOSTILE = [
    "", "  ", "2**", ")", "t t", "t.", ".t", "t..x", "2t", "1_0__0", "0777", "1if t else 2",
    "t.__class__", "().__class__", "(1).__class__", "t.__class__.__mro__[1]", "__builtins__", "_t", "legs._tip",
    "__import__('os').system('true')", "exec('1')", "eval('1')", "open('x')", "getattr(t, 'x')", "sin.__globals__",
    "lambda: 1", "(lambda t: t)(1)", "lambda*2", "[t for t in t]", "{t for t in t}", "(t for t in t)", "{1: t}", "[t]",
    "(x := 1)", "t, t", "t[0]", "t[:]", "f'{t}'", "'t'", "b't'", "\"t\"*1000", "...", "None", "True", "not t", "t or 1",
    "t and 1", "t if t else 1", "t < 1", "t == 1", "t = 1", "t != 1", "1 < t < 2", "t in t", "await t", "yield t",
    "sin(x=t)", "sin(*t)", "sin(**t)", "min(t, key=t)", "sin()", "sin(t, t)", "atan2(t)", "atan2(t, t, t)", "min(t)",
    "sin", "sin + 1", "sin(t)(t)", "t(t)", "2(t)", "a.b().c", "sin(t).real", "math.sin(t)", "pow(t, 2)",
    "t % 2", "t // 2", "t @ t", "t ^ 2", "t & 1", "t | 1", "t << 1", "t >> 1", "~t", "1j", "2 + 3j",
    "9**9**9", "9**9**9**9", "2**-9**9", "t**t", "t**65", "t**-65", "t**(1/3)", "t**pi", "t**(2 + 1)", "t**1e9", "t**nan",
    "9**64*9**64*9**64*9**64*9**64*9**64", "((9**64)**64)**64", "exp(1000)", "1e200*1e200", "-1e200/1e-200",
    "1e999", "-1e999", "9"*400, "0x" + "F"*400, "nan", "inf", "-inf", "Infinity", "NaN", "1/0", "0**-1", "(-8)**0.5",
    "log(0)", "log(-1)", "sqrt(-1)", "asin(2)", "acos(-1.5)",
    "("*10_000 + "1" + ")"*10_000, "("*400 + "t" + ")"*400, "-"*999 + "t", "sin("*100 + "t" + ")"*100, "t" * 1001,
    "+".join(["t"] * 400), "t.x"*300, "[" * 400, "t" + ".x"*400, "1 " * 400,
    "t\0", "\0", "t\n#", "t # comment", "t; t", "t\\\n+1", "import os", "t\x1b[2J", "t\u2028+1", "\ufefft",
    "ｔ", "ｓin(t)", "ſin(t)", "ᵗ", "t²", "−t", "t·t", "π", "τ", "t\u200b", "\u202et", "١", "ｅxec(1)", "ＰＩ",
]  # fmt: skip


@pytest.mark.parametrize("allowed", [None, {"t", "x", "legs.tip.x"}], ids=["any name", "some names"])
@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text[:24]))
def test_hostile_text_is_refused_at_once(text: str, allowed: set[str] | None) -> None:
    begin = time.perf_counter()
    with pytest.raises(ExpressionError) as caught:
        parse(text, "forces[0].law", allowed)
    assert time.perf_counter() - begin < 1.0
    message = str(caught.value)
    assert message.startswith("forces[0].law = ")
    assert len(message) < 700 and message.isascii() and message.isprintable()


@pytest.mark.parametrize("value", [True, None, [], {}, b"t", 1j, math.nan, math.inf, -math.inf, 10**400, sympy.Symbol("t")])
def test_other_than_text_and_finite_numbers_is_refused(value: object) -> None:
    with pytest.raises(ExpressionError, match="links"):
        parse(value, "links[0].upper.law")  # type: ignore[arg-type]


def test_nothing_in_the_text_runs(tmp_path) -> None:
    mark = tmp_path / "mark"
    for text in (f"__import__('pathlib').Path({str(mark)!r}).touch()", f"open({str(mark)!r}, 'w')"):
        with pytest.raises(ExpressionError):
            time_law(text, {}, "law")
        with pytest.raises(ExpressionError):
            parse_equation(f"t = {text}")
    assert not mark.exists()


@pytest.mark.parametrize(
    "text",
    ["exp(1e300*log(2*t))", "exp((t+t)**64/t**64*log(t+t))", "((((t+t)**64)**64)**64)**64", "1/(t-t)", "sqrt(-t**2)",
     "sin(exp(1e300*log(2*t))/exp(1e300*log(t)))", "*".join(f"(t + {i})" for i in range(40)), "log(t - t)"],
)  # fmt: skip
def test_constants_that_cancelling_makes_cannot_blow_up(text: str) -> None:
    begin = time.perf_counter()
    with pytest.raises(ExpressionError, match=r"real numbers|factors"):
        to_sympy(parse(text), {"t": sympy.Symbol("t", real=True)})
    assert time.perf_counter() - begin < 5.0


@pytest.mark.parametrize(
    "text, parts",
    [
        ("t ^ 2", ["'t ^ 2'", "a power is **"]),
        ("t == 2", ["'t == 2'", "equality is ="]),
        ("t = 2", ["an expression has no ="]),
        ("t**A", ["exponent", "exp(b*log(a))"]),
        ("lambda*t", ["'lambda' cannot be a name"]),
        ("sine(t)", ["'sine' is not a function", "'sin'"]),
        ("math.cos(t)", ["'math.cos'", "'cos'"]),
        ("cos*t", ["cos is a function", "cos(...)"]),
        ("2(t)", ["multiplication is written *"]),
        ("t[1]", ["'t[1]'", "Subscript", "sin cos tan"]),
        ("atan2(t)", ["'atan2(t)'", "takes 2 argument(s)"]),
        ("max(t)", ["takes 2 or more"]),
        ("t + 'a'", ["\"'a'\"", "str"]),
        ("1/(2 - 2)", ["1.0 / 0.0"]),
        ("t + ｔ", ["\\uff54"]),
        ("", ["found nothing"]),
        ("t" * 2000, ["2000 characters", "at most 1000"]),
        ("phi_1 + t", ["unknown name 'phi_1'", "'phi1'"]),
        ("leg.tip.x", ["unknown name 'leg.tip.x'", "'legs.tip.x'"]),
        ("zzzzzz", ["unknown name 'zzzzzz'", "valid names", "phi1", "pi", "sin"]),
    ],
)
def test_errors_say_what_was_found_and_what_to_do(text: str, parts: list[str]) -> None:
    with pytest.raises(SceneError) as caught:
        parse(text, "forces[2].law", {"t", "A", "phi1", "psi1", "legs.tip.x"})
    for part in ["forces[2].law", *parts]:
        assert part in str(caught.value)


def test_names_are_flat_and_spaces_free() -> None:
    expression = parse(" legs.tip.x +\n\t sin( phi1_dot )*pi*2 ", "key", {"legs.tip.x", "phi1_dot", "unused"})
    assert expression.names == {"legs.tip.x", "phi1_dot"}
    assert expression.text == "legs.tip.x +\n\t sin( phi1_dot )*pi*2"
    assert evaluate(expression, {"legs.tip.x": 1.5, "phi1_dot": 0.25}) == 1.5 + math.sin(0.25) * math.pi * 2
    with pytest.raises(dataclasses.FrozenInstanceError):
        expression.text = "t"  # type: ignore[misc]
    assert parse("t + 1", "a") == parse("t + 1", "b") and hash(parse("t")) == hash(parse("t"))


@pytest.mark.parametrize("value", [0, 3, -2, 0.1, -0.0, 1e-300, "3", " .5 ", "1_000", "0x10", "-2.5e-3", "+4"])
def test_numbers_are_expressions(value: float | str) -> None:
    wanted = float(value) if not isinstance(value, str) else eval(value.strip())
    assert evaluate(parse(value), {}) == wanted
    assert parse(value).names == frozenset()


def test_equations_split_at_the_equals_sign() -> None:
    equation = parse_equation("  (xi1_1 + 0.5)*sin(psi1) = 0.7 ", "programme.constraints[2]", {"xi1_1", "psi1"})
    assert equation.text == "(xi1_1 + 0.5)*sin(psi1) = 0.7"
    assert equation.names == {"xi1_1", "psi1"} and equation.right.names == frozenset()
    assert evaluate(equation.left, {"xi1_1": 0.2, "psi1": 1.0}) == (0.2 + 0.5) * math.sin(1.0)
    assert evaluate(equation.right, {}) == 0.7


@pytest.mark.parametrize(
    "text, part",
    [("a", "0 equals signs"), ("a == b", "comparison"), ("a = b = a", "2 equals signs"), ("a <= b", "comparison"),
     ("a != b", "comparison"), ("a := b", "comparison"), ("a < b", "comparison"), ("= b", "found nothing"),
     ("a =", "found nothing"), ("min(a, key=b)", "not an expression"), ("a = c", "unknown name 'c'"), ("", "nothing"),
     ("a = ｂ", "\\uff42"), (3.0, "neither text")],
)  # fmt: skip
def test_what_is_not_one_equation_is_refused(text: str, part: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_equation(text, "constraints[1]", {"a", "b"})
    assert part in str(caught.value) and "constraints[1]" in str(caught.value)


PRECEDENCE = [
    "-x**2", "2*-x", "x - y - 1", "x - (y - 1)", "x/y/2", "x/(y/2)", "x/y*2", "x*y/2*x", "-x**-2", "+x - -y",
    "x + y*2 - x/y", "(x + y)*(x - y)", "--x", "-(x + y)", "x**0.5", "x**-0.5", "x**1.7", "x**0",
    "min(x, y, 1) + max(x, 2, y)", "atan2(x, y)", "atan2(-x, -y)", "abs(x - y)", "1/x**2", "sqrt(x)/sqrt(y)",
    "x**-1.5", "exp(-x)*log(y)", "tan(x)*asin(x/2)*acos(x/2)*atan(y)", "1e3*x + .5", "x/3 + y*0.1", "2*pi*x",
    "123456789*x", "(x + x)**20", "abs(sqrt(x) - y)", "sqrt((x - y)**2)", "max(sqrt(x), log(y))", "x**64",
]  # fmt: skip


@pytest.mark.parametrize("text", PRECEDENCE)
def test_values_are_pythons_own(text: str) -> None:
    expression = parse(text, allowed={"x", "y"})
    compiled = compile_scalar([to_sympy(expression, {"x": X, "y": Y})], [X, Y])
    for x, y in [(0.7, 1.3), (1.9, 0.4), (1.0, 1.0)]:
        wanted = eval(text, PYTHON, {"x": x, "y": y})
        assert evaluate(expression, {"x": x, "y": y}) == pytest.approx(wanted, rel=1e-15, abs=0)
        assert compiled(x, y)[0] == pytest.approx(wanted, rel=1e-13, abs=1e-15)


def trees(leaves: st.SearchStrategy[str], kinks: bool) -> st.SearchStrategy[str]:
    """Text of random expressions whose values and condition numbers stay moderate."""

    def grow(children: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        one = st.sampled_from(["sin({})", "cos({})", "atan({})", "-{}", "(-({}))", "sqrt(1 + ({})**2)", "exp(sin({}))",
                               "log(2 + cos({}))", "tan(atan({})/2)", "asin(sin({})/2)", "acos(cos({})/2)"])  # fmt: skip
        two = ["{} + {}", "{} - {}", "({} - ({}))", "sin({})*cos({})", "({})/(2 + sin({}))", "atan2({}, 2 + ({})**2)"]
        two += ["abs({} - {})", "min({}, {})", "max({}, {})"] if kinks else []
        return st.one_of(
            st.builds(lambda form, a: form.format(a), one, children),
            st.builds(lambda form, a, b: form.format(a, b), st.sampled_from(two), children, children),
        )

    return st.recursive(leaves, grow, max_leaves=8)


LEAVES = st.one_of(st.sampled_from(["x", "y", "pi"]), st.floats(0.0, 3.0, width=16).map(repr), st.integers(0, 3).map(str))
POINTS = st.floats(-2.0, 2.0)


@settings(max_examples=150, deadline=None)
@given(trees(LEAVES, kinks=True), POINTS, POINTS)
def test_random_expressions_agree_three_ways(text: str, x: float, y: float) -> None:
    wanted = eval(text, PYTHON, {"x": x, "y": y})
    expression = parse(text, allowed={"x", "y"})
    assert evaluate(expression, {"x": x, "y": y}) == pytest.approx(wanted, rel=1e-12, abs=1e-12)
    compiled = compile_scalar([to_sympy(expression, {"x": X, "y": Y})], [X, Y])
    assert compiled(x, y)[0] == pytest.approx(wanted, rel=1e-9, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(trees(LEAVES, kinks=False), POINTS, POINTS)
def test_random_derivatives_agree_with_high_precision_differences(text: str, x: float, y: float) -> None:
    expression = to_sympy(parse(text), {"x": X, "y": Y})
    slopes = {which: expression.diff(*((X, Y)[i] for i in which)) for which in ((0,), (1,), (0, 0), (0, 1), (1, 1))}
    values = dict(zip(slopes, compile_scalar(list(slopes.values()), [X, Y])(x, y), strict=True))
    with mpmath.workdps(60):
        for which, order in {(0,): (1, 0), (1,): (0, 1), (0, 0): (2, 0), (0, 1): (1, 1), (1, 1): (0, 2)}.items():
            wanted = mpmath.diff(lambda a, b: eval(text, MPMATH, {"x": a, "y": b}), (x, y), order)
            assert values[which] == pytest.approx(float(wanted), rel=1e-7, abs=1e-7)


@pytest.mark.parametrize(
    "text", ["sin(t)", "cos(t)", "tan(t)", "asin(t)", "acos(t)", "atan(t)", "exp(t)", "log(t)", "sqrt(t)", "t**-3", "t**1.7",
             "t**64", "1/t", "abs(-t)", "min(t**2, 5)", "max(t**2, t)", "atan2(t, t**2)", "t*t", "abs(sqrt(t) - 2)",
             "max(log(t), 1/t)", "sqrt(t**2)", "(t**2)**0.3", "0.2 + 0.05*sin(6*t)", "exp(-t)*abs(cos(t))/(1 + t)"],
)  # fmt: skip
def test_jets_of_every_function(text: str) -> None:
    law = time_law(text, {}, "law")
    namespace = MPMATH | {"min": min, "max": max}
    with mpmath.workdps(60):
        for order, found in enumerate(law.jet(0.37)):
            wanted = mpmath.diff(lambda t: eval(text, namespace, {"t": t}), mpmath.mpf(0.37), order)
            assert found == pytest.approx(float(wanted), rel=1e-12, abs=1e-14)
    assert law.value(0.37) == pytest.approx(law.jet(0.37)[0], rel=1e-14)


@pytest.mark.parametrize(
    "text, values, part",
    [("log(x)", {"x": 0.0}, "log(0.0)"), ("sqrt(x)", {"x": -1.0}, "x = -1.0"), ("1/x", {"x": 0.0}, "1.0 / 0.0"),
     ("x**0.5", {"x": -2.0}, "-2.0 ** 0.5"), ("exp(x)", {"x": 1e4}, "exp(10000.0)"), ("x*x", {"x": 1e200}, "inf"),
     ("x + y", {"x": 1.0}, "no value for 'y'"), ("x + 1", {"x": math.nan}, "nan"), ("legs.x", {"legs.y": 1.0}, "'legs.y'"),
     ("asin(x)", {"x": 1.5}, "asin(1.5)"), ("x**-1", {"x": 0.0}, "0.0 ** -1.0")],
)  # fmt: skip
def test_evaluating_outside_the_domain_is_a_named_error(text: str, values: dict[str, float], part: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        evaluate(parse(text, "start.phi0"), values)
    assert part in str(caught.value) and "start.phi0" in str(caught.value)


@pytest.mark.parametrize(
    "text, x", [("log(x)", 0.0), ("log(x)", -1.0), ("sqrt(x)", -1.0), ("1/x", 0.0), ("x**0.3", -2.0), ("x**-1.5", -2.0),
                ("x**64", 1e10), ("exp(x)", 1e4), ("asin(x)", 2.0), ("x**1.5", -1.0)],
)  # fmt: skip
def test_compiled_functions_answer_nan_outside_their_domain(text: str, x: float) -> None:
    compiled = compile_scalar([to_sympy(parse(text), {"x": X}), X + 1], [X])
    assert all(math.isnan(value) for value in compiled(x))
    assert compiled(0.5)[1] == 1.5
    law = time_law(re.sub(r"\bx\b", "t", text), {}, "law")
    assert math.isnan(law.value(x))
    assert not any(isinstance(value, complex) or math.isfinite(value) for value in law.jet(x))


def test_derivatives_at_kinks_and_roots_are_numbers() -> None:
    assert time_law("abs(t)", {}, "law").jet(0.0) == (0.0, 0.0, 0.0)
    assert time_law("abs(t)", {}, "law").jet(-2.0) == (2.0, -1.0, 0.0)
    assert time_law("max(3*t, t)", {}, "law").jet(0.0) == (0.0, 2.0, 0.0)
    assert time_law("min(3*t, t**2)", {}, "law").jet(1.0) == (1.0, 2.0, 2.0)
    assert time_law("min(3*t, t**2)", {}, "law").jet(-1.0) == (-3.0, 3.0, 0.0)
    assert time_law("sqrt(t)", {}, "law").value(0.0) == 0.0
    assert not any(math.isinf(value) for value in time_law("sqrt(t)", {}, "law").jet(0.0))


def test_sympys_own_kinks_compile_too() -> None:
    outputs = [sympy.Abs(X), sympy.sign(X), sympy.Max(X, Y), sympy.Min(X, Y, 1), sympy.Heaviside(X - Y), sympy.DiracDelta(X),
               sympy.Abs(X - Y).diff(X), sympy.Max(X, Y).diff(Y), sympy.Abs(X).diff(X, 2), sympy.Integer(7)]  # fmt: skip
    compiled = compile_scalar(outputs, [X, Y])
    assert compiled(-2.0, 3.0) == (2.0, -1.0, 3.0, -2.0, 0.0, 0.0, -1.0, 1.0, 0.0, 7.0)
    assert compiled(0.0, 0.0)[1] == 0.0


def test_symbol_names_never_reach_the_generated_source() -> None:
    hostile = sympy.Symbol("__import__('os').abort()", real=True)
    dotted, math_named, shared = sympy.symbols("legs.tip.x math x0", real=True)
    output = sympy.sin(hostile + dotted) ** 2 + sympy.cos(hostile + dotted) * math_named + shared
    compiled = compile_scalar([output, output * sympy.sin(hostile + dotted)], [hostile, dotted, math_named, shared])
    wanted = math.sin(0.5) ** 2 + math.cos(0.5) * 3.0 + 4.0
    assert compiled(0.3, 0.2, 3.0, 4.0) == pytest.approx((wanted, wanted * math.sin(0.5)), rel=1e-14)
    with pytest.raises(VlmbError, match="are no arguments"):
        compile_scalar([output], [dotted, math_named, shared])
    with pytest.raises(ExpressionError, match="no symbol for 'y'"):
        to_sympy(parse("x + y", "key"), {"x": X})


def test_shared_parts_are_computed_once(monkeypatch) -> None:
    calls: list[float] = []
    monkeypatch.setattr("vlmb.scene.symbolic._sign", lambda x: calls.append(x) or 1.0)
    slope = to_sympy(parse("abs(sin(x*y))"), {"x": X, "y": Y}).diff(X)
    wanted = 2.0 * math.cos(1.0)
    found = compile_scalar([slope, slope + X, sympy.exp(slope)], [X, Y])(0.5, 2.0)
    assert found == pytest.approx((wanted, wanted + 0.5, math.exp(wanted)), rel=1e-15)
    assert calls == [math.sin(1.0)]


def test_laws_of_parameters() -> None:
    parameters = {"A": -0.5, "k": 3.0, "unused": 1.0}
    law = time_law("A*sin(k*t) + A", parameters, "forces[0].law")
    assert law.value(0.4) == -0.5 * math.sin(3.0 * 0.4) - 0.5
    assert law.jet(0.4) == pytest.approx(
        (law.value(0.4), -1.5 * math.cos(1.2), 4.5 * math.sin(1.2)), rel=1e-14
    )  # fmt: skip
    for constant in (time_law("A*k", parameters, "law"), time_law(-1.5, {}, "law"), time_law("t*0 - 1.5", {}, "law")):
        assert constant.value(7.0) == -1.5 and constant.jet(7.0) == (-1.5, 0.0, 0.0)
    with pytest.raises(ExpressionError, match=r"forces\[0\].law.*unknown name 'kk'.*'k'"):
        time_law("kk*t", parameters, "forces[0].law")
    with pytest.raises(ExpressionError, match=r"forces\[1\].law.*1.0 / 0.0"):
        time_law("t + 1/(A + 0.5)", parameters, "forces[1].law")
    with pytest.raises(ExpressionError, match=r"parameters\.A"):
        time_law("A*t", {"A": math.nan}, "law")


def test_values_of_laws_do_not_import_sympy() -> None:
    code = (
        "import sys; from vlmb.scene.expressions import *; from vlmb.scene.laws import *;"
        " assert time_law('A*k', {'A': 1, 'k': 2}, '').jet(1.0) == (2, 0, 0);"
        "law = time_law('sin(3*t) + abs(t)', {}, ''); law.value(1.0); law_breaks(law, -1.0, 1.0);"
        "evaluate(parse_equation('tan(phi0) = k').left, {'phi0': 1.0}); assert 'sympy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    "text, span, breaks",
    [
        ("abs(sin(40*t))", (0.0, 10.0), [k * math.pi / 40 for k in range(1, 128)]),
        ("abs(t - 1)", (0.0, 2.0), [1.0]),
        ("abs(t - 0.3)", (0.0, 1.0), [0.3]),
        ("max(0.2, min(t, 0.7))", (0.0, 1.0), [0.2, 0.7]),
        ("min(t, 1, 3 - t)", (-1.0, 5.0), [1.0, 2.0]),
        ("abs(t - 1) + max(t, 1) + min(2*t, 2)", (0.0, 3.0), [1.0]),
        ("abs(t)", (0.0, 1.0), []),
        ("abs(t - 1)", (0.0, 1.0), []),
        ("abs(abs(t - 2) - 1)", (0.0, 4.0), [1.0, 2.0, 3.0]),
        ("max(t - 2, 0) + min(t - 1, 0)", (0.0, 3.0), [1.0, 2.0]),
        ("abs((t - 1)**63)", (0.0, 2.0), [1.0]),
        ("sin(t)/(2 + cos(t)) + 0.1*abs(t**2 + 1)", (-5.0, 5.0), []),
        ("1/(t - 0.6)", (0.0, 1.0), [0.6]),
        ("atan2(sin(t), cos(t))", (0.1, 6.0), [math.pi]),
        ("sqrt(t - 0.5)", (0.0, 1.0), [0.5]),
        ("7", (0.0, 1.0), []),
        ("abs(t - 1)", (2.0, 0.0), []),
    ],
)
def test_breaks(text: str, span: tuple[float, float], breaks: list[float]) -> None:
    assert law_breaks(time_law(text, {}, "law"), *span) == pytest.approx(breaks, rel=4e-15, abs=1e-15)


def test_breaks_see_parameters() -> None:
    assert law_breaks(time_law("max(A*(t - t0), 0)", {"A": -2.0, "t0": 0.25}, "law"), 0.0, 1.0) == (0.25,)


@pytest.mark.parametrize(
    "text, at, value, slope",
    [
        ("abs(t - 1)", 1.0, 0.0, 2.0),
        ("abs(sin(40*t))", math.pi / 40, 0.0, 80.0),
        ("max(t, 1)**2", 1.0, 0.0, 2.0),
        ("max(t - 1, 0)**2", 1.0, 0.0, 0.0),
        ("abs(t - 2)*(t - 2)", 2.0, 0.0, 0.0),
        ("3*abs(t - 1)/(t - 1) + t**2", 1.0, 6.0, 0.0),
        ("sin(5*t)", 0.7, 0.0, 0.0),
        ("1000*t + min(t, 100)", 100.0, 0.0, -1.0),
    ],
)
def test_jumps(text: str, at: float, value: float, slope: float) -> None:
    assert law_jump(time_law(text, {}, "law"), at) == pytest.approx((value, slope), rel=1e-6, abs=1e-8)


def test_a_jump_at_the_edge_of_a_domain_is_not_a_number() -> None:
    assert all(math.isnan(jump) for jump in law_jump(time_law("sqrt(t)", {}, "law"), 0.0))
