"""Steps of a plant: the cheapest method that is stable, and how many steps it takes per control period."""

from __future__ import annotations

import math
from typing import NamedTuple

from continuum_grasp.model import System
from continuum_grasp.scene import INTEGRATORS


class PlantIntegration(NamedTuple):
    """Integration of a plant: name in ``INTEGRATORS``, steps per control period, fastest rate [1/s].

    Plants of add-ons may have a name of their own.
    """

    name: str
    substeps: int
    radius: float

    def explicit_steps(self, period: float) -> int:
        """Steps of the explicit method in a period [s]."""
        return _explicit_steps(self.radius, period)


def _explicit_steps(rate: float, period: float) -> int:
    return max(1, math.ceil(rate * period / INTEGRATORS["rk4"].target))


def cheapest_steps(system: System, rate: float, period: float) -> tuple[str, int]:
    """Method and steps per period [s] of a system with a fastest rate [1/s], by contacts and damping."""
    structure = system.structure
    longest = system.finger_model.structure.partial_step
    is_damped = structure.has_law("damping")
    if system.surroundings is not None or is_damped:
        method = structure.stiff_method() if is_damped else "ros2"
        return method, math.ceil(period / longest - 1e-9)
    wanted = _explicit_steps(rate, period)
    # 12.5: longest step of either method per that; on fingers of a hand it follows a step of the input to 1e-6
    least = math.ceil(period / (12.5 * longest) - 1e-9)
    # 40: greatest number of sub-steps per control period for the explicit method
    if wanted <= max(40, least):
        return "rk4", max(wanted, least)
    return structure.stiff_method(), max(least, 1)
