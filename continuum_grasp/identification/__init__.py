"""Parameters of a finger from measurements: shapes at rest, paths of the tip, vibrations."""

from continuum_grasp.identification.commissioning import Commissioning, commission, design_commissioning
from continuum_grasp.identification.comparison import Channel, Comparison
from continuum_grasp.identification.data import Poses, Reading, TipPath
from continuum_grasp.identification.experiments import ExperimentPlan, design_experiments
from continuum_grasp.identification.fit import Fit
from continuum_grasp.identification.fitting import compare, identify
from continuum_grasp.identification.read import data_folder, read_data
from continuum_grasp.identification.replayed import Replay
from continuum_grasp.identification.vibrations import DampedSine, fit_damped_sine
from continuum_grasp.scene.identify import Estimate, IdentifyScene
from continuum_grasp.scene.table import Table, read_table

__all__ = [
    "Channel",
    "Commissioning",
    "Comparison",
    "DampedSine",
    "Estimate",
    "ExperimentPlan",
    "Fit",
    "IdentifyScene",
    "Poses",
    "Reading",
    "Replay",
    "Table",
    "TipPath",
    "commission",
    "compare",
    "data_folder",
    "design_commissioning",
    "design_experiments",
    "fit_damped_sine",
    "identify",
    "read_data",
    "read_table",
]
