"""heyoka: a chain's equations as expressions that LLVM compiles, alone or as a Taylor series method; no poles.

What a compiled core would bring: the equations alone take the place of the plain loop's right-hand side, under SciPy's DOP853;
the series method is heyoka's own, with an order for each tolerance, so each is compiled by itself. `NOTES` says how long.

State of a link: its direction d and d', the free lengths and their rates. What hangs on a hinge asks for the force A a + f there,
a being the hinge's acceleration less gravity's: A and f pass from the last link to the first, accelerations back. The knife edge
is eliminated.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import heyoka as hy
import numpy as np
from peers.chain import Array, Chain, ChainLink, Outcome, Run, UnsupportedError, read_chain
from scipy.integrate import solve_ivp

SETTINGS = tuple(10.0 ** -(k / 2) for k in range(4, 25))  # rtol; atol a tenth of it
SERIES = tuple(10.0**-k for k in range(3, 16, 2))  # tolerance of the series
LINKS = 8  # of the series
STRAIGHT = 800  # links times order squared; beyond, code without loops compiles for more than half a minute
NOTES: list[str] = []  # of the scene prepared last

Back = Callable[[Any], tuple[list[Any], Any]]  # of a hinge's acceleration: rates of the link's state, and the next hinge's


class Moving(NamedTuple):
    """State of a link as expressions: d and d' (3,), lengths of its segments and their rates."""

    d: Any
    u: Any
    lower: Any
    lower_rate: Any
    upper: Any
    upper_rate: Any


class Hanging(NamedTuple):
    """What a hinge feels: A (3, 3) and f (3,); A's determinant across the link, and its value along it."""

    A: Any
    f: Any
    across: Any
    along: float


def prepare(scene: dict[str, Any], duration: float) -> dict[str, tuple[tuple[float, ...], Run]]:
    """Compile the equations, and of short chains a series for every tolerance; return runs of a tolerance."""
    NOTES.clear()
    hy.llvm_state.set_diskcache_enabled(False)  # else the next session seems to compile at once
    chain = read_chain(scene)
    system, start = equations(chain)
    runs: dict[str, tuple[tuple[float, ...], Run]] = {}
    if len(chain.links) <= LINKS:
        runs["heyoka, Taylor series compiled by LLVM"] = (SERIES, series(chain, system, start, duration))
    else:
        NOTES.append(f"heyoka: no series of more than {LINKS} links: 50 compile for minutes, or with loops run slowly")
    began = time.perf_counter()
    compiled = hy.cfunc([rate for _, rate in system], [variable for variable, _ in system], compact_mode=False)
    NOTES.append(f"heyoka: compiling the equations took {time.perf_counter() - began:.1f} s")

    def run(rtol: float) -> Outcome:
        answer = solve_ivp(
            lambda t, y: compiled(y), (0.0, duration), start, method="DOP853", rtol=rtol, atol=0.1 * rtol, t_eval=(duration,)
        )
        if not answer.success:
            raise ArithmeticError(answer.message)
        return Outcome(points(chain, answer.y[:, -1]), int(answer.nfev), None)

    return {**runs, "heyoka, equations compiled by LLVM, DOP853": (SETTINGS, run)}


def series(chain: Chain, system: list[tuple[Any, Any]], start: Array, duration: float) -> Run:
    """Compile a series for every tolerance; return a run of a tolerance."""
    integrators, seconds, looped = {}, [], []
    for tolerance in SERIES:
        order = math.ceil(1.0 - 0.5 * math.log(tolerance))
        compact = len(chain.links) * order**2 > STRAIGHT
        began = time.perf_counter()
        integrators[tolerance] = hy.taylor_adaptive(system, start, tol=tolerance, compact_mode=compact)
        seconds.append(time.perf_counter() - began)
        looped += [tolerance] if compact else []
    note = f"heyoka: compiling the series took {min(seconds):.1f} to {max(seconds):.1f} s a tolerance"
    NOTES.append(note + (f"; from {looped[0]:g} on with loops (compact mode), which run slower" if looped else ""))

    def run(tolerance: float) -> Outcome:
        integrator = integrators[tolerance]
        integrator.time, integrator.state[:] = 0.0, start
        status, _, _, steps, *_ = integrator.propagate_until(duration)
        if status != hy.taylor_outcome.time_limit:
            raise ArithmeticError(f"ended with {status}")
        return Outcome(points(chain, integrator.state), None, steps)

    return run


