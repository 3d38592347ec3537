"""The result of the search for a grasp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arguments import check_arguments
from continuum_grasp.errors import InputError
from continuum_grasp.grasp.certificate.certificate import Certificate
from continuum_grasp.grasp.stored import DIMENSIONS, STORED
from continuum_grasp.model.family import family_class
from continuum_grasp.results.declared import Dimension, File, Picture, Stored, maker_of
from continuum_grasp.results.result import Result
from continuum_grasp.scene.families import default_family
from continuum_grasp.scene.grasp import GraspScene

if TYPE_CHECKING:
    from continuum_grasp.grasp.quality.quality import Quality
    from continuum_grasp.grasp.robust.result import Robustness
    from continuum_grasp.grasp.sensitivity import Sensitivity

Array = NDArray[Any]


class Status(StrEnum):
    """How the search ended."""

    OPTIMAL = "optimal"
    """A local optimum that the certificate confirms."""
    FEASIBLE = "feasible"
    """A grasp that the certificate confirms, but the solver stopped early, or the search before its last start."""
    INFEASIBLE = "infeasible"
    """There is no grasp near any start, and relaxing a named limit gives one: see ``reasons``."""
    NOT_SOLVED = "not_solved"
    """Neither a grasp nor a proof that there is none."""
    TIMED_OUT = "timed_out"
    """The clock stopped the search before there was a verdict: an emergency, which another machine may not meet."""


@dataclass(frozen=True)
class FingerPosture:
    """One finger of a grasp.

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
        Of the tendon on the finger's left (-X side), which bends it positively, and of that on its right [N].
    base : ndarray, shape (3,)
        World x, y [m] and angle [rad].
    backbone : ndarray, shape (K, 4)
        Position along it [m], world x, y [m], angle of the section's X axis [rad].
    """

    name: str
    family: str
    q: Array
    lengths: Array
    tip_curvature: float
    tensions: Array
    base: Array
    backbone: Array = field(repr=False)


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
        f along the normal turned by +90 degrees, on what touches the object [N].
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
    """Why there is no grasp: one limit, and what it would have to be.

    Attributes
    ----------
    name : str
    key : str
        The YAML key to change.
    unit : str
    limit, needed : float
        The limit as given, and as it would have to be.
    text : str
        The same as a sentence.
    repair : str
        What to do about it.
    confirmed : float, optional
        What it would have to be at the posture found, by linear programming; None where that gives no answer.
    """

    name: str
    key: str
    unit: str
    limit: float
    needed: float
    text: str
    repair: str
    confirmed: float | None = None


@dataclass(frozen=True)
class Change:
    """What other elements change about a grasp."""

    elements: dict[str, int]  # of each finger in the model compared with
    tension: float  # sum of tensions there [N]
    tension_change: float  # as a part of the sum here
    displacement: float  # greatest one of a contact point [m]
    length: float  # of the shortest finger [m]

    @property
    def size(self) -> float:
        """The greater of the change of tension and the displacement per length [1]."""
        return max(abs(self.tension_change), self.displacement / self.length)

    def __str__(self) -> str:
        count = max(self.elements.values())
        return (
            f"with {count} elements the tension changes by {self.tension_change:+.2%} to {self.tension:.4g} N, "
            f"contacts by {1e3 * self.displacement:.2g} mm at most"
        )


@dataclass(frozen=True)
class GraspResult(Result):
    """A grasp, or why there is none.

    Attributes
    ----------
    scene : GraspScene
        What was asked.
    status : Status
    message : str
        One sentence on how it ended.
    arrays : dict of str to ndarray
        The stored arrays by name, ``{finger}`` is the name of each finger; `fingers`, `contacts` and `object_pose`
        give them by object. Where there is no grasp: the point that comes closest, or empty.
    certificate : Certificate, optional
        Independent verification of these numbers.
    violated : tuple of str
        Broken constraints by name with their amounts, where there is no grasp.
    reasons : tuple of Reason
        Why there is none, each with the number that would repair it.
    advice : str
        What to try.
    statistics : dict
        Times, iterations, starts.
    sensitivity : tuple of Sensitivity
        How the answer changes with friction, mass and pose; empty where the solver stopped early.
    fine : Change, optional
        What a fine model changes, where that was asked for.
    robustness : Robustness, optional
        How the grasp fares with errors of the object, where the scene has ``robust``.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> grasp = cg.optimize_grasp("configs/grasp/mug_arcs.yaml")
    >>> [contact.name for contact in grasp.contacts]
    ['finger.middle', 'finger.tip', 'palm']
    >>> finger = grasp.fingers["finger"]
    >>> [round(tension, 1) for tension in finger.tensions.tolist()], finger.backbone.shape
    ([41.3, 1.0], (201, 4))
    """

    kind: ClassVar[str] = "grasp"
    stored: ClassVar[tuple[Stored, ...]] = STORED
    dimensions: ClassVar[tuple[Dimension, ...]] = DIMENSIONS
    texts: ClassVar[tuple[File, ...]] = (File("result.yaml", "grasp.report.text:result_yaml"),)
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("grasp", "grasp.report.page:picture"),
        Picture("robustness", "plotting.grasp.robustness:plot_robustness", needs="robustness", panels=True),
    )
    pages: ClassVar[tuple[File, ...]] = (File("report.html", "grasp.report.page:page"),)

    scene: GraspScene
    status: Status
    message: str
    arrays: Mapping[str, Array] = field(default_factory=dict)
    certificate: Certificate | None = None
    violated: tuple[str, ...] = ()
    reasons: tuple[Reason, ...] = ()
    advice: str = ""
    statistics: Mapping[str, Any] = field(default_factory=dict)
    sensitivity: tuple[Sensitivity, ...] = ()
    fine: Change | None = None
    robustness: Robustness | None = None

    @cached_property
    def quality(self) -> Quality:
        """Indices of quality; each is computed when it is first read.

        Raises
        ------
        InputError
            There is no verified grasp.
        """
        from continuum_grasp.grasp.quality.quality import Quality

        if not self.solved:
            raise InputError(f"there is no grasp whose quality could be computed (status {self.status.value})")
        return Quality(self.scene, self.arrays)

    @property
    def solved(self) -> bool:
        """Whether there is a verified grasp."""
        return self.status in (Status.OPTIMAL, Status.FEASIBLE)

    def words(self) -> dict[str, list[str]]:
        """Names of the fingers, and of the trials with errors where there are some."""
        trials = [] if self.robustness is None or self.robustness.robust is None else ["robust"]
        return {"finger": list(self.scene.named_fingers), "trials": trials}

    @property
    def contact_names(self) -> list[str]:
        """Names of the contacts."""
        return [str(name) for name in self.arrays.get("contact_names", ())]

    def pairs(self) -> dict[str, str]:
        """Tensions, contact forces and margins; where there is no grasp, why."""
        if not self.solved:
            reasons = {f"reason {k + 1}": reason.text for k, reason in enumerate(self.reasons[:4])}
            return {**(reasons or {"message": self.message}), **({"advice": self.advice} if self.advice else {})}
        rows = {"sum of tensions": f"{self.tension:.2f} N"}
        if self.contacts:
            forces = ", ".join(f"{c.name} {c.normal_force:.2f} N" for c in self.contacts)
            margin = max(min(c.friction_margin for c in self.contacts), 0.0)
            rows |= {"normal forces": forces, "least friction margin": f"{margin:.1%}"}
        if self.certificate is not None:
            checks, failed = len(self.certificate.checks), len(self.certificate.failed)
            stable = "stable" if self.certificate.stability.stable else "unstable"
            rows["certificate"] = f"{checks - failed} of {checks} checks passed, {stable}"
        return rows

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before this grasp is relied on."""
        if not self.solved or self.certificate is None:
            return ()
        found, error = [], self.certificate.model_error
        if not error.small:
            fine = default_family(free_tip=False)
            coarse = any(family_class(f.family).order < family_class(fine).order for f in self.fingers.values())
            other = f" or take fidelity.family: {fine}" if coarse else ""
            found.append(f"{error}: raise fidelity.elements{other}")
        if not self.certificate.stability.stable:
            found.append("the grasp is unstable: small motions that the contacts allow lower the energy")
        if self.robustness is not None:
            found += self.robustness.warnings()
        if "NOT satisfied" in str(self.statistics.get("fidelity", "")):
            found.append(str(self.statistics["fidelity"]))
        for key, how in (("cut_short", "cut short"), ("interrupted", "interrupted")):
            if self.statistics.get(key):
                found.append(f"the search was {how}: another start may hold the object with less tension")
        return tuple(found)

    @property
    def fingers(self) -> dict[str, FingerPosture]:
        """The fingers by name; empty where there are no numbers."""

        def posture(name: str) -> FingerPosture:
            keys = ("family", "q", "lengths", "tip_curvature", "tensions", "base", "backbone")
            family, q, lengths, tip_curvature, *rest = (self.arrays[f"{name}.{key}"] for key in keys)
            return FingerPosture(name, str(family), q, lengths, float(tip_curvature), *rest)

        return {name: posture(name) for name in (self.scene.named_fingers if self.arrays else ())}

    @property
    def object_pose(self) -> Array:
        """World x, y [m] and angle [rad] of the object (3,)."""
        return self.arrays["object.pose"]

    @property
    def tension(self) -> float:
        """Sum of all tensions [N]."""
        return float(sum(finger.tensions.sum() for finger in self.fingers.values()))

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts with their forces."""
        if "contact_names" not in self.arrays:
            return ()
        keys, found = ("names", "positions", "normals", "forces", "stations", "parts"), []
        columns = [self.arrays[f"contact_{key}"] for key in keys]
        for name, position, normal, forces, station, part in zip(*columns, strict=True):
            n, f, lift = (float(force) for force in forces)
            most = self.scene.friction(str(name)) * n
            margin = 1.0 - float(np.hypot(f, lift)) / most if most > 0 else 0.0
            found.append(Contact(str(name), position, normal, n, f, lift, margin, float(station), int(part)))
        return tuple(found)

    @check_arguments
    def contact(self, name: str) -> Contact:
        """The contact of a name.

        Raises
        ------
        InputError
            There is no such contact.
        """
        for contact in self.contacts:
            if contact.name == name:
                return contact
        raise InputError(f"no such contact: expected one of {[c.name for c in self.contacts]}, got {name!r}")

    def table(self) -> str:
        """The result as text: forces, verification, reasons."""
        text: str = maker_of("grasp.report.text:result_text")(self)
        return text

    def stored_arrays(self) -> dict[str, Array]:
        """The numbers: which there are depends on the fingers."""
        found = dict(self.arrays)
        if self.robustness is not None:
            found |= self.robustness.arrays()
        return found

    def details(self, *, quality: bool = True) -> dict[str, Any]:
        """Verification, indices of quality, and why there is no grasp."""
        return {
            "seed": self.scene.solver.random_seed,
            "message": self.message,
            "certificate": None if self.certificate is None else self.certificate.data(),
            "quality": self.quality.data() if quality and self.solved else None,
            "violated": list(self.violated),
            "reasons": [asdict(reason) for reason in self.reasons],
            "advice": self.advice,
            "robustness": None if self.robustness is None else self.robustness.data(),
        }

    @check_arguments
    def save(self, folder: str | PathLike[str], *, quality: bool = True) -> Path:
        """Write ``result.npz``, ``meta.json`` and ``result.yaml`` into a run folder, as `Result.save` does.

        Parameters
        ----------
        folder : path-like
            Made where missing; a run in it is replaced.
        quality : bool, optional
            Save the indices of quality too, which take some tenths of a second.
        """
        return self._save(folder, quality=quality)
