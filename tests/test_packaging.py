"""The package as a newcomer meets it: version, wheel, scripts, README, and an import that stays light."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest

import vlmb

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
HEAVY = ("sympy", "mpmath", "matplotlib", "meshcat", "tqdm")
SCRIPTS = ("scripts/demo", "scripts/test", "scripts/acceptance", "scripts/gallery", "scripts/reproduce_figures", ".ci/run")


def blocks(language: str) -> list[str]:
    """Return the README's code blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.M | re.S)


def commands() -> list[str]:
    """Return the README's shell lines without their remarks."""
    return [line.partition(" #")[0].strip() for block in blocks("sh") for line in block.splitlines() if line.strip()]


def call(*words: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder, with this checkout of vlmb and without a screen."""
    outer = {name: value for name, value in os.environ.items() if name != "VLMB_VENV"}  # of the tests' own run
    known = {**outer, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg", "PYTHONWARNINGS": "error", **environment}
    return subprocess.run(words, cwd=folder, env=known, capture_output=True, text=True, check=False, timeout=300)


def test_the_version_stands_in_one_place() -> None:
    literal = re.compile(r"__version__\s*=\s*[\"']")
    sources = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "vlmb").rglob("*.py")}
    assert [name for name, text in sources.items() if literal.search(text)] == ["_version.py"]
    assert 'dynamic = ["version"]' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def test_changelog_and_citation_are_of_this_version() -> None:
    latest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    cited = re.search(r"^version: (\S+)", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    assert latest and latest[1] == vlmb.__version__
    assert cited and cited[1] == vlmb.__version__


def test_installed_version() -> None:
    try:
        installed = version("vlmb")
    except PackageNotFoundError:
        pytest.skip("vlmb is not installed here")
    assert installed == vlmb.__version__


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this tree."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    build = ("-m", "hatchling", "build", "-t", "wheel", "-d", str(folder))
    done = call(sys.executable, *build, folder=ROOT, PYTHONWARNINGS="default")
    assert done.returncode == 0, done.stderr
    (built,) = folder.glob(f"vlmb-{vlmb.__version__}-*.whl")
    return built


def test_wheel_ships_every_module_and_the_type_marker(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    files = (path.relative_to(ROOT) for path in (ROOT / "vlmb").rglob("*") if path.is_file())
    here = {path.as_posix() for path in files if "__pycache__" not in path.parts}
    shipped = (path.relative_to(ROOT) for path in (ROOT / "models").rglob("*") if path.is_file())
    models = {f"vlmb/{path.as_posix()}" for path in shipped}
    assert {name for name in names if ".dist-info/" not in name} == here | models
    assert "vlmb/py.typed" in here
    assert f"vlmb-{vlmb.__version__}.dist-info/licenses/LICENSE" in names


def test_what_the_wheel_holds_finds_its_models_anywhere(wheel: Path, tmp_path: Path) -> None:
    zipfile.ZipFile(wheel).extractall(tmp_path / "installed")
    (tmp_path / "empty").mkdir()
    code = "import sys, vlmb.cli as c\nfor line in sys.argv[1:]: sys.exit(line) if c.main(line.split()) else print(end='\\0')"
    lines = ("models", "models slalom", "info slalom", "info recorded_pumping")
    done = call(sys.executable, "-c", code, *lines, folder=tmp_path / "empty", PYTHONPATH=str(tmp_path / "installed"))
    assert done.returncode == 0, done.stderr
    names, text, slalom, pumping, rest = done.stdout.split("\0")
    assert {path.stem for path in (ROOT / "models").glob("*.toml")} <= set(names.split())
    assert text == (ROOT / "models" / "skier_slalom.toml").read_text(encoding="utf-8")
    assert "skier in a slalom: ski base" in slalom
    assert "data  " in pumping and rest == ""


def test_importing_vlmb_and_simulating_a_plain_scene_is_light(tmp_path: Path) -> None:
    code = """
import sys
import vlmb
rod = {"length": 0.5, "mass": 2.0}
link = {"rod": rod, "lower": {"length": 0.25, "stiffness": 300.0}}
vlmb.simulate(vlmb.Scene.from_dict({"base": {"kind": "pivot"}, "links": [link]}), duration=0.01)["energy"]
print(*{name.partition(".")[0] for name in sys.modules})
"""
    done = call(sys.executable, "-c", code, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert not set(HEAVY) & set(done.stdout.split())


def test_the_readmes_python_runs(tmp_path: Path) -> None:
    assert blocks("python")
    for block in blocks("python"):
        done = call(sys.executable, "-c", block, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "finished" in done.stdout


def test_the_readmes_commands_run(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    shutil.copytree(ROOT / "models", tmp_path / "models")
    lines = [line for line in commands() if line.startswith("vlmb ")]
    assert lines
    code = "import shlex, sys, vlmb.cli as c; sys.exit(next((line for line in sys.argv[1:] if c.main(shlex.split(line)[1:])), 0))"
    done = call(sys.executable, "-c", code, *lines, folder=tmp_path)  # one process: what it imports is imported once
    assert done.returncode == 0, f"{done.stdout}{done.stderr}"
    assert (tmp_path / "results" / "skier" / "run.html").stat().st_size > 1000 and "phi1_ddot" in done.stdout


def test_the_readme_names_files_that_exist() -> None:
    linked = [target for target in re.findall(r"\]\(([^)#]+)\)", README) if "://" not in target]
    called = [line.split()[0] for line in commands() if line.startswith("scripts/")]
    assert called == ["scripts/demo", "scripts/test"]
    assert not [name for name in (*linked, *called) if not (ROOT / name).exists()]


def test_what_a_newcomer_looks_for_is_where_contributing_says() -> None:
    table = CONTRIBUTING.partition("## Where is ...?")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (.+?) \| `(\S+?)` \| `(.+?)` \|$", table, re.M)
    assert len(rows) >= 20
    stale = [f"{what}: no {name}" for what, name, _ in rows if not (ROOT / name).is_file()]
    stale += [
        f"{what}: no {text!r} in {name}"
        for what, name, text in rows
        if (ROOT / name).is_file() and text not in (ROOT / name).read_text(encoding="utf-8")
    ]
    assert not stale, "\n".join(["update CONTRIBUTING.md, Where is ...?", *stale])


def test_contributing_names_files_that_exist() -> None:
    names = set(re.findall(r"`((?:vlmb|tests|benchmarks|docs|scripts|models|\.ci)/[\w/.-]*)`", CONTRIBUTING))
    assert len(names) > 25
    assert not sorted(name for name in names if not (ROOT / name).exists())


def test_nothing_puts_another_folder_on_the_path() -> None:
    """What is imported is the vlmb that is installed; a folder put before it would hide that."""
    folders = ("vlmb", "tests", "benchmarks", "scripts", "docs")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in ("", ".py", ".ipynb")]
    texts = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in files if path.is_file()}
    assert [name for name, text in texts.items() if "sys" + ".path" in text] == []


def test_the_benchmarks_find_what_they_measure() -> None:
    """Every name that a benchmark imports of vlmb is there; other engines need not be."""
    pytest.importorskip("matplotlib")
    names = [*sorted(path.stem for path in (ROOT / "benchmarks").glob("*.py")), "peers.chain", "peers.plain_pinocchio"]
    assert "work_precision" in names
    done = call(sys.executable, "-c", f"import {', '.join(names)}", folder=ROOT / "benchmarks", PYTHONWARNINGS="default")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("script", SCRIPTS)
def test_scripts_are_executable_bash(script: str, tmp_path: Path) -> None:
    assert os.access(ROOT / script, os.X_OK)
    done = call("bash", "-n", str(ROOT / script), folder=tmp_path)
    assert done.returncode == 0, done.stderr


def project_with_pythons(folder: Path, **versions: str) -> tuple[Path, Path]:
    """Copy what the scripts need, into a path with spaces; make programs that answer as Pythons of these versions."""
    project, programs = folder / "my projects" / "a clone", folder / "programs"
    for name in ("scripts/_venv.sh", "scripts/demo", "pyproject.toml", "vlmb/_version.py"):
        (project / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, project / name)
    programs.mkdir()
    for name in ("bash", "dirname", "sed", "cat", "ls", "cksum"):
        (programs / name).symlink_to(str(shutil.which(name)))
    for name, minor in versions.items():
        fake = f'#!/bin/sh\ncode=$(printf "%s" "$2" | sed "s/sys.version_info\\[:2\\]/(3, {minor})/; s/, venv, ensurepip//")\n'
        (programs / name).write_text(f'{fake}exec "{sys.executable}" -c "$code"\n', encoding="utf-8")
        (programs / name).chmod(0o755)
    return project, programs


@pytest.mark.parametrize("versions", [{}, {"python3": "9"}, {"python3": "14", "python": "8"}])
def test_scripts_say_which_python_they_need(tmp_path: Path, versions: dict[str, str]) -> None:
    project, programs = project_with_pythons(tmp_path, **versions)
    done = call("bash", str(project / "scripts" / "demo"), folder=tmp_path, PATH=str(programs))
    assert done.returncode == 1
    assert "Python 3.10 to 3.13" in done.stderr
    assert not (project / ".venv").exists()


def test_scripts_take_a_python_in_the_declared_range(tmp_path: Path) -> None:
    project, programs = project_with_pythons(tmp_path, python3="9", python="12")
    done = call("bash", str(project / "scripts" / "demo"), folder=tmp_path, PATH=str(programs))
    assert done.stdout.startswith("Making a virtual environment with")


def test_scripts_leave_a_folder_that_is_no_environment_alone(tmp_path: Path) -> None:
    project, programs = project_with_pythons(tmp_path)
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.tex").touch()
    done = call("bash", str(project / "scripts" / "demo"), folder=tmp_path, PATH=str(programs), VLMB_VENV="mine")
    assert done.returncode == 1
    assert f"{mine} is not a virtual environment" in done.stderr
    assert [path.name for path in mine.iterdir()] == ["thesis.tex"]


def test_a_prepared_environment_installs_nothing(tmp_path: Path) -> None:
    project, programs = project_with_pythons(tmp_path)
    environment = project / ".venv"
    (environment / "bin").mkdir(parents=True)
    (environment / "bin" / "python").symlink_to(sys.executable)
    key = call("bash", "-c", f'source "{project}/scripts/_venv.sh"; installation_key', folder=tmp_path).stdout.strip()
    (environment / ".vlmb-test").write_text(key, encoding="utf-8")
    ask = f'source "{project}/scripts/_venv.sh"; prepare plots,view; echo "ready: $python"'
    done = call("bash", "-c", ask, folder=tmp_path, PATH=str(programs))
    assert (done.stdout, done.stderr) == (f"ready: {environment / 'bin' / 'python'}\n", "")
