"""Where the paper's matrices degenerate: condition numbers and lost digits beside the same posture in the engine's velocities.

Usage: python benchmarks/degenerate.py

Three approaches to a bad posture, at an angle that shrinks to 1e-9 rad: a link to the vertical, two links to one line, the ski to
the direction across x. At each posture: the condition number of the mass matrix, and how far the accelerations (of link
directions, lengths and ski, all regular) are from those solved for in the engine's velocities.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from common import table, write_report

# isort: split
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.equations.motion import equations_of_motion
from vlmb.errors import SingularError
from vlmb.model.coordinates import kinematics
from vlmb.model.mechanism import Mechanism, build
from vlmb.model.memory import make_data
from vlmb.scene.scene import Scene
from vlmb.views.style import BLACK, GREY, PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Named = dict[str, float]
Posture = Callable[[float], tuple[Named, Named]]

ANGLES = 10.0 ** np.linspace(-0.3, -9.0, 59)
SHOWN = (0.1, 1e-2, 1e-4, 1e-6, 1e-8)
SKI = {"kind": "ski", "mass": 5.0, "inertia": 0.6}
FORMS = {"full": "paper, full form", "chaplygin": "paper, Chaplygin form", "speed": "paper, speed form"}
ENGINE, MERGED = "engine's velocities", "paper, speed form with phi1 = phi0"


def mechanism(base: dict[str, Any], links: int, tips: float) -> Mechanism:
    """Make equal links, both lengths free, with tip masses [kg]; the last link always has one."""
    link = {"rod": {"length": 0.5, "mass": 30.0}, "lower": {"length": 0.25}, "upper": {"length": 0.2}}
    masses = [tips] * (links - 1) + [40.0]
    return build(Scene.from_dict({"base": base, "links": [{**link, "tip_mass": mass} for mass in masses]}))


def to_the_vertical(angle: float) -> tuple[Named, Named]:
    """One link on the ski falls past the vertical, sideways as fast as forwards."""
    psi = math.pi / 2 - angle
    coordinates = {"x": 0.0, "y": 0.0, "phi0": 0.4, "phi1": 1.1, "psi1": psi, "xi1_1": 0.25, "xi1_2": 0.2}
    return coordinates, {"speed": 3.0, "phi0_dot": 0.5, "phi1_dot": 0.6 / math.cos(psi), "psi1_dot": 0.6, "xi1_1_dot": 0.1}


def to_one_line(angle: float) -> tuple[Named, Named]:
    """The second of two links is bent from the first one's line by an angle."""
    coordinates = {"phi1": 0.3, "psi1": 0.7, "xi1_1": 0.25, "xi1_2": 0.2, "phi2": 0.3, "psi2": 0.7 - angle}
    rates = {"phi1_dot": 0.5, "psi1_dot": 0.4, "phi2_dot": -0.6, "psi2_dot": 0.3, "xi1_2_dot": 0.1}
    return coordinates | {"xi2_1": 0.25, "xi2_2": 0.2}, rates


def to_across(angle: float) -> tuple[Named, Named]:
    """The ski turns until it points across x."""
    coordinates = {"x": 0.0, "y": 0.0, "phi0": math.pi / 2 - angle, "phi1": 1.1, "psi1": 1.0, "xi1_1": 0.25, "xi1_2": 0.2}
    return coordinates, {"speed": 3.0, "phi0_dot": 0.5, "phi1_dot": 0.6, "psi1_dot": 0.6, "xi1_1_dot": 0.1}


