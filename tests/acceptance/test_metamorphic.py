"""Random scenes, a thousand and some hundreds, each told in a dozen words: `scripts/acceptance -k metamorphic` keeps counts."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from tests.acceptance.promises import keep
from tests.metamorphic import judge
from tests.metamorphic_kinds import KINDS

SCENES, LATER = 1000, 200
SLOWEST = 10.0  # [s] of a run


@pytest.mark.acceptance
@pytest.mark.parametrize(("what", "kind", "scenes"), [
    ("metamorphic", "every kind of base, link and force", SCENES), ("contacts", "contacts", LATER),
    ("singular", "singular starts", LATER), ("spared", "controls to spare", LATER),
])  # fmt: skip
def test_promises_metamorphic(what: str, kind: str, scenes: int, results: Path, tmp_path: Path) -> None:
    found: Counter[str] = Counter({"right": 0, "said": 0, "wrong without a word": 0, "refused": 0})
    maker = KINDS[kind]
    judge(0, tmp_path, maker)  # compiled before anything is timed
    wrong, slowest = [], 0.0
    for seed in range(scenes):
        why, verdicts = judge(seed, tmp_path, maker)
        found["refused"] += bool(why)
        for verdict in verdicts:
            found["wrong without a word" if verdict.word == "wrong" else verdict.word] += 1
            slowest = max(slowest, verdict.seconds)
            if verdict.word == "wrong":
                wrong.append((seed, *verdict))
    tried = sum(found.values())
    keep(results, what, tried, found)
    print(f"{tried} tried: {dict(found)}; the slowest took {slowest:.1f} s")
    assert not wrong
    assert found["refused"] <= 0.05 * scenes
    assert slowest < SLOWEST
