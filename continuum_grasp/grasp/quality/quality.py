"""All measures of the quality of a grasp in one place; costly ones are computed when first read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.quality.contact_set import ContactSet, WrenchSpace, wrench_space
from continuum_grasp.grasp.quality.mag_like import MagLike, mag_like
from continuum_grasp.grasp.quality.response import GraspResponse, Tendons
from continuum_grasp.grasp.quality.response_limits import ResponseLimits
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]

DISPLACEMENT_LIMIT = 0.1
"""Greatest motion of the object: as a part of its size, and in rad; finger tips may turn three times as much."""


@dataclass(frozen=True)
class Quality:
    """Indices of a grasp; definitions and sources are in ``docs/grasp_quality.md``.

    Attributes
    ----------
    scene : GraspScene
    arrays : mapping
        Of the grasp.
    """

    scene: GraspScene = field(repr=False)
    arrays: Mapping[str, Any] = field(repr=False)

    @property
    def torque_scale(self) -> float:
        """Length that turns a moment into the force that counts as much [m]."""
        return float(self.scene.torque_scale)

    @cached_property
    def wrench_space(self) -> WrenchSpace:
        """Wrenches of all contacts, supports included."""
        return wrench_space(self.scene, self.arrays)

    @property
    def epsilon_l1(self) -> float:
        """Ferrari-Canny quality with normal forces that add up to one; negative: no force closure [1]."""
        return self.wrench_space.epsilon_l1

    @property
    def epsilon_linf(self) -> float:
        """Ferrari-Canny quality with normal forces of up to one each; 0: no force closure [1]."""
        return self.wrench_space.epsilon_linf

    @property
    def min_weight(self) -> float:
        """Min-weight metric; 0: no force closure [1]."""
        return self.wrench_space.min_weight

    @cached_property
    def response(self) -> GraspResponse:
        """The elastic response to a small wrench."""
        return GraspResponse(self.scene, self.arrays)

    @cached_property
    def resistance(self) -> Resistance:
        """Greatest multiples of the scene's disturbances that fingers and tendons resist."""
        return resistance(self.scene, self.arrays, response=self.response)

    @cached_property
    def resistance_polygon(self) -> Array:
        """Greatest pure forces at the center of mass, in 36 directions, shape (36, 2) [N]."""
        return resistance_polygon(self.scene, self.arrays, response=self.response)

    @cached_property
    def friction_margins(self) -> dict[str, float]:
        """1 - |friction force| / (coefficient * normal force) by contact; contacts without friction are not listed."""
        contacts = ContactSet.of(self.scene, self.arrays)
        margins = {}
        for name, (normal, friction, lift), mu in zip(contacts.names, contacts.forces, contacts.friction, strict=True):
            if mu > 0.0:
                margins[name] = float(1.0 - np.hypot(friction, lift) / (mu * normal)) if normal > 0.0 else 0.0
        return margins

    @property
    def friction_margin(self) -> float:
        """Least of the friction margins; 0: a contact is about to slip [1]."""
        return min(self.friction_margins.values(), default=0.0)

    @cached_property
    def tension_margin(self) -> float:
        """Least of 1 - tension / greatest tension over the tendons [1]."""
        return min(
            1.0 - float(np.max(self.arrays[f"{setup.name}.tensions"])) / setup.tendons.max_tension
            for setup in self.scene.setups
        )

    @cached_property
    def normal_force_spread(self) -> float:
        """(greatest - least) / greatest normal force; 0: all contacts press alike [1]."""
        normal = ContactSet.of(self.scene, self.arrays).forces[:, 0]
        most = float(normal.max(initial=0.0))
        return 0.0 if most <= 0.0 else float(1.0 - normal.min() / most)

    @cached_property
    def mag_like(self) -> MagLike:
        """Multi-aspect index, of this toolkit's own definition, for carrying the object without turning it."""
        return mag_like(self.scene, self.arrays)

    def rows(self) -> tuple[tuple[str, float, str, str], ...]:
        """Name, value, unit and description of every index, for tables."""
        held = self.resistance
        tendons = "tensions chosen anew" if held.tendons == "retensioned" else "tendons locked"
        per = f"moments per {self.torque_scale:.3g} m"
        return (
            ("disturbance_margin", held.least, "1", f"least multiple of the disturbances that is resisted; {tendons}"),
            ("friction_margin", self.friction_margin, "1", "share of the friction cone that is left, worst contact"),
            ("tension_margin", self.tension_margin, "1", "share of the greatest tension that is left, worst tendon"),
            ("normal_force_spread", self.normal_force_spread, "1", "(greatest - least) / greatest normal force"),
            ("epsilon_l1", self.epsilon_l1, "1", f"Ferrari-Canny, normal forces add up to one; {per}; < 0: no closure"),
            ("epsilon_linf", self.epsilon_linf, "1", f"Ferrari-Canny, normal forces up to one each; {per}"),
            (
                "min_weight",
                self.min_weight,
                "1",
                "least weight of a cone edge in the best balance of all; 0: no closure",
            ),
            (
                "mag_like",
                self.mag_like.value,
                "1",
                "multi-aspect index, own definition; object, configuration, kinetics",
            ),
        )

    def data(self) -> dict[str, Any]:
        """Everything as plain numbers, strings, lists and mappings; factors without a limit are infinite."""
        held, mag = self.resistance, self.mag_like
        return {
            **{name: value for name, value, _, _ in self.rows()},
            "torque_scale": self.torque_scale,
            "friction_margins": self.friction_margins,
            "resistance": {
                "tendons": held.tendons,
                "stable": held.stable,
                "wrenches": held.wrenches.tolist(),
                "factors": held.factors.tolist(),
                "limiting": [list(words) for words in held.limiting],
            },
            "mag_like_aspects": {
                "object": mag.object_aspect,
                "configuration": mag.configuration_aspect,
                "kinetic": mag.kinetic_aspect,
            },
        }


