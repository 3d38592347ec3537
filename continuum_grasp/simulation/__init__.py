"""Motion, equilibrium and modes of a finger in its scene."""

from continuum_grasp.simulation.initial import initial_state
from continuum_grasp.simulation.modes import Modes, modes
from continuum_grasp.simulation.simulate import simulate
from continuum_grasp.simulation.slack import SlackTime, TensionLimit
from continuum_grasp.simulation.static_shape import Equilibrium
from continuum_grasp.simulation.statics import equilibrium, equilibrium_path, equilibrium_under
from continuum_grasp.simulation.trajectory import Trajectory

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
