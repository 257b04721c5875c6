"""The figure of eigenvalues: every mode has its number, the stable half is shaded, pairs and families are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import vlmb
from vlmb.errors import VlmbError
from vlmb.studies.linearize import Linear

pytest.importorskip("matplotlib")

from matplotlib.colors import to_rgba

from vlmb.views.eigenvalue_plots import STABLE, save_eigenvalues


def linear(*values: complex, labels: dict[int, str] | None = None) -> Linear:
    """A linearization with given eigenvalues."""
    scene = vlmb.Scene.from_dict({"base": {"kind": "pivot"}, "links": [{"rod": {"mass": 1.0, "length": 1.0}}]})
    count, matrix = len(values), np.diag(np.real(values))
    names, told = tuple(f"x{k}" for k in range(count)), tuple((labels or {}).get(k, "") for k in range(count))
    found = np.array(values, complex)
    return Linear(names, matrix, matrix[:, :0], (), found, matrix.astype(complex), told, 0.0, 0.0, scene, {})


def test_modes_have_their_numbers() -> None:
    found = linear(2.0, 0.0, 3.0j, -3.0j, -1.0 + 4.0j, -1.0 - 4.0j, -2.0, -2.0, labels={1: "family"})
    figure = vlmb.plots.eigenvalues(found)
    (ax,) = figure.axes
    shown = {text.get_text(): text.xy for text in ax.texts}
    assert shown == {"0": (2.0, 0.0), "1": (0.0, 0.0), "2, 3": (0.0, 3.0), "4, 5": (-1.0, 4.0), "6, 7": (-2.0, 0.0)}
    points = {line.get_label(): list(zip(*line.get_data(), strict=True)) for line in ax.lines if line.get_label()[0] != "_"}
    assert points["grows"] == [(2.0, 0.0)] and points["family"] == [(0.0, 0.0)] and len(points["decays"]) == 4
    assert points["stays"] == [(0.0, 3.0), (0.0, -3.0)] and "unstable" in figure.get_suptitle()
    low, high = ax.get_xlim()
    shaded = ax.patches[0].get_extents().transformed(ax.transData.inverted())
    assert shaded.x0 == pytest.approx(low) and shaded.x1 == pytest.approx(0.0) and low < -2.0 and high > 2.0
    assert ax.get_xscale() == "linear"
    assert ax.patches[0].get_facecolor() == pytest.approx(to_rgba(STABLE))


def test_slow_modes_beside_stiff_ones_are_seen_apart(tmp_path: Path) -> None:
    found = linear(-0.5 + 1.0j, -0.5 - 1.0j, -2000.0, -3000.0)
    (ax,) = vlmb.plots.eigenvalues(found).axes
    assert ax.get_xscale() == ax.get_yscale() == "symlog" and len(ax.texts) == 3
    across = ax.transAxes.inverted().transform(ax.transData.transform([(-3000.0, 0.0), (-0.5, 1.0), (0.0, 0.0)]))[:, 0]
    assert 0.0 < across[0] < across[1] - 0.2 and across[2] - across[1] > 0.05
    light, dark = (save_eigenvalues(found, tmp_path / f"{name}.png", name == "dark") for name in ("light", "dark"))
    assert light.read_bytes() != dark.read_bytes()


def test_a_locus_is_coloured_by_what_was_varied() -> None:
    several = [linear(-1.0 + 1.0j * k, -1.0 - 1.0j * k) for k in (1, 2, 3)]
    figure = vlmb.plots.eigenvalues(several, [5.0, 6.0, 7.0], "speed [m/s]")
    ax, bar = figure.axes
    (drawn,) = ax.collections
    assert drawn.get_array().tolist() == [5.0, 5.0, 6.0, 6.0, 7.0, 7.0] and bar.get_ylabel() == "speed [m/s]"
    with pytest.raises(VlmbError, match="2 values for 3 linearizations"):
        vlmb.plots.eigenvalues(several, [5.0, 6.0])
    with pytest.raises(VlmbError, match="nothing in it can deviate"):
        vlmb.plots.eigenvalues(linear())
