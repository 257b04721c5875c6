"""What one evaluation of the right-hand side costs beside its bare Pinocchio calls, how exact it is, and what memory it takes.

Usage: python benchmarks/rhs_cost.py [--links 1 2 8]

Chains with spring legs and tip masses, on a pivot and on the ski. Bare calls: crba and nonLinearEffects. Accuracy: direction and
length accelerations beside those of the same state from mass points and Lagrange's equations in extended precision.
"""

from __future__ import annotations

import argparse
import gc
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common import CLOCK, fastest, interleaved, save_figure, table, write_report

# isort: split
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import lapack

import vlmb
from vlmb.model.coordinates import Layout
from vlmb.model.long_chains import LONG_CHAIN
from vlmb.model.mechanism import Mechanism, build, data_bytes
from vlmb.system.dense import cross_of
from vlmb.system.dynamics import Dynamics
from vlmb.views.style import BLACK, GREY, PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[Any]

LINKS = (1, 2, 8, 20, 50, 100)
CROSSOVER = (1, 2, 3, 4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 50, 64)
BASES: dict[str, dict[str, Any]] = {
    "pivot": {"kind": "pivot"},
    "ski": {"kind": "ski", "mass": 5.0, "inertia": 0.6, "com_offset": 0.05},
}
ROD, MASS, TIP = 0.2, 1.0, 0.5  # [m], [kg], [kg]
LEG = {"length": 0.1, "stiffness": 4e3, "limits": [-math.inf, math.inf]}
LIMIT, DRIVER_LIMIT, IMPORT_LIMIT = 5.0, 10.0, 1.3  # times the bare calls, times the bare imports
LONG = np.longdouble
STATES = 3
DRIVERS = ("adams", "dop853")
PARTS = {
    "recursive": ("normalize", "springs", "aba", "tangent map"),
    "dense": ("normalize", "springs", "crba", "nonLinearEffects", "knife edge", "solve", "tangent map"),
}
SPENT = 0.3  # [s] of processor a measured run takes at least


def chain(base: str, links: int) -> vlmb.Scene:
    """Make a chain of equal links with spring legs."""
    link = {"rod": {"length": ROD, "mass": MASS}, "lower": LEG, "upper": LEG, "tip_mass": TIP}
    return vlmb.Scene.from_dict({"base": BASES[base], "links": [link] * links, "run": {"fall": False}})


def posture(mechanism: Mechanism, seed: int) -> vlmb.State:
    """Draw a bent, moving state without sideways slip; links far from the pole and from each other's line."""
    random = np.random.default_rng(seed)
    values: dict[str, float] = {}
    rates: dict[str, float] = {}
    for name in mechanism.coordinate_names:
        kind = name.rstrip("0123456789").rstrip("_")
        spread = {"psi": 0.6, "phi": 1.0, "xi": 0.02}.get(kind.rstrip("0123456789_"), 1.0)
        values[name] = (0.1 if name.startswith("xi") else 0.0) + random.uniform(-spread, spread)
        rates[f"{name}_dot"] = random.uniform(-0.5, 0.5)
    if "phi0" in values:
        speed = 2.0
        rates |= {"x_dot": speed * math.cos(values["phi0"]), "y_dot": speed * math.sin(values["phi0"])}
    return mechanism.state(values, rates)


# Cost ----------------------------------------------------------------------------------------------------------------


def bare(mechanism: Mechanism, state: vlmb.State) -> Callable[[], object]:
    """Make the yardstick: mass matrix and velocity products, nothing else."""
    model, data, q, v = mechanism.model, mechanism.data, np.array(state.q), np.array(state.v)
    crba, nle = pin.crba, pin.nonLinearEffects

    def call() -> None:
        crba(model, data, q)
        nle(model, data, q, v)

    return call


