"""Compiled kernels are kept once a machine and for one state of the core; other functions of a process keep their own place."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import pytest

from vlmb.core import cache, jit

ROOT = Path(__file__).resolve().parents[2]
kept_only = pytest.mark.skipif(not jit.COMPILED or jit.MODE == "bounds", reason="nothing is kept")
SCRIPT = """
import time
from vlmb.core.jit import kernel

@kernel
def twice(x):
    return 2.0 * x

assert twice(3.0) == 6.0
print(sum(twice.stats.cache_hits.values()))
"""


def start(script: Path, home: Path, **environment: str) -> subprocess.Popen[str]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    variables = os.environ | {"XDG_CACHE_HOME": str(home), "PYTHONPATH": path} | environment
    command, pipe = [sys.executable, str(script)], subprocess.PIPE
    return subprocess.Popen(command, env=variables, stdout=pipe, stderr=pipe, text=True)


@pytest.fixture
def script(tmp_path: Path) -> Path:
    path = tmp_path / "script.py"
    path.write_text(SCRIPT, encoding="utf-8")
    return path


@kept_only
def test_one_of_several_processes_compiles(script: Path, tmp_path: Path) -> None:
    processes = [start(script, tmp_path / "home") for _ in range(3)]
    texts = [process.communicate() for process in processes]
    assert [process.returncode for process in processes] == [0, 0, 0], texts
    assert sorted(out.strip() for out, _ in texts) == ["0", "1", "1"]
    told = [error.replace(f"{cache.WAITING}\n", "").strip() for _, error in texts]
    assert sorted(told) == ["", "", cache.ANNOUNCEMENT]
    (kept,) = (tmp_path / "home" / "vlmb").iterdir()
    assert kept.name == f"core-{cache.fingerprint()}"
    assert kept.stat().st_mode & 0o077 == 0


@kept_only
@pytest.mark.skipif(sys.platform == "win32", reason="no such locks")
def test_what_is_kept_waits_for_nobody_and_the_rest_says_so(script: Path, tmp_path: Path) -> None:
    import fcntl

    home = tmp_path / "home"
    start(script, home).communicate()
    (kept,) = (home / "vlmb").iterdir()
    other = tmp_path / "other.py"
    other.write_text(SCRIPT.replace("twice", "thrice").replace("2.0 * x", "3.0 * x").replace("6.0", "9.0"), encoding="utf-8")
    with (kept / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert start(script, home).communicate(timeout=60.0) == ("1\n", "")
        waits = start(other, home)
        assert waits.stderr is not None and waits.stderr.readline().strip() == cache.WAITING
        assert waits.poll() is None
    assert waits.communicate(timeout=60.0) == ("0\n", "")


NEGATIVE = """
import numpy as np
from vlmb.core.jit import inner, kernel

@inner
def part(x, i):
    return x[i]

@kernel
def entry(x, i):
    return part(x, i)

assert entry(np.arange(3.0), 2) == 2.0
try:
    entry(np.arange(3.0), -1)
except IndexError:
    print("found")
"""
BEYOND = """import sys
from script import kernel, twice
assert "numba.cpython.setobj" not in sys.modules

@kernel
def beyond(x):
    return twice(x) + 1.0

assert beyond(3.0) == 7.0
assert "numba.cpython.setobj" in sys.modules
"""


@kept_only
def test_what_is_kept_is_loaded_without_what_compiles_and_serves_what_is_compiled_later(script: Path, tmp_path: Path) -> None:
    home, caller = tmp_path / "home", tmp_path / "caller.py"
    caller.write_text("import script", encoding="utf-8")
    assert start(caller, home).communicate()[0] == "0\n"
    for text in (BEYOND, BEYOND.rsplit("assert", 1)[0]):  # compiled, then loaded itself
        caller.write_text(text, encoding="utf-8")
        assert start(caller, home).communicate() == ("1\n", "")


WITHIN = """
from script import kernel, twice
from vlmb.core.jit import inner

@inner
def part(x):
    return twice(x) + 1.0

@kernel
def outer(x):
    return part(x)

