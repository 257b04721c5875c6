"""x."""
import numba
def compiled(function, options):
    return numba.njit(**options)(function)
