"""Runs side by side and one within another give what they give alone, bit for bit."""

from __future__ import annotations

import multiprocessing
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import vlmb
from tests.small_scenes import FIXED, PIVOT, SKI, bent, link, scene

MANY = 16
WAYS = [("core", way) for way in ("dop853", "adams", "radau", "bdf")] + [("pinocchio", way) for way in ("adams", "dop853")]


def one(number: int) -> tuple[str, np.ndarray, np.ndarray, str]:
    """Run number `number`: its message, states, forces of a row or a control, and its summary less the times it took."""
    engine, method = WAYS[number % len(WAYS)]
    options: dict[str, Any] = {"duration": 0.2, "engine": engine, "method": method, "rtol": 1e-7, "atol": 1e-9}
    if number % 3 == 0:
        held = scene(PIVOT, [link("a"), link("b")], constraints=["phi2 = phi1"], start={"psi1": 0.5, "psi2": 0.2 + 0.01 * number})
        run = vlmb.simulate(held, **options)
        acted = run.reactions["phi2 = phi1"]
    elif number % 3 == 1:
        run = vlmb.simulate(bent(SKI, 1), control=lambda t, view: {"M_psi1": 0.1 * number + view["psi1"]}, **options)
        acted = run.controls["M_psi1"]
    else:
        run = vlmb.simulate(bent(PIVOT, 2, gravity=9.0 + 0.1 * number), **options)
        acted = run.hinge_force("link1")
    lines = [line for line in run.summary().splitlines() if "simulated" not in line]
    return run.message, np.array(run.states), np.array(acted), "\n".join(lines)


def same(first: Any, second: Any) -> bool:
    pairs = zip(first, second, strict=True)
    return all(np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else a == b for a, b in pairs)


@pytest.fixture(scope="module")
def alone() -> list[Any]:
    return [one(number) for number in range(MANY)]


def test_sixteen_threads(alone: list[Any]) -> None:
    together = threading.Barrier(MANY)

    def started(number: int) -> Any:
        together.wait(timeout=30.0)
        return one(number)

    with ThreadPoolExecutor(MANY) as pool:
        found = list(pool.map(started, range(MANY)))
    assert [number for number in range(MANY) if not same(found[number], alone[number])] == []


def test_sixteen_threads_share_a_mechanism() -> None:
    mechanism = vlmb.build(bent(PIVOT, 2))
    expected = vlmb.simulate(mechanism, duration=0.3)
    with ThreadPoolExecutor(MANY) as pool:
        runs = list(pool.map(lambda _: vlmb.simulate(mechanism, duration=0.3), range(MANY)))
        energies = list(pool.map(lambda _: np.array(expected["energy"]), range(MANY)))
    assert all(np.array_equal(run.states, expected.states) for run in runs)
    assert all(np.array_equal(run["energy"], energies[0]) for run in runs)


def test_four_processes(alone: list[Any]) -> None:
    """Sixteen have a test of acceptance."""
    assert in_processes(4, alone) == []


def in_processes(count: int, alone: list[Any]) -> list[int]:
    """Run all in so many processes; return the numbers of runs that differ."""
    with ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn")) as pool:
        found = list(pool.map(one, range(MANY)))
    return [number for number in range(MANY) if not same(found[number], alone[number])]


@pytest.mark.parametrize("inner", ["core", "pinocchio"])
@pytest.mark.parametrize("outer", ["core", "pinocchio"])
@pytest.mark.parametrize("method", ["dop853", "adams", "radau"])
def test_runs_within_a_control(method: str, outer: str, inner: str) -> None:
    """A control that plans ahead by running the same scene, or another one."""
    made, other = bent(PIVOT, 1), scene(SKI, [link("a", lower=FIXED)], start={"psi1": 1.2, "speed": 2.0})
    options: dict[str, Any] = {"duration": 0.1, "t_eval": np.linspace(0.0, 0.1, 5), "engine": outer, "method": method}
    within: list[vlmb.Trajectory] = []

    def planning(t: float, view: Any) -> dict[str, float]:
        if len(within) < 12:
            within.append(vlmb.simulate(made if len(within) % 2 else other, duration=0.05, engine=inner, method=method))
        return {"M_psi1": 0.2 * view["psi1_dot"]}

    run = vlmb.simulate(made, control=planning, **options)
    plain = vlmb.simulate(made, control=lambda t, view: {"M_psi1": 0.2 * view["psi1_dot"]}, **options)
    assert run.status == plain.status == "finished" and len(within) == 12
    assert np.array_equal(run.states, plain.states) and np.array_equal(run.controls["M_psi1"], plain.controls["M_psi1"])
    for at, scene_of in ((0, other), (1, made)):
        expected = vlmb.simulate(scene_of, duration=0.05, engine=inner, method=method)
        assert all(np.array_equal(found.states, expected.states) for found in within[at::2])
