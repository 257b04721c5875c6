"""Scenes of walkers for tests, from the models."""

from __future__ import annotations

from pathlib import Path

import vlmb

MODELS = Path(__file__).resolve().parents[2] / "models"
TIGHT = {"rtol": 1e-11, "atol": 1e-12}


def model(name, duration, changes=None, **run):
    """Read a model, with tight tolerances and other numbers."""
    return vlmb.load_scene(MODELS / f"{name}.toml").changed_at(changes or {}).changed(run={**TIGHT, "duration": duration, **run})


def compass(duration=7.2, **run):
    """Make the compass gait of Goswami, Thuilot and Espiau, after an impact; its left leg stands."""
    return model("compass_gait", duration, **run)


def wheel(duration=5.0):
    """Make a rimless wheel of eight spokes on a slope of 0.08; it begins on the spoke behind, at 1.2 rad/s."""
    return model("rimless_wheel", duration)


def simplest(beta, duration=4.0):
    """Make the simplest walker with feet of mass beta; its left leg stands."""
    return model("simplest_walker", duration, {"parameters.beta": beta})
