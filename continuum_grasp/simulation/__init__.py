"""Motion, equilibrium and modes of a finger in its scene; accuracy of all three, and the choice of a model."""

from lazy_loader import attach_stub

__all__ = [
    "AccuracyReport",
    "Chosen",
    "Equilibrium",
    "Modes",
    "SlackTime",
    "TensionLimit",
    "Trajectory",
    "accuracy_report",
    "choose_fidelity",
    "equilibrium",
    "equilibrium_path",
    "equilibrium_under",
    "initial_state",
    "modes",
    "simulate",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
