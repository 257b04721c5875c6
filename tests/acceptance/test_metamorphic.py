"""A thousand random scenes, each told in a dozen words: `scripts/acceptance -k metamorphic` keeps the counts."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

import vlmb
from tests.acceptance.promises import keep
from tests.metamorphic import judge, make

SCENES = 1000
SLOWEST = 10.0  # [s] of a run


@pytest.mark.acceptance
def test_promises_metamorphic(results: Path, tmp_path: Path) -> None:
    found: Counter[str] = Counter({"right": 0, "said": 0, "wrong without a word": 0, "refused": 0})
    vlmb.simulate(make(0))  # compiled before anything is timed
    wrong, slowest = [], 0.0
    for seed in range(SCENES):
        why, verdicts = judge(seed, tmp_path)
        found["refused"] += bool(why)
        for verdict in verdicts:
            found["wrong without a word" if verdict.word == "wrong" else verdict.word] += 1
            slowest = max(slowest, verdict.seconds)
            if verdict.word == "wrong":
                wrong.append((seed, *verdict))
    tried = sum(found.values())
    keep(results, "metamorphic", tried, found)
    print(f"{tried} tried: {dict(found)}; the slowest took {slowest:.1f} s")
    assert not wrong
    assert found["refused"] <= 0.05 * SCENES
    assert slowest < SLOWEST
