"""What a controller is tried on: a finer model that differs from what the controller knows."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.scene.families import default_family
from continuum_grasp.scene.simulate import Fidelity
from continuum_grasp.scene.value import NonNegative, Positive, Value

__all__ = ["Plant"]


class Plant(Value):
    """How the plant differs from what the controller knows."""

    fidelity: Fidelity = Fidelity(family=default_family(free_tip=True), elements=8)
    """Of the plant's model."""
    stiffness: Positive = 1.0
    """Bending stiffness per that of the controller's finger [1]."""
    damping: Positive = 1.0
    """Damping per that of the controller's finger [1]."""
    tip_mass: NonNegative = 0.0
    """Mass at the tip that the controller does not know [kg]."""
    tendon_friction: NonNegative | None = None
    """Capstan friction coefficient of the tendons [1]; None: as the controller knows it."""
    time_constant: Annotated[float, Field(ge=1e-6, le=1e6)] | None = None
    """Time constant of the drive [s]; None: as the controller knows it."""
    drive_order: Literal[1, 2] = 2
    """Order of the drive's lag: 2 as the controller knows it, critically damped; 1: T dF/dt = F_command - F. A ramp is
    followed twice the time constant late by the former, once by the latter."""
    noise: NonNegative = 1.0
    """Measurement noise per that of ``estimator.measured`` [1]."""
    delay: NonNegative | None = None
    """Age of measurements when they arrive [s]; None: ``estimator.delay``."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Of the noise."""
