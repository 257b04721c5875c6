"""Derivatives of expressions by mpmath, from their trees; as a script with VLMB_JIT=0 the tape itself runs with 50 digits."""

from __future__ import annotations

import sys
from typing import Any

import mpmath
import numpy as np

from vlmb.core import tape
from vlmb.core.opcodes import LEAVES, PARAMETER, RATE, TIME, VALUE, make_buffers
from vlmb.model.tape import Leaf, compile_tape
from vlmb.scene.expressions import parse, walk

NAMES = {
    "t": Leaf(TIME),
    "A": Leaf(PARAMETER, 0),
    "k": Leaf(PARAMETER, 1),
    "x": Leaf(VALUE, 0),
    "y": Leaf(VALUE, 1),
    "z": Leaf(VALUE, 2),
}
NAMES |= {f"{name}_dot": Leaf(RATE, NAMES[name].at) for name in "xyz"}

TEXTS = [  # every operation, at arguments of both signs
    "x + y", "x - y", "-x*y*z", "x/y", "x/3", "2/y", "x + 2", "x*2 - 3*y", "x**2", "x**3", "(-x)**3", "x**-1", "(-x)**-3",
    "y**64",     "x**0.5", "y**1.5", "y**-2.5", "x**0 + x**1", "sin(x)*cos(y)", "tan(x)", "asin(x/3)", "acos(x/3)",
    "atan(x*y)", "atan2(y, x)",
    "atan2(-y, -x)", "atan2(x, 2)", "exp(-x**2)", "log(x*y)", "sqrt(x + y)", "abs(x - y)", "abs(y - x)", "min(x, y)",
    "max(x, y, z)",     "min(x, 2)", "sign(x - y)*x", "step(x - y)*y", "step(y - x)*y", "where(x < y, x*y, log(-x))",
    "where(x >= y, log(-x), x*z)",
    "where(z <= y, sqrt(z), y**2)", "where(z > y, x, sin(y))", "A*sin(k*t)*x", "A*k*t - 3", "exp(A*t)/k",
    "sqrt(x**2 + y**2 + z**2)",     "A*k**2*sin(k*x)/(1.2*k**2 + 9.7/(A**2 + 2*y*x))", "x*x*x", "A*A", "((x + y)**2)**0.5",
    "x_dot*y + t", "x_dot**2*sin(y)",
]  # fmt: skip
FUNCTIONS = {
    "+": lambda *a: mpmath.fsum(a), "*": lambda *a: mpmath.fprod(a), "/": lambda a, b: a / b, "neg": lambda a: -a,
    "**": lambda a, b: mpmath.power(a, int(b) if b == int(b) else b), "abs": abs, "min": min, "max": max,
    "sign": lambda a: mpmath.sign(a), "step": lambda a: mpmath.mpf(a >= 0), "where": lambda a, b, c: b if a < 0 else c,
}  # fmt: skip


def value(tree: Any, values: dict[str, Any]) -> Any:
    def operation(op: str, parts: list[Any]) -> Any:
        if op == "atan2" and any(isinstance(part, mpmath.mpc) for part in parts):
            raise ValueError("not real")
        return (FUNCTIONS.get(op) or getattr(mpmath, op))(*parts)

    return walk(tree, values.__getitem__, mpmath.mpf, operation)


def jet(tree: Any, jets: dict[str, tuple[Any, Any, Any]]) -> list[Any]:
    """Value and two derivatives along c0 + c1 h + c2 h^2 / 2 of every name."""

    def along(h: Any) -> Any:
        return value(tree, {name: c[0] + c[1] * h + c[2] * h * h / 2 for name, c in jets.items()})

    return [along(mpmath.mpf(0)), mpmath.diff(along, 0), mpmath.diff(along, 0, 2)]


def slope(tree: Any, jets: dict[str, tuple[Any, Any, Any]], name: str) -> Any:
    return mpmath.diff(lambda h: value(tree, {n: c[0] + (h if n == name else 0) for n, c in jets.items()}), 0)


class Played:
    """One tape of several expressions, played on numbers of a type."""

    def __init__(self, texts: list[str], dtype: Any) -> None:
        self.compiled = compile_tape([parse(text, allowed=set(NAMES)) for text in texts], NAMES.__getitem__)
        self.buffers, self.dtype, self.tape = make_buffers(self.compiled.tape, dtype), dtype, self.compiled.tape
        if dtype is object:
            self.tape = self.tape._replace(constant=np.array([mpmath.mpf(c) for c in self.tape.constant], object))

    def __call__(self, t: Any, parameters: list[Any], measured: list[list[Any]]) -> tuple[np.ndarray, np.ndarray]:
        """Jets (roots, 3) and the gradient of every root over the leaves."""
        made, out = self.tape, np.zeros((len(self.compiled.rows), 3), self.dtype)
        numbers = np.array(parameters, self.dtype)
        tape.prepare(made, self.buffers, numbers)
        tape.read_leaves(made, t, numbers, np.array(measured, self.dtype), self.buffers.slots)
        tape.jets(made, self.buffers, out)
        slopes = np.zeros((len(out), made.parts[LEAVES]), self.dtype)
        for r in range(len(out)):
            tape.gradient(made, self.buffers, r, True)
            slopes[r] = self.buffers.adjoint[: made.parts[LEAVES]]
        return out, slopes


def jets_of(t: Any, parameters: list[Any], measured: list[list[Any]]) -> dict[str, tuple[Any, Any, Any]]:
    found = {"t": (t, 1, 0), "A": (parameters[0], 0, 0), "k": (parameters[1], 0, 0)}
    for name, (a, b, c) in zip("xyz", measured, strict=True):
        found |= {name: (a, b, c), f"{name}_dot": (b, c, 0)}
    return found


def main() -> list[str]:
    mpmath.mp.dps = 50
    t, parameters = mpmath.mpf("0.7"), [mpmath.mpf("1.3"), mpmath.mpf("0.36")]
    measured = [[mpmath.mpf(n) for n in row] for row in (("1.1", "0.4", "-0.7"), ("2.3", "-1.2", "0.5"), ("0.6", "2.1", "1.7"))]
    played, found = Played(TEXTS, object), []
    out, slopes = played(t, parameters, measured)
    for r, text in enumerate(TEXTS):
        tree, jets = parse(text).tree, jets_of(t, parameters, measured)
        used = {name: jets[name] for name in played.compiled.names}
        wanted = jet_of_branch(tree, jets)
        worst = max(abs(a - b) / (1 + abs(b)) for a, b in zip(out[r], wanted, strict=True))
        for k, name in enumerate(used):
            if played.compiled.names[k] in parse(text).names:
                exact = slope(pruned(tree, jets), jets, name)
                worst = max(worst, abs(slopes[r, k] - exact) / (1 + abs(exact)))
        if worst > 1e-25:
            found.append(f"{text}: {mpmath.nstr(worst, 3)}")
    return found


def pruned(tree: Any, jets: dict[str, tuple[Any, Any, Any]]) -> Any:
    """The tree with every `where` replaced by the branch taken, so that the other may have no value."""
    op, *rest = tree
    if op in ("name", "number"):
        return tree
    if op == "where":
        below = value(rest[0], {name: c[0] for name, c in jets.items()}) < 0
        return pruned(rest[1] if below else rest[2], jets)
    return (op, *(pruned(part, jets) for part in rest))


def jet_of_branch(tree: Any, jets: dict[str, tuple[Any, Any, Any]]) -> list[Any]:
    return jet(pruned(tree, jets), jets)


if __name__ == "__main__":
    wrong = main()
    print("\n".join(wrong) or "fine")
    sys.exit(bool(wrong))
