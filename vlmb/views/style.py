"""The style of all figures: colours that colour-blind readers tell apart, labels in the paper's symbols, legends outside."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.model.names import plain
from vlmb.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Make = TypeVar("Make", bound=Callable[..., Any])

QUIET = 1e-7  # [rad, m, per s] of spans that only rounding errors make
BLACK, GREY, SNOW = "#000000", "#8a8a8a", "#56B4E9"
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9")  # Okabe and Ito, without yellow
DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)), (0, (9, 3)))
RC = {
    "font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"], "font.size": 9.0, "mathtext.fontset": "cm",
    "axes.labelsize": 10.0, "axes.titlesize": 9.5, "axes.grid": True, "grid.color": "#dddddd", "grid.linewidth": 0.6,
    "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True, "axes.facecolor": "white",
    "figure.facecolor": "white", "savefig.facecolor": "white", "text.color": "black", "axes.labelcolor": "black",
    "lines.linewidth": 1.3, "legend.fontsize": 9.0, "legend.frameon": False, "legend.handlelength": 2.2,
    "axes.formatter.useoffset": False, "axes.formatter.limits": (-4, 5), "axes.formatter.use_mathtext": False,
    "axes.unicode_minus": True, "text.usetex": False, "figure.constrained_layout.use": True,
}  # fmt: skip


class Series(NamedTuple):
    """One line of a panel: its label, the number of its colour (a link, -1 the base), how to read it (None: not in this run)."""

    label: str
    link: int
    read: Callable[[Trajectory], Array | None]


def not_there(need: str, package: str, extra: str, error: ImportError) -> VlmbError:
    """Say what is not installed: a package, or one that it imports itself."""
    missing = (error.name or package).partition(".")[0]
    if not isinstance(error, ModuleNotFoundError) or missing == package:
        why = "" if isinstance(error, ModuleNotFoundError) else f" ({error})"
        return VlmbError(f"{need}, which {'cannot be imported' if why else 'is not installed'}{why}: pip install vlmb[{extra}]")
    name = "pillow" if missing == "PIL" else missing
    return VlmbError(f"{need}, which needs {name}, and that is not installed: pip install {name}")


@contextmanager
def style() -> Iterator[None]:
    """Put the style on for a while; matplotlib's own settings come back afterwards.

    Raises VlmbError when matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise not_there("plots need matplotlib", "matplotlib", "plots", error) from None
    with matplotlib.rc_context(RC):
        yield


def styled(make: Make) -> Make:
    """Make a figure in the style."""

    @wraps(make)
    def made(*args: Any, **kwargs: Any) -> Any:
        with style():
            return make(*args, **kwargs)

    return made  # type: ignore[return-value]


