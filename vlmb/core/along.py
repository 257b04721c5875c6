"""Reading a motion sample by sample: given lengths, energies, angles on their branch, and every force of each sample."""

from __future__ import annotations

from vlmb.core.angles import read_angles
from vlmb.core.energy import energies
from vlmb.core.evaluation import drive, evaluate
from vlmb.core.jit import inner, kernel
from vlmb.core.plant import COLUMN, ROW, Memory, Plant
from vlmb.core.scalars import atan2, cos, sin, wrapped
from vlmb.core.scratch import AXIAL
from vlmb.core.springs import follow_springs, springs_energy
from vlmb.core.tree import Array, Integers

OFF_POLE = 0.3  # cos(psi) above which an azimuth goes on smoothly from sample to sample
UPRIGHT = 1e-12  # cos(psi) below which an azimuth has no rate


@kernel
def given_along(plant: Plant, memory: Memory, t: Array, out: Array) -> None:
    """Write the given lengths with two derivatives (N, n, 6) at the times t (N,)."""
    for s in range(t.shape[0]):
        drive(plant, memory, t[s])
        for i in range(out.shape[1]):
            for j in range(6):
                out[s, i, j] = memory.given[i, j]


@kernel
def energies_along(plant: Plant, memory: Memory, t: Array, y: Array, out: Array) -> None:
    """Write kinetic energy, gravity's and that of all springs (N, 3) [J] at samples t (N,), y (N, ny)."""
    for s in range(t.shape[0]):
        drive(plant, memory, t[s])
        energies(plant.tree, y[s], memory.given, out[s])
        follow_springs(plant.springs, plant.tree, y[s], memory.near)
        out[s, 2] += springs_energy(plant.springs, plant.tree, y[s], memory.near)


@inner
def forces_along(
    plant: Plant, memory: Memory, t: Array, y: Array, inputs: Array, reference: Array, codes: Integers, values: Array,
    driving: Array, rates: Array,
) -> None:  # fmt: skip
    """Evaluate every sample: forces (N, k) [N, N m], those of given lengths (N, m) [N] and y' (N, ny); codes (N,) of failures.

    inputs (N, inputs) are the forces from outside, reference (N, quantities, 2) the branches of angles.
    """
    for s in range(t.shape[0]):
        for j in range(inputs.shape[1]):
            memory.inputs[j] = inputs[s, j]
        for k in range(reference.shape[1]):
            memory.reference[k, 0], memory.reference[k, 1] = reference[s, k, 0], reference[s, k, 1]
        follow_springs(plant.springs, plant.tree, y[s], memory.near)
        codes[s] = evaluate(plant, memory, t[s], y[s], rates[s])
        for k in range(plant.force.shape[0]):
            values[s, k] = memory.values[k]
        for k in range(plant.driven.shape[0]):
            driving[s, k] = memory.scratch.rows[plant.driven[k, ROW], AXIAL + plant.driven[k, COLUMN] // 3]


@kernel
def angles_along(
    t: Array, heading: Array, turning: Array, directions: Array, turns: Array, branch: Array, at: Integers, plane: bool,
    yaws: bool, near: Array, values: Array, rates: Array,
) -> None:  # fmt: skip
    """Write heading, azimuths and elevations of samples t (N,) and their rates into values and rates (N, coordinates).

    directions, turns (N, n, 3) and their rates; at (n,) places of the elevations, an azimuth stands before its own. Angles are
    read nearest to their row of `branch` (N, coordinates); after a single row they go on by rates that can be trusted.
    `near` (coordinates,) is overwritten. In a plane no posture hides an angle; `yaws`: the third coordinate is the heading.
    """
    count, links, each = t.shape[0], at.shape[0], branch.shape[0] > 1
    for s in range(count):
        if s == 0 or (each and not plane):
            for k in range(near.shape[0]):
                near[k] = branch[s, k]
        if yaws:
            values[s, 2] = near[2] + wrapped(heading[s] - near[2])
            rates[s, 2] = turning[s]
        cosine, sine = cos(heading[s]), sin(heading[s])
        for i in range(links):
            k = at[i]
            d, u = directions[s, i], turns[s, i]
            if plane:
                along, growth = cosine * d[0] + sine * d[1], cosine * u[0] + sine * u[1]
                values[s, k] = near[k] + wrapped(atan2(d[2], along) - near[k])
                rates[s, k] = along * u[2] - d[2] * growth
            else:
                phi, psi = read_angles((d[0], d[1], d[2]), near[k - 1], near[k])
                values[s, k - 1], values[s, k] = phi, psi
                steep = cos(psi)
                rates[s, k - 1] = (cos(phi) * u[1] - sin(phi) * u[0]) / steep if abs(steep) > UPRIGHT else 0.0
                rates[s, k] = steep * u[2] - sin(psi) * (cos(phi) * u[0] + sin(phi) * u[1])
        if s + 1 < count:
            for k in range(near.shape[0]):
                near[k] = values[s, k]
            step = t[s + 1] - t[s]
            if yaws:
                near[2] += rates[s, 2] * step
            for i in range(links):
                k = at[i]
                if plane:
                    near[k] += rates[s, k] * step
                elif abs(cos(values[s, k])) > OFF_POLE:
                    near[k - 1] += rates[s, k - 1] * step
                    near[k] += rates[s, k] * step
