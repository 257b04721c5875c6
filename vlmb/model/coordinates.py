"""The chart: the paper's angles and lengths of a state (q, v), and back.

Link i has the direction d_i = (cos phi cos psi, sin phi cos psi, sin psi) in the surface frame, with
u_phi = (-sin phi, cos phi, 0) and u_psi = dd/dpsi. The state (q, v) has no pole; the angles have one at psi = pi/2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import SceneError, finite, nearest
from vlmb.model.frozen import read_only
from vlmb.model.layout import Layout, LinkIndex, State, segment_of

Array = NDArray[np.float64]

POLE = 1e-6  # cos(psi) below which an azimuth is not read, and M_phi not applied
QUARTER_TURN = 0.25 * math.pi**2  # [rad^2]
LEVEL, STILL = read_only(np.eye(3)), read_only(np.zeros(3))  # the surface frame, and its angular velocity
AFTER, BEFORE = np.array([1, 2, 0]), np.array([2, 0, 1])  # the axes of each component of a cross product


class Kinematics(NamedTuple):
    """Link frames and rates in the surface frame; leading axes are samples, then links."""

    rotations: Array  # (..., n, 3, 3), R_i, its first column is d_i
    omegas: Array  # (..., n, 3) [rad/s], absolute

    @property
    def directions(self) -> Array:
        """d_i (..., n, 3)."""
        return self.rotations[..., 0]

    @property
    def direction_rates(self) -> Array:
        """d_i' = omega_i x d_i (..., n, 3) [1/s]; free of spin."""
        return cross(self.omegas, self.rotations[..., 0])


def cross(first: Array, second: Array) -> Array:
    """Cross product over the last axis: of few vectors, a third of the time of NumPy's."""
    return first[..., AFTER] * second[..., BEFORE] - first[..., BEFORE] * second[..., AFTER]


def kinematics(layout: Layout, q: Array, v: Array) -> Kinematics:
    """Compose link frames and angular velocities: R_i = R_p R(q_i), omega_i = omega_p + R_i w_i.

    q (..., nq), v (..., nv); needs no Pinocchio.
    """
    q, v = np.asarray(q, float), np.asarray(v, float)
    shape = q.shape[:-1]
    rotations = np.zeros((*shape, len(layout.links), 3, 3))
    omegas = np.zeros((*shape, len(layout.links), 3))
    base_rotation, base_omega = _turn_of_base(layout, q, v)
    for i in layout.order:
        link = layout.links[i]
        parent_rotation = base_rotation if link.parent < 0 else rotations[..., link.parent, :, :]
        parent_omega = base_omega if link.parent < 0 else omegas[..., link.parent, :]
        local, rate = _turn_in_hinge(layout, link, q, v)
        rotation = rotations[..., i, :, :] = parent_rotation @ local
        omegas[..., i, :] = parent_omega + (rotation @ rate[..., None])[..., 0]
    return Kinematics(rotations, omegas)


def directions_of(layout: Layout, q: Array, v: Array) -> list[tuple[list[float], list[float]]]:
    """Return d_i and d_i' [1/s] of every link at one state q (nq,), v (nv,), as `kinematics` has them: in a third of its time."""
    turns, found = {-1: _turn_of_base(layout, q, v)}, [([0.0], [0.0])] * len(layout.links)
    for i in layout.order:
        link = layout.links[i]
        (rotation, omega), (local, rate) = turns[link.parent], _turn_in_hinge(layout, link, q, v)
        rotation = rotation @ local
        omega = omega + (rotation @ rate[:, None])[:, 0]
        turns[i] = rotation, omega
        (x, y, z), (a, b, c) = rotation[:, 0].tolist(), omega.tolist()
        found[i] = [x, y, z], [b * z - c * y, c * x - a * z, a * y - b * x]
    return found


def _turn_of_base(layout: Layout, q: Array, v: Array) -> tuple[Array, Array]:
    """Rotation (..., 3, 3) of the base, and its angular velocity (..., 3) [rad/s]."""
    if layout.base != "ski":
        return LEVEL, STILL
    norm, zero = np.hypot(q[..., 2], q[..., 3]), np.zeros(q.shape[:-1])
    return _about_z(q[..., 2] / norm, q[..., 3] / norm), np.stack([zero, zero, v[..., 2]], axis=-1)


def _turn_in_hinge(layout: Layout, link: LinkIndex, q: Array, v: Array) -> tuple[Array, Array]:
    """Rotation (..., 3, 3) of a link in its parent's frame, and its angular velocity (..., 3) beyond the parent's in its own."""
    if not layout.plane:
        return _from_quaternion(q[..., link.q : link.q + 4]), v[..., link.v : link.v + 3]
    angle, rate = q[..., link.q], np.zeros((*q.shape[:-1], 3))
    rate[..., 1] = -v[..., link.v]
    return _about_minus_y(np.cos(angle), np.sin(angle)), rate


