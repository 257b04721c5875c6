r"""The base: a fixed point, a free point mass, or a ski that carries the hinges of root links at anchors r in its frame.

The ski has the mass m, its centre at c ahead of the point A, the inertia I about its centre, axes forward and left, and turns
with phi'. A hinge at r moves with a_A + phi'' tau - phi'^2 r (horizontal part), tau = z x r, so that root links ask in sum for

    force      S0 a_A + S1 phi'' + f0,    S0 = sum A,        S1 = sum A tau,         f0 = sum (f - phi'^2 A r)
    yaw        S1 . a_A + S2 phi'' + f1,                     S2 = sum tau . A tau,   f1 = sum tau . (f - phi'^2 A r)

Where there is no heading the axes are zero, and so is tau. Accelerations are less gravity's. Links in upright planes along a ski
ask through their hinges for forces ahead and up alone; what they ask for sideways is in sideways.py. All vectors are then in the
frame of the ski.

A free base that a contact holds, planted, does as a fixed point does: its rows and columns are crossed out. What it asks for
beyond the forces on it, m a_A + S0 a_A + f0 - Q with a_A = -g, is the force of the ground.
"""

from __future__ import annotations

from vlmb.core import scratch as c
from vlmb.core.jit import cos, kernel, reciprocal, sin
from vlmb.core.segments import yaw_of
from vlmb.core.tree import (
    ANCHOR,
    BASE_INERTIA,
    BASE_KIND,
    BASE_MASS,
    COM_OFFSET,
    FREE,
    FREE_BASE,
    GRAVITY,
    LIFTED,
    LINKS,
    PARENT,
    PIVOT,
    PLANTED,
    POSITIONS,
    SKI,
    TINY,
    UPRIGHT,
    Array,
    Tree,
)
from vlmb.core.vectors import (
    Pair,
    Sym2,
    Sym3,
    Vector,
    add,
    add_scaled,
    adjugate2,
    determinant2,
    dot,
    gather_sym3,
    gather_vector,
    put,
    put_row,
    row_sym3,
    row_vector,
    scale,
    scale2,
    times,
    times2,
    vector,
)


@kernel(inline=True)
def face(tree: Tree, y: Array, rows: Array) -> None:
    """Read the heading, and how fast it turns."""
    n = tree.shape[LINKS]
    if tree.shape[BASE_KIND] >= SKI:
        cosine, sine, rate = cos(y[2]), sin(y[2]), yaw_of(tree, y)
        rows[n, c.COSINE], rows[n, c.SINE], rows[n, c.SPIN] = cosine, sine, rate * rate
        rows[n, c.AHEAD], rows[n, c.AHEAD + 1] = cosine, sine
        if tree.shape[UPRIGHT] != 0:
            rows[n, c.AHEAD], rows[n, c.AHEAD + 1] = 1.0 + 0.0 * cosine, 0.0 * sine


@kernel(inline=True)
def heading(tree: Tree, rows: Array) -> tuple[Vector, Vector]:
    """Find the horizontal axes of the ski, forward and left, in the frame of the directions."""
    n = tree.shape[LINKS]
    cosine, sine = rows[n, c.AHEAD], rows[n, c.AHEAD + 1]
    return Vector(cosine, sine, 0.0 * sine), Vector(-sine, cosine, 0.0 * sine)


@kernel(inline=True)
def arm(tree: Tree, rows: Array, i: int) -> tuple[Vector, Vector]:
    """Find the horizontal place of a root link's hinge, and tau = z x r."""
    forward, left = heading(tree, rows)
    ahead, aside = tree.real[i, ANCHOR], tree.real[i, ANCHOR + 1]
    return add_scaled(scale(ahead, forward), aside, left), add_scaled(scale(ahead, left), -aside, forward)


@kernel(inline=True)
def is_fixed(tree: Tree, i: int) -> bool:
    """Tell whether link i hangs on a fixed point: nobody asks what that feels."""
    return tree.link[i, PARENT] < 0 and tree.shape[BASE_KIND] == PIVOT


@kernel(inline=True)
def is_carried_round(tree: Tree, i: int) -> bool:
    """Tell whether the hinge of a root link moves as a ski turns: elsewhere r = tau = 0."""
    return tree.shape[BASE_KIND] >= SKI and (tree.real[i, ANCHOR] != 0.0 or tree.real[i, ANCHOR + 1] != 0.0)


@kernel(inline=True)
def hang_inertia(tree: Tree, rows: Array, i: int, inertia: Sym3) -> None:
    """Add the inertia that a root link shows to the base, and what it feels of the whirl of the ski."""
    n = tree.shape[LINKS]
    if tree.shape[UPRIGHT] != 0:
        inertia = in_plane(inertia)
    gather_sym3(rows, n, c.SUM, 1.0, inertia)
    if is_carried_round(tree, i):
        place, tau = arm(tree, rows, i)
        coupled, drawn = times(inertia, tau), scale(-rows[n, c.SPIN], times(inertia, place))
        gather_vector(rows, n, c.TURN_SUM, 1.0, coupled)
        gather_vector(rows, n, c.FORCE, 1.0, drawn)
        rows[n, c.TURN_SQUARE] += dot(tau, coupled)
        rows[n, c.TURN_FORCE] += dot(tau, drawn)


