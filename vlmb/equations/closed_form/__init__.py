"""The paper's closed-form equations of motion for any number of links, in plain numpy.

Nothing here knows Pinocchio or the rest of the project: the package is an independent witness for the generated model.

    A_(n+1)  tip mass mu_n
       |  xi_n2   massless
       |  l_n     rod
       |  xi_n1   massless
      A_n        ...  A_1 = pivot, or the ski's knife-edge point (x, y, 0)
"""

from .assembly import (
    assemble_bias,
    assemble_mass_matrix,
    bias,
    coordinate_names,
    kinetic_energy,
    mass_matrix,
    potential_energy,
)
from .blocks import Blocks, chain_blocks, equation_blocks
from .parameters import (
    FORMS,
    ChainParameters,
    ChainState,
    Directions,
    Moments,
    chain_parameters,
    chain_state,
    directions,
    moments,
)
from .pivot import eq_2_3, eq_2_5, eq_2_6, eq_2_7, eq_2_8, eq_2_9, eq_3_1, eq_3_2, eq_3_3, eq_4_2
from .skier import (
    eq_7_2,
    eq_7_7,
    eq_7_8,
    eq_7_9,
    eq_7_10,
    eq_7_11,
    eq_7_12,
    eq_7_13,
    eq_7_14,
    eq_7_15,
    eq_7_16,
)

__all__ = [
    "FORMS",
    "Blocks",
    "ChainParameters",
    "ChainState",
    "Directions",
    "Moments",
    "assemble_bias",
    "assemble_mass_matrix",
    "bias",
    "chain_blocks",
    "chain_parameters",
    "chain_state",
    "coordinate_names",
    "directions",
    "eq_2_3",
    "eq_2_5",
    "eq_2_6",
    "eq_2_7",
    "eq_2_8",
    "eq_2_9",
    "eq_3_1",
    "eq_3_2",
    "eq_3_3",
    "eq_4_2",
    "eq_7_2",
    "eq_7_7",
    "eq_7_8",
    "eq_7_9",
    "eq_7_10",
    "eq_7_11",
    "eq_7_12",
    "eq_7_13",
    "eq_7_14",
    "eq_7_15",
    "eq_7_16",
    "equation_blocks",
    "kinetic_energy",
    "mass_matrix",
    "moments",
    "potential_energy",
]
