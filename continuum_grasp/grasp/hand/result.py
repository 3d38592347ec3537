"""The grasp of a hand in space, or why there is none."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from continuum_grasp.base import Array, Summarized, amount_text
from continuum_grasp.grasp.grasp_result import AnyGrasp, scene_of_run
from continuum_grasp.grasp.stored import BASE_MOMENT, OF_FINGERS, SHAPE
from continuum_grasp.results import Dimension, File, Picture, Stored, plain, yaml_text
from continuum_grasp.scene import HandScene

if TYPE_CHECKING:
    from continuum_grasp.grasp.certificate.drives import StoredFinger, WoundTendons
    from continuum_grasp.grasp.certificate.friction import TendonFriction
    from continuum_grasp.grasp.hand.body import BodySurface
    from continuum_grasp.grasp.hand.frames import PlaneFrame

_HEAD = """\
# How a hand holds an object, or why it does not. Axes of the hand, SI units. Forces are those on the fingers.
# result.npz holds all numbers, meta.json the configuration and every check.
"""
STORED = (
    Stored("contact_names", "(contact,)", "text", "name of each contact; palm_1, table_1 and so on of supports"),
    Stored("contact_positions", "(contact, xyz)", "m", "contacts on the object's surface"),
    Stored("contact_normals", "(contact, xyz)", "1", "outward normals of the object there"),
    Stored("contact_forces", "(contact, xyz)", "N", "forces on the fingers, on palm and table"),
    Stored("contact_stations", "(contact,)", "m", "positions along the finger; 0 of palm and table"),
    Stored("contact_deflections", "(contact,)", "m", "shift of the backbone out of its plane; 0 of palm and table"),
    Stored("contact_moments", "(contact,)", "N m", "about the normals, on the fingers; only with torsional friction"),
    Stored("{finger}.family", "()", "text", "arc, clothoid or matched_clothoid"),
    *SHAPE,
    replace(BASE_MOMENT, shape="(xyz,)", meaning="moment in the base; of exact rods alone"),
    Stored("{finger}.base", "(base,)", "", "pose of the base in the plane of the finger: x, y [m] and angle [rad]"),
    Stored("{finger}.backbone", "({finger} place, section)", "", "shape of the finger in its plane"),
)
"""Arrays of the grasp of a hand."""


_EDGE = 0.25
"""The result names an edge nearer to a contact than this distance per radius of the finger [1]: a finger of 6 mm radius
that shifts by 1.5 mm, as turned grasps may allow (``shift_max``), then reaches the edge."""


@dataclass(frozen=True)
class FingerTouch:
    """A contact of the object, as the hand sees it: with a finger, or, such as ``palm_1``, with palm or table."""

    name: str
    position: Array  # (3,) on the object's surface [m]
    normal: Array  # (3,) outward, of the object
    force: Array  # (3,) on the finger or support [N]
    station: float  # position along the finger [m], zero of a support
    deflection: float  # shift of the backbone out of its plane [m], zero of a support
    moment: float = 0.0  # about the normal, on the finger [N m]
    friction_margin: float = math.nan  # share of the friction cone that is free [1]; NaN where nothing presses

    @property
    def normal_force(self) -> float:
        """Normal force [N]."""
        return float(self.force @ self.normal)

    @property
    def friction_force(self) -> float:
        """Friction along the surface [N]."""
        return float(np.linalg.norm(self.force - self.normal_force * self.normal))


@dataclass(frozen=True)
class HandResult(AnyGrasp):
    """The grasp of a hand, or why there is none.

    Attributes
    ----------
    scene : HandScene
        The scene as given, with the elements that stand for the fingers.
    status : GraspStatus
    message : str
        One sentence on how it ended.
    arrays : dict of str to ndarray
        The stored arrays by name, ``{finger}`` is the name of each finger. Where there is no grasp: that with the first
        repair, or the point that came nearest; or empty.
    certificate : Certificate, optional
        Independent verification of these numbers.
    reasons : tuple of Reason
        Why there is none, each with the number that repairs it.
    advice : str
        What to try.
    statistics : dict
        Starts, iterations, seconds.
    element_errors : dict of str to ElementError
        By finger, the difference of the elements from the exact rod that they stand for.
    trial : dict
        How it fared in another program: whether it ``holds``, in ``words``, and what was measured; empty where it was
        not tried.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> grasp = cg.optimize_grasp("configs/hand/ball.yaml")
    >>> grasp.solved, [contact.name for contact in grasp.contacts]
    (True, ['finger_1.middle', 'finger_2.middle', 'finger_3.middle'])
    """

    kind: ClassVar[str] = "grasp"
    stored: ClassVar[tuple[Stored, ...]] = STORED
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension("contact", "contacts of the object", "contact_names"),
        Dimension("xyz", "axes of the hand", ("x", "y", "z")),
        Dimension("tendon", "tendons: on the side to which it bends, and on the other", ("left", "right")),
        Dimension("base", "pose of the base", ("x [m]", "y [m]", "angle [rad]")),
        Dimension("section", "of a section", ("s [m]", "x [m]", "y [m]", "angle [rad]")),
        *OF_FINGERS,
    )
    texts: ClassVar[tuple[File, ...]] = (File("result.yaml", "continuum_grasp.grasp.hand.result:result_yaml"),)
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("hand", "continuum_grasp.plotting.grasp.hand:plot_hand", panels=True),
    )

    pages: ClassVar[tuple[File, ...]] = (File("report.html", "continuum_grasp.grasp.hand.result:report_page"),)
    page: ClassVar[str] = "hand"

    scene: HandScene
    trial: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def _scene_of(cls, config: Mapping[str, Any], folder: str) -> HandScene:
        scene: HandScene = scene_of_run(HandScene, config, folder)
        return scene

    @classmethod
    def _further(cls, meta: Mapping[str, Any]) -> dict[str, Any]:
        return {"trial": meta.get("trial") or {}}

    @cached_property
    def body(self) -> BodySurface:
        """Surface of the object, for pictures."""
        from continuum_grasp.grasp.hand.body import BodySurface

        return BodySurface(self.scene)

    @property
    def frames(self) -> list[PlaneFrame]:
        """Planes of the fingers."""
        from continuum_grasp.grasp.hand.frames import PlaneFrame

        return PlaneFrame.each(self.scene)

    def show(self) -> Any:
        """Show the grasp as a page in space: turn it, and see what tensions change to first order.

        Returns
        -------
        continuum_grasp.addons.web.Page
            A notebook shows it; ``save`` writes it to a file.
        """
        return self._page_maker()(self)

    @property
    def contacts(self) -> tuple[FingerTouch, ...]:
        """The contacts with their forces."""
        keys = ("positions", "normals", "forces", "stations", "deflections")
        if not self.arrays:
            return ()
        stored = [self.arrays[f"contact_{key}"] for key in keys]
        stored.append(self.arrays.get("contact_moments", np.zeros(len(self.contact_names))))
        touches = [
            FingerTouch(name, x, n, f, float(s), float(w), float(m))
            for name, x, n, f, s, w, m in zip(self.contact_names, *stored, strict=True)
        ]
        return tuple(replace(touch, friction_margin=self._margin(touch)) for touch in touches)

    @property
    def wound(self) -> dict[str, WoundTendons]:
        """Tendons that drives wind up, of each finger that has such."""
        return {finger.name: finger.wound for finger in self._stored if finger.wound is not None}

    @property
    def tendon_friction(self) -> dict[str, TendonFriction]:
        """Tensions along tendons with friction, of each finger that has such."""
        return {finger.name: finger.friction for finger in self._stored if finger.friction is not None}

    @property
    def _stored(self) -> list[StoredFinger]:
        from continuum_grasp.grasp.certificate.drives import StoredFinger

        return [StoredFinger(setup, self.arrays) for setup in (self.scene.setups if self.arrays else ())]

    def words(self) -> dict[str, list[str]]:
        """Names of the fingers."""
        return {"finger": [setup.name for setup in self.scene.setups]}

    def stored_arrays(self) -> dict[str, Array]:
        """The numbers."""
        return dict(self.arrays)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings before this grasp is relied on."""
        found = self._common_warnings()
        if edges := self._near_edges() if self.solved else []:
            found.append(
                f"sharp edges of the mesh are near contacts: {', '.join(edges)}; a finger that moves as far slips off, "
                "and on an edge the normal is any between both sides: round the edges of the mesh, or move the hand"
            )
        return tuple(found)

    def _near_edges(self) -> list[str]:
        """Contacts of fingers near sharp edges of a mesh, with their distances."""
        halves = {s.name: s.finger.profile.half_thickness for s in self.scene.setups}
        contacts = [c for c in self.contacts if c.name.rpartition(".")[0] in halves]
        distances = self.body.edge_distance(np.array([c.position for c in contacts]).reshape(-1, 3))
        limits = [_EDGE * float(halves[c.name.rpartition(".")[0]](c.station)) for c in contacts]
        near = zip(contacts, distances, limits, strict=True)
        return [f"{c.name} ({1e3 * distance:.2f} mm)" for c, distance, limit in near if distance <= limit]

    def pairs(self) -> dict[str, str]:
        """Tension, forces and certificate; where there is no grasp, why."""
        if not self.verified:
            return self._why()
        rows = {"sum of tensions": amount_text(self.tension, "N", ".4g")}
        rows["greatest normal force"] = amount_text(self.greatest_normal_force, "N", ".4g")
        if self.certificate is not None:
            rows["checks passed"] = self.certificate.headline().removesuffix(" checks passed")
        if self.trial:
            rows["trial"] = str(self.trial["words"])
        return rows

    def table(self) -> str:
        """The result as text: tensions, contacts, verification, reasons."""
        lines = [f"{self.status.word}: {self.message}"]
        if self.reasons:
            lines += ["", "Why there is no grasp; any one of these repairs it:"]
            lines += [f"  {reason.text}: {reason.repair}" for reason in self.reasons]
        if self.arrays and not self.verified:
            lines += ["", f"{'With the first repair' if self.reasons else 'Where the search came nearest'}:"]
        if self.arrays:
            lines += ["", "Tensions [N]", *(f"  {line}" for line in self._tension_rows())]
            lines += [f"  {line}" for line in self._drive_rows()]
            if self.tendon_friction:
                lines.append("  with tendon friction as pulling leaves it; other friction states are not tested")
            lines += ["", "Contacts, as the hand sees them", *(f"  {line}" for line in self._contact_rows())]
        if self.certificate is not None:
            lines += ["", f"Certificate: {self.certificate.headline()}", *map(str, self.certificate.failed)]
        if self.trial:
            lines += ["", f"Tried: {self.trial['words']}"]
        if self.advice and not self.reasons:
            lines += ["", self.advice]
        return "\n".join(lines)

    def _tension_rows(self) -> list[str]:
        rows = [("Finger", "Bends", "Back", "At most")]
        for setup in self.scene.setups:
            left, right = (f"{pull:.3f}" for pull in self.tensions[setup.name])
            rows.append((setup.name, left, right, f"{setup.max_tension:g}"))
        return Summarized.aligned(rows, {0})

    def _drive_rows(self) -> list[str]:
        from continuum_grasp.grasp.text import drive_lines

        each = [(name, drive_lines(drives, self.tensions[name])) for name, drives in self.drives.items()]
        return [f"{name}: {line}" for name, lines in each for line in lines]

    def _contact_rows(self) -> list[str]:
        soft = self.scene.contacts.torsional_friction > 0.0
        moment = ["Moment [N mm]"] if soft else []
        head = ["Contact", "At [mm]", "Along [mm]", "Normal [N]", "Friction [N]", *moment, "Margin", "To the side [mm]"]
        rows = [tuple(head)]
        for contact in self.contacts:
            margin = contact.friction_margin
            rows.append(
                (
                    contact.name,
                    ", ".join(f"{1e3 * c:.1f}" for c in contact.position),
                    f"{1e3 * contact.station:.1f}",
                    f"{contact.normal_force:.3f}",
                    f"{contact.friction_force:.3f}",
                    *([f"{1e3 * contact.moment:.2f}"] if soft else []),
                    f"{margin:.1%}" if np.isfinite(margin) else "\N{EN DASH}",
                    f"{1e3 * contact.deflection:.2f}",
                )
            )
        return Summarized.aligned(rows, {0, 1})

    def _margin(self, contact: FingerTouch) -> float:
        """Free share of a contact's friction cone; NaN without a normal force."""
        friction = self.friction_of(contact.name)
        across = contact.friction_force
        if contact.moment:
            across = float(np.hypot(across, contact.moment * friction / self.scene.contacts.torsional_friction))
        limit = friction * contact.normal_force
        return 1.0 - across / limit if limit > 0.0 else math.nan

    def friction_of(self, contact: str) -> float:
        """Coefficient of friction of a contact."""
        of = {f"{setup.name}.": setup.friction for setup in self.scene.setups}
        of |= {f"{support.name}_": support.friction for support in self.scene.supports}
        return next(friction for start, friction in of.items() if contact.startswith(start))

    def details(self, *, quality: bool = True) -> dict[str, Any]:
        """Verification, and why there is no grasp."""
        return self._details(quality=quality) | ({"trial": plain(self.trial)} if self.trial else {})


