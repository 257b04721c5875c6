"""A run as a table: every column with its unit, for CSV, pandas and xarray."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vlmb.errors import TrajectoryError
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import AXES, POINTS, force_unit
from vlmb.scene.names import ENERGIES, SNOW

Array = NDArray[np.float64]


class Column(NamedTuple):
    """One column: its name, unit and values (N,)."""

    name: str
    unit: str
    values: Array

    @property
    def header(self) -> str:
        """Name and unit, such as `psi1 [rad]`."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


class Recorded(Protocol):
    """What of a run its table reads: see `Trajectory`."""

    @property
    def mechanism(self) -> Mechanism: ...  # noqa: D102
    @property
    def t(self) -> Array: ...  # noqa: D102
    @property
    def controls(self) -> Mapping[str, Array]: ...  # noqa: D102
    @property
    def reactions(self) -> Mapping[str, Array]: ...  # noqa: D102
    @property
    def residuals(self) -> Mapping[str, Any]: ...  # noqa: D102
    def __getitem__(self, name: str) -> Array: ...
    def hinge_force(self, link: str) -> Array: ...  # noqa: D102
    def hinge_torque(self, link: str) -> Array: ...  # noqa: D102


def columns(run: Recorded, points: bool = False, hinges: bool = False) -> Iterator[Column]:
    """Yield time, coordinates, rates, energies, measured data, controls, reactions and residuals, in this order.

    Residuals are `residual:NAME` of a row's equation and `residual_dot:NAME` of its rate; they and the multipliers of rows have
    the unit that the equation gives them, which is not known. Forces of contacts are `contact:NAME.x`, of legs `leg:NAME.x`.
    `points` adds the points of all links and the centre of mass, `hinges` the force and torque in each hinge
    (`hinge_force:legs.x`).
    """
    names = run.mechanism.names
    yield Column("t", "s", run.t)
    for name in names.known:
        yield Column(name, names.find(name).unit, run[name])
    for name in ENERGIES:
        yield Column(name, "J", run[name])
    signals = run.mechanism.signals
    for name in signals:
        yield Column(name, signals.unit(name), run[name])
    for name, values in run.controls.items():
        yield Column(name, force_unit(name), values)
    legs = {leg.name for leg in run.mechanism.scene.legs}
    for name, values in run.reactions.items():
        if values.ndim == 2:  # of a contact, or a leg
            for axis, part in zip(AXES, values.T, strict=True):
                yield Column(f"{'leg' if name in legs else 'contact'}:{name}.{axis}", "N", part)
            continue
        yield Column(name, SNOW.get(name, "N" if name == "friction" or name.endswith((".min", ".max")) else ""), values)
    for name, residual in run.residuals.items():
        if residual.position is not None:
            yield Column(f"residual:{name}", "", residual.position)
        yield Column(f"residual_dot:{name}", "m/s" if name == "knife_edge" else "", residual.velocity)
    links = tuple(names.links)
    if points:
        places = [f"{link}.{point}" for link in links for point in POINTS]
        for name in (f"{place}.{axis}" for place in [*places, "com"] for axis in AXES):
            yield Column(name, "m", run[name])
    if hinges:
        for what, unit, read in (("hinge_force", "N", run.hinge_force), ("hinge_torque", "N m", run.hinge_torque)):
            for link in links:
                for axis, values in zip(AXES, read(link).T, strict=True):
                    yield Column(f"{what}:{link}.{axis}", unit, values)


def to_pandas(found: Iterator[Column]) -> Any:
    """Return a DataFrame over t, units by column in `attrs["units"]`. Raises TrajectoryError without pandas."""
    pandas = _package("pandas")
    time, *others = found
    frame = pandas.DataFrame({c.name: c.values for c in others}, index=pandas.Index(time.values, name=time.name))
    frame.attrs["units"] = {c.name: c.unit for c in (time, *others)}
    return frame


def to_xarray(found: Iterator[Column], about: Mapping[str, str]) -> Any:
    """Return a Dataset over the dimension t, each variable with its unit in `attrs["units"]`. Raises TrajectoryError."""
    xarray = _package("xarray")
    time, *others = found
    variables = {c.name: (time.name, np.array(c.values), {"units": c.unit}) for c in (time, *others)}
    return xarray.Dataset({c.name: variables[c.name] for c in others}, {time.name: variables[time.name]}, dict(about))


def _package(name: str) -> Any:
    import importlib

    try:
        return importlib.import_module(name)
    except ImportError:
        raise TrajectoryError(f"this needs {name}, which is not installed: pip install vlmb[data]") from None
