"""What ideal rows are worth at a state, and what moves them: what a passage through a singular posture needs of an engine."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.core.run import LOOKED_AT as FIRST

Array = NDArray[np.float64]

# of the most that a row has been worth: where a way through a singular posture is sought
REPEATING, TINIEST = 1e-10, 1e-300  # eigenvalues below this part of the largest: rows that repeat each other
LOOKED_AT = (FIRST, 0.2 * FIRST, 0.04 * FIRST)


class RowState(NamedTuple):
    """The ideal rows at a state, the knife edge first where a multiplier holds it."""

    names: tuple[str, ...]
    z: Array  # (e,) residuals
    rate: Array  # (e,) their rates
    answers: Array  # (e, nv) M^-1 J^T
    square: Array  # (e, e) J M^-1 J^T
    scale: Array  # (e,) root of the largest that its diagonal has been
    worth: float  # of the row that has least: beside those before it, as a share of the largest that it has been

    def shares(self, wanted: Array) -> Array:
        """Return the change of the velocities (nv,) that is least in kinetic energy and changes the rows by `wanted`."""
        own = np.sqrt(np.maximum(np.diag(self.square), TINIEST))
        matrix, right = self.square / np.outer(own, own), wanted / own
        shares = np.linalg.lstsq(matrix, right, rcond=REPEATING)[0] if self.repeating else np.linalg.solve(matrix, right)
        answer: Array = (shares / own) @ self.answers
        return answer

    @property
    def repeating(self) -> bool:
        """Whether some rows repeat others."""
        scale = np.sqrt(np.maximum(np.diag(self.square), TINIEST))
        values = np.linalg.eigvalsh(self.square / np.outer(scale, scale))
        return bool(values[0] <= REPEATING * values[-1])

    @property
    def dependent(self) -> list[str]:
        """Names of the rows that nearly depend on each other."""
        values, vectors = np.linalg.eigh(self.square / np.outer(self.scale, self.scale))
        first = min(int((values <= REPEATING * values[-1]).sum()), len(values) - 1)  # those before it repeat each other anyway
        weakest = np.abs(vectors[:, first])
        return [name for name, share in zip(self.names, weakest, strict=True) if share > 0.1 * weakest.max()]