print(outer(1.0), twice(3.0), sum(twice.stats.cache_hits.values()))
"""


@kept_only
def test_a_kept_kernel_that_a_part_of_another_loads_can_be_called(script: Path, tmp_path: Path) -> None:
    script.write_text(SCRIPT.split("assert")[0], encoding="utf-8")
    home, caller = tmp_path / "home", tmp_path / "caller.py"
    caller.write_text("import script\nprint(script.twice(3.0))", encoding="utf-8")
    assert start(caller, home).communicate()[0] == "6.0\n"
    caller.write_text(WITHIN, encoding="utf-8")
    assert start(caller, home).communicate() == ("3.0 6.0 1\n", "")


COPIED = """
import numpy as np
from vlmb.core.dense import largest_entry

assert largest_entry(np.array([[1.0, -3.0]]), 1, 2) == 3.0
print(sum(largest_entry.stats.cache_hits.values()))
"""


@kept_only
def test_installations_of_the_same_sources_share_what_is_kept(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(COPIED, encoding="utf-8")
    for place, hits in (("one", "0"), ("other", "1")):
        shutil.copytree(ROOT / "vlmb", tmp_path / place / "vlmb", ignore=shutil.ignore_patterns("__pycache__"))
        process = start(script, tmp_path / "home", PYTHONPATH=str(tmp_path / place))
        assert process.communicate()[0] == f"{hits}\n"


@pytest.mark.parametrize("mode", ["0", "bounds"])
def test_other_modes_keep_nothing(script: Path, tmp_path: Path, mode: str) -> None:
    script.write_text(SCRIPT.rsplit("print", 1)[0], encoding="utf-8")
    process = start(script, tmp_path / "home", VLMB_JIT=mode)
    assert process.communicate() == ("", "")
    assert process.returncode == 0
    assert not (tmp_path / "home").exists()


def test_an_index_below_0_is_found_by_the_mode_with_checks(tmp_path: Path) -> None:
    path = tmp_path / "script.py"
    path.write_text(NEGATIVE, encoding="utf-8")
    process = start(path, tmp_path / "home", VLMB_JIT="bounds")
    assert process.communicate() == ("found\n", "")


def test_settings_of_numba_are_left_alone() -> None:
    @jit.kernel
    def once(x: float) -> float:
        return x

    assert str(numba.config.CACHE_DIR) == os.environ.get("NUMBA_CACHE_DIR", "")
    assert once(2.0) == 2.0


def test_another_source_has_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.py").write_text("x = 1\n", encoding="utf-8")
    monkeypatch.setattr(cache, "SOURCES", tmp_path)
    before = cache.fingerprint()
    (tmp_path / "a.py").write_text("x = 2\n", encoding="utf-8")
    assert cache.fingerprint() != before


def test_old_folders_go_and_recent_ones_stay(tmp_path: Path) -> None:
    now = time.time()
    for i in range(8):
        folder = tmp_path / f"core-{i}"
        folder.mkdir()
        used = now - (i if i < 5 else cache.RECENTLY + i)
        os.utime(folder, (used, used))
    (tmp_path / "other").mkdir()
    cache.prune(tmp_path, tmp_path / "core-7")
    assert sorted(path.name for path in tmp_path.iterdir()) == [*(f"core-{i}" for i in range(5)), "core-7", "other"]


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners are of POSIX")
def test_folders_that_others_can_write_are_not_used(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    assert not cache.is_own(tmp_path)
    tmp_path.chmod(0o700)
    assert cache.is_own(tmp_path)


def test_without_a_home_temporary_files_serve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home() -> Path:
        raise RuntimeError("no home")

    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setattr(Path, "home", no_home)
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path))
    (place,) = cache.candidates()
    assert place.parent == tmp_path
    monkeypatch.setattr(cache, "candidates", lambda: iter([tmp_path / "file" / "vlmb", place]))
    (tmp_path / "file").write_text("", encoding="utf-8")
    found = cache.folder.__wrapped__()
    assert found is not None and found.parent == place


def test_reference_counts_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "folder", lambda: None)  # a kernel from the disk shows no text

    @jit.kernel(inline=True)
    def first(x: np.ndarray) -> float:
        return x[0]

    @jit.kernel
    def outer(x: np.ndarray) -> float:
        return first(x) + first(x[1:])

    assert outer(np.array([1.0, 2.0])) == 3.0
    if jit.COMPILED:
        assert "NRT" not in next(iter(outer.inspect_llvm().values()))
