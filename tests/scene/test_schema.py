"""The JSON schema of scenes: every model fits, what vlmb refuses does not."""

from __future__ import annotations

import copy
import json
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.small_scenes import PIVOT, link
from vlmb.cli import main
from vlmb.scene.schema import scene_schema
from vlmb.scene.tables import SceneTables, Segment

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

jsonschema = pytest.importorskip("jsonschema")
MODELS = sorted((Path(__file__).resolve().parents[2] / "models").glob("*.toml"))
PENDULUM: dict[str, Any] = {"base": PIVOT, "links": [link("leg")], "parameters": {"k": 3.0}}


@pytest.fixture(scope="module")
def checker() -> Any:
    schema = scene_schema()
    kind = jsonschema.validators.validator_for(schema)
    kind.check_schema(schema)
    return kind(schema)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_every_model_fits(path: Path, checker: Any) -> None:
    found = [error.message for error in checker.iter_errors(tomllib.loads(path.read_text(encoding="utf-8")))]
    assert not found


def with_changes(**keys: Any) -> dict[str, Any]:
    return {**copy.deepcopy(PENDULUM), **keys}


def test_a_number_may_be_an_expression_and_a_point_a_name(checker: Any) -> None:
    checker.validate(with_changes(gravity="3*k"))
    checker.validate(with_changes(springs=[{"between": ["leg.tip", [0.0, 0.0, "k"]], "stiffness": "2*k"}]))
    checker.validate(with_changes(forces=[{"on": "M_psi1", "law": "sin(t)"}, {"on": "M_psi1", "law": 2}]))


@pytest.mark.parametrize(
    "keys",
    [
        {"gravitty": 9.81}, {"gravity": True}, {"gravity": -1.0}, {"slope": 12}, {"base": {"kind": "pivott"}}, {"links": {}},
        {"links": [{"rod": {"length": 1.0}}]}, {"links": [link("1 leg")]}, {"run": {"method": "rk5"}}, {"plane": "yes"},
        {"programme": {"constraints": [], "controls": ["M_psi1"]}}, {"start": [1.0]},
    ],
    ids=str,
)  # fmt: skip
def test_mistakes_do_not_fit(keys: dict[str, Any], checker: Any) -> None:
    assert not checker.is_valid(with_changes(**keys))


def test_remarks_and_defaults_come_along() -> None:
    schema = scene_schema()
    assert schema["$defs"]["Segment"]["properties"]["stiffness"]["description"] == "[N/m]"
    assert schema["properties"]["gravity"] == {
        "anyOf": [{"type": "number", "minimum": 0.0}, {"type": "string", "description": "an expression of parameters"}],
        "description": "[m/s^2]", "default": 9.81,
    }  # fmt: skip
    assert list(schema["properties"]) == list(SceneTables.__struct_fields__)
    assert list(schema["$defs"]["Segment"]["properties"]) == [field.name for field in msgspec.structs.fields(Segment)]
    assert '"null"' not in json.dumps(schema)  # TOML has none


def test_the_command_prints_it_or_writes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == scene_schema()
    assert main(["schema", "-o", str(tmp_path / "scene.json")]) == 0
    assert json.loads((tmp_path / "scene.json").read_text(encoding="utf-8")) == scene_schema()
    assert "scene.json" in capsys.readouterr().out
