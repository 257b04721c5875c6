"""What the site needs beyond MkDocs: formulas, files of the repository that pages link to, the gallery, notebooks."""

from __future__ import annotations

import base64
import html
import posixpath
import re
from functools import cache
from pathlib import Path
from typing import Any

from math_core import LatexError, LatexToMathML
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
REPOSITORY = "repository"  # where files from outside docs/ stand in the site
NOTEBOOKS = [f"notebooks/{path.stem}" for path in sorted((DOCS / "notebooks").glob("*.ipynb"))]
FORMULA = re.compile(r'(?P<tag><(?:span|div) class="arithmatex">)\\(?P<open>[(\[])(?P<latex>.*?)\\[)\]]', re.S)
PICTURES = DOCS / "images" / "gallery"  # what scripts/gallery --docs writes
PLAYERS = ROOT / "results" / "gallery"  # pages that play, where scripts/gallery wrote them
REPORTS = sorted((ROOT / "benchmarks" / "results").glob("*.md"))
LINK = re.compile(r"(\]\()([^)\s#]+)((?:#[^)\s]*)?\))")
FENCE = re.compile(r"^(?P<fence>```+|~~~+).*?^(?P=fence)[ \t]*$", re.M | re.S)


def on_config(config: Any) -> None:
    """Put the benchmarks into the navigation: pages that have no place in it yet, then every report, by its title."""
    pages = [name for name in ("benchmarks.md", "hard_cases.md") if (DOCS / name).exists() and f"'{name}'" not in str(config.nav)]
    entries = [{title_of(DOCS / name): name} for name in pages]
    entries += [{title_of(path): f"{REPOSITORY}/{path.relative_to(ROOT).as_posix()}"} for path in REPORTS]
    for section in config.nav:
        if "Benchmarks" in section:
            section["Benchmarks"] = entries


def title_of(path: Path) -> str:
    """Title of a page: its first heading."""
    return path.read_text(encoding="utf-8").partition("# ")[2].partition("\n")[0].strip()


def on_files(files: Files, config: Any) -> Files:
    """Add files of the repository that pages link to, the gallery's pictures and the notebooks' pages."""
    pages = [f"docs/{file.src_uri}" for file in files.documentation_pages()]
    seen = {"CONTRIBUTING.md", *(path.relative_to(ROOT).as_posix() for path in REPORTS)}
    waiting = [*pages, *seen]
    while waiting:
        path = waiting.pop()
        for target in outside(path, (ROOT / path).read_text(encoding="utf-8")) - seen:
            seen.add(target)
            if target.endswith(".md"):
                waiting.append(target)
    for path in sorted(seen):
        files.append(_generated(config, f"{REPOSITORY}/{path}", abs_src_path=str(ROOT / path)))
    for path in sorted(PLAYERS.glob("*.html")):
        files.append(_generated(config, f"gallery/{path.name}", abs_src_path=str(path)))
    for name in NOTEBOOKS:
        files.append(File.generated(config, f"{name}.md", content=notebook_page(DOCS / f"{name}.ipynb")))
    return files


def on_page_markdown(markdown: str, page: Page, config: Any, files: Files) -> str:
    """Set displayed formulas apart, point links to files of the repository into the site, fill the gallery."""
    source = page.file.src_uri
    path = source.removeprefix(f"{REPOSITORY}/") if source.startswith(f"{REPOSITORY}/") else f"docs/{source}"
    if "<!-- gallery -->" in markdown:
        markdown = markdown.replace("<!-- gallery -->", gallery())
    if "<!-- promises -->" in markdown:
        markdown = markdown.replace("<!-- promises -->", (DOCS / "acceptance" / "promises.md").read_text(encoding="utf-8"))
    if "<!-- figures -->" in markdown:
        markdown = markdown.replace("<!-- figures -->", figures())
    parts, end = [], 0
    for fence in FENCE.finditer(markdown):
        parts += [_prose(markdown[end : fence.start()], path, source), fence[0]]
        end = fence.end()
    return "".join([*parts, _prose(markdown[end:], path, source)])


def on_page_content(content: str, page: Page, config: Any, files: Files) -> str:
    """Turn formulas into MathML, which browsers draw by themselves; put the outputs of notebooks in."""
    converter = LatexToMathML(fancy_error=False)

    def formula(match: re.Match[str]) -> str:
        latex = html.unescape(match["latex"])
        try:
            math = converter.convert_with_local_state(latex, displaystyle=match["open"] == "[")
        except LatexError as error:
            raise PluginError(f"{page.file.src_uri}: the formula {latex!r} cannot be read: {error}") from None
        return match["tag"] + math

    content = FORMULA.sub(formula, content)
    if page.file.src_uri.removesuffix(".md") in NOTEBOOKS:
        outputs = notebook_outputs(page.file.src_uri.removesuffix(".md"))
        content = re.sub(r"<!-- output (\d+) -->", lambda match: outputs[int(match[1])], content)
    return content


