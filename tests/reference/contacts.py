"""Independent witness of contacts: balls, rods, blocks, walkers, runners and skis from closed forms and SciPy alone.

Nothing here knows of the project. Each function derives its case anew; what it returns is exact to a few units of 1e-13 where it
integrates (DOP853 at rounding; events by the secant method on integrations that end there) and to rounding where it does not.
g = 9.81 m/s^2 unless given. Units: m, rad, s, kg, N, J.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

Array = NDArray[np.float64]
Field = Callable[[float, Array], "list[float]"]
Crossing = Callable[[Array], float]

GRAVITY = 9.81


def advance(field: Field, start: Array, duration: float) -> Array:
    """State after a time."""
    if duration == 0.0:
        return np.array(start, dtype=np.float64)
    run = solve_ivp(field, (0.0, duration), start, method="DOP853", rtol=3e-14, atol=1e-15)
    return np.array(run.y[:, -1])


def until(
    field: Field, start: Array, crossing: Crossing, longest: float, *, rising: bool, counts: Crossing | None = None
) -> tuple[float, Array]:
    """Time and state where `crossing` first passes zero after the start, in the given sense and where `counts` is positive."""

    def watched(_: float, y: Array) -> float:
        return crossing(y)

    watched.direction = 1.0 if rising else -1.0  # type: ignore[attr-defined]
    run = solve_ivp(field, (0.0, longest), start, method="DOP853", rtol=1e-10, atol=1e-12, events=watched)
    times = [
        t for t, y in zip(run.t_events[0], run.y_events[0], strict=True) if t > 1e-6 and (counts is None or counts(y) > 0.0)
    ]
    if not times:
        raise ValueError(f"no crossing within {longest:g} s")
    t, other = float(times[0]), float(times[0]) + 1e-5
    value, beyond = crossing(advance(field, start, t)), crossing(advance(field, start, other))
    for _ in range(6):
        t, other, beyond = t - value * (other - t) / (beyond - value), t, value
        state = advance(field, start, t)
        value = crossing(state)
        if abs(other - t) < 1e-14 or value == beyond:
            break
    return t, state


# A ball, rods -------------------------------------------------------------------------------------------------------------


def ball_impacts(height: float = 1.0, restitution: float = 0.8, gravity: float = GRAVITY) -> Iterator[tuple[float, float]]:
    """Times of impacts and the speed before each, of a ball dropped from rest."""
    time, speed = math.sqrt(2.0 * height / gravity), math.sqrt(2.0 * gravity * height)
    while True:
        yield time, speed
        speed *= restitution
        time += 2.0 * speed / gravity


def ball_rests(height: float = 1.0, restitution: float = 0.8, gravity: float = GRAVITY) -> float:
    """Zeno time: the sum of the geometric series of flights."""
    return math.sqrt(2.0 * height / gravity) * (1.0 + restitution) / (1.0 - restitution)


class RodImpact(NamedTuple):
    """Impulse along the floor and away from it, and the energy lost."""

    along: float
    normal: float
    lost: float


def rod_on_smooth_floor(angle: float = 0.7, speed: float = 2.0, restitution: float = 0.5) -> RodImpact:
    """A uniform rod, m = l = 1, falls without turning at an angle from the floor: (1 + e) v over 1/m + (l cos/2)^2 / J."""
    inverse_mass = 1.0 + 3.0 * math.cos(angle) ** 2
    lost = 0.5 * (1.0 - restitution**2) * speed**2 / inverse_mass
    return RodImpact(0.0, (1.0 + restitution) * speed / inverse_mass, lost)


def rod_sticks(angle: float = 0.7, speed: float = 2.0) -> RodImpact:
    """The same rod whose lower end, left of the middle, sticks: its moment of momentum about that end goes on."""
    rate = 1.5 * speed * math.cos(angle)  # m v (l/2) cos = (m l^2/3) rate, the rod turning down
    after = np.array([0.5 * rate * math.sin(angle), -0.5 * rate * math.cos(angle)])  # of the middle
    return RodImpact(float(after[0]), float(after[1] + speed), 0.5 * speed**2 - rate**2 / 6.0)


class Ladder(NamedTuple):
    """A ladder between smooth wall and floor: where and when it leaves the wall, how fast it turns; when it lies."""

    angle: float
    leaves: float
    rate: float
    flat: float


def ladder(start: float = 1.2, gravity: float = GRAVITY) -> Ladder:
    """A uniform rod, l = 1, from rest: the wall lets go where sin = 2/3 sin(start); then the middle keeps its speed along."""
    angle = math.asin(2.0 / 3.0 * math.sin(start))
    leaves, there = until(
        lambda _, y: [y[1], -1.5 * gravity * math.cos(y[0])], np.array([start, 0.0]), lambda y: y[0] - angle, 5.0, rising=False
    )
    rate = -math.sqrt(3.0 * gravity * (math.sin(start) - math.sin(angle)))

    def on_the_floor(_: float, y: Array) -> list[float]:
        cosine, sine = math.cos(y[0]), math.sin(y[0])
        return [y[1], (0.25 * sine * cosine * y[1] ** 2 - 0.5 * gravity * cosine) / (1.0 / 12.0 + 0.25 * cosine**2)]

    falls, _ = until(on_the_floor, np.array([angle, rate]), lambda y: float(y[0]), 5.0, rising=False)
    assert abs(there[1] - rate) < 1e-11
    return Ladder(angle, leaves, rate, leaves + falls)


# Blocks that rub --------------------------------------------------------------------------------------------------------


def oscillator_rests(
    omega: float = 10.0, mu: float = 0.3, start: float = 0.5, gravity: float = GRAVITY
) -> tuple[float, float]:
    """Time and place where a block on a spring rests: each half swing ends 2 mu g / omega^2 nearer, till friction holds it."""
    band = mu * gravity / omega**2
    place = start
    for swings in count():
        if abs(place) <= band:
            return swings * math.pi / omega, place
        place = -math.copysign(abs(place) - 2.0 * band, place)
    raise AssertionError


class PulledBlock(NamedTuple):
    """Stick and slip of a block that a spring pulls at a steady speed: first slip, how long it slips, and the period."""

    slips: float
    lasts: float
    period: float


def pulled_block(
    mass: float = 1.0,
    stiffness: float = 100.0,
    speed: float = 0.2,
    hold: float = 0.3,
    slip: float = 0.2,
    gravity: float = GRAVITY,
) -> PulledBlock:
    """In the frame of the puller the block oscillates about slip m g / k and enters stick again with the mirrored stretch."""
    omega = math.sqrt(stiffness / mass)
    excess = (hold - slip) * mass * gravity / stiffness  # stretch above the middle where it lets go
    lasts = 2.0 * (math.pi - math.atan(excess * omega / speed)) / omega
    return PulledBlock(hold * mass * gravity / (stiffness * speed), lasts, lasts + 2.0 * excess / speed)


class Thrown(NamedTuple):
    """A block thrown up a slope: when and how far up it stops, and when it is back, or None where friction holds it."""

    stops: float
    place: float
    back: float | None


def thrown_up(slope: float, mu: float = 0.2, speed: float = 3.0, gravity: float = GRAVITY) -> Thrown:
    """Uniform deceleration up, and acceleration down if tan(slope) > mu."""
    pull, rub = gravity * math.sin(slope), mu * gravity * math.cos(slope)
    stops, place = speed / (pull + rub), 0.5 * speed**2 / (pull + rub)
    return Thrown(stops, place, stops + math.sqrt(2.0 * place / (pull - rub)) if pull > rub else None)


# Walkers ----------------------------------------------------------------------------------------------------------------


class Wheel(NamedTuple):
    """Steady rolling of a rimless wheel: rate after an impact, multiplier of the map of squares, time of a step, loss per kg."""

    rate: float
    multiplier: float
    step: float
    lost: float


def rimless_wheel(spokes: int = 8, slope: float = 0.08, length: float = 1.0, gravity: float = GRAVITY) -> Wheel:
    """A mass at the hub: each impact turns the velocity by 2 alpha and keeps its part across the new spoke."""
    half = math.pi / spokes
    keeps = math.cos(2.0 * half) ** 2
    gain = 4.0 * gravity / length * math.sin(half) * math.sin(slope)
    square = keeps * gain / (1.0 - keeps)

    def slowness(angle: float) -> float:
        raised = 2.0 * gravity / length * (math.cos(slope - half) - math.cos(slope + angle))
        return 1.0 / math.sqrt(square + raised)

    step = quad(slowness, -half, half, epsabs=1e-13, epsrel=1e-13)[0]
    return Wheel(math.sqrt(square), keeps, step, 2.0 * gravity * length * math.sin(half) * math.sin(slope))


class Compass(NamedTuple):
    """A walker of two straight legs: masses of hip and leg, place of the leg's mass above the foot and below the hip."""

    hip: float
    leg: float
    above: float
    below: float
    slope: float
    gravity: float

    @property
    def length(self) -> float:
        return self.above + self.below


