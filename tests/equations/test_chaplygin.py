"""Chaplygin's equations by name: accelerations along runs are those of (7.7) to (7.12), written out as the errata have them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import vlmb

GRAVITY, M0, I0, M1, L1, MB = 9.81, 6.0, 0.8, 30.0, 0.5, 40.0
LOWER, UPPER = (9000.0, 60.0, 0.33), (7000.0, 40.0, 0.45)  # stiffness, damping, rest
SCENE: dict[str, Any] = {
    "gravity": GRAVITY, "base": {"kind": "ski", "mass": M0, "inertia": I0},
    "links": [{
        "rod": {"length": L1, "mass": M1}, "tip_mass": MB,
        "lower": {"length": 0.3, "stiffness": LOWER[0], "damping": LOWER[1], "rest": LOWER[2]},
        "upper": {"length": 0.4, "stiffness": UPPER[0], "damping": UPPER[1], "rest": UPPER[2]},
    }],
    "forces": [{"on": "M_phi0", "law": "0.7*cos(2*t)"}, {"on": "M_psi1", "law": "30*sin(3*t)"}, {"on": "M_phi1", "law": "-2*t"}],
    "start": {
        "x": 0.3, "phi0": 0.5, "phi1": 1.1, "psi1": 1.15, "speed": 3.0, "phi0_dot": 0.6, "phi1_dot": -0.4, "psi1_dot": 0.3,
        "xi1_1_dot": 0.2, "xi1_2_dot": -0.1,
    },
    "run": {"rtol": 1e-11, "atol": 1e-12},
}  # fmt: skip
NAMES = ("x", "phi0", "phi1", "psi1", "xi1_1", "xi1_2")


def paper(t: float, of: dict[str, float], rate: dict[str, float]) -> dict[str, float]:
    """Accelerations by (7.7) to (7.12): the rows of x, phi0, phi1, psi1, xi11, xi12, solved."""
    phi0, phi, psi, lower, upper = (of[name] for name in ("phi0", "phi1", "psi1", "xi1_1", "xi1_2"))
    x_, phi0_, phi_, psi_, lower_, upper_ = (rate[f"{name}_dot"] for name in NAMES)
    tg, sec2 = math.tan(phi0), 1.0 / math.cos(phi0) ** 2
    c, s, C, S = math.cos(phi), math.sin(phi), math.cos(psi), math.sin(psi)  # of phi, of psi
    theta, both = M0 + M1 + MB, M1 + MB
    zeta = M1 * L1**2 / 3 + M1 * lower * (L1 + lower) + MB * (L1 + lower + upper) ** 2
    eta, vartheta = M1 * (lower + L1 / 2), MB * (lower + L1 + upper)
    lever, along, aside = eta + vartheta, s * tg + c, c * tg - s
    matrix = np.array([
        [theta * sec2, 0.0, lever * aside * C, -lever * along * S, both * along * C, MB * along * C],
        [0.0, I0, 0.0, 0.0, 0.0, 0.0],
        [lever * aside * C, 0.0, zeta * C**2, 0.0, 0.0, 0.0],
        [-lever * along * S, 0.0, 0.0, zeta, 0.0, 0.0],
        [both * along * C, 0.0, 0.0, 0.0, both, MB],
        [MB * along * C, 0.0, 0.0, 0.0, MB, MB],
    ])  # fmt: skip
    turned = sec2 * x_ * phi0_
    bias = np.array([
        -lever * along * C * (phi_**2 + psi_**2) - 2 * lever * aside * S * phi_ * psi_
        + 2 * both * aside * C * phi_ * lower_ + 2 * MB * aside * C * phi_ * upper_
        - 2 * both * along * S * psi_ * lower_ - 2 * MB * along * S * psi_ * upper_ + theta * tg * turned,
        0.0,
        2 * lever * C**2 * lower_ * phi_ + 2 * vartheta * C**2 * upper_ * phi_
        - 2 * zeta * C * S * phi_ * psi_ + lever * C * c * turned,
        zeta * C * S * phi_**2 + 2 * lever * lower_ * psi_ + 2 * vartheta * upper_ * psi_ + GRAVITY * lever * C
        - lever * s * S * turned,
        -lever * C**2 * phi_**2 - lever * psi_**2 + GRAVITY * both * S + both * s * C * turned,
        -vartheta * C**2 * phi_**2 - vartheta * psi_**2 + GRAVITY * MB * S + MB * s * C * turned,
    ])  # fmt: skip
    springs = [-k * (length - rest) - d * r for (k, d, rest), length, r in ((LOWER, lower, lower_), (UPPER, upper, upper_))]
    force = np.array([0.0, 0.7 * math.cos(2 * t), -2 * t, 30 * math.sin(3 * t), *springs])
    return dict(zip(NAMES, np.linalg.solve(matrix, force - bias).tolist(), strict=True))


@pytest.mark.parametrize("engine", ["core", "pinocchio"])
@pytest.mark.parametrize("form", ["reduction", "multiplier", "projection"])
def test_accelerations_along_a_run_are_those_of_the_paper(form: str, engine: str) -> None:
    keys = {**SCENE["run"], "knife_edge": form, "engine": engine, "samples": 25.0}
    run = vlmb.simulate({**SCENE, "run": keys}, 0.5)
    assert run.status == "finished", run.message
    assert np.ptp(run["phi0"]) > 0.2 and np.ptp(run["psi1"]) > 0.2 and np.abs(run["phi0"]).max() < 1.4
    names = run.mechanism.coordinate_names
    for k, t in enumerate(run.t.tolist()):
        of, rate = ({f"{name}{dot}": float(run[f"{name}{dot}"][k]) for name in names} for dot in ("", "_dot"))
        ours, theirs = vlmb.accelerations(run.scene, of, rate, t), paper(t, of, rate)
        for name in NAMES:
            assert ours[name] == pytest.approx(theirs[name], rel=1e-9, abs=1e-9 * max(map(abs, theirs.values()))), (t, name)
        turned = theirs["x"] * math.tan(of["phi0"]) + rate["x_dot"] * rate["phi0_dot"] / math.cos(of["phi0"]) ** 2
        assert ours["y"] == pytest.approx(turned, rel=1e-9, abs=1e-9)


def test_the_run_itself_has_them() -> None:
    """Second differences of the samples, so that nothing but what was integrated is asked."""
    step = 1e-3
    run = vlmb.simulate(SCENE, 0.5, t_eval=np.arange(501) * step, rtol=1e-12, atol=1e-13)
    names = run.mechanism.coordinate_names
    for k in range(100, 401, 60):
        of, rate = ({f"{name}{dot}": float(run[f"{name}{dot}"][k]) for name in names} for dot in ("", "_dot"))
        for name, wanted in paper(float(run.t[k]), of, rate).items():
            rates = run[f"{name}_dot"]
            found = (rates[k - 2] - 8 * rates[k - 1] + 8 * rates[k + 1] - rates[k + 2]) / (12 * step)
            assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6), name
