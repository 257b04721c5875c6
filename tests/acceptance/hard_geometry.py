"""Hard postures: the vertical, headings across, straight legs, lengths at and below zero, fast spin, equilibria."""

from __future__ import annotations

import math

import numpy as np

import vlmb
from tests.acceptance.hard_finding import (
    ANY_LENGTH,
    PIVOT,
    SKI,
    TIGHT,
    Finding,
    Table,
    judged,
    refused,
    rod,
    run,
    scene,
    tips,
    witnessed,
    worst_condition,
)  # fmt: skip
from tests.acceptance.naive import paper_chart, pin_integrate
from tests.reference import exact

LEANING = "phi1 = phi0 + 1.5707963267948966"
OFFSETS = (0.0, 1e-12, 1e-9, 1e-6, 1e-3)


def over_the_top(offset: float) -> vlmb.Scene:
    """A rigid link thrown from the horizontal so that it passes the vertical at an angle [rad]: J cos^2(psi) phi' is kept."""
    first, inertia = exact.rod_moments(0.5, 2.0, 0.25)
    up = 9.0
    top = math.sqrt(up**2 - 2.0 * 9.81 * first / inertia)
    start = {"psi1": 0.0, "psi1_dot": up, "phi1_dot": offset * top}
    return scene(PIVOT, [rod(lower={"length": 0.25, "motion": "fixed"})], start=start)


def skier_over_the_top(offset: float) -> vlmb.Scene:
    """A skier on a spring leg who leans from one side of the vertical to the other; `offset` is the yaw rate at the start."""
    leg = rod(0.5, 30.0, lower={"length": 0.25, "stiffness": 2e4}, upper={"length": 0.2, "stiffness": 2e4}, tip_mass=40.0)
    start = {"speed": 3.0, "phi0": 0.3, "phi1": 0.3, "psi1": 1.2, "psi1_dot": 3.0, "phi0_dot": offset, "phi1_dot": offset}
    return scene(SKI, [leg], start=start)


def vertical(quick: bool = False) -> list[Finding]:
    """1. A link goes through the vertical."""
    found, times = [], np.linspace(0.0, 1.0, 41)
    for offset in OFFSETS:
        case = over_the_top(offset)
        reference = witnessed(case, times)
        naive = ""
        if not quick or offset in (1e-12, 1e-6):
            chart = paper_chart(case, times.tolist(), most=1000 if quick else 6000)
            naive = f"angles: {chart.told(chart.error(reference))}"
        found.append(
            judged(f"pivoted link, {offset:g} rad beside the vertical", "ball joint", run(case, times), reference, 1e-9, naive)
        )
    for offset in OFFSETS[:: 4 if quick else 1]:
        case = skier_over_the_top(offset)
        what = f"skier with springs, started with {offset:g} rad/s about the vertical"
        found.append(judged(what, "ball joint", run(case, times[:21]), witnessed(case, times[:21]), 1e-9))
    return found


def heading(quick: bool = False) -> list[Finding]:
    """2. The heading goes through 90 degrees and several full turns."""
    times = np.linspace(0.0, 10.0, 101)
    skate = scene(SKI | {"mass": 75.0, "inertia": 1.2}, [], slope=0.3, start={"phi0_dot": 1.5, "speed": 2.0})
    true = exact.skate(times, 75.0, 0.3, 1.5, speed=2.0)
    way = run(skate, times)
    error = max(float(np.abs(way[name] - true[name]).max()) for name in ("x", "y", "phi0"))
    edge = float(np.abs(way.residuals["knife_edge"].velocity).max())
    chart = paper_chart(skate, times.tolist(), "chaplygin", most=1000 if quick else 4000)
    off = float(np.abs(chart.base[:, 1] - true["y"][: len(chart.base)]).max())
    naive = f"tan(phi0): {chart.told(off)}"
    found = [
        Finding(
            "skate on a slope, 2.4 turns",
            "body velocities",
            error,
            limit=1e-9,
            residual=edge,
            condition=worst_condition(way),
            naive=naive,
        )
    ]
    leg = rod(0.5, 30.0, lower={"length": 0.25, "stiffness": 2e4}, upper={"length": 0.2, "stiffness": 2e4}, tip_mass=40.0)
    start = {"speed": 3.0, "phi0": 0.0, "phi1": math.pi / 2, "psi1": 1.2, "phi0_dot": 6.0, "phi1_dot": 6.0}
    case = scene(SKI, [leg], constraints=[LEANING, "psi1 = 1.2"], start=start)
    times = np.linspace(0.0, 2.0, 41)
    way = run(case, times)
    turns = abs(way["phi0"][-1] - way["phi0"][0]) / math.tau
    wrapped = float(np.abs(way.residuals[LEANING].position).max())
    chart = paper_chart(case.changed(constraints=()), times.tolist(), "chaplygin", most=1000 if quick else 4000)
    what = f"skier who leans to the side, {turns:.1f} turns"
    found.append(judged(what, "regular row", way, witnessed(case, times), 1e-8, f"tan(phi0): {chart.outcome}", residual=wrapped))
    return found


