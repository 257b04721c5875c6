"""Blocks of the equations of motion from Pinocchio against the closed forms: largest error of each block, and time of each route.

Usage: python benchmarks/closed_form.py [LARGEST_N]. A chain of 100 links with every length free takes 4 GB.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from common import interleaved, table, write_report

# isort: split
import numpy as np

from vlmb.equations.closed_form import ChainParameters, chain_parameters, chain_state, equation_blocks
from vlmb.equations.closed_form import bias as closed_bias
from vlmb.equations.closed_form import mass_matrix as closed_mass_matrix
from vlmb.equations.motion import equations_of_motion
from vlmb.errors import VlmbError
from vlmb.model.mechanism import Mechanism, build
from vlmb.scene.scene import Scene
from vlmb.views.style import BLACK, PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINKS = (1, 2, 5, 10, 20, 50, 100)
POSTURES = {1: 100, 2: 100, 5: 100, 10: 50, 20: 30, 50: 20, 100: 5}
FLOOR = 1e-3  # of the mass matrix's largest entry: a block that is smaller at a posture is judged by this
CHAIN_BLOCKS = ("A", "B", "C1", "C2", "D", "E", "F1", "F2", "G", "H1", "H2", "K")
SKI_BLOCKS = ("X", "Y", "PHI0", "phi0dot_phi0dot")
FORMS = ("full", "chaplygin", "speed")
ROUTES = {
    "closed form: M, h": "mass matrix and bias by numpy",
    "closed form: blocks": "every block by numpy",
    "Pinocchio: M, h": "mass matrix and bias by CRBA and RNEA",
    "Pinocchio: blocks": "every block by CRBA and 7 RNEA a link",
}


def skier(n: int, rng: np.random.Generator) -> tuple[Mechanism, ChainParameters]:
    """Make a ski with n links, tip masses at all of them, and the same for the closed forms."""
    length, mass, tip = rng.uniform(0.3, 1.0, n), rng.uniform(1.0, 5.0, n), rng.uniform(0.5, 3.0, n)
    ski = {"mass": 5.0, "inertia": 0.6, "com_offset": 0.1}
    links = [
        {"rod": {"length": a, "mass": m}, "lower": {"length": 0.3}, "upper": {"length": 0.2}, "tip_mass": t}
        for a, m, t in zip(length.tolist(), mass.tolist(), tip.tolist(), strict=True)
    ]
    scene = Scene.from_dict({"base": {"kind": "ski", **ski}, "links": links, "slope": 0.2})
    parameters = chain_parameters(length, mass, tip, ski_mass=5.0, ski_inertia=0.6, com_offset=0.1, slope=0.2)
    return build(scene), parameters


def posture(mechanism: Mechanism, rng: np.random.Generator) -> tuple[dict[str, float], dict[str, float]]:
    """Draw |psi|, |phi0| < 1.2, any azimuth, and rates."""
    coordinates = {}
    for name in mechanism.coordinate_names:
        low, high = (0.1, 0.6) if name.startswith("xi") else (-1.2, 1.2)
        if name.startswith("phi") and name != "phi0":
            low, high = -np.pi, np.pi
        coordinates[name] = float(rng.uniform(low, high))
    return coordinates, {f"{name}_dot": float(rng.uniform(-2.0, 2.0)) for name in coordinates}


def errors(n: int, mechanism: Mechanism, parameters: ChainParameters, rng: np.random.Generator) -> dict[str, float]:
    """Largest error of each block over postures, forms and rows, relative to the block's largest entry."""
    worst: dict[str, float] = dict.fromkeys((*CHAIN_BLOCKS, *SKI_BLOCKS), 0.0)
    for k in range(POSTURES[n]):
        (coordinates, rates), form = posture(mechanism, rng), FORMS[k % 3]
        eom = equations_of_motion(mechanism, coordinates, rates, form)
        floor = FLOOR * np.abs(eom.mass_matrix).max()
        for (block, row), value in equation_blocks(parameters, chain_state(n, coordinates, rates), form).items():
            name = block if block in worst else "X"  # SPEED, xdot_phi0dot and the like: columns of the ski's motion
            error = np.abs(eom.blocks[block, row] - value).max() / max(np.abs(value).max(), floor)
            worst[name] = max(worst[name], float(error))
    return worst


