"""Random scenes told in other words have one motion; `scripts/acceptance -k metamorphic` tries a thousand."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.metamorphic import Words, judge, make, run, tellings
from tests.metamorphic_kinds import KINDS
from vlmb.core.jit import COMPILED


@pytest.mark.skipif(not COMPILED, reason="too slow in plain Python")
@pytest.mark.parametrize("first", range(0, 30, 10))
def test_scenes_told_in_other_words(first: int, tmp_path: Path) -> None:
    refused = 0
    for seed in range(first, first + 10):
        why, verdicts = judge(seed, tmp_path)
        refused += bool(why)
        wrong = [(seed, *verdict) for verdict in verdicts if verdict.word == "wrong"]
        assert not wrong
    assert refused <= 1


@pytest.mark.skipif(not COMPILED, reason="too slow in plain Python")
@pytest.mark.parametrize("kind", ["contacts", "singular starts", "controls to spare"])
def test_scenes_of_later_kinds_told_in_other_words(kind: str, tmp_path: Path) -> None:
    for seed in range(2):
        why, verdicts = judge(seed, tmp_path, KINDS[kind])
        assert not why and len(verdicts) > 7
        assert not [(seed, *verdict) for verdict in verdicts if verdict.word == "wrong"]
        assert all(verdict.word == "right" for verdict in verdicts)


def test_words_change_a_scene_and_a_wrong_motion_is_found() -> None:
    scene, words = make(3), tellings(3)
    assert all(make(3, told) != scene for name, told in words.items() if name not in ("in another order",))
    assert make(3) == scene
    plain, heavier = run(3), run(3, Words(mass=2.0))
    assert abs(plain.points - heavier.points).max() < 1e-6
    assert abs(run(4).points - run(4, Words(nudge=1e-3)).points).max() > 1e-4
