"""The style of all figures: colours that colour-blind readers tell apart, labels in the paper's symbols, legends outside."""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import VlmbError
from vlmb.model.names import plain
from vlmb.simulation.files import replacing
from vlmb.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Make = TypeVar("Make", bound=Callable[..., Any])

DPI = 130
TALLEST = 7.9  # [in] of a figure: a screen of 1080 lines shows it whole
LISTED = 30  # lines that a legend tells apart; more links share a scale
ALIKE, OFTEN = 0.008, 0.4  # lines nearer than this share of a panel's span, for this share of the time, hide each other
LABEL = 42.0  # [pt] from a panel to the label of its y axis
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")  # plain text is drawn much faster than mathematics
QUIET = 1e-7  # [rad, m, per s] of spans that only rounding errors make
BLACK, GREY, SNOW = "#000000", "#8a8a8a", "#56B4E9"
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9")  # Okabe and Ito, without yellow
BANDS, MOST_BANDS = ("#e3edf6", "#f8ead9", "#e2f1e8", "#f5e4ee", "#eeeeee", "#e8e4f4", "#f3f0d8", "#e0e0e0"), 12  # of phases
PHASES = "phases"  # marks the bands
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

    figure = Figure(figsize=(width, min(height, TALLEST)), layout="constrained")
    names = list(dict.fromkeys(run.scene.name for run in runs))
    lines = textwrap.wrap(f"{title}: {', '.join(names)}", int(width * 12), max_lines=6)
    for run in runs if len(runs) == 1 else ():
        if run.status != "finished":
            lines += textwrap.wrap(run.message, int(width * 12), max_lines=8)
    figure.suptitle("\n".join(plain(line) for line in lines), fontsize=10.5 if len(lines) < 4 else 8.0)
    return figure


