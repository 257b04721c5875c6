"""Runs the code blocks of one page in order, in the current folder: python tests/page_runner.py PAGE.

Without a page it reads lines `[page, folder, file]` in JSON and runs each page in a process of its own that is forked from
this one, so that what pages share is imported once; what the page says goes to the file. It answers with exit codes.

    toml       with title="name.toml": written to that file; without: checked as a scene, or as a part of one
    python     run; all blocks of a page share their names; a `text` block right behind it is what it prints
    console    lines `$ vlmb ...` are run, what follows is what they print; other commands are left alone
    sh, bash   lines `vlmb ...` are run

`...` in expected output stands for anything, and numbers need not agree to the last digit.
"""

from __future__ import annotations

import contextlib
import difflib
import gc
import io
import json
import os
import re
import shlex
import signal
import sys
import traceback
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import vlmb
from vlmb.cli import main
from vlmb.simulation.checking import check

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

BLOCK = re.compile(r"^```(?P<language>\w*)[ \t]*(?P<options>[^\n]*)\n(?P<text>.*?)^```[ \t]*$", re.M | re.S)
NUMBER = r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)"
SMALL = 1e-3
LONGEST = 300  # [s] that a page may take
DEFAULTS: dict[str, Any] = {  # what a part of a scene is tried on
    "base": {"kind": "ski", "mass": 5.0, "inertia": 0.6},
    "links": [{"name": "legs", "rod": {"length": 0.5, "mass": 30.0}, "lower": {"length": 0.25}, "upper": {"length": 0.2},
               "tip_mass": 40.0}],
    "start": {"psi1": 1.2},
}  # fmt: skip


class Block(NamedTuple):
    """A code block of a page."""

    language: str
    options: str
    text: str
    line: int
    output: str | None  # the text block right behind it


def blocks_of(page: str) -> list[Block]:
    """Return a page's code blocks; a `text` block right behind another is its output."""
    found = list(BLOCK.finditer(page))
    blocks = []
    for at, match in enumerate(found):
        following = found[at + 1] if at + 1 < len(found) else None
        output = None
        if following and following["language"] == "text" and not page[match.end() : following.start()].strip():
            output = following["text"]
        line = page[: match.start()].count("\n") + 1
        blocks.append(Block(match["language"], match["options"], match["text"], line, output))
    return blocks


def commands_of(block: Block) -> list[tuple[str, str | None]]:
    """Return the vlmb commands of a block with their expected output (None: not shown)."""
    if block.language in ("sh", "bash"):
        lines = [line.partition(" #")[0].strip() for line in block.text.splitlines()]
        return [(line, None) for line in lines if line.startswith("vlmb ")]
    found = []
    for part in re.split(r"^\$ ", block.text, flags=re.M)[1:]:
        command, _, output = part.partition("\n")
        if command.startswith("vlmb "):
            found.append((command, output or None))
    return found


def agree(expected: str, found: str) -> bool:
    """Compare outputs: `...` stands for anything, numbers agree to 1 %, and small ones only have to be small."""
    texts = ["\n".join(line.rstrip() for line in text.strip("\n").splitlines()) for text in (expected, found)]
    pieces = re.split(f"({NUMBER})", texts[0])
    pattern = "".join(f"({NUMBER})" if at % 2 else re.escape(piece) for at, piece in enumerate(pieces))
    match = re.fullmatch(pattern.replace(r"\.\.\.", ".*?"), texts[1], re.S)
    pairs = zip(pieces[1::2], match.groups() if match else (), strict=False)
    return match is not None and all(_near(float(one), float(other)) for one, other in pairs)


def _near(one: float, other: float) -> bool:
    return abs(one - other) <= 0.01 * abs(one) or max(abs(one), abs(other)) < SMALL


def run_command(command: str) -> tuple[int, str]:
    """Run one vlmb command; return its exit code and what it printed."""
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(shown):
        try:
            code = main(shlex.split(command)[1:])
        except SystemExit as end:
            code = int(end.code or 0)
    return code, shown.getvalue()


def read_scene(block: Block) -> None:
    """Write a scene with a title to its file; check any other, or a part of one on top of a plain skier."""
    title = re.search(r'title="([^"]+)"', block.options)
    if title:
        Path(title[1]).write_text(block.text, encoding="utf-8")
    else:
        data = tomllib.loads(block.text)
        check(vlmb.Scene.from_dict(data if "base" in data else {**DEFAULTS, **data}))


def run_page(page: str, names: dict[str, Any]) -> list[str]:
    """Run all blocks; return what is wrong."""
    problems = []

    def compare(block: Block, what: str, expected: str | None, found: str) -> None:
        if expected is not None and not agree(expected, found):
            lines = difflib.unified_diff(expected.splitlines(), found.splitlines(), "page", "run", lineterm="", n=99)
            problems.append(f"line {block.line}: {what} prints something else:\n" + "\n".join(lines))

    for block in blocks_of(page):
        if block.language == "toml":
            read_scene(block)
        elif block.language == "python":
            shown = io.StringIO()
            with contextlib.redirect_stdout(shown):
                exec(compile("\n" * block.line + block.text, "page", "exec"), names)
            compare(block, "the Python block", block.output, shown.getvalue())
        elif block.language in ("console", "sh", "bash"):
            for command, expected in commands_of(block):
                code, found = run_command(command)
                refused = expected is not None and re.match(r"vlmb \w+: ", expected) is not None
                if code != refused:
                    problems.append(f"line {block.line}: {command!r} ends with exit code {code}:\n{found}")
                compare(block, repr(command), expected, found)
    return problems


def run_alone(page: str) -> str:
    """Run a page; return what is wrong, or nothing."""
    return "\n\n".join(run_page(Path(page).read_text(encoding="utf-8"), {"__name__": "page"}))


def serve() -> None:
    """Run the pages that standard input asks for, each in a fork."""
    import matplotlib.pyplot  # noqa: F401

    vlmb.simulate(vlmb.Scene.from_dict(DEFAULTS), duration=0.1)  # loads what is compiled
    gc.freeze()
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            run_forked(*json.loads(line))
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def run_forked(page: str, folder: str, file: str) -> NoReturn:
    """Run a page as a process that was just forked, and end it without taking down what it shares."""
    signal.alarm(LONGEST)
    os.chdir(folder)
    said = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for end, other in ((0, os.open(os.devnull, os.O_RDONLY)), (1, said), (2, said)):
        os.dup2(other, end)
    wrong = "?"
    try:
        wrong = run_alone(page)
    except BaseException:
        traceback.print_exc()
    finally:
        print(wrong, end="", file=sys.stderr, flush=True)
        sys.stdout.flush()
        os._exit(wrong != "")


if __name__ == "__main__":
    sys.exit(run_alone(sys.argv[1]) or 0) if sys.argv[1:] else serve()
