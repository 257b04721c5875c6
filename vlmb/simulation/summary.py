"""The summary of a run in a few lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vlmb.model.names import force_unit
from vlmb.scene.rows import rows_of
from vlmb.scene.tables import DEFAULT_STEP
from vlmb.simulation.methods import find_method
from vlmb.simulation.named import largest
from vlmb.system.contacts import RESTING
from vlmb.system.events import HAPPENS, SLIPS

Array = NDArray[np.float64]

ENDS = ("hinge", "rod_end", "tip")
SHOWN = 4  # events of a contact
UNDER = 1e-9  # [m] below the ground that counts


class Told(Protocol):
    """What of a run the summary reads: see `Trajectory`."""

    @property
    def scene(self) -> Any: ...  # noqa: D102
    @property
    def t(self) -> Array: ...  # noqa: D102
    @property
    def t0(self) -> float: ...  # noqa: D102
    @property
    def run(self) -> Any: ...  # noqa: D102
    @property
    def status(self) -> str: ...  # noqa: D102
    @property
    def message(self) -> str: ...  # noqa: D102
    @property
    def adjustments(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def doubts(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def stats(self) -> dict[str, Any]: ...  # noqa: D102
    @property
    def residuals(self) -> Mapping[str, Any]: ...  # noqa: D102
    @property
    def reactions(self) -> Mapping[str, Array]: ...  # noqa: D102
    @property
    def controls(self) -> Mapping[str, Array]: ...  # noqa: D102
    @property
    def work_by_force(self) -> dict[str, Array]: ...  # noqa: D102
    @property
    def events(self) -> Sequence[Any]: ...  # noqa: D102
    @property
    def stretches(self) -> Sequence[Any]: ...  # noqa: D102
    @property
    def lowest_gaps(self) -> Mapping[str, float]: ...  # noqa: D102
    def __getitem__(self, name: str) -> Array: ...
    def power(self, name: str) -> Array: ...  # noqa: D102


def opening(trajectory: Told) -> list[str]:
    """Tell what every summary begins with: doubts, how the run ended, what it cost, how exact its energy is."""
    run, wall, lasted = trajectory.run, max(trajectory.stats["wall_time"], 1e-9), float(trajectory.t[-1]) - trajectory.t0
    fixed = not find_method(run.method).adaptive
    options = f"step {run.step or DEFAULT_STEP:g} s" if fixed else f"rtol {run.rtol:g}, atol {run.atol:g}"
    off = float(np.abs(trajectory["balance"]).max())
    share = off / max(float(trajectory["kinetic"].max()), 1e-300)
    return [
        *(f"DOUBTFUL  {doubt}" for doubt in trajectory.doubts),
        f"{'FAILED  ' if trajectory.status == 'failed' else ''}{trajectory.scene.name}: {trajectory.message}",
        f"  simulated        {lasted:.6g} s in {wall:.3g} s ({lasted / wall:.3g} times real time)",
        f"  method           {run.method} ({options}), {trajectory.stats['steps']} steps, "
        f"{trajectory.stats['rhs_evaluations']} right-hand sides",
        f"  energy balance   {off:.2e} J ({share:.1e} of the largest kinetic energy)",
    ]


def summarize(trajectory: Told, programme: str) -> str:
    """Return what a user wants to know of a run in a few lines; `programme` says how stable one is."""
    lines, ideal = opening(trajectory), [row.name for row in rows_of(trajectory.scene).ideal]
    for name in trajectory.residuals:
        residual = trajectory.residuals[name]
        position = "" if residual.position is None else f"{largest(residual.position):.2e}, "
        unit = "m/s" if name == "knife_edge" else "/s"
        held = f"; multiplier up to {largest(trajectory.reactions[name]):.4g}" if name in ideal else ""
        lines.append(f"  residual         {name}: {position}{largest(residual.velocity):.2e} {unit}{held}")
    if programme:
        lines.append(f"  programme        {programme}")
    if "knife_edge" in trajectory.reactions:
        edge, normal = trajectory.reactions["knife_edge"], trajectory.reactions["normal"]
        lines.append(f"  edge force       up to {largest(edge):.4g} N")
        lines.append(f"  normal force     {np.fmin.reduce(normal):.4g} to {np.fmax.reduce(normal):.4g} N")
        if np.fmin.reduce(normal) < 0.0 and not trajectory.scene.base.lift:
            first = float(trajectory.t[np.argmax(normal < 0.0)])
            lines.append(f"  WARNING          the snow would have to pull: the ski lifts off at t = {first:.4g} s")
    lines += [f"  WARNING          {sentence}" for sentence in _through_the_ground(trajectory)]
    lines += [f"  WARNING          {sentence}" for sentence in off_the_ski(trajectory)]
    lines += told_contacts(trajectory)
    lines += _events(trajectory)
    for name in trajectory.controls:
        values = trajectory.controls[name]
        power = trajectory.power(name)
        lines.append(
            f"  control          {name}: up to {largest(values):.4g} {force_unit(name)}, power {largest(power):.4g} W at most "
            f"and {_average(power):.4g} W on average, work {trajectory.work_by_force[name][-1]:.4g} J"
        )
    lines += [f"  note             {adjustment}" for adjustment in trajectory.adjustments]
    return "\n".join(lines)


def told_contacts(trajectory: Told) -> list[str]:
    """Tell when contacts changed, their largest forces and impulses, and what impacts and friction took."""
    lines, events = [], trajectory.events
    if trajectory.scene.base.lift:
        lines.append(f"  ski              {_when([event for event in events if 'ski' in event.contacts])}")
    legs = {leg.name for leg in trajectory.scene.legs}
    stops = [name for name in trajectory.lowest_gaps if name.endswith((".min", ".max"))]
    for name in (*trajectory.scene.touching, *stops):
        own = [event for event in events if name in event.contacts]
        when = _when(own)
        left = sum(event.kind == SLIPS and event.name == name for event in own) if name in legs else 0
        when += f"; WARNING: it let go {left} times because its force left its cone" if left else ""
        pushes = trajectory.reactions[name]
        force = largest(pushes if pushes.ndim == 1 else np.linalg.norm(pushes, axis=1))
        impulses = [float(np.linalg.norm(event.impulses[name])) for event in own if name in event.impulses]
        gap = trajectory.lowest_gaps.get(name)
        when += "" if gap is None else f"; lowest gap {gap:.2g} m"
        pushed = f"force up to {force:.4g} N, impulses up to {max(impulses, default=0.0):.4g} N s"
        what = "leg" if name in legs else "stop" if name in stops else "contact"
        lines.append(f"  {what:<17s}{name}: {pushed}; {when}")
    if any(footing.state == RESTING for stretch in trajectory.stretches for footing in stretch.footings):
        lines.append("  note             contacts share a load: forces are the least admissible ones, their sum is determined")
    times = [f"{event.t:.6g} s" for event in events if event.several]
    if times:
        when = ", ".join(times[:SHOWN]) + (f", ... ({len(times)})" if len(times) > SHOWN else "")
        lines.append(f"  note             other modes of contacts were admissible, and the most sticking ones taken, at {when}")
    ended = [f"{event.t:.6g} s (at most {event.early:.1g} s before)" for event in events if event.early]
    if ended:
        when = ", ".join(ended[:SHOWN]) + (f", ... ({len(ended)})" if len(ended) > SHOWN else "")
        lines.append(f"  note             contacts rest where endless ever smaller impacts would have ended, at {when}")
    works = trajectory.work_by_force.items()
    taken = {what: work[-1] for what, work in works if what == "impacts" or what.startswith("friction ")}
    if trajectory.scene.closing or stops:
        lines.append(f"  lost             {', '.join(f'{what} {-work:.4g} J' for what, work in taken.items())}")
    return lines


def _when(events: Sequence[Any]) -> str:
    """Tell when a contact changed: the first times."""
    when = ", ".join(f"{event.kind} {event.t:.6g} s" for event in events[:SHOWN]) or "no event"
    return when + (f", ... ({len(events)})" if len(events) > SHOWN else "")


def _events(trajectory: Told) -> list[str]:
    """Tell when the events of the scene happened."""
    lines = []
    for event in trajectory.scene.events:
        times = [f"{each.t:.6g} s" for each in trajectory.events if (each.kind, each.name) == (HAPPENS, event.name)]
        when = ", ".join(times[:SHOWN]) or "never"
        lines.append(f"  event            {event.name}: {when}" + (f", ... ({len(times)})" if len(times) > SHOWN else ""))
    return lines


def _through_the_ground(trajectory: Told) -> list[str]:
    """Say where a free base that starts above z = 0 takes a point below it: nothing stops it there."""
    scene = trajectory.scene
    if scene.base.kind != "free" or not scene.gravity or not trajectory.run.fall or scene.contacts or scene.legs:
        return []
    if not scene.links:
        return []
    heights = {f"{link.name}.{point}": trajectory[f"{link.name}.{point}.z"] for link in scene.links for point in ENDS}
    above = min((float(values[0]) for values in heights.values()), default=-1.0)
    below = {name: np.flatnonzero(values < -UNDER) for name, values in heights.items()}
    first = min((int(found[0]), name) for name, found in below.items() if found.size) if any(map(len, below.values())) else None
    if above < -UNDER or max(float(values[0]) for values in heights.values()) <= UNDER or first is None:
        return []
    return [
        f"{first[1]} goes through z = 0 at t = {trajectory.t[first[0]]:.4g} s: there is no ground under a free base (run.fall = "
        "false if that is meant)"
    ]


def off_the_ski(trajectory: Told) -> list[str]:
    """Say where the snow would have to push beside a ski of a given width or length, or beyond its ends."""
    base, found = trajectory.scene.base, []
    for size, moment, what in ((base.width, "roll_moment", "width"), (base.length, "pitch_moment", "length")):
        if not size:
            continue
        normal, turning = trajectory.reactions["normal"], trajectory.reactions[moment]
        off = np.flatnonzero(np.abs(turning) > 0.5 * size * np.maximum(normal, 0.0))
        if off.size:
            at = off[0]
            found.append(
                f"the snow would have to push {abs(turning[at] / normal[at]):.3g} m off the ski's middle at t = "
                f"{trajectory.t[at]:.4g} s, and half its {what} is {0.5 * size:g} m: a real one tips there ({moment} / normal)"
            )
    return found


def _average(values: Array) -> float:
    """Average size of the values that are known; nan where none is."""
    known = np.abs(values[~np.isnan(values)])
    return float(known.mean()) if known.size else float("nan")