GOSWAMI = Compass(10.0, 5.0, 0.5, 0.5, math.radians(3.0), GRAVITY)


class Step(NamedTuple):
    """Angles of the new stance and swing leg from the vertical and their rates, after the time of a step; energy lost."""

    state: Array
    time: float
    lost: float


def compass_mass(walker: Compass, apart: float) -> Array:
    """Mass matrix of (stance, swing) about the standing foot; `apart` is the angle between the legs."""
    hip, leg, above, below, _, _ = walker
    length = walker.length
    coupling = -leg * length * below * math.cos(apart)
    return np.array([[(hip + leg) * length**2 + leg * above**2, coupling], [coupling, leg * below**2]])


def compass_field(walker: Compass) -> Field:
    """Motion on one foot, from the double inverted pendulum's equations."""
    hip, leg, above, below, _, gravity = walker
    length = walker.length

    def field(_: float, y: Array) -> list[float]:
        stance, swing, stance_rate, swing_rate = y
        mixed = leg * length * below * math.sin(stance - swing)
        forces = [
            gravity * (hip * length + leg * above + leg * length) * math.sin(stance) + mixed * swing_rate**2,
            -gravity * leg * below * math.sin(swing) - mixed * stance_rate**2,
        ]
        return [stance_rate, swing_rate, *np.linalg.solve(compass_mass(walker, stance - swing), forces)]

    return field