def parts(mechanism: Mechanism, state: vlmb.State) -> dict[str, Callable[[], object]]:
    """Make the pieces of the dense and the recursive route, each as the right-hand side calls it."""
    model, data, nq = mechanism.model, mechanism.data, mechanism.model.nq
    dynamics = Dynamics(mechanism, route="dense")
    y, world = dynamics.pack(state), pin.Convention.WORLD
    raw, v, tau = y[:nq], y[nq : nq + model.nv], np.zeros(model.nv)
    q = pin.normalize(model, raw)
    write = dynamics.springs.write
    mass, right = np.asfortranarray(pin.crba(model, data, q, world)), np.ones(model.nv)
    flat, (crossed, identity) = mass.ravel(order="K"), cross_of(dynamics.known, model.nv)
    if dynamics.known:
        flat[crossed] = identity
    work = np.zeros_like(mass, order="F")

    def copy() -> None:
        work[:] = mass

    def solve() -> None:
        work[:] = mass
        lapack.dposv(work, right, overwrite_a=1)

    def cross() -> None:
        flat[crossed] = identity

    found: dict[str, Callable[[], object]] = {
        "normalize": lambda: pin.normalize(model, raw),
        "springs": lambda: write(y, tau),
        "aba": lambda: pin.aba(model, data, q, v, tau),
        "crba": lambda: pin.crba(model, data, q, world),
        "nonLinearEffects": lambda: pin.nonLinearEffects(model, data, q, v),
        "copy": copy,
        "solve": solve,
        "tangent map": lambda: pin.tangentMapProduct(model, raw, v),
    }
    return found | ({"knife edge": cross} if dynamics.known else {})


def cost(mechanism: Mechanism) -> dict[str, float]:
    """Seconds of the bare calls, of both routes, and of the parts of the dense one, taken in turn."""
    links = len(mechanism.layout.links)
    state = posture(mechanism, 0)
    functions: dict[str, Callable[[], object]] = {"bare": bare(mechanism, state)}
    for route in ("recursive", "dense", "subchains"):
        dynamics = Dynamics(mechanism, route=route)
        functions[route] = evaluation(dynamics, dynamics.pack(state))
    seconds = interleaved(functions | parts(mechanism, state), repeats=40 if links <= 8 else 15 if links <= 50 else 5)
    seconds["solve"] = max(seconds["solve"] - seconds.pop("copy"), 0.0)
    seconds["automatic"] = seconds[Dynamics(mechanism).route]
    return seconds


def evaluation(dynamics: Dynamics, y: Array) -> Callable[[], object]:
    """Make one evaluation of a right-hand side."""
    rhs = dynamics.rhs
    return lambda: rhs(0.0, y)


def with_driver(mechanism: Mechanism, method: str) -> dict[str, float]:
    """Processor time of whole runs over their evaluations, beside the bare calls between them."""
    state = posture(mechanism, 0)
    scene_start = mechanism.coordinates(state)
    scene = vlmb.Scene.from_dict({**mechanism.scene.to_dict(), "start": _start(mechanism, scene_start)})
    prepared = replace(mechanism, scene=scene)
    options = {"method": method, "rtol": 1e-8, "atol": 1e-10}
    duration, best, yardstick = 1e-3, math.inf, math.inf
    while True:
        began = CLOCK()
        trajectory = vlmb.simulate(prepared, duration=duration, t_eval=_samples(duration), **options)
        if CLOCK() - began > SPENT:
            break
        duration *= 2.0
    for _ in range(4):
        yardstick = min(yardstick, fastest(bare(mechanism, state), repeats=5))
        began = CLOCK()
        trajectory = vlmb.simulate(prepared, duration=duration, t_eval=_samples(duration), **options)
        best = min(best, (CLOCK() - began) / trajectory.stats["rhs_evaluations"])
    assert trajectory.status == "finished", trajectory.message
    return {"seconds": best, "ratio": best / yardstick, "duration": duration, "evaluations": trajectory.stats["rhs_evaluations"]}


def _samples(duration: float) -> Array:
    return np.linspace(0.0, duration, max(2, math.ceil(60.0 * duration) + 1))


def _start(mechanism: Mechanism, values: dict[str, float]) -> dict[str, float]:
    ski = mechanism.layout.base == "ski"
    start = {name: value for name, value in values.items() if not (ski and name in ("x_dot", "y_dot"))}
    return start | ({"speed": 2.0} if ski else {})


# Accuracy ------------------------------------------------------------------------------------------------------------


