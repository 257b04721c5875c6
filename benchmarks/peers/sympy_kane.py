"""SymPy: Kane's method of `sympy.physics.mechanics` in the paper's angles, `lambdify` with common subexpressions, SciPy's DOP853.

The knife edge is a velocity constraint with one dependent speed, the sideways one. Two links on a pivot at most, one on a ski.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy as sp
import sympy.physics.mechanics as me
from peers.chain import Array, Chain, Outcome, Run, UnsupportedError, read_chain
from scipy.integrate import solve_ivp

SETTINGS = tuple(10.0 ** -(k / 2) for k in range(4, 25))  # rtol; atol a tenth of it
LINKS = 2


def prepare(scene: dict[str, Any], duration: float) -> dict[str, tuple[tuple[float, ...], Run]]:
    """Derive and compile to Python; return a run of a tolerance."""
    chain = read_chain(scene)
    if len(chain.links) + chain.on_ski > LINKS:
        raise UnsupportedError(f"set up for {LINKS} links on a pivot or one on a ski: deriving the equations takes too long")
    names, start, equations, places = derive(chain)
    size = len(names) // 2
    compiled = sp.lambdify(names, equations, modules="math", cse=True)
    points = sp.lambdify(names[:size], places, modules="math", cse=True)

    def rhs(t: float, y: Array) -> Array:
        rates, mass, force = compiled(*y.tolist())
        return np.concatenate([rates, np.linalg.solve(mass, force)])

    def run(rtol: float) -> Outcome:
        answer = solve_ivp(rhs, (0.0, duration), start, method="DOP853", rtol=rtol, atol=0.1 * rtol, t_eval=(duration,))
        if not answer.success:
            raise ArithmeticError(answer.message)
        return Outcome(np.array(points(*answer.y[:size, -1])), int(answer.nfev), None)

    return {"SymPy Kane, DOP853": (SETTINGS, run)}


def derive(chain: Chain) -> tuple[list[Any], Array, list[Any], list[Any]]:
    """Return the state's symbols (q, u), the start, [dq/dt, M, f] with M du/dt = f, and the points."""
    values: list[tuple[Any, Any, float, float]] = []  # coordinate, speed, both at the start

    def coordinate(name: str, value: float, rate: float) -> tuple[Any, Any]:
        q, u = me.dynamicsymbols(f"q_{name} u_{name}")
        values.append((q, u, value, rate))
        return q, u

    ground, origin = me.ReferenceFrame("ground"), me.Point("origin")
    origin.set_vel(ground, 0)
    gravity = sum((pull * axis for pull, axis in zip(chain.gravity, ground, strict=True)), me.Vector(0))
    bodies: list[Any] = []
    loads: list[Any] = []
    base = origin
    if chain.on_ski:
        (x, u_along), (y, u_across) = coordinate("x", chain.x, chain.speed), coordinate("y", chain.y, 0.0)
        turn, u_turn = coordinate("heading", chain.phi0, chain.phi0_dot)
        ski = ground.orientnew("ski", "Axis", (turn, ground.z))
        ski.set_ang_vel(ground, u_turn * ski.z)
        base = origin.locatenew("A", x * ground.x + y * ground.y)
        base.set_vel(ground, u_along * ski.x + u_across * ski.y)
        centre = base.locatenew("ski_centre", chain.com_offset * ski.x)
        centre.v2pt_theory(base, ground, ski)
        dyad = me.inertia(ski, 0, 0, chain.ski_inertia)
        bodies.append(me.RigidBody("ski", centre, ski, chain.ski_mass, (dyad, centre)))
        loads.append((centre, chain.ski_mass * gravity))
    points = [base]
    for i, link in enumerate(chain.links):
        (phi, u_phi), (psi, u_psi) = coordinate(f"phi{i}", link.phi, link.phi_dot), coordinate(f"psi{i}", link.psi, link.psi_dot)
        turned = ground.orientnew(f"turned{i}", "Axis", (phi, ground.z))
        turned.set_ang_vel(ground, u_phi * ground.z)
        frame = turned.orientnew(f"link{i}", "Axis", (-psi, turned.y))
        frame.set_ang_vel(turned, -u_psi * turned.y)
        hinge = points[-1]

        def along(name: str, length: Any, rate: Any, frame: Any = frame, hinge: Any = hinge) -> Any:
            point = hinge.locatenew(name, length * frame.x)
            point.set_vel(ground, hinge.vel(ground) + rate * frame.x + frame.ang_vel_in(ground).cross(length * frame.x))
            return point

        lower, u_lower = coordinate(f"lower{i}", link.lower.start, link.lower.rate) if link.lower.free else (link.lower.start, 0)
        near = along(f"near{i}", lower, u_lower)
        centre = along(f"centre{i}", lower + link.com, u_lower)
        far = along(f"far{i}", lower + link.length, u_lower)
        upper, u_upper = coordinate(f"upper{i}", link.upper.start, link.upper.rate) if link.upper.free else (link.upper.start, 0)
        tip = along(f"tip{i}", lower + link.length + upper, u_lower + u_upper)
        dyad = me.inertia(frame, 0, link.inertia, link.inertia)
        bodies.append(me.RigidBody(f"rod{i}", centre, frame, link.mass, (dyad, centre)))
        loads.append((centre, link.mass * gravity))
        if link.tip_mass:
            bodies.append(me.Particle(f"mass{i}", tip, link.tip_mass))
            loads.append((tip, link.tip_mass * gravity))
        for leg, length, one, other in ((link.lower, lower, hinge, near), (link.upper, upper, far, tip)):
            if leg.free:
                pull = leg.stiffness * (length - leg.rest) * frame.x
                loads += [(one, pull), (other, -pull)]
        points.append(tip)
    t = me.dynamicsymbols._t
    q, u = [value[0] for value in values], [value[1] for value in values]
    rates = dict(zip(q, u, strict=True))
    speeds, constraint = u, {}
    if chain.on_ski:
        rates[x] = u_along * sp.cos(turn) - u_across * sp.sin(turn)
        rates[y] = u_along * sp.sin(turn) + u_across * sp.cos(turn)
        speeds = [speed for speed in u if speed != u_across]
        constraint = {"u_dependent": [u_across], "velocity_constraints": [u_across]}
    kinematic = [entry.diff(t) - rate for entry, rate in rates.items()]
    kane = me.KanesMethod(ground, q, speeds, kinematic, **constraint)
    kane.kanes_equations(bodies, loads)
    order = [list(kane.u).index(speed) for speed in u]
    plain = {symbol: sp.Symbol(symbol.func.__name__) for symbol in (*q, *u)}
    mass = kane.mass_matrix.subs(plain)[:, order]
    force = kane.forcing.subs({rate: rates[entry] for entry, rate in ((entry, entry.diff(t)) for entry in q)}).subs(plain)
    equations = [[rates[entry].subs(plain) for entry in q], mass.tolist(), list(force)]
    places = [list(point.pos_from(origin).to_matrix(ground).subs(plain)) for point in points]
    start = np.array([value[2] for value in values] + [value[3] for value in values])
    return [plain[symbol] for symbol in (*q, *u)], start, equations, places
