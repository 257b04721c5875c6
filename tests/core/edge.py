"""The force of a reduced knife edge, from what the recursion leaves in the base's row."""

from __future__ import annotations

from vlmb.core import base
from vlmb.core import scratch as c
from vlmb.core import tree as t
from vlmb.core.tree import Array, Tree
from vlmb.core.vectors import add, add_scaled, dot, row_sym3, row_vector, times


def edge_force(tree: Tree, rows: Array) -> float:
    """Return the force [N] to the left that the reduced knife edge of a ski, of a SKI alone, took at the last `accelerate`."""
    n = tree.shape[t.LINKS]
    _, left = base.heading(tree, rows)
    point, yaw, mass = row_vector(rows, n, c.POINT), rows[n, c.YAW], tree.base[t.BASE_MASS]
    felt = add(times(row_sym3(rows, n, c.SUM), point), row_vector(rows, n, c.FORCE))
    felt = add_scaled(add_scaled(felt, yaw, row_vector(rows, n, c.TURN_SUM)), mass, point)
    return float(dot(left, felt) + mass * tree.base[t.COM_OFFSET] * yaw)
