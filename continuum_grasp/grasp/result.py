"""The result of the search for a planar grasp."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

from continuum_grasp.base import Array, InputError, amount_text, check_arguments, named_value
from continuum_grasp.grasp.exploration import Exploration
from continuum_grasp.grasp.grasp_result import AnyGrasp, scene_of_run
from continuum_grasp.grasp.stored import DIMENSIONS, STORED
from continuum_grasp.grasp.values import (
    NEAR,
    Contact,
    OutlineError,
    Sensitivity,
    contacts_of,
    force_text,
    force_units,
)
from continuum_grasp.results import Dimension, File, Picture, Stored
from continuum_grasp.scene import GraspScene

if TYPE_CHECKING:
    from continuum_grasp.grasp.quality.quality import Quality
    from continuum_grasp.grasp.robust.result import Robustness


@dataclass(frozen=True)
class GraspResult(AnyGrasp):
    """A grasp, or why there is none.

    Attributes
    ----------
    scene : GraspScene
        The scene as given, with the elements that stand for the fingers.
    status : GraspStatus
    message : str
        One sentence on how it ended.
    arrays : dict of str to ndarray
        The stored arrays by name, ``{finger}`` is the name of each finger; `fingers`, `contacts` and `object_pose`
        give them by object. Where there is no grasp: what `answer` says, or empty.
    certificate : Certificate, optional
        Independent verification of these numbers.
    reasons : tuple of Reason
        Reasons why there is none, each with the number that would repair it.
    advice : str
        A remedy.
    statistics : dict
        Times, iterations, starts.
    element_errors : dict of str to ElementError
        By finger, the difference of the elements from the exact rod that they stand for.
    violated : tuple of str
        Violated constraints by name with their amounts, where there is no grasp.
    sensitivity : tuple of Sensitivity
        Changes of the answer with friction, mass and pose; empty where the solver stopped early.
    outline : OutlineError, optional
        Error of the polygons that stand for drawings of the object; None: the object is exact.
    exploration : Exploration, optional
        Extent of the search.
    lower_bound : float, optional
        Where the objective is ``least_normal_force``: lower bound of any grasp's greatest normal force [N], by
        `least_normal_force_bound`.
    robustness : Robustness, optional
        Trials of the grasp with errors of the object, where the scene has ``robust``; not read from folders.

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
    violated: tuple[str, ...] = ()
    sensitivity: tuple[Sensitivity, ...] = ()
    outline: OutlineError | None = None
    exploration: Exploration | None = None
    lower_bound: float | None = None
    robustness: Robustness | None = None

    @classmethod
    def _scene_of(cls, config: Mapping[str, Any], folder: str) -> GraspScene:
        scene: GraspScene = scene_of_run(GraspScene, config, folder)
        return scene

    @classmethod
    def _further(cls, meta: Mapping[str, Any]) -> dict[str, Any]:
        outline, exploration = meta.get("outline"), meta.get("exploration")
        return {
            "violated": tuple(meta.get("violated") or ()),
            "sensitivity": tuple(Sensitivity(**each) for each in meta.get("sensitivity") or ()),
            "outline": OutlineError(**outline) if outline else None,
            "exploration": Exploration(**exploration) if exploration else None,
            "lower_bound": meta.get("lower_bound"),
        }

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
    def answer(self) -> str:
        """Kind of the numbers: ``grasp``, ``unstable_grasp``, ``first_repair`` (the grasp of the first of the
        ``reasons``), ``nominal_grasp`` (without errors), ``closest_attempt``; empty where there are none.
        """
        if self.arrays and not self.verified and self.robustness is not None and self.robustness.robust is None:
            return "nominal_grasp"
        return super().answer

    def words(self) -> dict[str, list[str]]:
        """Names of the fingers, and of the trials with errors."""
        trials = [] if self.robustness is None or self.robustness.robust is None else ["robust"]
        return {"finger": list(self.scene.named_fingers), "trials": trials}

    def pairs(self) -> dict[str, str]:
        """Tension, greatest force, least margin and certificate; where there is no grasp, why."""
        if not self.verified:
            return self._why()
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
        if self.outline is not None:
            rows["outline error"] = f"{1e3 * self.outline.deviation:.3g} mm"
        return rows

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings before this grasp is relied on."""
        if not self.verified or self.certificate is None:
            return ()
        return (*self._common_warnings(), *self._planar_warnings())

    def _planar_warnings(self) -> list[str]:
        """Warnings about contacts, tendons, errors and the search."""
        warnings = list[str]()
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
        if self.robustness is not None:
            warnings += self.robustness.warnings()
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
        return self._details(quality=quality) | {
            "seed": self.scene.solver.random_seed,
            "lower_bound": self.lower_bound,
            "quality": self.quality.data() if quality and self.solved else None,
            "violated": list(self.violated),
            "sensitivity": [asdict(each) for each in self.sensitivity],
            "outline": None if self.outline is None else asdict(self.outline),
            "exploration": None if self.exploration is None else asdict(self.exploration),
            "robustness": None if self.robustness is None else self.robustness.data(),
        }


def with_outline(result: GraspResult) -> GraspResult:
    """The result with the error of its object's outline."""
    body = result.scene.object
    if body.deviation == 0.0:
        return result
    corners = sum(len(part.outline()) for part in body.parts)
    return replace(result, outline=OutlineError(body.deviation, body.size, corners, noise=body.outline_error))