def straight_legs(hinge: float, offset: float = 0.0) -> vlmb.Scene:
    """Two spring links whose second swings through the line of the first, `offset` rad/s beside it; `hinge` [kg] between them."""
    both = {
        "lower": {"length": 0.25, "stiffness": 100.0, "limits": ANY_LENGTH},
        "upper": {"length": 0.2, "stiffness": 100.0, "limits": ANY_LENGTH},
    }
    start = {"psi1": -1.0, "psi2": -1.3, "psi2_dot": 6.0, "phi2_dot": offset}
    return scene(
        PIVOT, [rod(**both, tip_mass=hinge), rod(**both, tip_mass=1.0)], start=start, run=TIGHT | {"rtol": 1e-10, "atol": 1e-11}
    )


def straight(quick: bool = False) -> list[Finding]:
    """3. Two links pass through a straight line."""
    found, times = [], np.linspace(0.0, 0.2, 41)
    for name, mass in (("no mass", 0.0), ("1e-6 of the rod", 2e-6), ("a quarter of the rod", 0.5)):
        case = straight_legs(mass)
        chart = paper_chart(case, times.tolist(), method="rk4", step=1e-3, most=10**6)
        if not mass:
            naive = f"angles and RK4: {chart.outcome}"
            aligned = case.changed(start={"psi1": -1.0, "psi2": -1.0})
            found.append(
                refused(
                    f"hinge with {name}, started on the line", "named at the start", lambda aligned=aligned: run(aligned, times)
                )
            )
            near = times[times <= 0.045]  # the links are still 0.04 rad apart
            found.append(
                judged(
                    f"hinge with {name}, up to 0.04 rad before the line",
                    "warned by build",
                    run(case, near),
                    witnessed(case, near, rtol=1e-11),
                    1e-8,
                    naive,
                )
            )
            continue
        reference = witnessed(case, times, rtol=1e-11)
        naive = f"angles and RK4: {chart.told(chart.error(reference))}"
        found.append(
            judged(
                f"hinge with {name}, through the line",
                "Cholesky of the ball-joint form",
                run(case, times),
                reference,
                1e-7,
                naive,
            )
        )
    return found


def lengths(quick: bool = False) -> list[Finding]:
    """5. A segment rebounds at zero; one goes below it until the link's far end meets its hinge."""
    found = []
    mass, k = 3.0, 400.0
    middle = 0.3 + mass * 9.81 / k
    for gap in (1e-6, 1e-9, -1e-6):  # smallest length reached; a dip of less than 1e-6 m may pass between two looks
        hanging = rod(0.5, mass, lower={"length": 2.0 * middle - gap, "stiffness": k, "rest": 0.3})
        way = run(scene(PIVOT, [hanging], start={"psi1": -math.pi / 2}), np.linspace(0.0, 1.0, 51))
        if gap < 0.0:  # the run must end where the true motion is at zero
            when = math.acos(-middle / (middle - gap)) / math.sqrt(k / mass)
            said = "" if way.status == "finished" else way.message
            found.append(Finding(f"length to {gap:g} m, limit 0", "event", abs(way.t[-1] - when), "s", 1e-5, said=said))
        else:
            true = exact.vertical_oscillator(way.t, mass, k, 0.3, 2.0 * middle - gap, up=False)["xi1_1"]
            line = np.zeros((len(way), 1, 3))
            line[:, 0, 2] = -true - 0.5
            found.append(judged(f"length rebounds {gap:g} m above zero, twice", "no event", way, line, 1e-9))
    for beside in (1e-1, 1e-3, 1e-6, 0.0):
        case = through_the_hinge(beside)
        times = np.linspace(0.0, 2.0, 41)
        line = np.stack([1.0 - times, np.zeros(41), beside * times], axis=1)[:, None]
        naive = ""
        if not quick or beside == 1e-6:
            chart = paper_chart(case, times.tolist(), method="rk4", step=1e-3, most=10**6)
            naive = f"angles and RK4: {chart.told(chart.error(line))}"
        found.append(
            judged(
                f"far end passes its hinge at {beside:g} m", "ball joint, length below zero",
                run(case, times, method="dop853"), line, 1e-6, naive,
            )
        )
    return found


