"""The command line: what it prints and writes, its exit codes, and errors that say what to change."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import FIXED, PIVOT, SKI, Table, link, write_toml
from vlmb.cli import main, run

COMMANDS = ("run", "info", "check", "matrices", "plot", "view")
ONE: Table = {
    "name": "one leg", "base": PIVOT, "links": [link("leg")], "start": {"psi1": 0.4, "phi1": 0.2},
    "run": {"duration": 0.2, "rtol": 1e-8},
}  # fmt: skip
SKIER: Table = {
    "name": "a skier", "base": SKI, "links": [link("legs", lower=FIXED), link("trunk")],
    "start": {"psi1": 1.3, "phi1": 0.2, "psi2": 1.2, "speed": 3.0}, "run": {"duration": 0.2},
}  # fmt: skip


HERE = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[1])}  # also where the package is not installed


def program(here: Path, *command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=here, env=HERE)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_toml(tmp_path / "one.toml", ONE)
    write_toml(tmp_path / "skier.toml", SKIER)
    return tmp_path


def fails(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Run a command that must be refused: exit code 1, one sentence on stderr, nothing else."""
    assert main(arguments) == 1
    printed = capsys.readouterr()
    assert printed.err.startswith(f"vlmb {arguments[0]}: ")
    assert len(printed.err.strip().splitlines()) == 1
    assert "Traceback" not in printed.err
    return printed.err


def usage(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    return capsys.readouterr().err


# Help and usage ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main([command, "--help"])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    assert f"usage: vlmb {command}" in text
    assert len(text.splitlines()) > 5


def test_the_list_of_commands(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    for command in COMMANDS:
        assert re.search(rf"^\s+{command}\s+\w", text, re.MULTILINE), command
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out.strip() == f"vlmb {vlmb.__version__}"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([], "COMMAND"), (["fly"], "fly"), (["run"], "scene"), (["run", "a.toml", "b.toml"], "b.toml"), (["plot"], "runs"),
        (["run", "one.toml", "--method", "rk5"], "rk4"), (["run", "one.toml", "--duration", "long"], "long"),
        (["run", "one.toml", "--speed", "3"], "--speed"), (["run", "one.toml", "--knife-edge", "glue"], "reduction"),
        (["run", "one.toml", "--engine", "steam"], "pinocchio"), (["run", "one.toml", "--max-step", "short"], "short"),
    ],
)  # fmt: skip
def test_wrong_usage_has_exit_code_2(arguments: list[str], text: str, capsys: pytest.CaptureFixture[str], here: Path) -> None:
    assert text in usage(capsys, *arguments)
    assert not (here / "results").exists()


def test_the_module_runs_as_a_program(here: Path) -> None:
    done = program(here, sys.executable, "-m", "vlmb", "check", "one.toml")
    assert (done.returncode, done.stderr) == (0, "")
    assert "one.toml: fine" in done.stdout
    wrong = program(here, sys.executable, "-m", "vlmb", "check", "two.toml")
    assert (wrong.returncode, wrong.stdout) == (1, "")
    assert wrong.stderr.strip() == "vlmb check: two.toml: no such scene file"


# run -----------------------------------------------------------------------------------------------------------------