def compass_step(walker: Compass, start: Array) -> Step:
    """A step: till stance + swing = -2 slope with the legs well apart, then the impact on the other foot.

    Moments of momentum stay: of all about the new foot, of the old stance leg about the hip.
    """
    hip, leg, above, below, slope, _ = walker
    length = walker.length
    time, end = until(
        compass_field(walker),
        start,
        lambda y: float(y[0] + y[1] + 2.0 * slope),
        6.0,
        rising=False,
        counts=lambda y: float(y[1] - y[0]) - 0.2,
    )
    stance, swing, *before = end
    cosine = math.cos(stance - swing)
    moment = (hip * length**2 + 2.0 * leg * above * length) * cosine - leg * above * below
    held = np.array([moment * before[0] - leg * above * below * before[1], -leg * above * below * before[0]])
    after = np.array(
        [
            [(hip + leg) * length**2 + leg * above**2 - leg * below * length * cosine, leg * below * (below - length * cosine)],
            [-leg * below * length * cosine, leg * below**2],
        ]
    )
    rates = np.linalg.solve(after, held)
    energies = [0.5 * float(w @ compass_mass(walker, stance - swing) @ w) for w in (np.array(before), rates)]
    return Step(np.array([swing, stance, *rates]), time, energies[0] - energies[1])


class Gait(NamedTuple):
    """A step that repeats: state after the impact (stance, swing and their rates), its time, its length, what it loses."""

    state: Array
    time: float
    length: float
    lost: float


def compass_gait(walker: Compass = GOSWAMI, guess: tuple[float, float, float] = (0.2187, -1.0924, -0.3774)) -> Gait:
    """Newton's method on (stance, rates): the swing leg follows from the ground."""

    def start(u: Array) -> Array:
        return np.array([u[0], -2.0 * walker.slope - u[0], u[1], u[2]])

    def misses(u: Array) -> Array:
        return compass_step(walker, start(u)).state[[0, 2, 3]] - u

    u = np.array(guess)
    for _ in range(4):
        h = 1e-6
        slopes = np.column_stack([(misses(u + h * e) - misses(u - h * e)) / (2.0 * h) for e in np.eye(3)])
        u = u - np.linalg.solve(slopes, misses(u))
    step = compass_step(walker, start(u))
    return Gait(start(u), step.time, 2.0 * walker.length * math.sin(abs(u[0] + walker.slope)), step.lost)


class SimplestGait(NamedTuple):
    """The long gait of the simplest walker (g = l = 1): stance angle from the slope's normal, its rate, the time of a step."""

    angle: float
    rate: float
    time: float


