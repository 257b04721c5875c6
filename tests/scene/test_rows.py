"""Named rows, and the one space of names of a scene."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import PIVOT, SKI, link, scene, table
from vlmb.scene.rows import read_row, rows_of
from vlmb.views.reference_path import steering

COURSE, LEAN = "tan(phi0) = A*k*cos(k*x)", "phi1 = phi0"
PROGRAMME = {"constraints": [f"course: {COURSE}", " psi1 = 1.3 "], "controls": ["M_phi0", "M_psi1"], "frequency": 6.0}
KEYS: dict[str, Any] = {"parameters": {"A": 0.5, "k": 0.4}, "start": {"psi1": 1.3, "speed": 4.0}, "run": {"duration": 0.2}}


def named() -> vlmb.Scene:
    programme = {**PROGRAMME, "secondary": [], "constraints": list(PROGRAMME["constraints"])}
    return vlmb.Scene.from_dict(table(SKI, [link("legs")], constraints=[f" lean :  {LEAN}"], programme=programme) | KEYS)


def test_a_name_is_the_only_key(tmp_path: Path) -> None:
    run = vlmb.simulate(named())
    assert list(run.residuals) == ["knife_edge", "lean", "course", "psi1 = 1.3"]
    assert [run.residuals[name].equation for name in run.residuals] == ["", LEAN, COURSE, "psi1 = 1.3"]
    assert "lean" in run.reactions and LEAN not in run.reactions
    with pytest.raises(vlmb.TrajectoryError, match="no residual 'phi1 = phi0'"):
        run.residuals[LEAN]
    position, velocity = run.residuals["course"]
    expected = np.tan(run["phi0"]) - 0.2 * np.cos(0.4 * run["x"])
    assert np.abs(position - expected).max() < 1e-12
    assert velocity is run.residuals["course"].velocity
    assert "residual         course: " in run.summary() and "residual         lean: " in run.summary()
    header = next(csv.reader(run.save_csv(tmp_path / "run.csv").read_text().splitlines()))
    assert {"lean", "residual:lean", "residual_dot:lean"} <= set(header) and LEAN not in header
    again = vlmb.load_trajectory(run.save(tmp_path / "run.npz"))
    assert np.array_equal(again.residuals["course"].position, position)
    assert np.array_equal(again.reactions["lean"], run.reactions["lean"])


def test_a_name_changes_no_number() -> None:
    bare = named().changed(constraints=[LEAN], programme={"constraints": [COURSE, "psi1 = 1.3"]})
    first, second = vlmb.simulate(named()), vlmb.simulate(bare)
    assert np.array_equal(first.q, second.q)
    assert np.array_equal(first.reactions["lean"], second.reactions[LEAN])
    assert np.array_equal(first.residuals["course"].position, second.residuals[COURSE].position)


@pytest.mark.parametrize("text", [" phi1 = 0.3*t ", "phi1 = 0.3*t\n", "\tphi1 = 0.3*t"])
def test_spaces_around_an_equation_are_no_part_of_its_key(text: str, tmp_path: Path) -> None:
    run = vlmb.simulate(scene(PIVOT, [link("a")], constraints=[text], start={"psi1": 0.4}), duration=0.05)
    assert list(run.reactions) == list(run.residuals) == ["phi1 = 0.3*t"]
    assert np.isfinite(run.reactions["phi1 = 0.3*t"]).all()
    assert "phi1 = 0.3*t" in next(csv.reader(run.save_csv(tmp_path / "run.csv").read_text().splitlines()))


def test_figures_and_the_course_know_named_rows() -> None:
    from vlmb.views.programme_plots import deviations
    from vlmb.views.reference_path import course

    equation = steering(named())
    assert equation is not None and equation.text == COURSE
    assert course(named(), np.linspace(0.0, 1.0, 20), np.full(20, 4.0), (0.0, 0.0, 0.2)) is not None
    titles = [ax.get_title(loc="left") for ax in deviations(vlmb.simulate(named())).axes]
    assert any(title.startswith("course: ") for title in titles)


def test_rows_are_read() -> None:
    assert read_row(" a_1 : x = 2 ", "k") == ("a_1", "x = 2", "k")
    assert read_row(" x = 2 ", "k") == ("x = 2", "x = 2", "k")
    ideal, servo, secondary = rows_of(named())
    assert ([row.name for row in ideal], [row.key for row in servo]) == (
        ["lean"], ["programme.constraints[0]", "programme.constraints[1]"]
    )  # fmt: skip
    assert (secondary, ideal[0].named, servo[1].named) == ((), True, False)


@pytest.mark.parametrize(
    ("keys", "texts"),
    [
        ({"constraints": ["my row: phi1 = 0"]}, ("constraints[0]", "names the row", "letters, digits and _")),
        ({"constraints": ["1: phi1 = 0"]}, ("constraints[0]", "names the row")),
        ({"constraints": [": phi1 = 0"]}, ("constraints[0]", "names the row")),
        ({"constraints": ["a: phi1 = 0", "a: psi1 = 1"]}, ("constraints[1]", "'a'", "constraints[0] has this name already")),
        ({"constraints": ["legs: phi1 = 0"]}, ("constraints[0]", "'legs'", "links[0] has this name already")),
        (
            {"constraints": ["a: phi1 = 0"], "programme": {"constraints": ["a: phi1 = 0"], "controls": ["M_psi1"]}},
            ("programme.constraints[0]", "constraints[0] has this name already"),
        ),
        (
            {"programme": {"constraints": ["a: phi1 = 0"], "controls": ["M_psi1"], "secondary": ["a: psi1 = 0"]}},
            ("programme.secondary[0]", "programme.constraints[0] has this name already"),
        ),
        ({"constraints": ["com: phi1 = 0"]}, ("constraints[0]", "'com'", "choose another")),
        ({"constraints": ["psi1: phi1 = 0"]}, ("constraints[0]", "'psi1'", "a coordinate")),
        ({"constraints": ["M_psi1: phi1 = 0"]}, ("constraints[0]", "'M_psi1'", "a force")),
        ({"constraints": ["energy: phi1 = 0"]}, ("constraints[0]", "'energy'", "an energy")),
    ],
)
def test_names_that_clash_are_refused(keys: dict[str, Any], texts: tuple[str, ...]) -> None:
    with pytest.raises(vlmb.SceneError) as caught:
        scene(PIVOT, [link("legs")], **keys)
    for text in texts:
        assert text in str(caught.value)


RESERVED = ["base", "ski", "ground", "heading", "com", "speed", "normal", "friction", "knife_edge", "impacts", "t", "phase_t"]


@pytest.mark.parametrize("name", RESERVED)
def test_reserved_words_name_nothing(name: str) -> None:
    with pytest.raises(vlmb.SceneError, match=rf"links\[1\]\.name = '{name}': this name is .*choose another"):
        scene(PIVOT, [link("a"), link(name)])
    with pytest.raises(vlmb.SceneError, match=rf"constraints\[0\]: the row's name '{name}': this name is"):
        scene(PIVOT, [link("a")], constraints=[f"{name}: phi1 = 0"])


def test_rows_without_a_name_may_repeat() -> None:
    made = scene(PIVOT, [link("a")], constraints=["phi1 = 0", " phi1 = 0"], start={"psi1": 0.3})
    assert list(vlmb.simulate(made, duration=0.01).residuals) == ["phi1 = 0"]


@pytest.mark.parametrize("name", ["M_psi1", "F1_1", "T_a", "knife_edge", "normal", "kinetic", "balance"])
def test_results_may_not_stand_in_laws_and_equations(name: str) -> None:
    row = {"constraints": [f"psi1 = {name}"]}
    force = {"forces": [{"on": "M_psi1", "law": f"2*{name}"}]}
    length = {"links": [link("a", lower={"motion": "prescribed", "law": f"0.2 + {name}"})]}
    for keys, key in ((force, "forces[0].law"), (length, "links[0].lower.law"), (row, "constraints[0]")):
        with pytest.raises(vlmb.SceneError, match="may not name forces, reactions or energies") as caught:
            vlmb.check({**table(PIVOT, [link("a")]), **keys})
        assert key in str(caught.value) and name in str(caught.value)
