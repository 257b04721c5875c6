"""What an evaluation of a robot costs beside Pinocchio's own calls, and its parts (some seconds).

Usage: python benchmarks/robots.py

All is timed in turn, in one thread: read ratios. *Bare calls*: `crba`, `nonLinearEffects` and the Cholesky of the mass matrix in
place, called from Python, the least that any dense formulation asks for; an evaluation is called from Python as well.
"""

from __future__ import annotations

from collections.abc import Callable

from common import MODELS, interleaved, micro, table, write_report

# isort: split
import numpy as np
import pinocchio as pin

import vlmb
from vlmb.system.robot_engine import RobotEngine
from vlmb.system.robot_start import robot_start
from vlmb.system.robot_system import make_robot_system
from vlmb.system.robot_workspace import rows_of_frames


def calls_of(path: str, without: bool) -> tuple[dict[str, Callable[[], object]], str]:
    """Return what is timed of a scene, and how large it is; `without` its programme."""
    data = vlmb.load_scene(MODELS / path).to_dict()
    if without:
        data.pop("programme")
    system = make_robot_system(vlmb.build(data))
    start = robot_start(system)
    engine = RobotEngine(system, start.state)
    space, model, y = engine.workspace, system.mechanism.model, engine.pack(start.state)
    data_of, (q, v) = pin.Data(model), start.state

    def bare() -> None:
        pin.crba(model, data_of, q)
        pin.nonLinearEffects(model, data_of, q, v)
        pin.cholesky.decompose(model, data_of)

    def rows() -> None:
        rows_of_frames(*space.arguments, 0.0, q, v, space.dy[: space.nq], space.out, space.matrix, space.values)

    calls = {"bare": bare, "evaluation": lambda: space.rhs(0.0, y), "rows": rows}
    if space.count:
        mass, bias = np.array(pin.crba(model, data_of, q)), pin.nonLinearEffects(model, data_of, q, v)
        back = space.back(q, v)
        calls["controls"] = lambda: space.controlled(mass, bias, back)
    return calls, f"{model.nv} velocities, {len(system.info)} rows, {space.count} controls"


def main() -> None:
    """Time all scenes, write the report."""
    rows, found = [], {}
    for path in sorted(MODELS.glob("robots/*.toml")):
        for without in (False, True):
            calls, size = calls_of(str(path.relative_to(MODELS)), without)
            best = interleaved(calls)
            name = f"{path.stem}{' without a programme' if without else ''}"
            ratio = best["evaluation"] / best["bare"]
            parts = [micro(best[part]) if part in best else "" for part in ("bare", "rows", "controls", "evaluation")]
            rows.append([name, size, *parts, f"{ratio:.2f}"])
            found[name] = {**best, "ratio": ratio}
    head = ["scene", "size", "bare calls [us]", "rows and laws [us]", "controls [us]", "evaluation [us]", "over bare calls"]
    write_report("robots", [str(__doc__).split("\n\n")[0].strip(), table(head, rows), str(__doc__).split("\n\n")[2]], found)


if __name__ == "__main__":
    main()
