"""Fifteen hard cases: what the engine answers, how far it is off, and what naive ways do there."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tests.acceptance import hard_geometry, hard_numbers, hard_rows
from tests.acceptance.hard_finding import Finding
from vlmb.studies.bench import footer, table

PACKAGES = ("pin", "numpy", "scipy", "mpmath")
CASES = dict(sorted({**hard_geometry.CASES, **hard_numbers.CASES, **hard_rows.CASES}.items()))
HEADER = ("variant", "what is done", "error", "allowed", "residual", "condition", "verdict", "naive way")
INTRO = """# Results of the hard cases

Error: largest distance [m] of the links' ends from the reference over the run, unless another unit is named. Residual: largest
error of the case's constraints, or of the energy balance [J] where it has none. Condition: of the mass matrix scaled to a unit
diagonal, the worst on the way. Verdict: *right* within the allowed error; *said* where the engine stops, refuses or warns in
words, which are below each table; WRONG would be off without a word.
"""


def title_of(case: int) -> str:
    """Number and name of a case."""
    return (CASES[case].__doc__ or "").strip()


def number(value: float | None) -> str:
    """A number for a table."""
    return "" if value is None else f"{value:.1e}"


def rows_of(findings: list[Finding]) -> list[tuple[str, ...]]:
    """Table rows."""
    found = []
    for f in findings:
        error = "" if f.error is None else f"{number(f.error)} {'' if f.unit == 'm' else f.unit}".strip()
        allowed = "" if f.error is None else number(f.limit)
        row = (f.what, f.done, error, allowed, number(f.residual), number(f.condition), f.verdict, f.naive)
        found.append(tuple(cell.replace("|", "\\|") for cell in row))
    return found


def section(title: str, findings: list[Finding]) -> str:
    """One case as markdown."""
    words = dict.fromkeys(f"* {f.what}: {f.said}" for f in findings if f.said)
    parts = [f"## {title}", table(HEADER, rows_of(findings)), *(["In words:\n\n" + "\n".join(words)] if words else [])]
    return "\n\n".join(parts)


def summary(found: dict[str, list[Finding]]) -> str:
    """One line a case: variants, the error nearest to what is allowed or beyond it, condition, verdicts."""
    rows = []
    for title, findings in found.items():
        judged = [f for f in findings if f.error is not None and f.verdict != "said"]
        worst = max(judged, key=lambda f: f.error / f.limit if f.limit else f.error, default=None)
        conditions = [f.condition for f in findings if f.condition is not None]
        verdicts = ", ".join(f"{n} {verdict}" for verdict, n in sorted(Counter(f.verdict for f in findings).items()))
        error = f"{number(worst.error)} {worst.unit} of {number(worst.limit)}" if worst else ""
        rows.append((title.rstrip("."), error, number(max(conditions)) if conditions else "", verdicts))
    return table(("case", "worst error of what is allowed", "condition", "verdicts of the variants"), rows)


def stored(folder: Path) -> dict[str, list[Finding]]:
    """Findings by title as `keep` left them in a folder; null stands for what was not finite."""
    cases = json.loads((folder / "hard_cases.json").read_text(encoding="utf-8"))["cases"]
    return {entry["title"]: [Finding(**finding) for finding in entry["findings"]] for entry in cases.values()}


def keep(folder: Path, case: int, findings: list[Finding]) -> None:
    """Put one case's findings beside those that are in a folder, as hard_cases.json and hard_cases.md."""
    data, page = folder / "hard_cases.json", folder / "hard_cases.md"
    cases = json.loads(data.read_text(encoding="utf-8"))["cases"] if data.exists() else {}
    cases[str(case)] = {"title": title_of(case), "findings": [_plain(asdict(finding)) for finding in findings]}
    cases = {key: cases[key] for key in sorted(cases, key=int)}
    machine = footer(PACKAGES)
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"cases": cases, "machine": machine}, indent=1, allow_nan=False)
    data.write_text(f"{text}\n", encoding="utf-8")
    found = stored(folder)
    counts = Counter(f.verdict for findings in found.values() for f in findings)
    parts = [
        INTRO.rstrip(),
        f"Verdicts over all variants: {', '.join(f'{count} {verdict}' for verdict, count in sorted(counts.items()))}.",
        summary(found),
        *(section(title, findings) for title, findings in found.items()),
        f"Measured by `scripts/acceptance` on {machine}",
    ]
    page.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def _plain(finding: dict[str, Any]) -> dict[str, Any]:
    return {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in finding.items()}
