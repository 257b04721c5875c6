"""The models that come with vlmb: scene files beside the package, each with a short name."""

from __future__ import annotations

import os
import re
from pathlib import Path

from vlmb.errors import SceneError, nearest

PACKAGE = Path(__file__).resolve().parents[1]
ROW = re.compile(r"^\| `(\w+)\.toml` \| (.+?) \|", re.M)


def model_folder() -> Path:
    """Return where the models are: inside an installed package, beside it where vlmb runs from its sources.

    Raises SceneError where neither has them.
    """
    for folder in (PACKAGE.parent / "models", PACKAGE / "models"):
        if (folder / "README.md").is_file() and (folder / "one_link.toml").is_file():
            return folder
    raise SceneError(f"the models that come with vlmb are not in {PACKAGE / 'models'}: install vlmb again")


def model_names() -> list[str]:
    """Return the names of all models, in order."""
    return sorted(path.stem for path in model_folder().glob("*.toml"))


def model_lines() -> dict[str, str]:
    """Return what each model shows, in a line, by its name; as the table of their README has it, in its order."""
    said = ROW.findall((model_folder() / "README.md").read_text(encoding="utf-8"))
    return {name: text.replace("`", "") for name, text in said}


def model_file(name: str) -> Path:
    """Return the file of a model by its name, or by the end of it where no other ends so: `slalom` is `skier_slalom`.

    Raises SceneError naming the nearest ones.
    """
    names = model_names()
    found = [name] if name in names else [entry for entry in names if entry.endswith(f"_{name}")]
    if len(found) == 1:
        return model_folder() / f"{found[0]}.toml"
    several = " or ".join(map(repr, found))
    hint = f"several models end so: {several}" if found else nearest(name, names)
    raise SceneError(f"{name}: no such scene file and no model of that name; {hint} (`vlmb models` lists them)")


def scene_file(path: str | os.PathLike[str]) -> Path:
    """Return the scene file that is meant: a file where there is one, otherwise the model that a bare word names.

    Raises SceneError where a bare word names none.
    """
    file = Path(path)
    return model_file(str(path)) if re.fullmatch(r"\w{1,64}", str(path)) and not file.exists() else file
