"""Many runs of one scene: on the threads of this machine, an executor or a cluster, as a table."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import queue
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from vlmb._version import __version__
from vlmb.errors import SceneError, StudyError, VlmbError
from vlmb.model.mechanism import build
from vlmb.model.names import force_unit
from vlmb.scene.names import ENERGIES, SNOW
from vlmb.scene.rows import rows_of
from vlmb.scene.scene import Scene, as_scene
from vlmb.simulation.trajectory import versions
from vlmb.studies.ensemble import Shard, Task, ensemble_of, run_shard
from vlmb.studies.folder import StudyFolder
from vlmb.studies.packages import need
from vlmb.studies.reductions import Kept, kept_of, require_known
from vlmb.studies.variation import Variation, variation_of
from vlmb.system.system import make_system

SHARDS, LARGEST = 100, 250  # shards of a study, and runs in one, about
AHEAD = 4  # shards a worker that are given out before they are wanted


def sweep(
    scene: Scene | str | Path | Mapping[str, Any],
    vary: Any,
    keep: Mapping[str, str | Callable[..., float]] | Sequence[str] | None = None,
    histories: Sequence[str] = (),
    output: str | Path | None = None,
    executor: Any = None,
    *,
    workers: int | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Any:
    """Simulate a scene many times and return what is kept as an xarray.Dataset.

    Every run is `simulate(scene.changed_at(values))`, bit for bit, wherever it is computed. One that fails is a row with its
    `status` and `message`; `doubts` are those of the trajectory.

    Parameters
    ----------
    scene : a Scene, the path of a scene file or a dict with its keys
    vary : {key path: values} for a grid, whose dimensions are the keys; or a DataFrame (`vlmb.sample`) with a column for each key
        and a row for each run, whose dimension is `run`
    keep : {name: "QUANTITY:reduction"}, one of last, first, min, max, absmax (of the size), mean, rms (over time); or a function
        of the trajectory that returns a number; or a list of the first kind. Quantities are all that a trajectory knows by name,
        controls, reactions and residual:NAME. Of a run that stops early they are those of the part until then
    histories : names whose samples are kept, over the dimension t; nan after the end of a run that stops early
    output : folder for study.json, shards of the runs and table.nc
    executor : None takes threads of this machine (`workers`, default: its processors), 1 of them this one; any
        concurrent.futures.Executor, or a dask.distributed.Client
    resume : go on with the study in `output`: what is there is not computed again
    progress : called with the runs that are done and all

    Raises SceneError for wrong keys or names, StudyError where `output` has another study, or none of `studies` is installed.
    """
    need("xarray")
    scene = as_scene(scene)
    variation, kept, histories = variation_of(scene, vary), kept_of(keep), tuple(histories)
    _require_names(scene, kept, histories)
    study = {
        "scene": scene.to_dict(), "vary": variation.as_data(), "keep": {entry.name: entry.told for entry in kept},
        "histories": list(histories), "vlmb": __version__,
    }  # fmt: skip
    digest = hashlib.sha256(_as_json(study).encode()).hexdigest()
    task = Task(scene, variation.keys, kept, histories, digest)
    times = ensemble_of(task).times
    if histories and not len(times):
        raise SceneError("histories: runs of different lengths share no samples; do not vary run.duration or run.samples")
    each = min(max(-(-len(variation) // SHARDS), 1), LARGEST)
    folder = None
    if output is not None:
        about = {"shard": each, "runs": len(variation), "seed": variation.seed, "versions": versions()}
        folder = StudyFolder(Path(output), study, digest, about, resume)
        each = folder.each
    elif resume:
        raise SceneError("resume: give the folder of the study, output = 'results/sweep'")
    rows = variation.rows()
    shards: dict[int, Shard] = {}
    parts = [rows[first : first + each] for first in range(0, len(rows), each)]
    for index, part in enumerate(parts):
        found = folder.read(index, (len(kept), len(part)), (len(histories), len(part), len(times))) if folder else None
        if found is not None:
            shards[index] = found
    done = sum(len(parts[index]) for index in shards)
    missing = {index: part for index, part in enumerate(parts) if index not in shards}
    for index, shard in _computed(task, missing, executor, workers, folder):
        if folder is not None:
            folder.write(index, shard)
        shards[index] = shard
        done += len(parts[index])
        if progress is not None:
            progress(done, len(rows))
    table = _table(scene, variation, task, times, [shards[index] for index in range(len(parts))])
    if folder is not None:
        folder.write_table(table)
    return table


def _as_json(study: Mapping[str, Any]) -> str:
    try:
        return json.dumps(study, sort_keys=True)
    except TypeError as error:
        raise SceneError(f"vary: values must be numbers, texts, lists or tables: {error}") from None


def _require_names(scene: Scene, kept: Sequence[Kept], histories: Sequence[str]) -> None:
    """Refuse quantities that no run has, before there is one."""
    mechanism = build(scene)
    names = {*mechanism.names.known, *mechanism.signals}

    def others() -> list[str]:
        snow = [*SNOW, "friction", "knife_edge"] if scene.on_snow else []
        rows = rows_of(scene)
        return list(dict.fromkeys([*snow, *(row.name for row in (*rows.ideal, *rows.servo)), *make_system(mechanism).work_names]))

    class Known:
        """Names of quantities, with a hint for those that are none."""

        def __contains__(self, name: object) -> bool:
            return name in names or name in mechanism.names

        def hint(self, name: str) -> str:
            return mechanism.names.hint(name)

    require_known(kept, histories, Known(), others)


def _computed(
    task: Task, missing: Mapping[int, Sequence[Any]], executor: Any, workers: int | None, folder: StudyFolder | None
) -> Iterator[tuple[int, Shard]]:
    """Yield shards as they are done."""
    count = workers or _processors()
    if not missing:
        return
    if executor is None and (count == 1 or len(missing) == 1):
        for index, part in missing.items():
            yield index, run_shard(task, part)
        return
    with _pool(executor, count) as pool:

        def ahead() -> int:
            """Return how many shards are given out at once; a cluster may grow, and what waits in a worker is lost with it."""
            if _is_dask(executor):
                return max(_workers_of(executor), 1)
            return AHEAD * (count if executor is None else max(_workers_of(executor), count))

        yield from _given_out(task, missing, pool, ahead, folder)


def _given_out(
    task: Task, missing: Mapping[int, Sequence[Any]], pool: Any, ahead: Callable[[], int], folder: StudyFolder | None
) -> Iterator[tuple[int, Shard]]:
    """Give shards to a pool, some ahead of those that are done, and yield these."""
    finished: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()
    options = {"pure": False} if _is_dask(pool) else {}
    waiting, under_way = iter(missing.items()), dict[int, Any]()

    def give() -> None:
        for index, part in itertools.islice(waiting, max(ahead() - len(under_way), 0)):
            future = under_way[index] = pool.submit(run_shard, task, part, **options)
            future.add_done_callback(lambda done, index=index: finished.put((index, done)))

    try:
        give()
        while under_way:
            index, future = finished.get()
            del under_way[index]
            yield index, Shard(*future.result())
            give()
    except (VlmbError, OSError):
        raise
    except Exception as error:
        kept = f"; what is done is in {folder.path}, and resume = True goes on" if folder else ""
        raise StudyError(f"sweep: a worker failed: {type(error).__name__}: {error}{kept}") from error
    finally:
        for future in under_way.values():
            future.cancel()


@contextmanager
def _pool(executor: Any, count: int) -> Iterator[Any]:
    """Return the executor that is given; threads of our own otherwise, which end here."""
    if executor is not None:
        if not callable(getattr(executor, "submit", None)):
            raise SceneError(f"executor = {executor!r:.80}: must be a concurrent.futures.Executor or a dask.distributed.Client")
        yield executor
        return
    with ThreadPoolExecutor(count, "vlmb-sweep") as pool:
        try:
            yield pool
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _is_dask(executor: Any) -> bool:
    """Whether shards are computed by the workers of a cluster, which keep what is done until it is asked for."""
    return type(executor).__module__.startswith("distributed")


def _workers_of(executor: Any) -> int:
    """How many shards an executor computes at once, as far as it tells."""
    threads = getattr(executor, "nthreads", None)
    return sum(threads().values()) if callable(threads) else int(getattr(executor, "_max_workers", 1))


def _processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _table(scene: Scene, variation: Variation, task: Task, times: Any, shards: Sequence[Shard]) -> Any:
    """Put shards together: variables over the dimensions of the variation, histories over t as well."""
    xarray = need("xarray")
    shape, dims, names = variation.shape, variation.dimensions, build(scene).names
    numbers = np.concatenate([shard.numbers for shard in shards], axis=1)
    variables: dict[str, Any] = {}
    for entry, values in zip(task.kept, numbers, strict=True):
        variables[entry.name] = (dims, values.reshape(shape), _about(names, entry.quantity) if entry.function is None else {})
    for j, name in enumerate(task.histories):
        values = np.concatenate([shard.histories[j] for shard in shards])
        variables[name] = ((*dims, "t"), values.reshape(*shape, len(times)), _about(names, name))
    hasher = hashlib.sha256(numbers.tobytes())
    for shard in shards:
        hasher.update(shard.histories.tobytes())
    for what in ("status", "message", "doubts"):
        texts = [text for shard in shards for text in getattr(shard, what)]
        variables[what] = (dims, np.array(texts, dtype=str).reshape(shape))
        hasher.update("\0".join(texts).encode())
    coordinates: dict[str, Any] = {} if variation.grid else {dims[0]: np.arange(len(variation))}
    for key, axis in zip(variation.keys, variation.axes, strict=True):
        coordinates[key] = (key if variation.grid else dims[0], _coordinate(axis))
    if task.histories:
        coordinates["t"] = ("t", times, {"units": "s"})
    about = {"scene": scene.name, "study": task.digest, "digest": hasher.hexdigest(), "vlmb": __version__}
    return xarray.Dataset(variables, coordinates, about)


def _about(names: Any, quantity: str) -> dict[str, str]:
    """Return the unit of a quantity, where it is known."""
    if quantity in names:
        return {"units": names.find(quantity).unit}
    if quantity in ENERGIES:
        return {"units": "J"}
    if quantity in SNOW:
        return {"units": SNOW[quantity]}
    return {"units": "s"} if quantity == "t" else {"units": force_unit(quantity)} if quantity[:2] in ("F_", "M_", "T_") else {}


def _coordinate(axis: Sequence[Any]) -> Any:
    """Return values along a dimension: numbers, or texts of what is none."""
    plain = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in axis)
    if plain:
        return np.array(axis, float)
    return np.array([value if isinstance(value, str) else json.dumps(value) for value in axis])
