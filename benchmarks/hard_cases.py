"""Fifteen hard cases: what the engine answers, how far it is off, and what naive ways do there.

Usage: python benchmarks/hard_cases.py [NUMBER...]. All take some minutes, most of them the million steps of case 11;
numbers choose cases to measure again, the others stay as they are. Exit code 1 if any answer is off without a word.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from dataclasses import asdict
from typing import Any

from common import RESULTS, table, write_report

# isort: split
import hard_geometry
import hard_numbers
import hard_rows
from hard_finding import Finding

PACKAGES = ("pin", "numpy", "scipy", "mpmath")
CASES = dict(sorted({**hard_geometry.CASES, **hard_numbers.CASES, **hard_rows.CASES}.items()))
HEADER = ("variant", "what is done", "error", "allowed", "residual", "condition", "verdict", "naive way")
INTRO = """# Hard cases

Error: largest distance [m] of the links' ends from the reference over the run, unless another unit is named. Residual: largest
error of the case's constraints, or of the energy balance [J] where it has none. Condition: of the mass matrix scaled to a unit
diagonal, the worst on the way. Verdict: *right* within the allowed error; *said* where the engine stops, refuses or warns in
words, which are below each table; WRONG would be off without a word.
"""


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
        worst = max(judged, key=lambda f: f.error / f.limit if f.limit else f.error)
        conditions = [f.condition for f in findings if f.condition is not None]
        verdicts = ", ".join(f"{n} {verdict}" for verdict, n in sorted(Counter(f.verdict for f in findings).items()))
        error = f"{number(worst.error)} {worst.unit} of {number(worst.limit)}"
        rows.append((title.rstrip("."), error, number(max(conditions)) if conditions else "", verdicts))
    return table(("case", "worst error of what is allowed", "condition", "verdicts of the variants"), rows)


def stored_findings(data: dict[str, Any]) -> dict[str, list[Finding]]:
    """Findings by title from stored results; null stands for what was not finite."""
    return {
        entry["title"]: [Finding(**{k: v for k, v in f.items() if k != "verdict"}) for f in entry["findings"]]
        for entry in data.values()
    }


def main(chosen: list[int]) -> int:
    """Measure, print and write the report."""
    stored = RESULTS / "hard_cases.json"
    data = {}
    for case in chosen or CASES:
        began = time.perf_counter()
        findings, title = CASES[case](False), (CASES[case].__doc__ or "").strip()
        print(section(title, findings), f"({time.perf_counter() - began:.1f} s)\n", flush=True)
        data[str(case)] = {"title": title, "findings": [asdict(f) | {"verdict": f.verdict} for f in findings]}
    if chosen and stored.exists():
        data = json.loads(stored.read_text(encoding="utf-8"))["cases"] | data
    data = {number: data[number] for number in sorted(data, key=int)}
    found = stored_findings(data)
    verdicts = Counter(f.verdict for findings in found.values() for f in findings)
    counted = ", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items()))
    parts = [
        INTRO,
        f"Verdicts over all variants: {counted}.",
        summary(found),
        *(section(title, findings) for title, findings in found.items()),
    ]
    write_report("hard_cases", "\n\n".join(parts), {"cases": data, "verdicts": dict(verdicts)}, PACKAGES)
    print(counted)
    return 1 if verdicts["WRONG"] else 0


if __name__ == "__main__":
    sys.exit(main([int(value) for value in sys.argv[1:]]))