def times(n: int, mechanism: Mechanism, parameters: ChainParameters, rng: np.random.Generator) -> dict[str, float]:
    """Seconds of each route at one posture, full form."""
    coordinates, rates = posture(mechanism, rng)

    def engine_matrices() -> Any:
        eom = equations_of_motion(mechanism, coordinates, rates)
        return eom.mass_matrix, eom.bias

    def closed_matrices() -> Any:
        state = chain_state(n, coordinates, rates)
        return closed_mass_matrix(parameters, state, "full"), closed_bias(parameters, state, "full")

    def closed_blocks() -> Any:
        return equation_blocks(parameters, chain_state(n, coordinates, rates), "full")

    functions: dict[str, Callable[[], Any]] = {
        "closed form: M, h": closed_matrices,
        "closed form: blocks": closed_blocks,
        "Pinocchio: M, h": engine_matrices,
        "Pinocchio: blocks": lambda: equations_of_motion(mechanism, coordinates, rates).blocks,
    }
    return interleaved(functions, repeats=30)


def draw(figure: Figure, results: dict[int, dict[str, Any]]) -> None:
    """Errors and times against n, log-log."""
    ns = list(results)
    left, right = figure.subplots(1, 2)
    groups = {
        "accelerations  A B C X Y PHI0": ("A", "B", "C1", "C2", "X", "Y", "PHI0"),
        "velocity products  D E F G H": ("D", "E", "F1", "F2", "G", "H1", "H2", "phi0dot_phi0dot"),
        "gravity  K": ("K",),
    }
    for (label, blocks), colour, marker in zip(groups.items(), PALETTE, "os^", strict=False):
        values = [max(results[n]["errors"][block] for block in blocks) for n in ns]
        left.loglog(ns, values, color=colour, marker=marker, markersize=4, label=label)
    left.axhline(1e-12, color=BLACK, linestyle="--", linewidth=1.0, label="required")
    left.set_ylim(1e-16, 3e-12)
    left.set(xlabel="links n", ylabel="largest error / block's largest entry", title="Pinocchio against the closed forms")
    for name, colour, marker in zip(ROUTES, (PALETTE[3], PALETTE[1], PALETTE[5], PALETTE[0]), "o^os", strict=True):
        right.loglog(ns, [1e3 * results[n]["seconds"][name] for n in ns], color=colour, marker=marker, markersize=4, label=name)
    right.set(xlabel="links n", ylabel="time of one posture [ms]", title="Time of each route")
    for axes in (left, right):
        axes.set_xticks(ns, [str(n) for n in ns])
        axes.minorticks_off()
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)


def report(results: dict[int, dict[str, Any]]) -> str:
    """Markdown with both tables."""
    ns = list(results)
    blocks = list(results[ns[0]]["errors"])
    error_rows = [[n, *(f"{results[n]['errors'][block]:.0e}" for block in blocks)] for n in ns]
    routes = list(ROUTES)
    time_rows = []
    for n in ns:
        seconds = results[n]["seconds"]
        ratios = [f"{seconds[name] / seconds[routes[1]]:.2g}" for name in routes]
        time_rows.append([n, results[n]["coordinates"], *ratios, f"{1e3 * seconds[routes[1]]:.2g} ms"])
    worst = max(max(results[n]["errors"].values()) for n in ns)
    return f"""# Blocks of the equations: Pinocchio against the closed forms

A ski with n links, all lengths free, a tip mass on every link, slope and com_offset; random postures with |psi|, |phi0| < 1.2.

![errors and times](closed_form.png)

## Largest error of each block

Over all rows, the three forms and {", ".join(f"{POSTURES[n]}" for n in ns)} postures, relative to the block's largest entry at
that posture. A block that is smaller than {FLOOR:g} of the mass matrix's largest entry, or zero as all of row phi0 but its own
column, is judged by that. X holds the columns of the ski's motion in the reduced forms too. The largest of all is {worst:.1e}.

{table(["n", *blocks], error_rows)}

## Time

{chr(10).join(f"* *{name}*: {what}" for name, what in ROUTES.items())}

Full form, one posture, relative to *closed form: blocks*, whose own time is in the last column.

{table(["n", "coordinates", *routes, "unit"], time_rows)}
"""


def main() -> None:
    """Measure, write the report and the picture."""
    largest = int(sys.argv[1]) if len(sys.argv) > 1 else max(LINKS)
    results: dict[int, dict[str, Any]] = {}
    for n in (n for n in LINKS if n <= largest):
        rng = np.random.default_rng(n)
        try:
            mechanism, parameters = skier(n, rng)
        except VlmbError as error:
            print(f"n = {n} left out: {error}")
            continue
        results[n] = {
            "coordinates": len(mechanism.coordinate_names),
            "errors": errors(n, mechanism, parameters, rng),
            "seconds": times(n, mechanism, parameters, rng),
        }
        print(f"n = {n}: largest error {max(results[n]['errors'].values()):.1e}, {results[n]['seconds']}")
        del mechanism  # its Data may be gigabytes
    picture = (lambda figure: draw(figure, results), 9.0, 4.8)
    write_report("closed_form", [report(results)], {"postures": POSTURES, "results": results}, picture=picture)


if __name__ == "__main__":
    main()
