"""The integration methods by name: what they are for, and what their driver in the core is called."""

from __future__ import annotations

from dataclasses import dataclass

from vlmb.errors import SceneError, nearest


@dataclass(frozen=True)
class Method:
    """An integration method: its order, whether its steps adapt, and what it is for."""

    name: str
    order: int
    adaptive: bool
    purpose: str
    driver: str  # its name in the core
    stiff: bool = False


METHODS = {
    method.name: method
    for method in (
        Method("euler", 1, False, "the paper's first-order scheme; for comparison", "euler"),
        Method("rk4", 4, False, "fixed steps, known cost", "rk4"),
        Method("gauss", 4, False, "long runs: energy error stays bounded", "gauss"),
        Method("dop853", 8, True, "smooth motions at any tolerance", "dop853"),
        Method("adams", 12, True, "fewest right-hand sides: where a control in Python takes the time", "adams"),
        Method("bdf", 5, True, "the name that stiff scenes had before radau served them all", "radau", True),
        Method("radau", 5, True, "stiff scenes", "radau", True),
    )
}


def find_method(name: str) -> Method:
    """Return a method by name; SceneError lists the valid ones."""
    if name not in METHODS:
        raise SceneError(f"method = {name!r}: no such method; {nearest(name, METHODS)}")
    return METHODS[name]