def write(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG; drawn once, where `savefig` draws twice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(DPI)
    with replacing(path) as file, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # a letter of a name that the font does not have
        FigureCanvasAgg(figure).print_png(file, metadata={"Software": None}, pil_kwargs={"compress_level": 3})
    return path


def whole(text: str, width: int = 60) -> str:
    """Break a long equation into lines, for a legend or a title, and keep it from being read as mathematics."""
    return "\n".join(plain(line) for line in textwrap.wrap(text, width))


def empty_figure(runs: Sequence[Trajectory], title: str, why: str) -> Figure:
    """Return a figure without axes that says why there is nothing to draw."""
    figure = new_figure(runs, 6.0, 1.5, title)
    figure.text(0.5, 0.4, why, ha="center", va="center")
    return figure


def link_colour(link: int, links: int, told: bool = False) -> Any:
    """Return the colour of a link; black for the base (-1; -2, -3: its y, z). Very many links share one dark-to-light scale.

    `told`: dashes tell runs apart and not links, so that no colour may come twice.
    """
    if link < 0:
        return (BLACK, PALETTE[1], PALETTE[2])[-1 - link]
    if links <= (len(PALETTE) if told else LISTED):
        return PALETTE[link % len(PALETTE)]
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
    several = len(runs) > 1
    for number, entry in enumerate(series):
        for k, run in enumerate(runs):
            across, values = run.t if x is None else x[number](run), entry.read(run)
            if values is None or across is None:
                continue
            dashes = k if several else max(entry.link, 0) // len(PALETTE) * (links <= LISTED)
            (line,) = ax.plot(
                across, values, label=entry.label, linestyle=DASHES[dashes % len(DASHES)], marker="o" if len(values) == 1 else "",
                color=PALETTE[k % len(PALETTE)] if by_run and several else link_colour(entry.link, links, several),
            )  # fmt: skip
            line.set_gid(str(dashes % len(DASHES)))
            if several and k == 0:  # what lies on it leaves it visible
                line.set(linewidth=2.6, alpha=0.5)
    if ax.lines and x is None:
        start, end = min(run.t[0] for run in runs), max(run.t[-1] for run in runs)
        ax.set_xlim(start, end if end > start else start + 1.0)
        if len(runs) == 1:
            draw_phases(ax, runs[0])


def phase_colours(run: Trajectory) -> dict[tuple[str, ...], str]:
    """Return the colour of the bands of each set of closed contacts, in the order in which they come; none without events."""
    if not getattr(run, "events", ()):
        return {}
    sets = dict.fromkeys(phase.closed for phase in run.phases)
    colours = iter(BANDS)
    return {closed: next(colours, BANDS[-1]) if closed else "#ffffff" for closed in list(sets)[:MOST_BANDS]}


def draw_phases(ax: Axes, run: Trajectory) -> None:
    """Draw the phases of a run as bands behind a panel over time."""
    from matplotlib.collections import PolyCollection

    for closed, colour in phase_colours(run).items():
        if not closed:
            continue
        spans = [(phase.start, phase.end) for phase in run.phases if phase.closed == closed and phase.end > phase.start]
        corners = [[(low, 0.0), (high, 0.0), (high, 1.0), (low, 1.0)] for low, high in spans]
        bands = PolyCollection(corners, facecolors=colour, edgecolors="none", transform=ax.get_xaxis_transform(), zorder=0.05)
        bands.set_gid(PHASES)
        ax.add_collection(bands, autolim=False)


def reveal(*panels: Axes) -> None:
    """Where lines lie on each other, dash the upper ones and widen the lowest, alike in panels that share a legend."""
    rows = [[line for line in ax.lines if len(np.asarray(line.get_ydata())) > 1 and _label(line)[0] != "_"] for ax in panels]
    if len({len(lines) for lines in rows}) > 1 or not 1 < len(rows[0]) <= LISTED:
        return
    hides = np.zeros((len(rows[0]), len(rows[0])), dtype=bool)
    for lines in rows:
        values = np.array([np.asarray(line.get_ydata(), float) for line in lines])
        span = np.nanmax(values) - np.nanmin(values) if np.isfinite(values).any() else 0.0
        for upper in range(1, len(lines)):
            hides[upper, :upper] |= np.mean(np.abs(values[:upper] - values[upper]) <= ALIKE * span, axis=1) > OFTEN
    for upper in np.flatnonzero(hides.any(axis=1)).tolist():
        lowest = int(np.argmax(hides[upper]))
        worn = [(line.get_color(), _dashes(line)) for k, line in enumerate(rows[0]) if k != upper]
        taken = [_dashes(rows[0][k]) for k in np.flatnonzero(hides[upper])]
        free = [dash for dash in DASHES[1:] if (rows[0][upper].get_color(), dash) not in worn]
        chosen = next((dash for dash in free if dash not in taken), (free or DASHES[1:])[0])
        for lines in rows:
            lines[lowest].set_linewidth(2.8)
            lines[upper].set_linestyle(chosen)
            lines[upper].set_gid(str(DASHES.index(chosen)))


def _dashes(line: Any) -> Any:
    """The dashes a line was drawn with."""
    return DASHES[int(line.get_gid() or 0)]


def calm(ax: Axes, also_x: bool = False) -> None:
    """Give a panel whose values are constant but for rounding errors a scale of 0.001 about them."""
    for low, high, limit in ((*ax.get_ylim(), ax.set_ylim), (*ax.get_xlim(), ax.set_xlim))[: 1 + also_x]:
        if abs(high - low) < QUIET * max(1.0, abs(high)):
            middle = 0.5 * (low + high)
            limit(middle - 1e-3 * max(1.0, abs(middle)), middle + 1e-3 * max(1.0, abs(middle)))


def decades(ax: Axes, low: float, high: float) -> None:
    """Put a panel on a log axis from below `low` to above `high`, with whole decades alone where they are many."""
    from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator

    bottom, top = np.floor(np.log10(low) - 0.2), np.ceil(np.log10(high) + 0.2)
    ax.set_yscale("log")
    ax.set_ylim(10.0**bottom, 10.0**top)
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"10{str(round(np.log10(value))).translate(RAISED)}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    if top - bottom > 4:
        ax.yaxis.set_minor_locator(NullLocator())


def align(axes: Iterable[Axes]) -> None:
    """Put the labels of y axes at one distance from their panels; `align_ylabels` measures every tick for it."""
    from matplotlib.transforms import ScaledTranslation

    for ax in axes:
        away = ax.transAxes + ScaledTranslation(-LABEL / 72.0, 0.0, ax.figure.dpi_scale_trans)
        ax.yaxis.set_label_coords(0.0, 0.5, transform=away)


def label_size(label: str, room: float) -> float:
    """Return the size [pt] at which the longest line of a label fits beside a panel of some height [in]."""
    longest = max(map(len, label.split("\n")))
    return max(6.5, min(10.0, 10.0 * 0.9 * room / (0.078 * longest)))


def legend_beside(ax: Axes, above: bool = False, of: Axes | None = None) -> None:
    """Put a legend (of another panel's lines) to the right of a panel, or above it; none for one line, or for too many."""
    entries = {_label(line): line for line in reversed((of or ax).lines) if _label(line)[0] != "_"}
    if not 1 < len(entries) <= LISTED:
        return
    labels = list(reversed(entries))
    rows = sum(label.count("\n") + 1 for label in labels)
    small = rows > 7
    room = ax.get_position().height * ax.get_figure().get_figheight() / (0.17 if small else 0.2)  # type: ignore[union-attr]
    where: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.02), "borderaxespad": 0.0,
                             "ncols": max(1, -(-rows // max(int(room), 1)))}  # fmt: skip
    if above:
        columns = min(len(labels), 2 if max(map(len, labels)) > 24 else 4)
        where = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": columns}
    ax.legend([entries[label] for label in labels], labels, fontsize=7.5 if small else 9.0, columnspacing=1.2, **where)


def finish(figure: Figure, runs: Sequence[Trajectory], labels: Sequence[str] | None, by_link: bool = True) -> Figure:
    """Name the runs below the panels, and many links on a scale beside them."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.lines import Line2D

    panels = list(figure.axes)
    links = max((run.scene.links for run in runs), key=len)
    if by_link and len(links) > LISTED:
        colours = ListedColormap([link_colour(i, len(links)) for i in range(len(links))])
        shown = ScalarMappable(BoundaryNorm(np.arange(len(links) + 1) - 0.5, len(links)), colours)
        ticks = range(0, len(links), max(1, -(-len(links) // 20)))
        bar = figure.colorbar(shown, ax=panels, ticks=list(ticks), aspect=40, pad=0.01, shrink=0.9)
        bar.ax.set_yticklabels([f"{i + 1} {links[i].name[:16]}" for i in ticks])
        bar.ax.minorticks_off()
        bar.ax.set_ylabel("link")
    phases = phase_colours(runs[0]) if len(runs) == 1 else {}
    if phases and any(entry.get_gid() == PHASES for ax in panels for entry in ax.collections):
        from matplotlib.patches import Patch

        patches = [Patch(facecolor=colour, edgecolor="#bbbbbb", linewidth=0.5, gid=PHASES) for colour in phases.values()]
        texts = [plain(" + ".join(closed)) or "nothing touches" for closed in phases]
        most = max(1, min(len(texts), int(figure.get_figwidth() * 10 / (max(map(len, texts)) + 6))))
        figure.legend(patches, texts, loc="outside lower center", ncols=most, title="phases", fontsize=8.0, title_fontsize=8.0)
    if len(runs) > 1:
        alone = all(len(_labels(ax)) <= 1 for ax in panels)
        handles = [
            Line2D([], [], color=PALETTE[k % len(PALETTE)] if alone else GREY, linestyle=DASHES[k % len(DASHES)])
            for k in range(len(runs))
        ]
        handles[0].set(linewidth=2.6, alpha=0.5)
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
