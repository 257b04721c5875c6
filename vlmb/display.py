"""Rich display: a notebook that shows a mechanism or a trajectory asks the module `notebook`, which is imported only then."""

from __future__ import annotations

import importlib


class Displayed:
    """Something that notebooks show as a picture with a table."""

    def _repr_html_(self) -> str:
        # By name, against the order of imports: so the engine knows nothing of pictures.
        return str(importlib.import_module("vlmb.notebook").card(self))
