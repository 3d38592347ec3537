"""Whether a mission asks for more than its certificate promises: said with both numbers before anything moves."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike

import numpy as np

from continuum_grasp.addons.mission.assignment import LARGEST, Assignment
from continuum_grasp.addons.mission.budget import (
    ROUNDING,
    held_resistance,
    lowered_by_pulls,
    plant_friction,
    plant_mass,
)
from continuum_grasp.addons.mission.causes import FALLEN
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.on_pads import check_pads
from continuum_grasp.addons.mission.plant import PlantVariation
from continuum_grasp.addons.mission.scene import MissionScene
from continuum_grasp.base import Array, SolverError, amount_text, check_arguments
from continuum_grasp.grasp import GraspResult
from continuum_grasp.scene import scene_of


class BeyondCertificate(UserWarning):
    """A mission asks for more than the certificate of its grasp promises; raised before it runs."""


@dataclass(frozen=True)
class Exceeded:
    """A number of a mission that its certificate does not cover.

    Attributes
    ----------
    name : str
        ``mass``, ``friction``, ``tension``, ``turn``, the phase that pulls, or ``sinking`` in the one that lowers most.
    key : str
        The YAML key to change.
    unit : str
    given : float
        Demand of the mission; of friction, the coefficient at the contact that lacks most; of sinking, how far the pull
        lowers the object with the mission's drives and pads.
    certified : float
        Value that the grasp is certified for; of sinking, the same with drives that keep their position.
    resisted : float
        Value that the grasp's contact forces bear on this plant, all else as it is there; of sinking, how far the
        object may sink until it counts as dropped.
    certain : bool
        Whether the object is dropped for certain: these contact forces cannot carry it, however they share its weight.
    text : str
        The same as a sentence.
    """

    name: str
    key: str
    unit: str
    given: float
    certified: float
    resisted: float
    certain: bool
    text: str


@check_arguments
def check_mission(
    scene: MissionScene | str | PathLike[str],
    *,
    grasp: GraspResult | None = None,
    variation: PlantVariation | None = None,
) -> tuple[Exceeded, ...]:
    """Compare what a mission asks for with what the certificate of its grasp promises; nothing moves.

    Parameters
    ----------
    scene : MissionScene or path-like
        The mission, or its YAML file.
    grasp : GraspResult, optional
        The grasp, if you have it already.
    variation : Variation, optional
        Differences of the plant from the mission's own.

    Returns
    -------
    tuple of Exceeded
        Demands beyond the certificate: mass [kg], friction [1], drive [N], pulls [N or N m]; empty where it covers
        everything.

    Raises
    ------
    SolverError
        If there is no verified grasp, or its contacts bear too little on the mission's compliant pads.
    InputError
        If the mission is inconsistent.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.addons.mission import check_mission
    >>> check_mission("configs/mission/mug.yaml")
    ()
    >>> heavy = cg.load("configs/mission/mug.yaml", ["object_mass=0.8"])
    >>> [(one.name, one.given, one.certified, one.certain) for one in check_mission(heavy)][0]
    ('mass', 0.8, 0.33, True)
    """
    assignments = assign(scene_of(scene, MissionScene), grasp)
    beyond = exceeded(assignments, variation or PlantVariation())
    check_pads(assignments)
    return beyond


def exceeded(assignments: Sequence[Assignment], variation: PlantVariation) -> tuple[Exceeded, ...]:
    """Numbers of a mission on a plant that go beyond the certificate."""
    plant = _OnPlant(assignments, variation)
    beyond = (*plant.weight(), *plant.tension(), *plant.turning())
    # What is dropped at once, or held with less force than certified, leaves pulls nothing to be compared with.
    if any(number.certain or number.name == "tension" for number in beyond):
        return beyond
    return (*beyond, *plant.pulls(), *plant.sinking())


def exceeded_by_trials(assignments: Sequence[Assignment], drawn: Sequence[PlantVariation]) -> tuple[str, ...]:
    """Sentences about numbers beyond the certificate at the heavy and slippery end of the trials, and the count of
    plants.
    """
    asked = assignments[0].mission.trials
    beyond = exceeded(assignments, PlantVariation(mass=1.0 + asked.mass, friction=1.0 - asked.friction))
    # What holds an object less against a pull holds it less against a push.
    rough = PlantVariation(mass=1.0 + asked.mass, friction=1.0 + asked.friction)
    beyond += (
        tuple(_OnPlant(assignments, rough).turning()) if not any(number.name == "turn" for number in beyond) else ()
    )
    if not beyond:
        return ()
    count = sum(bool(exceeded(assignments, variation)) for variation in drawn)
    head = f"{count} of {len(drawn)} plants are beyond the certificate"
    ends = {"turn": "at the heavy and rough end of trials"}
    return (
        head,
        *(f"{ends.get(number.name, 'at the heavy and slippery end of trials')}: {number.text}" for number in beyond),
    )


def admit(assignments: Sequence[Assignment], reasons: Sequence[str]) -> None:
    """Warn before the run of what goes beyond the certificate, or refuse it; then check the mission's pads."""
    if reasons and assignments[0].mission.beyond_certificate == "refuse":
        raise SolverError(
            "the mission asks for more than its certificate promises",
            status="beyond_certificate",
            violated=reasons,
            advice="Ask for less, or certify the grasp for this; beyond_certificate: warn tries it nevertheless.",
        )
    for text in reasons:
        warnings.warn(text, BeyondCertificate, stacklevel=2)
    check_pads(assignments)