def reference(mechanism: Mechanism, state: vlmb.State) -> tuple[Array, Array]:
    """Accelerations of directions (n, 3) and lengths (n, 2) from mass points and Lagrange's equations, extended precision.

    r_p = r_A + sum_k s_pk d_k, d_k'' = -|d_k'|^2 d_k + a_k b_k + c_k (d_k x b_k); unknown a, c, both xi'' of every link,
    and for a ski the accelerations along its heading and in yaw.
    """
    layout, n, ski = mechanism.layout, len(mechanism.layout.links), mechanism.layout.base == "ski"
    d, omega = directions(layout, state)
    rate = np.cross(omega, d)
    lengths = np.array([[state.q[e.lower.q], state.q[e.upper.q]] for e in layout.links], dtype=LONG)
    speeds = np.array([[state.v[e.lower.v], state.v[e.upper.v]] for e in layout.links], dtype=LONG)
    side = np.cross(d, np.array([0, 0, 1], dtype=LONG))
    side /= np.sqrt(np.sum(side**2, axis=1))[:, None]
    up = np.cross(d, side)
    first = 2 if ski else 0
    size = first + 4 * n
    gravity = np.array([0, 0, -LONG(mechanism.scene.gravity)], dtype=LONG)
    matrix, load = np.zeros((size, size), dtype=LONG), np.zeros(size, dtype=LONG)

    def add(mass: float, jacobian: Array, bias: Array) -> None:
        columns = np.flatnonzero(jacobian.any(axis=0))
        part = jacobian[:, columns]
        matrix[np.ix_(columns, columns)] += LONG(mass) * part.T.dot(part)
        load[columns] += LONG(mass) * part.T.dot(gravity - bias)

    jacobian, bias = np.zeros((3, size), dtype=LONG), np.zeros(3, dtype=LONG)
    if ski:
        base = BASES["ski"]
        norm = np.sqrt(LONG(state.q[2]) ** 2 + LONG(state.q[3]) ** 2)
        ahead = np.array([LONG(state.q[2]) / norm, LONG(state.q[3]) / norm, 0], dtype=LONG)
        left = np.array([-ahead[1], ahead[0], 0], dtype=LONG)
        speed, yaw, offset = LONG(state.v[0]), LONG(state.v[2]), LONG(base["com_offset"])
        jacobian[:, 0], bias = ahead, speed * yaw * left
        centre = jacobian.copy()
        centre[:, 1] = offset * left
        add(base["mass"], centre, bias - offset * yaw**2 * ahead)
        matrix[1, 1] += LONG(base["inertia"])
    for i in range(n):
        at = first + 4 * i

        rod = LONG(ROD)
        points = [(LONG(MASS) / 6, LONG(0), 1), (4 * LONG(MASS) / 6, rod / 2, 1), (LONG(MASS) / 6, rod, 1)]
        for mass, where, segments in (*points, (TIP, rod + lengths[i, 1], 2)):  # the tip last: it carries the next link
            along = lengths[i, 0] + where
            moved, rest = jacobian.copy(), bias - along * np.sum(rate[i] ** 2) * d[i]
            moved[:, at], moved[:, at + 1] = along * side[i], along * up[i]
            for which in range(segments):
                moved[:, at + 2 + which] = d[i]
                rest = rest + 2 * speeds[i, which] * rate[i]
            add(mass, moved, rest)
        jacobian, bias = moved, rest
        load[at + 2 : at + 4] -= LONG(LEG["stiffness"]) * (lengths[i] - LONG(LEG["length"]))
    u = cholesky_solve(matrix, load)[first:].reshape(n, 4)
    turning = -np.sum(rate**2, axis=1)[:, None] * d + u[:, :1] * side + u[:, 1:2] * up
    return turning, u[:, 2:]


def directions(layout: Layout, state: vlmb.State) -> tuple[Array, Array]:
    """Directions and angular velocities (n, 3) of a chain's links, extended precision."""
    rotations, omega = _rotations(layout, state)
    return rotations[:, :, 0], omega


def measured(layout: Layout, state: vlmb.State, vdot: Array) -> tuple[Array, Array]:
    """Accelerations of directions (n, 3) and lengths (n, 2) of a solution vdot."""
    rotations, omega = _rotations(layout, state)
    turning = np.zeros(3, dtype=LONG)
    before = np.zeros(3, dtype=LONG)
    if layout.base == "ski":
        turning[2], before[2] = vdot[2], state.v[2]
    found = []
    for i, entry in enumerate(layout.links):
        relative = rotations[i].dot(state.v[entry.v : entry.v + 3].astype(LONG))
        turning = turning + rotations[i].dot(vdot[entry.v : entry.v + 3].astype(LONG)) + np.cross(before, relative)
        d = rotations[i][:, 0]
        found.append(np.cross(turning, d) + np.cross(omega[i], np.cross(omega[i], d)))
        before = omega[i]
    return np.array(found), np.array([[vdot[e.lower.v], vdot[e.upper.v]] for e in layout.links], dtype=LONG)


