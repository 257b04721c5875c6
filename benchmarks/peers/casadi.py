"""CasADi: Kane's equations in the paper's angles, C code generated and compiled, CVODES with Adams and functional iteration.

The knife edge is eliminated: the ski's velocities are its speed and its turn. Two links on a pivot at most, one on a ski: the
generated code grows fast.
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
    if len(chain.links) + chain.on_ski > LINKS:
        raise UnsupportedError(f"set up for {LINKS} links on a pivot or one on a ski: the generated code grows fast")
    state, rate, start, points = derive(chain)
    tips = ca.Function("tips", [state], [points])
    integrators: dict[float, Any] = {}
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # the compiler writes beside the source
        try:
            flags = {"flags": ["-O2"], "cleanup": False}
            compiled = {"jit": True, "compiler": "shell", "jit_options": flags, "jit_cleanup": False}
            function = ca.Function("rhs", [state], [rate], compiled)
            place = ca.MX.sym("place", state.numel())  # a call with SX would put the expressions back in, uncompiled
            for rtol in SETTINGS:
                options = {
                    "reltol": rtol, "abstol": 0.1 * rtol, "linear_multistep_method": "adams",
                    "nonlinear_solver_iteration": "functional", "max_num_steps": 1_000_000,
                }  # fmt: skip
                problem = {"x": place, "ode": function(place)}
                integrators[rtol] = ca.integrator("run", "cvodes", problem, 0.0, duration, options)
        finally:
            os.chdir(here)

    def run(rtol: float) -> Outcome:
        end = integrators[rtol](x0=start)["xf"]
        stats = integrators[rtol].stats()
        return Outcome(np.array(tips(end)), stats.get("nfevals"), stats.get("nsteps"))

    return {"CasADi C code, CVODES Adams": (SETTINGS, run)}


def derive(chain: Chain) -> tuple[Any, Any, Any, Any]:
    """Return the state (q, u), its rate, the start and the points.

    Kane: sum of m A'(A du/dt + B - g) = springs, with A the partial velocities of each mass and B its acceleration at du/dt = 0.
    """
    names, values, rates = [], [], []
    if chain.on_ski:
        names += ["x", "y", "heading"]
        values += [chain.x, chain.y, chain.phi0]
        rates += [chain.speed, chain.phi0_dot]
    for i, link in enumerate(chain.links):
        names += [f"phi{i}", f"psi{i}"]
        values += [link.phi, link.psi]
        rates += [link.phi_dot, link.psi_dot]
        for which, leg in (("lower", link.lower), ("upper", link.upper)):
            if leg.free:
                names.append(f"{which}{i}")
                values.append(leg.start)
                rates.append(leg.rate)
    q, u = ca.SX.sym("q", len(names)), ca.SX.sym("u", len(rates))
    at = {name: q[k] for k, name in enumerate(names)}
    skipped = len(names) - len(rates)  # one on a ski: x and y have one speed
    q_dot = ca.vertcat(u[0] * ca.cos(at["heading"]), u[0] * ca.sin(at["heading"]), u[1:]) if chain.on_ski else u
    gravity = ca.DM(chain.gravity)
    masses, load = [], ca.SX.zeros(len(rates))  # masses: (mass or inertia, place or direction, pull)
    place = ca.SX.zeros(3)
    if chain.on_ski:
        place = ca.vertcat(at["x"], at["y"], 0)
        heading = ca.vertcat(ca.cos(at["heading"]), ca.sin(at["heading"]), 0)
        masses += [(chain.ski_mass, place + chain.com_offset * heading, gravity), (chain.ski_inertia, at["heading"], 0)]
    points = [place]
    for i, link in enumerate(chain.links):
        phi, psi = at[f"phi{i}"], at[f"psi{i}"]
        d = ca.vertcat(ca.cos(phi) * ca.cos(psi), ca.sin(phi) * ca.cos(psi), ca.sin(psi))
        lower, upper = at.get(f"lower{i}", link.lower.start), at.get(f"upper{i}", link.upper.start)
        tip = place + (lower + link.length + upper) * d
        masses += [(link.mass, place + (lower + link.com) * d, gravity), (link.tip_mass, tip, gravity), (link.inertia, d, 0)]
        for name, leg in ((f"lower{i}", link.lower), (f"upper{i}", link.upper)):
            if leg.free:
                load[names.index(name) - skipped] -= leg.stiffness * (at[name] - leg.rest)
        place = tip
        points.append(place)
    inertia = ca.SX.zeros(len(rates), len(rates))
    for mass, where, pull in masses:
        if mass:
            velocity = ca.jtimes(where, q, q_dot)
            partial = ca.jacobian(velocity, u)
            inertia += mass * partial.T @ partial
            load += mass * partial.T @ (pull - ca.jtimes(velocity, q, q_dot))
    rate = ca.vertcat(q_dot, ca.ldl_solve(load, *ca.ldl(inertia)))
    return ca.vertcat(q, u), rate, ca.DM([*values, *rates]), ca.horzcat(*points).T