def admitted(
    mission: MissionScene, grasp: GraspResult | None, variation: PlantVariation | None = None
) -> tuple[Assignment, ...]:
    """Tasks of the fingers of a mission that is admitted on a plant, its own where none is given; see `admit`."""
    assignments = assign(mission, grasp)
    admit(assignments, [number.text for number in exceeded(assignments, variation or PlantVariation())])
    return assignments


class _OnPlant:
    """The contact forces of a grasp with mass and friction of a plant."""

    def __init__(self, assignments: Sequence[Assignment], variation: PlantVariation) -> None:
        self.fingers = assignments
        self.of = assignments[0]
        self.mission = assignments[0].mission
        grasp = self.of.grasp
        self.variation = variation
        self.mass = plant_mass(self.mission, variation)
        self.gravity = self.mission.gravity
        self.certified_mass = grasp.scene.object.mass
        self.names = [contact.name for contact in grasp.contacts]
        self.normal = np.array([contact.normal_force for contact in grasp.contacts])
        self.across = np.array([contact.friction_force for contact in grasp.contacts])
        self.certified_friction = np.array([grasp.scene.friction(name) for name in self.names])
        self.friction = plant_friction(self.mission, variation, self.names)
        self.table_friction = self.mission.table_friction * variation.friction

    # -- weight -------------------------------------------------------------------------------------------------------

    def _carried(self, friction: Array) -> float:
        """Mass that the contact forces carry [kg]: out of the plane by friction beside what it bears in the plane,
        shared out at will; in the plane until one slips or parts. Zero where one is beyond its cone without it.
        """
        if not self.gravity:
            down = [[*self.mission.grasp.gravity[:2], 0.0]]
            (more,) = held_resistance(self.of.grasp, friction, self.certified_mass, wrenches=down).factors
            # Beyond a cone at the certified weight nothing is resisted, although less weight might be carried.
            return self.certified_mass + float(more) if more > 0.0 else 0.0
        spare = (friction * self.normal) ** 2 - self.across**2
        if (spare < -ROUNDING * (friction * self.normal) ** 2).any():
            return 0.0
        return float(np.sqrt(np.maximum(spare, 0.0)).sum()) / self.gravity

    def weight(self) -> Iterator[Exceeded]:
        """Mass and friction."""
        carried = self._carried(self.friction)
        friction = self.friction
        # Out of the plane no sharing of the weight carries more than this.
        greatest_mass = float((friction * self.normal).sum()) / self.gravity if self.gravity else np.inf
        certain = self.mass > greatest_mass * (1.0 + ROUNDING)
        bears = f"its contact forces carry {carried:.3g} kg on this plant"
        low, high = f"{friction.min():.3g}", f"{friction.max():.3g}"
        between = low if low == high else f"{low} to {high}"
        ends = f"; it will be dropped: {greatest_mass:.3g} kg is the most that friction of {between} carries with them"
        ends = ends if certain else ""
        if self.mass > (certified := self.certified_mass) * (1.0 + ROUNDING):
            text = f"the object has {self.mass:.3g} kg, the grasp is certified for {certified:.3g} kg; {bears}{ends}"
            yield Exceeded("mass", "object_mass", "kg", self.mass, certified, carried, certain, text)
        share = friction / np.maximum(self.certified_friction, 1e-300)
        worst = int(np.argmin(share))
        if share[worst] < 1.0 - ROUNDING:
            there = float(friction[worst])
            certified = float(self.certified_friction[worst])
            least = self._least_share() * friction[worst]
            where = ", ".join(n for n, s in zip(self.names, share, strict=True) if s < share[worst] + ROUNDING)
            text = (
                f"friction is {there:.3g} at {where}, the grasp is certified for {certified:.3g}; its contact forces "
                f"need {least:.3g} with {self.mass:.3g} kg{ends}"
            )
            yield Exceeded("friction", "contact_law.friction", "1", there, certified, least, certain, text)

    def _least_share(self) -> float:
        """Factor on the plant's friction with which the contact forces just carry the object; infinite if none does."""

        def spare(share: float) -> float:
            return self._carried(share * self.friction) - self.mass

        from scipy.optimize import brentq

        enough = next((share for share in 2.0 ** np.arange(20.0) if spare(share) >= 0.0), np.inf)
        return float(brentq(spare, 0.0, enough, xtol=1e-6)) if np.isfinite(enough) else float("inf")

    # -- drives -------------------------------------------------------------------------------------------------------

    def tension(self) -> Iterator[Exceeded]:
        """Whether the drives have the tensions of the grasp."""
        for finger in self.fingers:
            greatest = np.array([tendon.max_tension for tendon in finger.control.finger.tendon_list])
            worst = int(np.argmax(finger.tensions / greatest))
            needed = float(finger.tensions[worst])
            limit = float(greatest[worst])
            if needed <= limit * (1.0 + ROUNDING):
                continue
            key = "drive_tension" if self.mission.tendons is None else "tendons.max_tension"
            whose = f"the drive of {finger.name}" if len(self.fingers) > 1 else "the drive"
            takes = f"the certified grasp takes {amount_text(needed, 'N')}: it is not reached"
            text = f"{whose} pulls with {amount_text(limit, 'N')} at most, {takes}"
            yield Exceeded("tension", key, "N", limit, needed, needed, False, text)

    # -- a turn -------------------------------------------------------------------------------------------------------

    def turning(self) -> Iterator[Exceeded]:
        """Whether the fingertip presses harder than the table holds the object against sliding.

        Pushed off its center it gives way to less, by the ellipsoid of force and moment; a support that it is pushed
        against holds it too, as far as the push presses it there, which no force overcomes where it jams.
        """
        if self.mission.turn is None:
            return
        held = self.table_friction * self.mass * self.gravity
        (tip,) = (force for name, force in zip(self.names, self.normal, strict=True) if name.endswith(".tip"))
        if held <= tip * (1.0 + ROUNDING):
            return
        text = (
            f"the table holds the object with {amount_text(held, 'N')} against sliding "
            f"(friction {self.table_friction:.3g}, {self.mass:.3g} kg), the fingertip presses "
            f"with {amount_text(tip, 'N')} in the certified grasp"
        )
        yield Exceeded("turn", "table_friction", "N", held, float(tip), float(tip), False, text)

    # -- pulls --------------------------------------------------------------------------------------------------------

    def pulls(self) -> Iterator[Exceeded]:
        """Every pull against what the grasp resists, as certified and with the plant's mass and friction."""
        certified = self.of.resisted
        evenly = self.of.grasp.quality.resistance.tendons != "locked"
        drive_tension = self.mission.drive_tension
        there = held_resistance(self.of.grasp, self.friction, self.mass, max_tension=drive_tension, evenly=evenly)
        for k, wrench in enumerate(certified.wrenches):
            factors = certified.factors[k], there.factors[k]
            asked = self.mission.pull_share * min(factors[0], LARGEST)
            if not asked > min(factors) * (1.0 + ROUNDING):
                continue
            unit, size = _size(wrench)
            pull, as_certified, resisted = (float(size * factor) for factor in (asked, *factors))
            why = ", ".join(there.limiting[k]) or "nothing limits it"
            text = (
                f"pull {k + 1} is {amount_text(pull, unit)}, the grasp resists {amount_text(as_certified, unit)} as "
                f"certified and {amount_text(resisted, unit)} on this plant ({why})"
            )
            yield Exceeded(f"pull {k + 1}", "pull_share", unit, pull, as_certified, resisted, False, text)

    def sinking(self) -> Iterator[Exceeded]:
        """Whether a pull lowers an object that weighs in the plane so far that it counts as dropped.

        The certificate states what its contacts resist while drives keep their position; drives that keep their
        tension are as firm as the bare fingers are.
        """
        worst = max(lowered_by_pulls(self.fingers, self.variation), key=lambda lowered: lowered.distance, default=None)
        if worst is None or worst.distance < FALLEN:
            return
        text = f"{worst.text}. From {1e3 * FALLEN:g} mm on the object counts as dropped"
        yield Exceeded("sinking", "pull_share", "m", worst.distance, worst.certified, FALLEN, False, text)


def _size(wrench: Array) -> tuple[str, float]:
    """Unit and size of a force or a moment; of both together, the multiple of the scene's disturbance."""
    force = float(np.hypot(*wrench[:2]))
    moment = abs(float(wrench[2]))
    if force and moment:
        return "times the disturbance", 1.0
    return ("N", force) if force else ("N m", moment)
