"""The equations of a tree of links by d'Alembert, all at once: Jacobians of masses, and a multiplier for every |d| = 1.

Nothing here is recursive in forces, and nothing is shared with the core but the meaning of its arrays. Works for floats and for
numbers of any precision. Every segment has a column, given ones too, so that the forces they take come out. Directions in the
frame of a ski have a second multiplier, which keeps them from going sideways.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vlmb.core import tree as t
from vlmb.core.tree import Tree


class Point(NamedTuple):
    """Place, velocity, Jacobian (3, columns) and acceleration without that of the unknowns."""

    place: Any
    velocity: Any
    jacobian: Any
    bias: Any


class Mass(NamedTuple):
    mass: Any
    point: Point


class Model(NamedTuple):
    """All masses, and rods by the columns of their directions."""

    masses: list[Mass]
    rods: list[tuple[Any, Point]]  # transverse inertia, and the direction as a point
    yaw: Any  # inertia of the ski about its centre
    directions: list[tuple[int, Any, Any]]  # first column of u, d, u, as the state has them
    columns: list[int]  # of the velocities
    given: Any  # (n, 2) columns of given segments, or -1


def solve(matrix: Any, right: Any) -> Any:
    """Solve with pivots, in the numbers of the matrix."""
    if matrix.dtype != object:
        return np.linalg.solve(matrix, right)
    rows, n = np.column_stack([matrix, right]), len(matrix)
    for k in range(n):
        best = k + int(np.argmax([abs(value) for value in rows[k:, k]]))
        rows[[k, best]] = rows[[best, k]]
        for i in range(k + 1, n):
            if rows[i, k] != 0:
                rows[i, k:] -= rows[i, k] / rows[k, k] * rows[k, k:]
    x = rows[:, -1].copy()
    for k in range(n - 1, -1, -1):
        x[k] = (x[k] - rows[k, k + 1 : n] @ x[k + 1 :]) / rows[k, k]
    return x


def square_root(x: Any) -> Any:
    return x**0.5


def model_of(tree: Tree, y: Any, given: Any) -> Model:
    """Build Jacobians at a state."""
    kind, positions, _, n, upright, _ = tree.shape
    zero = 0 * y[0]
    base_columns = {t.PIVOT: 0, t.FREE: 3, t.SKI: 2, t.SLIDING: 3, t.LIFTED: 4}[kind]
    width = base_columns + 5 * n

    def nothing() -> Any:
        return np.zeros((3, width), y.dtype) + zero

    def vector(*values: Any) -> Any:
        return np.array(values) + zero

    masses: list[Mass] = []
    v = y[positions:]
    origin, forward, left, up = vector(0, 0, 0), vector(0, 0, 0), vector(0, 0, 0), vector(0, 0, 1)
    velocity, jacobian, bias, yaw_rate, yaw_column = vector(0, 0, 0), nothing(), vector(0, 0, 0), zero, -1
    if kind == t.FREE:
        origin, velocity = y[:3], v[:3]
        jacobian[:, :3] = np.eye(3)
    elif kind != t.PIVOT:
        context = getattr(y[2], "context", np)
        forward = vector(context.cos(y[2]), context.sin(y[2]), 0)
        left = vector(-context.sin(y[2]), context.cos(y[2]), 0)
        yaw_column = 1 if kind == t.SKI else 2
        origin, yaw_rate = vector(y[0], y[1], y[3] if kind == t.LIFTED else 0), v[yaw_column]
        sideways = zero if kind == t.SKI else v[1]
        velocity = v[0] * forward + sideways * left
        bias = yaw_rate * (v[0] * left - sideways * forward)
        jacobian[:, 0] = forward
        if kind != t.SKI:
            jacobian[:, 1] = left
        if kind == t.LIFTED:
            velocity, jacobian[:, 3] = velocity + v[3] * up, up

    def carried(ahead: Any, aside: Any, high: Any) -> Point:
        """Point of the ski; of a base without a heading it is the base itself."""
        arm = ahead * forward + aside * left
        lift = high * up if yaw_column >= 0 else 0 * up
        moved = jacobian.copy()
        turned = ahead * left - aside * forward
        if yaw_column >= 0:
            moved[:, yaw_column] += turned
        return Point(origin + arm + lift, velocity + yaw_rate * turned, moved, bias - yaw_rate**2 * arm)

    if kind != t.PIVOT:
        masses.append(Mass(tree.base[t.BASE_MASS], carried(tree.base[t.COM_OFFSET], zero, zero)))
    rods, directions, columns, given_columns = [], [], list(range(base_columns)), np.full((n, 2), -1)
    origins, units = [], []
    for i in range(n):
        parent, place, at_p, at_v, lower_free, upper_free = tree.link[i, :6]
        real, c = tree.real[i], base_columns + 5 * i
        d, u = y[at_p : at_p + 3], v[at_v : at_v + 3]
        d = d / square_root(d @ d)
        u = u - (u @ d) * d
        directions.append((c, d, u))
        turning, drift = nothing(), vector(0, 0, 0)
        turning[:, c : c + 3] = np.eye(3)
        if upright:
            axes, quarter = np.column_stack([forward, left, up]), np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])
            turning[:, c : c + 3], turning[:, yaw_column] = axes, axes @ quarter @ d
            drift = axes @ (2 * yaw_rate * (quarter @ u) + yaw_rate**2 * (quarter @ quarter @ d))
            d, u = axes @ d, axes @ (u + yaw_rate * (quarter @ d))
        lengths, free = [], 0
        for side, is_free in enumerate((lower_free, upper_free)):
            if is_free:
                lengths.append((y[at_p + 3 + free], v[at_v + 3 + free], zero))
                free += 1
            else:
                lengths.append(tuple(given[i, 3 * side : 3 * side + 3]))
                given_columns[i, side] = c + 3 + side
        columns += [c, c + 1, c + 2] + [c + 3] * int(lower_free) + [c + 4] * int(upper_free)

        way = Point(d, u, turning, drift)

        def on_link(hinge: Point, r: Any, sides: int, c=c, way=way, lengths=lengths) -> Point:  # type: ignore[no-untyped-def]
            """Point at r beyond the lower segment (sides 1) or beyond both (2)."""
            far, rate, second = (sum(values[:sides]) for values in zip(*lengths, strict=True))
            d, u, turning, drift = way
            moved = hinge.jacobian + (far + r) * turning
            for side in range(sides):
                moved[:, c + 3 + side] += d
            bias = hinge.bias + second * d + 2 * rate * u + (far + r) * drift
            return Point(hinge.place + (far + r) * d, hinge.velocity + rate * d + (far + r) * u, moved, bias)

        if parent < 0:
            hinge = carried(*real[t.ANCHOR : t.ANCHOR + 3])
        elif place == t.TIP:
            hinge = units[parent]
        else:
            hinge = origins[parent](real[t.ON_ROD])
        origins.append(lambda s, hinge=hinge, on_link=on_link: on_link(hinge, s, 1))
        units.append(on_link(hinge, real[t.LENGTH], 2))
        masses += [Mass(real[t.MASS], on_link(hinge, real[t.CENTRE], 1)), Mass(real[t.TIP_MASS], units[i])]
        rods.append((real[t.INERTIA], way))
    return Model(masses, rods, (tree.base[t.BASE_INERTIA], yaw_column), directions, columns, given_columns)


def applied(tree: Tree, y: Any, force: Any) -> Any:
    """Generalized forces with those of springs and dampers, their parts along directions taken out."""
    positions = tree.shape[t.POSITIONS]
    total = force.copy()
    for link, real in zip(tree.link, tree.real, strict=True):
        p, v = link[t.AT_P], link[t.AT_V]
        d = y[p : p + 3] / square_root(y[p : p + 3] @ y[p : p + 3])
        total[v : v + 3] -= (total[v : v + 3] @ d) * d
        free = 0
        for side in range(2):
            if link[t.LOWER_FREE + side]:
                k, rest, c = real[t.K1 + 3 * side : t.K1 + 3 * side + 3]
                total[v + 3 + free] += k * (rest - y[p + 3 + free]) - c * y[positions + v + 3 + free]
                free += 1
    return total


def mass_matrix(model: Model, zero: Any) -> Any:
    """Mass matrix over all columns."""
    width = model.masses[0].point.jacobian.shape[1]
    matrix = np.zeros((width, width), np.asarray([zero]).dtype) + zero
    for mass, point in model.masses:
        matrix += mass * (point.jacobian.T @ point.jacobian)
    for inertia, way in model.rods:
        matrix += inertia * (way.jacobian.T @ way.jacobian)
    inertia, column = model.yaw
    if column >= 0:
        matrix[column, column] += inertia
    return matrix


def accelerations(tree: Tree, y: Any, given: Any, force: Any) -> tuple[Any, Any]:
    """Rates of the velocities (velocities,), u' being that of the true direction, and axial forces (n, 2) of given segments."""
    model = model_of(tree, y, given)
    zero = 0 * y[0]
    matrix, gravity = mass_matrix(model, zero), tree.base[t.GRAVITY :]
    load = sum(mass * (point.jacobian.T @ (point.bias - gravity)) for mass, point in model.masses)
    load = load + sum(inertia * (way.jacobian.T @ way.bias) for inertia, way in model.rods)
    columns, n, count = model.columns, len(model.directions), len(model.columns)
    held = n * (2 if tree.shape[t.UPRIGHT] else 1)
    whole = np.zeros((count + held, count + held), matrix.dtype) + zero
    right = np.zeros(count + held, matrix.dtype) + zero
    whole[:count, :count] = matrix[np.ix_(columns, columns)]
    right[:count] = applied(tree, y, force) - load[columns]
    for i, (c, d, u) in enumerate(model.directions):
        at = columns.index(c)
        whole[count + i, at : at + 3] = whole[at : at + 3, count + i] = d
        right[count + i] = -(u @ u)
        if held > n:
            whole[count + n + i, at + 1] = whole[at + 1, count + n + i] = 1
    found = solve(whole, right)[:count]
    everything = np.zeros(len(matrix), matrix.dtype) + zero
    everything[columns] = found
    taken = matrix @ everything + load
    axial = np.array([[taken[c] if c >= 0 else zero for c in pair] for pair in model.given])
    return found, axial