def _rotations(layout: Layout, state: vlmb.State) -> tuple[Array, Array]:
    rotation, omega = np.eye(3, dtype=LONG), np.zeros(3, dtype=LONG)
    if layout.base == "ski":
        norm = np.sqrt(LONG(state.q[2]) ** 2 + LONG(state.q[3]) ** 2)
        cosine, sine = LONG(state.q[2]) / norm, LONG(state.q[3]) / norm
        rotation[:2, :2] = [[cosine, -sine], [sine, cosine]]
        omega[2] = state.v[2]
    rotations, omegas = [], []
    for entry in layout.links:
        quaternion = state.q[entry.q : entry.q + 4].astype(LONG)
        x, y, z, w = quaternion / np.sqrt(np.sum(quaternion**2))
        local = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ],
            dtype=LONG,
        )
        rotation = rotation.dot(local)
        omega = omega + rotation.dot(state.v[entry.v : entry.v + 3].astype(LONG))
        rotations.append(rotation)
        omegas.append(omega)
    return np.array(rotations), np.array(omegas)


def cholesky_solve(matrix: Array, load: Array) -> Array:
    """Solve a symmetric positive definite system in the precision of its numbers."""
    lower, size = matrix.copy(), len(load)
    x = load.copy()
    for k in range(size):
        lower[k, k] = np.sqrt(lower[k, k])
        lower[k + 1 :, k] /= lower[k, k]
        lower[k + 1 :, k + 1 :] -= np.outer(lower[k + 1 :, k], lower[k + 1 :, k])
    for k in range(size):
        x[k] = (x[k] - lower[k, :k].dot(x[:k])) / lower[k, k]
    for k in reversed(range(size)):
        x[k] = (x[k] - lower[k + 1 :, k].dot(x[k + 1 :])) / lower[k, k]
    return x


def errors(mechanism: Mechanism) -> dict[str, float]:
    """Largest relative error of each route over some states: accelerations of directions and of lengths, each by its largest."""
    found = {"recursive": 0.0, "dense": 0.0}
    routes = {route: Dynamics(mechanism, route=route) for route in found}
    for seed in range(STATES):
        state = posture(mechanism, seed)
        exact = reference(mechanism, state)
        for route, dynamics in routes.items():
            vdot = dynamics.rhs(0.0, dynamics.pack(state))[dynamics.nq : dynamics.nq + dynamics.nv]
            for ours, true in zip(measured(mechanism.layout, state, vdot), exact, strict=True):
                found[route] = max(found[route], float(np.abs(ours - true).max() / np.abs(true).max()))
    return found


# Memory and imports --------------------------------------------------------------------------------------------------


def memory(base: str, links: int) -> dict[str, float]:
    """Resident memory [bytes] that building a chain adds to a process of its own, beside the estimate."""
    return json.loads(_child(["--memory", base, str(links)]))