def outside(path: str, text: str) -> set[str]:
    """Files of the repository outside docs/ that a page links to."""
    found = {_target(path, match[2]) for match in LINK.finditer(FENCE.sub("", text))}
    return {target for target in found if target and not target.startswith("docs/")}


def gallery() -> str:
    """Every shipped scene with its picture, which opens the page that plays it, if scripts/gallery has made one."""
    import vlmb

    entries = []
    for path in sorted((ROOT / "models").glob("*.toml")):
        name, title = path.stem, html.escape(vlmb.load_scene(path).name)
        shown = f'<img src="images/gallery/{name}.jpg" alt="{title}">' if (PICTURES / f"{name}.jpg").exists() else ""
        if (PLAYERS / f"{name}.html").exists():
            shown = f'<a href="gallery/{name}.html">{shown}</a>'
        entries.append(f"<figure>{shown}<figcaption>{title}<br><code>models/{name}.toml</code></figcaption></figure>")
    return '<div class="gallery">\n' + "\n".join(entries) + "\n</div>"


def figures() -> str:
    """Every figure of `vlmb plot` with what its function says of itself."""
    from vlmb.views.plots import PLOTS

    rows = [f"| `{name}` | {' '.join((make.__doc__ or '').partition(chr(10) * 2)[0].split())} |" for name, make in PLOTS.items()]
    return "\n".join(["| figure | |", "| --- | --- |", *rows])


def notebook_page(path: Path) -> str:
    """The cells of a notebook as a page; outputs are marked by comments."""
    import nbformat

    parts = []
    for at, cell in enumerate(nbformat.read(path, as_version=4).cells):
        parts.append(cell.source if cell.cell_type == "markdown" else f"```python\n{cell.source}\n```\n\n<!-- output {at} -->")
    return "\n\n".join(parts) + f"\n\nThe notebook itself: [{path.name}]({path.name}).\n"


@cache
def notebook_outputs(name: str) -> dict[int, str]:
    """Run a notebook; return what each code cell shows, as HTML."""
    import nbclient
    import nbformat

    notebook = nbformat.read(DOCS / f"{name}.ipynb", as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(DOCS / "notebooks")}}).execute()
    shown = {}
    for at, cell in enumerate(notebook.cells):
        if cell.cell_type == "code":
            inner = "\n".join(_shown(output) for output in cell.outputs)
            shown[at] = f'<div class="notebook-output">{inner}</div>' if inner else ""
    return shown


def _shown(output: Any) -> str:
    if output.output_type == "stream":
        return f"<pre>{html.escape(output.text)}</pre>"
    data = output.get("data", {})
    if "text/html" in data:
        return str(data["text/html"])
    if "image/png" in data:
        png = base64.b64encode(base64.b64decode(data["image/png"])).decode("ascii")
        return f'<img alt="figure" src="data:image/png;base64,{png}">'
    return f"<pre>{html.escape(data.get('text/plain', ''))}</pre>"


def _prose(text: str, path: str, source: str) -> str:
    """Text between code blocks: a displayed formula gets empty lines around it, a link its place in the site."""

    def moved(match: re.Match[str]) -> str:
        target = _target(path, match[2])
        name = (target or "").removeprefix("docs/").removesuffix(".ipynb")
        if name in NOTEBOOKS and source != f"{name}.md":
            return match[1] + match[2].replace(".ipynb", ".md") + match[3]
        if target is None or (target.startswith("docs/") and path.startswith("docs/")):
            return match[0]
        place = target.removeprefix("docs/") if target.startswith("docs/") else f"{REPOSITORY}/{target}"
        return match[1] + posixpath.relpath(place, posixpath.dirname(source) or ".") + match[3]

    text = re.sub(r"[ \t]*\n?(?<!`)(\$\$(?!`).+?\$\$)[ \t]*\n?", r"\n\n\1\n\n", text, flags=re.S)
    return LINK.sub(moved, text)


def _target(path: str, link: str) -> str | None:
    """Path in the repository of a relative link to a file that exists."""
    if re.match(r"[a-z]+:|/", link):
        return None
    target = posixpath.normpath(posixpath.join(posixpath.dirname(path), link))
    return target if not target.startswith("..") and (ROOT / target).is_file() else None


def _generated(config: Any, uri: str, abs_src_path: str) -> File:
    return File.generated(config, uri, abs_src_path=abs_src_path, inclusion=InclusionLevel.NOT_IN_NAV)
