"""What was tried to break the promises of docs/promises.md: counts, kept beside each other in one table."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

TITLES = {
    "lines": "Ctrl-C at every line of a short run's code, each time that it is passed",
    "phases": "Ctrl-C at every line of a short run's code with contacts, the last time that it is passed",
    "signals": "SIGINT or SIGTERM to a process at a random moment",
    "runs": "damaged or malicious stored runs",
    "scenes": "damaged or malicious scenes",
    "metamorphic": "random scenes, each told in a dozen words: turned, mirrored, later, heavier, larger, by the other engine",
    "contacts": "the same of links that are thrown at the ground, bounce, slip and stay",
    "singular": "the same of closed loops that start in line",
    "spared": "the same of programmes with `u0` and `border`",
    "threads": "runs in sixteen threads, compared bit for bit",
}


def keep(folder: Path, what: str, tried: int, found: Mapping[str, Any]) -> None:
    """Write how many were tried and what became of them beside what others wrote."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "promises.json"
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    known[what] = {"tried": tried, "found": {str(name): value for name, value in found.items()}}
    ordered = {name: known[name] for name in TITLES if name in known}
    path.write_text(json.dumps(ordered, indent=1) + "\n", encoding="utf-8")
    (folder / "promises.md").write_text(table(ordered), encoding="utf-8")


def table(known: Mapping[str, Any]) -> str:
    """Return the counts as a table."""
    lines = ["| what | tried | what became of them |", "| --- | ---: | --- |"]
    for name, entry in known.items():
        found = ", ".join(f"{value} {what}" for what, value in entry["found"].items())
        lines.append(f"| {TITLES[name]} | {entry['tried']} | {found} |")
    return "\n".join(lines) + "\n"