def new_figure(runs: Sequence[Trajectory], width: float, height: float, title: str) -> Figure:
    """Return an empty figure [inches] with a title; no pyplot, so nothing is shown or kept."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    names = list(dict.fromkeys(run.scene.name for run in runs))
    lines = textwrap.wrap(f"{title}: {', '.join(names)}", int(width * 12))
    for run in runs if len(runs) == 1 else ():
        if run.status != "finished":
            lines += textwrap.wrap(run.message, int(width * 12))
    figure.suptitle("\n".join(plain(line) for line in lines[:5]), fontsize=10.5)
    return figure


def empty_figure(runs: Sequence[Trajectory], title: str, why: str) -> Figure:
    """Return a figure without axes that says why there is nothing to draw."""
    figure = new_figure(runs, 6.0, 1.5, title)
    figure.text(0.5, 0.4, why, ha="center", va="center")
    return figure


def link_colour(link: int, links: int) -> Any:
    """Return the colour of a link; black for the base (-1; -2, -3: its y, z). Many links share one dark-to-light scale."""
    if link < 0:
        return (BLACK, PALETTE[1], PALETTE[2])[-1 - link]
    if links <= len(PALETTE):
        return PALETTE[link]
    return _scale()(link / (links - 1))


def _scale() -> Any:
    import matplotlib
    from matplotlib.colors import ListedColormap

    return ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.9, 256)))


def draw(
    ax: Axes, runs: Sequence[Trajectory], series: Sequence[Series],
    x: Sequence[Callable[[Trajectory], Array | None]] | None = None, links: int | None = None, by_run: bool = False,
) -> None:  # fmt: skip
    """Draw series of all runs: dashes by run, colours by link, or by run as well (`by_run`)."""
    links = links or max(len(run.scene.links) for run in runs)
    for number, entry in enumerate(series):
        for k, run in enumerate(runs):
            across, values = run.t if x is None else x[number](run), entry.read(run)
            if values is None or across is None:
                continue
            ax.plot(
                across, values, label=entry.label, linestyle=DASHES[k % len(DASHES)], marker="o" if len(values) == 1 else "",
                color=PALETTE[k % len(PALETTE)] if by_run and len(runs) > 1 else link_colour(entry.link, links),
            )  # fmt: skip
    if ax.lines and x is None:
        start, end = min(run.t[0] for run in runs), max(run.t[-1] for run in runs)
        ax.set_xlim(start, end if end > start else start + 1.0)


def calm(ax: Axes, also_x: bool = False) -> None:
    """Give a panel whose values are constant but for rounding errors a scale of 0.001 about them."""
    for low, high, limit in ((*ax.get_ylim(), ax.set_ylim), (*ax.get_xlim(), ax.set_xlim))[: 1 + also_x]:
        if abs(high - low) < QUIET * max(1.0, abs(high)):
            middle = 0.5 * (low + high)
            limit(middle - 1e-3 * max(1.0, abs(middle)), middle + 1e-3 * max(1.0, abs(middle)))


def legend_beside(ax: Axes, above: bool = False) -> None:
    """Put a legend to the right of a panel, or above it; none for one line, or for so many that a scale serves better."""
    entries = {_label(line): line for line in reversed(ax.lines) if _label(line)[0] != "_"}
    if not 1 < len(entries) <= len(PALETTE) + 2:
        return
    labels = list(reversed(entries))
    where: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.02), "borderaxespad": 0.0}
    if above:
        columns = min(len(labels), 2 if max(map(len, labels)) > 24 else 4)
        where = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": columns}
    ax.legend([entries[label] for label in labels], labels, **where)


def finish(figure: Figure, runs: Sequence[Trajectory], labels: Sequence[str] | None, by_link: bool = True) -> Figure:
    """Name the runs below the panels, and many links on a scale beside them."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.lines import Line2D

    panels = list(figure.axes)
    links = max((run.scene.links for run in runs), key=len)
    if by_link and len(links) > len(PALETTE):
        colours = ListedColormap([link_colour(i, len(links)) for i in range(len(links))])
        shown = ScalarMappable(BoundaryNorm(np.arange(len(links) + 1) - 0.5, len(links)), colours)
        ticks = range(0, len(links), max(1, -(-len(links) // 20)))
        bar = figure.colorbar(shown, ax=panels, ticks=list(ticks), aspect=40, pad=0.01, shrink=0.9)
        bar.ax.set_yticklabels([f"{i + 1} {links[i].name[:16]}" for i in ticks])
        bar.ax.minorticks_off()
        bar.ax.set_ylabel("link")
    if len(runs) > 1:
        alone = all(len(_labels(ax)) <= 1 for ax in panels)
        handles = [
            Line2D([], [], color=PALETTE[k % len(PALETTE)] if alone else GREY, linestyle=DASHES[k % len(DASHES)])
            for k in range(len(runs))
        ]
        texts = [plain(text) for text in (labels or run_labels(runs))]
        columns = max(1, min(len(texts), int(figure.get_figwidth() * 10 / (max(map(len, texts)) + 6))))
        figure.legend(handles, texts, loc="outside lower center", ncols=columns)
    return figure


def _labels(ax: Axes) -> set[str]:
    return {text for text in map(_label, ax.lines) if text[0] != "_"}


def _label(line: Any) -> str:
    return str(line.get_label())


def run_labels(runs: Sequence[Trajectory]) -> list[str]:
    """Tell runs apart by what differs: scene name, method, tolerance, step, knife edge."""
    columns: list[list[str]] = [
        [run.scene.name for run in runs],
        [run.run.method for run in runs],
        [f"step {run.run.step:g} s" if run.run.step else f"rtol {run.run.rtol:g}" for run in runs],
        [run.run.knife_edge for run in runs],
    ]
    different = [column for column in columns if len(set(column)) > 1]
    texts = [", ".join(parts) for parts in zip(*different, strict=True)] if different else [""] * len(runs)
    return texts if len(set(texts)) == len(runs) else [f"run {k + 1}{': ' if t else ''}{t}" for k, t in enumerate(texts)]
