"""The summary of a run with robots in a few lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vlmb.scene.tables import DEFAULT_STEP
from vlmb.simulation.methods import find_method
from vlmb.simulation.named import largest

Array = NDArray[np.float64]

SHOWN = 8  # controls and limits, those of the largest shares first


class Told(Protocol):
    """What of a run the summary reads: see `RobotTrajectory`."""

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
    def shares(self) -> dict[str, float]: ...  # noqa: D102
    def __getitem__(self, name: str) -> Array: ...


def summarize_robots(run: Told, programme: str) -> str:
    """Return what a user wants to know of a run in a few lines; `programme` says how stable one is."""
    options, wall, lasted = run.run, max(run.stats["wall_time"], 1e-9), float(run.t[-1]) - run.t0
    fixed = not find_method(options.method).adaptive
    chosen = f"step {options.step or DEFAULT_STEP:g} s" if fixed else f"rtol {options.rtol:g}, atol {options.atol:g}"
    off = float(np.abs(run["balance"]).max())
    share = off / max(float(run["kinetic"].max()), 1e-300)
    lines = [f"DOUBTFUL  {doubt}" for doubt in run.doubts]
    lines += [
        f"{'FAILED  ' if run.status == 'failed' else ''}{run.scene.name}: {run.message}",
        f"  simulated        {lasted:.6g} s in {wall:.3g} s ({lasted / wall:.3g} times real time)",
        f"  method           {options.method} ({chosen}), {run.stats['steps']} steps, "
        f"{run.stats['rhs_evaluations']} right-hand sides",
        f"  energy balance   {off:.2e} J ({share:.1e} of the largest kinetic energy)",
    ]
    for name, residual in run.residuals.items():
        position = "" if residual.position is None else f"{largest(residual.position):.2e}, "
        lines.append(f"  residual         {name}: {position}{largest(residual.velocity):.2e} /s")
    if programme:
        lines.append(f"  programme        {programme}")
    for name, values in run.reactions.items():
        if values.ndim == 2:
            force, moment = (np.linalg.norm(values[:, part], axis=1) for part in (slice(0, 3), slice(3, 6)))
            lines.append(f"  reaction         {name}: up to {largest(force):.4g} N and {largest(moment):.4g} N m")
        else:
            lines.append(f"  reaction         {name}: up to {largest(values):.4g}")
    lines += _controls(run) + _limits(run.shares)
    lines += [f"  note             {adjustment}" for adjustment in run.adjustments]
    return "\n".join(lines)


def _controls(run: Told) -> list[str]:
    """Tell the controls with the largest shares of their efforts, or of all the largest."""
    if not run.controls:
        return []
    shares = {name: run.shares.get(f"effort:{name}") for name in run.controls}
    order = sorted(run.controls, key=lambda name: -(shares[name] or 0.0))
    found = []
    for name in order[:SHOWN]:
        share = shares[name]
        of = "" if share is None else f", {100.0 * share:.3g} % of its limit"
        work = run.work_by_force[name][-1]
        found.append(f"  control          {name}: up to {largest(run.controls[name]):.4g}{of}, work {work:.4g} J")
    if len(order) > SHOWN:
        found.append(f"  control          and {len(order) - SHOWN} more: see `controls` and run.csv")
    return found


def _limits(shares: Mapping[str, float]) -> list[str]:
    """Tell the largest share of every kind of limit, and warn of those that are passed."""
    found = []
    for kind, what in (("effort", "efforts"), ("speed", "speeds"), ("range", "ranges of joints")):
        own = {name.partition(":")[2]: value for name, value in shares.items() if name.startswith(f"{kind}:")}
        if not own:
            continue
        most = max(own, key=lambda name: own[name])
        found.append(f"  limits           {what} of the URDF: {most} uses {100.0 * own[most]:.3g} %")
        beyond = sorted((name for name, value in own.items() if value > 1.0 + 1e-9), key=lambda name: -own[name])
        if beyond:
            names = ", ".join(f"{name} ({100.0 * own[name]:.3g} %)" for name in beyond[:5])
            more = f" and {len(beyond) - 5} more" if len(beyond) > 5 else ""
            found.append(f"  WARNING          beyond the limits of the URDF ({what}): {names}{more}: a real robot cannot do this")
    return found