def test_run_writes_results_and_prints_the_summary(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "one.toml", "--no-plots", "--quiet"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    trajectory = vlmb.load_trajectory(here / "results" / "one" / "run.npz")
    assert printed.out.startswith(trajectory.summary())
    assert printed.out.splitlines()[-1] == f"wrote {Path('results/one/run.npz')}, {Path('results/one/run.csv')}"
    assert sorted(path.name for path in (here / "results" / "one").iterdir()) == ["run.csv", "run.npz"]
    direct = vlmb.simulate("one.toml")
    assert np.array_equal(trajectory.q, direct.q)


def test_run_with_options(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = [
        "--duration",
        "0.1",
        "--method",
        "rk4",
        "--step",
        "0.01",
        "--knife-edge",
        "multiplier",
        "--gain",
        "2.5",
        "-o",
        "out put/deep",
    ]
    assert main(["run", "skier.toml", "--no-plots", "--quiet", *options]) == 0
    run = vlmb.load_trajectory(here / "out put" / "deep" / "run.npz").run
    assert (run.duration, run.method, run.step, run.knife_edge, run.gain) == (0.1, "rk4", 0.01, "multiplier", 2.5)
    assert "rk4 (step 0.01 s), 10 steps" in capsys.readouterr().out
    assert main(["run", "one.toml", "--no-plots", "--quiet", "--rtol", "1e-5", "--atol", "1e-7"]) == 0
    assert "rtol 1e-05, atol 1e-07" in capsys.readouterr().out
    assert main(["run", "one.toml", "--no-plots", "--quiet", "--engine", "pinocchio", "--max-step", "0.001", "-o", "slow"]) == 0
    trajectory = vlmb.load_trajectory(here / "slow" / "run.npz")
    assert (trajectory.engine, trajectory.run.engine, trajectory.run.max_step) == ("pinocchio", "pinocchio", 0.001)
    assert trajectory.stats["steps"] >= 200


@pytest.mark.slow
def test_run_draws_plots(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    assert main(["run", "skier.toml", "--quiet"]) == 0
    pictures = list((here / "results" / "skier").glob("*.png"))
    assert len(pictures) >= 4
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in pictures)
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith(f"wrote into {Path('results/skier')}: ") and all(path.name in last for path in pictures)


def test_run_writes_a_page_that_plays(here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("meshcat")
    folder = here / "results" / "skier"
    assert main(["run", "skier.toml", "--quiet"]) == 0
    assert "run.html" in capsys.readouterr().out
    assert (folder / "run.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    monkeypatch.setitem(sys.modules, "meshcat", None)
    (folder / "run.html").unlink()
    assert main(["run", "skier.toml", "--quiet"]) == 0
    assert "no run.html" in capsys.readouterr().err
    assert not (folder / "run.html").exists()


def test_a_run_is_replayed(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "skier.toml", "--no-plots", "--quiet", "-o", "first", "--duration", "0.15", "--method", "dop853"]) == 0
    assert main(["run", "first/run.npz", "--no-plots", "--quiet", "-o", "again"]) == 0
    first, again = (vlmb.load_trajectory(here / name / "run.npz") for name in ("first", "again"))
    assert again.run == first.run
    for name in ("t", "q", "v", "work"):
        assert np.array_equal(getattr(first, name), getattr(again, name)), name
    assert main(["run", "first/run.npz", "--no-plots", "--quiet", "-o", "longer", "--duration", "0.2"]) == 0
    longer = vlmb.load_trajectory(here / "longer" / "run.npz")
    assert (longer.t[-1], longer.run.method) == (0.2, "dop853")
    capsys.readouterr()


def test_a_run_with_samples_of_its_own_is_replayed_with_them(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times = [0.0, 0.01, 0.05, 0.2]
    stored = vlmb.simulate("skier.toml", t_eval=times)
    stored.save(here / "run.npz")
    assert main(["run", "run.npz", "--no-plots", "--quiet", "-o", "again"]) == 0
    again = vlmb.load_trajectory(here / "again" / "run.npz")
    assert again.t.tolist() == times
    np.testing.assert_allclose(again.q, stored.q, rtol=0, atol=1e-12)
    capsys.readouterr()


def test_a_run_with_a_python_control_cannot_be_replayed(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vlmb.simulate("one.toml", control=lambda t, view: {"M_psi1": 1.0}).save(here / "run.npz")
    text = fails(capsys, "run", "run.npz", "--quiet")
    assert "run.npz" in text
    assert "control" in text


def test_a_run_that_stops_at_an_event_is_a_success(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    falling = {**SKIER, "links": [link("legs", lower=FIXED, upper=FIXED)], "start": {"psi1": 0.1}, "run": {"duration": 2.0}}
    write_toml(here / "fall.toml", falling)
    assert main(["run", "fall.toml", "--no-plots", "--quiet"]) == 0
    assert "stopped at t = " in capsys.readouterr().out
    assert vlmb.load_trajectory(here / "results" / "fall" / "run.npz").status == "stopped"


def test_a_run_that_fails_keeps_its_files_and_says_so(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    failing = {**ONE, "forces": [{"on": "M_psi1", "law": "log(0.1 - t)"}]}
    write_toml(here / "fails.toml", failing)
    assert main(["run", "fails.toml", "--no-plots", "--quiet"]) == 1
    printed = capsys.readouterr()
    assert "failed at t = 0." in printed.out + printed.err
    assert "the law 'log(0.1 - t)' of the force on M_psi1 has no finite value" in printed.out + printed.err
    trajectory = vlmb.load_trajectory(here / "results" / "fails" / "run.npz")
    assert trajectory.status == "failed"
    assert 0.05 < trajectory.t[-1] <= 0.1


def test_an_interrupt_keeps_what_was_computed(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupting(bar: Any, t: float) -> None:
        if t > 0.1:
            raise KeyboardInterrupt

    monkeypatch.setattr(run, "_advance", interrupting)
    assert main(["run", "one.toml", "--no-plots", "--quiet"]) == 1
    assert "interrupted at t = 0.1" in capsys.readouterr().out
    assert vlmb.load_trajectory(here / "results" / "one" / "run.npz").status == "interrupted"


class Terminal:
    """A stderr that says it is a terminal."""

    def __init__(self) -> None:
        self.text = ""

    def write(self, text: str) -> int:
        self.text += text
        return len(text)

    def flush(self) -> None:
        pass

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("quiet", [False, True])
def test_a_progress_bar_on_a_terminal(
    quiet: bool, here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert main(["run", "one.toml", "--no-plots", *(["--quiet"] if quiet else [])]) == 0
    assert ("0.20/0.20 s simulated" in terminal.text) == (not quiet)
    assert "finished" in capsys.readouterr().out


def test_no_progress_bar_in_a_file(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "one.toml", "--no-plots"]) == 0
    assert capsys.readouterr().err == ""


# info and check ------------------------------------------------------------------------------------------------------


def test_info(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "skier.toml"]) == 0
    text = capsys.readouterr().out
    for part in (
        "a skier: ski base, 2 links, 15 kg", "x y phi0 phi1 psi1 xi1_2 phi2 psi2 xi2_1 xi2_2", "degrees of freedom  9",
        "    x                    m    place\n", "    phi0                 rad  heading\n",
        "    xi1_2                m    legs.upper\n",
        "xi1_1, the lower segment of 'legs': fixed at 0.2 m", "Spherical", "Planar", "trunk.lower",
    ):  # fmt: skip
        assert part in text
    assert main(["info", "one.toml"]) == 0
    assert "left out            nothing" in capsys.readouterr().out


def test_info_warns(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_toml(here / "straight.toml", {"base": PIVOT, "links": [link("thigh", tip_mass=None), link("shin")]})
    assert main(["info", "straight.toml"]) == 0
    assert re.search(r"warning .*'thigh' and 'shin'", capsys.readouterr().out)


def test_check(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "skier.toml"]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first == "skier.toml: fine. 10 coordinates, 9 degrees of freedom"
    assert second.startswith("  both engines agree at the start")
    write_toml(here / "slip.toml", {"base": SKI, "start": {"phi0": 0.5, "x_dot": 1.0, "y_dot": 0.0}})
    assert main(["check", "slip.toml"]) == 0
    assert "sideways velocity" in capsys.readouterr().out


def test_check_runs_nothing(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_toml(here / "long.toml", {**ONE, "run": {"duration": 1e6}})
    assert main(["check", "long.toml"]) == 0
    assert sorted(path.name for path in here.iterdir()) == ["long.toml", "one.toml", "skier.toml"]
    capsys.readouterr()


# plot ----------------------------------------------------------------------------------------------------------------


def test_plot(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    for name in ("one", "skier"):
        assert main(["run", f"{name}.toml", "--no-plots", "--quiet"]) == 0
    capsys.readouterr()
    assert main(["plot", "results/skier/run.npz", "--only", "path", "energy"]) == 0
    assert len(list((here / "plots").glob("*.png"))) == 2
    assert main(["plot", "results/skier/run.npz", "results/skier/run.npz", "--only", "energy", "-o", "two"]) == 0
    (picture,) = (here / "two").glob("*.png")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "energy" in capsys.readouterr().out
    text = fails(capsys, "plot", "results/one/run.npz", "--only", "enrgy")
    assert "energy" in text


# Errors --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["run", "info", "check"])
@pytest.mark.parametrize(
    ("data", "texts"),
    [
        ({**ONE, "gravitty": 3.0}, ("scene.toml", "'gravitty'", "'gravity'")),
        ({**ONE, "links": [link("leg", tip_mass=-1.0)]}, ("scene.toml", "links[0].tip_mass", "-1")),
        ({**ONE, "links": [link("a", tip_mass=None, rod={"length": 0.1, "mass": 0.0})]}, ("scene.toml", "links[0]", "mass")),
    ],
    ids=["unknown key", "negative mass", "no mass"],
)
def test_wrong_scenes_name_the_file(
    command: str, data: Table, texts: tuple[str, ...], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_toml(here / "scene.toml", data)
    text = fails(capsys, command, "scene.toml")
    for part in texts:
        assert part in text
    assert not (here / "results").exists()


@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize(
    ("data", "texts"),
    [
        ({**ONE, "start": {"psi2": 1.0}}, ("scene.toml", "start.psi2", "'psi1'")),
        ({**ONE, "forces": [{"on": "M_psi2", "law": 1.0}]}, ("scene.toml", "forces[0].on", "'M_psi1'")),
        ({**ONE, "forces": [{"on": "M_psi1", "law": "sin(t"}]}, ("scene.toml", "forces[0].law", "sin(t")),
    ],
    ids=["unknown start", "unknown force", "law"],
)
def test_what_only_a_run_needs_is_refused_before_it(
    command: str, data: Table, texts: tuple[str, ...], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_toml(here / "scene.toml", data)
    text = fails(capsys, command, "scene.toml")
    for part in texts:
        assert part in text
    assert not (here / "results").exists()


def test_missing_and_foreign_files(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("run", "info", "check"):
        assert fails(capsys, command, "none.toml").strip() == f"vlmb {command}: none.toml: no such scene file"
        (here / "binary.toml").write_bytes(bytes(range(256)))
        assert "not a TOML file" in fails(capsys, command, "binary.toml")
        assert "cannot be read" in fails(capsys, command, ".")
    for command in ("run", "plot"):
        assert "no such file" in fails(capsys, command, "none.npz")
        (here / "foreign.npz").write_bytes(b"text")
        assert "not a trajectory" in fails(capsys, command, "foreign.npz")


@pytest.mark.parametrize(
    ("option", "value", "text"),
    [("--duration", "-1", "duration"), ("--rtol", "0", "rtol"), ("--step", "nan", "step"), ("--max-step", "0", "max_step")],
)
def test_wrong_numbers_are_refused_before_the_run(
    option: str, value: str, text: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert text in fails(capsys, "run", "one.toml", option, value)
    assert not (here / "results").exists()


def test_a_folder_that_cannot_be_written(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "taken").write_text("a file")
    assert "taken" in fails(capsys, "run", "one.toml", "--no-plots", "--quiet", "-o", "taken")


def test_output_into_a_closed_pipe_is_no_error(here: Path) -> None:
    done = program(here, "sh", "-c", f"'{sys.executable}' -m vlmb info one.toml | true")
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr


def test_a_folder_that_cannot_be_made_is_refused_before_the_run(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "file").write_text("in the way")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "simulate", lambda *_, **__: pytest.fail("the run had begun"))
        fails(capsys, "run", "skier.toml", "--quiet", "-o", "file/below")


def test_without_matplotlib_the_rest_is_written(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert main(["run", "skier.toml", "--quiet"]) == 0
    printed = capsys.readouterr()
    assert "no plots" in printed.err and "matplotlib" in printed.err
    assert "run.npz" in printed.out and "run.html" in printed.out


def test_ideal_constraints_take_degrees_of_freedom(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    constraints = ["psi1 = 1.2", "2*psi1 = 2.4", "x_dot*sin(phi0) = y_dot*cos(phi0)"]
    write_toml(here / "held.toml", {**SKIER, "constraints": constraints, "start": {"psi1": 1.2}})
    free = len(vlmb.build(vlmb.Scene.from_dict(SKIER)).coordinate_names) - 2
    for command in ("info", "check"):
        assert main([command, "held.toml"]) == 0
        assert re.search(rf"freedom +{free}$|{free} degrees of freedom", capsys.readouterr().out, re.M)
    assert main(["check", "held.toml"]) == 0
    assert "3 equations, 1 of them independent at the start" in capsys.readouterr().out