def resident() -> int:
    """Resident memory [bytes] of this process; 0 where the system does not tell."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


def print_memory(base: str, links: int) -> None:
    """Print what building takes, for `memory`."""
    scene = chain(base, links)
    build(chain(base, 1))
    before = resident()
    mechanism = build(scene)
    dynamics = Dynamics(mechanism, route="dense")
    state = posture(mechanism, 0)
    dynamics.rhs(0.0, dynamics.pack(state))
    print(json.dumps({"measured": resident() - before, "estimate": data_bytes(mechanism.model.nv)}))


IMPORTS = {"vlmb": "import vlmb", "bare": "import pinocchio, scipy.integrate"}


def imports(repeats: int = 12) -> dict[str, float]:
    """Processor seconds of imports in processes of their own, the fastest of some taken in turn."""
    best = dict.fromkeys(IMPORTS, math.inf)
    for _ in range(repeats):
        for name, statement in IMPORTS.items():
            code = f"import time; t = time.process_time(); {statement}; print(time.process_time() - t)"
            best[name] = min(best[name], float(_child(["-c", code], script=False)))
    return best


def _child(arguments: list[str], script: bool = True) -> str:
    root = Path(__file__).resolve().parents[1]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    command = [sys.executable, *([__file__] if script else []), *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout


# Report --------------------------------------------------------------------------------------------------------------


def micro(seconds: float) -> str:
    """Microseconds with three digits."""
    return f"{1e6 * seconds:.3g}" if seconds < 1e-2 else f"{1e6 * seconds:.0f}"


def crossover(values: dict[int, dict[str, float]]) -> str:
    """Say at which numbers of links each route is ahead."""
    runs: list[tuple[str, list[int]]] = []
    for n in sorted(values):
        best = "recursive" if values[n]["recursive"] < values[n]["dense"] else "dense"
        if not runs or runs[-1][0] != best:
            runs.append((best, []))
        runs[-1][1].append(n)
    spans = [f"{best} at {sizes[0]}" + (f" to {sizes[-1]}" if len(sizes) > 1 else "") for best, sizes in runs]
    return ", ".join(spans) + " links"


def measure(links: tuple[int, ...]) -> dict[str, Any]:
    """Measure everything; chains are built one at a time, since Data of a long one takes gigabytes."""
    data: dict[str, Any] = {"cost": {}, "driver": {}, "error": {}, "memory": {}, "time": {}}
    for base in BASES:
        for entry in data.values():
            entry[base] = {}
        for n in sorted({*links, *(k for k in CROSSOVER if k <= max(links))}):
            mechanism = build(chain(base, n))
            data["error"][base][n] = errors(mechanism)
            seconds = cost(mechanism)
            data["time"][base][n] = {name: seconds[name] for name in ("bare", "recursive", "dense")}
            if n in links:
                data["cost"][base][n] = seconds
                data["driver"][base][n] = {method: with_driver(mechanism, method) for method in DRIVERS}
                data["memory"][base][n] = memory(base, n) if n < 100 else {}
            del mechanism
            gc.collect()
            if n in links and n >= 100:  # after this process gave its gigabytes back
                data["memory"][base][n] = memory(base, n)
            print(f"{base}, {n} links: {seconds['automatic'] / seconds['bare']:.2f} times the bare calls", flush=True)
    data["imports"] = imports()
    return data


def report(data: dict[str, Any]) -> str:
    """Write the page."""
    lines = [
        "# Cost of the right-hand side",
        "",
        f"Chains of equal links: rod {ROD} m, {MASS} kg, both legs with springs of {LEG['stiffness']:g} N/m, tip mass {TIP} kg. "
        "Processor time of one thread, the fastest of batches taken in turn, so read it as ratios. Bare calls: `crba` and "
        "`nonLinearEffects` on the same state.",
        "",
        "## One evaluation",
        "",
        f"Acceptable: {LIMIT:g} times the bare calls for one link on the ski. *Ours* is the route `simulate` takes.",
        "",
    ]
    header = ("chain", "velocities", "bare, us", "ours, us", "ours / bare", "recursive / bare", "dense / bare")
    rows = []
    for base, sizes in data["cost"].items():
        for n, s in sizes.items():
            ratios = (f"{s[name] / s['bare']:.2f}" for name in ("automatic", "recursive", "dense"))
            rows.append((f"{base}, {n}", _velocities(base, n), micro(s["bare"]), micro(s["automatic"]), *ratios))
    lines += [table(header, rows), ""]
    for route, names in PARTS.items():
        rows = []
        for base, sizes in data["cost"].items():
            for n, s in sizes.items():
                rest = s[route] - sum(s.get(name, 0.0) for name in names)
                cells = [micro(s[name]) if name in s else "-" for name in names]
                rows.append((f"{base}, {n}", *cells, micro(max(rest, 0.0)), micro(s[route])))
        lines += [f"Parts of the {route} route, us:", "", table(("chain", *names, "rest", "whole"), rows), ""]
    lines += ["## Driver included", ""]
    lines += [
        f"Processor time of whole runs over their evaluations, rtol 1e-8, 60 samples a second. Acceptable: {DRIVER_LIMIT:g} "
        "times the bare calls for one link on the ski.",
        "",
    ]
    rows = []
    for base, sizes in data["driver"].items():
        for n, methods in sizes.items():
            row: list[str] = [f"{base}, {n}"]
            for method in DRIVERS:
                entry = methods[method]
                row += [micro(entry["seconds"]), f"{entry['ratio']:.2f}", str(entry["evaluations"])]
            rows.append(tuple(row))
    header = ("chain", *(text for m in DRIVERS for text in (f"{m}, us", f"{m} / bare", "evaluations")))
    lines += [table(header, rows), "", "## Accuracy", ""]
    lines += [
        "Largest relative error of direction and length accelerations over "
        f"{STATES} postures, beside mass points in numbers of {np.finfo(LONG).nmant + 1} bits (double: 53).",
        "",
    ]
    rows = []
    for n in data["error"]["pivot"]:
        row = [str(n)]
        for base in BASES:
            s, e = data["time"][base][n], data["error"][base][n]
            row += [f"{s['dense'] / s['recursive']:.2f}", f"{e['recursive']:.1e}", f"{e['dense']:.1e}"]
        rows.append(tuple(row))
    header = (
        "links",
        *(f"{base}: {text}" for base in BASES for text in ("time dense / recursive", "error recursive", "error dense")),
    )
    lines += [table(header, rows), ""]
    lines += [f"* {base}, ahead in time: {crossover(data['time'][base])}." for base in BASES]
    lines += [f"* {base}, ahead in error: {crossover(data['error'][base])}." for base in BASES]
    lines += [
        f"* `simulate` takes the recursive route for spring-dampers up to {LONG_CHAIN} links; longer chains go as "
        "[sub-chains](long_chains.md) where they can; the rest is dense.",
        "",
        "![time and error of both routes](rhs_cost.png)",
        "",
        "## Memory",
        "",
        "`pinocchio.Data` holds about 4 nv^3 doubles; measured: what a process grows by when it builds and evaluates the chain.",
        "",
    ]
    rows = [
        (f"{base}, {n}", _velocities(base, n), f"{m['estimate'] / 2**20:.4g}", f"{m['measured'] / 2**20:.4g}")
        for base, sizes in data["memory"].items() for n, m in sizes.items()
    ]  # fmt: skip
    lines += [table(("chain", "velocities", "estimate, MiB", "measured, MiB"), rows), "", "## Imports", ""]
    ratio = data["imports"]["vlmb"] / data["imports"]["bare"]
    lines += [
        f"`import vlmb` takes {1e3 * data['imports']['vlmb']:.0f} ms of processor time, `import pinocchio, scipy.integrate` "
        f"{1e3 * data['imports']['bare']:.0f} ms: {ratio:.2f} times; acceptable: {IMPORT_LIMIT:g} times.",
    ]
    return "\n".join(lines)


def _velocities(base: str, links: int) -> int:
    return 5 * links + (3 if base == "ski" else 0)


def draw(data: dict[str, Any], figure: Figure) -> None:
    """Time over the bare calls, and error, of both routes over the number of links."""
    axes = figure.subplots(1, 2)
    styles = {"pivot": "-", "ski": "--"}
    for base in BASES:
        sizes = sorted(data["time"][base])
        for route, colour in (("recursive", PALETTE[0]), ("dense", PALETTE[1])):
            ratios = [data["time"][base][n][route] / data["time"][base][n]["bare"] for n in sizes]
            wrong = [data["error"][base][n][route] for n in sizes]
            axes[0].plot(sizes, ratios, styles[base], color=colour, label=f"{route}, {base}", marker=".")
            axes[1].plot(sizes, wrong, styles[base], color=colour, label=f"{route}, {base}", marker=".")
    axes[0].axhline(1.0, color=GREY, linewidth=0.8)
    axes[0].set(xscale="log", yscale="log", xlabel="links", ylabel="time of one evaluation / bare calls")
    axes[1].axhline(float(np.finfo(float).eps), color=BLACK, linewidth=0.8)
    axes[1].set(xscale="log", yscale="log", xlabel="links", ylabel="largest relative error of accelerations")
    axes[0].legend()


def main() -> None:
    """Measure, print and write the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", type=int, nargs="+", default=list(LINKS))
    parser.add_argument("--memory", nargs=2, metavar=("BASE", "LINKS"), help="print the memory one chain takes, and stop")
    args = parser.parse_args()
    if args.memory:
        print_memory(args.memory[0], int(args.memory[1]))
        return
    data = measure(tuple(args.links))
    page = report(data)
    print(page)
    if tuple(args.links) == LINKS:
        save_figure("rhs_cost", lambda figure: draw(data, figure), 9.0, 4.0)
        write_report("rhs_cost", page, data)


if __name__ == "__main__":
    main()