def grasp_quality(scene: GraspScene, arrays: Mapping[str, Any]) -> Quality:
    """Indices of a grasp from its stored numbers.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        Of the grasp, as a run folder stores them.
    """
    return Quality(scene, arrays)


@dataclass(frozen=True)
class Resistance:
    """Answer of `resistance`.

    Attributes
    ----------
    wrenches : ndarray, shape (K, 3)
        Disturbances: force x, y [N] and moment about the center of mass [N m].
    factors : ndarray, shape (K,)
        Greatest multiple of each that the grasp resists [1]; infinite where nothing limits it, zero where the grasp is
        unstable or beyond a limit by itself.
    limiting : tuple of tuple of str
        What stops each from growing.
    motions : ndarray, shape (K, 3)
        How far the object moves at this factor: center of mass [m], angle [rad]; NaN where not limited.
    tendons : {"retensioned", "locked"}
        Whether tensions are chosen anew for each disturbance, or tendon lengths are fixed.
    stable : bool
        Whether the grasp is stable with its tendons so.
    """

    wrenches: Array
    factors: Array
    limiting: tuple[tuple[str, ...], ...]
    motions: Array
    tendons: Tendons
    stable: bool

    @property
    def least(self) -> float:
        """Least of the factors; infinite without disturbances."""
        return float(self.factors.min(initial=math.inf))


def resistance(
    scene: GraspScene,
    arrays: Mapping[str, Any],
    *,
    wrenches: Sequence[Sequence[float]] | None = None,
    tendons: Tendons | None = None,
    displacement_limit: float | None = DISPLACEMENT_LIMIT,
    response: GraspResponse | None = None,
) -> Resistance:
    """Greatest multiples of disturbances that a grasp resists, one disturbance at a time: until a contact slips, parts
    or is pressed too hard, a tendon is at its limit, or the grasp yields too much.

    The fingers move as `continuum_grasp.grasp.quality.response` computes: to first order, contacts sticking until the
    first one does not. It does not hold far from the stored grasp of soft fingers, so motions are limited too. Forces
    out of the plane stay as they are.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        Of the grasp.
    wrenches : sequence of (float, float, float), optional
        Force x, y [N] and moment about the center of mass [N m]; those of the scene where not given.
    tendons : {"retensioned", "locked"}, optional
        Those of the scene by default.
    displacement_limit : float or None, optional
        Greatest motion of the object, as a part of its size and in rad; finger tips may turn three times as much. None:
        no limit, which takes the first order at its word.
    response : GraspResponse, optional
        Of the same grasp, where it is at hand.
    """
    kind: Tendons = tendons or scene.disturbances.tendons
    given = np.asarray(scene.wrenches if wrenches is None else wrenches, dtype=float).reshape(-1, 3)
    response = response or GraspResponse(scene, arrays)
    count = len(given)
    if not response.stable(kind):
        return Resistance(given, np.zeros(count), (("unstable",),) * count, np.zeros((count, 3)), kind, False)
    limits = ResponseLimits(response, kind, math.inf if displacement_limit is None else displacement_limit)
    answers = [limits.greatest(wrench) for wrench in given]
    return Resistance(
        given,
        np.array([answer[0] for answer in answers]),
        tuple(answer[1] for answer in answers),
        np.array([answer[2] for answer in answers]).reshape(count, 3),
        kind,
        True,
    )


def resistance_polygon(
    scene: GraspScene,
    arrays: Mapping[str, Any],
    directions: int = 36,
    *,
    tendons: Tendons | None = None,
    displacement_limit: float | None = DISPLACEMENT_LIMIT,
    response: GraspResponse | None = None,
) -> Array:
    """Greatest pure forces at the center of mass that a grasp resists, in directions all round, shape (D, 2) [N].

    Parameters
    ----------
    scene, arrays, tendons, displacement_limit, response
        As in `resistance`.
    directions : int, optional
        Number D of directions, evenly spread from +x counter-clockwise.
    """
    turns = 2.0 * np.pi * np.arange(directions) / directions
    units = np.stack([np.cos(turns), np.sin(turns), np.zeros(directions)], axis=1)
    found = resistance(
        scene,
        arrays,
        wrenches=units.tolist(),
        tendons=tendons,
        displacement_limit=displacement_limit,
        response=response,
    )
    return np.asarray(found.factors[:, None] * units[:, :2])
