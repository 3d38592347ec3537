"""Names that the results of planar grasps and of hands share."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from continuum_grasp.base import Array
from continuum_grasp.grasp.values import FingerPosture, GraspStatus, postures_of
from continuum_grasp.results import Result

if TYPE_CHECKING:
    from continuum_grasp.grasp.values import Reason


class AnyGrasp(Result):
    """A grasp in the plane or of a hand in space, or the reason why none exists.

    Code for both kinds reads these names, and ``scene``, ``message``, ``certificate`` and ``advice``.
    """

    status: GraspStatus
    arrays: Mapping[str, Array]
    reasons: tuple[Reason, ...]

    @property
    def solved(self) -> bool:
        """Whether a verified grasp holds the object."""
        return self.status in (GraspStatus.OPTIMAL, GraspStatus.FEASIBLE)

    @property
    def balanced(self) -> bool:
        """Whether the numbers are a grasp of this scene, at least in balance, and not a repair or a nearest point."""
        raise NotImplementedError

    @property
    def contact_names(self) -> list[str]:
        """Names of the contacts."""
        return [str(name) for name in self.arrays.get("contact_names", ())]

    @property
    def contacts(self) -> Sequence[Any]:
        """Contacts of the object with their ``name``, ``normal_force`` [N] and ``friction_margin`` [1]."""
        raise NotImplementedError

    @property
    def finger_names(self) -> Iterable[str]:
        """Names of the fingers."""
        return [setup.name for setup in self.scene.setups]

    @property
    def fingers(self) -> dict[str, FingerPosture]:
        """Fingers by name; empty without numbers."""
        return postures_of(self.finger_names if self.arrays else (), self.arrays)

    @property
    def tensions(self) -> dict[str, Array]:
        """Tendon tensions (2,) of each finger [N]; empty without numbers."""
        return {name: self.arrays[f"{name}.tensions"] for name in (self.finger_names if self.arrays else ())}

    @property
    def tension(self) -> float:
        """Sum of all tensions [N]; NaN if no grasp holds, so that no attempt passes for a grasp."""
        return self.total_tension if self.balanced else math.nan

    @property
    def total_tension(self) -> float:
        """Sum of all tensions in the numbers [N], also of an attempt or a repair; NaN without numbers."""
        return float(sum(pair.sum() for pair in self.tensions.values())) if self.arrays else math.nan

    @property
    def greatest_normal_force(self) -> float:
        """Greatest normal force of all contacts [N]."""
        return max((contact.normal_force for contact in self.contacts), default=0.0)

    @property
    def friction_margin(self) -> float:
        """Least friction margin of the pressing contacts [1]; NaN if no grasp holds."""
        margins = [contact.friction_margin for contact in self.contacts if contact.normal_force > 0.0]
        return min(margins, default=math.nan) if self.balanced else math.nan
