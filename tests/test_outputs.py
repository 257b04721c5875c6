"""Files and terminals that do not take what is written: the earlier file stays, and a sentence names what to do."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import vlmb
from tests.small_scenes import PIVOT, Table, bent, link, scene, write_toml
from vlmb.cli import main
from vlmb.errors import OutputError
from vlmb.simulation.files import replacing, write_text
from vlmb.views import stills, view, visual_model
from vlmb.views.plots import save_all

resource = pytest.importorskip("resource")  # limits of a process
ROOT = Path(__file__).resolve().parents[1]
NAMED: Table = {
    "name": "a skier \N{SKIER} in Zürich", "base": PIVOT, "links": [link("leg")], "start": {"psi1": 0.4, "phi1": 0.2},
    "run": {"duration": 0.1, "rtol": 1e-8},
}  # fmt: skip


@pytest.fixture
def full() -> Iterator[None]:
    """A disk that takes 4 kB a file and no more."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="module")
def run() -> vlmb.Trajectory:
    return vlmb.simulate(bent(PIVOT, 1), duration=0.2)


WRITERS = {
    "run.npz": lambda run, path: run.save(path),
    "run.csv": lambda run, path: run.save_csv(path),
    "path.png": lambda run, path: save_all(run, path.parent, ["path"]),
    "run.html": lambda run, path: view.export_html(run, path),
    "still.png": lambda run, path: stills.save_still(view.picture(run, size=(480, 300)), path),
    "run.gif": lambda run, path: stills.animation(visual_model.of_trajectory(run, 20.0), path, (120, 80)),
    "run.mp4": lambda run, path: stills.animation(visual_model.of_trajectory(run, 60.0), path, (480, 320), fps=60.0),
    "frame_00000.png": lambda run, path: stills.frames(visual_model.of_trajectory(run, 20.0), path.parent, (480, 300)),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_named_and_damages_nothing(name: str, run: vlmb.Trajectory, tmp_path: Path, full: None) -> None:
    path = tmp_path / name
    path.write_bytes(b"earlier")
    with pytest.raises(vlmb.VlmbError) as caught:
        WRITERS[name](run, path)
    said = str(caught.value)
    assert said.startswith(f"{path}: cannot be written: File too large: make room")
    assert said.endswith("the file that stood there is as it was")
    assert path.read_bytes() == b"earlier" and [entry.name for entry in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", WRITERS)
def test_files_are_written_whole(name: str, run: vlmb.Trajectory, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(b"earlier")
    path.chmod(0o640)
    WRITERS[name](run, path)
    assert path.stat().st_size > 300 and path.stat().st_mode & 0o777 == 0o640
    assert not list(tmp_path.glob(".vlmb-*"))


def test_an_error_while_writing_leaves_the_earlier_file(tmp_path: Path) -> None:
    write_text(tmp_path / "a.txt", "earlier")
    for error in (RuntimeError("mine"), KeyboardInterrupt(), vlmb.SceneError("mine")):
        with pytest.raises(type(error)), replacing(tmp_path / "a.txt") as file:  # noqa: PT012
            file.write_text("half")
            raise error
    assert (tmp_path / "a.txt").read_text() == "earlier" and len(list(tmp_path.iterdir())) == 1


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"No such file or directory: its folder does not exist") as caught:
        write_text(tmp_path / "none" / "a.txt", "text")
    assert isinstance(caught.value, OSError)
    with pytest.raises(OutputError, match="Is a directory"):
        write_text(tmp_path, "text")
    write_text(os.devnull, "text")  # a device has no earlier content
    assert Path(os.devnull).is_char_device()
    (tmp_path / "there.txt").write_text("earlier")
    (tmp_path / "link.txt").symlink_to(tmp_path / "there.txt")
    write_text(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "there.txt").read_text() == "new"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_device_that_is_full(run: vlmb.Trajectory) -> None:
    with pytest.raises(OutputError, match=r"/dev/full: cannot be written: No space left on device: make room"):
        run.save_csv("/dev/full")


def test_a_run_that_its_folder_does_not_take_is_kept_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_toml(tmp_path / "one.toml", NAMED)
    (tmp_path / "spare").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "spare"))
    (tmp_path / "out" / "run.npz").mkdir(parents=True)  # nothing can be written there
    assert main(["run", "one.toml", "--no-plots", "--quiet", "-o", "out"]) == 1
    said = capsys.readouterr().err
    (kept,) = (tmp_path / "spare").glob("vlmb-*/run.npz")
    assert "out/run.npz: cannot be written: Is a directory" in said and f"this run is in {kept}" in said
    assert vlmb.load_trajectory(kept).status == "finished" and (tmp_path / "out" / "run.csv").exists()


