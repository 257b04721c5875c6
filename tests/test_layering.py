"""Imports in vlmb/ run one way, in the order of the table "Layout" of CONTRIBUTING.md; closed_form imports numpy alone."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "vlmb"


def documented_order() -> list[str]:
    section = re.search(r"^## Layout$(.*?)^## ", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.M | re.S)
    assert section, "CONTRIBUTING.md has no section 'Layout'"
    return re.findall(r"^\| `(\w+)` \|", section[1], re.M)


def module_names(package: Path) -> set[str]:
    """Names of the modules and subpackages of a package, itself as `__init__`."""
    return {path.stem for path in package.glob("*.py")} | {path.parent.name for path in package.glob("*/__init__.py")}


def sources(package: Path) -> Iterator[tuple[str, Path]]:
    """Every source file with the module of the table it counts as; a subpackage counts as one module."""
    for path in sorted(package.rglob("*.py")):
        yield path.relative_to(package).with_suffix("").parts[0], path


def imports(tree: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    """Every import that is carried out, in functions too; `if TYPE_CHECKING:` is not."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test).rpartition(".")[2] == "TYPE_CHECKING":
            for other in node.orelse:
                yield from imports(ast.Module([other], []))
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            yield node
        else:
            yield from imports(node)


def modules_of(node: ast.Import | ast.ImportFrom, path: Path, package: Path) -> list[str]:
    """Absolute dotted names of what an import loads: `from vlmb import forces` loads vlmb.forces, `import simulate` vlmb."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    source = node.module or ""
    if node.level:
        at = [package.name, *path.relative_to(package).parent.parts]
        source = ".".join([*at[: len(at) - node.level + 1], *filter(None, [node.module])])
    if source == package.name:
        known = module_names(package)
        return [f"{source}.{alias.name}" if alias.name in known else source for alias in node.names]
    return [source]


def violations(package: Path, order: Sequence[str]) -> list[str]:
    """Say of every import of a later module, and of every module missing on either side, what to change."""
    modules = module_names(package)
    found = [f"{name}: not in the table; add a row below everything it imports" for name in sorted(modules - set(order))]
    found += [f"{name}: in the table, but there is no such module; remove its row" for name in order if name not in modules]
    found += [f"{name}: two rows; keep one" for name in sorted(set(order)) if order.count(name) > 1]
    for importer, path in sources(package):
        for node in imports(ast.parse(path.read_text(encoding="utf-8"))):
            for target in modules_of(node, path, package):
                head, _, rest = target.partition(".")
                imported = rest.split(".")[0] or "__init__"
                if head != package.name or imported == importer or not {importer, imported} <= set(order):
                    continue
                if order.index(imported) > order.index(importer):
                    advice = "import from the module itself" if imported == "__init__" else "move the code, or its row"
                    where = f"{path.relative_to(package.parent)}:{node.lineno}"
                    found.append(f"{where}: imports {target}, which is below {importer} in the table; {advice}")
    return found


def test_imports_run_one_way() -> None:
    found = violations(PACKAGE, documented_order())
    assert not found, "\n".join(["the order of imports (CONTRIBUTING.md, Layout) is broken:", *found])


def test_closed_form_imports_numpy_alone() -> None:
    allowed = {"numpy", *sys.stdlib_module_names}
    for module, path in sources(PACKAGE):
        if module == "closed_form":
            for node in imports(ast.parse(path.read_text(encoding="utf-8"))):
                for target in modules_of(node, path, PACKAGE):
                    inside = f"{target}.".startswith("vlmb.closed_form.")
                    assert inside or target.partition(".")[0] in allowed, f"{path.name}:{node.lineno} imports {target}"


@pytest.mark.parametrize(
    "text",
    [
        "import vlmb.high",
        "import vlmb",
        "from vlmb.high import f",
        "from vlmb import high",
        "from vlmb import f",
        "from . import high",
        "from .high import f",
        "def late():\n    from vlmb.high import f",
        "class A:\n    def late(self):\n        if self:\n            import vlmb.high",
        "if TYPE_CHECKING:\n    pass\nelse:\n    from vlmb.high import f",
        "try:\n    from vlmb.part.inner import f\nexcept ImportError:\n    pass",
    ],
)
def test_imports_of_later_modules_are_found(tmp_path: Path, text: str) -> None:
    package = make_package(tmp_path, low=text)
    (found,) = violations(package, ["low", "middle", "part", "high", "__init__"])
    assert found.startswith(f"vlmb/low.py:{1 + text[: text.rindex('import')].count(chr(10))}: imports vlmb")


@pytest.mark.parametrize(
    "text",
    [
        "import numpy",
        "from vlmb.low import f",
        "from vlmb import low",
        "from .low import f",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from vlmb.high import f",
        "import typing\nif typing.TYPE_CHECKING:\n    from vlmb.high import f",
    ],
)
def test_other_imports_are_allowed(tmp_path: Path, text: str) -> None:
    assert violations(make_package(tmp_path, middle=text), ["low", "middle", "part", "high", "__init__"]) == []


def test_relative_imports_of_a_subpackage(tmp_path: Path) -> None:
    order = ["low", "part", "middle", "high", "__init__"]
    assert violations(make_package(tmp_path / "a", part="from .inner import f\nfrom ..low import f"), order) == []
    (found,) = violations(make_package(tmp_path / "b", part="from ..high import f"), order)
    assert "imports vlmb.high" in found


def test_the_table_and_the_modules_agree(tmp_path: Path) -> None:
    package = make_package(tmp_path)
    (found,) = violations(package, ["low", "middle", "part", "__init__"])
    assert found.startswith("high: not in the table")
    (found,) = violations(package, ["low", "middle", "part", "high", "gone", "__init__"])
    assert found.startswith("gone: in the table")


def make_package(folder: Path, **texts: str) -> Path:
    package = folder / "vlmb"
    (package / "part").mkdir(parents=True)
    for name in ("low", "middle", "high", "__init__"):
        (package / f"{name}.py").write_text(texts.get(name, ""), encoding="utf-8")
    (package / "part" / "__init__.py").write_text(texts.get("part", ""), encoding="utf-8")
    (package / "part" / "inner.py").write_text("", encoding="utf-8")
    return package
