"""Bars and straps between links that hang side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import vlmb
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system
from vlmb.views.appearance import STRAP, look_of
from vlmb.views.visual_model import of_state

MODEL = Path(__file__).resolve().parents[2] / "models" / "exoskeleton.toml"


def test_straps_go_from_bar_to_limb_and_bars_to_what_hangs_aside() -> None:
    mechanism = vlmb.build(MODEL)
    state = consistent_start(make_system(mechanism)).state
    scenery = of_state(mechanism, (state.q, state.v))
    poses, seen = scenery.poses(0), mechanism.postures(state)
    straps = {body.path for body in scenery.bodies if body.colour == STRAP}
    pairs = (("upper_bar", "thigh"), ("lower_bar", "shank"))
    names = [(f"{side}_{bar}", f"{side}_{limb}") for side in ("left", "right") for bar, limb in pairs]
    assert straps == {f"strap_{bar}_{limb}" for bar, limb in names}  # the belt is in one plane with the hips
    for bar, limb in names:
        ends = poses[f"strap_{bar}_{limb}"] @ np.array([[0.0, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 1.0]]).T
        number = mechanism.names.links
        np.testing.assert_allclose(ends[:3].T, [seen.position(number[bar], "tip"), seen.position(number[limb], "tip")], atol=1e-9)
    inner = poses["beside_left_thigh"] @ np.array([1.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(inner[:3], seen.position(mechanism.names.links["trunk"], "hinge"), atol=1e-12)
    assert look_of("exo_left_thigh") == look_of("left_upper_bar") != look_of("left_thigh")
