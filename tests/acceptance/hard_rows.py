"""Hard rows: inconsistent starts, repeated and nearly dependent rows, gains, a programme's own singular posture."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import numpy as np
from scipy.integrate import solve_ivp

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
    refused,
    rod,
    run,
    scene,
    tips,
    witnessed,
    worst_condition,
)
from tests.acceptance.naive import SCHEMES
from vlmb.core.fixed import MOST_ITERATIONS, ROOT
from vlmb.system.gains import largest_stable_step
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

SPRINGS: Table = {
    "lower": {"length": 0.3, "stiffness": 4e3, "limits": ANY_LENGTH},
    "upper": {"length": 0.2, "stiffness": 4e3, "limits": ANY_LENGTH},
}
WEIGHTY = rod(0.5, 20.0, tip_mass=10.0, **SPRINGS)
GAINS_OF_H = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 2.7, 2.8, 3.0)  # gain times step
PER_SECOND = (0.0, 1.0, 10.0, 100.0, 1000.0)
STEP = 1e-3


def largest_residual(way: vlmb.Trajectory) -> float:
    """Largest error of any equation over the run."""
    sizes = [np.abs(entry.velocity if entry.position is None else entry.position).max() for entry in way.residuals.values()]
    return float(max(sizes))


def unrepaired(case: vlmb.Scene, coordinates: dict[str, float], seconds: float) -> str:
    """What becomes of a start that is not repaired, without stabilization: the largest residual at the start and the end."""
    mechanism = vlmb.build(case)
    good = consistent_start(make_system(mechanism))
    workspace = make_system(mechanism, knife_edge="reduction", gain=0.0, run=case.run).workspace()
    values = good.coordinates | coordinates
    workspace.branch = [values[name] for name in mechanism.layout.names]
    y = workspace.pack(mechanism.state(values, good.rates))

    def size(y: Array) -> float:
        return max(abs(z) for z, _ in workspace.evaluate(0.0, y).residuals.values())

    first = size(y)
    for k in range(round(seconds / STEP)):
        y = SCHEMES["euler"](workspace.rhs, k * STEP, y, STEP)
    return f"no repair, no gain, explicit Euler: the error goes from {first:.2g} to {size(y):.2g} without a word"


def starts(quick: bool = False) -> list[Finding]:
    """7. Inconsistent and far-off starts."""
    found, times = [], np.linspace(0.0, 0.5, 21)
    far = {"speed": 2.0, "phi0": 0.0, "phi1": 2.0, "psi1": 1.0, "phi0_dot": 1.0}
    case = scene(SKI, [WEIGHTY], constraints=["phi1 = phi0"], start=far)
    way = run(case, times)
    begun = consistent_start(make_system(way.mechanism))
    told = case.changed(
        start={
            **begun.coordinates,
            **{k: v for k, v in begun.rates.items() if k not in ("x_dot", "y_dot")},
            "speed": float(way["speed"][0]),
        }
    )
    reference = witnessed(told, times)
    said = "; ".join(way.adjustments)
    naive = unrepaired(case, {"phi0": 0.0, "phi1": 0.5}, 0.5)
    found.append(
        judged(
            "phi1 = phi0 given 2 rad apart",
            "repaired and reported",
            way,
            reference,
            1e-9,
            naive,
            residual=largest_residual(way),
            said=said,
        )
    )
    case = scene(PIVOT, [WEIGHTY], constraints=["link1.tip.z = 0.9"], start={"psi1": -1.0, "phi1_dot": 1.0})
    way = run(case, times)
    error = float(np.abs(way.position("link1")[:, 2] - 0.9).max())
    found.append(
        Finding(
            "tip height 0.9 m from a link that hangs",
            "Gauss-Newton of least norm",
            error,
            limit=1e-9,
            residual=largest_residual(way),
            condition=worst_condition(way),
            said="; ".join(way.adjustments),
        )
    )
    case = scene(SKI, [WEIGHTY], start={"x_dot": 1.0, "y_dot": 5.0, "psi1": 1.0})
    way = run(case, times)
    side = float(np.abs(way.residuals["knife_edge"].velocity).max())
    found.append(
        Finding(
            "ski started sideways at 5 m/s",
            "projected on the heading",
            abs(float(way["speed"][0]) - 1.0),
            "m/s",
            1e-12,
            side,
            worst_condition(way),
            "; ".join(way.adjustments),
        )
    )
    programme = {"constraints": ["psi1 = 1.2"], "controls": ["M_psi1"], "frequency": 10.0}
    way = run(scene(PIVOT, [WEIGHTY], programme=programme, start={"psi1": 0.5}), times)
    first, w = 0.5 - 1.2, 10.0
    decay = first * (1.0 + w * times) * np.exp(-w * times)
    off = float(np.abs(way.residuals["psi1 = 1.2"].position - decay).max())
    found.append(
        Finding(
            "programme started 0.7 rad off",
            "decays as (1 + w t) exp(-w t)",
            off,
            "rad",
            1e-9,
            abs(decay[-1]),
            worst_condition(way),
            "; ".join(way.adjustments),
        )
    )
    impossible: dict[str, Table] = {
        "an equation no posture meets": {"constraints": ["cos(psi1) = 2"]},
        "two that contradict each other": {"constraints": ["psi1 = 1.0", "psi1 = 1.1"]},
        "a length outside its limits": {
            "links": [WEIGHTY | {"lower": {"length": 0.3, "limits": [0.1, 0.5]}}],
            "start": {"xi1_1": 0.6},
        },
    }
    for what, keys in impossible.items():
        given = {"links": [WEIGHTY]} | keys
        found.append(refused(what, "refused before the run", lambda given=given: run(scene(PIVOT, **given), times)))
    return found


def dependent(quick: bool = False) -> list[Finding]:
    """8. Redundant and nearly dependent rows, of constraints and of a programme."""
    found, times = [], np.linspace(0.0, 0.5, 21)
    start = {"psi1": 1.2, "phi1_dot": 1.0, "xi1_1": 0.3}
    alone = scene(PIVOT, [WEIGHTY], constraints=["psi1 = 1.2"], start=start)
    reference = witnessed(alone, times)
    for rows in (["psi1 = 1.2", "psi1 = 1.2"], ["psi1 = 1.2", "2*psi1 = 2.4", "sin(psi1) = sin(1.2)"]):
        way = run(alone.changed(constraints=tuple(rows)), times)
        naive = naive_rows(alone.changed(constraints=tuple(rows)))
        found.append(
            judged(
                f"{len(rows)} rows that say the same",
                "least multipliers",
                way,
                reference,
                1e-9,
                naive,
                residual=largest_residual(way),
            )
        )
    both = witnessed(alone.changed(constraints=("psi1 = 1.2", "xi1_1 = 0.3")), times)
    for apart in (1e-2, 1e-4, 1e-5, 1e-7, 1e-9):
        rows = ("psi1 = 1.2", f"psi1 + {apart:.0e}*(xi1_1 - 0.3) = 1.2")
        case = alone.changed(constraints=rows)
        what = f"second row differs by {apart:g} of another coordinate"
        loose = {"rtol": 1e-9, "atol": 1e-10} if apart == 1e-5 else {}  # above the noise of multipliers that nearly cancel
        way = run(case, times, **loose)
        found.append(
            judged(
                what, "Cholesky", way, both, 1e-6, naive_rows(case), residual=largest_residual(way),
                said="; ".join(way.adjustments),
            )
        )
    controls = ["M_psi1", "F1_1", "F1_2"]
    for rows, what in (
        (["psi1 = 1.2", "psi1 = 1.2"], "programme rows that say the same"),
        (["psi1 = 1.2", "2*psi1 = 2.4"], "one the other's double"),
    ):
        programme = {"constraints": rows, "controls": controls, "frequency": 10.0}
        single = {"constraints": rows[:1], "controls": controls, "frequency": 10.0}
        first, second = (run(scene(PIVOT, [WEIGHTY], programme=p, start=start), times) for p in (single, programme))
        found.append(
            judged(
                what,
                "controls of least norm, against the row alone",
                second,
                tips(first),
                1e-9,
                residual=largest_residual(second),
            )
        )
    against = {"constraints": ["psi1 = 1.2", "psi1 = 1.3"], "controls": controls, "frequency": 10.0}
    found.append(
        refused(
            "programme rows that contradict", "named", lambda: run(scene(PIVOT, [WEIGHTY], programme=against, start=start), times)
        )
    )
    weak = {"constraints": ["psi1 = 1.2", "xi1_1 = 0.3"], "controls": ["M_psi1", "M_phi1"], "frequency": 10.0}
    found.append(
        refused(
            "programme whose controls do not act on a row",
            "named",
            lambda: run(scene(PIVOT, [WEIGHTY], programme=weak, start=start), times),
        )
    )
    return found


def naive_rows(case: vlmb.Scene) -> str:
    """Solve the bordered matrix [[M, -J^T], [J, 0]] at the start as it stands."""
    mechanism = vlmb.build(case)
    start = consistent_start(make_system(mechanism))
    workspace = make_system(mechanism, knife_edge="reduction", gain=0.0, run=case.run).workspace()
    workspace.branch = [start.coordinates[name] for name in mechanism.layout.names]
    good = workspace.evaluate(0.0, workspace.pack(start.state)).vdot
    rows, q, v = workspace.solver.rows, start.state.q, start.state.v
    import pinocchio as pin

    mass = np.array(workspace.frames.update(q))
    bias = np.array(pin.nonLinearEffects(mechanism.model, workspace.frames.data, q, v))
    values = rows.evaluate(workspace.frames, 0.0, q, v, workspace.branch)
    whole = np.block([[mass, -values.jacobian.T], [values.jacobian, np.zeros((rows.count, rows.count))]])
    tau = np.zeros(len(v))
    workspace.springs.write(np.concatenate([q, v]), tau)
    try:
        answer = np.linalg.solve(whole, np.concatenate([tau - bias, -values.drift]))[: len(v)]
    except np.linalg.LinAlgError:
        return "bordered matrix: LinAlgError: Singular matrix"
    return f"bordered matrix of condition {np.linalg.cond(whole):.0e}: accelerations off by {np.abs(answer - good).max():.1e}"


def grows(method: str, product: float, holonomic: bool, steps: int = 400) -> bool:
    """Whether a small error of a row grows under a fixed-step method, at a gain times step; an error of the method counts."""
    gain = product / STEP
    if holonomic:
        case = scene(PIVOT, [rod(0.5, 2.0)], gravity=0.0, constraints=["psi1 = 0.3"], start={"psi1": 0.3})
        mechanism, at = vlmb.build(case), 1e-7
        workspace = make_system(mechanism, knife_edge="reduction", gain=gain, run=case.run).workspace()
        values = {"phi1": 0.0, "psi1": 0.3 + at}
        workspace.branch = list(values.values())
        y = workspace.pack(mechanism.state(values))
    else:
        case = scene(SKI, [], start={})
        mechanism, at = vlmb.build(case), 1e-7
        workspace = make_system(mechanism, knife_edge="multiplier", gain=gain, run=case.run).workspace()
        y = workspace.pack(consistent_start(make_system(mechanism)).state)
        y[workspace.nq + 1] = at

    def size(y: Array) -> float:
        return (
            abs(mechanism.coordinates((y[: workspace.nq], y[workspace.nq : workspace.nq + workspace.nv]))["psi1"] - 0.3)
            if holonomic
            else abs(float(y[workspace.nq + 1]))
        )

    largest = []
    try:
        for state in marched(method, workspace.rhs, y, STEP, [STEP * k for k in range(1, steps + 1)]):
            largest.append(size(state))
            if largest[-1] > 1e3 * at:
                return True
    except vlmb.VlmbError:
        return True
    late = max(largest[-steps // 4 :])
    return late > 1e-14 and late > max(largest[: steps // 2]) * 0.999


def measured_limit(method: str, holonomic: bool, around: tuple[float, float], quick: bool = False) -> float:
    """Largest stable gain times step, by bisection from 5 % around what is predicted; inf where none up to 20 grows."""
    fine, steps = (0.05, 100) if quick else (2e-3, 400)
    low, high = 0.95 * around[0], 1.05 * around[1]
    if grows(method, low, holonomic, steps) or not grows(method, high, holonomic, steps):
        low, high = 0.2, 20.0
        if not grows(method, high, holonomic, steps):
            return math.inf
    while high - low > fine:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if grows(method, middle, holonomic, steps) else (middle, high)
    return low


def contraction(product: float) -> float:
    """Spectral radius of one pass over the stages of the Gauss method, z' = -gain z: how fast they converge."""
    low, high, z = 0.25 - ROOT, 0.25 + ROOT, -product
    return float(np.abs(np.linalg.eigvals([[0.25 * z, low * z], [0.25 * high * z * z, low * high * z * z + 0.25 * z]])).max())


