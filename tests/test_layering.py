"""Imports in vlmb/ run one way: between folders as CONTRIBUTING.md allows (table "Layout"), within a folder without a circle.

Every kind counts: at the top, in functions, under TYPE_CHECKING, and by name through importlib.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "vlmb"
LONGEST = 400  # lines of a file that is taken in at one sitting


class Import(NamedTuple):
    """An import: where it stands, which module it is in and which it loads, as dotted names without the package's."""

    where: str
    importer: str
    imported: str


def documented_layout() -> dict[str, set[str]]:
    """Folder or module -> what it may import, itself and what those import included."""
    section = re.search(r"^## Layout$(.*?)^## ", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.M | re.S)
    assert section, "CONTRIBUTING.md has no section 'Layout'"
    rows = re.findall(r"^\| `(\w+)` \|[^|]*\|([^|]*)\|$", section[1], re.M)
    assert rows, "the section 'Layout' has no table | `folder` | holds | imports |"
    found: dict[str, set[str]] = {}
    for name, imports in rows:
        named = set(re.findall(r"`(\w+)`", imports))
        assert named <= found.keys(), f"{name} imports what stands below it in the table: {sorted(named - found.keys())}"
        found[name] = {name}.union(*(found[other] for other in named))
    return found


def modules(package: Path) -> dict[str, Path]:
    """Dotted names of all modules without the package's; a folder's own code is its name, the package's own `__init__`."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)] = path
    return found


def imports(package: Path) -> Iterator[Import]:
    """Every import of one module of the package by another."""
    known = modules(package)
    for importer, path in known.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            for target in targets(node, path, package):
                head, _, inner = target.partition(".")
                if head != package.name:
                    continue
                while inner and inner not in known:  # a name in a module
                    inner = inner.rpartition(".")[0]
                imported = inner or "__init__"
                if imported != importer:
                    yield Import(f"{path.relative_to(package.parent)}:{getattr(node, 'lineno', 0)}", importer, imported)


def targets(node: ast.AST, path: Path, package: Path) -> list[str]:
    """Dotted names that a node loads; `from a import b` is a.b. A text that is the dotted name of a module counts as well."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        source = node.module or ""
        if node.level:
            at = [package.name, *path.relative_to(package).parent.parts]
            source = ".".join([*at[: len(at) - node.level + 1], *filter(None, [node.module])])
        return [f"{source}.{alias.name}" for alias in node.names]
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith(f"{package.name}."):
        return [node.value] if node.value.removeprefix(f"{package.name}.") in modules(package) else []
    return []


def part(module: str) -> str:
    """Folder, or module beside the folders."""
    return module.partition(".")[0]


def violations(package: Path, layout: Mapping[str, set[str]]) -> list[str]:
    """Say of every import that the layout does not allow, and of every part missing on either side, what to change."""
    parts = {part(name) for name in modules(package)} - {"__init__"}
    found = [f"{name}: not in the table; add a row" for name in sorted(parts - layout.keys())]
    found += [f"{name}: in the table, but there is no such folder; remove its row" for name in sorted(layout.keys() - parts)]
    for entry in imports(package):
        importer, imported = part(entry.importer), part(entry.imported)
        if importer in layout and importer != imported and imported not in layout[importer]:
            allowed = ", ".join(sorted(layout[importer]))
            found.append(f"{entry.where}: {entry.importer} imports {entry.imported}; {importer} may import {allowed}")
    return found


def circle(package: Path) -> list[str]:
    """Modules that import each other in a ring; folders' own code and the package's own are left out."""
    graph: dict[str, set[str]] = {name: set() for name in modules(package)}
    for entry in imports(package):
        if "." in entry.imported or entry.imported in graph:
            graph[entry.importer].add(entry.imported)
    graph.pop("__init__", None)
    for name in graph:
        graph[name].discard("__init__")
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return [str(name) for name in error.args[1]]
    return []


def test_imports_run_one_way() -> None:
    found = violations(PACKAGE, documented_layout())
    assert not found, "\n".join(["the order of imports (CONTRIBUTING.md, Layout) is broken:", *found])


def test_there_is_no_circle() -> None:
    assert circle(PACKAGE) == []


def test_closed_form_imports_numpy_alone() -> None:
    allowed = {"numpy", *sys.stdlib_module_names}
    for name, path in modules(PACKAGE).items():
        if name.startswith("equations.closed_form"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                for target in targets(node, path, PACKAGE):
                    inside = f"{target}.".startswith("vlmb.equations.closed_form.")
                    assert inside or target.partition(".")[0] in allowed, f"{path.name} imports {target}"


def test_nothing_above_the_model_asks_for_the_kind_of_base() -> None:
    """A layout says what matters of it: whether it has a heading, whether it is on snow."""
    for name, path in modules(PACKAGE).items():
        if name.partition(".")[0] not in ("core", "scene", "model"):
            assert not re.search(r'(base|kind) [!=]= "ski"', path.read_text(encoding="utf-8")), name


def test_a_file_is_taken_in_at_one_sitting() -> None:
    lengths = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in modules(PACKAGE).items()}
    assert not {name: length for name, length in lengths.items() if length > LONGEST}


@pytest.mark.parametrize(
    "text",
    [
        "import vlmb.high.top",
        "import vlmb",
        "from vlmb.high.top import f",
        "from vlmb.high import top",
        "from vlmb import f",
        "from .. import high",
        "from ..high.top import f",
        "def late():\n    from vlmb.high.top import f",
        "class A:\n    def late(self):\n        if self:\n            import vlmb.high",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from vlmb.high.top import f",
        "import importlib\nimportlib.import_module('vlmb.high.top')",
        "try:\n    from vlmb.high.top import f\nexcept ImportError:\n    pass",
    ],
)
def test_forbidden_imports_are_found(tmp_path: Path, text: str) -> None:
    package = make_package(tmp_path, low=text)
    found = violations(package, {"low": {"low"}, "high": {"low", "high"}})
    assert len(found) == 1 and found[0].startswith("vlmb/low/one.py:")


@pytest.mark.parametrize(
    "text", ["import numpy", "from vlmb.low.one import f", "from ..low import one", "from vlmb.high import f"]
)
def test_other_imports_are_allowed(tmp_path: Path, text: str) -> None:
    assert violations(make_package(tmp_path, high=text), {"low": {"low"}, "high": {"low", "high"}}) == []


def test_a_circle_is_found(tmp_path: Path) -> None:
    package = make_package(tmp_path, low="def late():\n    from vlmb.low import two")
    assert circle(package) == []
    (package / "low" / "two.py").write_text("from vlmb.low import one", encoding="utf-8")
    assert {"low.one", "low.two"} <= set(circle(package))


def test_the_table_and_the_folders_agree(tmp_path: Path) -> None:
    package = make_package(tmp_path)
    assert violations(package, {"low": {"low"}}) == ["high: not in the table; add a row"]
    (found,) = violations(package, {"low": {"low"}, "high": {"high"}, "gone": {"gone"}})
    assert found.startswith("gone: in the table")


def make_package(folder: Path, **texts: str) -> Path:
    package = folder / "vlmb"
    for name, module in (("low", "one"), ("high", "top")):
        (package / name).mkdir(parents=True)
        (package / name / "__init__.py").write_text("", encoding="utf-8")
        (package / name / f"{module}.py").write_text(texts.get(name, ""), encoding="utf-8")
    (package / "__init__.py").write_text("", encoding="utf-8")
    return package
