"""Descriptions by the user: frozen values in SI units, read from YAML or built in Python.

The names here are loaded when they are first used. Reading files: `continuum_grasp.scene.load.load`.
"""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.scene.control import ControlScene as ControlScene
    from continuum_grasp.scene.controller import Bounds as Bounds
    from continuum_grasp.scene.controller import Controller as Controller
    from continuum_grasp.scene.controller import DiscZone as DiscZone
    from continuum_grasp.scene.controller import HalfPlaneZone as HalfPlaneZone
    from continuum_grasp.scene.controller import Horizon as Horizon
    from continuum_grasp.scene.controller import InputLimits as InputLimits
    from continuum_grasp.scene.controller import Penalty as Penalty
    from continuum_grasp.scene.controller import Plant as Plant
    from continuum_grasp.scene.cost import CircleReference as CircleReference
    from continuum_grasp.scene.cost import Cost as Cost
    from continuum_grasp.scene.cost import ForceWeight as ForceWeight
    from continuum_grasp.scene.cost import Reference as Reference
    from continuum_grasp.scene.cost import RowSamples as RowSamples
    from continuum_grasp.scene.cost import ShapeWeight as ShapeWeight
    from continuum_grasp.scene.cost import Weight as Weight
    from continuum_grasp.scene.design import Design as Design
    from continuum_grasp.scene.design import DesignSolver as DesignSolver
    from continuum_grasp.scene.design import DesignVariable as DesignVariable
    from continuum_grasp.scene.design import QuantityLimit as QuantityLimit
    from continuum_grasp.scene.design import Tolerance as Tolerance
    from continuum_grasp.scene.estimator import BendingSensors as BendingSensors
    from continuum_grasp.scene.estimator import Disturbed as Disturbed
    from continuum_grasp.scene.estimator import Estimator as Estimator
    from continuum_grasp.scene.estimator import Measured as Measured
    from continuum_grasp.scene.finger import BasePose as BasePose
    from continuum_grasp.scene.finger import Finger as Finger
    from continuum_grasp.scene.finger import PointMass as PointMass
    from continuum_grasp.scene.finger import Stops as Stops
    from continuum_grasp.scene.finger import TipBody as TipBody
    from continuum_grasp.scene.graded import PiecewiseCurvature as PiecewiseCurvature
    from continuum_grasp.scene.graded import RodFactors as RodFactors
    from continuum_grasp.scene.graded import RodSamples as RodSamples
    from continuum_grasp.scene.graded import RodSection as RodSection
    from continuum_grasp.scene.graded import SpiRob as SpiRob
    from continuum_grasp.scene.grasp import GraspScene as GraspScene
    from continuum_grasp.scene.grasp_options import Disturbances as Disturbances
    from continuum_grasp.scene.grasp_options import FingerContacts as FingerContacts
    from continuum_grasp.scene.grasp_options import GraspContacts as GraspContacts
    from continuum_grasp.scene.grasp_options import GraspFinger as GraspFinger
    from continuum_grasp.scene.grasp_options import GraspSolver as GraspSolver
    from continuum_grasp.scene.grasp_options import NoGravity as NoGravity
    from continuum_grasp.scene.grasp_options import ObjectiveWeights as ObjectiveWeights
    from continuum_grasp.scene.grasp_options import OutOfPlaneGravity as OutOfPlaneGravity
    from continuum_grasp.scene.grasp_options import PlanarGravity as PlanarGravity
    from continuum_grasp.scene.loads import Actuation as Actuation
    from continuum_grasp.scene.loads import ForceLoad as ForceLoad
    from continuum_grasp.scene.loads import Load as Load
    from continuum_grasp.scene.loads import MomentLoad as MomentLoad
    from continuum_grasp.scene.loads import Samples as Samples
    from continuum_grasp.scene.loads import VectorSamples as VectorSamples
    from continuum_grasp.scene.mission import MissionController as MissionController
    from continuum_grasp.scene.mission import MissionScene as MissionScene
    from continuum_grasp.scene.mission import Phases as Phases
    from continuum_grasp.scene.mission import Trials as Trials
    from continuum_grasp.scene.mission import Turn as Turn
    from continuum_grasp.scene.objects import Box as Box
    from continuum_grasp.scene.objects import Circle as Circle
    from continuum_grasp.scene.objects import Ellipse as Ellipse
    from continuum_grasp.scene.objects import Freedom as Freedom
    from continuum_grasp.scene.objects import Outline as Outline
    from continuum_grasp.scene.objects import Polygon as Polygon
    from continuum_grasp.scene.objects import Stadium as Stadium
    from continuum_grasp.scene.objects import Superellipse as Superellipse
    from continuum_grasp.scene.objects import Union as Union
    from continuum_grasp.scene.plan import DurationRange as DurationRange
    from continuum_grasp.scene.plan import FineCheck as FineCheck
    from continuum_grasp.scene.plan import Goal as Goal
    from continuum_grasp.scene.plan import PlanBounds as PlanBounds
    from continuum_grasp.scene.plan import PlanInput as PlanInput
    from continuum_grasp.scene.plan import PlanScene as PlanScene
    from continuum_grasp.scene.plan import PlanSolver as PlanSolver
    from continuum_grasp.scene.rod import Damping as Damping
    from continuum_grasp.scene.rod import DryFriction as DryFriction
    from continuum_grasp.scene.rod import Rod as Rod
    from continuum_grasp.scene.simulate import Fidelity as Fidelity
    from continuum_grasp.scene.simulate import Initial as Initial
    from continuum_grasp.scene.simulate import Scene as Scene
    from continuum_grasp.scene.simulate import Timing as Timing
    from continuum_grasp.scene.supports import Line as Line
    from continuum_grasp.scene.supports import Palm as Palm
    from continuum_grasp.scene.supports import Point as Point
    from continuum_grasp.scene.supports import VGroove as VGroove
    from continuum_grasp.scene.surroundings import ContactLaw as ContactLaw
    from continuum_grasp.scene.surroundings import Surroundings as Surroundings
    from continuum_grasp.scene.sweep import Sweep as Sweep
    from continuum_grasp.scene.tendons import Chamber as Chamber
    from continuum_grasp.scene.tendons import Tendon as Tendon
    from continuum_grasp.scene.tendons import Tendons as Tendons

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)
