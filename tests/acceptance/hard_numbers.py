"""Hard numbers: mass ratios, stiffness, long runs, chaos, input that is not finite."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin

import vlmb
from tests.acceptance.hard_finding import (
    ANY_LENGTH,
    PIVOT,
    SKI,
    TIGHT,
    Array,
    Finding,
    Table,
    judged,
    marched,
    rod,
    run,
    scene,
    tips,
    witnessed,
)
from tests.acceptance.naive import paper_chart, pin_integrate
from tests.reference import exact
from tests.reference.two_rods import TwoRods, growth_rate
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

BAD = (math.inf, -math.inf, math.nan, 5e-324, 1e-310, 1.7e308)


def in_the_plane(way: vlmb.Trajectory) -> Array:
    """Tips (samples, links, 2) [m], horizontal and up."""
    return tips(way)[:, :, [0, 2]]


def ratios(quick: bool = False) -> list[Finding]:
    """4. Mass ratios to 1e8, tip mass 1e-9."""
    found, times = [], np.linspace(0.0, 1.0, 21)
    for inner, outer in ((1e4, 1e-4), (1e-4, 1e4)):
        rods = TwoRods(masses=(inner, outer))
        flat = rods.positions(rods.motion([0.3, -0.4], [0.0, 0.0], times.tolist(), 25))
        reference = np.insert(flat, 1, 0.0, axis=2)
        case = vlmb.Scene.from_dict(rods.scene([0.3, -0.4], [0.0, 0.0], run=TIGHT))
        what, naive = f"two rods of {inner:g} and {outer:g} kg", ""
        if not quick:
            chart = paper_chart(case, times.tolist())
            naive = f"angles: {chart.told(chart.error(reference))}"
        found.append(judged(what, "ball joints", run(case, times, method="dop853"), reference, 1e-7, naive))
    times = np.linspace(0.0, 0.2 if quick else 0.5, 21)
    for k, method, limit in ((1e-6, "adams", 1e-9), (1e-3, "adams", 1e-9), (10.0, "adams", 1e-7)):
        light = rod(0.5, 2.0, lower={"length": 0.3, "stiffness": 200.0, "limits": ANY_LENGTH}, tip_mass=1e-9)
        light["upper"] = {"length": 0.2, "stiffness": k, "limits": ANY_LENGTH}
        case = scene(PIVOT, [light], start={"psi1": 0.3, "phi1_dot": 1.0})
        if k == 10.0:
            times = np.linspace(0.0, 0.01 if quick else 0.02, 11)
        found.append(
            judged(
                f"tip mass 1e-9 kg on a spring of {k:g} N/m",
                method,
                run(case, times, method=method),
                witnessed(case, times, 1e-11),
                limit,
            )
        )
    return found


def stiff_leg(k: float, c: float = 0.0) -> vlmb.Scene:
    """A rider of 80 kg straight above the hinge on a spring of stiffness k [N/m], let go 1 mm above its rest."""
    leg = rod(0.5, 80.0, lower={"length": 0.501, "stiffness": k, "damping": c, "rest": 0.5})
    return scene(PIVOT, [leg], start={"psi1": -math.pi / 2})


def stiff(quick: bool = False) -> list[Finding]:
    """6. Stiff legs, k to 1e8 N/m, and damped ones."""
    found, times = [], np.linspace(0.0, 0.5, 26)
    for k, c, method in (
        (1e4, 0.0, "adams"),
        (1e6, 0.0, "adams"),
        (1e8, 0.0, "adams"),
        (1e8, 0.0, "dop853"),
        (1e8, 1e5, "adams"),
        (1e8, 1e5, "bdf"),
        (1e8, 1e5, "radau"),
    ):
        case = stiff_leg(k, c)
        length = exact.vertical_oscillator(times, 80.0, k, 0.5, 0.501, damping=c, up=False)["xi1_1"]
        line = np.zeros((26, 1, 3))
        line[:, 0, 2] = -length - 0.5
        clumsy = pin_integrate(case, times.tolist(), 2e-3)
        options: Table = {"rtol": 1e-7, "atol": 1e-10} if method == "radau" else {}
        way = run(case, times, method=method, **options)
        damped = f", damped {c:g} N s/m" if c else ""
        naive = f"RK4 through pin.integrate, 2 ms: {clumsy.told(clumsy.error(line))}"
        found.append(
            judged(
                f"leg of {k:g} N/m{damped}, {method}", f"{way.stats['rhs_evaluations']} right-hand sides", way, line, 1e-8, naive
            )
        )
    return found


def turning_skier() -> vlmb.Scene:
    """A skier on a stiff leg held upright by a spring to the surface normal, who goes round on level snow; nothing is lost."""
    leg = rod(0.5, 30.0, lower={"length": 0.3, "stiffness": 4e4}, tip_mass=40.0)
    upright = [{"between": ["base", "link1"], "stiffness": 4000.0}]
    start = {"speed": 3.0, "phi0_dot": 0.6, "psi1": 1.5}
    return scene(SKI | {"inertia": 2.0}, [leg], forces=upright, start=start)


def march(
    case: vlmb.Scene, method: str, step: float, steps: int, knife_edge: str = "reduction", gain: float = 0.0
) -> dict[str, Any]:
    """Fixed steps from the start: largest relative error of the energy and its drift from the first tenth of the run to the last.

    Also the largest error of the edge [m/s] and of quaternion norms, `turns` of the heading, the last condition number.
    """
    mechanism = vlmb.build(case)
    workspace = make_system(mechanism, knife_edge=knife_edge, gain=gain).workspace()
    y = workspace.pack(consistent_start(make_system(mechanism)).state)
    times = [step * steps * k / 1000.0 for k in range(1, 1001)]
    states = itertools.chain([y], marched(method, workspace.rhs, y, step, times))
    layout, model, data = mechanism.layout, mechanism.model, workspace.frames.data
    balls = [slice(link.q, link.q + 4) for link in layout.links]
    errors, edge, norms, turned, first = [], 0.0, 0.0, 0.0, math.nan
    heading = math.atan2(y[3], y[2])
    for k, y in enumerate(states):
        q, v = workspace.unpack(0.0, y)
        energy = pin.computeKineticEnergy(model, data, q, v) + pin.computePotentialEnergy(model, data, q)
        energy += float(vlmb.system.springs.spring_energy(mechanism, q[None])[0])
        pin.crba(model, data, q, pin.Convention.WORLD)
        energy += sum(spring.energy(workspace.frames, q) for spring in workspace.system.direction_springs)
        first = energy if k == 0 else first
        errors.append(energy / first - 1.0)
        edge = max(edge, abs(float(v[1])))
        norms = max([norms, abs(math.hypot(y[2], y[3]) - 1.0), *(abs(float(np.linalg.norm(y[at])) - 1.0) for at in balls)])
        now = math.atan2(q[3], q[2])
        turned += math.remainder(now - heading, math.tau)
        heading = now
    share = np.array(errors)
    return {
        "energy": float(np.abs(share).max()), "drift": float(share[-100:].mean() - share[:100].mean()), "edge": edge,
        "norms": norms, "turns": abs(turned) / math.tau, "condition": workspace.diagnostics.conditioning(y[: layout.nq])[0],
    }  # fmt: skip


def long_run(quick: bool = False) -> list[Finding]:
    """11. A million steps of a turning skier."""
    steps, found = 2_000, []
    try:
        clumsy = march(turning_skier(), "euler", 2e-3, 1000, "multiplier")
        euler = f"explicit Euler, 1000 steps: energy off by {clumsy['energy']:.1e}, edge {clumsy['edge']:.1e} m/s"
    except vlmb.VlmbError as error:
        euler = f"explicit Euler does not last 1000 steps: {error}"
    for method, edge, gain in (
        ("rk4", "reduction", 0.0),
        ("gauss", "reduction", 0.0),
        ("rk4", "multiplier", 0.0),
        ("rk4", "multiplier", 5.0),
    ):
        count = 500 * steps if not quick else 5 * steps if (method, edge) == ("rk4", "reduction") else steps
        now = march(turning_skier(), method, 2e-3, count, edge, gain)
        what = f"{count} steps of 2 ms, {method}, {edge}{f' with gain {gain:g}/s' if edge == 'multiplier' else ''}"
        done = f"{now['turns']:.0f} turns; energy drifts by {now['drift']:.1e}, quaternion norms by {now['norms']:.1e}"
        limit = 1e-6 if method == "gauss" else 1e-3
        found.append(
            Finding(
                what, done, now["energy"], "of the energy", limit, now["edge"], now["condition"], naive=euler if not found else ""
            )
        )
    return found


def chaos(quick: bool = False) -> list[Finding]:
    """13. A chaotic two-link swing against 30 digits."""
    rods, end = TwoRods(), 4.0 if quick else 16.0
    times = np.linspace(0.0, end, int(20 * end) + 1)
    psi = [1.0, 0.5]
    states = rods.motion(psi, [0.0, 0.0], times.tolist(), 30)
    beside = rods.motion([psi[0] + 2.0**-40, psi[1]], [0.0, 0.0], times.tolist(), 30)
    apart = np.array([max(abs(float(a - b)) for a, b in zip(x, y, strict=True)) for x, y in zip(states, beside, strict=True)])
    grows = growth_rate(apart[10:], times[10:])
    reference = np.insert(rods.positions(states), 1, 0.0, axis=2)
    clumsy_scene = vlmb.Scene.from_dict(rods.scene(psi, [0.0, 0.0], run=TIGHT))
    clumsy = pin_integrate(clumsy_scene, times.tolist(), 1e-3)
    lasted = agrees(times, np.abs(clumsy.tips - reference).max(axis=(1, 2)))
    naive = f"RK4 through pin.integrate, 1 ms: agrees to 1e-3 m until {lasted:.1f} s"
    found = []
    for plane in (False, True):
        for method, rtol in (("dop853", 1e-7), ("dop853", 1e-13), ("adams", 1e-13)):
            case = vlmb.Scene.from_dict(rods.scene(psi, [0.0, 0.0], plane=plane, run=TIGHT))
            way = run(case, times, method=method, rtol=rtol, atol=0.1 * rtol)
            error = np.abs(tips(way) - reference).max(axis=(1, 2))
            until = agrees(times, error)
            before = times <= math.log(1e-6 / rtol) / grows  # until then a thousand times rtol has not grown to 1e-3 m
            what = f"{'plane' if plane else 'ball joints'}, {method}, rtol {rtol:g}"
            done = (
                f"agrees to 1e-3 m until {until:.1f} s, predicted {times[before][-1]:.1f} s at least; grows as exp({grows:.2g} t)"
            )
            said = "" if way.status == "finished" else way.message
            off = float(np.abs(way["balance"]).max())
            found.append(Finding(what, done, float(error[before].max()), limit=1e-3, residual=off, said=said, naive=naive))
            naive = ""
    return found


def agrees(times: Array, error: Array, limit: float = 1e-3) -> float:
    """Time [s] until which an error stays below a limit."""
    beyond = np.flatnonzero(~(error < limit))
    return float(times[beyond[0] - 1] if len(beyond) else times[-1])


def full_scene() -> Table:
    """A scene that uses every kind of number a scene may have."""
    segment = {"length": 0.25, "stiffness": 3000.0, "damping": 20.0, "rest": 0.25, "limits": [0.05, 0.8]}
    legs = {
        "name": "legs",
        "rod": {"length": 0.5, "mass": 30.0, "com": 0.2, "inertia": 0.8},
        "lower": segment,
        "upper": dict(segment),
        "tip_mass": 4.0,
    }
    trunk = {"name": "trunk", "rod": {"length": 0.5, "mass": 30.0}, "lower": {"length": 0.1, "motion": "fixed"}, "tip_mass": 5.0}
    spring = {"between": ["base", "legs"], "stiffness": 3000.0, "damping": 100.0, "rest": 0.4}
    start = {
        "x": 0.1,
        "y": 0.1,
        "phi0": 0.3,
        "phi1": 0.3,
        "psi1": 1.2,
        "psi2": 1.0,
        "xi1_1": 0.25,
        "speed": 3.0,
        "phi1_dot": 0.2,
        "xi1_1_dot": 0.1,
    }
    programme = {
        "constraints": ["psi1 = A"],
        "controls": ["M_psi1"],
        "frequency": 5.0,
        "damping_ratio": 1.0,
        "weights": {"M_psi1": 1.0},
    }
    settings = {"duration": 0.05, "rtol": 1e-6, "atol": 1e-8, "samples": 60.0, "gain": 5.0, "step": 1e-3}
    return {
        "gravity": 9.81, "slope": 0.1, "base": dict(SKI, com_offset=0.1), "links": [legs, trunk],
        "forces": [{"on": "M_phi0", "law": 1.0}, spring], "start": start, "parameters": {"A": 1.2},
        "programme": programme, "run": settings,
    }  # fmt: skip


def numbers_of(data: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Every number in nested data: its path, its container and its key."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        where = f"{path}.{key}" if path else str(key)
        if isinstance(value, (dict, list)):
            yield from numbers_of(value, where)
        elif isinstance(value, float):
            yield where, data, key


def outcome_of(attempt: Any) -> str:
    """`named` for an error of ours, `finite` for a run without NaN, otherwise what went wrong."""
    try:
        answer = attempt()
    except vlmb.VlmbError as error:
        return "named" if str(error) else "an error without a word"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    if not isinstance(answer, vlmb.Trajectory):
        return f"accepted: {answer!r}"
    return (
        "finite" if np.isfinite(answer.q).all() and np.isfinite(answer.v).all() and np.isfinite(answer["energy"]).all() else "NaN"
    )


def bad_input(quick: bool = False) -> list[Finding]:
    """15. Infinities, NaN and denormals in every input."""
    wrong: list[str] = []
    count = {"named": 0, "finite": 0}

    def note(where: str, attempt: Any) -> None:
        outcome = outcome_of(attempt)
        if outcome in count:
            count[outcome] += 1
        else:
            wrong.append(f"{where}: {outcome}")

    def report(what: str) -> Finding:
        done = f"{count['named']} named, {count['finite']} run to finite numbers"
        done = "; ".join([done, *wrong])[:400]
        found = Finding(what, done, float(len(wrong)), "inputs without a word", 0.0)
        wrong.clear()
        count.update(named=0, finite=0)
        return found

    table = full_scene()
    for where, container, key in list(numbers_of(table)):
        good = container[key]
        for value in BAD:
            container[key] = value
            note(f"{where} = {value}", lambda: vlmb.simulate(vlmb.Scene.from_dict(table)))
        container[key] = good
    found = [report("every number of a scene")]
    case = vlmb.Scene.from_dict(table)
    for name in ("duration", "rtol", "atol", "step", "gain"):
        for value in BAD:
            note(f"{name} = {value}", lambda name=name, value=value: vlmb.simulate(case, **{"duration": 0.05, name: value}))
    for value in BAD:
        note(f"t_eval {value}", lambda value=value: vlmb.simulate(case, t_eval=[0.0, value]))
    found.append(report("every argument of simulate"))
    mechanism = vlmb.build(case)
    posture = mechanism.coordinates(consistent_start(make_system(mechanism)).state)
    values = {name: posture[name] for name in mechanism.coordinate_names}
    for name in values:
        for value in BAD[:3]:
            note(f"state {name} = {value}", lambda name=name, value=value: mechanism.state(values | {name: value}))
            note(f"state {name}_dot = {value}", lambda name=name, value=value: mechanism.state(values, {f"{name}_dot": value}))
            note(
                f"equations {name} = {value}",
                lambda name=name, value=value: vlmb.equations_of_motion(mechanism, values | {name: value}),
            )
            note(
                f"equations {name}_dot = {value}",
                lambda name=name, value=value: vlmb.equations_of_motion(mechanism, values, {f"{name}_dot": value}),
            )
    found.append(report("every coordinate and rate of a state"))
    plain = {**table, "programme": None, "forces": []}
    for value in BAD:
        note(
            f"control {value}",
            lambda value=value: vlmb.simulate(
                vlmb.Scene.from_dict(plain), control=lambda t, view: {"M_phi0": value if t > 0.01 else 0.0}
            ),
        )
    for law in (
        "1/(t - 0.02)",
        "log(t - 0.02)",
        "exp(1e5*t)",
        "sqrt(0.02 - t)",
        "1e308*exp(t)*1e10",
        "1/0",
        "0/0*t",
        "tan(pi/2 + 0*t)*1e300",
        "asin(2 + t)",
    ):
        note(
            f"law {law}", lambda law=law: vlmb.simulate(vlmb.Scene.from_dict({**plain, "forces": [{"on": "M_phi0", "law": law}]}))
        )
        note(
            f"programme {law}",
            lambda law=law: vlmb.simulate(
                vlmb.Scene.from_dict({**table, "programme": table["programme"] | {"constraints": [f"psi1 = {law}"]}})
            ),
        )
    found.append(report("values of controls, laws and programmes"))
    return found


CASES = {4: ratios, 6: stiff, 11: long_run, 13: chaos, 15: bad_input}
