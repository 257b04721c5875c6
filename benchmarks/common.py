"""What all benchmarks share: timing, and one way to report in benchmarks/results.

Import it before numpy (`# isort: split` below the import): it asks BLAS for one thread, without which small matrices are timed
by chance.
"""

from __future__ import annotations

import gc
import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

from vlmb.studies.bench import footer, table  # noqa: E402

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CLOCK", "MODELS", "PACKAGES", "RESULTS", "interleaved", "micro", "save_figure", "table", "write_report"]

RESULTS = Path(__file__).resolve().parent / "results"
MODELS = RESULTS.parents[1] / "models"
PACKAGES = ("pin", "numpy", "scipy")
CLOCK = time.thread_time if time.get_clock_info("thread_time").resolution < 1e-6 else time.perf_counter


def interleaved(functions: Mapping[str, Callable[[], object]], repeats: int = 20, number: int | None = None) -> dict[str, float]:
    """Seconds of one call of each function by name: the fastest of `repeats` batches, taken in turn after a warm-up.

    Without `number` a batch lasts about 3 ms. A slow spell of the machine hits all alike, and seconds are those of this thread,
    so that other work does not count: read them as ratios. A function that starts threads needs `time.perf_counter` instead.
    """
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


def micro(seconds: float) -> str:
    """Microseconds with three digits."""
    return f"{1e6 * seconds:.3g}" if seconds < 1e-2 else f"{1e6 * seconds:.0f}"


def write_report(
    name: str,
    parts: Sequence[str],
    data: Mapping[str, Any],
    packages: Sequence[str] = PACKAGES,
    picture: tuple[Callable[[Figure], None], float, float] | None = None,
) -> None:
    """Print a page of parts; write results/NAME.md, NAME.json and NAME.png of a picture (function, width, height [inches]).

    Machine and versions stand in the last line of the page and in the data.
    """
    RESULTS.mkdir(exist_ok=True)
    where = footer(packages)
    text = "\n\n".join([*(part.strip("\n") for part in parts), f"Measured by `benchmarks/{name}.py` on {where}"])
    print(text)
    (RESULTS / f"{name}.md").write_text(f"{text}\n", encoding="utf-8")
    numbers = json.dumps(_plain({**data, "machine": where}), indent=1, allow_nan=False)
    (RESULTS / f"{name}.json").write_text(f"{numbers}\n", encoding="utf-8")
    if picture is not None:
        save_figure(name, *picture)


def save_figure(name: str, draw: Callable[[Figure], None], width: float, height: float) -> None:
    """Draw on an empty figure [inches] in the project's style and save it as results/NAME.png."""
    from matplotlib.figure import Figure

    from vlmb.views.style import style

    RESULTS.mkdir(exist_ok=True)
    with style():
        figure = Figure(figsize=(width, height), layout="constrained")
        draw(figure)
        figure.savefig(RESULTS / f"{name}.png", dpi=150, metadata={"Software": None})


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
