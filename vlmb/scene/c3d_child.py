"""Run by c3d.py in a process of its own: reads FILE by ezc3d, writes its points and analogs as npz to standard output.

A damaged file may bring ezc3d down, or keep it busy without end; then it takes this process along, and no other.
"""

import contextlib
import io
import sys
from typing import Any

import numpy as np

MEMORY = 4 << 30  # bytes


def main(path: str) -> None:
    """Read a file and write what it holds."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    import ezc3d

    content: Any = ezc3d.c3d(path)
    parameters, data, header = content["parameters"], content["data"], content["header"]
    found = io.BytesIO()
    np.savez(
        found, points=np.asarray(data["points"], float)[:3], residuals=np.asarray(data["meta_points"]["residuals"], float)[0],
        analogs=np.asarray(data["analogs"], float)[0], point_names=names(parameters, "POINT", "LABELS"),
        analog_names=names(parameters, "ANALOG", "LABELS"), point_units=names(parameters, "POINT", "UNITS"),
        analog_units=names(parameters, "ANALOG", "UNITS"),
        rates=np.array([header["points"]["frame_rate"], header["analogs"]["frame_rate"]], float),
    )  # fmt: skip
    sys.stdout.buffer.write(found.getvalue())


def names(parameters: Any, group: str, key: str) -> Any:
    """Texts of all channels of a group; a group of many has them in several parameters."""
    found: list[str] = []
    for entry in (key, *(f"{key}{k}" for k in range(2, 100))):
        if group not in parameters or entry not in parameters[group]:
            break
        found += [str(text).strip() for text in parameters[group][entry]["value"]]
    return np.array(found, dtype=str)


if __name__ == "__main__":
    main(sys.argv[1])