def read_angles(direction: Sequence[float], reference: tuple[float, float] | None = None) -> tuple[float, float]:
    """Read (phi, psi) of a direction on the branch nearest to a reference; without one, |psi| <= pi/2 and |phi| <= pi.

    (phi, psi) and (phi + pi, pi - psi), each modulo 2 pi, are the same direction; a link that leans back past the
    vertical goes on smoothly. Within POLE of the pole the azimuth of the reference is kept.
    """
    dx, dy, dz = direction
    flat = math.hypot(dx, dy)
    psi = math.atan2(dz, flat)
    if reference is None:
        return math.atan2(dy, dx) if flat > 1e-12 else 0.0, psi
    phi = math.atan2(dy, dx) if flat > 1e-12 else reference[0]
    best, angles = math.inf, (phi, psi)
    for candidate_phi, candidate_psi in ((phi, psi), (phi + math.pi, math.pi - psi)):
        delta_phi = math.remainder(candidate_phi - reference[0], math.tau)
        delta_psi = math.remainder(candidate_psi - reference[1], math.tau)
        distance = delta_phi * delta_phi + delta_psi * delta_psi
        if distance < best:
            best, angles = distance, (reference[0] + delta_phi, reference[1] + delta_psi)
        if best < QUARTER_TURN:
            break  # the other one is further away
    return angles


def angle_rates(direction_rate: Sequence[float], phi: float, psi: float) -> tuple[float, float]:
    """Return (phidot, psidot) of a link: phidot = u_phi . d' / cos psi, psidot = u_psi . d'; phidot is 0 at the pole."""
    sin_phi, cos_phi, sin_psi, cos_psi = math.sin(phi), math.cos(phi), math.sin(psi), math.cos(psi)
    rx, ry, rz = direction_rate
    along = -sin_phi * rx + cos_phi * ry
    phi_rate = along / cos_psi if abs(cos_psi) > 1e-12 else 0.0
    return phi_rate, -cos_phi * sin_psi * rx - sin_phi * sin_psi * ry + cos_psi * rz


def read_coordinates(layout: Layout, q: Array, v: Array, reference: Array | None = None) -> tuple[Array, Array]:
    """Read the coordinates and their rates (N,), (N,) of one state, angles on the branch nearest to `reference` (N,)."""
    values, rates = np.zeros(len(layout.names)), np.zeros(len(layout.names))
    index, moving = layout.index, directions_of(layout, q, v)
    if layout.base == "ski":
        heading = math.atan2(q[3], q[2])
        if reference is not None:
            heading = reference[2] + math.remainder(heading - reference[2], math.tau)
        cosine, sine = math.cos(heading), math.sin(heading)
        values[:3] = q[0], q[1], heading
        rates[:3] = cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1], v[2]
        if layout.lifts:
            values[3], rates[3] = q[4], v[3]
    elif layout.base == "free":
        size = layout.base_size
        values[:size], rates[:size] = q[:size], v[:size]
    for i in layout.order:
        link = layout.links[i]
        at = index[f"psi{i + 1}"]
        if layout.plane:
            parent = index[f"psi{link.parent + 1}"] if link.parent >= 0 else -1
            values[at] = q[link.q] + (values[parent] if parent >= 0 else 0.0)
            rates[at] = v[link.v] + (rates[parent] if parent >= 0 else 0.0)
        else:
            before = None if reference is None else (reference[at - 1], reference[at])
            direction, direction_rate = moving[i]
            angles = read_angles(direction, before)
            values[at - 1 : at + 1] = angles
            rates[at - 1 : at + 1] = angle_rates(direction_rate, *angles)
    for at, coordinate in enumerate(layout.coordinates):
        if coordinate.kind == "xi":
            segment = segment_of(layout, coordinate)
            values[at], rates[at] = q[segment.q], v[segment.v]
    return values, rates


