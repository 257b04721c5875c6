"""Rich display: what a notebook shows of a mechanism or a trajectory is made further down the house, and told here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Displayed:
    """Something that notebooks show as a picture with a table, made by `card`; without one by its short text."""

    card: Callable[[Any], str] | None = None  # set once, by the package itself: so the engine knows nothing of pictures

    def _repr_html_(self) -> str | None:
        return None if Displayed.card is None else Displayed.card(self)
