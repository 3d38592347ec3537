"""Parameters of a finger from measurements: shapes at rest, paths of the tip, vibrations."""

from lazy_loader import attach_stub

__all__ = [
    "Commissioning",
    "ComparedChannel",
    "Comparison",
    "DampedSine",
    "Estimate",
    "ExperimentPlan",
    "Fit",
    "IdentifyScene",
    "Poses",
    "Reading",
    "Replay",
    "TipPath",
    "commission",
    "compare",
    "data_folder",
    "design_commissioning",
    "design_experiments",
    "fit_damped_sine",
    "identify",
    "read_data",
    "replay",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
