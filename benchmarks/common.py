"""What all benchmarks share: timing, the footer with machine and versions, reports and figures in benchmarks/results.

Import it before numpy (`# isort: split` below the import): it asks BLAS for one thread, without which small matrices are timed
by chance.
"""

from __future__ import annotations

import gc
import json
import math
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # measure this tree, installed or not

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RESULTS = Path(__file__).resolve().parent / "results"
PACKAGES = ("pin", "numpy", "scipy")
CLOCK = time.thread_time if time.get_clock_info("thread_time").resolution < 1e-6 else time.perf_counter


def footer(packages: Sequence[str] = PACKAGES) -> str:
    """One line: machine, system, and versions of Python and of the packages that are installed."""
    from vlmb.studies.bench import footer

    return footer(packages)


def fastest(function: Callable[[], object], repeats: int = 20, number: int | None = None) -> float:
    """Seconds of one call: the fastest of `repeats` batches of `number` calls after a warm-up.

    Without `number` a batch lasts about 3 ms. Seconds are those of this thread, so that other work of the machine does not count;
    a function that starts threads needs `time.perf_counter` around it instead. Read the result as a ratio to another one of the
    same run.
    """
    return interleaved({"": function}, repeats, number)[""]


def interleaved(functions: Mapping[str, Callable[[], object]], repeats: int = 20, number: int | None = None) -> dict[str, float]:
    """Seconds of one call of each function by name, batches taken in turn, so that a slow spell of the machine hits all."""
    numbers = {}
    for name, function in functions.items():
        function()
        numbers[name] = number or max(1, math.ceil(0.003 / max(min(_batch(function, 1) for _ in range(3)), 1e-9)))
    best = dict.fromkeys(functions, math.inf)
    collecting = gc.isenabled()
    gc.disable()
    try:
        for _ in range(repeats):
            for name, function in functions.items():
                best[name] = min(best[name], _batch(function, numbers[name]))
    finally:
        if collecting:
            gc.enable()
    return best


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Markdown table; the first column is aligned to the left, the others to the right."""
    lines = ["| " + " | ".join(header) + " |", "| --- |" + " ---: |" * (len(header) - 1)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def write_report(name: str, markdown: str, data: Mapping[str, Any], packages: Sequence[str] = PACKAGES) -> list[Path]:
    """Write results/NAME.md and results/NAME.json, both with the footer; return the files."""
    RESULTS.mkdir(exist_ok=True)
    where = footer(packages)
    page, numbers = RESULTS / f"{name}.md", RESULTS / f"{name}.json"
    page.write_text(f"{markdown.rstrip()}\n\nMeasured by `benchmarks/{name}.py` on {where}\n", encoding="utf-8")
    numbers.write_text(json.dumps(_plain({**data, "machine": where}), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return [page, numbers]


def save_figure(name: str, draw: Callable[[Figure], None], width: float, height: float) -> Path:
    """Draw on an empty figure [inches] in the project's style and save it as results/NAME.png."""
    from matplotlib.figure import Figure

    from vlmb.views.style import style

    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.png"
    with style():
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure)
        figure.savefig(path, dpi=150, metadata={"Software": None})
    return path


def _batch(function: Callable[[], object], number: int) -> float:
    start = CLOCK()
    for _ in range(number):
        function()
    return (CLOCK() - start) / number


def _plain(value: Any) -> Any:
    """Numpy numbers and arrays as plain ones, keys as text, what is not finite as null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