def simplest_walker(slope: float = 0.009) -> SimplestGait:
    """Feet without mass: the hip is an inverted pendulum, the swing leg a pendulum on it, and an impact keeps cos(2 angle)."""

    def field(_: float, y: Array) -> list[float]:
        lean = math.sin(y[0] - slope)
        return [y[1], lean, y[3], lean + math.sin(y[2]) * (y[1] ** 2 - math.cos(y[0] - slope))]

    def step(u: Array) -> tuple[Array, float]:
        start = np.array([u[0], u[1], 2.0 * u[0], (1.0 - math.cos(2.0 * u[0])) * u[1]])
        time, end = until(field, start, lambda y: float(y[2] - 2.0 * y[0]), 6.0, rising=True, counts=lambda y: -float(y[0]) - 0.1)
        return np.array([-end[0], math.cos(2.0 * end[0]) * end[1]]), time

    u = np.array([0.2003, -0.1998])
    for _ in range(5):
        h = 1e-5
        slopes = np.column_stack([(step(u + h * e)[0] - step(u - h * e)[0]) / (2.0 * h) for e in np.eye(2)])
        u = u - np.linalg.solve(slopes - np.eye(2), step(u)[0] - u)
    return SimplestGait(float(u[0]), float(u[1]), step(u)[1])


def first_step_with_feet(mass: float, slope: float = 0.009) -> float:
    """Time of the first step from the simplest walker's gait if each foot has a mass, as a part of the hip's."""
    angle, rate, _ = simplest_walker(slope)
    start = np.array([angle - slope, -angle - slope, rate, math.cos(2.0 * angle) * rate])
    return compass_step(Compass(1.0, mass, 0.0, 1.0, slope, 1.0), start).time


# A mass on springs ------------------------------------------------------------------------------------------------------


class Stride(NamedTuple):
    """From apex to apex of a running mass: height and speed of the next apex, time on the ground and in the air."""

    height: float
    speed: float
    contact: float
    flight: float


class Runner(NamedTuple):
    """A mass on a massless spring, its angle of attack, and the energy of it all."""

    mass: float = 80.0
    stiffness: float = 20_000.0
    rest: float = 1.0
    attack: float = math.radians(68.0)
    energy: float = 80.0 * GRAVITY + 1000.0
    gravity: float = GRAVITY


def stride(runner: Runner, height: float) -> Stride:
    """One stride, on the ground in polar coordinates about the foot."""
    mass, stiffness, rest, attack, energy, gravity = runner
    speed = math.sqrt(2.0 / mass * (energy - mass * gravity * height))
    fall = height - rest * math.sin(attack)
    down = math.sqrt(2.0 * gravity * fall)
    angle = math.pi - attack  # of foot -> mass

    def field(_: float, y: Array) -> list[float]:
        r, a, r_rate, a_rate = y
        push = stiffness / mass * (rest - r)
        turning = -(2.0 * r_rate * a_rate + gravity * math.cos(a)) / r
        return [r_rate, a_rate, r * a_rate**2 - gravity * math.sin(a) + push, turning]

    radial = speed * math.cos(angle) - down * math.sin(angle)
    turning = (-speed * math.sin(angle) - down * math.cos(angle)) / rest
    contact, end = until(field, np.array([rest, angle, radial, turning]), lambda y: float(y[0] - rest), 1.0, rising=True)
    r, a, r_rate, a_rate = end
    along = r_rate * math.cos(a) - r * a_rate * math.sin(a)
    up = r_rate * math.sin(a) + r * a_rate * math.cos(a)
    return Stride(r * math.sin(a) + up**2 / (2.0 * gravity), along, contact, math.sqrt(2.0 * fall / gravity) + up / gravity)


def steady_run(runner: Runner | None = None, between: tuple[float, float] | None = None) -> tuple[Stride, float]:
    """The stride that repeats, and the slope of its map."""
    runner = runner or Runner()
    low, high = between or (runner.rest * math.sin(runner.attack) + 1e-3, 1.0)
    height = brentq(lambda y: stride(runner, y).height - y, low, high, xtol=1e-15, rtol=1e-15)
    h = 1e-5
    return stride(runner, height), (stride(runner, height + h).height - stride(runner, height - h).height) / (2.0 * h)


class WalkingStep(NamedTuple):
    """From a vertical leg to the next: height and speed there, times on one foot, on both, on one; length."""

    height: float
    speed: float
    single: float
    double: float
    rest: float
    length: float
    vertical_speed: float

    @property
    def time(self) -> float:
        return self.single + self.double + self.rest


