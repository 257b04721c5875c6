"""Independent witness: the same mechanisms from mass points and Lagrange's equations, in numpy and scipy alone.

Nothing here knows of joints, quaternions or the project's engine. A link is a unit direction d in R^3, so there is no
pole; every mass point is linear in the directions,

    r_p = b_p r_base + sum_k s_pk(xi) d_k,      s_pk affine in the segment lengths xi,

and the equations are those of d'Alembert and Lagrange for the velocities u that the constraints leave free,

    sum_p m_p J_p^T (J_p udot + a_p - g) = Q,   v_p = J_p u,   a_p = Jdot_p u.

* A thin uniform rod is three points, m/6, 4m/6, m/6 at its start, middle and end: exact mass, centre and inertia.
* A rod with a given centre of mass and inertia I is one point and the energy I |ddot|^2 / 2: a row with b = 0, s = 1.
* |d| = 1: accelerations are -|ddot|^2 d plus two components in the tangent plane, the multiplier being eliminated.
  The integrated d may drift off the sphere by rounding; it is normalised where it is used, and the field is continued
  off the sphere so that |d| stays what it is.
* Ski: a direction of its own, (cos phi0, sin phi0, 0). The knife edge is v_A = speed * heading, which holds exactly.
* `phi1 = phi0`: the link has one angle in the vertical plane of the heading, poles included, and it too holds exactly.
* Any other ideal constraint is an equation between the paper's coordinates, with a multiplier.

Angles are read as the scene's coordinates: phi = atan2(d_y, d_x), psi = atan2(d_z, hypot(d_x, d_y)) or
(phi + pi, pi - psi), each modulo 2 pi, whichever is nearest to the last accepted step. Units: m, rad, s, kg, N.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import DOP853

Array = npt.NDArray[np.float64]
Law = Callable[[float], tuple[float, float, float]]
Force = Callable[[float, dict[str, float], dict[str, float]], "Mapping[str, Any] | None"]

POINTS = ("hinge", "rod_start", "rod_end", "tip")
SCENE_KEYS = {
    "name", "gravity", "slope", "plane", "constraints", "base", "links", "start", "parameters", "forces", "programme",
    "run",
}  # fmt: skip
BASE_KEYS = {"kind", "mass", "inertia", "com_offset"}
LINK_KEYS = {"name", "parent", "parent_point", "rod", "lower", "upper", "tip_mass"}
ROD_KEYS = {"length", "mass", "com", "inertia"}
SEGMENT_KEYS = {"length", "motion", "law", "stiffness", "damping", "rest", "limits"}

STABILISATION = 5.0  # 1/s: how fast residuals of general ideal constraints decay; does not act where they are zero
POLE = 1e-12  # |cos psi| below this: M_phi has no meaning, phi_dot is reported as 0


class Rates(dict[str, float]):
    """Rates by coordinate name: `rates["phi1_dot"]` and `rates["phi1"]` are the same number."""

    def __missing__(self, key: str) -> float:
        if key.endswith("_dot"):
            raise KeyError(key)
        return self[key + "_dot"]


class RateArrays(dict[str, Array]):
    """Arrays of rates by coordinate name, with and without `_dot`."""

    def __missing__(self, key: str) -> Array:
        if key.endswith("_dot"):
            raise KeyError(key)
        return self[key + "_dot"]


@dataclass(frozen=True)
class _Segment:
    """One massless segment: a constant length, a free length or a prescribed one."""

    name: str
    motion: str
    length: float
    stiffness: float
    damping: float
    rest: float


@dataclass(frozen=True)
class _Reach:
    """A point of a link, r = b r_base + sum_k s_k d_k + sum_j sigma_j xi_j d_k(j)."""

    s: Array
    sigma: Array

    def along(self, direction: int, length: float, segment: int | None = None) -> _Reach:
        s, sigma = self.s.copy(), self.sigma.copy()
        s[direction] += length
        if segment is not None:
            sigma[segment] += 1.0
        return _Reach(s, sigma)


@dataclass
class _Link:
    """A link as read from the scene, then its points."""

    name: str
    number: int
    parent: str
    parent_point: str
    rod: Mapping[str, float]
    lower: _Segment
    upper: _Segment
    tip_mass: float
    direction: int = 0
    points: dict[str, _Reach] = field(default_factory=dict)


@dataclass(frozen=True)
class _Plane:
    """`phi_i = phi0` (azimuth None) or `phi_i = constant`; sign of the equation as written."""

    text: str
    azimuth: float | None
    sign: float


@dataclass(frozen=True)
class _Row:
    """An ideal constraint g(q, t) = 0: returns g, gdot, the part of gddot without accelerations, dg/dq."""

    text: str
    function: Callable[..., Sequence[float]]


@dataclass
class Instant:
    """Everything at one instant: accelerations of the paper's coordinates and the forces that go with them."""

    accelerations: dict[str, float]
    edge_force: float
    prescribed_force: dict[str, float]
    constraint_force: dict[str, float]
    derivative: Array


@dataclass(slots=True)
class _Kinematics:
    """Directions, reaches and Jacobians at one state."""

    t: float
    base: Array  # (3,) position of pivot, knife-edge point or first hinge
    base_rate: Array  # (3,)
    base_bias: Array  # (3,) its acceleration without udot
    heading: Array  # (3,) ski
    left: Array  # (3,) ski
    speed: float
    yaw: float
    yaw_rate: float
    norms: Array  # (nf,) |d| as integrated
    radial: Array  # (nf,) d . ddot as integrated
    tilt: Array  # (np,) angles of links kept in a plane
    tilt_rate: Array
    d: Array  # (nd, 3)
    d_rate: Array  # (nd, 3)
    d_bias: Array  # (nd, 3)
    d_jacobian: Array  # (nd, 3, N)
    xi: Array  # (nx,)
    xi_rate: Array
    xi_bias: Array  # prescribed accelerations, else 0
    s: Array  # (P, nd)
    s_rate: Array


def _check_keys(table: Mapping[str, Any], allowed: set[str], where: str) -> None:
    unknown = sorted(set(table) - allowed)
    if unknown:
        raise ValueError(f"{where}: unknown key {unknown[0]!r}; allowed: {', '.join(sorted(allowed))}")


def _segment(table: Mapping[str, Any] | None, name: str) -> _Segment:
    if table is None:
        return _Segment(name, "fixed", 0.0, 0.0, 0.0, 0.0)
    _check_keys(table, SEGMENT_KEYS, name)
    motion = table.get("motion", "free")
    if motion not in ("free", "fixed", "prescribed"):
        raise ValueError(f"{name}: motion {motion!r} is none of free, fixed, prescribed")
    length = float(table.get("length", 0.0))
    return _Segment(
        name,
        motion,
        length,
        float(table.get("stiffness", 0.0)),
        float(table.get("damping", 0.0)),
        float(table.get("rest", length)),
    )


