"""The examples run, say what they promise, and are short enough to be read at once."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
LONGEST = 40  # lines


def said(name: str, folder: Path) -> str:
    """Run an example in an empty folder; return what it prints."""
    known = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error", "MPLBACKEND": "agg"}
    words = [sys.executable, str(ROOT / "examples" / f"{name}.py")]
    done = subprocess.run(words, cwd=folder, env=known, capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_a_measured_slalom_is_followed(tmp_path: Path) -> None:
    text = said("measured_slalom", tmp_path)
    assert "finished at t = 6 s" in text
    off = {name: float(value) for name, value in re.findall(r"^(\w+) .* within (\S+)$", text, re.M)}
    assert off["xi1_1"] < 1e-3  # [m] errors of the recording, which are smoothed
    assert off["F1_1"] < 30.0 and off["M_psi1"] < 5.0


def test_a_walker_needs_almost_the_speed_of_a_point_mass(tmp_path: Path) -> None:
    least, rigid = map(float, re.findall(r"(\d\.\d+) rad/s", said("walker", tmp_path)))
    assert least == pytest.approx(rigid, rel=0.1)


def test_a_crane_that_takes_its_time_leaves_its_load_at_rest(tmp_path: Path) -> None:
    text = said("crane", tmp_path)
    sways = [float(value) for value in re.findall(r" s +(\d\.\d+) m", text)]
    assert len(sways) == 20 and max(sways) == sways[0] > 4.0 and min(sways) < 0.15
    best, period = map(float, re.findall(r"in (\d+\.\d) s", text))
    assert 2.0 * period < best < 3.0 * period
    least, most = map(int, re.search(r"carries (\d+) to (\d+) N", text).groups())
    assert least < 800.0 * 9.81 < most  # the load's weight


def test_each_is_short_and_tested() -> None:
    tested = Path(__file__).read_text(encoding="utf-8")
    for path in EXAMPLES:
        assert len(path.read_text(encoding="utf-8").splitlines()) < LONGEST, path.name
        assert f'said("{path.stem}"' in tested, f"{path.name} has no test"
        assert f"examples/{path.name}" in (ROOT / "docs" / "index.md").read_text(encoding="utf-8"), path.name
