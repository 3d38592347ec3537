"""All measures of the quality of a grasp in one place; costly ones are computed when first read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from continuum_grasp.base import Array, CheckedArgument
from continuum_grasp.grasp.quality.contact_set import ContactSet, cone_edges, epsilon_l1
from continuum_grasp.grasp.quality.resistance import Resistance
from continuum_grasp.grasp.quality.response import GraspResponse
from continuum_grasp.grasp.values import contacts_of
from continuum_grasp.scene import GraspScene


@dataclass(frozen=True)
class Quality:
    """Indices of a grasp from its ``arrays``, as a run folder stores them; definitions and sources are in
    ``docs/grasp_quality.md``.
    """

    scene: GraspScene = field(repr=False)
    arrays: Mapping[str, Any] = field(repr=False)

    def __post_init__(self) -> None:
        CheckedArgument("scene", self.scene).instance(GraspScene)
        CheckedArgument("arrays", self.arrays).instance(Mapping)

    @property
    def torque_scale(self) -> float:
        """Length that turns a moment into the force that counts as much [m]."""
        return float(self.scene.torque_scale)

    @cached_property
    def _contacts(self) -> ContactSet:
        return ContactSet(self.scene, self.arrays)

    @cached_property
    def response(self) -> GraspResponse:
        """The elastic response to a small wrench."""
        return GraspResponse(self.scene, self.arrays)

    @cached_property
    def epsilon_l1(self) -> float:
        """Ferrari-Canny quality with normal forces that add up to one; negative: no force closure [1]."""
        return epsilon_l1(cone_edges(self._contacts))

    @cached_property
    def resistance(self) -> Resistance:
        """Greatest multiples of the scene's disturbances that fingers and tendons resist."""
        return Resistance.of(self.response)

    @property
    def disturbance_margin(self) -> float:
        """Least of these multiples; infinite where nothing limits any [1]."""
        return self.resistance.least

    @cached_property
    def resistance_polygon(self) -> Array:
        """Greatest pure forces at the center of mass, in 36 directions from +x counter-clockwise, shape (36, 2) [N]."""
        turns = 2.0 * np.pi * np.arange(36) / 36
        units = np.stack([np.cos(turns), np.sin(turns), np.zeros(36)], axis=1)
        return np.asarray(Resistance.of(self.response, wrenches=units.tolist()).factors[:, None] * units[:, :2])

    @cached_property
    def friction_margins(self) -> dict[str, float]:
        """1 - |friction force| / (coefficient * normal force) by contact; contacts without friction are not listed."""
        contacts = contacts_of(self.scene, self.arrays)
        return {
            contact.name: contact.friction_margin for contact in contacts if self.scene.friction(contact.name) > 0.0
        }

    @property
    def friction_margin(self) -> float:
        """Least of the friction margins; 0: a contact is about to slip [1]."""
        return min(self.friction_margins.values(), default=0.0)

    @cached_property
    def tension_margin(self) -> float:
        """Least of 1 - tension / greatest tension over the tendons [1]."""
        return min(
            1.0 - float(np.max(self.arrays[f"{setup.name}.tensions"])) / setup.max_tension
            for setup in self.scene.setups
        )

    @cached_property
    def normal_force_spread(self) -> float:
        """(greatest - least) / greatest normal force; 0: all contacts press alike [1]."""
        normal = self._contacts.forces[:, 0]
        greatest = float(normal.max(initial=0.0))
        return 0.0 if greatest <= 0.0 else float(1.0 - normal.min() / greatest)

    def rows(self) -> tuple[tuple[str, float, str], ...]:
        """Name, value [1] and description of every index, for tables."""
        held = self.resistance
        per = f"moments per {self.torque_scale:.3g} m"
        tendons = "tensions chosen anew" if held.tendons == "retensioned" else "tendons locked"
        return (
            (
                "disturbance_margin",
                self.disturbance_margin,
                f"least multiple of the disturbances that the grasp resists; {tendons}",
            ),
            ("friction_margin", self.friction_margin, "unused share of the friction cone, worst contact"),
            ("tension_margin", self.tension_margin, "unused share of the greatest tension, worst tendon"),
            ("normal_force_spread", self.normal_force_spread, "(greatest - least) / greatest normal force"),
            ("epsilon_l1", self.epsilon_l1, f"Ferrari-Canny, normal forces add up to one; {per}; < 0: no closure"),
        )

    def data(self) -> dict[str, Any]:
        """Everything as plain numbers, strings, lists and mappings; factors without a limit are infinite."""
        held = self.resistance
        return {
            **{name: value for name, value, _ in self.rows()},
            "torque_scale": self.torque_scale,
            "friction_margins": self.friction_margins,
            "resistance": {
                "tendons": held.tendons,
                "stable": held.stable,
                "wrenches": held.wrenches.tolist(),
                "factors": held.factors.tolist(),
                "limiting": [list(words) for words in held.limiting],
            },
        }
