"""Parts of the answer to a scene: status and its words, fingers, contacts, reasons, and notation of its forces."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum
from typing import Any

import numpy as np

from continuum_grasp.base import Array, amount_text, prefixed, prefixes
from continuum_grasp.scene import GraspScene

NEAR, SAME = 1e-3, 1e-4
"""Relative differences of results: below the first a grasp is no better than another, since 0.1 % of tension is
below the model's error, less tension per force is slack, less force per weight presses nothing, less than 0.1 % of
a usual amount relaxes nothing, and a body as near to the object, per length of the finger, may touch; below the
second two points are the same, and the difference is rounding and guarded places."""
LITTLE = 1e-5
"""Small part of the aim: the weight of the tensions where they are no aim; and less than a change by
new guarded places, with which it is solved once more."""
SATISFIED = 1e-7
"""Scaled violation below which a constraint counts as satisfied: a hundred times the tolerances of the solvers."""
OPENED = ". Unstable: a small push opens this grasp. (`stability: ignore` accepts it.)"
CLOSE = 0.03
"""Change of a normal force, per greatest one, up to which elements stand for a rod [1]: less than the error with which
friction and stiffness are known."""
PUSH_SHARE = 0.1
"""Share of the greatest push that a grasp must bear if the scene has neither loads on the object nor a push [1]:
contacts press with a tenth of their possible force, a hundred times the error of models, at tensions far from their
limits."""
STEADIER = (
    "For a stable grasp, move contacts nearer to the base, add a contact or support, or use a stiffer finger. "
    "Set stability: ignore where the drives hold their position or something else steadies the object."
)


def unloaded_words(greatest: float) -> str:
    """Say why a grasp bears a push that the scene does not state, by the greatest push [N]."""
    most = amount_text(greatest, "N", ".3g")
    share = f"{PUSH_SHARE:.0%} of the greatest push found, {most}"
    return f"nothing loads the object, so a grasp has to bear {share} (contacts.push)"


class GraspStatus(StrEnum):
    """Outcome of the search."""

    OPTIMAL = "optimal"
    """A local optimum that the certificate confirms: starts from different postures lead to it, and none to a better
    one."""
    FEASIBLE = "feasible"
    """A grasp that the certificate confirms; the message says what is missing for ``optimal``, such as a second start
    that leads to it."""
    UNSTABLE = "unstable"
    """All checks of the certificate pass, but small motions that the contacts allow lower the energy, where the scene
    requires a stable grasp: the fingers do not hold the object."""
    INFEASIBLE = "infeasible"
    """No forces at any place of the object balance its weight; ``reasons`` name changes that allow a grasp."""
    NOT_SOLVED = "not_solved"
    """Neither a grasp nor a proof that none exists; ``reasons`` name changes that allow one, where some are found."""
    STOPPED = "stopped"
    """The clock stopped the search before there was a verdict: an emergency, which another machine may not meet."""

    @property
    def word(self) -> str:
        """The status as people read it: an unstable grasp stands out, since all of its checks pass."""
        return self.value.upper() if self is GraspStatus.UNSTABLE else self.value.replace("_", " ")


@dataclass(frozen=True)
class FingerPosture:
    """A finger of a grasp.

    Attributes
    ----------
    name : str
    family : str
        ``arc``, ``clothoid`` or ``matched_clothoid``.
    q : ndarray, shape (n,)
        Bending coordinates above rest: bends of the elements [rad] (arc) or nodal curvatures [1/m].
    lengths : ndarray, shape (N,)
        Element lengths [m].
    tip_curvature : float
        Above the rest curvature [1/m].
    tensions : ndarray, shape (2,)
        Tensions of the tendon on the finger's left (-X side), which bends it positively, and on its right [N].
    base : ndarray, shape (3,)
        World x, y [m] and angle [rad]; of a hand's finger, in its own plane.
    backbone : ndarray, shape (K, 4)
        Position along it [m], world x, y [m], angle of the section's X axis [rad]; of a hand's finger, in its own
        plane.
    """

    name: str
    family: str
    q: Array
    lengths: Array
    tip_curvature: float
    tensions: Array
    base: Array
    backbone: Array = field(repr=False)


def postures_of(names: Iterable[str], arrays: Mapping[str, Array]) -> dict[str, FingerPosture]:
    """Fingers by name from the stored arrays of a grasp."""

    def posture(name: str) -> FingerPosture:
        keys = ("family", "q", "lengths", "tip_curvature", "tensions", "base", "backbone")
        family, q, lengths, tip_curvature, *rest = (arrays[f"{name}.{key}"] for key in keys)
        return FingerPosture(name, str(family), q, lengths, float(tip_curvature), *rest)

    return {name: posture(name) for name in names}


@dataclass(frozen=True)
class Contact:
    """A contact of the object.

    Attributes
    ----------
    name : str
        ``<finger>.middle`` (``<finger>.middle_1`` and so on where there are several), ``<finger>.tip``, or the name of
        a support (``<support>.1`` and ``<support>.2`` where a flat face lies on it).
    position : ndarray, shape (2,)
        On the object's surface, world [m].
    normal : ndarray, shape (2,)
        Outward normal of the object, world.
    normal_force : float
        N >= 0 [N].
    friction_force : float
        f along the normal turned by +90 degrees, on the body that touches the object [N].
    lift : float
        Friction force out of the plane, on the object [N].
    friction_margin : float
        1 - sqrt(f^2 + lift^2) / (friction coefficient * N).
    station : float
        Position along the finger [m]; NaN for supports.
    part : int
        Index of the object's convex part.
    """

    name: str
    position: Array
    normal: Array
    normal_force: float
    friction_force: float
    lift: float
    friction_margin: float
    station: float
    part: int

    @property
    def force(self) -> Array:
        """Force on what touches the object, in the plane, world (2,) [N]; the object bears the opposite."""
        across = np.array([-self.normal[1], self.normal[0]])
        return self.normal_force * self.normal + self.friction_force * across


@dataclass(frozen=True)
class Reason:
    """Why there is no grasp: one limit, or several at once, and the values that would allow one.

    Attributes
    ----------
    name : str
    key : str
        The YAML key to change.
    unit : str
    limit, needed : float
        The limit as given, and the value needed.
    text : str
        The same as a sentence.
    repair : str
        The remedy.
    also : tuple of Reason
        Other limits that must be changed with it; ``text`` and ``repair`` are then about all of them.
    stable : bool
        Whether the grasp that confirms it is stable, where the scene requires that; ``repair`` says so where it is not.
    arrays : dict of str to ndarray
        The grasp that confirms it, by the names of a result's arrays; empty where there are no numbers of one.
    """

    name: str
    key: str
    unit: str
    limit: float
    needed: float
    text: str
    repair: str
    also: tuple[Reason, ...] = ()
    stable: bool = True
    arrays: Mapping[str, Array] = field(default_factory=dict, repr=False, compare=False)

    @property
    def title(self) -> str:
        """Names of all limits that must be changed."""
        return " and ".join(reason.name for reason in (self, *self.also))

    @property
    def numbers(self) -> dict[str, Any]:
        """Name, key, limit and amount needed, also of those that go with it."""
        numbers = {"name": self.name, "key": self.key, "limit": self.limit, "needed": self.needed}
        return numbers | ({"also": [other.numbers for other in self.also]} if self.also else {})

    def data(self) -> dict[str, Any]:
        """The reason as plain data, without its grasp."""
        entries = {entry.name: getattr(self, entry.name) for entry in fields(self) if entry.name != "arrays"}
        return entries | {"also": [other.data() for other in self.also]}

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Reason:
        """Make a reason of plain data, as `data` gives them."""
        return cls(**{**data, "also": tuple(map(cls.of, data["also"]))})


@dataclass(frozen=True)
class OutlineError:
    """Error of the polygons that represent drawings or measured outlines of the object.

    Attributes
    ----------
    deviation : float
        Greatest distance of a polygon from its drawing, or from the true outline [m].
    size : float
        Greatest distance of the object's boundary from its center of mass [m].
    corners : int
        Of the polygons.
    noise : float
        Part of the deviation that the noise of measured points explains [m].
    """

    deviation: float
    size: float
    corners: int
    noise: float = 0.0

    def __str__(self) -> str:
        share = f"{self.deviation / self.size:.2%} of the object's size"
        off = f"{1e3 * self.deviation:.3g} mm"
        if self.noise:
            return f"the outline is within {off} of the true one ({share}), {1e3 * self.noise:.3g} mm of it by noise"
        return f"the polygon of {self.corners} corners is within {off} of the drawing ({share})"


@dataclass(frozen=True)
class ElementError:
    """Difference of a finger's elements from its rod.

    Attributes
    ----------
    elements : int
        Number of elements.
    normal_force : float
        Greatest change of a normal force, per greatest normal force of the grasp [1]; NaN if the elements have no
        equilibrium near the rod.
    displacement : float
        Greatest distance of the backbones, per length [1].
    """

    elements: int
    normal_force: float
    displacement: float

    @property
    def is_close(self) -> bool:
        """Whether the elements stand for the rod."""
        return self.normal_force <= CLOSE

    @property
    def words(self) -> str:
        """The difference in words."""
        if math.isnan(self.normal_force):
            return "no equilibrium near the rod"
        return f"normal forces change by {self.normal_force:.2g}, the shape by {self.displacement:.2g} of the length"


def error_warning(finger: str, error: ElementError) -> str:
    """Warn of elements that do not stand for the rod of a finger."""
    return (
        f"{error.elements} elements of {finger} do not stand for its rod ({error.words}): what is computed with them "
        "is off by as much; leave out fidelity.elements, or raise it"
    )


@dataclass(frozen=True)
class Sensitivity:
    """By how much the objective changes with one number of the scene, to first order."""

    name: str
    derivative: float
    """Derivative of the sum of tensions [N] where that is the objective, else of the objective as minimized, per
    ``unit``."""
    unit: str  # of the number that changes


def contacts_of(scene: GraspScene, arrays: Mapping[str, Array]) -> tuple[Contact, ...]:
    """The contacts of a grasp with their forces, by its stored numbers; none where there are no numbers."""
    if "contact_names" not in arrays:
        return ()
    keys = ("names", "positions", "normals", "forces", "stations", "parts")
    contacts = []
    columns = [arrays[f"contact_{key}"] for key in keys]
    for name, position, normal, forces, station, part in zip(*columns, strict=True):
        n, f, lift = (float(force) for force in forces)
        friction_limit = scene.friction(str(name)) * n
        margin = 1.0 - float(np.hypot(f, lift)) / friction_limit if friction_limit > 0 else 0.0
        contacts.append(Contact(str(name), position, normal, n, f, lift, margin, float(station), int(part)))
    return tuple(contacts)


def force_units(arrays: Mapping[str, Array]) -> tuple[str, str]:
    """Units in which tensions and contact forces of a grasp are written: N, mN or µN, each by the greatest of them."""
    total, of_contacts, presses = _greatest(arrays)
    of_tensions = prefixed("N", total or of_contacts)[1]
    return of_tensions, prefixed("N", of_contacts)[1] if presses else of_tensions


def force_text(arrays: Mapping[str, Array], force: float, unit: str = "N") -> str:
    """Write a force [N] of a grasp in a unit, N, mN or µN, with so many decimals that its greatest one has four digits.

    The greatest force is the sum of tensions or a component of a contact force; the greatest component has two
    digits at least; in newtons two to nine decimals. Contact forces in a smaller unit than the tensions have three
    digits.
    """
    (total, of_contacts, presses), units = _greatest(arrays), force_units(arrays)
    if units[0] != units[1] != "N":
        decimals = _decimals(total, 4) if unit == units[0] else _decimals(of_contacts, 3)
    else:
        decimals = max(2, _decimals(max(total, of_contacts), 4), _decimals(of_contacts, 2) if presses else 0)
    factor = prefixes("N")[unit]
    text = f"{factor * force:.{max(min(decimals, 9) - round(math.log10(factor)), 0)}f}"
    return text.removeprefix("-") if not text.strip("-0.") else text  # no -0.00


def _greatest(arrays: Mapping[str, Array]) -> tuple[float, float, bool]:
    """Sum of tensions and greatest component of the contact forces [N], and whether anything presses."""
    total = sum(float(np.sum(value)) for name, value in arrays.items() if name.endswith(".tensions"))
    of_contacts = float(np.abs(arrays.get("contact_forces", 0.0)).max(initial=0.0))
    # 1e-5: contact forces per tension below which they are what a solver leaves of zero
    return total, of_contacts, of_contacts > 1e-5 * total


def _decimals(value: float, digits: int) -> int:
    """Decimals with which a positive value has so many digits; none where it is not one."""
    return digits - 1 - math.floor(math.log10(value)) if math.isfinite(value) and value > 0.0 else 0
