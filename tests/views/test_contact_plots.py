"""Figures of contacts: friction needed beside what the ground gives, and where the ground pushes."""

from __future__ import annotations

import numpy as np
import pytest

import vlmb

pytest.importorskip("matplotlib")

from vlmb.views.plots import PLOTS

G = 9.81


def block(**base) -> vlmb.Trajectory:
    """A block on two feet, 0.4 m apart, is pushed ahead at 0.5 m: it leans on the one in front."""
    return vlmb.simulate(vlmb.Scene.from_dict({
        "plane": True, "base": {"kind": "free", **base},
        "links": [{"name": "sole", "rod": {"length": 0.4, "mass": 10.0}}],
        "contacts": [
            {"name": "back", "point": "base", "friction": 0.3, "friction_static": 0.5},
            {"name": "front", "point": "sole.tip", "friction": 0.0},
        ],
        "forces": [{"on": "F_x", "law": "10*t"}, {"on": "M_psi1", "law": "-5*t"}],
        "start": {"psi1": 0.0}, "run": {"duration": 1.0, "samples": 20, "fall": False},
    }))


def test_friction_needed_stands_beside_what_the_ground_gives() -> None:
    run = block()
    figure = PLOTS["contacts"](run)
    forces, needed, pressed = figure.axes
    by_name = {line.get_label(): np.asarray(line.get_ydata()) for line in forces.lines}
    back, front = 0.5 * 10.0 * G - 5.0 * run.t / 0.4, 0.5 * 10.0 * G + 5.0 * run.t / 0.4
    assert by_name["back"] == pytest.approx(back, abs=1e-6) and by_name["front"] == pytest.approx(front, abs=1e-6)
    lines = {line.get_label(): line for line in needed.lines}
    assert np.asarray(lines["back"].get_ydata()) == pytest.approx(10.0 * run.t / back, abs=1e-6) and "front" not in lines
    assert [line.get_ydata()[0] for line in needed.lines if line.get_linestyle() == "--"] == [0.5]
    centre = 0.4 * front / (10.0 * G)
    assert np.asarray(pressed.lines[0].get_ydata()) == pytest.approx(centre, abs=1e-9)
    assert run.centre_of_pressure("*")[:, 0] == pytest.approx(centre, abs=1e-9)
    feet = [np.asarray(line.get_ydata()) for line in pressed.lines if line.get_label() == "_" and line.get_linewidth() == 3.0]
    assert [float(foot[-1]) for foot in feet] == pytest.approx([0.0, 0.4], abs=1e-9)
    with pytest.raises(vlmb.VlmbError, match="did you mean 'front'"):
        run.centre_of_pressure("frnt")


def test_a_scene_without_contacts_has_no_such_figure() -> None:
    run = vlmb.simulate("models/one_link.toml", duration=0.1)
    assert not PLOTS["contacts"](run).axes