def iterated(holonomic: bool, quick: bool) -> Finding:
    """The Gauss method is stable at every step, but its stages are iterated: between which gains they stop to converge."""
    products = np.linspace(0.5, 3.0, 2501)
    radius = np.array([contraction(product) for product in products])
    sure, never = (float(products[np.argmax(radius >= bound)]) for bound in (1e-10 ** (1.0 / MOST_ITERATIONS), 1.0))
    measured = measured_limit("gauss", holonomic, (sure, never), quick)
    row = "a holonomic row" if holonomic else "the knife edge"
    done = (
        f"stages converge up to gain x step {measured:.4g}, predicted between {sure:.4g} (any error) and {never:.4g} (small ones)"
    )
    off = max(sure - measured, measured - never, 0.0)
    return Finding(f"gauss, {row}", f"{done}; beyond, a named error", off, "of gain x step", 0.02)


def gains(quick: bool = False) -> list[Finding]:
    """9. Baumgarte gains from 0 to 3/h for fixed steps, and to 1000 per second for adaptive ones."""
    found = []
    for holonomic in (False, True):
        found.append(iterated(holonomic, quick))
    for method in ("euler", "rk4", "gauss"):
        predicted = largest_stable_step(np.array([-1.0 + 0.0j]), method)
        for holonomic in (False, True) if method != "gauss" else ():
            measured = measured_limit(method, holonomic, (predicted, predicted))
            row = "a holonomic row" if holonomic else "the knife edge"
            done = f"measured limit of gain x step {measured:.4g}, predicted {predicted:.4g}"
            found.append(
                Finding(
                    f"{method}, {row}",
                    done,
                    abs(measured / predicted - 1.0),
                    "of the limit",
                    0.02,
                )
            )
        allowed, named, unstable = [], [], []
        for product in GAINS_OF_H:
            case = scene(
                SKI,
                [],
                slope=0.3,
                start={"phi0_dot": 1.5},
                run={"duration": 0.2, "method": method, "step": STEP, "knife_edge": "multiplier", "gain": product / STEP},
            )
            try:
                way = run(case)
            except vlmb.VlmbError:
                named.append(product)
                continue
            if way.status != "finished":
                named.append(product)
            else:
                allowed.append(product)
                if np.abs(way.residuals["knife_edge"].velocity).max() > 1e-3:
                    unstable.append(product)
        done = (
            f"gain x step runs at {', '.join(f'{p:g}' for p in allowed)}; named at {', '.join(f'{p:g}' for p in named) or 'none'}"
        )
        found.append(
            Finding(f"{method}, gains 0 to 3/h in a run", done, float(len(unstable)), "runs that drift without a word", 0.0)
        )
    times = np.linspace(0.0, 2.0, 41)
    keys: Table = {"slope": 0.2, "start": {"phi0_dot": 1.5, "psi1": 1.0, "speed": 2.0, "phi1_dot": 0.5}}
    case = scene(SKI, [WEIGHTY], run=TIGHT | {"rtol": 1e-9, "atol": 1e-11}, **keys)
    best = tips(run(case.changed(run=msgspec.to_builtins(vlmb.scene.tables.Run(**TIGHT))), times[:11]))
    for method in ("adams", "dop853", "bdf", "radau"):
        for gain in PER_SECOND[:: 4 if quick else 1]:
            way = run(case, times[:11], method=method, knife_edge="multiplier", gain=gain)
            what, done = f"{method}, gain {gain:g} per second", f"{way.stats['rhs_evaluations']} right-hand sides"
            residual = float(np.abs(way.residuals["knife_edge"].velocity).max())
            found.append(judged(what, done, way, best, 1e-5, residual=residual))
    return found


