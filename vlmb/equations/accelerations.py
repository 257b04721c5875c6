"""Accelerations of a scene's coordinates at a posture, with everything that acts in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlmb.equations.motion import all_rates, complete_posture
from vlmb.errors import SceneError, SingularError, finite
from vlmb.model.coordinates import POLE
from vlmb.model.layout import Layout
from vlmb.model.mechanism import Mechanism, build
from vlmb.model.memory import make_data
from vlmb.model.velocity_map import VelocityMap
from vlmb.scene.scene import Scene
from vlmb.system.beginning import beginning, touching
from vlmb.system.forces import StateView
from vlmb.system.pace import require_data
from vlmb.system.prescribed import prescribed_segments
from vlmb.system.system import System, make_system

Array = NDArray[np.float64]

OFF = 1e-9  # [m, m/s] by which a given value may differ from what a law or the knife edge makes it


def accelerations(
    scene: Scene | Mechanism | str | Path | Mapping[str, Any],
    coordinates: Mapping[str, float],
    rates: Mapping[str, float] | None = None,
    t: float = 0.0,
) -> dict[str, float]:
    """Return the acceleration of every coordinate by name [m/s^2, rad/s^2], as a run would have it at this state.

    Forces, springs, ideal rows and programme of the scene act, with their corrections where a row does not hold.

    Parameters
    ----------
    scene : a Scene, the path of a scene file, a dict with its keys, or a mechanism built from one
    coordinates : every coordinate by name [m, rad]; prescribed ones may be left out
    rates : by name with `_dot` [m/s, rad/s]; missing ones are 0, prescribed ones follow their law. A ski's `speed` may stand
        for x_dot and y_dot
    t : [s] of laws

    Raises SceneError naming a coordinate that is missing, unknown, not finite or against its law, and a ski's motion across its
    edge, or contacts that touch; SingularError where the acceleration of an azimuth is asked for at its pole.
    """
    mechanism = scene if isinstance(scene, Mechanism) else build(scene)
    t = finite("t", t)
    layout = mechanism.layout
    require_data(mechanism.scene, t, t, "the instant")
    posture, speeds = _with_laws(mechanism, coordinates, rates or {}, t)
    values = complete_posture(mechanism, posture)
    motion = all_rates(mechanism, values, speeds)
    _refuse_sideways(layout, values, motion)
    _refuse_pole(layout, values)
    system, state = make_system(mechanism), mechanism.state(values, motion)
    _refuse_contacts(system, StateView(mechanism, t, mechanism.postures(state), [values[name] for name in layout.names], state))
    workspace = beginning(system, t).workspace(branch=[values[name] for name in layout.names])
    vdot = workspace.rhs(t, workspace.pack(state))[workspace.nq : workspace.nq + workspace.nv]
    chart = VelocityMap(mechanism, values, make_data(mechanism.model))
    products = chart.products(np.array([motion[f"{name}_dot"] for name in layout.names]))
    found = np.linalg.lstsq(chart.velocities(np.eye(len(layout.names))).T, vdot - products, rcond=None)[0]
    return dict(zip(layout.names, found.tolist(), strict=True))


def _with_laws(
    mechanism: Mechanism, coordinates: Mapping[str, float], rates: Mapping[str, float], t: float
) -> tuple[dict[str, float], dict[str, float]]:
    """Put in lengths and rates of prescribed segments; refuse given ones that differ."""
    posture, speeds = mechanism.names.canonical(coordinates, "coordinates"), mechanism.names.canonical(rates, "rates")
    for at in prescribed_segments(mechanism):
        length, rate, _ = at.law.jet(t)
        for given, name, value in ((posture, at.name, length), (speeds, f"{at.name}_dot", rate)):
            if name in given and not abs(given[name] - value) <= OFF:
                raise SceneError(f"{name} = {given[name]}: this segment follows its law, {value:.9g} at t = {t:g}; leave it out")
            given[name] = value
    return posture, speeds


def _refuse_contacts(system: System, view: StateView) -> None:
    names = sorted(touching(system, view)) if system.points else []
    if names:
        why = "whether they push, slip or open is found in a run: take its first sample, or lift them off"
        raise SceneError(f"contacts: {', '.join(names)} touch here, and {why}")


def _refuse_sideways(layout: Layout, values: Mapping[str, float], motion: Mapping[str, float]) -> None:
    if not layout.edged:
        return
    cosine, sine = math.cos(values["phi0"]), math.sin(values["phi0"])
    sideways = cosine * motion["y_dot"] - sine * motion["x_dot"]
    if abs(sideways) > OFF * max(1.0, abs(motion["x_dot"]), abs(motion["y_dot"])):
        raise SceneError(f"x_dot, y_dot: the ski would move sideways at {sideways:.6g} m/s; give `speed`, the motion along it")


def _refuse_pole(layout: Layout, values: Mapping[str, float]) -> None:
    """Refuse a posture where a link has no azimuth."""
    for i, link in enumerate(layout.links if not layout.plane else ()):
        if abs(math.cos(values[f"psi{i + 1}"])) < POLE:
            raise SingularError(
                f"link {link.name!r} stands at the pole (psi{i + 1} at 90 deg), where it has no azimuth and phi{i + 1} no "
                f"acceleration; take a posture beside it, or read vdot of the state (q, v), which has no pole"
            )
