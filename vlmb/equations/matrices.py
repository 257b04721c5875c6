"""The blocks of the equations of motion as text, LaTeX, CSV or NPZ, with row and column names."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vlmb.equations.motion import EquationsOfMotion, equations_of_motion
from vlmb.errors import SceneError, nearest
from vlmb.model.layout import Layout
from vlmb.model.mechanism import build
from vlmb.model.names import tex_of
from vlmb.scene.scene import Scene
from vlmb.system.beginning import NEAR_AT_START
from vlmb.system.contacts import STILL
from vlmb.system.ski_contact import SKI
from vlmb.system.start import consistent_start
from vlmb.system.system import make_system

Array = NDArray[np.float64]

FORMATS = ("text", "latex", "csv", "npz")
WHOLE = ("mass_matrix", "bias")  # what may be asked for beside the blocks
OF_PHASE = ("W", "w", "supported_mass_matrix", "supported_bias")  # and of a phase
ROUNDING = 1e-14  # of the mass matrix's largest entry: smaller numbers are shown as 0
WIDTH = 118  # characters
TEX_COLUMNS = 100  # TeX has no wider paper than 5.7 m


class Table(NamedTuple):
    """One block with every row that has it."""

    block: str
    rows: tuple[str, ...]  # coordinates
    columns: tuple[str, ...]  # what the columns multiply
    values: Array  # (rows, columns)


def at_posture(
    scene: Scene | str | Path | Mapping[str, Any], changes: Sequence[str] = (), form: str = "full",
    closed: Sequence[str] = (),
) -> EquationsOfMotion:
    """Return the equations of a scene at its start, changed by entries such as `psi1=1.2`, `phi1_dot=0.5`, `speed=8`.

    A ski that may lift is on the snow where it stands there, and in the air above it.

    Raises SceneError naming what cannot be read.
    """
    mechanism = build(scene)
    start = consistent_start(make_system(mechanism))
    coordinates, rates = dict(start.coordinates), dict(start.rates)
    given = mechanism.names.canonical(dict(_read(entry) for entry in changes), "--at")
    ski = mechanism.layout.headed
    if ski and ("speed" in given or _along(coordinates, rates)):  # the start's speed stays along the ski when the heading changes
        heading = coordinates["phi0"]
        rates["speed"] = rates.pop("x_dot") * math.cos(heading) + rates.pop("y_dot") * math.sin(heading)
    if "x_dot" in given or "y_dot" in given:
        rates.pop("speed", None)
    for name, value in given.items():
        (rates if name.endswith("_dot") or (ski and name == "speed") else coordinates)[name] = value
    if mechanism.layout.lifts and not closed and form == "full" and abs(coordinates["z"]) <= NEAR_AT_START:
        closed = (SKI,)
    return equations_of_motion(mechanism, coordinates, rates, form, closed)


def tables(eom: EquationsOfMotion, wanted: Sequence[str] = ()) -> list[Table]:
    """Return the blocks asked for, or all of them, each over every row of the equations."""
    known = tuple(eom.columns)
    phase = OF_PHASE[: 4 if eom.phase.supported else 2] if eom.closed else ()
    found = []
    for name in wanted or (*known, *phase):
        if name in phase:
            found.append(_of_phase(eom, name))
        elif name == "mass_matrix":
            columns = tuple("speed_dot" if row == "speed" else f"{row}_ddot" for row in eom.names)
            found.append(Table(name, eom.names, columns, eom.mass_matrix))
        elif name == "bias":
            found.append(Table(name, eom.names, ("1",), eom.bias[:, None]))
        elif name in known:
            parts = [eom.blocks[name, row].reshape(len(places), -1) for row, places in eom.rows.items() if places]
            rows = tuple(place for places in eom.rows.values() for place in places)
            found.append(Table(name, rows, eom.columns[name], np.vstack(parts)))
        else:
            raise SceneError(f"--block {name}: no such block; {nearest(name, (*known, *WHOLE, *phase))}")
    return [table for table in found if table.columns]


def _of_phase(eom: EquationsOfMotion, name: str) -> Table:
    """Return a table of a phase: W c'' + w = 0, and the equations of the chain on the foot that stands."""
    phase = eom.phase
    if name in ("W", "w"):
        columns = tuple(f"{row}_ddot" for row in eom.names) if name == "W" else ("1",)
        return Table(name, phase.names, columns, phase.jacobian if name == "W" else phase.drift[:, None])
    columns = tuple(f"{row}_ddot" for row in phase.supported)
    if name == "supported_mass_matrix":
        return Table(name, phase.supported, columns, eom.supported_mass_matrix)
    return Table(name, phase.supported, ("1",), eom.supported_bias[:, None])


def arrays(eom: EquationsOfMotion, wanted: Sequence[str] = ()) -> dict[str, Array]:
    """Return what an NPZ file holds.

    Blocks as `A_phi` (block, row), `mass_matrix`, its `condition` number, `bias`, `names`, the posture as `coordinates` and
    `rates`, and row and column names as `rows_phi`, `columns_A`.
    """
    blocks = {table.block for table in tables(eom, wanted)} if wanted else set(eom.columns)
    found: dict[str, Array] = {f"{block}_{row}": value for (block, row), value in eom.blocks.items() if block in blocks}
    names = eom.mechanism.layout.names
    found |= {"mass_matrix": eom.mass_matrix, "bias": eom.bias, "names": np.array(eom.names)}
    found["condition"] = np.array(eom.condition)
    found |= {"coordinate_names": np.array(names), "coordinates": np.array([eom.coordinates[name] for name in names])}
    found["rates"] = np.array([eom.rates[f"{name}_dot"] for name in names])
    found |= {f"rows_{row}": np.array(places, dtype=str) for row, places in eom.rows.items()}
    if eom.closed:
        found |= {"W": eom.phase.jacobian, "w": eom.phase.drift, "phase_rows": np.array(eom.phase.names, dtype=str)}
        found |= {"supported_mass_matrix": eom.supported_mass_matrix, "supported_bias": eom.supported_bias}
        found["supported_names"] = np.array(eom.phase.supported, dtype=str)
    return found | {f"columns_{block}": np.array(eom.columns[block], dtype=str) for block in eom.columns if block in blocks}


def comma_separated(eom: EquationsOfMotion, blocks: Sequence[Table]) -> str:
    """One line an entry, every digit: block, row, column, value."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["block", "row", "column", "value"])
    for table in blocks:
        for row, values in zip(table.rows, table.values.tolist(), strict=True):
            writer.writerows([table.block, row, column, repr(value)] for column, value in zip(table.columns, values, strict=True))
    return out.getvalue()


