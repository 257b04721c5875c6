"""The hard cases in full, half an hour of them: `scripts/acceptance` runs them and keeps their tables."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.acceptance.hard_cases import CASES, keep, section, title_of


@pytest.mark.acceptance
@pytest.mark.parametrize("case", CASES)
def test_nothing_is_off_without_a_word(case: int, results: Path) -> None:
    findings = CASES[case](False)
    keep(results, case, findings)
    wrong = [f for f in findings if f.verdict == "WRONG"]
    assert not wrong, "\n" + section(title_of(case), wrong)
