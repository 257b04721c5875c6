"""A scene of links as MJCF, for `vlmb convert`."""

from __future__ import annotations

from pathlib import Path

from vlmb.errors import VlmbError
from vlmb.model.mechanism import Mechanism
from vlmb.model.mjcf import left_behind, mjcf
from vlmb.scene.scene import load_scene
from vlmb.simulation.checking import check
from vlmb.simulation.files import write_text


def to_mjcf(source: str, target: Path) -> int:
    """Write a scene of links as MJCF, at its start; return an exit code. Raises VlmbError for a scene with robots."""
    mechanism, start = check(load_scene(source))
    if not isinstance(mechanism, Mechanism):
        raise VlmbError(f"{source}: MJCF is written of scenes of links; of a robot there is its URDF, which MuJoCo reads")
    write_text(target, mjcf(mechanism, start.state))
    for sentence in left_behind(mechanism):
        print(f"  note  {sentence}")
    print(f"wrote {target}")
    return 0
