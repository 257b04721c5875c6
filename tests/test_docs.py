"""The documentation: the site builds without a warning, refers to nothing that is missing, and all code on it runs."""

from __future__ import annotations

import html.parser
import inspect
import json
import os
import posixpath
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

import vlmb
from tests.page_runner import agree, blocks_of, commands_of
from vlmb.views.plots import PLOTS

NEEDED = (
    "mkdocs", "mkdocstrings", "material", "math_core", "nbclient", "nbformat", "ipykernel", "PIL", "meshcat", "pandas", "xarray",
)  # fmt: skip
for package in NEEDED:
    pytest.importorskip(package, reason=f"{package} is not installed, so the site cannot be built")

ROOT = Path(__file__).resolve().parents[1]
OUTSIDE = [ROOT / "models" / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "benchmarks" / "results").glob("*.md")]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), *OUTSIDE])
NAMES = [page.relative_to(ROOT).as_posix() for page in PAGES]
LANGUAGES = {"python", "toml", "console", "sh", "text", ""}
Run = Callable[[Path, Path], tuple[int, str]]
HERE = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg", "NO_MKDOCS_2_WARNING": "1"}


def test_no_page_holds_what_a_merge_left() -> None:
    for page in [*PAGES, ROOT / "README.md", ROOT / "CHANGELOG.md"]:
        assert not re.search(r"^(<{7}|={7}|>{7})( |$)", page.read_text(encoding="utf-8"), re.MULTILINE), page


