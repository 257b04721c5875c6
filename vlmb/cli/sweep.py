"""vlmb sweep: a scene many times."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from vlmb.errors import StudyError, VlmbError
from vlmb.model.names import counted
from vlmb.scene.scene import load_scene
from vlmb.studies.sampling import METHODS, sample
from vlmb.studies.sweep import sweep

WHAT = "simulate a scene many times and write a table of results"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Describe what the command takes."""
    parser.add_argument("scene", help="scene file (.toml)")
    parser.add_argument(
        "--vary", action="append", default=[], metavar="KEY=VALUES", required=True,
        help="values of a key: LOW:HIGH:COUNT or A,B,C, e.g. links.legs.lower.stiffness=8e3:16e3:9; with --sample LOW:HIGH",
    )  # fmt: skip
    parser.add_argument(
        "--keep", nargs="+", action="extend", default=[], metavar="NAME:REDUCTION",
        help="last, first, min, max, absmax, mean or rms of a quantity, e.g. psi1:last knife_edge:absmax",
    )  # fmt: skip
    parser.add_argument("--histories", nargs="+", default=[], metavar="NAME", help="quantities whose samples over time are kept")
    parser.add_argument("--sample", choices=METHODS, help="spread the runs over the ranges instead of a grid")
    parser.add_argument("--runs", type=int, default=256, help="number of runs with --sample (default: 256)")
    parser.add_argument("--seed", type=int, default=0, help="seed of --sample (default: 0)")
    parser.add_argument("-o", "--output", type=Path, default=None, help="folder (default: results/NAME_sweep)")
    parser.add_argument("--workers", type=int, help="threads (default: the processors of this machine)")
    parser.add_argument("--dask", metavar="ADDRESS", help="scheduler of a Dask cluster, e.g. tcp://10.0.0.1:8786")
    parser.add_argument("--resume", action="store_true", help="continue the study in the output folder")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def execute(args: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if args.workers is not None and args.workers < 1:
        raise VlmbError(f"--workers {args.workers}: must be at least 1")
    scene, pairs = load_scene(args.scene), [_pair(text) for text in args.vary]
    vary: Any = {key: _values(key, text) for key, text in pairs}
    if args.sample:
        vary = sample(args.sample, {key: _range(key, text) for key, text in pairs}, runs=args.runs, seed=args.seed)
    output = args.output or Path("results") / f"{Path(args.scene).stem}_sweep"
    client = _client(args.dask) if args.dask else None
    try:
        with tqdm(unit="run", disable=args.quiet or None) as bar:

            def tell(done: int, total: int) -> None:
                bar.total = total
                bar.update(done - bar.n)

            table = sweep(
                scene, vary, args.keep, args.histories, output, client, workers=args.workers, resume=args.resume, progress=tell
            )
    finally:
        if client is not None:
            client.close()
    states, counts = np.unique(table["status"].values, return_counts=True)
    shares = ", ".join(f"{n} {what}" for what, n in zip(states, counts, strict=True))
    print(f"{scene.name}: {counted(int(counts.sum()), 'run')}: {shares}")
    for name in table.data_vars:
        values = table[name].values
        if values.dtype.kind == "f":
            known = values[np.isfinite(values)]
            shown = f"{known.min():.6g} to {known.max():.6g}, mean {known.mean():.6g}" if known.size else "not known in any run"
            print(f"  {name:<24s} {shown}")
    failed = table["message"].values[table["status"].values == "failed"]
    if failed.size:
        print(f"  {'failed':<24s} {counted(failed.size, 'run')}, the first: {failed.flat[0]}")
    doubtful = int((table["doubts"].values != "").sum())
    if doubtful:
        print(f"  DOUBTFUL                 {counted(doubtful, 'run')}: see `doubts` in the table")
    print(f"wrote {output / 'table.nc'}")
    return int(failed.size == table["status"].size)


def _pair(text: str) -> tuple[str, str]:
    key, equals, values = text.partition("=")
    if not (key and equals and values):
        raise VlmbError(f"--vary {text}: must be KEY=LOW:HIGH:COUNT or KEY=A,B,C")
    return key, values


def _values(key: str, text: str) -> list[Any]:
    """Read values: LOW:HIGH:COUNT, or A,B,C; what is no number is a text."""
    parts = text.split(":")
    if len(parts) == 3:
        try:
            return [float(value) for value in np.linspace(float(parts[0]), float(parts[1]), int(parts[2]))]
        except ValueError:
            raise VlmbError(f"--vary {key}={text}: must be LOW:HIGH:COUNT, such as 8e3:16e3:9") from None
    return [_number(value) for value in text.split(",")]


def _range(key: str, text: str) -> tuple[float, float]:
    try:
        low, high = (float(value) for value in text.split(":")[:2])
    except ValueError:
        raise VlmbError(f"--vary {key}={text}: --sample needs LOW:HIGH") from None
    return low, high


def _number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


def _client(address: str) -> Any:
    """Connect to a Dask cluster."""
    try:
        distributed = importlib.import_module("distributed")
    except ImportError:
        raise StudyError("--dask: needs the extra dask: pip install vlmb[dask]") from None
    try:
        return distributed.Client(address, timeout="10s")
    except OSError as error:
        raise StudyError(f"--dask {address}: no scheduler answers at this address: {error}") from None
