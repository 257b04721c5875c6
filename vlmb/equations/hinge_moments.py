"""Maps between the paper's hinge moments and the generalized forces of its absolute angles, both ways.

The paper joins links by two cylindrical hinges: the first turns about the vertical, the second about the horizontal axis normal
to the vertical plane of the link, -u_phi = (sin phi, -cos phi, 0). A hinge moment acts on the link with its sign and on what the
link hangs on with the opposite one, while phi and psi are absolute. By virtual work, summed over the links c that hang on link i
(on its tip or its rod: the point does not matter),

    Q_phi0   = M_phi0   - sum M_phi_c                          over the links on the ski,
    Q_phi_i  = M_phi_i  - sum M_phi_c,
    Q_psi_i  = M_psi_i  - sum M_psi_c cos(phi_c - phi_i).

The ski feels M_phi of its links, as a ski does, and nothing of M_psi: it cannot roll or pitch. Positive moments increase the
link's own angle. The ground of a pivot takes every reaction; a free base has nothing that could, so the moments of its first
links come from outside. Forces along segments and on the base are the same in both descriptions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from vlmb.equations.motion import complete_posture
from vlmb.errors import SceneError, finite, nearest
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import force_along


def generalized_from_hinge_moments(
    mechanism: Mechanism, coordinates: Mapping[str, float], moments: Mapping[str, float]
) -> dict[str, float]:
    """Return the generalized forces of the coordinates that hinge moments amount to.

    Q_phi_i = M_phi_i - sum M_phi_c, Q_psi_i = M_psi_i - sum M_psi_c cos(phi_c - phi_i), Q_phi0 = M_phi0 - sum M_phi_c.

    Parameters
    ----------
    coordinates : every coordinate by name; the azimuths alone matter.
    moments : hinge moments `M_phi1`, `M_psi1` [N m]; the moment `M_phi0` on the ski from outside; forces `F1_1`, `F_x` [N].
        What is left out is 0.

    Returns every generalized force under the same names, as `solve`, forces and controls take them.
    Raises SceneError naming an unknown force, or a coordinate (see `equations_of_motion`).
    """
    given, cosines = _given(mechanism, moments), _cosines(mechanism, coordinates)
    out = dict(given)
    for i, link in enumerate(mechanism.layout.links):
        for angle, share in (("phi", 1.0), ("psi", cosines[i])):
            own, reacting = f"M_{angle}{i + 1}", f"M_{angle}{link.parent + 1}"  # the ski's is M_phi0
            if own in given and reacting in given:
                out[reacting] -= given[own] * share
    return out


def hinge_moments_from_generalized(
    mechanism: Mechanism, coordinates: Mapping[str, float], forces: Mapping[str, float]
) -> dict[str, float]:
    """Return the hinge moments that amount to generalized forces; the inverse of `generalized_from_hinge_moments`.

    M_phi_i = Q_phi_i + sum M_phi_c, M_psi_i = Q_psi_i + sum M_psi_c cos(phi_c - phi_i), from the outer links inwards.
    Names, units and errors are the same.
    """
    out, cosines = _given(mechanism, forces), _cosines(mechanism, coordinates)
    for i in reversed(mechanism.layout.order):
        for angle, share in (("phi", 1.0), ("psi", cosines[i])):
            own, reacting = f"M_{angle}{i + 1}", f"M_{angle}{mechanism.layout.links[i].parent + 1}"
            if own in out and reacting in out:
                out[reacting] += out[own] * share
    return out


def _given(mechanism: Mechanism, forces: Mapping[str, float]) -> dict[str, float]:
    """Every force by name, 0 where none is given."""
    out = {force_along(coordinate): 0.0 for coordinate in mechanism.layout.coordinates}
    for name, value in forces.items():
        if name not in out:
            why = "with plane = true the links have no azimuth of their own; " if str(name).startswith("M_phi") else ""
            raise SceneError(f"unknown force {name!r}; {why if mechanism.layout.plane else ''}{nearest(name, out)}")
        out[name] = finite(name, value)
    return out


def _cosines(mechanism: Mechanism, coordinates: Mapping[str, float]) -> list[float]:
    """cos(phi_i - phi_p) of each link and what it hangs on; 1 in a plane."""
    layout, posture = mechanism.layout, complete_posture(mechanism, coordinates)
    if layout.plane:
        return [1.0] * len(layout.links)
    phi = {-1: 0.0} | {i: posture[f"phi{i + 1}"] for i in range(len(layout.links))}
    return [math.cos(phi[i] - phi[link.parent]) for i, link in enumerate(layout.links)]