def direction(phi: float, psi: float) -> Array:
    """Return d = (cos phi cos psi, sin phi cos psi, sin psi)."""
    return np.array([math.cos(phi) * math.cos(psi), math.sin(phi) * math.cos(psi), math.sin(psi)])


def _nearest(angle: float, reference: float) -> float:
    return angle + 2.0 * math.pi * round((reference - angle) / (2.0 * math.pi))


class Witness:
    """The mechanism of a scene as mass points.

    Parameters
    ----------
    scene : dict with the keys of a scene file (base, links, gravity, slope, start, constraints, plane on a ski).
    laws : for each prescribed segment, by coordinate name, t -> (length, rate, acceleration) [m, m/s, m/s^2].
    """

    def __init__(self, scene: Mapping[str, Any], laws: Mapping[str, Law] | None = None) -> None:
        _check_keys(scene, SCENE_KEYS, "scene")
        base = scene.get("base", {})
        _check_keys(base, BASE_KEYS, "base")
        self.kind: str = base.get("kind", "")
        if self.kind not in ("pivot", "ski", "free"):
            raise ValueError(f"base.kind {self.kind!r} is none of pivot, ski, free")
        slope, size = float(scene.get("slope", 0.0)), float(scene.get("gravity", 9.81))
        self.gravity = size * np.array([math.sin(slope), 0.0, -math.cos(slope)])
        self._start: dict[str, float] = dict(scene.get("start", {}))
        self._texts_of_forces = bool(scene.get("forces")) or bool(scene.get("programme"))

        self._links = self._read_links(scene.get("links", []))
        self._by_name = {link.name: link for link in self._links}
        self._read_segments(dict(laws or {}))
        self._read_points()
        self._read_masses(base)
        self._read_constraints(scene)
        self._layout()

    # ------------------------------------------------------------------------------------------------ reading a scene

    @staticmethod
    def _read_links(tables: Sequence[Mapping[str, Any]]) -> list[_Link]:
        links: list[_Link] = []
        for number, table in enumerate(tables, 1):
            name = table.get("name", f"link{number}")
            _check_keys(table, LINK_KEYS, f"link {name}")
            rod = dict(table.get("rod", {}))
            _check_keys(rod, ROD_KEYS, f"rod of {name}")
            links.append(
                _Link(
                    name,
                    number,
                    table.get("parent", links[-1].name if links else "base"),
                    table.get("parent_point", "tip"),
                    rod,
                    _segment(table.get("lower"), f"xi{number}_1"),
                    _segment(table.get("upper"), f"xi{number}_2"),
                    float(table.get("tip_mass", 0.0)),
                )
            )
        names = ["base", *(link.name for link in links)]
        if len(set(names)) != len(names):
            raise ValueError(f"names of links are not unique: {names[1:]}")
        for link in links:
            if link.parent not in names:
                raise ValueError(f"link {link.name}: parent {link.parent!r} is none of {', '.join(names)}")
            if link.parent_point not in POINTS[1:]:
                raise ValueError(f"link {link.name}: parent_point {link.parent_point!r} is none of {POINTS[1:]}")
        return links

    def _read_segments(self, laws: dict[str, Law]) -> None:
        """Choose the lengths that are coordinates; the last upper segment is one only if a mass hangs on it."""
        offset = 1 if self.kind == "ski" else 0
        self._segments: list[_Segment] = []
        self._segment_direction: list[int] = []
        loaded = {link.parent for link in self._links if link.parent_point == "tip"}
        names = {"pivot": [], "ski": ["x", "y", "phi0"], "free": ["x", "y", "z"]}[self.kind]
        for link in self._links:
            link.direction = link.number - 1 + offset
            names += [f"phi{link.number}", f"psi{link.number}"]
            for segment in (link.lower, link.upper):
                idle = segment is link.upper and link.tip_mass == 0.0 and link.name not in loaded
                if segment.motion == "prescribed" or (segment.motion == "free" and not idle):
                    self._segments.append(segment)
                    self._segment_direction.append(link.direction)
                    names.append(segment.name)
        self.names: tuple[str, ...] = tuple(names)
        self._rate_names = tuple(name + "_dot" for name in names)
        self._index = {name: i for i, name in enumerate(names)}
        prescribed = {segment.name for segment in self._segments if segment.motion == "prescribed"}
        if set(laws) != prescribed:
            raise ValueError(f"laws are needed for exactly {sorted(prescribed)}, given for {sorted(laws)}")
        self._laws = laws
        self._nd = len(self._links) + offset

    def _read_points(self) -> None:
        number_of = {segment.name: j for j, segment in enumerate(self._segments)}
        here = _Reach(np.zeros(self._nd), np.zeros(len(self._segments)))
        done: set[str] = set()
        while len(done) < len(self._links):
            ready = [k for k in self._links if k.name not in done and (k.parent == "base" or k.parent in done)]
            if not ready:
                raise ValueError(f"links form a loop: {[k.name for k in self._links if k.name not in done]}")
            for link in ready:
                hinge = here if link.parent == "base" else self._by_name[link.parent].points[link.parent_point]
                k, length = link.direction, float(link.rod.get("length", 0.0))

                def beyond(reach: _Reach, segment: _Segment, k: int = k) -> _Reach:
                    j = number_of.get(segment.name)
                    return reach.along(k, 0.0 if j is not None else segment.length, j)

                start = beyond(hinge, link.lower)
                end = start.along(k, length)
                link.points = {"hinge": hinge, "rod_start": start, "rod_end": end, "tip": beyond(end, link.upper)}
                done.add(link.name)
        self._here = here

    def _read_masses(self, base: Mapping[str, Any]) -> None:
        rows: list[tuple[float, float, _Reach]] = []  # mass, b, reach

        def spin(k: int, inertia: float) -> None:
            rows.append((inertia, 0.0, _Reach(np.zeros(self._nd), np.zeros(len(self._segments))).along(k, 1.0)))

        if self.kind == "ski":
            rows.append((float(base["mass"]), 1.0, self._here.along(0, float(base.get("com_offset", 0.0)))))
            spin(0, float(base["inertia"]))
        for link in self._links:
            k, start = link.direction, link.points["rod_start"]
            mass, length = float(link.rod.get("mass", 0.0)), float(link.rod.get("length", 0.0))
            if "com" in link.rod or "inertia" in link.rod:
                rows.append((mass, 1.0, start.along(k, float(link.rod.get("com", length / 2.0)))))
                spin(k, float(link.rod.get("inertia", mass * length**2 / 12.0)))
            else:
                for share, place in ((1.0, 0.0), (4.0, 0.5), (1.0, 1.0)):
                    rows.append((share * mass / 6.0, 1.0, start.along(k, place * length)))
            rows.append((link.tip_mass, 1.0, link.points["tip"]))
        rows = [row for row in rows if row[0] != 0.0]
        self._mass = np.array([row[0] for row in rows])
        self._root = np.sqrt(self._mass)
        self._b = np.array([row[1] for row in rows])
        self._s0 = np.array([row[2].s for row in rows]).reshape(len(rows), self._nd)
        self._sigma = np.array([row[2].sigma for row in rows]).reshape(len(rows), len(self._segments))
        self._one_hot = np.zeros((len(self._segments), self._nd))
        self._one_hot[np.arange(len(self._segments)), self._segment_direction] = 1.0

    def _read_constraints(self, scene: Mapping[str, Any]) -> None:
        texts = list(scene.get("constraints", []))
        if scene.get("plane"):
            if self.kind != "ski":
                raise ValueError('plane on this base: give constraints = ["phi1 = 0.3", ...] instead')
            texts += [f"phi{link.number} = phi0" for link in self._links]
        self._planes: dict[int, _Plane] = {}
        self._rows: list[_Row] = []
        number = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
        for text in texts:
            left, _, right = (side.strip() for side in text.partition("="))
            sign = 1.0
            if not re.fullmatch(r"phi[1-9]\d*", left):
                left, right, sign = right, left, -1.0
            link = re.fullmatch(r"phi([1-9]\d*)", left)
            if link and (right == "phi0" or re.fullmatch(number, right)):
                k = int(link[1]) - 1
                if k >= len(self._links) or (right == "phi0" and self.kind != "ski"):
                    raise ValueError(f"constraint {text!r} names no coordinate of this scene")
                if k not in self._planes:
                    self._planes[k] = _Plane(text, None if right == "phi0" else float(right), sign)
            else:
                self._rows.append(self._general_row(text))

    def _general_row(self, text: str) -> _Row:
        """Differentiate an equation between the paper's coordinates, t and points such as legs.tip.z."""
        import sympy as sp

        q = sp.symbols(self.names)
        v = sp.symbols([name + "_dot" for name in self.names])
        t = sp.Symbol("t")
        known: dict[str, Any] = {str(symbol): symbol for symbol in (*q, t)}
        of = dict(zip(self.names, q, strict=True))
        d = {}
        if self.kind == "ski":
            d[0] = sp.Matrix([sp.cos(of["phi0"]), sp.sin(of["phi0"]), 0])
        for link in self._links:
            phi, psi = of[f"phi{link.number}"], of[f"psi{link.number}"]
            d[link.direction] = sp.Matrix([sp.cos(phi) * sp.cos(psi), sp.sin(phi) * sp.cos(psi), sp.sin(psi)])
        origin = sp.Matrix([of.get("x", 0), of.get("y", 0), of.get("z", 0)])

        def lengths(reach: _Reach, k: int) -> Any:
            total = sp.Float(reach.s[k])
            for j, segment in enumerate(self._segments):
                if self._segment_direction[j] == k:
                    total += int(reach.sigma[j]) * of[segment.name]
            return total

        def replace(match: re.Match[str]) -> str:
            link, axis = self._by_name[match[1]], match[3]
            if match[2] == "length":
                value = lengths(link.points["tip"], link.direction) - lengths(link.points["hinge"], link.direction)
            elif match[2] == "direction":
                value = d[link.direction]["xyz".index(axis)]
            else:
                reach = link.points[match[2]]
                value = (origin + sum((lengths(reach, k) * d[k] for k in d), sp.zeros(3, 1)))["xyz".index(axis)]
            known[f"point{len(known)}"] = value
            return f"point{len(known) - 1}"

        pattern = r"(\w+)\.(hinge|rod_start|rod_end|tip|direction|length)(?:\.([xyz]))?\b"
        left, _, right = re.sub(pattern, replace, text).partition("=")
        g = sp.sympify(left, locals=known) - sp.sympify(right, locals=known)
        stray = {str(symbol) for symbol in g.free_symbols} - {str(symbol) for symbol in (*q, t)}
        if stray:
            raise ValueError(f"constraint {text!r} names {sorted(stray)}, which this scene has not")
        rate = sp.diff(g, t) + sum(sp.diff(g, a) * b for a, b in zip(q, v, strict=True))
        drift = sp.diff(rate, t) + sum(sp.diff(rate, a) * b for a, b in zip(q, v, strict=True))
        function = sp.lambdify([t, *q, *v], [g, rate, drift, *(sp.diff(g, a) for a in q)], "math", cse=True)
        return _Row(text, function)

    def _layout(self) -> None:
        offset = self._nd - len(self._links)
        self._free = np.array([k + offset for k in range(len(self._links)) if k not in self._planes], dtype=int)
        self._planar = [k + offset for k in range(len(self._links)) if k in self._planes]
        self._free_xi = [j for j, segment in enumerate(self._segments) if segment.motion == "free"]
        self._law_xi = [j for j, segment in enumerate(self._segments) if segment.motion == "prescribed"]
        nf, npl, nx = len(self._free), len(self._planar), len(self._free_xi)
        nb, mb = {"pivot": (0, 0), "ski": (3, 2), "free": (3, 3)}[self.kind]
        self._mb = mb
        self._position = (nb, nb + 3 * nf, nb + 3 * nf + npl, nb + 3 * nf + npl + nx)
        self._velocity = (mb, mb + 3 * nf, mb + 3 * nf + npl, mb + 3 * nf + npl + nx)
        self._columns = (mb, mb + 2 * nf, mb + 2 * nf + npl, mb + 2 * nf + npl + nx)
        self._size = self._position[-1]
        self._stiffness = np.array([segment.stiffness for segment in self._segments])
        self._damping = np.array([segment.damping for segment in self._segments])
        self._rest = np.array([segment.rest for segment in self._segments])
        self._xi_names = [segment.name for segment in self._segments]
        self._xi_at = np.array([self._index[name] for name in self._xi_names], dtype=int)
        self._base_at = np.array([self._index[name] for name in ("x", "y", "z") if name in self._index], dtype=int)
        self._phi_at = [self._index[f"phi{link.number}"] for link in self._links]
        self._free_reach = self._sigma[:, self._free_xi][:, None, :]  # (P, 1, nx)
        self._free_reach_direction = [self._segment_direction[j] for j in self._free_xi]
        aliases = {name: name for name in self.names}
        for name in self.names:
            aliases[("F" + name[2:]) if name.startswith("xi") else f"M_{name}"] = name
        self._aliases = aliases

    # ------------------------------------------------------------------------------------------------------- mechanics

    def _kinematics(self, t: float, y: Array) -> _Kinematics:
        p1, p2, p3, p4 = self._position
        position, velocity = y[:p4], y[p4:]
        v1, v2, v3, _ = self._velocity
        c1, c2, _, c4 = self._columns
        nd = self._nd
        d, d_rate, d_bias = np.empty((nd, 3)), np.empty((nd, 3)), np.empty((nd, 3))
        jacobian = np.zeros((nd, 3, c4))

        base, base_rate, base_bias = np.zeros(3), np.zeros(3), np.zeros(3)
        heading, left = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
        speed = yaw = yaw_rate = 0.0
        if self.kind == "ski":
            yaw, speed, yaw_rate = float(position[2]), float(velocity[0]), float(velocity[1])
            cos, sin = math.cos(yaw), math.sin(yaw)
            heading, left = np.array([cos, sin, 0.0]), np.array([-sin, cos, 0.0])
            base[:2] = position[:2]
            base_rate, base_bias = speed * heading, speed * yaw_rate * left
            d[0], d_rate[0], d_bias[0] = heading, yaw_rate * left, -(yaw_rate**2) * heading
            jacobian[0, :, 1] = left
        elif self.kind == "free":
            base, base_rate = position[:3], velocity[:3]

        norms = radial = tilt = tilt_rate = np.empty(0)
        if p2 > p1:
            raw, raw_rate = position[p1:p2].reshape(-1, 3), velocity[v1:v2].reshape(-1, 3)
            norms = np.sqrt(np.einsum("ij,ij->i", raw, raw))
            unit = raw / norms[:, None]
            radial = np.einsum("ij,ij->i", unit, raw_rate)
            tangent = raw_rate - radial[:, None] * unit
            d[self._free], d_rate[self._free] = unit, tangent
            d_bias[self._free] = -np.einsum("ij,ij->i", tangent, tangent)[:, None] * unit
            for i, k in enumerate(self._free):
                (x, y_, z), c = unit[i].tolist(), c1 + 2 * i  # an orthonormal pair normal to d, without a pole
                sign = math.copysign(1.0, z)
                a = -1.0 / (sign + z)
                jacobian[k, :, c] = (1.0 + sign * x * x * a, sign * x * y_ * a, -sign * x)
                jacobian[k, :, c + 1] = (x * y_ * a, sign + y_ * y_ * a, -y_)
        if p3 > p2:
            tilt, tilt_rate = position[p2:p3], velocity[v2:v3]
            for i, k in enumerate(self._planar):
                azimuth = self._planes[k - nd + len(self._links)].azimuth
                along, aside, turn = heading, left, yaw_rate
                if azimuth is not None:
                    along = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
                    aside, turn = np.array([-along[1], along[0], 0.0]), 0.0
                cos, sin, rate = math.cos(tilt[i]), math.sin(tilt[i]), tilt_rate[i]
                up = np.array([0.0, 0.0, 1.0])
                d[k] = cos * along + sin * up
                jacobian[k, :, c2 + i] = cos * up - sin * along
                d_rate[k] = rate * jacobian[k, :, c2 + i] + turn * cos * aside
                d_bias[k] = -(rate**2) * d[k] - 2.0 * rate * turn * sin * aside - turn**2 * cos * along
                if azimuth is None:
                    jacobian[k, :, 1] = cos * aside

        nx = len(self._segments)
        xi, xi_rate, xi_bias = np.empty(nx), np.empty(nx), np.zeros(nx)
        xi[self._free_xi], xi_rate[self._free_xi] = position[p3:], velocity[v3:]
        for j in self._law_xi:
            xi[j], xi_rate[j], xi_bias[j] = self._laws[self._xi_names[j]](t)
        s = self._s0 + (self._sigma * xi) @ self._one_hot
        s_rate = (self._sigma * xi_rate) @ self._one_hot
        return _Kinematics(
            t, base, base_rate, base_bias, heading, left, speed, yaw, yaw_rate, norms, radial, tilt, tilt_rate,
            d, d_rate, d_bias, jacobian, xi, xi_rate, xi_bias, s, s_rate,
        )  # fmt: skip

    def _angles(self, kin: _Kinematics, reference: Array) -> tuple[Array, Array]:
        """Read (phi, psi) and their rates on the branch nearest to the reference, (n, 2) each."""
        n, offset = len(self._links), self._nd - len(self._links)
        angles, rates = np.empty((n, 2)), np.empty((n, 2))
        planar = 0
        for i in range(n):
            k = i + offset
            plane = self._planes.get(i)
            if plane is not None:
                azimuth, turn = (kin.yaw, kin.yaw_rate) if plane.azimuth is None else (plane.azimuth, 0.0)
                angles[i] = _nearest(azimuth, float(reference[i, 0])), kin.tilt[planar]
                rates[i] = turn, kin.tilt_rate[planar]
                planar += 1
                continue
            (x, y, z), (u, v, w) = kin.d[k].tolist(), kin.d_rate[k].tolist()
            phi0, psi0 = reference[i].tolist()
            cos = math.hypot(x, y)
            if cos < 1e-300:
                angles[i], rates[i] = (phi0, _nearest(math.atan2(z, 0.0), psi0)), (0.0, 0.0)
                rates[i, 1] = -math.copysign(1.0, z) * (u * math.cos(phi0) + v * math.sin(phi0))
                continue
            phi, psi = math.atan2(y, x), math.atan2(z, cos)
            first = _nearest(phi, phi0), _nearest(psi, psi0)
            second = _nearest(phi + math.pi, phi0), _nearest(math.pi - psi, psi0)
            if math.dist(second, (phi0, psi0)) < math.dist(first, (phi0, psi0)):
                cos, first = -cos, second
            ca, sa = x / cos, y / cos
            angles[i] = first
            rates[i] = (ca * v - sa * u) / cos if abs(cos) > POLE else 0.0, cos * w - z * (ca * u + sa * v)
        return angles, rates

    def _named(self, kin: _Kinematics, reference: Array) -> tuple[dict[str, float], Rates, Array, Array]:
        angles, rates = self._angles(kin, reference)
        values = np.empty((2, len(self.names)))
        for i, at in enumerate(self._base_at):
            values[:, at] = kin.base[i], kin.base_rate[i]
        if self.kind == "ski":
            values[:, 2] = kin.yaw, kin.yaw_rate
        for i, at in enumerate(self._phi_at):
            values[0, at : at + 2], values[1, at : at + 2] = angles[i], rates[i]
        values[:, self._xi_at] = kin.xi, kin.xi_rate
        q = dict(zip(self.names, values[0].tolist(), strict=True))
        v = Rates(zip(self._rate_names, values[1].tolist(), strict=True))
        if self.kind == "ski":
            v["speed"] = kin.speed
        return q, v, angles, rates

    def _frames(self, kin: _Kinematics, angles: Array) -> tuple[Array, Array, Array]:
        """Return u_phi (n, 3), e_psi (n, 3), cos psi (n,) on the branch of the angles."""
        n = len(self._links)
        d = kin.d[self._nd - n :]
        cos_phi, sin_phi = np.cos(angles[:, 0]), np.sin(angles[:, 0])
        cos_psi = np.hypot(d[:, 0], d[:, 1]) * np.where(np.cos(angles[:, 1]) < 0.0, -1.0, 1.0)
        zero = np.zeros(n)
        u_phi = np.stack([-sin_phi, cos_phi, zero], axis=1)
        e_psi = np.stack([-d[:, 2] * cos_phi, -d[:, 2] * sin_phi, cos_psi], axis=1)
        return u_phi, e_psi, cos_psi

    def _spread(
        self, q: Array, angles: Array | None, kin: _Kinematics, given: Mapping[str, Any]
    ) -> tuple[Array, Array, float, Array]:
        """Turn generalized forces of the paper's coordinates into forces on base, directions, yaw and segments."""
        n, offset = len(self._links), self._nd - len(self._links)
        on_base, on_d, on_yaw = np.zeros(3), np.zeros((self._nd, 3)), 0.0
        on_base[: len(self._base_at)] = q[self._base_at]
        if self.kind == "ski":
            on_yaw = float(q[2])
        if n and angles is not None:
            u_phi, e_psi, cos_psi = self._frames(kin, angles)
            for i, at in enumerate(self._phi_at):
                moment, lift = q[at], q[at + 1]
                if moment != 0.0:
                    if abs(cos_psi[i]) < POLE:
                        raise ValueError(f"M_phi{i + 1} at the pole of link {self._links[i].name}: no such moment")
                    on_d[i + offset] += moment / cos_psi[i] * u_phi[i]
                on_d[i + offset] += lift * e_psi[i]
        for key, value in given.items():
            link = self._by_name[key.split("_", 1)[1]]
            vector = np.asarray(value, dtype=float)
            if key.startswith("direction_"):
                on_d[link.direction] += vector
                continue
            on_d[link.direction] += np.cross(vector, kin.d[link.direction])
            if link.parent != "base":
                parent = self._by_name[link.parent].direction
                on_d[parent] -= np.cross(vector, kin.d[parent])
            elif self.kind == "ski":
                on_yaw -= float(vector[2])
        return on_base, on_d, on_yaw, q[self._xi_at]

    def _split(self, forces: Mapping[str, Any] | None) -> tuple[Array, dict[str, Any]]:
        """Sort forces into those of coordinates and vectors on links (`T_legs`, `direction_legs`)."""
        q, vectors = np.zeros(len(self.names)), {}
        for key, value in (forces or {}).items():
            name = self._aliases.get(key)
            if name is not None:
                q[self._index[name]] += float(value)
                if name in self._laws:
                    raise ValueError(f"a force on {name}, whose motion is prescribed")
            elif re.match(r"(T|direction)_", key) and key.split("_", 1)[1] in self._by_name:
                vectors[key] = value
            else:
                raise ValueError(f"no coordinate for force {key!r}; there are {', '.join(self._aliases)}")
        return q, vectors

    def _reduce(self, kin: _Kinematics, on: tuple[Array, Array, float, Array]) -> Array:
        """Virtual work of forces on base, directions, yaw and segments in the free velocities u."""
        on_base, on_d, on_yaw, on_xi = on
        c1, _, c3, c4 = self._columns
        force = np.zeros(c4)
        if self._nd:
            force += on_d.reshape(-1) @ kin.d_jacobian.reshape(-1, c4)
        if self.kind == "ski":
            force[0] += on_base @ kin.heading
            force[1] += on_yaw
        else:
            force[:c1] += on_base[:c1]
        force[c3:] += on_xi[self._free_xi]
        return force

    def _solve(self, t: float, y: Array, reference: Array, force: Force | None, full: bool) -> Array | Instant:
        kin = self._kinematics(t, y)
        _, _, c3, c4 = self._columns
        count, nd = len(self._mass), self._nd
        jacobian = (kin.s @ kin.d_jacobian.reshape(nd, 3 * c4)).reshape(count, 3, c4)
        if self.kind == "ski":
            jacobian[:, :, 0] += self._b[:, None] * kin.heading
        elif self.kind == "free":
            jacobian[:, :, :3] += self._b[:, None, None] * np.eye(3)
        if c4 > c3:
            jacobian[:, :, c3:] += self._free_reach * kin.d[self._free_reach_direction].T
        bias = 2.0 * kin.s_rate @ kin.d_rate + kin.s @ kin.d_bias + self._b[:, None] * (kin.base_bias - self.gravity)
        if self._law_xi:
            bias += ((self._sigma * kin.xi_bias) @ self._one_hot) @ kin.d
        weighted = (self._root[:, None, None] * jacobian).reshape(3 * count, c4)
        matrix = weighted.T @ weighted
        if full:
            self._check_rank(matrix)
        load = -(weighted.T @ (self._root[:, None] * bias).reshape(-1))

        springs = -self._stiffness * (kin.xi - self._rest) - self._damping * kin.xi_rate
        load[c3:] += springs[self._free_xi]
        angles = rates = None
        named: dict[str, float] = {}
        on: tuple[Array, Array, float, Array] | None = None
        if force is not None or self._rows or full:
            named, named_rates, angles, rates = self._named(kin, reference)
        if force is not None:
            q, vectors = self._split(force(t, named, named_rates))
            on = self._spread(q, angles, kin, vectors)
            load += self._reduce(kin, on)

        multipliers: list[tuple[_Row, float, Array]] = []
        if self._rows:
            assert angles is not None
            assert rates is not None
            maps, tails = self._chart(kin, angles, rates)
            values = [row.function(t, *named.values(), *(named_rates[k] for k in self.names)) for row in self._rows]
            gradients = np.array([value[3:] for value in values], dtype=float)
            rows = gradients @ maps
            wanted = [
                -value[2] - 2.0 * STABILISATION * value[1] - STABILISATION**2 * value[0] - gradient @ tails
                for value, gradient in zip(values, gradients, strict=True)
            ]
            m = len(rows)
            block = np.block([[matrix, -rows.T], [rows, np.zeros((m, m))]])
            answer = np.linalg.solve(block, np.concatenate([load, wanted]))
            rate_of_u = answer[:c4]
            multipliers = list(zip(self._rows, answer[c4:].tolist(), gradients, strict=True))
        else:
            rate_of_u = np.linalg.solve(matrix, load) if c4 else np.empty(0)

        derivative = self._derivative(kin, y, rate_of_u)
        if not full:
            return derivative
        assert angles is not None
        assert rates is not None
        absolute = jacobian @ rate_of_u + bias  # accelerations less gravity, (P, 3)
        return self._instant(kin, angles, rates, rate_of_u, absolute, springs, on, multipliers, derivative)

    @staticmethod
    def _check_rank(matrix: Array) -> None:
        scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        if len(matrix) and np.linalg.cond(matrix * scale * scale[:, None]) > 1e13:
            raise np.linalg.LinAlgError("mass matrix is singular: some motion moves no mass")

    def _derivative(self, kin: _Kinematics, y: Array, rate_of_u: Array) -> Array:
        p1, p2, _, p4 = self._position
        v1, v2, _, _ = self._velocity
        c1, c2, _, _ = self._columns
        out = np.empty_like(y)
        velocity, rate = y[p4:], out[p4:]
        if self.kind == "ski":
            out[0], out[1], out[2] = kin.base_rate[0], kin.base_rate[1], kin.yaw_rate
        elif self.kind == "free":
            out[:3] = velocity[:3]
        rate[:v1] = rate_of_u[:c1]
        if p2 > p1:
            tangent = kin.d_rate[self._free]
            second = (kin.d_jacobian[self._free] @ rate_of_u) + kin.d_bias[self._free]
            out[p1:p2] = (kin.norms[:, None] * tangent).reshape(-1)
            rate[v1:v2] = (second + kin.radial[:, None] * tangent).reshape(-1)
        out[p2:p4] = velocity[v2:]
        rate[v2:] = rate_of_u[c2:]
        return out

    def _chart(self, kin: _Kinematics, angles: Array, rates: Array) -> tuple[Array, Array]:
        """Return the matrix A and the vector b with (accelerations of the paper's coordinates) = A udot + b."""
        c4, c3 = self._columns[3], self._columns[2]
        maps, tails = np.zeros((len(self.names), c4)), np.zeros(len(self.names))
        if self.kind == "ski":
            maps[:2, 0], maps[2, 1], tails[:2] = kin.heading[:2], 1.0, kin.base_bias[:2]
        elif self.kind == "free":
            maps[:3, :3] = np.eye(3)
        if self._links:
            u_phi, e_psi, cos_psi = self._frames(kin, angles)
        for i, at in enumerate(self._phi_at):
            k = i + self._nd - len(self._links)
            sin, cos, (phi_rate, psi_rate) = kin.d[k, 2], cos_psi[i], rates[i]
            plane = self._planes.get(i)
            if plane is not None:
                if plane.azimuth is None:
                    maps[at, 1] = 1.0
            elif abs(cos) > POLE:
                maps[at] = u_phi[i] @ kin.d_jacobian[k] / cos
                tails[at] = (u_phi[i] @ kin.d_bias[k] + 2.0 * sin * phi_rate * psi_rate) / cos
            maps[at + 1] = e_psi[i] @ kin.d_jacobian[k]
            tails[at + 1] = e_psi[i] @ kin.d_bias[k] - sin * cos * phi_rate**2
        maps[self._xi_at[self._free_xi], np.arange(c3, c4)] = 1.0
        tails[self._xi_at] += kin.xi_bias
        return maps, tails

    def _instant(
        self,
        kin: _Kinematics,
        angles: Array,
        rates: Array,
        rate_of_u: Array,
        absolute: Array,
        springs: Array,
        on: tuple[Array, Array, float, Array] | None,
        multipliers: list[tuple[_Row, float, Array]],
        derivative: Array,
    ) -> Instant:
        maps, tails = self._chart(kin, angles, rates)
        accelerations = dict(zip(self.names, (maps @ rate_of_u + tails).tolist(), strict=True))
        inertial = self._mass[:, None] * absolute  # m (a - g)
        on_base, on_d = np.zeros(3), np.zeros((self._nd, 3))
        on_xi = springs.copy()
        known = [on] if on is not None else []
        known += [self._spread(value * gradient, angles, kin, {}) for _, value, gradient in multipliers]
        for base, directions, _, xi in known:
            on_base, on_d, on_xi = on_base + base, on_d + directions, on_xi + xi
        edge = float(kin.left @ (self._b @ inertial - on_base)) if self.kind == "ski" else 0.0
        moment = kin.s.T @ inertial - on_d  # what is missing on each direction
        reactions = {row.text: value for row, value, _ in multipliers}
        for i, plane in self._planes.items():
            aside = kin.left
            if plane.azimuth is not None:
                aside = np.array([-math.sin(plane.azimuth), math.cos(plane.azimuth), 0.0])
            cos = math.cos(angles[i, 1])
            reactions[plane.text] = plane.sign * cos * float(aside @ moment[i + self._nd - len(self._links)])
        servo = {
            self._xi_names[j]: float((self._sigma[:, j] @ inertial) @ kin.d[self._segment_direction[j]] - on_xi[j])
            for j in self._law_xi
        }
        return Instant(accelerations, edge, servo, reactions, derivative)

    # ----------------------------------------------------------------------------------------------------- state, time

    def _pack(
        self, t: float, coordinates: Mapping[str, float] | None, rates: Mapping[str, float] | None
    ) -> tuple[Array, Array]:
        """Return the state and the angles (n, 2) that later readings stay near."""
        given = {**self._start, **(coordinates or {})}
        speeds: dict[str, float] = {}
        for key in list(given):
            if key == "speed" or key.endswith("_dot"):
                speeds[key] = float(given.pop(key))
        if rates and {"x", "y", "x_dot", "y_dot"} & set(rates):
            speeds.pop("speed", None)
        if rates and "speed" in rates:
            speeds = {key: value for key, value in speeds.items() if key not in ("x_dot", "y_dot")}
        for key, value in (rates or {}).items():
            speeds[key if key == "speed" or key.endswith("_dot") else key + "_dot"] = float(value)
        unknown = (set(given) - set(self.names)) | (set(speeds) - {n + "_dot" for n in self.names} - {"speed"})
        if unknown or ("speed" in speeds and self.kind != "ski"):
            raise ValueError(f"unknown in the start: {sorted(unknown) or ['speed']}; names: {', '.join(self.names)}")

        def rate(name: str, default: float = 0.0) -> float:
            return speeds.get(name + "_dot", default)

        position: list[float] = []
        velocity: list[float] = []
        yaw, turn = given.get("phi0", 0.0), rate("phi0")
        if self.kind == "free":
            position += [given.get(name, 0.0) for name in "xyz"]
            velocity += [rate(name) for name in "xyz"]
        elif self.kind == "ski":
            cos, sin = math.cos(yaw), math.sin(yaw)
            along = rate("x") * cos + rate("y") * sin
            across = rate("y") * cos - rate("x") * sin
            speed = speeds.get("speed", along)
            moving = "x_dot" in speeds or "y_dot" in speeds
            if abs(across) > 1e-9 or (moving and abs(speed - along) > 1e-9):
                raise ValueError(
                    f"start: sideways speed {across:.3g} m/s at the knife edge, or speed and x_dot disagree"
                )
            position += [given.get("x", 0.0), given.get("y", 0.0), yaw]
            velocity += [speed, turn]
        directions: list[list[float]] = [[], []]
        tilts: list[list[float]] = [[], []]
        reference = np.empty((len(self._links), 2))
        for i, link in enumerate(self._links):
            phi_name, psi_name = f"phi{link.number}", f"psi{link.number}"
            plane = self._planes.get(i)
            azimuth, spin = (0.0, 0.0) if plane is None else (yaw, turn)
            if plane is not None and plane.azimuth is not None:
                azimuth, spin = plane.azimuth, 0.0
            phi, psi = given.get(phi_name, azimuth), given.get(psi_name, math.pi / 2.0)
            phi_rate, psi_rate = rate(phi_name, spin), rate(psi_name)
            reference[i] = phi, psi
            if plane is not None:
                if abs(_nearest(phi, azimuth) - azimuth) > 1e-9 or abs(phi_rate - spin) > 1e-9:
                    raise ValueError(f"start: {plane.text} does not hold: {phi} {phi_rate} / {azimuth} {spin}")
                tilts[0].append(psi)
                tilts[1].append(psi_rate)
                continue
            d = direction(phi, psi)
            directions[0] += d.tolist()
            e_phi = np.array([-d[1], d[0], 0.0])
            e_psi = np.array([-math.cos(phi) * d[2], -math.sin(phi) * d[2], math.cos(psi)])
            directions[1] += (phi_rate * e_phi + psi_rate * e_psi).tolist()
        position += directions[0] + tilts[0]
        velocity += directions[1] + tilts[1]
        for segment in self._segments:
            name = segment.name
            if segment.motion == "free":
                position.append(given.get(name, segment.length))
                velocity.append(rate(name))
                continue
            value, slope, _ = self._laws[name](t)
            if abs(given.get(name, value) - value) > 1e-9 or abs(rate(name, slope) - slope) > 1e-9:
                raise ValueError(f"start: {name} is prescribed, {value} m and {slope} m/s at t = {t}")
        y = np.array(position + velocity)
        if self._rows:
            q, v, _, _ = self._named(self._kinematics(t, y), reference)
            for row in self._rows:
                residual = row.function(t, *q.values(), *(v[name] for name in self.names))
                if max(abs(residual[0]), abs(residual[1])) > 1e-9:
                    raise ValueError(f"start: {row.text} does not hold: {residual[0]:.3g}, rate {residual[1]:.3g}")
        return y, reference

    def instant(
        self,
        coordinates: Mapping[str, float] | None = None,
        rates: Mapping[str, float] | None = None,
        force: Force | Mapping[str, Any] | None = None,
        t: float = 0.0,
    ) -> Instant:
        """Accelerations, edge force, prescribed forces and reactions at one state.

        Parameters
        ----------
        coordinates, rates : by name; what is left out is the scene's start, then phi 0, psi pi/2, the segment's length.
        force : generalized forces by name, or the callable that `simulate` takes.
        t : time [s], for prescribed segments.
        """
        y, reference = self._pack(t, coordinates, rates)
        law = force if force is None or callable(force) else (lambda *_: force)
        answer = self._solve(t, y, reference, law, True)
        assert isinstance(answer, Instant)
        return answer

    def accelerations(
        self,
        coordinates: Mapping[str, float] | None = None,
        rates: Mapping[str, float] | None = None,
        force: Force | Mapping[str, Any] | None = None,
        t: float = 0.0,
    ) -> dict[str, float]:
        """Second derivatives of the paper's coordinates by name, at one state (see `instant`)."""
        return self.instant(coordinates, rates, force, t).accelerations

    def equations(self, coordinates: Mapping[str, float], rates: Mapping[str, float]) -> tuple[Array, Array]:
        """Return mass matrix (N, N) and bias (N,) of the paper's coordinates, before any constraint.

        M qddot + bias = generalized forces, in the order of `names`; prescribed segments are coordinates like any
        other; bias holds velocity products and gravity, no springs.
        """
        q = np.array([coordinates[name] for name in self.names])
        v = np.array([rates[name if name in rates else name + "_dot"] for name in self.names])
        nd, total, count = self._nd, len(self.names), len(self._mass)
        d, rate, bias = np.empty((nd, 3)), np.empty((nd, 3)), np.empty((nd, 3))
        partial = np.zeros((nd, 3, total))
        if self.kind == "ski":
            d[0], partial[0, :, 2] = direction(q[2], 0.0), direction(q[2] + math.pi / 2.0, 0.0)
            rate[0], bias[0] = v[2] * partial[0, :, 2], -(v[2] ** 2) * d[0]
        for link, at in zip(self._links, self._phi_at, strict=True):
            k, (phi, psi), (a, b) = link.direction, q[at : at + 2], v[at : at + 2]
            d[k] = direction(phi, psi)
            u_phi = np.array([-math.sin(phi), math.cos(phi), 0.0])
            partial[k, :, at] = math.cos(psi) * u_phi
            partial[k, :, at + 1] = direction(phi, psi + math.pi / 2.0)
            rate[k] = partial[k] @ v
            flat = np.array([d[k, 0], d[k, 1], 0.0])
            bias[k] = -(a**2) * flat - 2.0 * a * b * math.sin(psi) * u_phi - b**2 * d[k]
        xi, xi_rate = q[self._xi_at], v[self._xi_at]
        s = self._s0 + (self._sigma * xi) @ self._one_hot
        jacobian = (s @ partial.reshape(nd, 3 * total)).reshape(count, 3, total)
        for c, at in enumerate(self._base_at):
            jacobian[:, c, at] += self._b
        for j, at in enumerate(self._xi_at):
            jacobian[:, :, at] += self._sigma[:, j, None] * d[self._segment_direction[j]]
        tail = 2.0 * ((self._sigma * xi_rate) @ self._one_hot) @ rate + s @ bias - self._b[:, None] * self.gravity
        weighted = (self._mass[:, None, None] * jacobian).reshape(3 * count, total)
        return weighted.T @ jacobian.reshape(3 * count, total), weighted.T @ tail.reshape(-1)

    def simulate(
        self,
        t_eval: Iterable[float],
        coordinates: Mapping[str, float] | None = None,
        rates: Mapping[str, float] | None = None,
        force: Force | None = None,
        rtol: float = 1e-12,
        atol: float = 1e-13,
        t_start: float = 0.0,
        breaks: Sequence[float] = (),
        max_step: float = math.inf,
    ) -> Result:
        """Integrate from t_start by DOP853; samples are Runge-Kutta steps of their own, not interpolations.

        Parameters
        ----------
        t_eval : times [s], increasing, none before t_start.
        coordinates, rates : the start by name, as in `instant`; a ski takes `speed` too.
        force : callable (t, coordinates, rates) -> generalized forces by name ("phi1" or "M_phi1", "xi1_1" or "F1_1",
            "x", ...), hinge torques {"T_legs": vector} (minus it on the parent) or forces conjugate to a direction
            {"direction_legs": vector}; or None.
        breaks : times at which a law or a force has a kink: steps end there.

        Raises
        ------
        ValueError : impossible start or unknown name. numpy.linalg.LinAlgError : a motion that moves no mass.
        RuntimeError : the step size fell to nothing.
        """
        times = np.array(list(t_eval), dtype=float)
        if len(times) == 0 or np.any(np.diff(times) <= 0.0) or times[0] < t_start:
            raise ValueError("t_eval must increase and start no earlier than t_start")
        if self._texts_of_forces and force is None:
            raise ValueError("the scene has forces or a programme: give them as the callable force")
        y, reference = self._pack(t_start, coordinates, rates)
        start = reference
        self._solve(t_start, y, reference, force, True)  # names a singular start

        def right_side(t: float, state: Array) -> Array:
            answer = self._solve(t, state, reference, force, False)
            assert isinstance(answer, np.ndarray)
            return answer

        states: list[Array] = []
        references: list[Array] = []
        if times[0] == t_start:
            states.append(y)
            references.append(start)
        evaluations, steps, t = 0, 0, t_start
        for bound in sorted({float(b) for b in breaks if t_start < b < times[-1]} | {float(times[-1])}):
            if bound <= t:
                continue
            solver = DOP853(right_side, t, y, bound, rtol=rtol, atol=atol, max_step=max_step)
            while solver.status == "running":
                before, old = solver.t, solver.y
                message = solver.step()
                if solver.status == "failed":
                    raise RuntimeError(f"witness stopped at t = {solver.t}: {message}")
                steps += 1
                while len(states) < len(times) and times[len(states)] <= solver.t:
                    at = float(times[len(states)])
                    states.append(solver.y if at == solver.t else _one_step(right_side, before, old, at))
                    references.append(reference)
                reference, _ = self._angles(self._kinematics(solver.t, solver.y), reference)
            evaluations += solver.nfev
            t, y = bound, solver.y
        return Result(self, times, np.array(states), references, force, evaluations, steps)


