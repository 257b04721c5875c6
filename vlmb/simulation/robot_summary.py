"""The summary of a run with robots in a few lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vlmb.simulation import summary
from vlmb.simulation.named import largest

Array = NDArray[np.float64]

SHOWN = 8  # controls and limits, those of the largest shares first


class Told(summary.Told, Protocol):
    """What of a run the summary reads: see `RobotTrajectory`."""

    @property
    def shares(self) -> dict[str, float]: ...  # noqa: D102


def summarize_robots(run: Told, programme: str) -> str:
    """Return what a user wants to know of a run in a few lines; `programme` says how stable one is."""
    lines = summary.opening(run)
    for name, residual in run.residuals.items():
        position = "" if residual.position is None else f"{largest(residual.position):.2e}, "
        lines.append(f"  residual         {name}: {position}{largest(residual.velocity):.2e} /s")
    if programme:
        lines.append(f"  programme        {programme}")
    contacts = [contact.name for contact in run.scene.contacts]
    for name, values in run.reactions.items():
        if name in contacts:
            continue
        if values.ndim == 2:
            force, moment = (np.linalg.norm(values[:, part], axis=1) for part in (slice(0, 3), slice(3, 6)))
            lines.append(f"  reaction         {name}: up to {largest(force):.4g} N and {largest(moment):.4g} N m")
        else:
            lines.append(f"  reaction         {name}: up to {largest(values):.4g}")
    lines += [f"  WARNING          {sentence}" for sentence in summary.off_the_ski(run)]
    lines += summary.told_contacts(run)
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
