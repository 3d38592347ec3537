"""Measurements of a finger, and the estimator of its state and disturbances."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from continuum_grasp.scene.value import Length, Positive, Value

__all__ = ["BendingSensors", "Disturbed", "Estimator", "Measured"]


class BendingSensors(Value):
    """Angles of sections."""

    at: Annotated[tuple[Length, ...], Field(strict=False, min_length=1)]
    """Positions along the finger [m]."""
    std: Positive
    """Standard deviation of a measured angle [rad]."""


class Measured(Value):
    """Measured quantities, each with the standard deviation of its noise."""

    tip: Positive | None = None
    """Of each coordinate of the tip's world position, by a camera [m]."""
    tension: Positive | None = None
    """Of each tendon's tension, or of the tip moment of a finger without tendons [N or N m]; needs a lag, since without
    one it is the input itself."""
    bending: BendingSensors | None = None

    @model_validator(mode="after")
    def _something(self) -> Measured:
        if self.tip is None and self.bending is None:
            raise ValueError(
                "measure the tip, the bending, or both: the shape cannot be estimated from a tension alone"
            )
        return self


class Disturbed(Value):
    """Slowly varying unknowns estimated with the state, each with its drift per square root of a second."""

    tip_moment: Positive | None = None
    """Tip moment missing in the model, from wrong stiffness or friction [N m / s^0.5]."""
    tip_force: Positive | None = None
    """Unknown world force at the tip, each component [N / s^0.5]."""
    contact_force: Positive | None = None
    """Unknown world force at each place of ``contacts``, each component [N / s^0.5]."""
    object_position: Positive | None = None
    """Position of a fixed object, each coordinate [m / s^0.5]; observable only in contact."""
    bending_stiffness: Positive | None = None
    """Bending stiffness, relative [1 / s^0.5]; must be one of the scene's ``parameters``."""

    @property
    def names(self) -> frozenset[str]:
        """Those that are estimated."""
        return frozenset(name for name in type(self).model_fields if getattr(self, name) is not None)


class Estimator(Value):
    """An extended Kalman filter with disturbance states."""

    measured: Measured
    disturbances: Disturbed = Disturbed()
    acceleration_std: Positive = 10.0
    """Unmodeled acceleration of each bending angle [rad/s2 s^0.5]."""
    initial_std: Positive = 0.05
    """Standard deviation of each bending angle at the start [rad]; of their rates ten times that per second."""
    delay: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Known age of a measurement when it arrives, a whole number of control periods [s]."""
    outlier: Annotated[float, Field(ge=2.0, le=100.0)] = 8.0
    """A sensor further than this many standard deviations from its expected value is rejected, unless that happens too
    often: then the model is wrong, and the sensor is used with bounded influence."""
    frozen: bool = True
    """Whether a reading at rest for 0.2 s (20 samples at least) counts as missing while the command moves. False: for
    sensors whose resolution is coarser than their noise, which repeat a number while the finger rests."""
