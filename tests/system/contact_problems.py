"""Random problems of contacts, what a solution of one is, and Pinocchio's solver of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from vlmb.system.cone import Answer, Contact, Grip

Array = NDArray[np.float64]


class Problem(NamedTuple):
    """Contacts with rows (first tangent, second tangent, normal) each, then ideal rows; velocities before."""

    g: Array
    v: Array
    mu: float
    restitution: float
    count: int

    @property
    def contacts(self) -> list[Contact]:
        grip = [Grip((3 * k, 3 * k + 1), self.mu, self.mu) for k in range(self.count)]
        return [Contact(3 * k + 2, (grip[k],), self.restitution) for k in range(self.count)]

    @property
    def free(self) -> Array:
        """What is to be complementary to p where p is zero: v and e v_n."""
        found = self.v.copy()
        found[2 : 3 * self.count : 3] *= 1.0 + self.restitution
        return found


def cross(r: Array) -> Array:
    """Matrix of w x r."""
    return np.array([[0.0, r[2], -r[1]], [-r[2], 0.0, r[0]], [r[1], -r[0], 0.0]])


def random_problem(seed: int, count: int) -> Problem:
    """A rigid body with feet (G is singular from three on), or a mechanism of many freedoms, with an ideal row or none."""
    rng = np.random.default_rng(seed)
    if rng.integers(3) == 0:
        jacobian = np.vstack([np.hstack([np.eye(3), cross(rng.normal(size=3))]) for _ in range(count)])
        half = rng.normal(size=(3, 3))
        mass = np.zeros((6, 6))
        mass[:3, :3] = rng.uniform(0.5, 2.0) * np.eye(3)
        mass[3:, 3:] = half @ half.T / 3.0 + 0.5 * np.eye(3)
        ideal = 0
    else:
        freedoms, ideal = 3 * count + 3, int(rng.integers(2))
        jacobian = rng.normal(size=(3 * count + ideal, freedoms))
        half = rng.normal(size=(freedoms, freedoms))
        mass = half @ half.T / freedoms + 0.5 * np.eye(freedoms)
    rates = rng.normal(size=mass.shape[0])
    rows = jacobian[3 * count :]
    rates -= np.linalg.pinv(rows) @ (rows @ rates)
    g = jacobian @ np.linalg.solve(mass, jacobian.T)
    mu, restitution = float(rng.choice([0.0, 0.1, 0.3, 0.6, 1.0])), float(rng.choice([0.0, 0.3, 0.8]))
    return Problem((g + g.T) / 2.0, jacobian @ rates, mu, restitution, count)


def worst(problem: Problem, p: Array) -> float:
    """The largest breach of the law by impulses p, each against the size of its terms."""
    w = problem.g @ p + problem.free
    size = np.abs(problem.free) + np.abs(problem.g) @ np.abs(p)
    fast, large = float(size.max()), max(float(np.abs(p).max()), 1e-300)
    breaches = [float(np.abs(w[3 * problem.count :]).max(initial=0.0)) / fast]
    for k in range(problem.count):
        across, normal = slice(3 * k, 3 * k + 2), 3 * k + 2
        force, speed = float(np.linalg.norm(p[across])), float(np.linalg.norm(w[across]))
        breaches += [-w[normal] / fast, -p[normal] / large, abs(w[normal] * p[normal]) / (fast * large)]
        breaches.append((force - problem.mu * p[normal]) / large)
        breaches.append(abs(float(p[across] @ w[across]) + problem.mu * p[normal] * speed) / (fast * large))  # most dissipation
    return max(breaches)


def lost(problem: Problem, answer: Answer) -> float:
    """Kinetic energy lost, against that of the velocities along the impulses."""
    scale = max(float(np.abs(answer.p) @ (np.abs(problem.v) + np.abs(answer.v))), 1e-300)
    return -0.5 * float(answer.p @ (problem.v + answer.v)) / scale


def admm(problem: Problem) -> Array | None:
    """Impulses of the contacts by Pinocchio's alternating directions, ideal rows taken out; None where it gives up."""
    count = 3 * problem.count
    one, rest = slice(0, count), slice(count, None)
    g, b = problem.g[one, one], problem.free[one]
    if problem.v.size > count:
        held = np.linalg.solve(problem.g[rest, rest], np.column_stack([problem.g[rest, one], problem.free[rest]]))
        g, b = g - problem.g[one, rest] @ held[:, :-1], b - problem.g[one, rest] @ held[:, -1]
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    for _ in range(problem.count):
        contact = pin.PointContactConstraintModel(model, joint, pin.SE3.Identity())
        contact.setFriction(problem.mu)
        made = pin.ConstraintModel(contact)
        models.append(made)
        datas.append(made.createData())
    settings, result = pin.ADMMSolverSettings(), pin.ADMMSolverResult()
    for name in ("absolute_feasibility_tol", "relative_feasibility_tol", "absolute_complementarity_tol"):
        setattr(settings, name, 1e-14)
    settings.relative_complementarity_tol = 1e-14
    settings.max_iterations = 100_000
    pin.ADMMConstraintSolver(count).solve(pin.DelassusOperatorDense((g + g.T) / 2.0), b, models, datas, settings, result)
    p = np.array(result.retrieveConstraintImpulses())
    return p if np.all(np.isfinite(p)) else None
