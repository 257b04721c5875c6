"""What is released, as a newcomer gets it: wheel and sdist in fresh environments, away from the sources, on every Python here."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import vlmb

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = ("plots", "view", "data", "studies", "dask", "mocap", "robots", "film")
PYTHONS = [entry.rpartition(" ")[2] for entry in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", entry)]

pytestmark = pytest.mark.acceptance


def call(*words: str | Path, folder: Path, seconds: float = 1800.0) -> str:
    """Run a command in a folder with nothing of this checkout in its way; return what it printed."""
    outer = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VLMB"))}
    clean = {**outer, "MPLBACKEND": "agg"}
    done = subprocess.run([*map(str, words)], cwd=folder, env=clean, capture_output=True, text=True, check=False, timeout=seconds)
    assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with wheel and sdist; the wheel is built from the sdist, as package indexes do."""
    folder = tmp_path_factory.mktemp("dist")
    call(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder, folder=ROOT)
    (sdist,) = folder.glob("*.tar.gz")
    shutil.unpack_archive(sdist, folder / "unpacked")
    (sources,) = (folder / "unpacked").iterdir()
    call(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, folder=sources)
    return folder


def works(python: str) -> str:
    """Return the path of a Python that can make environments, an empty text where there is none."""
    program = shutil.which(f"python{python}") or ""
    made = program and subprocess.run([program, "-c", "import venv, ensurepip"], capture_output=True, check=False).returncode == 0
    return program if made else ""


def environment(folder: Path, python: str) -> Path:
    """Make an environment; return its folder of programs."""
    program = works(python)
    if not program:
        pytest.skip(f"no python{python} here: untested")
    call(program, "-m", "venv", folder / "env", folder=folder)
    return folder / "env" / ("Scripts" if os.name == "nt" else "bin")


def run_away_from_sources(programs: Path, folder: Path) -> None:
    """Run a model by its name in an empty folder and read the run again."""
    (folder / "empty").mkdir()
    where = call(programs / "python", "-c", "import vlmb; print(vlmb.__file__)", folder=folder / "empty")
    assert str(ROOT) not in where and str(folder) in where
    assert "skier_slalom" in call(programs / "vlmb", "models", folder=folder / "empty")
    said = call(programs / "vlmb", "run", "slalom", "--duration", "2", "--quiet", folder=folder / "empty")
    assert "finished at t = 2 s" in said
    written = {path.name for path in (folder / "empty" / "results" / "slalom").iterdir()}
    assert {"run.npz", "run.csv", "run.html"} <= written and any(name.endswith(".png") for name in written)
    again = call(programs / "vlmb", "run", "results/slalom/run.npz", "--no-plots", "--quiet", folder=folder / "empty")
    assert "finished" in again


@pytest.mark.parametrize("python", PYTHONS)
def test_the_wheel_runs_a_model_without_a_clone(python: str, built: Path, tmp_path: Path) -> None:
    programs = environment(tmp_path, python)
    (wheel,) = built.glob("*.whl")
    call(programs / "python", "-m", "pip", "install", "-q", f"{wheel}[plots,view]", folder=tmp_path)
    assert call(programs / "vlmb", "--version", folder=tmp_path).strip() == f"vlmb {vlmb.__version__}"
    run_away_from_sources(programs, tmp_path)


def test_the_sdist_installs(built: Path, tmp_path: Path) -> None:
    programs = environment(tmp_path, f"{sys.version_info.major}.{sys.version_info.minor}")
    (sdist,) = built.glob("*.tar.gz")
    call(programs / "python", "-m", "pip", "install", "-q", f"{sdist}[plots,view]", folder=tmp_path)
    run_away_from_sources(programs, tmp_path)


def test_the_lower_bounds_of_what_it_needs(built: Path, tmp_path: Path) -> None:
    """The oldest versions that pyproject.toml allows, of what vlmb needs and of every extra that users install."""
    extras = PROJECT["optional-dependencies"]
    needed = [*PROJECT["dependencies"], *(entry for extra in EXTRAS for entry in extras[extra] if not entry.startswith("vlmb["))]
    oldest = [re.sub(r">=([\d.]+)(,<[\d.]+)?", r"==\1", entry) for entry in needed]
    programs = environment(tmp_path, next((name for name in PYTHONS if works(name)), PYTHONS[0]))
    (wheel,) = built.glob("*.whl")
    call(programs / "python", "-m", "pip", "install", "-q", *oldest, str(wheel), folder=tmp_path)
    run_away_from_sources(programs, tmp_path)
    said = call(programs / "python", Path(__file__).with_name("extras.py"), folder=tmp_path / "empty")
    assert "every extra works" in said
