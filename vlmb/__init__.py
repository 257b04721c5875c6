"""vlmb: multibody dynamics of mechanisms whose links change their length, built on Pinocchio."""

import importlib
from typing import TYPE_CHECKING, Any

from vlmb._version import __version__
from vlmb.equations.accelerations import accelerations
from vlmb.equations.motion import EquationsOfMotion, equations_of_motion
from vlmb.errors import ExpressionError, SceneError, SimulationError, SingularError, StudyError, TrajectoryError, VlmbError
from vlmb.model.building import build
from vlmb.model.display import Displayed
from vlmb.model.layout import State
from vlmb.model.mechanism import Mechanism
from vlmb.scene.scene import Scene, load_scene
from vlmb.scene.tables import (
    Attach,
    Base,
    Column,
    Contact,
    Data,
    Edge,
    Force,
    Leg,
    Link,
    Posture,
    Programme,
    Robot,
    Rod,
    Run,
    Segment,
    Smoothing,
    Spring,
    Weld,
)
from vlmb.simulation.checking import check
from vlmb.simulation.loading import load_trajectory
from vlmb.simulation.simulate import simulate
from vlmb.simulation.trajectory import Trajectory
from vlmb.studies.inverse import inverse

__all__ = [
    "Attach",
    "Base",
    "Column",
    "Contact",
    "Data",
    "Edge",
    "EquationsOfMotion",
    "ExpressionError",
    "Force",
    "Leg",
    "Link",
    "Mechanism",
    "Posture",
    "Programme",
    "Robot",
    "Rod",
    "Run",
    "Scene",
    "SceneError",
    "Segment",
    "SimulationError",
    "SingularError",
    "Smoothing",
    "Spring",
    "State",
    "StudyError",
    "Trajectory",
    "TrajectoryError",
    "VlmbError",
    "Weld",
    "__version__",
    "accelerations",
    "build",
    "check",
    "closed_form",
    "equations_of_motion",
    "find_gait",
    "fit",
    "hinge_moments",
    "inverse",
    "linearize",
    "load_scene",
    "load_trajectory",
    "periodic",
    "plots",
    "sample",
    "sensitivities",
    "simulate",
    "steady",
    "sweep",
    "view",
]


def _card(what: Any) -> str:
    """Show a mechanism or a trajectory in a notebook."""
    from vlmb.views.notebook import card

    return card(what)


Displayed.card = staticmethod(_card)

if TYPE_CHECKING:
    from vlmb.equations import closed_form, hinge_moments
    from vlmb.studies.fit import fit
    from vlmb.studies.gaits import find_gait
    from vlmb.studies.linearize import linearize
    from vlmb.studies.periodic import periodic
    from vlmb.studies.sampling import sample
    from vlmb.studies.sensitivities import sensitivities
    from vlmb.studies.steady import steady
    from vlmb.studies.sweep import sweep
    from vlmb.views import plots, view
else:
    LATER = {
        "closed_form": "vlmb.equations.closed_form",
        "hinge_moments": "vlmb.equations.hinge_moments",
        "plots": "vlmb.views.plots",
        "view": "vlmb.views.view",
    }
    STUDIES = {
        name: {"sample": "sampling", "find_gait": "gaits"}.get(name, name)
        for name in ("find_gait", "fit", "linearize", "periodic", "sample", "sensitivities", "steady", "sweep")
    }  # functions and the modules of studies that they stand in

    def __getattr__(name: str) -> Any:
        """Import a module that few need when it is first asked for."""
        if name in LATER:
            return importlib.import_module(LATER[name])
        if name in STUDIES:
            return getattr(importlib.import_module(f"vlmb.studies.{STUDIES[name]}"), name)
        raise AttributeError(f"module 'vlmb' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
