"""What notebooks show of a mechanism or a trajectory: a picture with a table; without pillow the table alone."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Sequence

from vlmb.errors import VlmbError
from vlmb.model.mechanism import Mechanism
from vlmb.model.names import counted
from vlmb.simulation.checking import check
from vlmb.simulation.trajectory import Trajectory
from vlmb.views.sceneries import of_state, of_trajectory
from vlmb.views.stills import still
from vlmb.views.visual_model import Scenery

HEIGHT = 300  # [pixels] of a picture
FRAMES = 120  # from which it is chosen
GHOSTS = 5  # earlier postures of what travels
ROWS = 12  # of a table; a longer one is folded


def card(what: Mechanism | Trajectory, height: int = HEIGHT) -> str:
    """Return HTML. Of a trajectory: its end, its summary, and the range of each coordinate.

    Of a mechanism: its start posture, its coordinates, what was left out, and warnings.
    """
    return _of_trajectory(what, height) if isinstance(what, Trajectory) else _of_mechanism(what, height)


def _of_trajectory(trajectory: Trajectory, height: int) -> str:
    lasts = float(trajectory.t[-1] - trajectory.t[0])
    made = of_trajectory(trajectory, min(30.0, FRAMES / max(lasts, 1e-3)))
    rows = []
    names = trajectory.mechanism.names
    for entry in names.coordinates:
        values = trajectory[entry.name]
        numbers = (values[0], values.min(), values.max(), values[-1])
        what = [entry.name, names.meaning(entry), entry.unit]
        rows.append([*what, *(f"{number:.4g}" for number in numbers)])
    columns = ("coordinate", "", "unit", "start", "least", "most", "end")
    picture = _picture(made, GHOSTS if trajectory.scene.base.kind != "pivot" else 0, height)
    return f"<div>{picture}{_text(trajectory.summary())}{_table(columns, rows)}</div>"


def _of_mechanism(mechanism: Mechanism, height: int) -> str:
    scene, picture = mechanism.scene, ""
    lines = [f"{scene.name}: {scene.base.kind} base, {counted(len(scene.links), 'link')}"]
    lines += [f"left out  {entry}" for entry in mechanism.left_out] + [f"warning   {entry}" for entry in mechanism.warnings]
    values = dict.fromkeys(mechanism.coordinate_names, "")
    try:
        start = check(scene)[1]
        values = {name: f"{start.coordinates[name]:.4g}" for name in mechanism.coordinate_names}
        lines += [f"note      {entry}" for entry in start.adjustments]
        picture = _picture(of_state(mechanism, start.state), 0, height)
    except VlmbError as error:  # a scene that cannot start has coordinates all the same
        lines.append(f"no start  {error}")
    names = mechanism.names
    rows = [[entry.name, names.meaning(entry), entry.unit, values[entry.name]] for entry in names.coordinates]
    return f"<div>{picture}{_text(chr(10).join(lines))}{_table(('coordinate', '', 'unit', 'start'), rows)}</div>"


def _picture(made: Scenery, ghosts: int, height: int) -> str:
    buffer = io.BytesIO()
    try:
        still(made, size=(height * 8 // 5, height), ghosts=ghosts).save(buffer, "PNG")
    except VlmbError:
        return ""  # without pillow the text must do
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f'<img alt="{html.escape(made.name, quote=True)}" src="data:image/png;base64,{data}">'


def _text(text: str) -> str:
    return f"<pre>{html.escape(text)}</pre>"


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def line(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    body = "".join(line(row, "td") for row in rows)
    made = f"<table><thead>{line(columns, 'th')}</thead><tbody>{body}</tbody></table>"
    return made if len(rows) <= ROWS else f"<details><summary>{len(rows)} coordinates</summary>{made}</details>"
