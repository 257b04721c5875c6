"""What commands print of the files they wrote."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def wrote(files: Sequence[Path]) -> str:
    """List written files, many of one folder by their names."""
    folders = {file.parent for file in files}
    if len(files) < 4 or len(folders) > 1:
        return "wrote " + ", ".join(str(file) for file in files)
    return f"wrote into {folders.pop()}: " + ", ".join(file.name for file in files)
