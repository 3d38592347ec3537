"""Dissipation in the bending of a finger: damping by the rate, and dry friction, which holds at rest."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Duration, NonNegative, Positive, Value


class DryFriction(Value):
    """One branch of dry friction in bending: a spring in series with a slider.

    It resists bending like a spring until its moment is reached, then slides at that moment, whatever the rate. Several
    branches are the law of W. D. Iwan (1966, doi:10.1115/1.3625199).
    """

    stiffness: Annotated[Positive, Unit("N m2"), Field(examples=[0.2])]
    """Bending stiffness that it adds while it sticks [N m2]."""
    moment: Annotated[Positive, Unit("N m"), Field(examples=[0.4])]
    """Bending moment at which it slides [N m]."""


class Relaxation(Value):
    """One branch of a material that creeps and relaxes: a spring in series with a dashpot, beside the elastic rod.

    ``bending_stiffness`` is that of slow loads. Several branches are a Prony series.
    """

    share: Annotated[float, Field(gt=0.0, le=100.0, examples=[0.2]), Unit("1")]
    """Stiffness that it adds under sudden loads, per that of slow ones [1]."""
    time: Annotated[Duration, Field(ge=1e-3, examples=[3.0, "3 s"])]
    """Time in which its moment relaxes to 37 % while the bend is held [s]."""


class Damping(Value):
    """Internal damping; all kinds may be given and add up.

    Of a graded rod the values are those at the base, and along it in the ratio of its bending stiffness.

    Examples
    --------
    >>> from continuum_grasp.scene import Damping
    >>> damping = Damping.model_validate({"material": 0.005, "dry_friction": [{"stiffness": 0.2, "moment": 0.4}]})
    >>> damping.dry_friction[0].moment
    0.4
    """

    material: Annotated[NonNegative, Unit("N m2 s")] = 0.0
    """Material (Kelvin-Voigt) damping eta [N m2 s]: bending moment per curvature rate. Does not depend on the mesh."""
    per_arc: Annotated[NonNegative, Unit("N m s")] = 0.0
    """The paper's c_frc [N m s] of equation (39): moment per rate of each element's bending angle."""
    quadratic: Annotated[NonNegative, Unit("N m3 s2")] = 0.0
    """Damping that grows with the speed [N m3 s2]: bending moment per squared curvature rate, as air drag has it in a
    vibration of one shape; unlike dry friction it makes the finger no softer where it swings far."""
    dry_friction: Annotated[tuple[DryFriction, ...], Field(strict=False, max_length=8)] = ()
    """Branches of dry friction, in which the finger remembers how it was bent: it rests anywhere between two shapes,
    is stiffer where it moves little, and small swings die out."""
    relaxation: Annotated[tuple[Relaxation, ...], Field(strict=False, max_length=3)] = ()
    """Branches in which the material relaxes: it creeps under a load that is held, and comes back slowly."""
    friction_cells: Annotated[int, Field(ge=1, le=16)] = 2
    """Cells per element on which dry friction (a state of each branch) and quadratic damping see the mean curvature;
    elements of constant curvature need only one."""