def equations(chain: Chain) -> tuple[list[tuple[Any, Any]], Array]:
    """Return the state's variables with their rates, and the start."""
    variables: list[Any] = []
    start: list[float] = []

    def variable(name: str, value: float) -> Any:
        variables.append(hy.make_vars(name))
        start.append(value)
        return variables[-1]

    ski = [variable(name, getattr(chain, name)) for name in ("x", "y", "phi0", "speed", "phi0_dot")] if chain.on_ski else []
    state = []
    for i, link in enumerate(chain.links):
        d = link.direction()[0]
        entries: list[Any] = [
            np.array([variable(f"{name}{axis}{i}", value) for axis, value in zip("xyz", vector, strict=True)])
            for name, vector in (("d", d), ("u", np.cross(link.omega(), d)))
        ]
        for name, leg in (("lower", link.lower), ("upper", link.upper)):
            pair = ((f"{name}{i}", leg.start), (f"{name}_rate{i}", leg.rate))
            entries += [variable(*entry) for entry in pair] if leg.free else [leg.start, 0.0]
        state.append(Moving(*entries))
    hanging, backs = Hanging(np.full((3, 3), 0.0, dtype=object), np.full(3, 0.0, dtype=object), 0.0, 0.0), []
    for i, (link, moving) in reversed(list(enumerate(zip(chain.links, state, strict=True)))):
        if link.upper.free:
            hanging, back = inward(link, moving, hanging)
        elif link.tip_mass or i + 1 < len(state):
            raise UnsupportedError("written for masses that hang on springs")
        else:
            hanging, back = last(link, moving)
        backs.append(back)
    rates: list[Any] = []
    acceleration: Any = -np.array(chain.gravity, dtype=object)
    if chain.on_ski:
        rates, acceleration = ski_rates(chain, ski, hanging)
    for back in reversed(backs):
        more, acceleration = back(acceleration)
        rates += more
    return list(zip(variables, rates, strict=True)), np.array(start)


def inward(link: ChainLink, moving: Moving, hanging: Hanging) -> tuple[Hanging, Back]:
    """Pass a link with a free upper segment towards the base: what its lower hinge feels, and the way back.

    Across d the tip's acceleration s obeys (J + tip^2 T) s = K a + h, with T what the tip feels less what the upper segment gives
    way to. T d = 0, so the inverse follows from T's trace and its determinant across d; A = (far T + m inertia)(J + tip^2 T)^-1.
    """
    d, u, lower, lower_rate, upper, upper_rate = moving
    m, inertia, mu, unit = link.mass, link.inertia, link.tip_mass, np.eye(3, dtype=object)
    centre, tip, beyond = lower + link.com, lower + link.length + upper, link.length - link.com + upper
    push, pull = (leg.stiffness * (leg.rest - length) for leg, length in ((link.upper, upper), (link.lower, lower)))
    turning, fanning = u @ u, 2.0 * (lower_rate + upper_rate)

    heavy = hanging.A + mu * unit
    b = heavy @ d
    stiff = d @ b
    T = heavy - outer(b / stiff, b)
    trace = T.trace()
    felt = hanging.A.trace() - hanging.along
    determinant = (hanging.across + mu * felt + mu * mu) * (hanging.along + mu) / stiff
    excess = push - d @ hanging.f
    load = hanging.f + (excess / stiff) * b - push * d

    J, far, K = inertia + m * centre * centre, inertia + m * beyond * beyond, inertia - m * centre * beyond
    square = tip * tip
    G = J + square * trace
    D = J * G + square * square * determinant
    over, under = G / D, square / D  # (J + tip^2 T)^-1 = over - under T across d
    h = (J * fanning - 2.0 * m * tip * centre * lower_rate) * u - square * load
    s0 = over * h - under * (T @ h)
    alpha, beta = K * K / D, m * inertia * over + far * under * determinant
    A = alpha * T + beta * unit - outer(beta * d, d)
    f = (K / square) * (fanning * u - s0) + (2.0 * m * beyond * lower_rate / tip) * u
    across = (far * far * determinant + m * inertia * (far * trace) + (m * inertia) ** 2) / D
    if link.lower.free:
        out = Hanging(A, f + pull * d, across, 0.0)
    else:
        out = Hanging(A + m * outer(d, d), f + (push - m * centre * turning) * d, across, m)

    def back(a: Any) -> tuple[list[Any], Any]:
        along = d @ a
        flat = a - along * d
        s = s0 + (K * over) * flat - (K * under) * (T @ a)
        rates = [*u, *((s - flat - fanning * u) / tip - turning * d)]
        out_of_hinge = (excess - b @ s) / stiff  # the tip's acceleration along d
        if link.lower.free:
            parting = (pull - push) / m
            rates += [lower_rate, parting + centre * turning - along]
            rates += [upper_rate, out_of_hinge - parting + beyond * turning]
        else:
            rates += [upper_rate, out_of_hinge - along + tip * turning]
        return rates, s + out_of_hinge * d

    return out, back