@kernel(inline=True)
def in_plane(m: Sym3) -> Sym3:
    """Leave out what a matrix has sideways."""
    zero = 0.0 * m.xx
    return Sym3(m.xx, zero, m.xz, zero, zero, m.zz)


@kernel(inline=True)
def hang_force(tree: Tree, rows: Array, loads: Array, i: int, force: Vector) -> None:
    """Add the force of a root link on a hinge at rest."""
    n = tree.shape[LINKS]
    gather_vector(loads, n, c.FORCE, 1.0, force)
    if is_carried_round(tree, i):
        _, tau = arm(tree, rows, i)
        loads[n, c.TURN_FORCE] += dot(tau, force)


@kernel(inline=True)
def hinge_of_root(tree: Tree, rows: Array, loads: Array, i: int) -> Vector:
    """Find the acceleration of a root link's hinge, less gravity's."""
    n = tree.shape[LINKS]
    found = row_vector(loads, n, c.POINT)
    if is_carried_round(tree, i):
        place, tau = arm(tree, rows, i)
        found = add_scaled(add_scaled(found, loads[n, c.YAW], tau), -loads[n, c.SPIN], place)
    if tree.shape[UPRIGHT] != 0:
        return Vector(found.x, 0.0 * found.y, found.z)  # sideways the plane has its own motion, see sideways.py
    return found


@kernel(inline=True)
def solve3(m: Sym3, f: Vector) -> tuple[bool, Vector]:
    """Solve M x = f by L D L'; returns whether M is positive definite, and x."""
    first = reciprocal(m.xx)
    below, last = first * m.xy, first * m.xz
    yy, yz, zz = m.yy - below * m.xy, m.yz - below * m.xz, m.zz - last * m.xz
    second = reciprocal(yy)
    corner = second * yz
    rest = zz - corner * yz
    third = reciprocal(rest)
    sound = m.xx > 0.0 and yy > TINY * m.yy and rest > TINY * m.zz
    two = f.y - below * f.x
    z = third * (f.z - last * f.x - corner * two)
    y = second * two - corner * z
    return sound, Vector(first * f.x - below * y - last * z, y, z)


@kernel(inline=True)
def solve2(m: Sym2, f: Pair) -> tuple[bool, Pair]:
    """Solve M x = f; returns whether M is positive definite, and x."""
    det = determinant2(m)
    return m.one > 0.0 and det > TINY * m.one * m.two, scale2(reciprocal(det), times2(adjugate2(m), f))


@kernel(inline=True)
def base_bias(tree: Tree, y: Array, rows: Array) -> Vector:
    """Find the acceleration of the base's point, less gravity's, when its velocities stay what they are."""
    point = scale(-1.0, vector(tree.base, GRAVITY))
    kind, first = tree.shape[BASE_KIND], tree.shape[POSITIONS]
    if kind >= SKI:
        forward, left = heading(tree, rows)
        if tree.shape[UPRIGHT] != 0:
            cosine, sine = rows[tree.shape[LINKS], c.COSINE], rows[tree.shape[LINKS], c.SINE]
            point = Vector(cosine * point.x + sine * point.y, cosine * point.y - sine * point.x, point.z)
        if kind == SKI:
            return add_scaled(point, y[first] * y[first + 1], left)
        point = add_scaled(point, y[first] * y[first + 2], left)
        return add_scaled(point, -y[first + 1] * y[first + 2], forward)
    return point


@kernel(inline=True)
def no_bias(tree: Tree) -> Vector:
    """Make the bias of a base at rest without gravity."""
    zero = 0.0 * tree.base[BASE_MASS]
    return Vector(zero, zero, zero)


@kernel(inline=True)
def move_base(tree: Tree, bias: Vector, force: Array, out: Array, at: int, rows: Array, loads: Array) -> int:
    """Write the base's accelerations to `out` from `at` on, `bias` being its point's without them; returns a fault."""
    n = tree.shape[LINKS]
    kind = tree.shape[BASE_KIND]
    if kind == LIFTED:
        return move_lifted(tree, bias, force, out, at, rows, loads)
    if kind >= SKI:
        return move_ski(tree, bias, force, out, at, rows, loads)
    if kind == PIVOT:
        put_row(loads, n, c.POINT, bias)
        return 0
    mass, sums, asked = tree.base[BASE_MASS], row_sym3(rows, n, c.SUM), row_vector(loads, n, c.FORCE)
    if kind == PLANTED:
        zero = 0.0 * mass
        put_row(loads, n, c.POINT, bias)
        put_row(loads, n, c.GROUND, add_scaled(add_scaled(add(times(sums, bias), asked), mass, bias), -1.0, vector(force, 0)))
        put(out, at, Vector(zero, zero, zero))
        return 0
    whole = Sym3(sums.xx + mass, sums.xy, sums.xz, sums.yy + mass, sums.yz, sums.zz + mass)
    sound, point = solve3(whole, add_scaled(vector(force, 0), -1.0, asked))
    put_row(loads, n, c.POINT, point)
    put(out, at, add_scaled(point, -1.0, bias))
    return 0 if sound else FREE_BASE


