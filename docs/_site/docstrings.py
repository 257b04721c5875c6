"""How docstrings are read: `name : what it is` under Parameters, and the remark behind a field."""

from __future__ import annotations

import ast
import re
from typing import Any

import griffe


class PlainDocstrings(griffe.Extension):
    """Turns the Parameters section, whose entries have no types (the signature has them), into one that Griffe reads."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite the docstring of an object."""
        if obj.docstring is not None:
            obj.docstring.value = rewritten(obj.docstring.value)

    def on_attribute_instance(self, *, node: ast.AST | Any, attr: griffe.Attribute, **_: Any) -> None:
        """Take the remark behind a field, such as its unit, as its docstring."""
        if attr.docstring is not None or attr.lineno is None or not isinstance(node, ast.AST):
            return
        last = attr.endlineno or attr.lineno
        line = attr.module.lines_collection[attr.filepath][last - 1] if attr.module else ""
        remark = re.search(r"\s#\s(.+)$", line)
        if remark and not remark[1].startswith(("fmt:", "noqa", "type:")):
            attr.docstring = griffe.Docstring(remark[1], parent=attr)


def rewritten(text: str) -> str:
    """Return the text with `Parameters`, a rule and `name : description` entries as an `Args:` section."""
    match = re.search(r"^Parameters\n-+\n((?:.+\n?)+)", text, re.M)
    if not match:
        return set_apart(text)
    entries = re.sub(r"^(\w+) : ", r"\1: ", match[1], flags=re.M)
    section = "Args:\n" + "".join(f"    {line}\n" for line in entries.splitlines())
    return set_apart(text[: match.start()]) + section + set_apart(text[match.end() :])


def set_apart(text: str) -> str:
    """Put empty lines around indented lines, which then are shown as they are."""
    text = re.sub(r"^(\S.*)\n(?=    )", r"\1\n\n", text, flags=re.M)
    return re.sub(r"^(    .*)\n(?=\S)", r"\1\n\n", text, flags=re.M)
