"""What has no mass: held by ideal rows it has a motion, else none."""

from __future__ import annotations

import contextlib

from vlmb.errors import SceneError, SingularError
from vlmb.system.start import Start
from vlmb.system.system import System

SINGULAR = 1e14  # condition of the scaled mass matrix beside the rows at which a start is refused


def require_held(system: System, start: Start, t0: float = 0.0) -> str:
    """Return a sentence about what has no mass and is held by ideal rows, "" without. SceneError where they do not hold it."""
    massless = system.mechanism.massless
    if not massless:
        return ""
    workspace = system.workspace(branch=start.branch)
    with contextlib.suppress(SingularError):  # the rows are known then, if not what moves
        workspace.rhs(t0, workspace.pack(start.state))
    condition, names = workspace.diagnostics.conditioning(start.state.q)
    if condition > SINGULAR:
        raise SceneError(f"{'; '.join(massless)}; the ideal rows do not hold it: {', '.join(names)} can move without inertia")
    said = "; ".join(text.partition(": give")[0] for text in massless)
    return f"{said}: ideal rows hold it, and Pinocchio's engine computes the motion"