def walking_step(height: float, walker: Runner, rising: float = 0.0) -> WalkingStep:
    """One step from a leg at the vertical with a vertical speed."""
    mass, stiffness, rest, attack, energy, gravity = walker
    moving = 2.0 / mass * (energy - mass * gravity * height - 0.5 * stiffness * (rest - height) ** 2)
    speed = math.sqrt(moving - rising**2)

    def on(*feet: float) -> Field:
        def field(_: float, s: Array) -> list[float]:
            ax, ay = 0.0, -gravity
            for foot in feet:
                length = math.hypot(s[0] - foot, s[1])
                push = stiffness / mass * (rest / length - 1.0)
                ax, ay = ax + push * (s[0] - foot), ay + push * s[1]
            return [s[2], s[3], ax, ay]

        return field

    start = np.array([0.0, height, speed, rising])
    single, s = until(on(0.0), start, lambda s: s[1] - rest * math.sin(attack), 1.5, rising=False)
    foot = float(s[0]) + rest * math.cos(attack)
    double, s = until(on(0.0, foot), s, lambda s: math.hypot(s[0], s[1]) - rest, 1.5, rising=True)
    last, s = until(on(foot), s, lambda s: s[0] - foot, 1.5, rising=True)
    return WalkingStep(float(s[1]), float(s[2]), single, double, last, foot, float(s[3]))


def steady_walk(walker: Runner | None = None, between: tuple[float, float] = (0.969, 0.973)) -> WalkingStep:
    """The symmetric step that repeats: vertical speed zero at the next vertical leg too."""
    walker = walker or Runner(stiffness=14_000.0, attack=math.radians(69.0), energy=816.0)
    height = brentq(lambda y: walking_step(y, walker).vertical_speed, *between, xtol=1e-15, rtol=1e-15)
    return walking_step(height, walker)


def jump(
    middle: float = 0.9, amplitude: float = 0.12, frequency: float = 12.0, gravity: float = GRAVITY
) -> tuple[float, float]:
    """Take-off, time and speed, of a mass on a massless leg of length middle - amplitude cos(frequency t): l'' = -g."""
    angle = math.acos(-gravity / (amplitude * frequency**2))
    return angle / frequency, amplitude * frequency * math.sin(angle)


# Skis -------------------------------------------------------------------------------------------------------------------


class Landing(NamedTuple):
    """Speed along the ski after landing, impulse across the edge, and the energy lost."""

    speed: float
    edge: float
    lost: float


def ski_lands(mass: float = 80.0, speed: float = 10.0, off: float = 0.2, down: float = 3.0) -> Landing:
    """The edge takes the velocity across the ski, the snow the one into it."""
    across = speed * math.sin(off)
    return Landing(speed * math.cos(off), mass * across, 0.5 * mass * (across**2 + down**2))


class Skate(NamedTuple):
    """When the edge of a turning skate lets go and holds again, and its velocity (down the slope, across it) then."""

    lets_go: float
    holds: float
    velocity: Array


def skate(slope: float = 0.3, rate: float = 1.0, hold: float = 0.4, gravity: float = GRAVITY) -> Skate:
    """From rest, heading down the slope and turning steadily: the edge needs 2 m g sin(slope) sin(heading).

    Beyond hold times the normal force it skids under that force: in the frame of the slope both accelerations integrate. It holds
    again where the velocity is along the skate.
    """
    pull, most = gravity * math.sin(slope), hold * gravity * math.cos(slope)
    heading = math.asin(most / (2.0 * pull))
    speed = pull / rate * math.sin(heading)
    start = speed * np.array([math.cos(heading), math.sin(heading)])

    def velocity(angle: float) -> Array:
        turned = np.array([math.cos(angle) - math.cos(heading), math.sin(angle) - math.sin(heading)])
        return start + np.array([pull * (angle - heading) / rate, 0.0]) + most / rate * turned

    def across(angle: float) -> float:
        return float(velocity(angle) @ np.array([-math.sin(angle), math.cos(angle)]))

    tries = np.linspace(heading + 0.05, heading + 6.0, 600)
    values = [across(angle) for angle in tries]
    first = next(k for k in range(len(tries) - 1) if values[k] < 0.0 <= values[k + 1])
    again = brentq(across, tries[first], tries[first + 1], xtol=1e-15, rtol=1e-15)
    return Skate(heading / rate, again / rate, velocity(again))


def skid_stops(speed: float = 2.0, mu: float = 0.4, gravity: float = GRAVITY) -> float:
    """Time in which skidding ends a speed across the ski."""
    return speed / (mu * gravity)
