"""CasADi: Lagrange's equations in the paper's angles, C code generated and compiled, CVODES with Adams and functional iteration.

Written for a pivot. Two links at most: the generated code grows fast.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from peers.chain import Chain, Outcome, Run, UnsupportedError, read_chain

SETTINGS = tuple(10.0 ** -(k / 2) for k in range(4, 25))  # rtol; atol a tenth of it
LINKS = 2


def prepare(scene: dict[str, Any], duration: float) -> dict[str, tuple[tuple[float, ...], Run]]:
    """Derive, generate and compile; return a run of a tolerance."""
    chain = read_chain(scene)
    if chain.on_ski:
        raise UnsupportedError("no rows for a knife edge: its equations would have to be reduced by hand, which is not done here")
    if len(chain.links) > LINKS:
        raise UnsupportedError(f"the code generated for more than {LINKS} links takes too long to compile")
    state, rate, start, points = derive(chain)
    tips = ca.Function("tips", [state], [points])
    integrators: dict[float, Any] = {}
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # the compiler writes beside the source
        try:
            compiled = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2"]}, "jit_cleanup": False}
            function = ca.Function("rhs", [state], [rate], compiled)
            for rtol in SETTINGS:
                options = {
                    "reltol": rtol, "abstol": 0.1 * rtol, "linear_multistep_method": "adams",
                    "nonlinear_solver_iteration": "functional", "max_num_steps": 1_000_000,
                }  # fmt: skip
                problem = {"x": state, "ode": function(state)}
                integrators[rtol] = ca.integrator("run", "cvodes", problem, 0.0, duration, options)
        finally:
            os.chdir(here)

    def run(rtol: float) -> Outcome:
        end = integrators[rtol](x0=start)["xf"]
        stats = integrators[rtol].stats()
        return Outcome(np.array(tips(end)), stats.get("nfevals"), stats.get("nsteps"))

    return {"CasADi C code, CVODES Adams": (SETTINGS, run)}


def derive(chain: Chain) -> tuple[Any, Any, Any, Any]:
    """Return the state, its rate, the start and the points, from kinetic and potential energy."""
    names, values, rates = [], [], []
    for i, link in enumerate(chain.links):
        names += [f"phi{i}", f"psi{i}"]
        values += [link.phi, link.psi]
        rates += [link.phi_dot, link.psi_dot]
        for which, leg in (("lower", link.lower), ("upper", link.upper)):
            if leg.free:
                names.append(f"{which}{i}")
                values.append(leg.start)
                rates.append(leg.rate)
    q, qd = ca.SX.sym("q", len(names)), ca.SX.sym("qd", len(names))
    at = {name: q[k] for k, name in enumerate(names)}
    place, kinetic, potential, points = ca.SX.zeros(3), 0, 0, []
    gravity = ca.DM(chain.gravity)

    def point_mass(mass: float, where: Any) -> tuple[Any, Any]:
        speed = ca.jtimes(where, q, qd)
        return 0.5 * mass * ca.dot(speed, speed), -mass * ca.dot(gravity, where)

    points.append(place)
    for i, link in enumerate(chain.links):
        phi, psi = at[f"phi{i}"], at[f"psi{i}"]
        d = ca.vertcat(ca.cos(phi) * ca.cos(psi), ca.sin(phi) * ca.cos(psi), ca.sin(psi))
        turn = ca.jtimes(d, q, qd)
        lower, upper = at.get(f"lower{i}", link.lower.start), at.get(f"upper{i}", link.upper.start)
        tip = place + (lower + link.length + upper) * d
        for mass, where in ((link.mass, place + (lower + link.com) * d), (link.tip_mass, tip)):
            if mass:
                moving, lying = point_mass(mass, where)
                kinetic, potential = kinetic + moving, potential + lying
        kinetic += 0.5 * link.inertia * ca.dot(turn, turn)
        for leg, length in ((link.lower, lower), (link.upper, upper)):
            if leg.free:
                potential += 0.5 * leg.stiffness * (length - leg.rest) ** 2
        place = tip
        points.append(place)
    mass = ca.hessian(kinetic, qd)[0]
    momentum = ca.gradient(kinetic, qd)
    force = ca.gradient(kinetic - potential, q) - ca.jtimes(momentum, q, qd)  # M qdd = force
    rate = ca.vertcat(qd, ca.solve(mass, force))
    return ca.vertcat(q, qd), rate, ca.DM([*values, *rates]), ca.horzcat(*points).T
