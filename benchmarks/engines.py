"""Other engines beside the default method and the plain Pinocchio loop, on the same scenes in the same turns.

Usage: python benchmarks/engines.py [SCENE ...]; needs `pip install vlmb[benchmarks]`, and a C compiler for CasADi. Some scenes
are printed; all together are written to benchmarks/results.
"""

from __future__ import annotations

import math
import sys
from typing import Any

from common import table, write_report

# isort: split
from work_precision import ERRORS, one_scene, ratio_rows

from vlmb.views.style import BLACK, GREY, PALETTE

SCENES = {  # repeats, and seconds of a run that ends an engine's line
    "one link": (5, 0.6),
    "two links": (5, 0.6),
    "skier, spring link": (5, 0.6),
    "eight links": (2, 2.0),
    "fifty links": (1, 2.0),
}
PEERS = ("mujoco", "casadi", "sympy_kane", "drake", "exudyn", "heyoka")
PACKAGES = ("pin", "numpy", "scipy", "mujoco", "casadi", "sympy", "drake", "exudyn", "heyoka")


def one(name: str) -> dict[str, Any]:
    """Measure a scene; add what peers say of setting it up."""
    repeats, budget = SCENES[name]
    extra = one_scene(name, PEERS, methods=["dop853"], repeats=repeats, budget=budget)[1]
    for peer in PEERS:
        extra["notes"] += getattr(sys.modules.get(f"peers.{peer}"), "NOTES", [])
    return extra


def report(found: dict[str, dict[str, Any]]) -> str:
    """Markdown: time over the plain loop's at each error, and what an engine cannot express."""
    rows, notes = [], []
    limits = ", ".join(f"{budget:g} s ({name})" for name, (_, budget) in SCENES.items())
    for name, extra in found.items():
        rows += ratio_rows(name, extra["points"], "plain loop", "plain loop, sampled")
        notes += [f"* {name}: {note}" for note in extra["notes"]]
    return "\n".join(
        [
            "# Other engines",
            "",
            "Processor time to a final position error over that of a plain Pinocchio loop with SciPy's DOP853, setup excluded. "
            "*Sampled*: both give 60 samples a second; all others give the end alone.",
            "",
            table(["scene: engine", *(f"{error:g} m" for error in ERRORS)], rows),
            "",
            *notes,
            "",
            "SymPy, CasADi, Drake and EXUDYN have two angles a link here, so they have poles, and need more steps near one; "
            "of the two links the second passes close to the vertical. EXUDYN's explicit solvers take no constraints: on the ski "
            "it runs with generalized alpha, of order 2.",
            "",
            "heyoka knows no mechanisms: its equations are written for these chains (`benchmarks/peers/heyoka.py`). It stands "
            "for what a compiled core would bring: the equations alone in the place of the plain loop's right-hand side, and a "
            "Taylor series method of its own.",
            "",
            f"A setting whose run takes more than {limits} ends an engine's line; - means that it does not reach the error "
            "before.",
            "",
            "![error against time](engines.png)",
        ]
    )


def engine(label: str) -> str:
    """First word of a label."""
    return label.split()[0].rstrip(",")


def draw(figure: Any, found: dict[str, dict[str, Any]]) -> None:
    """Error against time, a panel a scene."""
    from matplotlib.ticker import NullFormatter

    *axes, last = figure.subplots(math.ceil((len(found) + 1) / 3), 3, squeeze=False).flat
    engines = list(dict.fromkeys(engine(label) for extra in found.values() for label in extra["points"]))
    colours = dict(zip(engines, (BLACK, GREY, *PALETTE), strict=False))
    for panel, (name, extra) in zip(axes, found.items(), strict=False):
        drawn = set()
        for label, values in extra["points"].items():
            kept = sorted((value for value in values if math.isfinite(value[1])), key=lambda value: value[2])
            line = [(seconds, max(error, 1e-16)) for seconds, error, _ in kept]
            dash = "--" if engine(label) in drawn else "-"
            drawn.add(engine(label))
            panel.loglog(*zip(*line, strict=True), color=colours[engine(label)], linestyle=dash, marker=".", label=label)
        panel.set(xlabel="CPU time [s]", ylabel="final position error [m]", title=name, ylim=(1e-13, 1.0))
        panel.xaxis.set_minor_formatter(NullFormatter())
        low, high = panel.get_xlim()
        if math.ceil(math.log10(low)) + 1 > math.floor(math.log10(high)):  # less than two powers of ten to read
            panel.set_xlim(10.0 ** math.floor(math.log10(low)), 10.0 ** math.ceil(math.log10(high)))
    shown = {label: line for panel in axes for line, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    for panel in (*axes[len(found) :], last):
        panel.axis("off")
    last.legend(shown.values(), shown.keys(), loc="center")


def main() -> None:
    """Measure; write the report and the picture when all scenes were measured."""
    names = sys.argv[1:]
    found = {name: one(name) for name in names or SCENES}
    if names:
        print(report(found))
        return
    write_report("engines", [report(found)], found, PACKAGES, (lambda figure: draw(figure, found), 11.0, 7.4))


if __name__ == "__main__":
    main()