def rates(tree: Tree, y: Any, given: Any, force: Any) -> tuple[Any, Any]:
    """What `accelerate` is to write, and the axial forces of given segments."""
    kind, positions, velocities = tree.shape[:3]
    vdot, axial = accelerations(tree, y, given, force)
    out, v = 0 * y[: positions + velocities], y[positions:]
    out[positions:] = vdot
    if kind == t.FREE:
        out[:3] = v[:3]
    elif kind != t.PIVOT:
        context = getattr(y[2], "context", np)
        cosine, sine, sideways = context.cos(y[2]), context.sin(y[2]), 0 * y[0] if kind == t.SKI else v[1]
        out[:3] = v[0] * cosine - sideways * sine, v[0] * sine + sideways * cosine, v[1 if kind == t.SKI else 2]
        if kind == t.LIFTED:
            out[3] = v[3]
    for link in tree.link:
        p, at, free = link[t.AT_P], link[t.AT_V], link[t.LOWER_FREE] + link[t.UPPER_FREE]
        d, u = y[p : p + 3], v[at : at + 3]
        norm = square_root(d @ d)
        slip = (u @ d) / norm
        across = u - slip * d / norm
        out[p : p + 3] = norm * across
        out[p + 3 : p + 3 + free] = v[at + 3 : at + 3 + free]
        out[positions + at : positions + at + 3] += slip * across
    return out, axial


def energies(tree: Tree, y: Any, given: Any) -> tuple[Any, Any, Any]:
    """Kinetic energy, potential of gravity, energy of springs [J]."""
    model = model_of(tree, y, given)
    gravity = tree.base[t.GRAVITY :]
    kinetic = sum(mass * (point.velocity @ point.velocity) for mass, point in model.masses)
    kinetic += sum(inertia * (way.velocity @ way.velocity) for inertia, way in model.rods)
    inertia, column = model.yaw
    if column >= 0:
        kinetic += inertia * y[tree.shape[t.POSITIONS] + column] ** 2
    springs = 0 * y[0]
    for link, real in zip(tree.link, tree.real, strict=True):
        free = 0
        for side in range(2):
            if link[t.LOWER_FREE + side]:
                k, rest, _ = real[t.K1 + 3 * side : t.K1 + 3 * side + 3]
                springs += k * (y[link[t.AT_P] + 3 + free] - rest) ** 2
                free += 1
    return kinetic / 2, -sum(mass * (gravity @ point.place) for mass, point in model.masses), springs / 2
