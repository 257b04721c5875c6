"""Figures: their labels, their data, their legends, and the files they make."""

from __future__ import annotations

import builtins
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb import Scene, simulate
from vlmb.scene.rows import rows_of

pytest.importorskip("matplotlib")

from vlmb.model.names import quantity_of
from vlmb.views.plots import PLOTS, ZERO, coordinates, save_all
from vlmb.views.style import DPI, run_labels

LINK = {"rod": {"length": 0.5, "mass": 30.0}, "lower": {"length": 0.25, "stiffness": 2e4, "damping": 200.0, "rest": 0.28}}
SKIER: dict[str, Any] = {
    "name": "skier", "slope": 0.2, "base": {"kind": "ski", "mass": 5.0, "inertia": 0.6},
    "links": [{**LINK, "name": "legs", "upper": {"length": 0.2, "stiffness": 2e4}, "tip_mass": 40.0}],
    "forces": [{"on": "M_psi1", "law": "20*sin(3*t)"}, {"on": "F1_1", "law": "5"}],
    "start": {"phi0": 0.4, "phi1": 0.4, "psi1": 1.4, "speed": 6.0}, "run": {"duration": 0.3},
}  # fmt: skip
TREE: dict[str, Any] = {
    "name": "tree", "base": {"kind": "free", "mass": 1.0},
    "links": [
        {"name": "trunk", "rod": {"length": 0.5, "mass": 3.0}, "tip_mass": 1.0,
         "upper": {"motion": "prescribed", "law": "0.2+0.05*sin(6*t)"}},
        {"name": "left", "parent": "trunk", "parent_point": "rod_end", **LINK, "tip_mass": 0.5},
        {"name": "right", "parent": "trunk", "parent_point": "rod_end", **LINK, "tip_mass": 0.5},
    ],
    "forces": [{"on": "T_right", "law": "0.5"}],
    "start": {"psi1": 1.2, "psi2": 0.3, "phi2": 1.5, "psi3": 0.2, "phi3": -1.5, "z": 1.0},
    "run": {"duration": 0.3, "fall": False},
}  # fmt: skip
PIVOT: dict[str, Any] = {
    "name": "one link", "base": {"kind": "pivot"}, "links": [{**LINK, "tip_mass": 1.0}], "start": {"psi1": 0.4},
    "run": {"duration": 0.3, "fall": False},
}  # fmt: skip
SKATE: dict[str, Any] = {
    "name": "skate", "slope": 0.3, "base": {"kind": "ski", "mass": 70.0, "inertia": 1.0}, "start": {"phi0_dot": 1.0},
    "run": {"duration": 1.0},
}  # fmt: skip
CHAIN: dict[str, Any] = {
    "name": "chain", "base": {"kind": "pivot"}, "start": {"phi1_dot": 1.0}, "run": {"duration": 0.2, "fall": False},
    "links": [{"rod": {"length": 0.2, "mass": 0.5}, "lower": {"length": 0.05, "stiffness": 2e3}, "tip_mass": 0.1}] * 9,
}  # fmt: skip
SCENES = {"skier": SKIER, "tree": TREE, "pivot": PIVOT, "skate": SKATE, "chain": CHAIN}


@pytest.fixture(scope="module")
def runs() -> dict[str, vlmb.Trajectory]:
    return {name: simulate(Scene.from_dict(scene)) for name, scene in SCENES.items()}


def lines_of(figure: Any, label: str) -> list[Any]:
    return [line for ax in figure.axes for line in ax.lines if line.get_label() == label]


def y_labels(figure: Any) -> list[str]:
    return [ax.get_ylabel() for ax in figure.axes]


@pytest.mark.parametrize("name", ["skier", "tree", "chain"])
def test_every_coordinate_and_rate_is_drawn_as_computed(runs: dict[str, vlmb.Trajectory], name: str) -> None:
    run = runs[name]
    figure = PLOTS["coordinates"](run)
    for coordinate in run.mechanism.layout.coordinates:
        drawn = lines_of(figure, quantity_of(coordinate).symbol)
        assert len(drawn) == 2
        for line, quantity in zip(drawn, (coordinate.name, f"{coordinate.name}_dot"), strict=True):
            np.testing.assert_array_equal(line.get_xdata(), run.t)
            np.testing.assert_array_equal(line.get_ydata(), run[quantity])
    assert all("[" in label for ax, label in zip(figure.axes, y_labels(figure), strict=True) if ax.lines)