class Found(html.parser.HTMLParser):
    """What a page of the site holds: anchors, links, loaded files, pictures without a text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.mute: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.ids |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        self.loads += [given["src"]] if "src" in given else []
        self.loads += [given["href"]] if tag == "link" and given.get("rel") != "canonical" else []
        if tag == "img" and not given.get("alt"):
            self.mute.append(given.get("src", "?"))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(words, cwd=ROOT, env=HERE, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    complaints = [line for line in (done.stdout + done.stderr).splitlines() if re.match(r"(WARNING|ERROR)\b", line)]
    assert complaints == []
    return folder


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[str, Found]:
    """Return the pages of the site by path; the pages that play, and the one for wrong addresses, have no place of their own."""
    own = [path for path in site.rglob("*.html") if path.relative_to(site).parts[0] not in ("gallery", "404.html")]
    return {path.relative_to(site).as_posix(): Found(path.read_text("utf-8")) for path in own}


# code on the pages -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run() -> Iterator[Run]:
    """Return what runs a page in a folder, in a process of its own, and tells its exit code and what it said."""
    words = [sys.executable, str(ROOT / "tests" / "page_runner.py")]
    with subprocess.Popen(words, env=HERE, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as runner:
        assert runner.stdin and runner.stdout
        ask, answers = runner.stdin, runner.stdout

        def run_page(page: Path, folder: Path) -> tuple[int, str]:
            said = folder / "said.txt"
            print(json.dumps([str(page), str(folder), str(said)]), file=ask, flush=True)
            code = int(answers.readline())
            return code, said.read_text(encoding="utf-8")

        yield run_page
        ask.close()


@pytest.mark.parametrize("name", [name for name, page in zip(NAMES, PAGES, strict=True) if blocks_of(page.read_text("utf-8"))])
def test_the_code_on_a_page_runs(name: str, tmp_path: Path, run: Run) -> None:
    (tmp_path / "models").symlink_to(ROOT / "models")
    code, said = run(ROOT / name, tmp_path)
    assert code == 0, f"{name}:\n{said}"


@pytest.mark.parametrize("name", NAMES)
def test_every_block_is_of_a_kind_that_runs(name: str) -> None:
    for block in blocks_of((ROOT / name).read_text("utf-8")):
        assert block.language in LANGUAGES, f"{name}:{block.line}: no runner for {block.language!r}; use one of {LANGUAGES}"


def test_the_runner_notices_what_is_wrong(tmp_path: Path, run: Run) -> None:
    page = tmp_path / "page.md"

    def complaints(text: str) -> str:
        page.write_text(text, encoding="utf-8")
        code, said = run(page, tmp_path)
        assert (code == 0) == (said.strip() == "")
        return said

    assert complaints("```python\nprint(2.0)\n```\n\n```text\n2.001\n```\n") == ""
    assert "prints something else" in complaints("```python\nprint(2.0)\n```\n\n```text\n2.1\n```\n")
    assert "NameError" in complaints("```python\nunknown\n```\n")
    assert "exit code 1" in complaints("```sh\nvlmb check nothing.toml\n```\n")
    assert complaints("```console\n$ vlmb check nothing.toml\nvlmb check: nothing.toml: no such scene file\n```\n") == ""
    assert "SceneError" in complaints('```toml\n[start]\npsi7 = 1.0\n```\n')


def test_outputs_are_compared_up_to_the_last_digits() -> None:
    assert agree("phi 1.000 rad, ... s", "phi 1.004 rad, 0.31 s")
    assert agree("error 2e-08", "error 7e-09")
    assert not agree("phi 1.000 rad", "phi 1.02 rad")
    assert not agree("error 2e-08", "error 2e-02")
    assert not agree("three links", "four links")
    (block,) = blocks_of("```console\n$ vlmb check a.toml\nfine\n$ ls\n$ vlmb info a.toml\n```\n")
    assert commands_of(block) == [("vlmb check a.toml", "fine\n"), ("vlmb info a.toml", None)]


# the site ----------------------------------------------------------------------------------------------------------


def test_the_table_of_promises_names_files_that_exist() -> None:
    rows = re.findall(r"^\| .* \| (`.*`) \|$", (ROOT / "docs" / "promises.md").read_text(encoding="utf-8"), re.M)
    named = [name for row in rows for name in re.findall(r"`([\w/]+\.py)`", row)]
    assert len(rows) > 15 and len(named) > 40
    assert [name for name in named if not (ROOT / "tests" / name).is_file()] == []


def test_every_link_leads_somewhere(site: Path, pages: dict[str, Found]) -> None:
    broken = []
    for name, page in pages.items():
        for link in [*page.links, *page.loads]:
            target, anchor = urldefrag(unquote(link))
            if re.match(r"(https?|mailto|data):", link):
                continue
            path = posixpath.normpath(posixpath.join(posixpath.dirname(name), target)) if target else name
            there = site / path
            if not (there.is_file() or (there / "index.html").is_file()):
                broken.append(f"{name}: {link}: no such file")
            elif anchor and path in pages and anchor not in pages[path].ids and not anchor.startswith("__"):
                broken.append(f"{name}: {link}: no such anchor")
    assert broken == []
    assert sum(len(page.links) for page in pages.values()) > 500


def test_the_site_loads_nothing_from_elsewhere(pages: dict[str, Found]) -> None:
    assert [(name, load) for name, page in pages.items() for load in page.loads if re.match(r"(https?:)?//", load)] == []


def test_every_picture_has_a_text(pages: dict[str, Found]) -> None:
    assert [(name, page.mute) for name, page in pages.items() if page.mute] == []


def test_formulas_are_drawn_by_the_browser(site: Path) -> None:
    theory = (site / "theory.html").read_text("utf-8")
    assert theory.count("<math") > 50
    assert not re.search(r'class="arithmatex">\\[(\[]', theory)


def test_every_public_name_is_on_the_api_page(site: Path, pages: dict[str, Found]) -> None:
    known = pages["api.html"].ids
    for name in set(vlmb.__all__) - {"__version__"}:
        entry = getattr(vlmb, name)
        path = entry.__name__ + "." if inspect.ismodule(entry) else f"{entry.__module__}.{entry.__qualname__}"
        assert any(anchor.startswith(path) for anchor in known), f"{name} is missing in docs/api.md"
    for entry in (vlmb.Mechanism, vlmb.Trajectory, vlmb.EquationsOfMotion):
        for name in {name for name, member in vars(entry).items() if name[0] != "_" and inspect.getdoc(member)} - {"from_run"}:
            path = f"{entry.__module__}.{entry.__qualname__}.{name}"
            assert path in known, f"{path} is missing in docs/api.md"
    for name in ("show", "play", "export_html", "picture"):
        assert f"vlmb.views.view.{name}" in known
    text = (site / "api.html").read_text("utf-8")
    for name in PLOTS:
        assert f"<code>{name}</code>" in text, f"the figure {name} is missing in docs/api.md"


def test_every_shipped_scene_is_in_the_gallery(site: Path, pages: dict[str, Found]) -> None:
    scenes = {path.stem for path in (ROOT / "models").glob("*.toml")}
    pictures = {path.stem for path in (ROOT / "docs" / "images" / "gallery").glob("*.jpg")}
    advice = "run scripts/gallery --docs, look at the picture, and commit it"
    assert scenes == pictures, f"{sorted(scenes ^ pictures)}: {advice}"
    assert {f"images/gallery/{name}.jpg" for name in scenes} <= set(pages["gallery.html"].loads)


@pytest.mark.parametrize(
    ("name", "pictures", "texts"),
    [
        ("skier", 4, ["energy balance", "<iframe srcdoc="]),
        ("stability", 2, ["grows with", "asymptotically stable", "<iframe srcdoc="]),
    ],
)
def test_notebooks_ran_and_show_their_results(site: Path, name: str, pictures: int, texts: list[str]) -> None:
    import nbformat

    notebook = nbformat.read(ROOT / "docs" / "notebooks" / f"{name}.ipynb", as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in code), "clear the outputs before committing"
    page = (site / "notebooks" / f"{name}.html").read_text("utf-8")
    shown = page.split('<div class="notebook-output">')[1:]
    assert len(shown) == len(code) > 5
    assert sum("data:image/png;base64," in part for part in shown) >= pictures
    assert all(text in page for text in texts)
    assert "<!-- output" not in page