def _one_step(function: Callable[[float, Array], Array], t: float, y: Array, end: float) -> Array:
    """One eighth-order step of DOP853 from t to end."""
    h, stages = end - t, DOP853.n_stages
    slopes = np.empty((stages, len(y)))
    slopes[0] = function(t, y)
    for i in range(1, stages):
        slopes[i] = function(t + DOP853.C[i] * h, y + h * (DOP853.A[i, :i] @ slopes[:i]))
    return np.asarray(y + h * (DOP853.B @ slopes))


class Result:
    """A run: arrays over `t` (N,).

    Attributes
    ----------
    coordinates, rates : by name, (N,); phi and psi continuous, through poles too. `rates["phi1"]` and
        `rates["phi1_dot"]` are the same; on a ski there is `rates["speed"]`.
    kinetic, gravity, spring, energy : (N,) [J].
    edge_force : (N,) [N], the snow's lateral force on the ski, positive to its left; 0 without a ski.
    prescribed_force : by coordinate name, (N,) [N], along the segment, beside its own spring and damper.
    constraint_force : by equation text, multiplier of (left side - right side).
    momentum, angular_momentum : (N, 3), the latter about the origin [kg m/s, kg m^2/s].
    center_of_mass : (N, 3).
    evaluations, steps : of the right side, and accepted.
    """

    def __init__(
        self,
        witness: Witness,
        t: Array,
        states: Array,
        references: list[Array],
        force: Force | None,
        evaluations: int,
        steps: int,
    ) -> None:
        self.t, self.evaluations, self.steps = t, evaluations, steps
        self._witness = witness
        self.states = states
        kins, instants, named, rates = [], [], [], []
        for time, y, reference in zip(t.tolist(), states, references, strict=True):
            kin = witness._kinematics(time, y)
            q, v, _, _ = witness._named(kin, reference)
            instant = witness._solve(time, y, reference, force, True)
            assert isinstance(instant, Instant)
            kins.append(kin)
            named.append(q)
            rates.append(v)
            instants.append(instant)

        def table(rows: Sequence[Mapping[str, float]]) -> dict[str, Array]:
            return {key: np.array([row[key] for row in rows]) for key in rows[0]}

        self.coordinates = table(named)
        self.rates = RateArrays(table(rates))
        self.accelerations = table([instant.accelerations for instant in instants])
        self.edge_force = np.array([instant.edge_force for instant in instants])
        self.prescribed_force = table([instant.prescribed_force for instant in instants])
        self.constraint_force = table([instant.constraint_force for instant in instants])

        self._d = np.array([kin.d for kin in kins])
        self._d_rate = np.array([kin.d_rate for kin in kins])
        self._xi = np.array([kin.xi for kin in kins])
        self._xi_rate = np.array([kin.xi_rate for kin in kins])
        self._base = np.array([kin.base for kin in kins])
        self._base_rate = np.array([kin.base_rate for kin in kins])
        s, s_rate = np.array([kin.s for kin in kins]), np.array([kin.s_rate for kin in kins])
        mass, b = witness._mass, witness._b
        r = s @ self._d + b[:, None] * self._base[:, None, :]
        v = s_rate @ self._d + s @ self._d_rate + b[:, None] * self._base_rate[:, None, :]
        weight = mass * b
        self.kinetic = 0.5 * np.einsum("p,tpc,tpc->t", mass, v, v)
        self.gravity = -np.einsum("p,tpc,c->t", weight, r, witness.gravity)
        self.spring = 0.5 * ((self._xi - witness._rest) ** 2 @ witness._stiffness)
        self.energy = self.kinetic + self.gravity + self.spring
        self.momentum = np.einsum("p,tpc->tc", weight, v)
        self.angular_momentum = np.einsum("p,tpc->tc", mass, np.cross(r, v))
        self.center_of_mass = np.einsum("p,tpc->tc", weight, r) / weight.sum()
        self.damping_power = -(self._xi_rate**2 @ witness._damping)

    def direction(self, link: str) -> Array:
        """Unit direction of a link, (N, 3)."""
        return self._d[:, self._witness._by_name[link].direction]

    def position(self, link: str, point: str = "tip") -> Array:
        """Position of hinge, rod_start, rod_end or tip of a link, or of "base", (N, 3) [m]."""
        return self._point(link, point)[0]

    def velocity(self, link: str, point: str = "tip") -> Array:
        """Velocity of the same points, (N, 3) [m/s]."""
        return self._point(link, point)[1]

    def _point(self, link: str, point: str) -> tuple[Array, Array]:
        witness = self._witness
        reach = witness._here if link == "base" else witness._by_name[link].points[point]
        s = reach.s + (reach.sigma * self._xi) @ witness._one_hot  # (N, nd)
        s_rate = (reach.sigma * self._xi_rate) @ witness._one_hot
        r = self._base + np.einsum("tk,tkc->tc", s, self._d)
        v = self._base_rate + np.einsum("tk,tkc->tc", s_rate, self._d) + np.einsum("tk,tkc->tc", s, self._d_rate)
        return r, v