def test_labels_are_the_papers_with_units(runs: dict[str, vlmb.Trajectory]) -> None:
    run = runs["skier"]
    assert y_labels(PLOTS["coordinates"](run)) == [
        "$x$, $y$ [m]", r"$\dot{x}$, $\dot{y}$ [m/s]",
        r"$\varphi_{0}$, $\varphi_{1}$ [rad]", r"$\dot{\varphi}_{0}$, $\dot{\varphi}_{1}$ [rad/s]",
        r"$\psi_{1}$ [rad]", r"$\dot{\psi}_{1}$ [rad/s]",
        r"$\xi_{11}$ [m]", r"$\dot{\xi}_{11}$ [m/s]", r"$\xi_{12}$ [m]", r"$\dot{\xi}_{12}$ [m/s]",
    ]  # fmt: skip
    assert y_labels(PLOTS["energy"](run)) == ["energy [J]", "balance [J]"]
    assert y_labels(PLOTS["controls"](run)) == ["$F_{11}$ [N]", r"$M_{\psi_{1}}$ [N m]"]
    assert y_labels(PLOTS["power"](run)) == ["power [W]", "work [J]"]
    assert y_labels(PLOTS["reactions"](run)) == [
        "edge force [N]",
        "normal force [N]",
        "moments of the snow\n[N m]",
        "hinge force [N]",
    ]
    assert y_labels(PLOTS["residuals"](run)) == ["velocity level\n|knife edge| [m/s]"]
    phase = PLOTS["phase"](run)
    assert [ax.get_xlabel() for ax in phase.axes] == [r"$\psi_{1}$ [rad]", r"$\xi_{11}$ [m]", r"$\xi_{12}$ [m]"]
    for figure in (PLOTS[name](run) for name in ("coordinates", "energy", "controls", "power", "reactions", "residuals")):
        assert figure.axes[-1].get_xlabel() == "$t$ [s]"


def test_energy_reactions_controls_are_drawn_as_computed(runs: dict[str, vlmb.Trajectory]) -> None:
    run = runs["skier"]
    energy = PLOTS["energy"](run)
    for label, name in {
        "kinetic": "kinetic",
        "spring": "spring",
        "total": "energy",
        "work": "work",
        "balance": "balance",
    }.items():
        np.testing.assert_array_equal(lines_of(energy, label)[0].get_ydata(), run[name])
    reactions = PLOTS["reactions"](run)
    np.testing.assert_array_equal(lines_of(reactions, "knife edge")[0].get_ydata(), run.reactions["knife_edge"])
    np.testing.assert_array_equal(lines_of(reactions, "legs")[0].get_ydata(), np.linalg.norm(run.hinge_force("legs"), axis=1))
    (moment,) = lines_of(PLOTS["controls"](run), r"$M_{\psi_{1}}$")
    np.testing.assert_array_equal(moment.get_ydata(), run.controls["M_psi1"])
    portrait = lines_of(PLOTS["phase"](run), r"$\psi_{1}$")[0]
    np.testing.assert_array_equal(portrait.get_xdata(), run["psi1"])
    np.testing.assert_array_equal(portrait.get_ydata(), run["psi1_dot"])


def test_power_and_work_are_drawn_as_computed(runs: dict[str, vlmb.Trajectory]) -> None:
    run = runs["skier"]
    power, work = PLOTS["power"](run).axes
    watts = {"M_psi1": run.controls["M_psi1"] * run["psi1_dot"], "F1_1": run.controls["F1_1"] * run["xi1_1_dot"]}
    for line, done, name in zip(power.lines, work.lines, run.controls, strict=False):
        np.testing.assert_allclose(line.get_ydata(), watts[name], atol=1e-10)
        peak, mean = np.abs(watts[name]).max(), np.abs(watts[name]).mean()
        assert line.get_label().endswith(f": up to {peak:.3g} W, mean {mean:.3g} W")
        np.testing.assert_array_equal(done.get_ydata(), run.work_by_force[name])
    for name, control in (("skier", "F1_1"), ("tree", "T_right"), ("tree", "F1_2")):
        total = np.trapezoid(runs[name].power(control), runs[name].t)
        assert total == pytest.approx(runs[name].work_by_force[control][-1], rel=1e-2, abs=1e-6)


