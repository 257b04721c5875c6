"""Feet that stand at a start, and ideal constraints: what of a start follows from what of it is given."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import StudyError
from vlmb.model.mechanism import Mechanism, build
from vlmb.model.names import DOT
from vlmb.scene.scene import Scene
from vlmb.simulation.trajectory import Trajectory
from vlmb.system.contacts import Footing, contact_points
from vlmb.system.row_sets import RowSet
from vlmb.system.ski_contact import NORMAL_ROW, SKI
from vlmb.system.start_rows import row_sets
from vlmb.system.system import make_system

Array = NDArray[np.float64]
Values = dict[str, float]

KEPT = ("plane", "slope", "base", "links", "parameters", "data", "constraints")  # of a scene: what rows of a start may name
ROUNDS, HELD, NUDGE, FLAT = 12, 1e-12, 1e-6, 1e-10


class Feet:
    """The rows that a start must meet: contacts closed in the guess stay where they are, ideal constraints hold."""

    def __init__(
        self, mechanism: Mechanism, values: Values, free: Collection[str], prescribed: set[str], begun: Trajectory
    ) -> None:
        rows = _feet(mechanism, begun)
        self.texts = tuple(rows)
        data = {key: value for key, value in mechanism.scene.to_dict().items() if key in KEPT}
        data["constraints"] = [*data.get("constraints", []), *rows]
        held = build(Scene.from_dict(data))
        assert isinstance(held, Mechanism)
        sets = row_sets(make_system(held)) if data["constraints"] else []
        self.rows: RowSet | None = next((entry for entry in sets if entry.ideal), None)
        self.holonomic = self.rows.holonomic if self.rows is not None else np.zeros(0, bool)
        moving = [name for name in values if name not in free and name.removesuffix(DOT) not in prescribed]
        self.places = [name for name in moving if not name.endswith(DOT) and name != "speed"]
        self.rates = [name for name in moving if name.endswith(DOT) or name == "speed"]
        self.ski = "speed" in values

    def follow(self, values: Values) -> Values:
        """Return a start with what is not free moved as little as rows ask for. Raises StudyError where they cannot hold."""
        rows = self.rows
        if rows is None:
            return values
        values = dict(values)
        if self.holonomic.any():
            self._solve(values, self.places, lambda at: rows.values(*self._both(at, still=True)).z[self.holonomic])
        self._solve(values, self.rates, lambda at: rows.values(*self._both(at)).rate)
        return values

    def _both(self, values: Values, still: bool = False) -> tuple[Values, Values]:
        """Return coordinates and rates by name."""
        found = dict(values)
        if self.ski:
            speed, at = found.pop("speed"), found["phi0"]
            found[f"x{DOT}"], found[f"y{DOT}"] = speed * math.cos(at), speed * math.sin(at)
        rates = {name: 0.0 if still else value for name, value in found.items() if name.endswith(DOT)}
        return {name: value for name, value in found.items() if not name.endswith(DOT)}, rates

    def _solve(self, values: Values, names: Sequence[str], lacking: Callable[[Values], Array]) -> None:
        """Move values by name until nothing is lacking."""
        for _ in range(ROUNDS):
            error = lacking(values)
            if np.abs(error).max(initial=0.0) <= HELD:
                return
            if not names:
                break
            columns = []
            for name in names:
                sides = [lacking({**values, name: values[name] + way * NUDGE}) for way in (1.0, -1.0)]
                columns.append((sides[0] - sides[1]) / (2.0 * NUDGE))
            change = np.linalg.pinv(np.column_stack(columns), FLAT) @ -error
            for name, by in zip(names, change.tolist(), strict=True):
                values[name] += by
        if np.abs(lacking(values)).max(initial=0.0) > 1e3 * HELD:
            feet = f"feet that stand ({'; '.join(self.texts)}) and " if self.texts else ""
            raise StudyError(f"{feet}ideal constraints do not hold at a start with what is free given; free other coordinates")


def _feet(mechanism: Mechanism, begun: Trajectory) -> list[str]:
    """Return equations for the contacts that are closed at a start: places of those that hold, gaps of those that slide."""
    phase, found = begun.phases[0], []
    for point in contact_points(mechanism):
        if point.name not in phase.closed:
            continue
        if point.name in phase.slipping or point.smooth:
            found.append(f"{point.gap_text(Footing())} = 0")
            continue
        for name, speed in zip(point.names, point.contact.surface_velocity, strict=True):
            if not name:
                continue
            moving = f" + {speed!r}*t" if speed else ""
            found.append(f"{name} = {float(begun[name][0])!r}{moving}")
    return [*found, NORMAL_ROW] if SKI in phase.closed else found
