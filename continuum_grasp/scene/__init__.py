"""What the user describes: frozen values in SI units, read from YAML or built in Python.

The names here are loaded when they are first used. Reading files: `continuum_grasp.scene.load.load`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from continuum_grasp._lazy import lazy_names

_ROOMS = {
    "continuum_grasp.scene.finger": (
        "BasePose",
        "Damping",
        "Finger",
        "PiecewiseCurvature",
        "PointMass",
        "Rod",
        "Tendons",
    ),
    "continuum_grasp.scene.grasp": (
        "Circle",
        "GraspContacts",
        "GraspScene",
        "GraspSolver",
        "NoGravity",
        "OutOfPlaneGravity",
        "Palm",
        "PlanarGravity",
    ),
    "continuum_grasp.scene.loads": (
        "Actuation",
        "ForceLoad",
        "Load",
        "MomentLoad",
        "Samples",
        "VectorSamples",
    ),
    "continuum_grasp.scene.simulate": ("Fidelity", "Initial", "Scene", "Timing"),
}
__all__ = [name for names in _ROOMS.values() for name in names]

if TYPE_CHECKING:
    from continuum_grasp.scene.finger import BasePose as BasePose
    from continuum_grasp.scene.finger import Damping as Damping
    from continuum_grasp.scene.finger import Finger as Finger
    from continuum_grasp.scene.finger import PiecewiseCurvature as PiecewiseCurvature
    from continuum_grasp.scene.finger import PointMass as PointMass
    from continuum_grasp.scene.finger import Rod as Rod
    from continuum_grasp.scene.finger import Tendons as Tendons
    from continuum_grasp.scene.grasp import Circle as Circle
    from continuum_grasp.scene.grasp import GraspContacts as GraspContacts
    from continuum_grasp.scene.grasp import GraspScene as GraspScene
    from continuum_grasp.scene.grasp import GraspSolver as GraspSolver
    from continuum_grasp.scene.grasp import NoGravity as NoGravity
    from continuum_grasp.scene.grasp import OutOfPlaneGravity as OutOfPlaneGravity
    from continuum_grasp.scene.grasp import Palm as Palm
    from continuum_grasp.scene.grasp import PlanarGravity as PlanarGravity
    from continuum_grasp.scene.loads import Actuation as Actuation
    from continuum_grasp.scene.loads import ForceLoad as ForceLoad
    from continuum_grasp.scene.loads import Load as Load
    from continuum_grasp.scene.loads import MomentLoad as MomentLoad
    from continuum_grasp.scene.loads import Samples as Samples
    from continuum_grasp.scene.loads import VectorSamples as VectorSamples
    from continuum_grasp.scene.simulate import Fidelity as Fidelity
    from continuum_grasp.scene.simulate import Initial as Initial
    from continuum_grasp.scene.simulate import Scene as Scene
    from continuum_grasp.scene.simulate import Timing as Timing

__getattr__, __dir__ = lazy_names(__name__, _ROOMS)
