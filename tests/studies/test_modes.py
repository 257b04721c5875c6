"""Modes as motions: postures on the mode's plane, pictures with both ends, pages, and what the command writes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import vlmb
from vlmb.cli import main
from vlmb.errors import StudyError
from vlmb.views.sceneries import ends_of_mode

MODELS = Path(__file__).resolve().parents[2] / "models"


def skier(start: dict[str, float]) -> vlmb.Scene:
    """A rod and a spring on a ski, without boots."""
    ski = {"kind": "ski", "mass": 6.0, "inertia": 0.5}
    leg = {"name": "legs", "rod": {"length": 0.9, "mass": 50.0}, "lower": {"length": 0.3, "stiffness": 4e4, "damping": 800.0}}
    return vlmb.Scene.from_dict({"base": ski, "links": [leg], "start": start})


def test_a_mode_swings_about_the_steady_posture_as_it_is() -> None:
    pytest.importorskip("PIL")
    linear = vlmb.linearize(vlmb.steady(skier({"speed": 7.0}), {"speed": 7.0}))
    sideways = next(k for k in range(4) if abs(linear.modes[linear.names.index("legs.direction.y"), k]) > 0.1)
    mode = linear.mode(sideways)
    rate = linear.eigenvalues[sideways].real
    assert "legs.direction.y" in repr(mode) and mode.told == f"mode {sideways}: grows with {rate:.3g} 1/s"
    tips = [ends_of_mode(mode).poses(frame)["links/legs/rod"][:3, 0] for frame in (0, 1, 2)]
    np.testing.assert_allclose(tips[0] * [1.0, -1.0, 1.0], tips[1], atol=1e-12)  # from one side to the other
    assert abs(tips[0][1]) == pytest.approx(0.3, abs=1e-12) and tips[2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert mode.q[0] == pytest.approx(mode.ends[0]) and mode.t[-1] == pytest.approx(6.0) and len(mode.t) == len(mode.q)
    pixels = np.asarray(vlmb.view.picture(mode, size=(240, 160)), float)
    middle = np.asarray(vlmb.view.picture(linear.mode(sideways, size=1e-9), size=(240, 160)), float)
    assert np.abs(pixels - middle).max() > 50.0  # both ends are there


def test_an_oscillation_is_shown_in_its_own_time() -> None:
    linear = vlmb.linearize(vlmb.steady(MODELS / "spring_pendulum_cone.toml", hold={"psi1": -1.1}))
    k = next(k for k, value in enumerate(linear.eigenvalues) if value.imag > 10.0)
    mode = linear.mode(k)
    assert mode.t[-1] == pytest.approx(3.0 * math.tau / linear.eigenvalues[k].imag)
    first, half = mode.q[0], mode.q[30]
    np.testing.assert_allclose(0.5 * (first + half), mode.middle, atol=0.03)  # half a period later on the other side
    with pytest.raises(StudyError, match="modes 0 to 4"):
        linear.mode(5)


def test_what_moves_no_posture_is_named() -> None:
    linear = vlmb.linearize(vlmb.steady(skier({"speed": 7.0}), {"speed": 7.0}))
    with pytest.raises(StudyError, match="moves no posture: it is one of speed"):
        linear.mode(linear.labels.index("family"))


def test_the_command_writes_a_page_and_a_still(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("PIL")
    pytest.importorskip("meshcat")
    page, still = tmp_path / "mode.html", tmp_path / "mode.png"
    command = ["steady", str(MODELS / "spring_pendulum_cone.toml"), "--hold", "psi1=-1.1"]
    assert main([*command, "--html", str(page)]) == 1 and "--mode K" in capsys.readouterr().err
    assert main([*command, "--dark"]) == 1 and "--plot FILE" in capsys.readouterr().err
    figure = tmp_path / "eigenvalues.png"
    assert main([*command, "--mode", "0", "--html", str(page), "--png", str(still), "--plot", str(figure), "--dark"]) == 0
    assert capsys.readouterr().out.count("wrote") == 2 and min(still.stat().st_size, figure.stat().st_size) > 1000
    text = page.read_text(encoding="utf-8")
    assert "spring pendulum" in text and ", mode 0: " in text and "http" not in text.split("<script", 1)[0]