def report_page(result: HandResult, **_: Any) -> str:
    """Text of the page of a grasp."""
    return str(result.show().text)


def result_yaml(result: HandResult, *, quality: bool = True) -> str:
    """The summary as YAML."""
    summary: dict[str, Any] = {"status": result.status.value, "message": result.message}
    if result.arrays:
        summary["tensions"] = {name: [round(float(t), 6) for t in pair] for name, pair in result.tensions.items()}
        if drives := {name: [plain(asdict(drive)) for drive in each] for name, each in result.drives.items()}:
            summary["drives"] = drives
        summary["contacts"] = {
            c.name: {
                "position": [round(float(v), 7) for v in c.position],
                "normal_force": round(c.normal_force, 6),
                "friction_force": round(c.friction_force, 6),
                "deflection": round(c.deflection, 7),
                **({"moment": round(c.moment, 9)} if result.scene.contacts.torsional_friction else {}),
            }
            for c in result.contacts
        }
    if quality and result.certificate is not None:
        summary["certificate"] = {
            "passed": result.certificate.passed,
            **({"push": result.certificate.push, "stable": result.certificate.stable} if result.verified else {}),
        }
    if result.trial:
        summary["trial"] = plain(result.trial)
    if result.reasons:
        summary["reasons"] = [reason.text for reason in result.reasons]
    return _HEAD + yaml_text(summary)
