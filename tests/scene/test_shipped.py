"""Models by their names."""

from __future__ import annotations

from pathlib import Path

import pytest

import vlmb
from vlmb.scene.shipped import model_file, model_folder, model_lines, model_names


def test_each_model_has_a_line() -> None:
    lines = model_lines()
    assert sorted(lines) == model_names()
    assert all(0 < len(line) < 120 for line in lines.values())


def test_every_model_is_read_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in model_names():
        assert vlmb.load_scene(name) == vlmb.load_scene(model_folder() / f"{name}.toml")


def test_the_end_of_a_name_is_enough_where_it_is_the_only_one() -> None:
    assert model_file("slalom").stem == "skier_slalom"
    assert model_file("two_links").stem == "two_links"


@pytest.mark.parametrize(
    ("name", "texts"),
    [
        ("slalm", ("slalm: no such scene file", "did you mean", "'skier_slalom'", "`vlmb models`")),
        ("body", ("several models end so", "'skier_whole_body'", "'skier_slalom_whole_body'")),
        ("nothing.toml", ("nothing.toml: no such scene file",)),
    ],
)
def test_names_of_no_model(name: str, texts: tuple[str, ...]) -> None:
    with pytest.raises(vlmb.SceneError) as caught:
        vlmb.load_scene(name)
    assert all(text in str(caught.value) for text in texts), str(caught.value)


def test_a_file_comes_before_a_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("one_link").write_text('name = "mine"\nbase.kind = "pivot"\n[[links]]\nrod = {length = 1.0, mass = 1.0}\n')
    assert vlmb.load_scene("one_link").name == "mine"
