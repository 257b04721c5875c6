"""Other engines beside the default method and the plain Pinocchio loop, on the same scenes in the same turns.

Usage: python benchmarks/engines.py; needs `pip install vlmb[benchmarks]`, and a C compiler for CasADi.
"""

from __future__ import annotations

import math
from typing import Any

from common import save_figure, table, write_report

# isort: split
from work_precision import ERRORS, one_scene, ratio_rows

from vlmb.style import BLACK, PALETTE

SCENES = ("one link", "two links", "skier, spring link")
PEERS = ("mujoco", "casadi", "sympy_kane", "drake", "exudyn")


def report(found: dict[str, dict[str, Any]]) -> str:
    """Markdown: time over the plain loop's at each error, and what an engine cannot express."""
    rows, notes = [], []
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
            "of the two links the second passes close to the vertical.",
            "",
            "A setting whose run takes more than 0.6 s ends an engine's line; - means that it does not reach the error before.",
            "",
            "![error against time](engines.png)",
        ]
    )


def draw(figure: Any, found: dict[str, dict[str, Any]]) -> None:
    """Error against time, a panel a scene."""
    axes = list(figure.subplots(1, len(found)))
    names = list(dict.fromkeys(label.removesuffix(", sampled") for extra in found.values() for label in extra["points"]))
    colours = dict(zip(names, (BLACK, *PALETTE), strict=True))
    for panel, (name, extra) in zip(axes, found.items(), strict=True):
        for label, values in extra["points"].items():
            line = sorted((seconds, max(error, 1e-16)) for seconds, error, _ in values if math.isfinite(error))
            dash = "--" if label.endswith("sampled") else "-"
            panel.loglog(
                *zip(*line, strict=True), color=colours[label.removesuffix(", sampled")], linestyle=dash, marker=".", label=label
            )
        panel.set(xlabel="CPU time [s]", ylabel="final position error [m]", title=name, ylim=(1e-13, 1.0))
    shown = {label: line for panel in axes for line, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=5)


def main() -> None:
    """Measure, write the report and the picture."""
    found = {name: one_scene(name, PEERS, methods=["adams"], repeats=5, budget=0.6)[1] for name in SCENES}
    text = report(found)
    print(text)
    save_figure("engines", lambda figure: draw(figure, found), 11.0, 4.2)
    write_report("engines", text, found, ("pin", "numpy", "scipy", "mujoco", "casadi", "sympy", "drake", "exudyn"))


if __name__ == "__main__":
    main()
