"""Studies in the phase in which a state stands: a ski on the snow is the ski that cannot lift, a foot that holds is a pivot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vlmb
from vlmb.equations.matrices import at_posture

LEGS = {"name": "legs", "rod": {"length": 0.5, "mass": 40.0}, "lower": {"length": 0.3, "stiffness": 9000.0, "rest": 0.35}}
ARM = {"name": "arm", "rod": {"length": 0.4, "mass": 8.0}}
LEANS = {"speed": 6.0, "phi0": 0.3, "phi0_dot": 0.4, "psi1": 1.4, "phi1": 1.87, "psi2": -1.4, "phi2": 1.6}
ON_SNOW = ({}, {"lift": True})


def rider(base: dict[str, Any], links: Any = (LEGS, ARM), start: Any = LEANS, **changes: Any) -> vlmb.Scene:
    """A ski of 8 kg with legs and an arm."""
    base = {"kind": "ski", "mass": 8.0, "inertia": 0.6, **base}
    return vlmb.Scene.from_dict({"base": base, "links": list(links), "start": start, **changes})


@pytest.mark.parametrize("form", ["full", "chaplygin", "speed"])
def test_equations_of_a_ski_on_the_snow(form: str) -> None:
    found = [at_posture(rider(base), ["arm.elevation_dot=0.7"], form) for base in ON_SNOW]
    bound, lifted = found
    assert lifted.closed == (("ski",) if form == "full" else ()) and ("z" in lifted.names) == (form == "full")
    own = [lifted.names.index(name) for name in bound.names]
    np.testing.assert_array_equal(lifted.mass_matrix[np.ix_(own, own)], bound.mass_matrix)
    np.testing.assert_array_equal(lifted.bias[own], bound.bias)
    for block, values in bound.blocks.items():
        np.testing.assert_array_equal(lifted.blocks[block], values)
    ours, theirs = lifted.solve({"M_psi2": 5.0}), bound.solve({"M_psi2": 5.0})
    np.testing.assert_allclose(ours.accelerations[own], theirs.accelerations, rtol=1e-12, atol=1e-12)
    if form == "full":
        assert lifted.phase.names == ("ski.normal", "ski.knife_edge") and ours.knife_edge == pytest.approx(theirs.knife_edge)
        np.testing.assert_allclose(lifted.phase.jacobian @ ours.accelerations + lifted.phase.drift, 0.0, atol=1e-12)
        free = at_posture(rider({"lift": True}), ["z=0.1"]).solve()
        assert free.knife_edge is None and not free.forces and ours.forces["F_z"] > 0.0
    else:
        with pytest.raises(vlmb.SceneError, match=r"that of a ski on the snow: z = 0\.1 m"):
            at_posture(rider({"lift": True}), ["z=0.1"], form)


def test_a_carving_turn_is_as_steady_and_as_stable_on_snow_that_only_pushes() -> None:
    turns = [vlmb.steady(rider(base), hold={"speed": 6.0, "phi0_dot": 0.4}) for base in ON_SNOW]
    for name, value in turns[0].coordinates.items():
        assert turns[1].coordinates[name] == pytest.approx(value, abs=1e-12)
    bound, lifted = (vlmb.linearize(turn, controls=["M_phi0"]) for turn in turns)
    assert lifted.names == bound.names and lifted.labels == bound.labels and turns[0].family == turns[1].family
    np.testing.assert_allclose(lifted.eigenvalues, bound.eigenvalues, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(lifted.B, bound.B, atol=1e-9)
    flies = vlmb.linearize(rider({"lift": True}, start={**LEANS, "z": 0.5}))
    assert {*flies.names} - {*lifted.names} == {"sideways", "z_dot"} and flies.residual > 9.0
    with pytest.raises(vlmb.StudyError, match=r"is none that they allow: there they would be ski sliding"):
        vlmb.steady(rider({"lift": True, "hold": 0.2}), hold={"speed": 6.0, "phi0_dot": 0.4})
    with pytest.raises(vlmb.SceneError, match="ski strike here"):
        vlmb.linearize(rider({"lift": True}, start={**LEANS, "z_dot": -1.0}))


def test_a_bouncing_rider_has_the_same_gait() -> None:
    start = {"speed": 3.0, "psi1": np.pi / 2, "xi1_1": 0.33}
    rows = ["legs.direction.x = 0", "legs.direction.y = 0"]
    bound, lifted = (
        vlmb.find_gait(rider(base, [LEGS], start, constraints=rows), until="xi1_1_dot", free=["xi1_1"]) for base in ON_SNOW
    )
    assert lifted.period == pytest.approx(bound.period, rel=1e-9) and lifted.start["z"] == 0.0
    np.testing.assert_allclose(lifted.multipliers, bound.multipliers, atol=1e-9)


def test_forces_that_drove_a_ski_are_found_on_the_snow_and_in_the_air() -> None:
    times, push = np.linspace(0.0, 0.1, 61), [{"on": "M_phi0", "law": "1.5*sin(9*t)"}]
    leans = {"phi0": 0.3, "phi0_dot": 0.4, "psi1": 1.4, "phi1": 1.87}
    for more, forces in (({"speed": 6.0}, push), ({"z": 0.5, "y_dot": 1.0, "x_dot": 2.0}, [])):
        scene = rider({"lift": True, "friction": 0.1}, [LEGS], {**leans, **more})
        run = vlmb.simulate(scene.changed(forces=forces), duration=0.1, t_eval=times, rtol=1e-12)
        found = vlmb.inverse(scene, run.to_pandas(), smooth="none")
        assert ("F_z" in found.input_names) == ("z" in more) and found.phases[0].closed == (() if "z" in more else ("ski",))
        for name in found.input_names:
            wanted = 1.5 * np.sin(9.0 * times) if name == "M_phi0" and forces else np.zeros(len(times))
            np.testing.assert_allclose(found.controls[name][15:-15], wanted[15:-15], atol=2e-3)
        for name in ("knife_edge", "normal", "friction"):
            np.testing.assert_allclose(found.reactions[name][15:-15], run.reactions[name][15:-15], atol=5e-3)
    mixed = run.to_pandas()
    mixed.loc[mixed.index[:30], "z"] = 0.0
    with pytest.raises(vlmb.SceneError, match="leaves the snow or lands"):
        vlmb.inverse(scene, mixed)
    with pytest.raises(vlmb.SceneError, match="stands or turns back"):
        vlmb.inverse(scene, {**mixed, "time": times, "z": 0 * times, "x": 0 * times, "y": 0 * times})


def test_a_body_on_a_foot_that_holds_is_as_stable_as_on_a_pivot() -> None:
    start, links = {"psi1": 1.6, "psi1_dot": 0.2}, [{**LEGS, "lower": {"length": 0.3}}, ARM]
    data: dict[str, Any] = {"plane": True, "links": links, "start": start}
    pinned = vlmb.linearize({**data, "base": {"kind": "pivot"}})
    foot = {"name": "foot", "point": "base", "friction": 0.9}
    standing = {**data, "base": {"kind": "free", "mass": 1.0}, "contacts": [foot]}
    stands = vlmb.linearize(standing)
    assert stands.names == pinned.names
    np.testing.assert_allclose(stands.eigenvalues, pinned.eigenvalues, rtol=1e-9, atol=1e-9)
    carried = [{**foot, "surface_velocity": [0.1, 0.0, 0.0]}]
    with pytest.raises(vlmb.SceneError, match="carried along by ground that moves"):
        vlmb.linearize({**standing, "contacts": carried, "start": {**start, "x_dot": 0.1}})
