"""Files and scenes that were damaged, or made to damage: refused by a named error, or read as they are written."""

from __future__ import annotations

from pathlib import Path

import pytest

import vlmb
from tests.damaging import (
    MEGABYTES,
    SECONDS,
    damaged_run,
    damaged_scene,
    deep,
    judged,
    look_at_run,
    look_at_scene,
    stored_runs,
)
from tests.small_scenes import PIVOT, link, table

FEW = 30  # tried here; three hundred in scripts/acceptance


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Stored runs, each looked at once: what is compiled on the way is not counted below."""
    made = stored_runs(tmp_path_factory.mktemp("runs"))
    for path in made:
        look_at_run(path)
    return made


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", range(FEW))
def test_a_damaged_run(seed: int, runs: list[Path], tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    path.write_bytes(damaged_run(runs[seed % len(runs)], seed))
    said, seconds, megabytes = judged(lambda: look_at_run(path))
    assert seconds < SECONDS and megabytes < MEGABYTES, said
    assert said == "read" or str(path) in said


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", range(FEW))
def test_a_damaged_scene(seed: int, runs: list[Path], tmp_path: Path) -> None:
    path = damaged_scene(seed, tmp_path)
    said, seconds, megabytes = judged(lambda: look_at_scene(path))
    assert seconds < SECONDS and megabytes < MEGABYTES, said


@pytest.mark.parametrize(
    "text",
    [
        "a." * 20_000 + "b = 1",
        "a = " + "{a = " * 3000 + "1" + "}" * 3000,
        "a = " + "[" * 100_000,
        "".join(f"[a{n}.b]\n" for n in range(100_000)),
        "".join(f"k{n} = {n}\n" for n in range(50_000)),
        "name = '" + "x" * 5_000_000 + "'",
        "a = " + "9" * 100_000,
    ],
    ids=["a long key", "deep tables", "deep lists", "many tables", "many keys", "a long name", "a long number"],
)
def test_files_that_take_long_to_read(text: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    said, seconds, megabytes = judged(lambda: vlmb.load_scene(path))
    assert said.startswith(("refused: ", f"refused: {path}")) and seconds < SECONDS and megabytes < MEGABYTES


@pytest.mark.parametrize("name", ["\x1b[2J", "a\x00b", "a\u202eb", "\ud800", "\x9b1m"])
def test_texts_that_do_something_to_a_terminal(name: str) -> None:
    with pytest.raises(vlmb.SceneError, match=r"name = .*: has control characters"):
        vlmb.Scene.from_dict({**table(PIVOT, [link("a")]), "name": name})
    assert vlmb.Scene.from_dict({**table(PIVOT, [link("a")]), "name": "Zürich \N{SKIER}\u200d, two\nlines"}).name


def test_what_is_no_file(tmp_path: Path) -> None:
    for path in (tmp_path, Path("/dev/zero")):
        with pytest.raises(vlmb.TrajectoryError, match=str(path)):
            vlmb.load_trajectory(path)
    with pytest.raises(vlmb.SceneError):
        vlmb.load_scene("/dev/zero")
    with pytest.raises(vlmb.SceneError):
        vlmb.Scene.from_dict({**table(PIVOT, [link("a")]), "expect": {"a": deep(500)}})
