"""Many runs: equal bit for bit wherever they are computed, in little memory, killed at random moments; and many fits."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.studies.test_sensitivities import STIFFNESS, bouncing, measured

pytestmark = pytest.mark.acceptance

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "models" / "one_link.toml"
RANGES = {"links.arm.lower.stiffness": (250.0, 350.0), "start.phi1_dot": (2.0, 3.0), "start.psi1": (-0.5, -0.3)}
RUNS, KILLED, MEMORY = 10_000, 4_000, 500.0  # [MB] above idle
KEEP = ["psi1:last", "xi1_1:rms", "energy:max"]


def scene() -> vlmb.Scene:
    return vlmb.load_scene(MODEL).changed(run={"duration": 1.0})


def runs(count: int) -> Any:
    return vlmb.sample("sobol", RANGES, runs=count, seed=7)


def test_ten_thousand_runs_are_equal_bit_for_bit_in_line_in_threads_and_in_processes() -> None:
    serial = vlmb.sweep(scene(), runs(RUNS), KEEP, workers=1)
    assert set(serial["status"].values.tolist()) == {"finished"}
    threads = vlmb.sweep(scene(), runs(RUNS), KEEP, workers=4)
    with ProcessPoolExecutor(2) as pool:
        processes = vlmb.sweep(scene(), runs(RUNS), KEEP, executor=pool)
    for other in (threads, processes):
        assert other.attrs["digest"] == serial.attrs["digest"] and other.identical(serial)


def test_ten_thousand_runs_are_the_same_on_a_cluster() -> None:
    distributed = pytest.importorskip("distributed")
    serial = vlmb.sweep(scene(), runs(RUNS), KEEP, workers=1)
    with _cluster(distributed) as cluster, distributed.Client(cluster) as client:
        assert vlmb.sweep(scene(), runs(RUNS), KEEP, executor=client).identical(serial)


def test_intervals_of_two_hundred_fits_cover_the_truth() -> None:
    truth, sigma, keys = bouncing(), 0.005, {"links.legs.lower.stiffness": (100.0, 900.0), "start.xi1_1": (0.15, 0.6)}
    off = [(450.0, 0.175), (150.0, 0.525), (450.0, 0.525)]  # by 50 %
    rough = [truth.changed_at({**dict(zip(keys, values, strict=True)), "run.rtol": 1e-6, "run.atol": 1e-8}) for values in off]
    covered, count = np.zeros(2), 200
    for seed in range(count):
        found = vlmb.fit(rough[seed % 3], keys, measured(seed, truth, sigma), {"legs.tip.z": sigma} if seed % 2 else None)
        covered += [low <= value <= high for (low, high), value in zip(found.intervals.values(), (STIFFNESS, 0.35), strict=True)]
    print(f"95 % intervals cover {covered / count}")
    assert (covered >= 0.9 * count).all() and (covered <= 0.99 * count).all()


PARENT = """
import re, sys, vlmb
from tests.acceptance.test_studies import KEEP, RUNS, runs, scene

def most():
    return int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) / 1024

vlmb.sweep(scene(), runs(16), KEEP)
idle = most()
vlmb.sweep(scene(), runs(RUNS), KEEP)
print(most() - idle)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc here")
def test_ten_thousand_runs_take_little_memory() -> None:
    command = [sys.executable, "-c", PARENT]
    found = subprocess.run(command, cwd=ROOT, env=_environment(), capture_output=True, text=True, check=True)
    print(f"{float(found.stdout):.0f} MB above idle")
    assert float(found.stdout) < MEMORY


CLIENT = """
import os, sys
import vlmb
from tests.acceptance.test_studies import KEEP, KILLED, runs, scene

where, log, address = sys.argv[1:4]

def logged(run):
    file = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(file, b"%.17g\\n" % run["psi1"][0])
    os.close(file)
    return 0.0

executor = None
if address:
    from distributed import Client
    executor = Client(address)
workers = 2 if executor is None else None
keep = {**{name: name for name in KEEP}, "logged": logged}
print(vlmb.sweep(scene(), runs(KILLED), keep, output=where, executor=executor, workers=workers, resume=True).attrs["digest"])
"""


@pytest.mark.parametrize("where", ["threads", "cluster"])
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
def test_killed_at_random_moments_a_study_ends_the_same(where: str, tmp_path: Path) -> None:
    if where == "threads":
        _killed(tmp_path, "", None)
        return
    distributed = pytest.importorskip("distributed")
    with _cluster(distributed) as cluster:
        _killed(tmp_path, cluster.scheduler_address, cluster)


def _killed(folder: Path, address: str, cluster: Any) -> None:
    """Kill the client at ten random moments, and a worker before half of them; then let it end.

    At most the shard that each worker was at is computed again, by each kill.
    """
    keep: dict[str, Any] = {**{name: name for name in KEEP}, "logged": lambda run: 0.0}
    whole = vlmb.sweep(scene(), runs(KILLED), keep, workers=1)
    log, said, chance = folder / "log", folder / "said", random.Random(11)
    for kill in range(11):
        command = [sys.executable, "-c", CLIENT, str(folder / "study"), str(log), address]  # two workers
        with said.open("w") as told:
            process = subprocess.Popen(command, cwd=ROOT, env=_environment(), stdout=told)
        if kill < 10:
            _wait_for_more(folder, process, chance.randint(1, 6))
            time.sleep(0.05 * chance.random())
            if cluster is not None and kill % 2:
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
                _wait_for_more(folder, process, 2)
            process.kill()
        assert process.wait(600) == (0 if kill == 10 else -signal.SIGKILL)
        lines, shards = len(log.read_text().splitlines()), len(list(folder.glob("study/shard-*.npz")))
        print(f"after kill {kill}: {shards} shards, {lines} runs computed")
    again = len(log.read_text().splitlines()) - KILLED
    each = -(-KILLED // len(list(folder.glob("study/shard-*.npz"))))
    print(f"{again} runs were computed again, {again / each:.1f} shards of {each}")
    assert said.read_text().strip() == whole.attrs["digest"]
    assert again <= (10 * 2 + 5 * (cluster is not None)) * each


def _wait_for_more(folder: Path, process: subprocess.Popen[bytes], count: int) -> None:
    """Wait until some more shards are done."""
    there, until = len(list(folder.glob("study/shard-*.npz"))), time.monotonic() + 120.0
    while len(list(folder.glob("study/shard-*.npz"))) < there + count and process.poll() is None and time.monotonic() < until:
        time.sleep(0.005)


def _cluster(distributed: Any) -> Any:
    return distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0")


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
