"""The promises of docs/promises.md, attacked at length: `scripts/acceptance -k promises` keeps the counts."""

from __future__ import annotations

import functools
import json
import signal
import warnings
from collections import Counter
from pathlib import Path

import pytest

import vlmb
from tests.acceptance.promises import keep, table
from tests.damaging import MEGABYTES, SECONDS, damaged_run, damaged_scene, judged, look_at_run, look_at_scene, stored_runs
from tests.interrupting import PHASED, SHORT, interrupted_at, last_passes, lines_of, moments, require_kept, signalled
from tests.simulation.test_side_by_side import MANY, one, same
from tests.small_scenes import PIVOT, bent, write_toml
from vlmb.cli import main

DOCS = Path(__file__).resolve().parents[2] / "docs"
COMMAND = ["run", "short.toml", "--no-plots", "--quiet", "-o", "out"]


def test_counts_are_kept_beside_each_other(tmp_path: Path) -> None:
    keep(tmp_path, "scenes", 3, {"refused": 2, "read": 1})
    keep(tmp_path, "lines", 5, {"kept": 5})
    text = (tmp_path / "promises.md").read_text(encoding="utf-8")
    assert text.splitlines()[2:] == [
        "| Ctrl-C at every line of a short run's code, each time that it is passed | 5 | 5 kept |",
        "| damaged or malicious scenes | 3 | 2 refused, 1 read |",
    ]


def test_the_page_shows_what_was_counted() -> None:
    known = json.loads((DOCS / "acceptance" / "promises.json").read_text(encoding="utf-8"))
    assert (DOCS / "acceptance" / "promises.md").read_text(encoding="utf-8") == table(known)
    assert known["runs"]["tried"] >= 300 and known["scenes"]["tried"] >= 300 and known["lines"]["tried"] > 5000
    assert "<!-- promises -->" in (DOCS / "promises.md").read_text(encoding="utf-8")


@pytest.mark.acceptance
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")  # between the last line of a `with` and its end
@pytest.mark.parametrize("what", ["lines", "phases"])
def test_promises_an_interrupt_at_every_line(
    what: str, results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One process, many runs of hundredths of a second; of the plain one every pass of every line."""
    monkeypatch.chdir(tmp_path)
    write_toml(tmp_path / "short.toml", SHORT if what == "lines" else PHASED)
    assert main([*COMMAND, "--duration", "0.1"]) == 0
    earlier = (tmp_path / "out" / "run.npz").read_bytes()
    lines = lines_of(COMMAND)
    found: Counter[str] = Counter()
    numbers = list(range(1, len(lines) + 1)) if what == "lines" else last_passes(lines)
    for number in numbers:
        (tmp_path / "out" / "run.npz").write_bytes(earlier)
        try:
            outcome = interrupted_at(number, COMMAND, capsys)
        except KeyboardInterrupt:  # before the command looks for it, or after all is written
            vlmb.load_trajectory(tmp_path / "out" / "run.npz")
            found["before or after the command itself, earlier or new result whole"] += 1
            continue
        require_kept(tmp_path / "out", earlier, outcome)
        kept = (tmp_path / "out" / "run.npz").read_bytes() != earlier
        found["the new run kept" if kept else "before the first sample, the earlier result whole"] += 1
    keep(results, what, len(numbers), found)


@pytest.mark.acceptance
def test_promises_signals_at_any_moment(results: Path, tmp_path: Path) -> None:
    found: Counter[str] = Counter()
    out = tmp_path / "out"
    out.mkdir()
    earlier = vlmb.simulate(bent(PIVOT, 1), duration=0.1).save(out / "run.npz").read_bytes()
    for sent, after in moments(40, seed=1):
        (out / "run.npz").write_bytes(earlier)
        process, stdout, _ = signalled(tmp_path, sent, after)
        run = vlmb.load_trajectory(out / "run.npz")
        assert process.returncode in (1, 130, -signal.SIGINT, -signal.SIGTERM) and not list(out.glob(".vlmb-*"))
        if (out / "run.npz").read_bytes() != earlier:
            assert run.status == "interrupted" and "interrupted at t =" in stdout and len(run) > 0.9 * 1000 * run.t[-1] / 40.0
            found["the new run kept"] += 1
        else:
            found["before the first sample, the earlier result whole"] += 1
    keep(results, "signals", 40, found)


@pytest.mark.acceptance
@pytest.mark.parametrize("what", ["runs", "scenes"])
def test_promises_damaged_files(what: str, results: Path, tmp_path: Path) -> None:
    """Three hundred of each."""
    found: Counter[str] = Counter()
    slowest = most = 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        runs = stored_runs(tmp_path)
        for path in runs:
            look_at_run(path)
        for seed in range(1000, 1300):
            if what == "runs":
                path = tmp_path / "damaged.npz"
                path.write_bytes(damaged_run(runs[seed % len(runs)], seed))
            else:
                path = damaged_scene(seed, tmp_path)
            look = functools.partial(look_at_run if what == "runs" else look_at_scene, path)
            said, seconds, megabytes = judged(look)
            if seconds > SECONDS:  # the first scene of its kind on a machine compiles
                said, seconds, megabytes = judged(look)
            assert seconds < SECONDS and megabytes < MEGABYTES, f"seed {seed}: {said}"
            found["refused by a named error" if said.startswith("refused") else "read as written"] += 1
            slowest, most = max(slowest, seconds), max(most, megabytes)
    keep(results, what, 300, {**found, "s at most": round(slowest, 2), "MB at most": round(most)})


@pytest.mark.acceptance
def test_promises_runs_side_by_side(results: Path) -> None:
    from concurrent.futures import ThreadPoolExecutor

    alone = [one(number) for number in range(MANY)]
    with ThreadPoolExecutor(MANY) as pool:
        found = list(pool.map(one, [*range(MANY)] * 10))
    equal = sum(same(run, alone[number % MANY]) for number, run in enumerate(found))
    keep(results, "threads", len(found), {"equal": equal})
    assert equal == len(found)