def through_the_hinge(beside: float) -> vlmb.Scene:
    """A point mass at the end of a massless rod of 0.5 m, no gravity and no spring: it flies straight on."""
    link = rod(0.5, 0.0, lower={"length": 0.5, "limits": ANY_LENGTH}, tip_mass=1.0)
    return scene(PIVOT, [link], gravity=0.0, start={"psi1": 0.0, "xi1_1_dot": -1.0, "psi1_dot": beside})


def spin(quick: bool = False) -> list[Finding]:
    """12. Fast spin, 100 rad/s."""
    times = np.linspace(0.0, 1.0, 51)
    flying = scene({"kind": "free"}, [rod()], start={"psi1": 0.3, "phi1_dot": 80.0, "psi1_dot": 60.0, "z": 1.0})
    true = exact.free_link(times, 0.0, 0.3, 80.0, 60.0, 0.25, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    ends = (true["hinge"] + 0.5 * true["direction"])[:, None]
    way = run(flying, times)
    clumsy = pin_integrate(flying, times.tolist(), 1e-3)
    naive = f"RK4 through pin.integrate, 1 ms: {clumsy.told(clumsy.error(ends))}"
    found = [judged("free link tumbling at 97 rad/s, adams", "quaternions in the embedding", way, ends, 1e-8, naive)]
    fixed = run(flying, times, method="rk4", step=1e-3)
    found.append(judged("the same, rk4 with steps of 1 ms", "the same", fixed, ends, 1e-3))
    finer = run(flying, times, method="rk4", step=5e-4)
    ratio = np.abs(tips(fixed) - ends).max() / np.abs(tips(finer) - ends).max()
    found.append(
        Finding(
            "order of rk4 there, from steps of 1 and 0.5 ms", "log2 of the ratio of errors", abs(math.log2(ratio) - 4.0), "", 0.7
        )
    )
    times = np.linspace(0.0, 2.0, 51)
    skate = scene(SKI, [], slope=0.3, start={"phi0_dot": 100.0})
    way, exactly = run(skate, times), exact.skate(times, 5.0, 0.3, 100.0)
    error = max(float(np.abs(way[name] - exactly[name]).max()) for name in ("x", "y"))
    found.append(
        Finding(
            "ski turning at 100 rad/s on a slope",
            "body velocities",
            error,
            limit=1e-10,
            condition=worst_condition(way),
            residual=float(np.abs(way["balance"]).max()),
        )
    )
    cone = exact.conical_spring_pendulum(2.0, 1e6, 0.6, 1.5692)
    start = {"psi1": cone["psi1"], "xi1_1": cone["xi1_1"], "phi1_dot": cone["phi1_dot"]}
    whirl = scene(PIVOT, [rod(0.0, 0.0, lower={"length": 0.6, "stiffness": 1e6}, tip_mass=2.0)], start=start)
    angle = cone["phi1_dot"] * times
    flat = cone["xi1_1"] * math.cos(cone["psi1"])
    circle = np.stack([flat * np.cos(angle), flat * np.sin(angle), np.full(51, cone["xi1_1"] * math.sin(cone["psi1"]))], axis=1)[
        :, None
    ]
    found.append(judged(f"mass whirled at {cone['phi1_dot']:.0f} rad/s", "ball joint", run(whirl, times), circle, 1e-7))
    return found


def upright() -> Table:
    """A rigid link, straight up."""
    return rod(0.5, 2.0)


def equilibrium(quick: bool = False) -> list[Finding]:
    """14. A start at rest exactly at an unstable equilibrium."""
    found = []
    rate = math.sqrt(1.5 * 9.81 / 0.5)
    for method in ("adams", "dop853", "radau", "gauss"):
        way = run(
            scene(PIVOT, [upright()]), np.linspace(0.0, 3.0, 31), method=method, **({"step": 1e-2} if method == "gauss" else {})
        )
        off = float(np.abs(way.position("link1") - [0.0, 0.0, 0.5]).max())
        said = " ".join([*way.adjustments, "" if way.status == "finished" else way.message]).strip()
        found.append(
            Finding(
                f"link upright at rest, 3 s, {method}",
                "stays within what rounding grows to",
                off,
                limit=1e-16 * math.exp(3.0 * rate) * 10,
                said=said,
            )
        )
    nudge = 1e-6
    way = run(scene(PIVOT, [upright()], start={"psi1": math.pi / 2 - nudge}), np.linspace(0.0, 3.0, 31))
    grown = nudge * np.cosh(rate * way.t)
    small = grown < 1e-3
    error = float(np.abs((math.pi / 2 - way["psi1"])[small] / grown[small] - 1.0).max())
    found.append(Finding("the same, 1e-6 rad off", "falls as cosh(rate t) while small", error, "of it", 1e-5))
    return found


CASES = {1: vertical, 2: heading, 3: straight, 5: lengths, 12: spin, 14: equilibrium}
