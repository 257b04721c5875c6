"""vlmb: multibody dynamics of mechanisms whose links change their length, built on Pinocchio."""

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
    "equations_of_motion",
    "load_scene",
    "load_trajectory",
    "simulate",
]