def test_residuals_are_on_log_axes_with_exact_zeros_lifted(runs: dict[str, vlmb.Trajectory]) -> None:
    run = runs["skate"]
    ax = PLOTS["residuals"](run).axes[0]
    drawn, exact = ax.lines[0].get_ydata(), np.abs(run.residuals["knife_edge"].velocity)
    assert ax.get_yscale() == "log"
    np.testing.assert_array_equal(drawn, np.maximum(exact, ZERO))
    assert ax.get_ylim()[0] < drawn.min() <= drawn.max() < ax.get_ylim()[1]


def test_track_and_tips_are_drawn_to_scale(runs: dict[str, vlmb.Trajectory]) -> None:
    track = PLOTS["path"](runs["skier"])
    ax = track.axes[0]
    assert ax.get_aspect() == 1.0
    assert [ax.get_xlabel(), ax.get_ylabel()] == ["$x$ [m]", "$y$ [m]"]
    np.testing.assert_array_equal(
        lines_of(track, "ski")[0].get_xydata(), np.column_stack([runs["skier"]["x"], runs["skier"]["y"]])
    )
    assert "fall line" in [text.get_text() for text in ax.texts]
    assert "fall line" not in [
        text.get_text() for text in PLOTS["path"](simulate(Scene.from_dict({**SKIER, "slope": 0.0}))).axes[0].texts
    ]
    tips = PLOTS["path"](runs["tree"])
    above, side = lines_of(tips, "tip of left")
    position = runs["tree"].position("left", "tip")
    np.testing.assert_array_equal(above.get_xydata(), position[:, :2])
    np.testing.assert_array_equal(side.get_xydata(), position[:, [0, 2]])
    plane = simulate(Scene.from_dict({**PIVOT, "plane": True}))
    assert [ax.get_ylabel() for ax in PLOTS["path"](plane).axes] == ["$z$ [m]"]


@pytest.mark.parametrize("name", SCENES)
def test_nothing_is_clipped_and_legends_cover_no_data(runs: dict[str, vlmb.Trajectory], name: str) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    for make in PLOTS.values():
        figure = make(runs[name])
        if not figure.axes:
            continue
        canvas = FigureCanvasAgg(figure)
        figure.set_dpi(60)
        canvas.draw()
        renderer, bounds = canvas.get_renderer(), figure.bbox
        texts = [text for ax in figure.axes for text in (ax.title, ax.xaxis.label, ax.yaxis.label, *ax.texts)]
        legends = [*figure.legends, *(ax.get_legend() for ax in figure.axes if ax.get_legend() is not None)]
        for artist in [*texts, *legends, *figure.texts]:
            box = artist.get_window_extent(renderer)
            if box.width > 0.0:
                assert bounds.x0 - 1 <= box.x0 and box.x1 <= bounds.x1 + 1, artist
                assert bounds.y0 - 1 <= box.y0 and box.y1 <= bounds.y1 + 1, artist
        for legend in legends:
            box = legend.get_window_extent(renderer)
            assert not any(box.overlaps(ax.get_window_extent(renderer).shrunk(0.99, 0.99)) for ax in figure.axes)


