"""Motion, equilibrium and modes of a finger in its scene."""

from lazy_loader import attach_stub

__all__ = [
    "Equilibrium",
    "Modes",
    "SlackTime",
    "TensionLimit",
    "Trajectory",
    "equilibrium",
    "equilibrium_path",
    "equilibrium_under",
    "initial_state",
    "modes",
    "simulate",
]
__getattr__, __dir__, _ = attach_stub(__name__, __file__)
