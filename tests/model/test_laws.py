"""Laws of time: values and derivatives against high precision, domains, parameters, breaks and jumps."""

from __future__ import annotations

import math
import re
import subprocess
import sys

import mpmath
import numpy as np
import pytest

from vlmb.errors import ExpressionError, SceneError
from vlmb.model.laws import law_breaks, law_jump, time_law
from vlmb.scene.expressions import FUNCTIONS

MPMATH = {name: getattr(mpmath, name) for name in FUNCTIONS if hasattr(mpmath, name)} | {"abs": abs, "pi": mpmath.pi}


@pytest.mark.parametrize(
    "text", ["exp(1e300*log(2*t))", "exp((t+t)**64/t**64*log(t+t))", "((((t+t)**64)**64)**64)**64", "1/(t-t)", "sqrt(-t**2)",
             "sin(exp(1e300*log(2*t))/exp(1e300*log(t)))", "log(t - t)"],
)  # fmt: skip
def test_what_leaves_the_range_of_numbers_is_refused_or_has_no_value(text: str) -> None:
    if re.search(r"t ?- ?t", text):
        with pytest.raises(ExpressionError, match=r"division by 0|not a finite real number"):
            time_law(text, {}, "law")
    else:
        law = time_law(text, {}, "law")
        assert math.isnan(law.value(1e6)) and all(map(math.isnan, law.jet(1e6)))


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
    "text, x", [("log(x)", 0.0), ("log(x)", -1.0), ("sqrt(x)", -1.0), ("1/x", 0.0), ("x**0.3", -2.0), ("x**-1.5", -2.0),
                ("x**64", 1e10), ("exp(x)", 1e4), ("asin(x)", 2.0), ("x**1.5", -1.0)],
)  # fmt: skip
def test_outside_their_domain_laws_are_nan(text: str, x: float) -> None:
    law = time_law(re.sub(r"\bx\b", "t", text), {}, "law")
    assert math.isnan(law.value(x))
    assert not any(isinstance(value, complex) or math.isfinite(value) for value in law.jet(x))


def test_derivatives_at_kinks_and_roots_are_those_of_the_side_that_counts() -> None:
    assert time_law("abs(t)", {}, "law").jet(0.0) == (0.0, 1.0, 0.0)
    assert time_law("abs(t)", {}, "law").jet(-2.0) == (2.0, -1.0, 0.0)
    assert time_law("max(3*t, t)", {}, "law").jet(0.0) == (0.0, 3.0, 0.0)
    assert time_law("min(3*t, t**2)", {}, "law").jet(1.0) == (1.0, 2.0, 2.0)
    assert time_law("min(3*t, t**2)", {}, "law").jet(-1.0) == (-3.0, 3.0, 0.0)
    assert time_law("sign(t) + step(t)", {}, "law").jet(0.0) == (1.0, 0.0, 0.0)
    assert time_law("where(t < 1, t, t**2)", {}, "law").jet(1.0) == (1.0, 2.0, 2.0)
    assert time_law("sqrt(t)", {}, "law").value(0.0) == 0.0
    assert not any(math.isinf(value) for value in time_law("sqrt(t)", {}, "law").jet(0.0))


def test_values_at_many_times() -> None:
    law, times = time_law("A*sin(3*t) + sqrt(t - 1)", {"A": 2.0}, "law"), np.linspace(0.0, 4.0, 9)
    np.testing.assert_array_equal(law.values(times), [law.value(t) for t in times])
    assert np.isnan(law.values(times)).sum() == 2


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
    with pytest.raises(ExpressionError, match=r"forces\[1\].law.*1/\(A \+ 0.5\) is not a finite.*A = -0.5"):
        time_law("t + 1/(A + 0.5)", parameters, "forces[1].law")
    with pytest.raises(ExpressionError, match=r"parameters\.A"):
        time_law("A*t", {"A": math.nan}, "law")
    assert time_law("where(A < 0, t, t/(A + 0.5))", parameters, "law").value(2.0) == 2.0  # not looked at


def test_nothing_here_imports_sympy() -> None:
    code = (
        "import sys, vlmb; from vlmb.model.laws import *; law = time_law('sin(3*t) + abs(t)', {}, ''); law.jet(1.0);"
        "law_breaks(law, -1.0, 1.0); assert 'sympy' not in sys.modules"
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
        ("sin(t)/(2 + cos(t)) + 0.1*abs(t**2 + 1)", (-5.0, 5.0), []),
        ("1/(t - 0.6)", (0.0, 1.0), [0.6]),
        ("atan2(sin(t), cos(t))", (0.1, 6.0), [math.pi]),
        ("sqrt(t - 0.5)", (0.0, 1.0), [0.5]),
        ("abs(t - 0.5000001) + abs(t - 0.5000004)", (0.0, 1.0), [0.5000001, 0.5000004]),
        ("step(t - 0.3) + sign(t - 0.6)", (0.0, 1.0), [0.3, 0.6]),
        ("where(t > 0.4, 1, 2*t)", (0.0, 1.0), [0.4]),
        ("tan(t)", (0.0, 3.0), [math.pi / 2]),
        ("7", (0.0, 1.0), []),
        ("abs(t - 1)", (2.0, 0.0), []),
    ],
)
def test_breaks(text: str, span: tuple[float, float], breaks: list[float]) -> None:
    assert law_breaks(time_law(text, {}, "law"), *span) == pytest.approx(breaks, rel=4e-15, abs=1e-15)


def test_a_kink_too_flat_for_numbers_is_told_where_they_leave_zero() -> None:
    found = law_breaks(time_law("abs((t - 1)**63)", {}, "law"), 0.0, 2.0)
    assert 1.0 in found or all(abs(t - 1.0) ** 63 < 1e-300 for t in found)
    assert 1 <= len(found) <= 2


def test_breaks_see_parameters() -> None:
    assert law_breaks(time_law("max(A*(t - t0), 0)", {"A": -2.0, "t0": 0.25}, "law"), 0.0, 1.0) == (0.25,)


def test_too_many_breaks_are_refused() -> None:
    with pytest.raises(SceneError, match="switches too often"):
        law_breaks(time_law("sign(sin(1e7*t))", {}, "law"), 0.0, 10.0)


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
    assert law_jump(time_law(text, {}, "law"), at) == pytest.approx((value, slope), rel=1e-6, abs=1e-7)  # rounding over 1e-7 s


def test_a_jump_at_the_edge_of_a_domain_is_not_a_number() -> None:
    assert all(math.isnan(jump) for jump in law_jump(time_law("sqrt(t)", {}, "law"), 0.0))
