"""The folder of a study: study.json, a file for each shard, written by rename, and the table at the end. No pickles."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vlmb.errors import StudyError
from vlmb.simulation.files import replacing, write_text
from vlmb.studies.ensemble import Shard

FORMAT = 1
STUDY, TABLE = "study.json", "table.nc"
PARTS = {"scene": "scene", "vary": "variation", "keep": "reductions", "histories": "histories", "vlmb": "version of vlmb"}


class StudyFolder:
    """Where a study is kept. `sizes`: numbers, histories and samples of a run; `count` runs, `each` a shard."""

    def __init__(self, path: Path, study: Mapping[str, Any], digest: str, about: Mapping[str, Any], resume: bool) -> None:
        self.path, self.digest = path, digest
        self.each = int(about["shard"])
        note = path / STUDY
        if note.exists():
            found = _read(note)
            if not resume:
                raise StudyError(
                    f"{path}: has a study already; resume = True (--resume) goes on with it, or choose another folder"
                )
            if found.get("digest") != digest:
                raise StudyError(f"{path}: has another study ({_difference(found.get('study'), study)}); choose another folder")
            self.each = int(found["shard"])
            return
        path.mkdir(parents=True, exist_ok=True)
        write_text(note, json.dumps({"format": FORMAT, "digest": digest, **about, "study": study}, indent=1) + "\n")

    def shard_path(self, index: int) -> Path:
        """Return the file of a shard."""
        return self.path / f"shard-{index:06d}.npz"

    def write(self, index: int, shard: Shard) -> None:
        """Write a shard, whole or not at all. Raises OutputError."""
        texts = {name: np.array(getattr(shard, name), dtype=str) for name in ("status", "message", "doubts")}
        with replacing(self.shard_path(index)) as beside, beside.open("wb") as file:
            arrays = {"digest": np.array(self.digest), "numbers": shard.numbers, "histories": shard.histories}
            np.savez(file, allow_pickle=False, **arrays, **texts)

    def read(self, index: int, numbers: tuple[int, ...], histories: tuple[int, ...]) -> Shard | None:
        """Return a shard of these shapes; None where there is none, or a damaged one: it is computed again."""
        path = self.shard_path(index)
        if not path.exists():
            return None
        try:
            with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                if str(file["digest"]) != self.digest:
                    return None
                texts = [tuple(file[name].tolist()) for name in ("status", "message", "doubts")]
                shard = Shard(file["numbers"], file["histories"], *texts)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            return None
        fits = shard.numbers.shape == numbers and shard.histories.shape == histories
        return shard if fits and all(len(text) == numbers[1] for text in texts) else None

    def write_table(self, table: Any) -> Path:
        """Write the table as NetCDF; a slash, which names may not have there, becomes `per`."""
        table = table.rename({name: name.replace("/", " per ") for name in table.variables if "/" in name})
        with replacing(self.path / TABLE) as beside:
            table.to_netcdf(beside, engine="scipy", format="NETCDF3_64BIT")
        return self.path / TABLE


def _read(note: Path) -> dict[str, Any]:
    try:
        found = json.loads(note.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StudyError(f"{note}: cannot be read: {error}") from None
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise StudyError(f"{note}: not a study of this version of vlmb")
    return found


def _difference(there: Any, here: Mapping[str, Any]) -> str:
    """Say in which parts two studies differ."""
    other = there if isinstance(there, dict) else {}
    plain = json.loads(json.dumps(here))
    return "another " + " and another ".join(what for part, what in PARTS.items() if other.get(part) != plain.get(part))