# Terminals -----------------------------------------------------------------------------------------------------------


def shell(here: Path, text: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = text.replace("vlmb", f"{sys.executable} -m vlmb")
    env = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    return subprocess.run(["sh", "-c", command], cwd=here, env=env, capture_output=True, text=True, errors="replace", check=False)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_a_name_that_the_terminal_has_no_letters_for(encoding: str, tmp_path: Path) -> None:
    write_toml(tmp_path / "one.toml", NAMED)
    vlmb.simulate(tmp_path / "one.toml", duration=0.01)  # the engine is compiled then, and no line says that it is being compiled
    done = shell(tmp_path, "vlmb run one.toml -o out --no-plots --quiet", PYTHONIOENCODING=encoding)
    assert done.returncode == 0 and done.stderr == ""
    assert ("\\u26f7" in done.stdout) == (encoding != "utf-8") and "wrote out" in done.stdout


@pytest.mark.parametrize("closed", ["2>&-", ">&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_closed_streams(closed: str, tmp_path: Path) -> None:
    """Files that are opened then must not take the place of the output."""
    write_toml(tmp_path / "one.toml", NAMED)
    every = closed == "<&- >&- 2>&-"  # pictures take most of the time
    assert shell(tmp_path, f"vlmb run one.toml -o out {'' if every else '--no-plots'} {closed}").returncode == 0
    assert vlmb.load_trajectory(tmp_path / "out" / "run.npz").status == "finished"
    assert (tmp_path / "out" / "run.csv").read_text(encoding="utf-8").startswith("t [s],phi1")
    assert not every or (tmp_path / "out" / "energy.png").read_bytes().startswith(b"\x89PNG")
    assert shell(tmp_path, f"vlmb run none.toml {closed}").returncode == 1


def test_a_byte_order_mark(tmp_path: Path) -> None:
    path = write_toml(tmp_path / "one.toml", NAMED)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert vlmb.load_scene(path).name == NAMED["name"]
    path.write_bytes(path.read_text(encoding="utf-8").encode("utf-16"))
    with pytest.raises(vlmb.SceneError, match=r"one\.toml: not a TOML file"):
        vlmb.load_scene(path)


# What is asked of pictures -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--png a.png --ghosts -3", "ghosts = -3: earlier postures in a still are 0 to 1000"),
        ("--png a.png --ghosts 100000", "ghosts = 100000"),
        ("--png a.txt", "a.txt: its name must end as a picture's does, such as .png"),
        ("--png a", "a: its name must end as a picture's does"),
        ("--gif a.gif --speed 1e-9", "has 4e+09 pictures: at most 10000; lower fps, or raise speed"),
        ("--mp4 a.mp4 --fps 99999 --speed 1e-3", "pictures: at most 10000"),
        ("--frames f --fps 99999", "pictures: at most 10000"),
        ("--gif a.gif --size 4000 4000 --fps 2000", "too large: write an MP4, or lower fps or size"),
        ("--png a.png --size 90000 90000", "size 90000 x 90000: a picture has 1 to"),
    ],
)
def test_pictures_that_cannot_be(
    options: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = scene(PIVOT, 1, start={"psi1": 0.4})
    stored = vlmb.simulate(made, duration=0.2).save(tmp_path / "run.npz")
    monkeypatch.chdir(tmp_path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert main(["view", str(stored), *options.split()]) == 1
    assert said in capsys.readouterr().err
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + 400_000  # [kB]
    assert not (tmp_path / "a.png").exists()


def test_long_motions_have_fewer_frames() -> None:
    run = vlmb.simulate(scene(PIVOT, 1, start={"psi1": -1.5}), duration=20.0, t_eval=np.linspace(0.0, 20.0, 21), rtol=1e-4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(visual_model, "MAX_FRAMES", 100)
        assert len(visual_model.of_trajectory(run, 60.0).t) == 101


@pytest.mark.parametrize(
    ("gone", "said"),
    [
        ("matplotlib", "plots need matplotlib, which is not installed: pip install vlmb[plots]"),
        ("PIL", "plots need matplotlib, which needs pillow, and that is not installed: pip install pillow"),
        ("cycler", "plots need matplotlib, which needs cycler, and that is not installed: pip install cycler"),
    ],
)
def test_what_is_not_installed_is_named(gone: str, said: str, run: vlmb.Trajectory, tmp_path: Path) -> None:
    stored = run.save(tmp_path / "run.npz")
    program = f"import sys; sys.modules[{gone!r}] = None; from vlmb.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", program, "plot", str(stored), "-o", str(tmp_path)]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
    assert done.returncode == 1 and done.stderr.strip() == f"vlmb plot: {said}"
