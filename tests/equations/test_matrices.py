"""`vlmb matrices`: what it prints is what the equations hold, in every format."""

from __future__ import annotations

import csv
import io
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import vlmb
from tests.reference.equation_cases import Table, random_scene
from tests.small_scenes import write_toml
from vlmb.cli import make_parser
from vlmb.equations import matrices


def run(*words: str | Path) -> int:
    args = make_parser().parse_args(["matrices", *map(str, words)])
    return int(args.execute(args))


@pytest.fixture
def skier(tmp_path: Path) -> Path:
    table: Table = random_scene(2, "ski")
    table["links"][1]["name"] = "trunk"
    table["start"] = {"phi0": 0.4, "psi1": 1.1, "psi2": 0.3, "phi2": 0.9, "speed": 5.0, "phi1_dot": 0.7}
    return write_toml(tmp_path / "skier.toml", {"name": "two & more_links 100% {é}", **table})


def printed(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    assert run(*words) == 0
    return capsys.readouterr().out


def test_posture_is_the_start_and_what_differs(skier: Path) -> None:
    eom = matrices.at_posture(skier, ["psi1=1.2", "phi0=-0.3", "psi2_dot=2"], "speed")
    assert (eom.coordinates["psi1"], eom.coordinates["psi2"], eom.coordinates["phi0"]) == (1.2, 0.3, -0.3)
    assert (eom.rates["psi2_dot"], eom.rates["phi1_dot"]) == (2.0, 0.7)
    np.testing.assert_allclose([eom.rates["x_dot"], eom.rates["y_dot"]], [5 * np.cos(0.3), -5 * np.sin(0.3)])
    np.testing.assert_allclose(matrices.at_posture(skier, ["speed=2"]).rates["x_dot"], 2 * np.cos(0.4))
    assert matrices.at_posture(skier, ["x_dot=2"]).rates["y_dot"] == 0.0


@pytest.mark.parametrize("form", ["full", "chaplygin", "speed"])
def test_csv_has_every_entry_to_the_last_digit(skier: Path, capsys: pytest.CaptureFixture[str], form: str) -> None:
    eom = matrices.at_posture(skier, ["psi1=1.2"], form)
    rows = list(csv.DictReader(io.StringIO(printed(capsys, skier, "--at", "psi1=1.2", "--form", form, "--format", "csv"))))
    read = {(row["block"], row["row"], row["column"]): float(row["value"]) for row in rows}
    expected = {
        (block, name, column): value
        for (block, row), values in eom.blocks.items()
        for name, line in zip(eom.rows[row], values.reshape(len(eom.rows[row]), -1).tolist(), strict=True)
        for column, value in zip(eom.columns[block], line, strict=True)
    }
    assert read == expected
    assert len(rows) == len(read) > 200


def test_whole_matrix_and_bias(skier: Path, capsys: pytest.CaptureFixture[str]) -> None:
    eom = matrices.at_posture(skier, ["phi1_dot=0.5"])
    out = printed(capsys, skier, "--at", "phi1_dot=0.5", "--block", "mass_matrix", "bias", "--format", "csv")
    read = {(row["block"], row["row"], row["column"]): float(row["value"]) for row in csv.DictReader(io.StringIO(out))}
    for i, name in enumerate(eom.names):
        assert read.pop(("bias", name, "1")) == eom.bias[i] != 0.0 or name == "phi0"
        for j, column in enumerate(eom.names):
            assert read.pop(("mass_matrix", name, f"{column}_ddot")) == eom.mass_matrix[i, j]
    assert not read


def test_values_that_overflow_are_refused(skier: Path) -> None:
    with pytest.raises(vlmb.VlmbError, match="overflow at this posture"):
        run(skier, "--at", "xi1_1=1e160", "--block", "A")


def test_npz(skier: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    eom = matrices.at_posture(skier)
    assert "wrote" in printed(capsys, skier, "--format", "npz", "--output", tmp_path / "out.npz")
    with np.load(tmp_path / "out.npz") as stored:
        np.testing.assert_array_equal(stored["mass_matrix"], eom.mass_matrix)
        np.testing.assert_array_equal(stored["bias"], eom.bias)
        assert stored["condition"] == eom.condition
        assert tuple(stored["names"]) == eom.names
        for (block, row), value in eom.blocks.items():
            np.testing.assert_array_equal(stored[f"{block}_{row}"], value)
        assert tuple(stored["columns_F1"]) == eom.columns["F1"] and tuple(stored["rows_xi1"]) == ("xi1_1", "xi2_1")
        assert dict(zip(stored["coordinate_names"], stored["coordinates"], strict=True)) == eom.coordinates
    run(skier, "--format", "npz", "--output", tmp_path / "out.npz", "--block", "A")
    with np.load(tmp_path / "out.npz") as stored:
        assert "A_x" in stored and "B_x" not in stored


def test_text_names_rows_and_columns(skier: Path, capsys: pytest.CaptureFixture[str]) -> None:
    eom = matrices.at_posture(skier)
    out = printed(capsys, skier, "--block", "A", "K", "--block", "bias")
    assert "form full, condition number of the mass matrix" in out and "psi1 = 1.1" in out
    lines = out.split("\n\nA\n")[1].splitlines()
    assert lines[0].split() == ["phi1_ddot", "phi2_ddot"]
    first = next(line for line in lines if line.startswith("phi2 (trunk)"))
    values = np.array(first.split()[2:], dtype=float)
    np.testing.assert_allclose(values, eom.blocks["A", "phi"][1], rtol=1e-5)
    assert re.search(r"^phi0 +0 +0$", out, re.MULTILINE)
    weight = out.split("\n\nK\n")[1].split("\n\n")[0].splitlines()[1:]
    assert weight[3].split()[-1] == "0" and matrices._rounding(eom) == 1e-14 * eom.mass_matrix.max()  # rounding is shown as 0
    np.testing.assert_allclose([float(line.split()[-1]) for line in weight][3:5], eom.blocks["K", "phi"], rtol=1e-5, atol=1e-12)
    assert [line.split()[0] for line in out.split("\n\nbias\n")[1].splitlines()[1:]] == list(eom.names)


def test_wide_tables_are_cut_into_parts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chain = write_toml(tmp_path / "chain.toml", random_scene(20, "pivot"))
    out = printed(capsys, chain, "--block", "mass_matrix", "--at", *(f"psi{i}=0.{i}" for i in range(1, 21)))
    assert max(map(len, out.splitlines())) <= matrices.WIDTH + 2
    assert out.count("mass_matrix, continued") == 9
    assert re.findall(r"\S+_ddot", out) == [f"{name}_ddot" for name in matrices.at_posture(chain).names]


def test_latex_is_well_formed(skier: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = printed(capsys, skier, "--format", "latex", "--form", "chaplygin")
    assert out.isascii()
    assert out.startswith(r"\documentclass") and out.endswith("\\end{document}\n")
    assert r"two \& more\_links 100\% ???" in out
    depth = 0
    for sign in re.sub(r"\\[{}&%#_]", "", out):
        depth += {"{": 1, "}": -1}.get(sign, 0)
        assert depth >= 0
    assert depth == 0
    assert out.count(r"\[") == out.count(r"\]") == out.count(r"\begin{array}") == out.count(r"\end{array}") > 14
    for kinds, body in re.findall(r"\\begin\{array\}\{r\|(r+)\}(.*?)\\end\{array\}", out, re.DOTALL):
        rows = body.strip().splitlines()
        assert {row.count("&") for row in rows} == {len(kinds)}
        assert all(row.endswith(("\\\\", "\\hline")) for row in rows)
    assert r"2\,\dot{\varphi}_{1}\,\dot{\xi}_{1,2}" in out and r"\dot{x}\,\dot{\varphi}_{0}" in out and r"\ddot{\psi}_{2}" in out


def test_latex_numbers() -> None:
    assert matrices._tex_number(-1.25e-7, 0.0) == r"-1.25\cdot 10^{-7}"
    assert matrices._tex_number(3e25, 0.0) == r"3\cdot 10^{25}"
    assert matrices._tex_number(1e-15, 1e-14) == "0"


def test_latex_of_a_large_matrix_is_cut_into_parts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chain = write_toml(tmp_path / "chain.toml", random_scene(50, "ski"))
    out = printed(capsys, chain, "--format", "latex", "--block", "mass_matrix")
    assert out.count("continued") == 2
    assert out.count(r"\ddot") == 203
    width = re.search(r"paperwidth=(\d+)mm", out)
    assert width and int(width[1]) < 5700


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="pdflatex is not installed (Debian: apt install texlive-latex-base)")
@pytest.mark.parametrize("large", [False, True])
def test_latex_compiles(skier: Path, tmp_path: Path, large: bool) -> None:
    if large:
        skier = write_toml(tmp_path / "chain.toml", random_scene(50, "ski"))
    blocks = ("--block", "mass_matrix") if large else ()
    run(skier, "--format", "latex", "--output", tmp_path / "out.tex", "--form", "speed", *blocks)
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "out.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout[-2000:]
    assert (tmp_path / "out.pdf").stat().st_size > 10_000
    assert "Overfull" not in done.stdout


REFUSED = [
    (["--at", "psi1"], "--at psi1: must be NAME=VALUE"),
    (["--at", "psi1=nan"], "--at psi1=nan: must be NAME=VALUE with a finite number"),
    (["--at", "psi9=1"], "unknown coordinate 'psi9'; did you mean"),
    (["--at", "phi9_dot=1"], "unknown rate 'phi9_dot'; did you mean"),
    (["--block", "C"], "--block C: no such block; did you mean|valid names: .*C1"),
    (["--block", "SPEED"], "--block SPEED: no such block"),
    (["--format", "npz"], "needs --output FILE"),
    (["--at", "speed=1", "x_dot=1"], "either speed or x_dot"),
]


@pytest.mark.parametrize(("words", "message"), REFUSED)
def test_errors(skier: Path, words: list[str], message: str) -> None:
    with pytest.raises(vlmb.VlmbError, match=message):
        run(skier, *words)