def posture(quick: bool = False) -> list[Finding]:
    """10. A programme through its own singular posture."""
    times = np.linspace(0.0, 1.0, 41)
    start = {"psi1": 1.2, "psi1_dot": 2.0, "xi1_1": 0.3}
    text = "link1.tip.x = 0.29 - 0.5*t"
    programme = {"constraints": [text], "controls": ["F1_1"], "frequency": 10.0}
    link = rod(0.5, 20.0, tip_mass=10.0, lower={"length": 0.3, "limits": ANY_LENGTH})
    case = scene(PIVOT, [link], programme=programme, start=start)
    found = [
        refused(
            "tip across the vertical by the force along the link",
            "named at the posture",
            lambda: run(case, times),
            naive_programme(case),
        )
    ]
    helped = case.changed(programme=programme | {"controls": ["F1_1", "M_psi1"]})
    way = run(helped, times)
    z = way.residuals[text].position
    error = float(np.abs(z[-5:]).max())
    found.append(
        Finding(
            "the same with M_psi1 beside it",
            "controls of least norm",
            error,
            limit=1e-3,
            residual=float(np.abs(way["balance"]).max()),
            condition=worst_condition(way),
            said="" if way.status == "finished" else way.message,
        )
    )
    pole = {"constraints": ["phi1 = 0.5*t"], "controls": ["M_phi1"], "frequency": 5.0}
    falling = scene(PIVOT, [rod(0.5, 2.0)], programme=pole, start={"psi1": 1.2, "psi1_dot": 6.0})
    way = run(falling, np.linspace(0.0, 1.0, 11), method="adams")
    found.append(
        Finding(
            "azimuth steered while the link passes the vertical",
            "adams, through the pole in one step",
            0.5 * abs(float(way["psi1"][-1]) - steered_fall(1.0)),
            limit=1e-6,
            residual=float(np.abs(way.residuals["phi1 = 0.5*t"].position).max()),
            condition=worst_condition(way),
            said="" if way.status == "finished" else way.message,
            naive=naive_programme(falling),
        )
    )
    return found