def make_state(layout: Layout, coordinates: Mapping[str, float], rates: Mapping[str, float] | None = None) -> State:
    """Turn the paper's coordinates and rates into (q, v), every link with zero absolute spin.

    Absolute omega_i = phidot cos(psi) u_psi - psidot u_phi; ball velocity R_i^T (omega_i - omega_p).
    Raises SceneError naming a missing, unknown or non-finite coordinate. Missing rates are 0.
    """
    values = _complete(layout, coordinates)
    speeds = _rates(layout, rates or {})
    q, v = np.zeros(layout.nq), np.zeros(layout.nv)
    base_rotation, base_omega = LEVEL, STILL
    if layout.base == "ski":
        cosine, sine = math.cos(values["phi0"]), math.sin(values["phi0"])
        q[:4] = values["x"], values["y"], cosine, sine
        v[:3] = (
            cosine * speeds["x"] + sine * speeds["y"],
            -sine * speeds["x"] + cosine * speeds["y"],
            speeds["phi0"],
        )
        if layout.lifts:
            q[4], v[3] = values["z"], speeds["z"]
        base_rotation, base_omega = _about_z(np.float64(cosine), np.float64(sine)), np.array([0.0, 0.0, v[2]])
    elif layout.base == "free":
        for at in range(layout.base_size):
            q[at], v[at] = values[layout.names[at]], speeds[layout.names[at]]
    frames, omegas = {-1: base_rotation}, {-1: base_omega}
    for i in layout.order:
        link, psi = layout.links[i], values[f"psi{i + 1}"]
        if layout.plane:
            parent = f"psi{link.parent + 1}"
            q[link.q] = psi - (values[parent] if link.parent >= 0 else 0.0)
            v[link.v] = speeds[f"psi{i + 1}"] - (speeds[parent] if link.parent >= 0 else 0.0)
            continue
        phi = values[f"phi{i + 1}"]
        cos_phi, sin_phi, cos_psi, sin_psi = math.cos(phi), math.sin(phi), math.cos(psi), math.sin(psi)
        d = cos_phi * cos_psi, sin_phi * cos_psi, sin_psi
        u_phi, u_psi = (-sin_phi, cos_phi, 0.0), (-cos_phi * sin_psi, -sin_phi * sin_psi, cos_psi)
        about_psi, about_phi = speeds[f"phi{i + 1}"] * cos_psi, speeds[f"psi{i + 1}"]
        frames[i] = np.array([*zip(d, u_phi, u_psi, strict=True)])
        omegas[i] = np.array([about_psi * rising - about_phi * turning for rising, turning in zip(u_psi, u_phi, strict=True)])
        q[link.q : link.q + 4] = _to_quaternion(frames[link.parent].T @ frames[i])
        v[link.v : link.v + 3] = frames[i].T @ (omegas[i] - omegas[link.parent])
    for coordinate in layout.coordinates:
        if coordinate.kind == "xi":
            segment = segment_of(layout, coordinate)
            q[segment.q], v[segment.v] = values[coordinate.name], speeds[coordinate.name]
    return State(q, v)


def _complete(layout: Layout, coordinates: Mapping[str, float]) -> dict[str, float]:
    if coordinates.keys() != layout.index.keys():
        for name in coordinates:
            if name not in layout.index:
                raise SceneError(f"unknown coordinate {name!r}; {nearest(name, layout.names)}")
        missing = [name for name in layout.names if name not in coordinates]
        raise SceneError(f"missing coordinates {', '.join(missing)}: a state needs every one of {', '.join(layout.names)}")
    return {name: finite(name, coordinates[name]) for name in layout.names}


def _rates(layout: Layout, rates: Mapping[str, float]) -> dict[str, float]:
    speeds = dict.fromkeys(layout.names, 0.0)
    for name, value in rates.items():
        coordinate = name.removesuffix("_dot")
        if coordinate == name or coordinate not in speeds:
            raise SceneError(f"unknown rate {name!r}; {nearest(name, [f'{known}_dot' for known in layout.names])}")
        speeds[coordinate] = finite(name, value)
    return speeds


def _about_z(cosine: Array | np.float64, sine: Array | np.float64) -> Array:
    zero, one = np.zeros_like(cosine), np.ones_like(cosine)
    rows = [cosine, -sine, zero, sine, cosine, zero, zero, zero, one]
    return np.stack(rows, axis=-1).reshape(*np.shape(cosine), 3, 3)


def _about_minus_y(cosine: Array, sine: Array) -> Array:
    zero, one = np.zeros_like(cosine), np.ones_like(cosine)
    rows = [cosine, zero, -sine, zero, one, zero, sine, zero, cosine]
    return np.stack(rows, axis=-1).reshape(*np.shape(cosine), 3, 3)


def _from_quaternion(quaternion: Array) -> Array:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) in the order x, y, z, w, of any norm."""
    one = quaternion.ndim == 1  # a tenth of the time in plain numbers
    x, y, z, w = quaternion.tolist() if one else (quaternion[..., at] for at in range(4))
    norm = (math.sqrt if one else np.sqrt)(x * x + y * y + z * z + w * w)
    if one and norm == 0.0:
        norm = math.nan  # as NumPy has it
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return (np.array(rows) if one else np.stack(rows, axis=-1)).reshape(*quaternion.shape[:-1], 3, 3)


def _to_quaternion(rotation: Array) -> tuple[float, ...]:
    """Quaternion (x, y, z, w) of a rotation matrix, by its largest component."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    products = (
        (1 + xx - yy - zz, xy + yx, xz + zx, zy - yz),
        (xy + yx, 1 - xx + yy - zz, yz + zy, xz - zx),
        (xz + zx, yz + zy, 1 - xx - yy + zz, yx - xy),
        (zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz),
    )  # symmetric, 4 q q^T
    x, y, z, w = products[max(range(4), key=lambda k: products[k][k])]
    norm = math.sqrt((x * x + z * z) + (y * y + w * w))
    return x / norm, y / norm, z / norm, w / norm
