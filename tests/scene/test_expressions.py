"""Expressions: hostile text is refused, values agree with independent evaluation."""

from __future__ import annotations

import dataclasses
import math
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vlmb.errors import ExpressionError, SceneError
from vlmb.scene.expressions import FUNCTIONS, evaluate, parse, parse_equation

PYTHON = {**FUNCTIONS, "pi": math.pi, "__builtins__": {}}

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


@pytest.mark.parametrize("value", [True, None, [], {}, b"t", 1j, math.nan, math.inf, -math.inf, 10**400, object()])
def test_other_than_text_and_finite_numbers_is_refused(value: object) -> None:
    with pytest.raises(ExpressionError, match="links"):
        parse(value, "links[0].upper.law")  # type: ignore[arg-type]


def test_nothing_in_the_text_runs(tmp_path) -> None:
    mark = tmp_path / "mark"
    for text in (f"__import__('pathlib').Path({str(mark)!r}).touch()", f"open({str(mark)!r}, 'w')"):
        with pytest.raises(ExpressionError):
            parse(text)
        with pytest.raises(ExpressionError):
            parse_equation(f"t = {text}")
    assert not mark.exists()


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
    for x, y in [(0.7, 1.3), (1.9, 0.4), (1.0, 1.0)]:
        wanted = eval(text, PYTHON, {"x": x, "y": y})
        assert evaluate(expression, {"x": x, "y": y}) == pytest.approx(wanted, rel=1e-15, abs=0)


def trees(leaves: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Text of random expressions whose values and condition numbers stay moderate."""

    def grow(children: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        one = st.sampled_from(["sin({})", "cos({})", "atan({})", "-{}", "(-({}))", "sqrt(1 + ({})**2)", "exp(sin({}))",
                               "log(2 + cos({}))", "tan(atan({})/2)", "asin(sin({})/2)", "acos(cos({})/2)"])  # fmt: skip
        two = ["{} + {}", "{} - {}", "({} - ({}))", "sin({})*cos({})", "({})/(2 + sin({}))", "atan2({}, 2 + ({})**2)"]
        two += ["abs({} - {})", "min({}, {})", "max({}, {})"]
        return st.one_of(
            st.builds(lambda form, a: form.format(a), one, children),
            st.builds(lambda form, a, b: form.format(a, b), st.sampled_from(two), children, children),
        )

    return st.recursive(leaves, grow, max_leaves=8)


LEAVES = st.one_of(st.sampled_from(["x", "y", "pi"]), st.floats(0.0, 3.0, width=16).map(repr), st.integers(0, 3).map(str))
POINTS = st.floats(-2.0, 2.0)


@settings(max_examples=150, deadline=None)
@given(trees(LEAVES), POINTS, POINTS)
def test_random_expressions_have_pythons_value(text: str, x: float, y: float) -> None:
    wanted = eval(text, PYTHON, {"x": x, "y": y})
    expression = parse(text, allowed={"x", "y"})
    assert evaluate(expression, {"x": x, "y": y}) == pytest.approx(wanted, rel=1e-12, abs=1e-12)


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
