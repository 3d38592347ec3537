"""The elastic rod: uniform, in sections, by samples, or a straightened spiral; and what dissipates in its bending."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from continuum_grasp.base import InputError
from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.graded import CrossSection, RodFactors, RodSamples, RodSection, SpiRob, ends
from continuum_grasp.scene.magnitudes import FINGER_LENGTH
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import (
    Duration,
    Length,
    ListOf,
    NonNegative,
    Positive,
    Value,
    check_shorter,
)

if TYPE_CHECKING:
    from continuum_grasp.scene.profile import Profile


class DryFriction(Value):
    """One branch of dry friction in bending: a spring in series with a slider.

    It resists bending like a spring until its moment is reached, then slides at that moment, whatever the rate. Several
    branches are the law of W. D. Iwan (1966, doi:10.1115/1.3625199).
    """

    stiffness: Annotated[Positive, Unit("N m2"), Field(examples=[0.2])]
    """Bending stiffness that it adds while it sticks [N m2]."""
    moment: Annotated[Positive, Unit("N m"), Field(examples=[0.4])]
    """Bending moment at which it slides [N m]."""


class Relaxation(Value):
    """One branch of a material that creeps and relaxes: a spring in series with a dashpot, beside the elastic rod.

    ``bending_stiffness`` holds for slow loads. Several branches are a Prony series.
    """

    share: Annotated[float, Field(gt=0.0, le=100.0, examples=[0.2]), Unit("1")]
    """Stiffness that it adds under sudden loads, relative to slow loads [1]."""
    time: Annotated[Duration, Field(examples=[3.0, "3 s"])]
    """Time in which its moment relaxes to 37 % while the bend is held [s]; less than a thousandth of the finger's
    slowest motion is damping."""


class Damping(Value):
    """Internal damping; all kinds may be given and add up.

    For a graded rod the values hold at the base, and scale with its bending stiffness along it.

    Examples
    --------
    >>> from continuum_grasp.scene import Damping
    >>> damping = Damping.model_validate({"material": 0.005, "dry_friction": [{"stiffness": 0.2, "moment": 0.4}]})
    >>> damping.dry_friction[0].moment
    0.4
    """

    material: Annotated[NonNegative, Unit("N m2 s")] = 0.0
    """Material (Kelvin-Voigt) damping eta [N m2 s]: bending moment per curvature rate. Does not depend on the mesh."""
    per_arc: Annotated[NonNegative, Unit("N m s")] = 0.0
    """The paper's c_frc [N m s] of equation (39): moment per rate of each element's bending angle."""
    quadratic: Annotated[NonNegative, Unit("N m3 s2")] = 0.0
    """Damping that grows with the speed [N m3 s2]: bending moment per squared curvature rate, as air drag has it in a
    vibration of one shape; unlike dry friction it makes the finger no softer where it swings far."""
    dry_friction: Annotated[ListOf[DryFriction], Field(max_length=8)] = ()
    """Branches of dry friction, in which the finger remembers how it was bent: it rests anywhere between two shapes,
    is stiffer where it moves little, and small swings die out."""
    relaxation: Annotated[ListOf[Relaxation], Field(max_length=3)] = ()
    """Branches in which the material relaxes: it creeps under a load that is held, and comes back slowly."""
    friction_cells: Annotated[int, Field(ge=1, le=16)] = 2
    """Cells per element on which dry friction, with a state of each branch, sees the mean curvature: elements of
    constant curvature need only one."""


_PARTS = ("sections", "samples", "spirob")
_LEAST_GAP = 1e-6
"""Least distance between jumps, and between samples, per length [1]: a panel of quadrature of its own is between."""
_LEAST_THICKNESS = 1e-3
"""Least thickness per thickness of the base [1]: towards a pointed tip the curvature has no bound."""


class Rod(CrossSection):
    """An inextensible, unshearable elastic rod: one section all along, or graded by ``sections``, ``samples`` or
    ``spirob``, or by values that change from base to tip.

    Examples
    --------
    >>> from continuum_grasp.scene import Rod
    >>> taper = Rod(
    ...     length=0.25,
    ...     youngs_modulus=2e6,
    ...     density=1100.0,
    ...     sections=[{"to": 0.1, "diameter": 0.02}, {"to": 0.25, "diameter": [0.016, 0.004]}],
    ... )
    >>> stiffness = taper.profile.bending_stiffness
    >>> stiffness([0.0, 0.1, 0.25]).round(9)  # [N m2]; at a jump the value of the base side
    array([1.5707963e-02, 1.5707963e-02, 2.5133000e-05])
    """

    REFUSALS = Consumer.refusals(
        """
        factors without graded: is for a graded rod
        {thickness,width,diameter,linear_density,bending_stiffness} with parted: works only for a rod of one section
        {youngs_modulus,density,rotary_inertia} with samples: samples have their own
        {samples,spirob} with sections: sections are given: give one of both
        spirob with samples: samples are given: give one of both
        spirob without youngs_modulus: spirob needs youngs_modulus and density of the rod
        spirob without density: spirob needs youngs_modulus and density of the rod
        {youngs_modulus,density,rotary_inertia} with stated_by_sections(NAME): no section needs it as one number
        """,
        # All sections state it by themselves, or it would change along each of them.
        stated_by_sections=lambda rod, name: (
            rod.sections is not None
            and not (any(name in s.left_open for s in rod.sections) and isinstance(getattr(rod, name), float))
        ),
    )

    length: Annotated[Length, FINGER_LENGTH, Field(examples=[0.18, "180 mm"])]
    """Length L [m]."""
    sections: Annotated[ListOf[RodSection], Field(min_length=1, max_length=1000)] | None = None
    """Sections from base to tip; values may change linearly inside a section and jump from one to the next. What a
    section does not state of ``youngs_modulus``, ``density`` and ``rotary_inertia`` is the rod's."""
    samples: RodSamples | None = None
    """Stiffness and mass at positions along the finger, interpolated between."""
    spirob: SpiRob | None = None
    """A logarithmic spiral, straightened; needs ``youngs_modulus`` and ``density``."""

    factors: RodFactors = RodFactors()
    """Factors on stiffness and mass of a graded rod, everywhere."""

    def _check(self) -> None:
        if self.sections is not None:
            self._check_section_keys(self.sections)
        elif self.spirob is not None:
            turn = self.spirob.unit_angle(self.length)
            # A spiral of fewer than four units a turn is none.
            if turn > 0.5 * math.pi:
                raise ValueError(
                    f"spirob.units = {self.spirob.units}: each would turn by {math.degrees(turn):.0f} degrees; use "
                    "more units, so that each turns by at most 90 degrees"
                )
        elif self.samples is not None:
            if not math.isclose(self.samples.at[-1], self.length, rel_tol=1e-9):
                raise ValueError(f"samples.at: the last, {self.samples.at[-1]} m, must be the length, {self.length} m")
        else:
            self.check_shape()
            for key in ("youngs_modulus", "density"):
                if key in self.left_open:
                    raise ValueError(f"a section given by its shape needs {key}")
            for key in ("thickness", "diameter"):
                check_shorter(key, max(ends(getattr(self, key) or 0.0)), self.length)
        if self.graded:
            self._check_values()

    def _check_section_keys(self, sections: tuple[RodSection, ...]) -> None:
        for k, (earlier, later) in enumerate(pairwise(sections), 1):
            if later.to <= earlier.to:
                raise ValueError(
                    f"sections[{k}].to = {later.to} m is not beyond {earlier.to} m, where the one before ends"
                )
        if not math.isclose(sections[-1].to, self.length, rel_tol=1e-9):
            last = f"sections[{len(sections) - 1}].to = {sections[-1].to} m"
            raise ValueError(f"{last}: the last section must end at the length of {self.length} m")
        for key in ("youngs_modulus", "density"):
            for k, section in enumerate(sections):
                if key in section.left_open and getattr(self, key) is None:
                    raise ValueError(f"sections[{k}] needs {key}, its own or the rod's, since it is given by its shape")
        known = [section.thick is not None for section in sections]
        if any(known) and not all(known):
            raise ValueError(
                f"sections[{known.index(False)}] needs a thickness or diameter, as other sections have one"
            )

    def _check_values(self) -> None:
        """Refuse what cannot be a rod, at ends of sections and at samples."""
        places = [at for _, at, _ in self._ends]
        for a, b in pairwise(sorted(set(places))):
            if b - a < _LEAST_GAP * self.length:
                key = self._ends[places.index(b)][0]
                raise ValueError(f"{key}: {a} m and {b} m are closer than {_LEAST_GAP:g} of the length")
        profile = self.profile
        thickest, stiffest = 2.0 * float(profile.half_thickness(0.0)), float(profile.bending_stiffness(0.0))
        for key, at, tip_side in self._ends:
            thickness = 2.0 * float(profile.half_thickness(at, tip_side=tip_side))
            stiffness = float(profile.bending_stiffness(at, tip_side=tip_side))
            # 1.0 / 3.0: greatest thickness of a graded rod per length: beyond, it is no thin rod
            if thickness > (1.0 / 3.0) * self.length:
                raise ValueError(
                    f"{key}: a thickness of {thickness:g} m is more than a third of the length of {self.length} m: "
                    "the rod is not thin"
                )
            if thickness < _LEAST_THICKNESS * thickest:
                raise ValueError(
                    f"{key}: a thickness of {thickness:g} m is less than {_LEAST_THICKNESS:g} of the base's, "
                    f"{thickest:g} m: the curvature of a sharp tip has no bound; cut the tip off"
                )
            of_cone = _LEAST_THICKNESS**4
            if stiffness < of_cone * stiffest:
                raise ValueError(
                    f"{key}: a bending stiffness of {stiffness:.3g} N m2 is less than {of_cone:g} of "
                    f"the base's, {stiffest:g} N m2"
                )

    @property
    def _ends(self) -> list[tuple[str, float, bool]]:
        """Ends of sections, or places of samples [m], with their keys, and whether that is seen from the tip."""
        if self.samples is not None:
            return [(f"samples.at[{k}]", at, False) for k, at in enumerate(self.samples.at)]
        keys = [f"sections[{k}]" for k in range(len(self.sections or ()))] or ["spirob" if self.spirob else "section"]
        spans = zip(keys, pairwise([0.0, *(section.to for section in self._all_sections)]), strict=True)
        return [(key, at, at == start) for key, (start, end) in spans for at in (start, end)]

    @property
    def _all_sections(self) -> tuple[RodSection, ...]:
        """The sections; a uniform rod and a straightened spiral are a single one."""
        if self.sections is not None:
            return self.sections
        if self.spirob is not None:
            thickness = (self.spirob.base_thickness, self.spirob.tip_thickness)
            return (RodSection(to=self.length, thickness=thickness, width=self.spirob.width or thickness),)
        return (RodSection(to=self.length, **{key: getattr(self, key) for key in CrossSection.model_fields}),)

    def is_tip(self, at: float) -> bool:
        """Whether a position [m] is the tip, but for the rounding of sums of lengths."""
        return abs(at - self.length) <= 1e-9 * self.length

    def check_inside(self, key: str, positions: Iterable[float], *, tip: bool = True) -> None:
        """Refuse positions beyond the tip, but for the rounding of sums, or also those at it.

        ``key`` has {} for the number of each.
        """
        for k, at in enumerate(positions):
            if at > self.length * (1 + 1e-9) if tip else at >= self.length:
                words = "is beyond" if tip else "is not before the tip, at"
                raise InputError(f"{at} m {words} the finger's length of {self.length} m", key=key.format(k))

    @property
    def parted(self) -> bool:
        """Whether it is given by sections, samples or a spiral."""
        return any(getattr(self, key) is not None for key in _PARTS)

    @property
    def graded(self) -> bool:
        """Whether it is given as one that changes along its length."""
        return self.parted or any(isinstance(getattr(self, key), tuple) for key in CrossSection.model_fields)

    @property
    def one_modulus(self) -> bool:
        """Whether its bending stiffness is everywhere proportional to its ``youngs_modulus``."""
        left_open = ("youngs_modulus" in section.left_open for section in self.sections or ())
        return isinstance(self.youngs_modulus, float) and all(left_open)

    @property
    def own_rest_curvature(self) -> bool:
        """Whether its sections or samples give a rest curvature."""
        if self.samples is not None:
            return self.samples.rest_curvature is not None
        return any(section.rest_curvature is not None for section in self.sections or ())

    @property
    def mass_per_length(self) -> float:
        """Mass per length rho A [kg/m], at the base."""
        return float(self.profile.linear_density(0.0))

    @property
    def stiffness(self) -> float:
        """Bending stiffness E I [N m2], at the base."""
        return float(self.profile.bending_stiffness(0.0))

    @property
    def inertia_per_length(self) -> float:
        """Rotary inertia per length rho I [kg m], at the base."""
        return float(self.profile.rotary_inertia(0.0))

    @property
    def mass(self) -> float:
        """Mass of the whole rod [kg]."""
        return self.profile.linear_density.integral()

    @property
    def natural_time(self) -> float:
        """Time sqrt(m L^3 / E I) of the rod's mass and its stiffness at the base [s]: 0.56 of the first period of a
        uniform one.
        """
        return math.sqrt(self.mass * self.length**3 / self.stiffness)

    @property
    def slow_time(self) -> float:
        """Time in which what happens is slow for the finger [s]: some periods of its sway, 0.5 s of the hand finger.

        A command that takes as long does not make it swing, and after it a setpoint is met, or a bound left.
        """
        # 6.5: natural times, 3.6 periods of a uniform rod
        return 6.5 * self.natural_time

    @property
    def least_force(self) -> float:
        """Size that a force counts with where none is asked for, and least scale of goals [N].

        5 E I / L^2: 0.9 N of the hand finger.
        """
        return 5.0 * self.stiffness / self.length**2

    @cached_property
    def profile(self) -> Profile:
        """Stiffness, mass, rest curvature and thickness along its length."""
        from continuum_grasp.scene.profile import of_samples, of_sections

        if self.samples is not None:
            profile = of_samples(self.length, self.samples)
        else:
            whole = (
                section.model_copy(update={k: getattr(self, k) for k in section.left_open})
                for section in self._all_sections
            )
            profile = of_sections(self.length, [*whole])
        if self.spirob is not None:
            stiffness = profile.bending_stiffness.scaled(self.spirob.core**3)
            profile = replace(
                profile, bending_stiffness=stiffness, half_depth=profile.half_thickness.scaled(self.spirob.core)
            )
        scaled = {key: getattr(profile, key).scaled(factor) for key, factor in self.factors}
        return replace(profile, graded=self.graded, **scaled)
