"""A Pinocchio model is made when first needed; the parts say beforehand where everything stands in it."""

from __future__ import annotations

import pickle
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import vlmb
from tests.small_scenes import FLYING, PIVOT, SKI, bent

MODELS = sorted((Path(__file__).resolve().parents[2] / "models").glob("*.toml"))


@pytest.mark.parametrize("path", MODELS, ids=[path.stem for path in MODELS])
def test_the_layout_is_that_of_the_model(path: Path) -> None:
    mechanism = vlmb.build(path)
    layout, model = mechanism.layout, mechanism.model
    assert (layout.nq, layout.nv) == (model.nq, model.nv)
    for link in layout.links:
        joint = model.joints[link.joint]
        assert (joint.idx_q, joint.idx_v, model.names[link.joint]) == (link.q, link.v, link.name)
        for segment in (link.lower, link.upper):
            if segment.joint:
                assert (model.joints[segment.joint].idx_q, model.joints[segment.joint].idx_v) == (segment.q, segment.v)


@pytest.mark.parametrize("base", [PIVOT, SKI, FLYING], ids=["pivot", "ski", "free"])
def test_a_run_of_the_core_makes_no_model(base: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> None:
    scene = bent(base, 2)
    module = sys.modules[vlmb.Mechanism.__module__]
    with monkeypatch.context() as patch:
        patch.setattr(module, "make_model", lambda *parts: pytest.fail("a model was made"))
        mechanism = vlmb.build(scene)
        run = vlmb.simulate(mechanism, duration=0.1)
        assert run.engine == "core" and run["energy"].size and run.end.rates
        kept = pickle.dumps(mechanism)
    again = pickle.loads(kept)  # noqa: S301
    assert again == mechanism and again.model == mechanism.model
    assert again.model is again.model


def test_threads_that_ask_for_it_at_once_get_equal_models() -> None:
    mechanism = vlmb.build(bent(SKI, 2))
    with ThreadPoolExecutor(4) as pool:
        models = list(pool.map(lambda _: mechanism.model, range(8)))
    assert all(model == models[0] for model in models)