def by_the_paper(m: Mechanism, coordinates: Named, rates: Named, form: str) -> tuple[float, Array | None]:
    """Condition number and regular accelerations of a form; None where `solve` refuses."""
    eom = equations_of_motion(m, coordinates, rates, form)
    try:
        solution = eom.solve().accelerations
    except SingularError:
        return eom.condition, None
    a = dict(zip(eom.names, solution.tolist(), strict=True))
    regular = []
    if m.layout.base == "ski":
        cos, sin, turn = math.cos(coordinates["phi0"]), math.sin(coordinates["phi0"]), eom.rates["phi0_dot"]
        speed = cos * eom.rates["x_dot"] + sin * eom.rates["y_dot"]
        along = {
            "full": lambda: cos * a["x"] + sin * a["y"],
            "chaplygin": lambda: (a["x"] + speed * sin * turn) / cos,
            "speed": lambda: a["speed"],
        }[form]()
        regular += [along, a["phi0"]]
    for i in range(1, len(m.layout.links) + 1):
        cos, sin = math.cos(coordinates[f"psi{i}"]), math.sin(coordinates[f"psi{i}"])
        phi, psi = eom.rates[f"phi{i}_dot"], eom.rates[f"psi{i}_dot"]
        regular += [a[f"phi{i}"] * cos - 2.0 * phi * psi * sin, a[f"psi{i}"] + phi**2 * sin * cos, a[f"xi{i}_1"], a[f"xi{i}_2"]]
    return eom.condition, np.array(regular)


def by_the_engine(m: Mechanism, coordinates: Named, rates: Named) -> tuple[float, Array | None]:
    """The same from Pinocchio's matrices in (q, v), without the row that the knife edge holds."""
    layout = m.layout
    q, v = m.state(coordinates, equations_of_motion(m, coordinates, rates).rates)
    keep = np.array([k for k in range(layout.nv) if k != 1 or layout.base != "ski"])
    mass = np.array(pin.crba(m.model, make_data(m.model), q, pin.Convention.LOCAL))[np.ix_(keep, keep)]
    vdot = np.zeros(layout.nv)
    try:
        vdot[keep] = np.linalg.solve(mass, -pin.nonLinearEffects(m.model, make_data(m.model), q, v)[keep])
    except np.linalg.LinAlgError:
        return float(np.linalg.cond(mass)), None
    motion, regular = kinematics(layout, q, v), []
    growth = {-1: np.zeros(3)}
    if layout.base == "ski":
        regular += [vdot[0], vdot[2]]
        growth[-1] = np.array([0.0, 0.0, vdot[2]])
    for i, link in enumerate(layout.links):
        rotation = motion.rotations[i]
        spin = rotation @ v[link.v : link.v + 3]
        growth[i] = growth[link.parent] + rotation @ vdot[link.v : link.v + 3] + np.cross(motion.omegas[i], spin)
        across = rotation.T @ growth[i]  # the link's frame of the chart: (d, u_phi, u_psi)
        regular += [across[2], -across[1], vdot[link.lower.v], vdot[link.upper.v]]
    return float(np.linalg.cond(mass)), np.array(regular)


def merged(m: Mechanism, coordinates: Named, rates: Named) -> tuple[float, Array | None]:
    """Condition number with (8.1), phi1 = phi0, put into the equations: one heading for ski and link."""
    eom = equations_of_motion(m, coordinates, rates, "speed")
    basis = np.delete(np.eye(len(eom.names)), 2, axis=1)
    basis[eom.names.index("phi1"), eom.names.index("phi0")] = 1.0
    return float(np.linalg.cond(basis.T @ eom.mass_matrix @ basis)), None


def approach(posture: Posture, routes: dict[str, Callable[[Named, Named], tuple[float, Array | None]]]) -> dict[str, Any]:
    """Condition numbers and differences from the engine along an approach; the engine's route comes first."""
    found: dict[str, Any] = {name: {"condition": [], "difference": []} for name in routes}
    for angle in ANGLES:
        coordinates, rates = posture(float(angle))
        reference = None
        for name, route in routes.items():
            condition, regular = route(coordinates, rates)
            reference = regular if reference is None else reference
            known = regular is not None and reference is not None
            difference = float(np.abs(regular - reference).max() / np.abs(reference).max()) if known else math.nan
            found[name]["condition"].append(condition)
            found[name]["difference"].append(difference)
    return found


