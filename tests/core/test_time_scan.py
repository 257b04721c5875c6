"""Laws of time before a run: breaks, jumps, and how long steps may be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vlmb.core import opcodes
from vlmb.core.enclosures import enclose
from vlmb.core.tape import play_jets
from vlmb.core.time_scan import TimeScale, set_parameters, set_time, time_breaks, time_jump, time_scale
from vlmb.model.tape import Leaf, compile_tape
from vlmb.scene.expressions import parse

STRAIGHT = np.array([[0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0], [100.0, *[0.0] * 6]])  # 1 + t/2 up to t = 100
PARAMETERS = np.array([2.0, 0.36])
NAMES = {
    "t": Leaf(opcodes.TIME), "A": Leaf(opcodes.PARAMETER, 0), "k": Leaf(opcodes.PARAMETER, 1), "x": Leaf(opcodes.VALUE, 0),
    "mocap": Leaf(opcodes.SIGNAL, 0),
}  # fmt: skip


def made(text: str) -> opcodes.Tape:
    return compile_tape([parse(text)], NAMES.__getitem__, [STRAIGHT]).tape


def scale(text: str, end: float = 100.0) -> TimeScale:
    return time_scale(made(text), PARAMETERS, 0.0, end)


def step_at(found: TimeScale, t: float) -> float:
    return float(found.steps[np.searchsorted(found.steps[:, 1], t), 2])


@pytest.mark.parametrize("width", [0.5, 0.1, 0.05, 1e-3])
@pytest.mark.parametrize(
    "text", ["1000*exp(-((t - 50.3)/W)**2)", "0.7 + 0.2*exp(-((t-50.3)/W)**2)", "A*sin(t) - 100*x + 1e-3*exp(-((t - 50.3)/W)**2)",
             "5/(1 + ((t - 50.3)/W)**2)", "t*x*(atan((t - 50.3)/W) + 2)",
             "step(exp(-((t - 50.3)/W)**2) - 0.5) + exp(-((t - 50.3)/W)**2)"],
)  # fmt: skip
def test_narrow_features_are_found(text: str, width: float) -> None:
    found = scale(text.replace("W", str(width)))
    assert found.until == 100.0
    assert found.steps[0, 0] == 0.0 and found.steps[-1, 1] == 100.0
    np.testing.assert_array_equal(found.steps[1:, 0], found.steps[:-1, 1])
    assert 0.02 * width < step_at(found, 50.3) <= 1.5 * width
    assert min(step_at(found, 20.0), step_at(found, 80.0)) > min(0.7, 10.0 * width)


@pytest.mark.parametrize("text", ["3*t - A", "A + k", "x*A", "abs(t - 5)", "where(t < 5, 2*t, 3)", "mocap*2 + x"])
def test_what_does_not_bend_bounds_nothing(text: str) -> None:
    assert scale(text).steps.tolist() == [[0.0, 100.0, 100.0]]


def test_waves_are_bounded_evenly() -> None:
    for w in (0.5, 3.0, 100.0):
        found = scale(f"0.2 + 0.1*sin({w}*t)")
        assert len(found.steps) == 1 and 0.5 < found.steps[0, 2] * w < 1.5


def test_what_is_too_fast_is_told() -> None:
    found = scale("sin(1e6*t)")
    assert 0.0 < found.until < 1.0


def breaks(text: str, end: float = 100.0) -> np.ndarray:
    return time_breaks(made(text), PARAMETERS, 0.0, end)


@pytest.mark.parametrize(
    "text, wanted",
    [("abs(t - 5)", [5.0]), ("where(t < 5, 0, where(t < 5.01, 100, 0))", [5.0, 5.01]), ("step(t - 1e-6)", [1e-6]),
     ("1/(t - 3)", [3.0]),
     ("sqrt((t - 5)**2)", [5.0]), ("abs(max(t - 5, 0))", [5.0]), ("abs((t - 5)**2)", []),
     ("tan(A*t/20)", [10 * math.pi * n for n in (0.5, 1.5, 2.5)]),
     ("A*abs(t - A) + x*abs(x)", [2.0]), ("log(7 - t)", [7.0]), ("asin(t/10)", [10.0]), ("step(mocap) + t", []),
     ("sign(sin(t))*x", [math.pi * n for n in range(1, 32)]),
     ("min(t, 40, 90 - t)", [40.0, 50.0]), ("sign(tan(t))", sorted([math.pi / 2 * n for n in range(1, 64)])), ("step(k)", [])],
)  # fmt: skip
def test_breaks(text: str, wanted: list[float]) -> None:
    np.testing.assert_allclose(breaks(text), wanted, rtol=1e-12)


def test_many_breaks() -> None:
    np.testing.assert_allclose(breaks("sign(sin(100*t))"), math.pi / 100 * np.arange(1, 3184), rtol=1e-12)
    assert math.isnan(time_breaks(made("sign(sin(100*t))"), PARAMETERS, 0.0, 100.0, count=10)[-1])


@pytest.mark.parametrize(
    "text, wanted",
    [("A*abs(t - 5)", (0.0, 4.0)), ("3*step(t - 5) + t", (3.0, 0.0)),
     ("where(t < 5, t, sin(t))", (math.sin(5) - 5, math.cos(5) - 1))],
)  # fmt: skip
def test_jumps(text: str, wanted: tuple[float, float]) -> None:
    np.testing.assert_allclose(time_jump(made(text), PARAMETERS, 0, 5.0), wanted, atol=1e-7)


LAWS = [
    "sin(t)*cos(2*t) - t", "(t - 1)/(1.2 + sin(t))", "3/(t + 0.1)", "(t - 1)**3", "(1 - t)**4", "(t + 0.1)**-3", "t**1.5",
    "(t + 1)**-0.5",
    "tan(t - 1)", "asin(sin(t)/1.2)", "acos(cos(t)/1.2)", "atan(t*t)", "atan2(t - 1, 2 - t)", "atan2(sin(t), cos(t))",
    "exp(-(t - 1)**2)",
    "log(t + 0.1)", "sqrt(t + 0.1)", "abs(t - 1)*t", "min(sin(t), cos(t))", "max(t, A - t)", "sign(t - 1)*t",
    "step(t - 1)*t + A/3",
    "where(t < 1, t*t, sin(t))", "where(t*t > 1, log(t), t)", "A*k**2*sin(k*t)/(1.2*k**2 + 9.7/(A**2 + 2*t))", "2*(t/3 - 1)**2",
]  # fmt: skip


@pytest.mark.parametrize("text", LAWS)
def test_laws_stay_in_their_enclosures(text: str) -> None:
    tape, rng = made(text), np.random.default_rng(2)
    buffers, boxes = opcodes.make_buffers(tape), np.empty((int(tape.parts[0]) + len(tape.code), 6))
    set_parameters(tape, buffers, PARAMETERS)
    for low, width in ((1.3, 0.01), (0.2, 0.7), (0.9, 3.0)):
        enclose(tape, PARAMETERS, low, low + width, boxes)
        for t in rng.uniform(low, low + width, 20):
            set_time(tape, buffers, t)
            play_jets(tape, buffers, 0, len(tape.code))
            slack = 1e-9 * (1.0 + np.abs(buffers.slots))
            inside = (boxes[:, ::2] - slack <= buffers.slots) & (buffers.slots <= boxes[:, 1::2] + slack)
            assert (inside | ~np.isfinite(buffers.slots)).all()


@pytest.mark.parametrize("text", LAWS)
def test_enclosures_shrink_to_the_jet(text: str) -> None:
    tape = made(text)
    boxes = np.empty((int(tape.parts[0]) + len(tape.code), 6))
    enclose(tape, PARAMETERS, 1.7, 1.7 + 1e-9, boxes)
    assert (boxes[tape.root[0], 1::2] - boxes[tape.root[0], ::2] < 1e-6).all()
