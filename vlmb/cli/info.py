"""`vlmb info`: a scene's mechanism in words."""

from __future__ import annotations

import argparse
from typing import Any

from vlmb.model.building import build
from vlmb.model.mechanism import Mechanism
from vlmb.model.memory import data_bytes
from vlmb.model.names import counted
from vlmb.scene.names import listed
from vlmb.scene.scene import Scene, load_scene
from vlmb.simulation.checking import Checked, check
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

WHAT = "print a scene's coordinates, degrees of freedom, joints, and what was left out and why"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("scene", help="scene file (.toml) or model")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    scene = load_scene(args.scene)
    mechanism = build(scene)
    if not isinstance(mechanism, Mechanism):
        return _of_robots(mechanism)
    checked = Checked(mechanism, consistent_start(make_system(mechanism)))
    layout, free = mechanism.layout, checked.degrees_of_freedom
    print(f"{scene.name}: {scene.base.kind} base, {counted(len(scene.links), 'link')}, {sum_mass(scene):g} kg")
    print(f"  coordinates         {len(layout.names)}: {' '.join(layout.names)}")
    for quantity in mechanism.names.coordinates:
        print(f"    {quantity.name:<20s} {quantity.unit:<4s} {mechanism.names.meaning(quantity)}")
    print(f"  degrees of freedom  {free}")
    memory = data_bytes(layout.nv) / 2**20
    print(f"  state               {layout.nq} positions, {layout.nv} velocities; pinocchio.Data {memory:.2g} MiB")
    print("  joints")
    for joint, name in list(zip(mechanism.model.joints, mechanism.model.names, strict=True))[1:]:
        print(f"    {name:<20s} {joint.shortname().removeprefix('JointModel')}")
    print("  left out" if mechanism.left_out else "  left out            nothing")
    for entry in mechanism.left_out:
        print(f"    {entry}")
    for entry in mechanism.warnings:
        print(f"  warning             {entry}")
    for sentence in checked.acting:
        print(f"  acts                {sentence}")
    for column in mechanism.signals.columns:
        print(f"  data                {column.report}")
    return 0


def _of_robots(mechanism: Any) -> int:
    """Print the same of a scene with robots."""
    scene, names, checked = mechanism.scene, mechanism.names, check(mechanism)
    print(f"{scene.name}: {scene.base.kind} base, {mechanism.facts}")
    print(f"  coordinates         {len(names.index)}")
    for quantity in names.coordinates:
        print(f"    {quantity.name:<28s} {quantity.unit:<4s} {names.meaning(quantity)}")
    print(f"  degrees of freedom  {checked.degrees_of_freedom}")
    print(f"  state               {mechanism.model.nq} positions, {mechanism.model.nv} velocities")
    print(f"  frames              {listed([name for name in mechanism.frames if name != 'universe'])}")
    for entry in mechanism.left_out or ("nothing",):
        print(f"  left out            {entry}")
    return 0


def sum_mass(scene: Scene) -> float:
    """Total mass [kg]."""
    return scene.base.mass + sum(link.rod.mass + link.tip_mass for link in scene.links)