@pytest.mark.parametrize("name", ["skier", "skate", "tree", "pivot"])
def test_files_are_not_blank_and_empty_figures_are_skipped(
    runs: dict[str, vlmb.Trajectory], tmp_path: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.image import imread

    monkeypatch.setattr("vlmb.views.style.DPI", 60)
    written = save_all(runs[name], tmp_path / "new folder")
    missing = {
        "pivot": {"residuals", "controls", "power", "deviations", "strengths"},
        "skate": {"controls", "power", "deviations", "strengths", "phase"},
        "tree": {"residuals", "deviations", "strengths"},
        "skier": {"deviations"},
    }
    assert {path.stem for path in written} == set(PLOTS) - {"data", "contacts"} - missing.get(name, set())
    for path in written:
        pixels = imread(path)[..., :3]
        assert path.suffix == ".png"
        assert pixels.std() > 0.02
        assert (np.ptp(pixels, axis=2) > 0.2).any() or path.stem == "path"


def test_several_runs_share_a_figure(runs: dict[str, vlmb.Trajectory], tmp_path: Any) -> None:
    pair = [runs["skier"], simulate(Scene.from_dict(SKIER), method="adams")]
    assert run_labels(pair) == ["dop853", "adams"]
    figure = PLOTS["coordinates"](pair)
    drawn = lines_of(figure, r"$\psi_{1}$")
    assert len(drawn) == 4
    np.testing.assert_array_equal(drawn[1].get_ydata(), pair[1]["psi1"])
    assert drawn[0].get_linestyle() != drawn[1].get_linestyle()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == run_labels(pair)
    mixed = list(runs.values())
    written = save_all(mixed, tmp_path, labels=["a $ b", *"cdef"])
    assert {path.stem for path in written} == set(PLOTS) - {"deviations", "data", "contacts"}


def test_names_are_checked_and_explained(runs: dict[str, vlmb.Trajectory], tmp_path: Any) -> None:
    assert [path.name for path in save_all(runs["skate"], tmp_path, only=["path", "energy"])] == ["path.png", "energy.png"]
    with pytest.raises(vlmb.VlmbError, match="did you mean 'energy'"):
        save_all(runs["skate"], tmp_path, only=["enrgy"])
    with pytest.raises(vlmb.VlmbError, match="'controls' would be empty: the scene has no controls"):
        save_all(runs["skate"], tmp_path, only=["controls"])
    with pytest.raises(vlmb.VlmbError, match="nothing to plot"):
        save_all([], tmp_path)


def test_a_run_of_one_sample_and_a_strange_name_are_drawn(tmp_path: Any) -> None:
    one = simulate(Scene.from_dict({**SKIER, "name": "$x_{ " + "long " * 60}), t_eval=[0.0])
    assert len(one) == 1
    assert save_all(one, tmp_path)


def test_a_missing_matplotlib_is_explained(
    runs: dict[str, vlmb.Trajectory], monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.split(".")[0] == "matplotlib":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(vlmb.VlmbError, match=r"pip install vlmb\[plots\]"):
        save_all(runs["skate"], tmp_path)


def test_matplotlib_is_imported_only_to_draw_and_keeps_its_settings() -> None:
    code = (
        "import sys, vlmb; from vlmb import plots; from vlmb.views.style import RC; assert 'matplotlib' not in sys.modules;"
        f"run = vlmb.simulate(vlmb.Scene.from_dict({SKATE!r}));"
        "from matplotlib import rcParams; before = {name: rcParams[name] for name in RC};"
        "figures = [make(run) for make in plots.PLOTS.values()];"
        "assert before == {name: rcParams[name] for name in RC}; assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("name", SCENES)
def test_every_curve_is_named_and_no_figure_is_taller_than_a_screen(runs: dict[str, vlmb.Trajectory], name: str) -> None:
    for kind, make in PLOTS.items():
        figure = make(runs[name])
        assert figure.get_figheight() * DPI <= 1080
        listed = {text.get_text() for ax in figure.axes if ax.get_legend() for text in ax.get_legend().get_texts()}
        for ax in figure.axes:
            labels = [line.get_label() for line in ax.lines if not line.get_label().startswith("_")]
            assert len(labels) == 1 or set(labels) <= listed, (kind, ax.get_ylabel())
            if ax.lines and kind != "path":
                assert re.search(r"\[.+\]|\$z\$", ax.get_ylabel()), (kind, ax.get_ylabel())


def test_many_controls_are_told_apart_by_colour_and_dashes(whole: vlmb.Trajectory) -> None:
    _, moments = PLOTS["controls"](whole).axes
    assert len(moments.lines) == 13 and len(moments.get_legend().get_texts()) == 13
    assert len({(line.get_color(), line.get_linestyle(), str(line._unscaled_dash_pattern)) for line in moments.lines}) == 13
    deviations = PLOTS["deviations"](whole)
    assert len(deviations.axes) == 13 and deviations.get_figheight() * DPI <= 1080
    texts = whole.scene.programme.constraints  # type: ignore[union-attr]
    for ax, row, text in zip(deviations.axes, rows_of(whole.scene).servo, texts, strict=True):
        assert " ".join(ax.get_title(loc="left").split()) == text  # not cut
        np.testing.assert_array_equal(ax.lines[0].get_ydata(), np.maximum(np.abs(whole.residuals[row.name].position), ZERO))


def test_curves_that_lie_on_each_other_are_all_seen() -> None:
    from matplotlib.figure import Figure

    from vlmb.views.style import reveal

    ax = Figure().subplots()
    t = np.linspace(0.0, 1.0, 50)
    lower, upper, other = (ax.plot(t, values, label=name)[0] for name, values in
                           (("a", t), ("b", t + 1e-6), ("c", 1.0 - t)))  # fmt: skip
    reveal(ax)
    assert lower.get_linestyle() == "-" and lower.get_linewidth() > upper.get_linewidth()
    assert upper.get_linestyle() == "--" and other.get_linestyle() == "-"
    same = simulate(Scene.from_dict({**SKIER, "start": {**SKIER["start"], "phi1_dot": 0.0}}), method="adams")
    pair = PLOTS["coordinates"]([simulate(Scene.from_dict(SKIER)), same])
    first, second = lines_of(pair, r"$\psi_{1}$")[:2]
    assert first.get_linewidth() > second.get_linewidth() and second.get_linestyle() == "--"


def test_figures_on_a_dark_ground_keep_their_curves_apart(runs: dict[str, vlmb.Trajectory], tmp_path: Any) -> None:
    from matplotlib.colors import to_rgb
    from matplotlib.text import Text
    from PIL import Image

    from vlmb.views.dark import BRIGHT, GROUND, darkened
    from vlmb.views.style import PALETTE

    light, dark = (coordinates(runs["skier"]) for _ in range(2))
    darkened(dark)
    colours = dict(zip((to_rgb(c) for c in PALETTE), (to_rgb(c) for c in BRIGHT), strict=True))
    panels = zip(light.axes, dark.axes, strict=True)
    pairs = [both for one, other in panels for both in zip(one.lines, other.lines, strict=True)]
    assert len(pairs) > 8
    for before, after in pairs:
        assert to_rgb(after.get_color()) == pytest.approx(colours.get(to_rgb(before.get_color()), to_rgb("#e6e8ea")), abs=1e-6)
        assert contrast(to_rgb(after.get_color()), to_rgb(GROUND)) > 4.5
    texts = [text for text in dark.findobj(Text) if text.get_text()]
    assert all(contrast(to_rgb(text.get_color()), to_rgb(GROUND)) > 7.0 for text in texts)
    (written,) = save_all(runs["skier"], tmp_path, ["energy"], dark=True)
    assert max(Image.open(written).convert("RGB").getpixel((2, 2))) < 40


def contrast(one: Any, other: Any) -> float:
    """Contrast of two colours as WCAG 2 defines it."""

    def luminance(colour: Any) -> float:
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour]
        return float(np.dot([0.2126, 0.7152, 0.0722], linear))

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_phases_are_bands_behind_panels_over_time() -> None:
    run = vlmb.simulate(Path(__file__).resolve().parents[2] / "models" / "slip_walker.toml", duration=0.7)
    figure = vlmb.plots.energy(run)
    for ax in figure.axes:
        bands = {entry.get_facecolor().tobytes(): entry for entry in ax.collections if entry.get_gid() == "phases"}
        assert len(bands) == 3
        ends = sorted(float(path.vertices[:, 0].max()) for entry in bands.values() for path in entry.get_paths())
        assert ends == pytest.approx([phase.end for phase in run.phases])
    legend = figure.legends[0]
    assert [text.get_text() for text in legend.get_texts()] == ["left", "left + right", "right"]
    assert not [entry for entry in vlmb.plots.energy([run, run]).axes[0].collections if entry.get_gid() == "phases"]
    side = vlmb.plots.path(run).axes[0]
    stood = next(line for line in side.lines if line.get_marker() == "v")
    assert stood.get_xdata() == pytest.approx(sorted({*run["left.foot.x"], *run["right.foot.x"][run.t > 0.2]}))
