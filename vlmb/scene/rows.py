"""Rows: the equations of a scene and the names they go by in residuals, reactions, plots and summaries."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from vlmb.errors import SceneError
from vlmb.scene.tables import ALLOWED_NAME, MAX_NAME, NAME

if TYPE_CHECKING:
    from vlmb.scene.tables import SceneTables


class Row(NamedTuple):
    """An equation by name: "course: tan(phi0) = A*k" is `course`; without a name the stripped text is its key."""

    name: str
    equation: str
    key: str  # where it stands in the scene: constraints[0]

    @property
    def named(self) -> bool:
        """Whether the scene gives it a name."""
        return self.name != self.equation


class SceneRows(NamedTuple):
    """All rows of a scene."""

    ideal: tuple[Row, ...]
    servo: tuple[Row, ...]  # of the programme
    secondary: tuple[Row, ...]


def read_row(text: str, key: str) -> Row:
    """Split the name, a word before the first colon, from an equation. Raises SceneError where it is no name."""
    name, colon, equation = text.partition(":")
    if not colon or "=" in name or equation.startswith("="):  # a colon elsewhere is refused with the equation
        return Row(text.strip(), text.strip(), key)
    name = name.strip()
    if not re.fullmatch(NAME, name) or len(name) > MAX_NAME:
        raise SceneError(f"{key} = {text!r:.120}: what stands before the colon names the row: {ALLOWED_NAME}")
    return Row(name, equation.strip(), key)


def rows_of(scene: SceneTables) -> SceneRows:
    """Return the rows of a scene, in its order."""
    own = [("programme", scene.programme)] if scene.programme else []
    programmes = [*own, *((f"programmes[{k}]", each) for k, each in enumerate(scene.programmes))]
    servo = [(f"{key}.constraints[{k}]", text) for key, each in programmes for k, text in enumerate(each.constraints)]
    second = [(f"{key}.secondary[{k}]", text) for key, each in programmes for k, text in enumerate(each.secondary)]
    ideal = [(f"constraints[{k}]", text) for k, text in enumerate(scene.constraints)]
    found = [[read_row(text, key) for key, text in group] for group in (ideal, servo, second)]
    if scene.programmes:  # a row of two phases is one row
        found[1:] = [list({(row.name, row.equation): row for row in reversed(group)}.values())[::-1] for group in found[1:]]
    return SceneRows(*map(tuple, found))
