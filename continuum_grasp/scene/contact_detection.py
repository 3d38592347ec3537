"""Detection of contact by drives alone: what is uncertain about the finger that touches nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Length, Mass, TimeConstant, Value

if TYPE_CHECKING:
    from continuum_grasp.scene.controller import Measured
    from continuum_grasp.scene.finger import Finger

Share = Annotated[float, Field(ge=0.0, le=0.9), Unit("1")]


class ContactDetection(Value):
    """A momentum observer with a threshold that follows from what is uncertain: greatest errors, not deviations.

    A finger that touches nothing raises no alarm while all errors are within these.
    """

    bending_stiffness: Share = 0.2
    """Greatest relative error of the bending stiffness [1]."""
    tendon_friction: Share = 0.5
    """Greatest relative error of the tendons' friction coefficient [1]."""
    coulomb_friction: Share = 0.3
    """Greatest relative error of the motors' dry friction [1]; at rest its direction is not known either."""
    payload: Mass = 0.0
    """Greatest unknown mass at the tip [kg]."""
    tension: Share = 0.05
    """Greatest relative error of a tension by all else: the model of the tendons, cables, arms [1]."""
    history_known: bool = True
    """Whether the finger came to where it starts as ``initial`` states, for tendons with friction. False: the threshold
    contains the whole loop until motions have passed through it."""
    time_constant: TimeConstant = 0.02
    """Time constant of the residual's low-pass filter [s]."""
    places: Annotated[tuple[Length, ...], Field(strict=False)] = ()
    """Positions along the finger where a contact may be [m], for which forces are reported; none: the middle and the
    tip."""

    def check(self, finger: Finger, measured: Measured, delay: float, key: str) -> None:
        """Refuse a finger or sensors that show no contact."""
        if not finger.winches:
            raise ValueError(f"{key} needs tendons with drive.kind: length or motor, whose tension a contact changes")
        if any(getattr(drive, "backlash", 0.0) > 0.0 for drive in finger.winches):
            raise ValueError(f"{key}: not through a gear with backlash, whose drum is not measured; leave it out")
        kind = finger.winches[0].kind
        position = "length" if kind == "length" else "angle"
        if getattr(measured, position) is None:
            raise ValueError(f"{key} needs estimator.measured.{position}")
        if kind == "length" and measured.tension is None:
            raise ValueError(f"{key} needs estimator.measured.tension with drive.kind: length")
        if kind == "motor" and delay > 0.0 and measured.torque is None and measured.current is None:
            raise ValueError(
                f"{key} needs estimator.measured.torque or current with estimator.delay: a commanded torque is not as "
                "old as the angle"
            )
        if self.tendon_friction > 0.0 and len({tendon.friction for tendon in finger.tendon_list}) > 1:
            raise ValueError(f"{key}.tendon_friction must be zero where tendons have different coefficients")
        for k, at in enumerate(self.places):
            if at > finger.rod.length * (1 + 1e-9):
                raise ValueError(f"{key}.places[{k}] = {at} m is beyond the finger")
