"""vlmb: multibody dynamics of mechanisms whose links change their length, built on Pinocchio."""

import importlib
from typing import TYPE_CHECKING, Any

from vlmb._version import __version__
from vlmb.coordinates import State
from vlmb.equations import EquationsOfMotion, equations_of_motion
from vlmb.errors import ExpressionError, SceneError, SimulationError, SingularError, TrajectoryError, VlmbError
from vlmb.mechanism import Mechanism, build
from vlmb.scene import Scene, load_scene
from vlmb.simulate import simulate
from vlmb.trajectory import Trajectory, load_trajectory

__all__ = [
    "EquationsOfMotion",
    "ExpressionError",
    "Mechanism",
    "Scene",
    "SceneError",
    "SimulationError",
    "SingularError",
    "State",
    "Trajectory",
    "TrajectoryError",
    "VlmbError",
    "__version__",
    "build",
    "closed_form",
    "equations_of_motion",
    "hinge_moments",
    "load_scene",
    "load_trajectory",
    "plots",
    "simulate",
    "view",
]

if TYPE_CHECKING:
    from vlmb import closed_form, hinge_moments, plots, view
else:

    def __getattr__(name: str) -> Any:
        """Import a module that few need when it is first asked for."""
        if name in ("closed_form", "hinge_moments", "plots", "view"):
            return importlib.import_module(f"vlmb.{name}")
        raise AttributeError(f"module 'vlmb' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