def measure() -> dict[str, dict[str, Any]]:
    """All three approaches: title -> route -> condition numbers and differences."""
    skier = mechanism(SKI, 1, 0.0)

    def paper(m: Mechanism, form: str) -> Callable[[Named, Named], tuple[float, Array | None]]:
        return lambda coordinates, rates: by_the_paper(m, coordinates, rates, form)

    def engine(m: Mechanism) -> Callable[[Named, Named], tuple[float, Array | None]]:
        return lambda coordinates, rates: by_the_engine(m, coordinates, rates)

    forms = {label: paper(skier, form) for form, label in FORMS.items()}
    upright = {ENGINE: engine(skier), **forms, MERGED: lambda coordinates, rates: merged(skier, coordinates, rates)}
    lines = {}
    for hinge, mass in (("hinge of 5 kg", 5.0), ("massless hinge", 0.0)):
        pair = mechanism({"kind": "pivot"}, 2, mass)
        lines |= approach(to_one_line, {f"{ENGINE}, {hinge}": engine(pair), f"paper, {hinge}": paper(pair, "full")})
    return {
        "a link to the vertical": approach(to_the_vertical, upright),
        "two links to one line": lines,
        "the ski across x": approach(to_across, {ENGINE: engine(skier), **forms}),
    }


def draw(figure: Figure, results: dict[str, dict[str, Any]]) -> None:
    """Condition numbers above, differences from the engine below."""
    grid = figure.subplots(2, 3, sharex=True, sharey="row")
    styles = {
        ENGINE: (BLACK, "-", 2.4), FORMS["full"]: (PALETTE[0], "-", 1.4), FORMS["chaplygin"]: (PALETTE[1], "--", 1.4),
        FORMS["speed"]: (PALETTE[2], "-.", 1.4), MERGED: (PALETTE[4], ":", 1.8),
        f"{ENGINE}, hinge of 5 kg": (BLACK, "-", 2.4), "paper, hinge of 5 kg": (PALETTE[0], "-", 1.4),
        f"{ENGINE}, massless hinge": (GREY, "-", 2.4), "paper, massless hinge": (PALETTE[3], "--", 1.4),
    }  # fmt: skip
    for column, (title, routes) in enumerate(results.items()):
        top, bottom = grid[:, column]
        for name, values in routes.items():
            colour, dashes, width = styles[name]
            top.loglog(ANGLES, values["condition"], color=colour, linestyle=dashes, linewidth=width, label=name)
            if not name.startswith(ENGINE) and name != MERGED:
                bottom.loglog(ANGLES, values["difference"], color=colour, linestyle=dashes, linewidth=width)
        top.set_title(title)
        bottom.set(xlabel="angle to that posture [rad]")
        bottom.legend(*top.get_legend_handles_labels(), loc="upper center", bbox_to_anchor=(0.5, -0.25))
    grid[0, 0].set(ylabel="condition number of the mass matrix", xlim=(1.0, 5e-10), ylim=(1.0, 1e20))
    grid[1, 0].set(ylabel="accelerations: difference from\nthe engine / largest", ylim=(1e-17, 10.0))


def report(results: dict[str, dict[str, Any]]) -> str:
    """Markdown with one table an approach."""
    nearest = [int(np.argmin(np.abs(np.log(ANGLES / angle)))) for angle in SHOWN]
    parts = []
    for title, routes in results.items():
        rows = [[name, *(_cell(name, values, at) for at in nearest)] for name, values in routes.items()]
        parts.append(f"## {title[0].upper()}{title[1:]}\n\n{table(['', *(f'{angle:.0e} rad' for angle in SHOWN)], rows)}")
    body = "\n\n".join(parts)
    return f"""# Where the paper's matrices degenerate

Condition number of the mass matrix (SI units) at an angle from the bad posture; in brackets the difference of the accelerations
of link directions, lengths and ski from those solved for in the engine's velocities, relative to the largest of them.
*refused*: `solve` raises SingularError. On the ski the engine's matrix is without the sideways row, which the knife edge holds.

![condition numbers and lost digits](degenerate.png)

{body}
"""


def _cell(name: str, values: dict[str, Any], at: int) -> str:
    condition, difference = f"{values['condition'][at]:.1e}", values["difference"][at]
    if name.startswith(ENGINE) or name == MERGED:
        return condition
    return f"{condition} (refused)" if math.isnan(difference) else f"{condition} ({difference:.0e})"


def main() -> None:
    """Measure, write the report and the picture."""
    results = measure()
    picture = (lambda figure: draw(figure, results), 11.0, 8.2)
    write_report("degenerate", [report(results)], {"angles": ANGLES, "results": results}, picture=picture)


if __name__ == "__main__":
    main()