def text(eom: EquationsOfMotion, blocks: Sequence[Table]) -> str:
    """Tables of six digits; wide ones are cut into parts."""
    scene, tiny = eom.mechanism.scene, _rounding(eom)
    lines = [f"{scene.name}: form {eom.form}, condition number of the mass matrix {eom.condition:.3g}"]
    posture = [f"{name} = {value:.6g}" for name, value in eom.coordinates.items()]
    posture += [f"{name} = {value:.6g}" for name, value in eom.rates.items() if value]
    lines += _wrapped("at ", posture)
    owners = {row: _with_owner(eom.mechanism.layout, row) for row in (*eom.names, "speed")}
    for table in blocks:
        label = max(len(owners.get(row, row)) for row in table.rows)
        cells = [[_number(value, tiny) for value in row] for row in table.values.tolist()]
        width = max(len(cell) for row in [*cells, list(table.columns)] for cell in row) + 2
        step = max(1, (WIDTH - label) // width)
        for first in range(0, len(table.columns), step):
            chosen = slice(first, first + step)
            lines += ["", table.block if first == 0 else f"{table.block}, continued"]
            lines.append(" " * label + "".join(f"{name:>{width}s}" for name in table.columns[chosen]))
            for row, values in zip(table.rows, cells, strict=True):
                lines.append(f"{owners.get(row, row):<{label}s}" + "".join(f"{value:>{width}s}" for value in values[chosen]))
    return "\n".join(lines) + "\n"


def latex(eom: EquationsOfMotion, blocks: Sequence[Table]) -> str:
    """A document of its own, on paper as large as its largest matrix; wide ones are cut into parts."""
    tiny, known = _rounding(eom), {*eom.names, "speed"}
    most_columns = min(max([len(table.columns) for table in blocks] + [3]), TEX_COLUMNS)
    most_rows = max([len(table.rows) for table in blocks] + [12])
    posture = [f"{tex_of(name)}={_tex_number(value, 0.0)}" for name, value in {**eom.coordinates, **eom.rates}.items()]
    lines = [
        r"\documentclass{article}",
        r"\usepackage{amsmath}",
        rf"\usepackage[paperwidth={40 + 30 * most_columns}mm,paperheight={60 + 7 * most_rows}mm,margin=10mm]{{geometry}}",
        r"\setlength{\parindent}{0pt}",
        r"\begin{document}",
        rf"\textbf{{{_escaped(eom.mechanism.scene.name)}}}, form \texttt{{{eom.form}}}, at $" + r"$, $".join(posture) + r"$.",
        rf"Condition number of the mass matrix: ${_tex_number(eom.condition, 0.0)}$.",
    ]
    for table in blocks:
        for first in range(0, len(table.columns), TEX_COLUMNS):
            chosen = slice(first, first + TEX_COLUMNS)
            columns = table.columns[chosen]
            title = rf"\texttt{{{_escaped(table.block)}}}" + (", continued" if first else "")
            lines += ["", title, r"\[", rf"\begin{{array}}{{r|{'r' * len(columns)}}}"]
            lines.append(" & " + " & ".join(map(tex_of, columns)) + r" \\ \hline")
            for row, values in zip(table.rows, table.values.tolist(), strict=True):
                shown = tex_of(row) if row in known else rf"\texttt{{{_escaped(row)}}}"
                lines.append(f"{shown} & " + " & ".join(_tex_number(value, tiny) for value in values[chosen]) + r" \\")
            lines += [r"\end{array}", r"\]"]
    return "\n".join([*lines, r"\end{document}"]) + "\n"


def _along(coordinates: Mapping[str, float], rates: Mapping[str, float]) -> bool:
    """Whether a ski moves along itself; one that may lift need not."""
    across = rates["y_dot"] * math.cos(coordinates["phi0"]) - rates["x_dot"] * math.sin(coordinates["phi0"])
    return abs(across) <= STILL * max(1.0, abs(rates["x_dot"]), abs(rates["y_dot"]))


def _read(entry: str) -> tuple[str, float]:
    name, sign, value = entry.partition("=")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not sign or not name or not math.isfinite(number):
        raise SceneError(f"--at {entry}: must be NAME=VALUE with a finite number, e.g. psi1=1.2")
    return name.strip(), number


def _rounding(eom: EquationsOfMotion) -> float:
    return ROUNDING * float(np.abs(eom.mass_matrix).max(initial=0.0))


def _number(value: float, tiny: float) -> str:
    return "0" if abs(value) <= tiny else f"{value:.6g}"


def _wrapped(lead: str, entries: Sequence[str]) -> list[str]:
    lines = [lead.rstrip()]
    for entry in entries:
        if len(lines[-1]) + len(entry) + 2 > WIDTH:
            lines.append("  ")
        lines[-1] += " " + entry + ","
    lines[-1] = lines[-1].rstrip(",")
    return lines


def _with_owner(layout: Layout, name: str) -> str:
    """Coordinate name, with the link's name where that says more than its number."""
    at = layout.index.get(name)
    link = layout.coordinates[at].link if at is not None else -1
    return name if link < 0 or layout.links[link].name == f"link{link + 1}" else f"{name} ({layout.links[link].name})"


def _tex_number(value: float, tiny: float) -> str:
    if not math.isfinite(value):
        return r"\infty"
    mantissa, exponent, power = _number(value, tiny).partition("e")
    return rf"{mantissa}\cdot 10^{{{int(power)}}}" if exponent else mantissa


def _escaped(words: str) -> str:
    """Words for LaTeX; signs that need fonts or packages of their own become question marks."""
    return re.sub(r"([&%#_])", r"\\\1", re.sub(r"[^ -~]|[\\{}~^$]", "?", words))
