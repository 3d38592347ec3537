"""The result of the search for a grasp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from continuum_grasp.base import Array, InputError, amount_text, check_arguments, named_value
from continuum_grasp.grasp.certificate.certificate import Certificate
from continuum_grasp.grasp.certificate.space import ASIDE
from continuum_grasp.grasp.grasp_result import AnyGrasp
from continuum_grasp.grasp.judge.certificate import RodCertificate
from continuum_grasp.grasp.stored import DIMENSIONS, STORED
from continuum_grasp.grasp.values import (
    NEAR,
    ROUGH,
    Change,
    Contact,
    ElementError,
    GraspStatus,
    OutlineError,
    Reason,
    Sensitivity,
    contacts_of,
    error_warning,
    force_text,
    force_units,
)
from continuum_grasp.model import Family
from continuum_grasp.results import Dimension, File, Picture, Stored
from continuum_grasp.scene import FAMILIES, GraspScene

if TYPE_CHECKING:
    from continuum_grasp.grasp.certificate.drives import RecomputedDrive
    from continuum_grasp.grasp.quality.quality import Quality
    from continuum_grasp.grasp.robust.result import Robustness
    from continuum_grasp.grasp.tried import Exploration


@dataclass(frozen=True)
class GraspResult(AnyGrasp):
    """A grasp, or why there is none.

    Attributes
    ----------
    scene : GraspScene
        The scene as given.
    status : Status
    message : str
        One sentence on how it ended.
    arrays : dict of str to ndarray
        The stored arrays by name, ``{finger}`` is the name of each finger; `fingers`, `contacts` and `object_pose`
        give them by object. Where there is no grasp: what `answer` says, or empty.
    certificate : Certificate, optional
        Independent verification of these numbers.
    violated : tuple of str
        Violated constraints by name with their amounts, where there is no grasp.
    reasons : tuple of Reason
        Reasons why there is none, each with the number that would repair it.
    advice : str
        A remedy.
    statistics : dict
        Times, iterations, starts.
    sensitivity : tuple of Sensitivity
        Changes of the answer with friction, mass and pose; empty where the solver stopped early.
    fine : Change, optional
        Changes by a fine model, if requested.
    outline : OutlineError, optional
        Error of the polygons that stand for drawings of the object, and changes by a finer one, if requested; None: the
        object is exact.
    exploration : Exploration, optional
        Extent of the search.
    lower_bound : float, optional
        Where the objective is ``least_normal_force``: lower bound of any grasp's greatest normal force [N], by
        `least_normal_force_bound`.
    robustness : Robustness, optional
        Trials of the grasp with errors of the object, where the scene has ``robust``.
    element_errors : dict of str to ElementError
        By finger, the difference of the elements from the exact rod that they stand for; empty where the grasp was
        sought with elements.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> grasp = cg.optimize_grasp("configs/grasp/mug_arcs.yaml")
    >>> [contact.name for contact in grasp.contacts]
    ['finger.middle', 'finger.tip', 'palm']
    >>> finger = grasp.fingers["finger"]
    >>> [round(tension, 1) for tension in finger.tensions.tolist()], finger.backbone.shape
    ([38.7, 1.0], (201, 4))
    """

    kind: ClassVar[str] = "grasp"
    stored: ClassVar[tuple[Stored, ...]] = STORED
    dimensions: ClassVar[tuple[Dimension, ...]] = DIMENSIONS
    texts: ClassVar[tuple[File, ...]] = (File("result.yaml", "continuum_grasp.grasp.text:result_yaml"),)
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("grasp", "continuum_grasp.plotting.grasp.picture:plot_grasp"),
        Picture(
            "robustness", "continuum_grasp.plotting.grasp.margins:plot_robustness", needs="robustness", panels=True
        ),
    )
    pages: ClassVar[tuple[File, ...]] = (File("report.html", "continuum_grasp.grasp.page:page"),)

    scene: GraspScene
    status: GraspStatus
    message: str
    arrays: Mapping[str, Array] = field(default_factory=dict)
    certificate: Certificate | RodCertificate | None = None
    violated: tuple[str, ...] = ()
    reasons: tuple[Reason, ...] = ()
    advice: str = ""
    statistics: Mapping[str, Any] = field(default_factory=dict)
    sensitivity: tuple[Sensitivity, ...] = ()
    fine: Change | None = None
    outline: OutlineError | None = None
    exploration: Exploration | None = None
    lower_bound: float | None = None
    robustness: Robustness | None = None
    element_errors: Mapping[str, ElementError] = field(default_factory=dict)

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
    def bound_words(self) -> str:
        """Words about the lower bound, where there is one."""
        if self.lower_bound is None:
            return ""
        share = self.greatest_normal_force / self.lower_bound - 1.0 if self.lower_bound > 0.0 else 0.0
        return (
            f"the balance of the object alone needs a greatest normal force of at least "
            f"{amount_text(self.lower_bound, 'N', '.4g')}; this grasp is {max(share, 0.0):.2%} above"
        )

    @property
    def verified(self) -> bool:
        """Whether forces and limits of the numbers are verified, as in a grasp, also in one that is unstable."""
        return self.solved or self.status is GraspStatus.UNSTABLE

    @property
    def balanced(self) -> bool:
        """Whether the numbers are a grasp of this scene, at least in balance."""
        return self.verified

    @property
    def answer(self) -> str:
        """Kind of the numbers: ``grasp``, ``unstable_grasp``, ``first_repair`` (the grasp of the first of the
        ``reasons``), ``nominal_grasp`` (without errors), ``closest_attempt``; empty where there are none.
        """
        if not self.arrays:
            return ""
        if self.verified:
            return "grasp" if self.solved else "unstable_grasp"
        if self.robustness is not None and self.robustness.robust is None:
            return "nominal_grasp"
        return "first_repair" if self.reasons and self.reasons[0].arrays else "closest_attempt"

    def words(self) -> dict[str, list[str]]:
        """Names of the fingers, of the trials with errors, and of postures with other friction where there are some."""
        trials = [] if self.robustness is None or self.robustness.robust is None else ["robust"]
        held = ["held"] if "held.object.pose" in self.arrays else []
        return {
            "finger": list(self.scene.named_fingers),
            "trials": trials,
            "held": held,
            "held trials": trials if self.scene.state_columns else [],
        }

    def pairs(self) -> dict[str, str]:
        """Tension, greatest force, least margin and certificate; where there is no grasp, why."""
        if not self.verified:
            reasons = {f"reason {k + 1}": reason.text for k, reason in enumerate(self.reasons[:4])}
            return {**(reasons or {"message": self.message}), **({"advice": self.advice} if self.advice else {})}
        of_tensions, of_contacts = self.force_units
        rows = {"sum of tensions": f"{self.force_text(self.tension, of_tensions)} {of_tensions}"}
        if self.contacts:
            least = min(self.contacts, key=lambda contact: contact.friction_margin)
            rows["greatest normal force"] = f"{self.force_text(self.greatest_normal_force, of_contacts)} {of_contacts}"
            rows["least friction margin"] = self.margin_text(least)
        if self.lower_bound is not None:
            rows["least in any grasp"] = f"{self.force_text(self.lower_bound, of_contacts)} {of_contacts}"
        if self.certificate is not None:
            rows["checks passed"] = self.certificate.headline().removesuffix(" checks passed")
        if isinstance(self.certificate, Certificate):
            error = self.certificate.model_error.greatest
            rows["second-order test"] = self.certificate.stability.word
            rows["model error"] = f"{1e3 * error:.2f} mm" if np.isfinite(error) else "not computed"
        if self.outline is not None:
            change = self.outline.change
            tension = "" if change is None else f", tension {change.tension_change:+.1%}"
            rows["outline error"] = f"{1e3 * self.outline.deviation:.3g} mm{tension}"
        return rows

    @property
    def opens(self) -> bool:
        """Whether the grasp is known to be unstable: small motions that the contacts allow lower the energy."""
        return isinstance(self.certificate, Certificate) and not self.certificate.stability.stable

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings before this grasp is relied on."""
        if not self.verified or self.certificate is None:
            return ()
        return (*self._warnings_of_elements(), *self._general_warnings())

    def _warnings_of_elements(self) -> list[str]:
        """Warnings about elements with which a grasp was sought, and about its stability."""
        warnings = list[str]()
        if not isinstance(self.certificate, Certificate):
            return warnings
        error = self.certificate.model_error
        if not error.small:
            fine = FAMILIES.default(free_tip=False)
            coarse = any(Family.named(f.family).order < Family.named(fine).order for f in self.fingers.values())
            other = f" or take fidelity.family: {fine}" if coarse else ""
            warnings.append(f"{error}: raise fidelity.elements{other}")
        stability = self.certificate.stability
        if self.solved and not stability.in_plane:
            warnings.append("the grasp is unstable: small motions that the contacts allow lower the energy")
        elif self.solved and stability.in_space is not None and not stability.stable:
            warnings.append(f"the grasp is not stable in space: {stability.in_space}")
        shortest = min(setup.finger.rod.length for setup in self.scene.setups)
        if stability.in_space is not None and stability.in_space.sinks > ASIDE * shortest:
            sinks = f"{1e3 * stability.in_space.sinks:.2g} mm"
            warnings.append(
                f"fingers count as stiff out of the plane, but the weight moves the object by {sinks} there"
            )
        return warnings

    def _general_warnings(self) -> list[str]:
        """Warnings about elements that stand for rods, contacts, tendons, outlines, errors and the search."""
        warnings = [error_warning(name, error) for name, error in self.element_errors.items() if not error.is_close]
        if self._idle:
            warnings.append(
                f"{' and '.join(self._idle)} on, but without a force: other contacts hold the object, and the least "
                "error loses a contact that does not press; use auto where a contact need not press"
            )
        if self._slack:
            warnings.append(
                f"the tendons hardly pull ({amount_text(self.tension, 'N', '.2g')} in all): the bases press the "
                "fingers against the object, so slack tendons do not release it, and its forces depend on the places "
                "of bases and object"
            )
        if self.outline is not None and self.outline.change and abs(self.outline.change.tension_change) > ROUGH:
            warnings.append(f"the outline is rough, {self.outline.words}: {self.outline.advice}")
        if self.robustness is not None:
            warnings += self.robustness.warnings()
        if "NOT satisfied" in str(self.statistics.get("fidelity", "")):
            warnings.append(str(self.statistics["fidelity"]))
        for key, how in (("cut_short", "cut short"), ("interrupted", "interrupted")):
            if self.statistics.get(key):
                warnings.append(f"the search was {how}: another start may hold the object with less tension")
        return warnings

    @property
    def _idle(self) -> list[str]:
        """Contacts of fingers that the scene switches on, and that carry nothing."""
        on = {name for setup in self.scene.setups for name, state in setup.switches.items() if state == "on"}
        least = NEAR * self.greatest_normal_force
        return [contact.name for contact in self.contacts if contact.name in on and contact.normal_force < least]

    @property
    def _slack(self) -> bool:
        """Whether the object is pressed although no tendon pulls by more than it must."""
        setups = {setup.name: setup.tendons for setup in self.scene.setups}
        over = sum(float((f.tensions - setups[name].min_tension).clip(0.0).sum()) for name, f in self.fingers.items())
        # A tendon's arm is a hundredth to a tenth of a finger's length: fingers that pull have a ratio of about ten.
        return over < NEAR * self.greatest_normal_force

    @cached_property
    def drives(self) -> dict[str, tuple[RecomputedDrive, ...]]:
        """States of the winches or motors of each finger; none of fingers whose tensions are commanded."""
        from continuum_grasp.grasp.certificate.drives import StoredFinger

        if not self.arrays or self.certificate is None:
            return {}
        fingers = [StoredFinger(setup, self.arrays) for setup in self.scene.setups if setup.drive is not None]
        return {finger.name: finger.wound.drives for finger in fingers if finger.wound is not None}

    @property
    def object_pose(self) -> Array:
        """World x, y [m] and angle [rad] of the object (3,)."""
        return self.arrays["object.pose"]

    @property
    def force_units(self) -> tuple[str, str]:
        """Units in which its tensions and its contact forces are written (`force_units`)."""
        return force_units(self.arrays)

    def force_text(self, force: float, unit: str = "N") -> str:
        """Write a force [N] in a unit, with the decimals that all forces of this grasp have (`force_text`)."""
        return force_text(self.arrays, force, unit)

    def margin_text(self, contact: Contact) -> str:
        """Write the friction margin of a contact, a dash where nothing presses; the same wherever it is written."""
        if not float(self.force_text(contact.normal_force, self.force_units[1])) or contact.friction_margin <= -9.99:
            return "\N{EN DASH}"
        # a contact at its limit has a margin of rounding, which would be written as -0.0%
        return f"{0.0 if abs(contact.friction_margin) < 5e-4 else contact.friction_margin:.1%}"

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts with their forces."""
        return contacts_of(self.scene, self.arrays)

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
        text: str = named_value("continuum_grasp.grasp.text:result_text")(self)
        return text

    def stored_arrays(self) -> dict[str, Array]:
        """The numbers: which there are depends on the fingers."""
        arrays = dict(self.arrays)
        if self.robustness is not None:
            arrays |= self.robustness.arrays()
        return arrays

    def details(self, *, quality: bool = True) -> dict[str, Any]:
        """Verification, indices of quality, and why there is no grasp."""
        return {
            "seed": self.scene.solver.random_seed,
            "message": self.message,
            "lower_bound": self.lower_bound,
            "certificate": self._certified(quality=quality),
            "quality": self.quality.data() if quality and self.solved else None,
            "violated": list(self.violated),
            "reasons": [reason.data() for reason in self.reasons],
            "advice": self.advice,
            "outline": None if self.outline is None else asdict(self.outline),
            "exploration": None if self.exploration is None else asdict(self.exploration),
            "robustness": None if self.robustness is None else self.robustness.data(),
            "element_errors": {name: asdict(error) for name, error in self.element_errors.items()},
        }

    def _certified(self, *, quality: bool) -> dict[str, Any] | None:
        """The certificate as plain data."""
        if isinstance(self.certificate, Certificate):
            return self.certificate.data(error=quality)
        return None if self.certificate is None else self.certificate.data()

    @check_arguments
    def save(self, folder: str | PathLike[str], *, quality: bool = True) -> Path:
        """Write ``result.npz``, ``meta.json`` and ``result.yaml`` into a run folder, as `Result.save` does.

        Parameters
        ----------
        folder : path-like
            Made where missing; a run in it is replaced.
        quality : bool, optional
            Save the indices of quality and the model's error too, which take some tenths of a second.
        """
        return self._save(folder, quality=quality)


def flawed(result: GraspResult, flaw: str) -> GraspResult:
    """A grasp with a flaw that was found afterwards; one that does not hold anyway stays as it is."""
    if not result.solved:
        return result
    message = result.message.replace("held with ", f"held but {flaw}: ", 1)
    if message == result.message:  # it has flaws already
        message = message.replace(": ", f" and {flaw}: ", 1)
    return replace(result, status=GraspStatus.FEASIBLE, message=message)


def with_outline(result: GraspResult) -> GraspResult:
    """The result with the error of its object's outline; what that changes is not computed."""
    body = result.scene.object
    off = body.deviation
    if off == 0.0:
        return result
    corners, finer = (sum(len(part.outline()) for part in each.parts) for each in (body, body.redrawn()))
    missing = "what that changes was not computed"
    return replace(
        result, outline=OutlineError(off, body.size, corners, finer, missing=missing, noise=body.outline_error)
    )
