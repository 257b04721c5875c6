"""Signs of indicators over a step: those that changed, and those that a cubic says came back within it."""

from __future__ import annotations

import math

from vlmb.core.driver import (
    DIRECTION,
    H_LAST,
    HIT,
    RATE,
    RATE_BEFORE,
    RESUMED,
    SIDE,
    VALUE,
    VALUE_BEFORE,
    VALUE_EARLIER,
    ZERO,
    ZERO_RATE,
    Array,
    Driver,
    H,
)
from vlmb.core.jit import inner, kernel

DOUBT = 0.2  # of the bend of a cubic: how far off it may be where it turns


@inner
def sign(x: float) -> float:
    """-1, 0 or 1."""
    if x > 0.0:
        return 1.0
    return -1.0 if x < 0.0 else 0.0


@inner
def side_at_start(value: float, rate: float, zero: float, zero_rate: float) -> float:
    """Side of 0: that of the value, or on 0 the one it moves to; 0 if it rests there: then any motion leaves it."""
    if abs(value) > zero:
        return sign(value)
    return sign(rate) if abs(rate) > zero_rate else 0.0


@inner
def note_start(driver: Driver) -> None:
    """Take the indicators at the start of a run; HIT of a resumed one means that its side is known."""
    g = driver.indicators
    for i in range(g.shape[1]):
        g[VALUE_BEFORE, i] = math.nan
        if driver.counts[RESUMED] and g[HIT, i] != 0.0:
            g[SIDE, i] = g[HIT, i]
        else:
            g[SIDE, i] = side_at_start(g[VALUE, i], g[RATE, i], g[ZERO, i], g[ZERO_RATE, i])
        g[HIT, i] = 0.0
    _remember(g)


@inner
def leaves_at_start(driver: Driver) -> bool:
    """Mark in HIT the first indicator that starts on its 0 and leaves it the wrong way; return whether there is one.

    Only those with a width ZERO are looked at: what lies within it is on 0.
    """
    g = driver.indicators
    for i in range(g.shape[1]):
        on = abs(g[VALUE, i]) <= g[ZERO, i] and g[ZERO, i] > 0.0
        if on and g[RATE, i] < -g[ZERO_RATE, i]:
            g[HIT, i] = -1.0
            return True
    return False


@inner
def note_step(driver: Driver) -> None:
    """Take the indicators at the end of an accepted step as those at the start of the next."""
    g = driver.indicators
    for i in range(g.shape[1]):
        now = sign(g[VALUE, i])
        if now != 0.0:
            g[SIDE, i] = now
        g[HIT, i] = 0.0
    _remember(g)


@inner
def _remember(g: Array) -> None:
    for i in range(g.shape[1]):
        g[VALUE_EARLIER, i] = g[VALUE_BEFORE, i]
        g[VALUE_BEFORE, i] = g[VALUE, i]
        g[RATE_BEFORE, i] = g[RATE, i]


@inner
def find_suspects(driver: Driver) -> bool:
    """Mark in HIT the indicators that may have crossed 0 in a watched direction within the step; return whether there are any."""
    g, h = driver.indicators, driver.real[H]
    some = False
    for i in range(g.shape[1]):
        if g[RATE, i] != g[RATE, i]:
            guess_rates(g, i, h, driver.real[H_LAST])
        start = (g[SIDE, i], g[VALUE_BEFORE, i], h * g[RATE_BEFORE, i])
        crossed = crosses(start, g[VALUE, i], h * g[RATE, i], g[DIRECTION, i])
        g[HIT, i] = 1.0 if crossed else 0.0
        some = some or crossed
    return some


@inner
def guess_rates(g: Array, i: int, h: float, h_before: float) -> None:
    """Write the rates of an indicator that knows none, as forces do not: of the parabola through its last three values.

    Of a first step, which has two, of a parabola that comes nearer to 0 than both by a third of what they differ by.
    """
    now = (g[VALUE, i] - g[VALUE_BEFORE, i]) / h
    bend = 3.0 * now / h if abs(g[VALUE, i]) > abs(g[VALUE_BEFORE, i]) else -3.0 * now / h
    if g[VALUE_EARLIER, i] == g[VALUE_EARLIER, i]:
        bend = (now - (g[VALUE_BEFORE, i] - g[VALUE_EARLIER, i]) / h_before) / (h_before + h)
    g[RATE_BEFORE, i], g[RATE, i] = now - h * bend, now + h * bend


@inner
def crosses(start: tuple[float, float, float], g1: float, m1: float, direction: float) -> bool:
    """Whether a function of values g and slopes m at both ends may change sign in a direction (0: any) for x in [0, 1].

    `start`: side of 0 at x = 0, g0, m0. The cubic through them is a share of its bend off where a step is as long as half an
    oscillation: where it turns that near to 0 it counts as crossing.
    """
    side, g0, m0 = start
    inside0, inside1 = g0 + m0 / 3.0, g1 - m1 / 3.0  # its Bezier points: all on one side, the curve too
    bend = max(abs(inside0 - (2.0 * g0 + g1) / 3.0), abs(inside1 - (g0 + 2.0 * g1) / 3.0))
    near = DOUBT * bend
    if side > 0.0 and inside0 > near and inside1 > near and g1 > 0.0:
        return False
    if side < 0.0 and inside0 < -near and inside1 < -near and g1 < 0.0:
        return False
    first, second = turning_points(g0, m0, g1, m1)
    for x in (first, second):
        if 0.0 < x < 1.0:
            turn = hermite(x, g0, m0, g1, m1)
            now = sign(turn)
            if leaves(side, now, direction) or (abs(turn) < near and leaves(side, -side, direction)):
                return True
            side = side if now == 0.0 else now
    return leaves(side, sign(g1), direction)


@kernel
def leaves(side: float, now: float, direction: float) -> bool:
    """Whether going from one side of 0 to another is a crossing that is watched."""
    return now != 0.0 and now != side and direction * now >= 0.0


@inner
def hermite(x: float, g0: float, m0: float, g1: float, m1: float) -> float:
    """Cubic through (0, g0) and (1, g1) with slopes m0 and m1."""
    rise = g1 - g0
    return g0 + x * (m0 + x * (3.0 * rise - 2.0 * m0 - m1 + x * (m0 + m1 - 2.0 * rise)))


@kernel
def turning_points(g0: float, m0: float, g1: float, m1: float) -> tuple[float, float]:
    """Where the cubic's slope m0 + 2 b x + 3 c x^2 is 0, in ascending order; -1 if nowhere."""
    rise = g1 - g0
    b, c = 3.0 * rise - 2.0 * m0 - m1, 3.0 * (m0 + m1 - 2.0 * rise)
    square = b * b - c * m0
    if not square > 0.0:
        return -1.0, -1.0
    q = -(b + math.copysign(math.sqrt(square), b))
    one = m0 / q if q != 0.0 else -1.0
    other = q / c if c != 0.0 else -1.0
    return min(one, other), max(one, other)
