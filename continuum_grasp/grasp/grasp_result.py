"""Parts that the results of planar grasps and of hands share."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from continuum_grasp.base import Array, InputError, check_arguments
from continuum_grasp.grasp.judge.certificate import Certificate
from continuum_grasp.grasp.judge.certify import certify, stored_shapes
from continuum_grasp.grasp.judge.drives import DriveState, WoundCables
from continuum_grasp.grasp.values import ElementError, FingerPosture, GraspStatus, Reason, error_warning, postures_of
from continuum_grasp.results import Result
from continuum_grasp.scene import GraspScene, HandScene

if TYPE_CHECKING:
    from continuum_grasp.grasp.judge.space_rod import SpaceRod


@dataclass(frozen=True)
class AnyGrasp(Result):
    """A grasp in the plane or of a hand in space, or the reason why none exists.

    Attributes
    ----------
    scene : GraspScene or HandScene
        The scene as given, with the elements that stand for the fingers.
    status : GraspStatus
    message : str
        One sentence on how it ended.
    arrays : dict of str to ndarray
        The stored arrays by name, ``{finger}`` is the name of each finger; `fingers` and `contacts` give them by
        object. Where there is no grasp: what `answer` says, or empty.
    certificate : Certificate, optional
        Independent verification of these numbers.
    reasons : tuple of Reason
        Reasons why there is no grasp, each with the number that would repair it.
    advice : str
        A remedy.
    statistics : dict
        Times, iterations, starts.
    element_errors : dict of str to ElementError
        By finger, the difference of the elements from the exact rod that they stand for.
    """

    scene: Any
    status: GraspStatus
    message: str
    arrays: Mapping[str, Array] = field(default_factory=dict)
    certificate: Certificate | None = None
    reasons: tuple[Reason, ...] = ()
    advice: str = ""
    statistics: Mapping[str, Any] = field(default_factory=dict)
    element_errors: Mapping[str, ElementError] = field(default_factory=dict)

    # -- from a folder -----------------------------------------------------------------------------------------

    @classmethod
    def of_run(cls, folder: str | PathLike[str]) -> Self:
        """The result in a run folder. A grasp is certified anew, and is none if the certificate refuses its numbers.

        Raises
        ------
        InputError
            There is no run of this kind of grasp in the folder.
        """
        run = cls.read(folder)
        meta, arrays = run.meta, dict(run.arrays)
        scene = cls._scene_of(meta.get("config") or {}, fspath(folder))
        errors = {name: ElementError(**error) for name, error in (meta.get("element_errors") or {}).items()}
        found = cls(
            scene,
            GraspStatus(str(meta["status"])),
            str(meta["message"]),
            arrays,
            reasons=tuple(Reason.of(reason) for reason in meta.get("reasons") or ()),
            advice=str(meta.get("advice") or ""),
            statistics=meta.get("statistics") or {},
            element_errors=errors,
            **cls._further(meta),
        )
        return found._judged() if found.verified else found

    @classmethod
    @abstractmethod
    def _scene_of(cls, config: Mapping[str, Any], folder: str) -> Any:
        """The scene of a run."""

    @classmethod
    def _further(cls, meta: Mapping[str, Any]) -> dict[str, Any]:
        """Further arguments of a result, from the meta data of its run."""
        return {}

    def _judged(self) -> Self:
        """The result with a certificate of its numbers."""
        certificate = certify(self.scene, self.arrays)
        if certificate.passed:
            return replace(self, certificate=certificate)
        message = f"the certificate refuses the stored numbers: {certificate.worst}"
        return replace(self, status=GraspStatus.NOT_SOLVED, message=message, certificate=certificate)

    # -- verdict -----------------------------------------------------------------------------------------------

    @property
    def solved(self) -> bool:
        """Whether a verified grasp holds the object."""
        return self.status in (GraspStatus.OPTIMAL, GraspStatus.FEASIBLE)

    @property
    def verified(self) -> bool:
        """Whether forces and limits of the numbers are verified, as in a grasp, also in one that is unstable."""
        return self.solved or self.status is GraspStatus.UNSTABLE

    @property
    def opens(self) -> bool:
        """Whether the grasp is known to be unstable; where the scene requires a stable one, a grasp is stable."""
        if self.solved and self.scene.stability != "ignore":
            return False
        return self.verified and self.certificate is not None and not self.certificate.stable

    @property
    def answer(self) -> str:
        """Kind of the numbers: ``grasp``, ``unstable_grasp``, ``first_repair`` (the grasp of the first of the
        ``reasons``), ``closest_attempt``; empty where there are none.
        """
        if not self.arrays:
            return ""
        if self.verified:
            return "grasp" if self.solved else "unstable_grasp"
        return "first_repair" if self.reasons and self.reasons[0].arrays else "closest_attempt"

    def _why(self) -> dict[str, str]:
        """Why there is no grasp, by name."""
        reasons = {f"reason {k + 1}": reason.text for k, reason in enumerate(self.reasons[:4])}
        return {**(reasons or {"message": self.message}), **({"advice": self.advice} if self.advice else {})}

    def _common_warnings(self) -> list[str]:
        """Warnings about stability, and about elements that stand for rods."""
        warnings = list[str]()
        if self.solved and self.opens:
            warnings.append("the grasp is unstable: small motions that the contacts allow lower the energy")
        errors = self.element_errors.items()
        return warnings + [error_warning(name, error) for name, error in errors if not error.is_close]

    # -- numbers -----------------------------------------------------------------------------------------------

    @property
    def contact_names(self) -> list[str]:
        """Names of the contacts."""
        return [str(name) for name in self.arrays.get("contact_names", ())]

    @property
    @abstractmethod
    def contacts(self) -> Sequence[Any]:
        """Contacts of the object with their ``name``, ``normal_force`` [N] and ``friction_margin`` [1]."""

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
        return self.total_tension if self.verified else math.nan

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
        return min(margins, default=math.nan) if self.verified else math.nan

    @cached_property
    def rods(self) -> dict[str, SpaceRod]:
        """Exact rods of the fingers by name; empty without numbers."""
        if not self.arrays:
            return {}
        own = self.certificate.rods if self.certificate is not None else ()
        return dict(zip(self.finger_names, own or stored_shapes(self.scene, self.arrays), strict=True))

    @cached_property
    def drives(self) -> dict[str, tuple[DriveState, ...]]:
        """States of the winches or motors of each finger; none of fingers whose tensions are commanded."""
        found = {}
        for setup in self.scene.setups if self.arrays else ():
            if (law := setup.drive) is not None:
                found[setup.name] = WoundCables(setup, law, self.rods[setup.name], self.tensions[setup.name]).states
        return found

    # -- files -------------------------------------------------------------------------------------------------

    @check_arguments
    def save(self, folder: str | PathLike[str], *, quality: bool = True) -> Path:
        """Write ``result.npz``, ``meta.json`` and ``result.yaml`` into a run folder, as `Result.save` does.

        Parameters
        ----------
        folder : path-like
            Made where missing; a run in it is replaced.
        quality : bool, optional
            Save the indices of quality and the push that the grasp bears too, which take some tenths of a second.
        """
        return self._save(folder, quality=quality)

    def _details(self, *, quality: bool) -> dict[str, Any]:
        """Verification, and why there is no grasp."""
        return {
            "message": self.message,
            "certificate": None if self.certificate is None else self.certificate.data(push=quality and self.verified),
            "reasons": [reason.data() for reason in self.reasons],
            "advice": self.advice,
            "element_errors": {name: asdict(error) for name, error in self.element_errors.items()},
        }


def scene_of_run(kind: type[GraspScene | HandScene], config: Mapping[str, Any], folder: str) -> Any:
    """The scene of a kind from the configuration of a run."""
    hand = "hand" in config
    if hand is not (kind is HandScene):
        expected, got = ("a planar scene", "a hand") if hand else ("a hand", "a planar scene")
        raise InputError(f"expected the grasp of {expected}, got the grasp of {got}", file=folder)
    return kind.model_validate(config)
