"""What the hard cases have in common: a finding with its verdict, runs judged by a reference, condition numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.reference.drive import drive
from tests.reference.witness import Witness
from vlmb import Scene, SimulationError, Trajectory, VlmbError, build, simulate
from vlmb.core.driver import DONE
from vlmb.system.system import make_system

Array = NDArray[np.float64]
Table = dict[str, Any]
PIVOT: Table = {"kind": "pivot"}
SKI: Table = {"kind": "ski", "mass": 5.0, "inertia": 0.6}
TIGHT: Table = {"rtol": 1e-12, "atol": 1e-13, "fall": False}
ANY_LENGTH = [-math.inf, math.inf]
LOOKED_AT = 400  # postures whose condition number is computed


def marched(method: str, rhs: Callable[[float, Array], Array], y: Array, step: float, times: Sequence[float]) -> Array:
    """States at the times by fixed steps from t = 0; SimulationError where the stages of a step do not converge."""
    found = drive(rhs, 0.0, y, times[-1], method, times, step=step)
    if found.code != DONE:
        raise SimulationError(f"its stages do not converge at t = {found.t:g} s")
    return found.samples


@dataclass(frozen=True)
class Finding:
    """One variant of a hard case. `limit`: the error allowed for the verdict `right`."""

    what: str
    done: str
    error: float | None = None  # None: no run to judge
    unit: str = "m"
    limit: float = 0.0
    residual: float | None = None  # of constraints, or of the energy [J]
    condition: float | None = None  # of the mass matrix scaled to a unit diagonal, largest on the way
    said: str = ""  # the engine's own words where it stops, refuses or warns
    naive: str = ""

    @property
    def verdict(self) -> str:
        """Whether it is right, named, both, or WRONG: off without a word."""
        if self.error is not None and self.error <= self.limit:
            return "right, and said" if self.said else "right"
        return "said" if self.said else "WRONG"


def scene(base: Table, links: Sequence[Table], **keys: Any) -> Scene:
    """A scene of links, by default with tight tolerances and no end by a fall."""
    return Scene.from_dict({"base": base, "links": list(links), "run": TIGHT, **keys})


def rod(length: float = 0.5, mass: float = 2.0, **keys: Any) -> Table:
    """A link: a rod with segments as given, none by default."""
    return {"rod": {"length": length, "mass": mass}, **keys}


def tips(run: Trajectory) -> Array:
    """Tips (samples, links, 3) [m]."""
    return np.stack([run.position(link.name) for link in run.mechanism.layout.links], axis=1)


def witnessed(of: Scene, times: Array, rtol: float = 1e-13) -> Array:
    """Tips (samples, links, 3) [m] by mass points and unit directions."""
    data = of.to_dict()
    result = Witness(data).simulate(times, rtol=rtol, atol=0.1 * rtol)
    return np.stack([result.position(link.name) for link in of.links], axis=1)


def worst_condition(run: Trajectory) -> float:
    """Largest condition number of the scaled mass matrix over the samples."""
    workspace = run.system.workspace()
    every = max(1, len(run) // LOOKED_AT)
    return max(workspace.diagnostics.conditioning(q)[0] for q in run.q[::every])


def posture_condition(of: Scene, coordinates: Mapping[str, float]) -> float:
    """Condition number of the scaled mass matrix at a posture."""
    mechanism = build(of)
    return make_system(mechanism, gain=0.0).workspace().diagnostics.conditioning(mechanism.state(coordinates).q)[0]


def judged(what: str, done: str, run: Trajectory, reference: Array, limit: float, naive: str = "", **known: Any) -> Finding:
    """A finding from a run and the reference of its tips."""
    error = float(np.abs(tips(run) - reference[: len(run)]).max())
    said = "" if run.status == "finished" else run.message
    said = " ".join([*run.mechanism.warnings, said]).strip()
    balance = float(np.abs(run["balance"]).max())
    values = {"residual": balance, "condition": worst_condition(run), "said": said} | known
    return Finding(what, done, error, limit=limit, naive=naive, **values)


def refused(what: str, done: str, attempt: Callable[[], object], naive: str = "") -> Finding:
    """A finding where a named error is the right answer; without one it is WRONG."""
    try:
        answer = attempt()
    except VlmbError as error:
        return Finding(what, done, said=str(error), naive=naive)
    if isinstance(answer, Trajectory) and answer.status != "finished":
        return Finding(what, done, said=answer.message, naive=naive)
    return Finding(what, done, naive=naive)


def run(of: Scene, times: Array | None = None, **options: Any) -> Trajectory:
    """A run up to the last of the times."""
    if times is not None:
        options = {"duration": float(times[-1]), "t_eval": times} | options
    return simulate(of, **options)
