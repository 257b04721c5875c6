"""Run the kernels as plain Python in 50 digits; called with VLMB_JIT=0 in a process of its own.

Reads cases (name, links, changes) as JSON from standard input and writes errors of evaluations that are handed in.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import mpmath
import numpy as np

from tests.core import dense, trees
from vlmb.core import jit, links
from vlmb.core.scratch import make_lanes, make_scratch
from vlmb.core.tree import Tree

DIGITS = 50


def exact(array: Any) -> Any:
    """The same numbers in 50 digits."""
    return np.array([mpmath.mpf(float(x)) for x in np.ravel(array)], dtype=object).reshape(np.shape(array))


def exact_case(case: trees.Case) -> trees.Case:
    tree, y, given, force = case
    return trees.Case(Tree(tree.shape, exact(tree.base), tree.link, exact(tree.real)), exact(y), exact(given), exact(force))


def error(found: Any, right: Any) -> float:
    """Largest error over the largest entry."""
    return float(max(abs(a - b) for a, b in zip(exact(found), right, strict=True)) / max(abs(b) for b in right))


def judge(request: dict[str, Any]) -> dict[str, float]:
    """Errors of rates and responses that the compiled core found, and of this run beside the dense equations."""
    case = exact_case(trees.Case(*trees.case_of(request["case"])))
    scratch, dy = make_scratch(case.tree, object), 0 * case.y
    assert links.accelerate(*case, dy, scratch) == 0
    errors = {"rates": error(request["rates"], dy)}
    if request["dense"]:
        right, axial = dense.rates(*case)
        errors["dense"] = float(max(abs(a - b) for a, b in zip(dy, right, strict=True)) / max(abs(b) for b in right))
        errors["axial"] = error(request["axial"], np.ravel(axial)) if axial.any() else 0.0
    lanes = make_lanes(len(case.tree.link), len(case.force), object)
    lanes.moved[:, 0] = case.force
    assert links.respond(case.tree, scratch, lanes) == 0
    errors["response"] = error(request["response"], lanes.moved[:, 0])
    return errors


if __name__ == "__main__":
    assert not jit.COMPILED
    mpmath.mp.dps = DIGITS
    json.dump([judge(request) for request in json.load(sys.stdin)], sys.stdout)
