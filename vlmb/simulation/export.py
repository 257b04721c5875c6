"""A run in files of other programs: csv, NetCDF (nc), OpenSim's storage (sto)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from vlmb.errors import TrajectoryError
from vlmb.simulation.columns import Column
from vlmb.simulation.files import replacing
from vlmb.simulation.trajectory import Trajectory

FORMATS = (".csv", ".nc", ".sto")


def export(trajectory: Trajectory, path: str | Path) -> Path:
    """Write the columns of `to_pandas`, points included, in the format that the ending of a path names.

    csv has units in its header line, nc in the attributes, sto (OpenSim, angles in radians) none. Raises TrajectoryError for
    another ending, and without xarray for nc; OutputError where nothing can be written.
    """
    path = Path(path)
    if path.suffix == ".csv":
        return trajectory.save_csv(path)
    if path.suffix == ".nc":
        return _write_netcdf(trajectory, path)
    if path.suffix == ".sto":
        return _write_storage(trajectory.scene.name, list(trajectory.columns(points=True)), path)
    raise TrajectoryError(f"{path}: a run is written as {', '.join(FORMATS)}")


def _write_netcdf(trajectory: Trajectory, path: Path) -> Path:
    """Write NetCDF 3, which needs no library but SciPy; a slash, which names may not have there, becomes `per`."""
    table = trajectory.to_xarray(points=True)
    names = {name: name.replace("/", " per ") for name in table.data_vars if "/" in name}
    for name in names:
        table[name].attrs["long_name"] = name
    with replacing(path) as beside:
        table.rename(names).to_netcdf(beside, engine="scipy", format="NETCDF3_64BIT")
    return path


def _write_storage(name: str, found: Iterable[Column], path: Path) -> Path:
    """Write OpenSim's storage: a header, names without blanks, and rows, all separated by tabs."""
    made = list(found)
    labels = ["time", *("_".join(column.name.split()) for column in made[1:])]
    sizes = [f"nRows={len(made[0].values)}", f"nColumns={len(labels)}"]
    lines = [" ".join(name.split()), "version=1", *sizes, "inDegrees=no", "endheader", "\t".join(labels)]
    lines += ["\t".join(map(repr, row)) for row in zip(*(column.values.tolist() for column in made), strict=True)]
    with replacing(path) as beside:
        beside.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