def last(link: ChainLink, moving: Moving) -> tuple[Hanging, Back]:
    """Begin with a rod at whose end nothing hangs: what its hinge feels, and the way back."""
    d, u, lower, lower_rate, *_ = moving
    m, centre, turning = link.mass, lower + link.com, u @ u
    J = link.inertia + m * centre * centre
    felt = m * link.inertia / J
    along = 0.0 if link.lower.free else m
    pull = link.lower.stiffness * (link.lower.rest - lower) if link.lower.free else -m * centre * turning
    A = felt * np.eye(3, dtype=object) - outer((felt - along) * d, d)
    f = (2.0 * felt * lower_rate) * u + pull * d

    def back(a: Any) -> tuple[list[Any], Any]:
        parallel = d @ a
        rates = [*u, *(-(m * centre / J) * (a - parallel * d + 2.0 * lower_rate * u) - turning * d)]
        return rates + ([lower_rate, pull / m + centre * turning - parallel] if link.lower.free else []), None

    return Hanging(A, f, felt * felt, along), back


def ski_rates(chain: Chain, ski: list[Any], hanging: Hanging) -> tuple[list[Any], Any]:
    """Rates of x, y, heading, speed and turn, and point A's acceleration less gravity's."""
    _, _, heading, speed, turn = ski
    cosine, sine = hy.cos(heading), hy.sin(heading)
    ahead, left = np.array([cosine, sine, 0.0]), np.array([-sine, cosine, 0.0])
    gravity = np.array(chain.gravity, dtype=object)
    m, c = chain.ski_mass, chain.com_offset
    known = speed * turn * left - gravity
    force = m * (c * turn * turn + gravity @ ahead) - ahead @ (hanging.A @ known + hanging.f)
    speed_rate = force / (ahead @ (hanging.A @ ahead) + m)
    turn_rate = -(m * c / (chain.ski_inertia + m * c * c)) * (left @ known)
    return [speed * cosine, speed * sine, turn, speed_rate, turn_rate], known + speed_rate * ahead


def outer(a: Any, b: Any) -> Any:
    """a b' (3, 3) of parallel vectors; equal entries are one expression, as heyoka does not see that they are equal."""
    product = np.outer(a, b)
    for row, column in ((1, 0), (2, 0), (2, 1)):
        product[row, column] = product[column, row]
    return product


def points(chain: Chain, state: Array) -> Array:
    """Points (1 + n, 3) of a state."""
    found, at = [np.zeros(3)], 0
    if chain.on_ski:
        found, at = [np.array([state[0], state[1], 0.0])], 5
    for link in chain.links:
        d, length, at = state[at : at + 3], link.length, at + 6
        for leg in (link.lower, link.upper):
            length += state[at] if leg.free else leg.start
            at += 2 * leg.free
        found.append(found[-1] + length * d)
    return np.array(found)