@kernel(inline=True)
def move_lifted(tree: Tree, bias: Vector, force: Array, out: Array, at: int, rows: Array, loads: Array) -> int:
    """Solve for the acceleration of a ski that may leave the snow: all hinges and its centre are at A, so that it turns alone."""
    n = tree.shape[LINKS]
    forward, left = heading(tree, rows)
    mass, sums, asked = tree.base[BASE_MASS], row_sym3(rows, n, c.SUM), row_vector(loads, n, c.FORCE)
    whole = Sym3(sums.xx + mass, sums.xy, sums.xz, sums.yy + mass, sums.yz, sums.zz + mass)
    flat = add_scaled(scale(force[0], forward), force[1], left)
    sound, point = solve3(whole, add_scaled(Vector(flat.x, flat.y, flat.z + force[3]), -1.0, asked))
    moved = add_scaled(point, -1.0, bias)
    yaw = (force[2] - loads[n, c.TURN_FORCE]) / tree.base[BASE_INERTIA]
    put_row(loads, n, c.POINT, point)
    loads[n, c.YAW] = yaw
    out[at], out[at + 1], out[at + 2], out[at + 3] = dot(forward, moved), dot(left, moved), yaw, moved.z
    return 0 if sound else FREE_BASE


@kernel(inline=True)
def move_ski(tree: Tree, bias: Vector, force: Array, out: Array, at: int, rows: Array, loads: Array) -> int:
    """Solve for speed', [sideways'] and phi'' of a ski; a reduced knife edge crosses the second row and column out."""
    n = tree.shape[LINKS]
    mass, offset, inertia, spin = tree.base[BASE_MASS], tree.base[COM_OFFSET], tree.base[BASE_INERTIA], loads[n, c.SPIN]
    forward, left = heading(tree, rows)
    sums, asked, coupled = row_sym3(rows, n, c.SUM), row_vector(loads, n, c.FORCE), row_vector(rows, n, c.TURN_SUM)
    sum_forward, lever = times(sums, forward), mass * offset
    # forces and yaw moment felt at the bias
    felt = add_scaled(add(times(sums, bias), asked), mass, bias)
    yaw = dot(coupled, bias) + lever * dot(left, bias) + loads[n, c.TURN_FORCE]
    along, turning = force[0] + lever * spin - dot(forward, felt), inertia + lever * offset + rows[n, c.TURN_SQUARE]
    ahead, mixed = mass + dot(forward, sum_forward), dot(forward, coupled)
    if tree.shape[BASE_KIND] == SKI:
        sound, moved = solve2(Sym2(ahead, mixed, turning), Pair(along, force[1] - yaw))
        out[at], out[at + 1] = moved.one, moved.two
        put_row(loads, n, c.POINT, add_scaled(bias, moved.one, forward))
        loads[n, c.YAW] = moved.two
        return 0 if sound else FREE_BASE
    sum_left = times(sums, left)
    matrix = Sym3(ahead, dot(forward, sum_left), mixed, mass + dot(left, sum_left), lever + dot(left, coupled), turning)
    sound, found = solve3(matrix, Vector(along, force[1] - dot(left, felt), force[2] - yaw))
    put(out, at, found)
    put_row(loads, n, c.POINT, add_scaled(add_scaled(bias, found.x, forward), found.y, left))
    loads[n, c.YAW] = found.z
    return 0 if sound else FREE_BASE


@kernel(inline=True)
def drive_base(tree: Tree, y: Array, dy: Array, rows: Array) -> None:
    """Write the rates of the base's positions."""
    n = tree.shape[LINKS]
    kind, first = tree.shape[BASE_KIND], tree.shape[POSITIONS]
    if kind in (FREE, PLANTED):
        put(dy, 0, vector(y, first))
    elif kind != PIVOT:
        cosine, sine, speed = rows[n, c.COSINE], rows[n, c.SINE], y[first]
        dy[0], dy[1], dy[2] = speed * cosine, speed * sine, y[first + 1]
        if kind != SKI:
            dy[0] -= y[first + 1] * sine
            dy[1] += y[first + 1] * cosine
            dy[2] = y[first + 2]
        if kind == LIFTED:
            dy[3] = y[first + 3]