def steered_fall(t: float) -> float:
    """Elevation [rad] of a rod that turns about the vertical at w: psi'' = -w^2 sin psi cos psi - 3 g cos psi / (2 L)."""

    def rates(_: float, y: Array) -> list[float]:
        return [y[1], -0.25 * math.sin(y[0]) * math.cos(y[0]) - 1.5 * 9.81 / 0.5 * math.cos(y[0])]

    return float(solve_ivp(rates, (0.0, t), [1.2, 6.0], method="DOP853", rtol=1e-12, atol=1e-12).y[0, -1])


def naive_programme(case: vlmb.Scene) -> str:
    """The same law by RK4 with steps of 1 ms, without looking back at what each step did."""
    mechanism = vlmb.build(case)
    start = consistent_start(make_system(mechanism))
    workspace = make_system(mechanism, run=case.run, gain=0.0).workspace()
    workspace.branch = [start.coordinates[name] for name in mechanism.layout.names]
    y, worst = workspace.pack(start.state), 0.0
    try:
        for k in range(1000):
            y = SCHEMES["rk4"](workspace.rhs, k * STEP, y, STEP)
            now = mechanism.coordinates(
                workspace.unpack(0.0, y), dict(zip(mechanism.layout.names, workspace.branch, strict=True))
            )
            workspace.branch = [now[name] for name in mechanism.layout.names]
            worst = max(worst, float(np.abs(workspace.solver.controls).max()))
            if not np.isfinite(y).all() or worst > 1e12:
                return f"RK4 without a guard: blows up at t = {k * STEP:.3f} s"
    except vlmb.VlmbError as error:
        return f"RK4 without a guard: {str(error)[:60]}... at t = {k * STEP:.3f} s"
    return f"RK4 without a guard: goes on with controls up to {worst:.1e} N, N m, without a word"


CASES: dict[int, Callable[[bool], list[Finding]]] = {7: starts, 8: dependent, 9: gains, 10: posture}
