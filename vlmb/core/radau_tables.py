"""Coefficients of Radau IIA with three stages, from its nodes."""

from __future__ import annotations

import numpy as np

SQRT6 = 6.0**0.5
NODES = np.array([(4.0 - SQRT6) / 10.0, (4.0 + SQRT6) / 10.0, 1.0])
POWERS = NODES[:, None] ** np.arange(1, 4)  # (stage, power) c^1, c^2, c^3
STAGES = (POWERS / np.arange(1, 4)) @ np.linalg.inv(POWERS / NODES[:, None])  # the matrix A: integrates 1, c, c^2 exactly
POLYNOMIAL = np.linalg.inv(POWERS)  # (power, stage) coefficients of the cubic through 0 and the stages

# A^-1 T = T diag(REAL, [[RE, IM], [-IM, RE]]): one real and one complex system instead of one three times as large
_values, _vectors = np.linalg.eig(np.linalg.inv(STAGES))
_real, _complex = int(np.argmin(abs(_values.imag))), int(np.argmax(_values.imag))
REAL, RE, IM = float(_values[_real].real), float(_values[_complex].real), float(_values[_complex].imag)
TO_STAGES = np.ascontiguousarray(np.array([_vectors[:, _real].real, _vectors[:, _complex].real, _vectors[:, _complex].imag]).T)
FROM_STAGES = np.ascontiguousarray(np.linalg.inv(TO_STAGES))
ERROR = np.array([-13.0 - 7.0 * SQRT6, -13.0 + 7.0 * SQRT6, -1.0]) / 3.0  # of the embedded formula of order 3
