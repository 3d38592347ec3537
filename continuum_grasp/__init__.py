"""Planar tendon-driven continuum fingers: physics written once, compiled C, simulation, grasping and control.

Everything here is loaded when it is first used; importing the package is quick.
"""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

__version__ = "0.8.0"

if TYPE_CHECKING:
    from continuum_grasp.accuracy.choose import choose_fidelity as choose_fidelity
    from continuum_grasp.accuracy.report import accuracy_report as accuracy_report
    from continuum_grasp.closed_loop.run import run_closed_loop as run_closed_loop
    from continuum_grasp.control.controller import Controller as Controller
    from continuum_grasp.control.estimation.estimator import Estimator as Estimator
    from continuum_grasp.control.ocp.control_problem import ControlProblem as ControlProblem
    from continuum_grasp.control.rti_solver import rti as rti
    from continuum_grasp.core import compile as compile
    from continuum_grasp.design import optimize_design as optimize_design
    from continuum_grasp.errors import BeyondCertificate as BeyondCertificate
    from continuum_grasp.errors import ContinuumGraspError as ContinuumGraspError
    from continuum_grasp.errors import InputError as InputError
    from continuum_grasp.errors import Interrupted as Interrupted
    from continuum_grasp.errors import NumericalError as NumericalError
    from continuum_grasp.errors import SolverError as SolverError
    from continuum_grasp.export import export_c as export_c
    from continuum_grasp.export import export_casadi as export_casadi
    from continuum_grasp.export import export_fmu as export_fmu
    from continuum_grasp.export import export_mjcf as export_mjcf
    from continuum_grasp.export import export_web as export_web
    from continuum_grasp.grasp import optimize_grasp as optimize_grasp
    from continuum_grasp.identification.commissioning import commission as commission
    from continuum_grasp.identification.fitting import compare as compare
    from continuum_grasp.identification.fitting import identify as identify
    from continuum_grasp.identification.replayed import replay as replay
    from continuum_grasp.mission.run import run_mission as run_mission
    from continuum_grasp.mission.run import run_trials as run_trials
    from continuum_grasp.model import FingerModel as FingerModel
    from continuum_grasp.model import System as System
    from continuum_grasp.planning import plan as plan
    from continuum_grasp.scene import Actuation as Actuation
    from continuum_grasp.scene import BasePose as BasePose
    from continuum_grasp.scene import ControlScene as ControlScene
    from continuum_grasp.scene import Damping as Damping
    from continuum_grasp.scene import Fidelity as Fidelity
    from continuum_grasp.scene import Finger as Finger
    from continuum_grasp.scene import ForceLoad as ForceLoad
    from continuum_grasp.scene import GraspScene as GraspScene
    from continuum_grasp.scene import Initial as Initial
    from continuum_grasp.scene import MissionScene as MissionScene
    from continuum_grasp.scene import MomentLoad as MomentLoad
    from continuum_grasp.scene import PiecewiseCurvature as PiecewiseCurvature
    from continuum_grasp.scene import PlanScene as PlanScene
    from continuum_grasp.scene import PointMass as PointMass
    from continuum_grasp.scene import Rod as Rod
    from continuum_grasp.scene import Samples as Samples
    from continuum_grasp.scene import Scene as Scene
    from continuum_grasp.scene import Tendons as Tendons
    from continuum_grasp.scene import Timing as Timing
    from continuum_grasp.scene import VectorSamples as VectorSamples
    from continuum_grasp.scene.load import load as load
    from continuum_grasp.sweeps import sweep as sweep
    from continuum_grasp.sweeps import sweep_table as sweep_table
    from continuum_grasp.verbs import equilibrium as equilibrium
    from continuum_grasp.verbs import modes as modes
    from continuum_grasp.verbs import simulate as simulate

_MODULES = checked_imports(__name__)
__all__ = ["__version__", *(name for names in _MODULES.values() for name in names)]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)
