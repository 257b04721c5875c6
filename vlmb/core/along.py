"""Reading a motion sample by sample: given lengths, energies, and every force of each sample."""

from __future__ import annotations

from vlmb.core.energy import energies
from vlmb.core.jit import kernel
from vlmb.core.plant import COLUMN, ROW, Memory, Plant, drive, evaluate
from vlmb.core.scratch import AXIAL
from vlmb.core.springs import follow_springs, springs_energy
from vlmb.core.tree import Array, Integers


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


@kernel
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
