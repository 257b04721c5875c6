"""Inverse dynamics: the generalized forces that a measured motion needs."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.errors import SceneError, nearest
from vlmb.model.coordinates import make_state
from vlmb.model.frozen import read_only
from vlmb.model.layout import Coordinate, segment_of
from vlmb.model.mechanism import Mechanism, build
from vlmb.model.memory import make_data
from vlmb.model.names import ANGLES, force_along, quantity_of
from vlmb.model.signals import Signal, make_signal
from vlmb.model.smoothing import FEWEST, smoothed
from vlmb.model.velocity_map import VelocityMap
from vlmb.scene.recorded import as_samples, require_ascending
from vlmb.scene.scene import Scene
from vlmb.scene.tables import Smooth
from vlmb.simulation.named import Named
from vlmb.simulation.phases import Stretch
from vlmb.simulation.trajectory import Trajectory, versions
from vlmb.system.beginning import NEAR_AT_START
from vlmb.system.constrained import SIDEWAYS
from vlmb.system.contacts import HELD, STILL, Footing
from vlmb.system.pace import require_data
from vlmb.system.prescribed import prescribed_segments
from vlmb.system.system import System, make_system

Array = NDArray[np.float64]
TIMES = ("time", "t")  # names of the times
ALONG, UP = 0, 3  # velocities of a ski


def inverse(
    scene: Scene | Mechanism | str | Path | Mapping[str, Any], data: Any, smooth: Any = "auto", *, gap: float = 0.2
) -> Trajectory:
    """Return the motion that was measured, with the generalized forces that it needs beyond the scene's own in `controls`.

    Every coordinate is smoothed by a quintic spline, as measured data of a scene are; `adjustments` tell how. Along a ski's
    edge nothing is asked of the forces on x and y: the snow gives it. A ski that may lift is on the snow where `z` is 0 or left
    out, in the air where it is above. `work` is integrated from the powers at the samples.

    Parameters
    ----------
    scene : a Scene, the path of a scene file, a dict with its keys, or a mechanism; without constraints and programme
    data : a DataFrame or dict with `time` [s] (of a DataFrame its index may be `time` or `t`) and every free coordinate by name
        [m, rad], nan where a sample is missing; prescribed lengths follow their laws
    smooth : "auto", "none", {"sigma": rms}, or a dict of such by coordinate
    gap : [s] longer holes are errors

    Raises SceneError naming a coordinate that is missing, a hole, or what of the scene has no inverse.
    """
    began, used = clock.perf_counter(), clock.thread_time()
    mechanism = scene if isinstance(scene, Mechanism) else build(scene)
    _refuse_rows(mechanism.scene)
    time, known = _columns(mechanism, data)
    on_snow = mechanism.layout.lifts and _stays_down(known)
    free = [c for c in mechanism.layout.coordinates if not (_is_prescribed(mechanism, c) or (on_snow and c.kind == "z"))]
    times, signals = _curves(free, time, known, smooth, gap)
    times = times[(times >= max(s.span[0] for s in signals)) & (times <= min(s.span[1] for s in signals))]
    if len(times) < FEWEST:
        raise SceneError(f"inverse: the coordinates have {len(times)} times in common; {FEWEST} are needed at least")
    require_data(mechanism.scene, float(times[0]), float(times[-1]), "the motion")
    run = msgspec.structs.replace(mechanism.scene.run, engine="pinocchio", knife_edge="reduction")
    system = make_system(mechanism, run, inputs=[force_along(c) for c in free])
    motion = _motion(mechanism, free, signals, times)
    footings = _footings(system, times, motion, on_snow)
    states, forces = _forces(system, free, times, motion, footings)
    span = f"t = {times[0]:.6g} to {times[-1]:.6g} s"
    made = Trajectory(
        mechanism, times, states, "pinocchio", forces, system.forces.inputs or (), motion[0], run, "finished",
        f"inverse dynamics of {len(times)} samples from {span}.", tuple(signal.report for signal in signals),
        {
            "wall_time": clock.perf_counter() - began, "cpu_time": clock.thread_time() - used,
            "rhs_evaluations": 2 * len(times), "steps": 0, "engine": "pinocchio",
        },
        versions(), float(times[0]),
        stretches=(Stretch(float(times[0]), float(times[-1]), footings, 0, len(times)),) if mechanism.layout.lifts else (),
    )  # fmt: skip
    made.__dict__["system"] = system
    needed, whole = dict(zip(made.input_names, made.inputs.T, strict=True)), made.controls
    # a force of the scene's on the same coordinate is none that is needed beyond it
    made.__dict__["controls"] = Named(
        "control", tuple(whole), lambda name: read_only(needed[name]) if name in needed else whole[name]
    )
    return made


def _refuse_rows(scene: Scene) -> None:
    if scene.contacts:
        raise SceneError("inverse: what contacts push is not told from the forces asked for; give a scene without them")
    if scene.constraints:
        raise SceneError(
            "inverse: the forces of constraints cannot be told from those that are asked for; give a scene without them, "
            "scene.changed(constraints=None)"
        )
    if scene.programme is not None or scene.programmes:
        raise SceneError("inverse: a programme makes a motion of its own; give a scene without it, scene.changed(programme=None)")


def _is_prescribed(mechanism: Mechanism, c: Coordinate) -> bool:
    return c.kind == "xi" and segment_of(mechanism.layout, c).motion == "prescribed"


def _columns(mechanism: Mechanism, data: Any) -> tuple[Any, dict[str, Any]]:
    """Return the times and the samples by name."""
    if isinstance(data, Mapping):
        columns = dict(data)
    elif hasattr(data, "columns") and hasattr(data, "index"):
        columns = {name: data[name].to_numpy() for name in data.columns}
        if data.index.name in TIMES:
            columns.setdefault("time", data.index.to_numpy())
    else:
        raise SceneError(f"data = {data!r:.80}: must be a DataFrame, or a dict with `time` and every free coordinate")
    time = next((columns.pop(name) for name in TIMES if name in columns), None)
    if time is None:
        raise SceneError("data: needs `time` [s], the times of the samples")
    return time, mechanism.names.canonical({name: values for name, values in columns.items() if isinstance(name, str)}, "data")


def _stays_down(known: Mapping[str, Any]) -> bool:
    """Whether a ski that may lift is on the snow in all samples, or in none. Raises SceneError for what is both."""
    if "z" not in known:
        return True
    values = np.array(as_samples(known["z"], "data.z"), float)
    down = np.abs(values[~np.isnan(values)]) <= NEAR_AT_START
    if down.any() and not down.all():
        raise SceneError(
            "data.z: the ski leaves the snow or lands, where velocities jump and smooth curves tell no forces; give flights and "
            "what is on the snow by themselves (on the snow z may be left out)"
        )
    return bool(down.all())


def _footings(system: System, times: Array, motion: tuple[Array, Array, Array], on_snow: bool) -> tuple[Footing, ...]:
    """Return how contacts stand. Raises SceneError for a ski with friction that does not slide one way."""
    footings, at = [Footing(since=float(times[0])) for _ in system.points], system.mechanism.layout.index
    if on_snow:
        heading, mu = motion[0][:, at["phi0"]], system.mechanism.scene.base.friction
        speed = motion[1][:, at["x"]] * np.cos(heading) + motion[1][:, at["y"]] * np.sin(heading)
        if mu and not (np.all(speed > STILL) or np.all(speed < -STILL)):
            raise SceneError(
                "inverse: friction under a ski that stands or turns back is not told from the forces asked for; give samples in "
                "which it goes one way, or friction = 0"
            )
        towards = mu * float(np.sign(speed[0]))
        footings[-1] = Footing(HELD, since=float(times[0]), towards=(towards, 0.0, 0.0))
    return tuple(footings)


def _curves(
    free: Sequence[Coordinate], time: Any, known: Mapping[str, Any], smooth: Any, gap: float
) -> tuple[Array, list[Signal]]:
    """Return the times and a curve through every free coordinate."""
    missing = [c.name for c in free if c.name not in known]
    if missing:
        hint = nearest(missing[0], [name for name in known if name not in {c.name for c in free}])
        wanted = ", ".join(c.name for c in free)
        raise SceneError(f"data: lacks {', '.join(missing)}: every free coordinate is needed, {wanted}; {hint}")
    times = require_ascending(as_samples(time, "data.time"), "data.time")
    at, found = np.array(times, float), []
    for c in free:
        values = np.array(as_samples(known[c.name], f"data.{c.name}"), float)
        if len(values) != len(at):
            raise SceneError(f"data.{c.name}: {len(values)} values at {len(at)} times")
        there = ~np.isnan(values)
        kept = np.unwrap(values[there]) if c.kind in ANGLES else values[there]
        wanted_smooth = _smoothing(smooth, c.name)
        found.append(make_signal(c.name, quantity_of(c).unit, at[there], kept, wanted_smooth, gap, f"data.{c.name}"))
    return at, found


def _smoothing(smooth: Any, name: str) -> Smooth:
    """Return what `smooth` says of a coordinate."""
    if isinstance(smooth, Mapping) and set(smooth) != {"sigma"}:
        smooth = smooth.get(name, "auto")
    try:
        made: Smooth = msgspec.convert(smooth, Smooth)
    except msgspec.ValidationError:
        raise SceneError(f"smooth = {smooth!r:.80}: must be 'auto', 'none' or {{'sigma': rms}} with rms > 0") from None
    return made


def _motion(
    mechanism: Mechanism, free: Sequence[Coordinate], signals: Sequence[Signal], times: Array
) -> tuple[Array, Array, Array]:
    """Return all coordinates, rates and accelerations (N, coordinates)."""
    found = np.zeros((3, len(times), len(mechanism.layout.names)))
    for c, signal in zip(free, signals, strict=True):
        for order in range(3):
            found[order, :, mechanism.layout.index[c.name]] = signal.values(times, order)
    for length in prescribed_segments(mechanism):
        found[:, :, mechanism.layout.index[length.name]] = np.array([length.law.jet(t) for t in times.tolist()]).T
    return found[0], found[1], found[2]


def _forces(
    system: System, free: Sequence[Coordinate], times: Array, motion: tuple[Array, Array, Array], footings: Sequence[Footing]
) -> tuple[Array, Array]:
    """Return the states (N, size) with the work done, and the forces (N, S) on the free coordinates.

    Q = S' (M v' + bias - what the scene gives), less what the snow gives across the ski.
    """
    mechanism, layout = system.mechanism, system.mechanism.layout
    workspace = (system.phase(footings) if layout.lifts else system).workspace()
    held = layout.edged or (layout.lifts and footings[-1].state == HELD)
    names, at, data = layout.names, [layout.index[c.name] for c in free], make_data(mechanism.model)
    works = len(system.work_names)
    states, forces, powers = np.zeros((len(times), system.size)), np.zeros((len(times), len(free))), np.zeros((len(times), works))
    for k, (t, values, rates, seconds) in enumerate(zip(times.tolist(), *motion, strict=True)):
        posture = dict(zip(names, values.tolist(), strict=True))
        q, v = make_state(layout, posture, {f"{name}_dot": rate for name, rate in zip(names, rates.tolist(), strict=True)})
        chart = VelocityMap(mechanism, posture, data)
        vdot = chart.velocities(seconds) + chart.products(rates)
        if held:
            v[SIDEWAYS] = vdot[SIDEWAYS] = 0.0
        y = np.concatenate([q, v, np.zeros(works)])
        own = workspace.evaluate(t, y, values.tolist(), [0.0] * len(free)).tau
        lacking = pin.rnea(mechanism.model, data, q, v, vdot) - own
        if held:
            lacking[SIDEWAYS] = 0.0
        if held and layout.lifts:  # friction goes by the normal force
            lacking[ALONG] += footings[-1].towards[0] * lacking[UP]
        forces[k] = chart.pull_back(lacking)[at]
        now = workspace.evaluate(t, y, values.tolist(), forces[k].tolist())
        powers[k] = [now.powers[name] for name in system.work_names]
        states[k] = y
    for work in range(works):
        states[:, layout.nq + layout.nv + work] = _integral(times, powers[:, work])
    return states, forces


def _integral(times: Array, values: Array) -> Array:
    """Return the integral (N,) of the quintic spline through values (N,)."""
    pieces, h = smoothed(times, values, 0.0).pieces, np.diff(times)
    parts = sum(pieces[:-1, 1 + k] * h ** (k + 1) / (k + 1) for k in range(6))
    return np.concatenate([[0.0], np.cumsum(parts)])
