"""The finger: rod, damping, masses, tendons, base pose."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from operator import attrgetter
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field

from continuum_grasp.base import InputError
from continuum_grasp.scene.consumer import FIT_MATCHED_TIP, SECTION_LAWS, Consumer
from continuum_grasp.scene.drives import ONSET, DriveLaw, Input, LengthDrive, MotorDrive, Pull, numbered
from continuum_grasp.scene.graded import PiecewiseCurvature, Varying, ends
from continuum_grasp.scene.loads import Actuation, Samples
from continuum_grasp.scene.methods import FAMILIES
from continuum_grasp.scene.rod import Damping, Rod
from continuum_grasp.scene.tendons import (
    MOST_SLOPE,
    AnyTendons,
    Chamber,
    ChamberList,
    Tendon,
    Tendons,
    channels,
    one_sided,
    two_lags,
)
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import (
    Angle,
    Distance,
    Length,
    ListOf,
    Mass,
    NonNegative,
    Position,
    Positive,
    Real,
    Value,
    check_shorter,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from continuum_grasp.base import Array
    from continuum_grasp.scene.profile import Channel, Curve, Profile

_AT_ONCE = 1e-3
"""Least relaxation time of a material per natural time of the finger [1]; a material that relaxes faster only damps."""


class PointMass(Value):
    """A point mass on the backbone."""

    at: Distance
    """Position along the finger [m]."""
    mass: Mass
    """Mass [kg]."""


class TipBody(Value):
    """A rigid body fastened to the tip."""

    mass: Annotated[float, Field(ge=1e-12, le=1e12), Unit("kg")]
    """Mass [kg]."""
    rotary_inertia: Annotated[NonNegative, Unit("kg m2")] = 0.0
    """Moment of inertia about its center of mass [kg m2]."""
    center_of_mass: Position = (0.0, 0.0)
    """Center of mass in the axes of the tip's section [m]: X across, Y along, from the tip on."""


class Stops(Value):
    """Links that touch where the finger is bent far: beyond a curvature it is stiffer."""

    curvature: Varying[Annotated[Positive, Unit("1/m")]] | None = None
    """Curvature at which links touch [1/m], a magnitude, or its values at base and tip. None: the curvature that closes
    the gaps of ``rod.spirob``."""
    stiffness_ratio: Annotated[float, Field(gt=1.0, le=1e6, examples=[50.0]), Unit("1")]
    """Bending stiffness beyond it per that before it [1]."""
    side: Literal["both", "left", "right"] = "both"
    """Side of the finger with stops: left, against bending towards -X (positive curvature); right, against the
    other."""

    @property
    def signs(self) -> tuple[float, ...]:
        """Signs of the curvatures that are stopped."""
        return {"both": (1.0, -1.0), "left": (1.0,), "right": (-1.0,)}[self.side]


class Softening(Value):
    """A material that softens under a strong bend, such as superelastic and printed ones, and unloads on the same
    curve.

    The bending moment is EI (k - (1 - ratio) c(k)), with the change k of the curvature since rest. Here c is the part
    of k beyond ``curvature``, rounded off there; both directions are alike.
    """

    curvature: Varying[Annotated[Positive, Unit("1/m")]]
    """Change of curvature since rest at which the material softens [1/m], a magnitude, or its values at base and
    tip."""
    stiffness_ratio: Annotated[float, Field(ge=0.01, lt=1.0, examples=[0.2]), Unit("1")]
    """Bending stiffness beyond it per that before it [1]."""
    rounding: Annotated[float, Field(ge=0.001, le=2.0), Unit("1")] = 0.1
    """Width of the transition per ``curvature`` [1]."""


class BasePose(Value):
    """Pose of the clamped base in the world; the undeformed finger points along the base's Y axis."""

    position: Position = (0.0, 0.0)
    """World position of the base [m]."""
    angle: Annotated[Angle, Field(examples=[-1.5707963267948966, "-90 deg"])] = 0.0
    """Angle from world axes to base axes, counter-clockwise [rad]."""

    @property
    def pose(self) -> tuple[float, float, float]:
        """World x, y [m] and angle [rad]."""
        return *self.position, self.angle


class Finger(Value):
    """A tendon-driven continuum finger."""

    REFUSALS = Consumer.refusals(
        """
        stops.curvature with rod.spirob: follows from the gaps of the spirob
        strain_limit without rod.profile.half_depth: needs rod.diameter, or a thickness of a graded rod
        rest_curvature with rod.own_rest_curvature: rod has it
        gyration_radius without tendons: needs tendons, whose tensions shorten the rod
        gyration_radius with tendons.{drive,friction,time_constant}:
            needs tensions as they are commanded, all along the tendons: leave drive, friction and time_constant out
        tendons.drive with two_kinds: all tendons of a finger need the same kind of drive, input and arrangement
        tendons.time_constant with two_lags:
            must be that of tendons that run alike: their moments add up before they lag
        tendons.drive_order with two_orders: must be that of all tendons
        tendons.drive.arrangement=one_pulley with no_two: one_pulley needs two tendons
        tendons.drive.arrangement=one_pulley with unlike(friction): one_pulley needs tendons with the same friction
        tendons.drive.arrangement=one_pulley with unlike(axial_stiffness):
            one_pulley needs tendons with the same axial_stiffness
        tendons.drive.arrangement=one_pulley with unlike(series_stiffness):
            one_pulley needs tendons with the same series_stiffness
        tendons.drive.arrangement=one_pulley with unlike(to): one_pulley needs tendons with the same to
        tendons.drive.arrangement=one_pulley with unlike(drive): one_pulley needs tendons with the same drive
        tendons.drive.arrangement=one_pulley with one_sided: one_pulley needs tendons at equal distances on both
            sides: it winds up the one by as much as it pays out the other
        """,
        two_kinds=lambda f: len({t.drive and (t.drive.key, t.drive.arrangement) for t in f.tendon_list}) > 1,
        two_lags=lambda f: two_lags(f.tendon_list, f.rod.length),
        two_orders=lambda f: len({tendon.drive_order for tendon in f.tendon_list}) > 1,
        no_two=lambda f: len(f.tendon_list) != 2,
        one_sided=lambda f: one_sided(f.tendon_list),
        unlike=lambda f, name: len({getattr(tendon, name) for tendon in f.tendon_list}) > 1,
    )

    rod: Rod
    """The elastic rod that the finger is."""
    damping: Damping = Damping()
    """Dissipation in the bending of the finger."""
    rest_curvature: Annotated[Real, Unit("1/m")] | PiecewiseCurvature = 0.0
    """Curvature of the unloaded finger [1/m], positive towards -X."""
    half_thickness: Annotated[Distance | None, Field(examples=[0.006, "6 mm"])] = None
    """Half the outer thickness [m], where contacts touch; by default half the thickness of the rod's section."""
    strain_limit: Annotated[float, Field(ge=1e-9, lt=1.0, examples=[0.06, "6 %"]), Unit("1")] | None = None
    """Greatest bending strain of the rod [1], 0.06 for 6 %; needs the thickness of the rod's section."""
    masses: ListOf[PointMass] = ()
    """Point masses in addition to the rod's own mass."""
    tip_body: TipBody | None = None
    """A body fastened to the tip; None: none."""
    stops: Stops | None = None
    """Stops of the finger's links; None: no stops."""
    softening: Softening | None = None
    """Softening of the material under a strong bend; None: the material is linear."""
    gyration_radius: Annotated[Length | None, Field(examples=[0.0015, "1.5 mm"])] = None
    """Radius of gyration of the rod's section at the base [m]: a quarter of the diameter of a round section, 0.289 of
    the thickness of a rectangle. It determines how far tendon tensions shorten the rod, and varies along the finger
    like the thickness. None: the rod keeps its length."""
    tendons: AnyTendons | None = None
    """A pair of tendons at equal distances on both sides, or a list of single ones; None: none."""
    pressure: Chamber | ChamberList | None = None
    """A pressure chamber, or a list of chambers, which may act together with tendons; None: none. Without tendons and
    chambers the input is the tip moment itself."""
    base: BasePose = BasePose()
    """Position and direction of the clamped base."""

    def _check(self) -> None:
        length, half = self.rod.length, self.half_thickness
        self.rod.check_inside("masses[{}].at", (mass.at for mass in self.masses))
        check_shorter("half_thickness", half or 0.0, length)
        if isinstance(self.rest_curvature, PiecewiseCurvature):
            self.rod.check_inside("rest_curvature.breaks[{}]", self.rest_curvature.breaks, tip=False)
        # Only the mass of a rod with a stated density reveals the user's unit.
        for k, m in enumerate(self.masses if self.rod.density is not None else ()):
            if m.mass > 1e3 * self.rod.mass:
                rod_mass = f"{self.rod.mass:.2g} kg"
                self._doubt(
                    f"masses[{k}].mass", f"= {m.mass:g} kg on a rod of {rod_mass}; is it in grams? (expected: kg)"
                )

        self._check_tendons()
        for key, chamber in zip(self.places_of("pressure"), self.chambers, strict=True):
            check_shorter(f"{key}.offset", chamber.offset, length)
            self.rod.check_inside(f"{key}.start", [chamber.start], tip=False)
            self.rod.check_inside(f"{key}.to", [chamber.to or 0.0])
        for k, branch in enumerate(self.damping.relaxation):
            if branch.time < _AT_ONCE * self.rod.natural_time:
                viscous = branch.share * self.rod.stiffness * branch.time
                raise ValueError(
                    f"damping.relaxation[{k}].time is {branch.time:g} s where the finger takes "
                    f"{self.rod.natural_time:.2g} s for its slowest motion: it relaxes at once; "
                    f"add {viscous:.3g} N m2 s to damping.material in its place"
                )
        if self.stops is not None:
            self._check_stops(self.stops)

    def _check_stops(self, stops: Stops) -> None:
        if stops.curvature is None and self.rod.spirob is None:
            raise ValueError("stops.curvature is needed: only a rod.spirob implies it by its shape")
        limit, rest = self.stop_curvature, self.profile.rest_curvature
        if limit is None or rest.constant == 0.0:
            return
        # Both are monotone between the edges of their pieces.
        for at, tip_side, sign in product(sorted((*rest.edges, *limit.edges)), (False, True), stops.signs):
            least, bent = float(limit(at, tip_side=tip_side)), float(rest(at, tip_side=tip_side))
            if sign * bent >= least:
                raise ValueError(
                    f"stops: at {at:g} m along the finger they touch from {sign * least:g} 1/m on, which is not "
                    f"beyond the rest curvature of {bent:g} 1/m"
                )

    def _check_tendons(self) -> None:
        # The second tendon of a pair is the mirror image of the first.
        for key, tendon in zip(self.places_of("tendons"), self.tendon_list, strict=False):
            self.rod.check_inside(f"{key}.to", [tendon.to or 0.0])
            key, offset, half = f"{key}.offset", tendon.greatest_offset, self.half_thickness
            check_shorter(key, offset, self.rod.length)
            if tendon.friction and offset and (slides := tendon.presliding_length) > offset:
                raise ValueError(
                    f"{key.removesuffix('offset')}presliding is {slides:g} m, more than the tendon slides "
                    f"({offset:g} m) where its finger bends by one radian"
                )
            if (slope := abs(tendon.slope(self.rod.length))) > MOST_SLOPE:
                raise ValueError(
                    f"{key} changes by {slope:.2g} per length, more than {MOST_SLOPE}: the law of the moment holds for "
                    "tendons that are nearly parallel to the backbone"
                )
            if half is not None and 0.0 < half < offset:
                self._doubt(
                    key, f"= {offset:g} m is more than half_thickness = {half:g} m: the tendons run outside the finger"
                )
            # By default, the outer thickness of a graded rod is the thickness of its sections.
            if half is None and self.rod.graded and self.rod.profile.half_depth is not None:
                self._check_inside_thickness(key, tendon)

    def _check_inside_thickness(self, key: str, tendon: Tendon) -> None:
        """Refuse a tendon that runs outside the finger; both are monotone between the edges of pieces."""
        half, to = self.profile.half_thickness, tendon.end(self.rod.length)
        shape, first = tendon.shape(self.rod.length), ends(tendon.offset)[0]
        for at in sorted([0.0, to, *(at for at in half.edges if at < to)]):
            offset = abs(first * float(shape(at)))
            least = min(float(half(at)), float(half(at, tip_side=at < to)))
            if offset > least * (1 + 1e-9):
                raise ValueError(
                    f"{key}: {offset:.4g} m at {at:g} m along the finger is more than half its thickness there, "
                    f"{least:.4g} m; with guides outside the rod, give half_thickness too"
                )

    @property
    def thickness_radius(self) -> float:
        """Greatest half of the outer thickness [m]."""
        return self.profile.half_thickness.most()

    @property
    def curvature_limit(self) -> float:
        """Greatest curvature that the strain limit allows everywhere [1/m]; infinite without a limit."""
        depth = self.profile.half_depth
        # Euler-Bernoulli: the strain of the outermost fiber is curvature times radius.
        return math.inf if self.strain_limit is None or depth is None else self.strain_limit / depth.most()

    def curvature_limit_at(self, s: ArrayLike) -> Array:
        """Greatest curvature that the strain limit allows at positions [m], of their shape [1/m]; infinite without."""
        import numpy as np

        depth, at = self.profile.half_depth, np.asarray(s, dtype=float)
        if self.strain_limit is None or depth is None:
            return np.full(at.shape, np.inf)
        return np.asarray(self.strain_limit / np.maximum(depth(at), depth(at, tip_side=True)))

    @cached_property
    def profile(self) -> Profile:
        """The rod along its length, with the finger's rest curvature and thickness."""
        from continuum_grasp.scene.profile import Curve, summed

        profile, length = self.rod.profile, self.rod.length
        half = profile.half_thickness if self.half_thickness is None else Curve.along(length, self.half_thickness)
        rest = Curve.along(length, self.rest_curvature) if self.rest_curvature else profile.rest_curvature
        profile = replace(profile, rest_curvature=rest, half_thickness=half)
        walls = [chamber.along(length, chamber.stiffness_share, 0.0) for chamber in self.chambers]
        if not any(chamber.stiffness_share for chamber in self.chambers):
            return profile
        added = summed(length, [Curve.along(length, 1.0), *walls])
        stiffness = profile.bending_stiffness.times(added)
        graded = profile.graded or stiffness.constant is None
        return replace(profile, bending_stiffness=stiffness, added=added, graded=graded)

    @cached_property
    def stop_curvature(self) -> Curve | None:
        """Curvature at which links touch [1/m], a magnitude; None without stops."""
        from continuum_grasp.scene.profile import Curve, touching

        if self.stops is None:
            return None
        if self.stops.curvature is not None:
            return Curve.along(self.rod.length, self.stops.curvature)
        return None if self.rod.spirob is None else touching(self.rod.length, self.rod.spirob)

    @cached_property
    def tendon_list(self) -> tuple[Tendon, ...]:
        """The single tendons: the list's, or the two of a pair, first the one on the -X side."""
        if not isinstance(self.tendons, Tendons):
            return self.tendons or ()
        entries, offset = dict(self.tendons), self.tendons.offset
        return tuple(Tendon(**{**entries, "offset": side * offset}) for side in (1.0, -1.0))

    @cached_property
    def chambers(self) -> tuple[Chamber, ...]:
        """The pressure chambers."""
        return (self.pressure,) if isinstance(self.pressure, Chamber) else self.pressure or ()

    @property
    def has_tendon_friction(self) -> bool:
        """Whether the tendons have friction."""
        return any(tendon.friction > 0.0 for tendon in self.tendon_list)

    @property
    def has_friction(self) -> bool:
        """Whether tendons or bending have friction, so that a shape depends on how it was reached."""
        return self.has_tendon_friction or bool(self.damping.dry_friction)

    @property
    def winches(self) -> tuple[LengthDrive | MotorDrive, ...]:
        """Winches and motors of the tendons, those on one pulley once; none where tensions are commanded."""
        winches = tuple(tendon.drive for tendon in self.tendon_list if tendon.drive is not None)
        return winches[:1] if winches and winches[0].arrangement == "one_pulley" else winches

    @property
    def drive_law(self) -> DriveLaw | None:
        """Drives of the first tendon and the one opposite, at rest; None where tensions are commanded."""
        tendon = self.tendon_list[0]
        if tendon.drive is None or tendon.axial_stiffness is None or tendon.series_stiffness is None:
            return None
        axial = tendon.end(self.rod.length) / tendon.axial_stiffness
        return DriveLaw(tendon.drive, 1.0 / tendon.series_stiffness, axial, self.onset(tendon))

    @property
    def drives_keep_position(self) -> bool:
        """Whether the drives keep their position while tensions change: winches, and motors under a position servo."""
        law = self.drive_law
        return bool(self.winches) if law is None else law.locks

    def natural_tension(self, tendon: Tendon) -> float:
        """Tension of a tendon that bends a rod by one radian that is as stiff all along as at the base [N]."""
        return self.rod.stiffness / (self.rod.length * tendon.greatest_offset)

    def onset(self, tendon: Tendon) -> float:
        """Half the change of length between a slack tendon on a winch and a tendon in tension [m]."""
        return ONSET * self.natural_tension(tendon) * tendon.compliance(self.rod.length)

    @cached_property
    def inputs(self) -> tuple[Input, ...]:
        """The inputs, as the model has them: the tip moment, or inputs of drives or tensions, then pressures."""
        limits = [(drive.key, -drive.limit, drive.limit) for drive in self.winches]
        limits = limits or [("tensions", tendon.min_tension, tendon.max_tension) for tendon in self.tendon_list]
        limits += [("pressures", chamber.min_pressure, chamber.max_pressure) for chamber in self.chambers]
        return numbered(limits or [("tip_moment", -math.inf, math.inf)])

    @property
    def input_keys(self) -> tuple[str, ...]:
        """Key of each input in ``actuation``."""
        return tuple(finger_input.key for finger_input in self.inputs)

    def actuated(self, commands: Sequence[Any]) -> dict[str, Any]:
        """Keys and values of an ``actuation`` by a command for each input."""
        return Actuation.by_key(self.input_keys, commands)

    @property
    def input_words(self) -> str:
        """Number and names of its inputs, for messages."""
        counts = Counter(self.input_keys)
        return "the tip moment" if "tip_moment" in counts else " and ".join(f"{n} {key}" for key, n in counts.items())

    @property
    def free_tip_reasons(self) -> tuple[str, ...]:
        """Features that a matched tip, whose bending under an input is known beforehand, cannot carry; in words."""
        winches, tip = self.winches, self.tip_body
        laws = (key for key in SECTION_LAWS if key not in FIT_MATCHED_TIP)
        why = {
            "tendon friction": self.has_tendon_friction,
            f"tendons with drive.kind: {winches[0].kind if winches else ''}": winches,
            "pressures that follow by a first-order lag": self.lagging_pressures,
            "tensions that follow by a first-order lag": self.drive_order == 1,
            **{SECTION_LAWS[key]: attrgetter(key.removeprefix("finger."))(self) for key in laws},
            "a body at the tip that turns with it": tip and (tip.rotary_inertia or any(tip.center_of_mass)),
        }
        return tuple(word for word, there in why.items() if there)

    @property
    def usual_family(self) -> str:
        """Default family of curvature of the finger's models."""
        return FAMILIES.default(free_tip=bool(self.free_tip_reasons))

    @property
    def moves_with_free_tip(self) -> bool:
        """Whether motions leave the curvature at the tip free where no family is stated."""
        # Quadratic damping holds the section at the tip back from where its moment alone would bend it: two matched
        # clothoids of 0.3 m are 10 mm off where a tendon bends them against 1e-4 N m3 s2, two free ones 0.01 mm.
        return bool(self.free_tip_reasons or self.damping.quadratic)

    @property
    def drive_order(self) -> int:
        """Order of the lag of commanded tensions, if they have one."""
        return min((tendon.drive_order for tendon in self.tendon_list), default=2)

    @property
    def lagging_pressures(self) -> bool:
        """Whether pressures of chambers follow late, by a lag of first order: rates of their moments jump."""
        return any(chamber.time_constant is not None for chamber in self.chambers)

    def check_commands(
        self,
        key: str,
        values: Sequence[float | Samples],
        limits: Sequence[tuple[float, float]],
        allowed: str = "the limits of the input, {:g} to {:g}",
    ) -> None:
        """Refuse commands, at a key, that are not as many as there are limits, or beyond these."""
        if len(values) != len(limits):
            raise ValueError(f"{key}: expected {self.input_words}, got {len(values)} numbers")
        for k, (command, (least, greatest)) in enumerate(zip(values, limits, strict=True)):
            for value in command.values if isinstance(command, Samples) else (command,):
                if not least <= value <= greatest:
                    raise ValueError(f"{key}[{k}] = {value:g} is outside {allowed.format(least, greatest)}")

    def check_family(self, key: str, family: str, runtime: str = "") -> None:
        """Refuse a curvature family, stated at ``key``, that cannot bend as the finger does.

        ``runtime`` names run-time arguments of a model that the family cannot carry.
        """
        if FAMILIES[family].matches_tip and (runtime or self.free_tip_reasons):
            free = " or ".join(name for name in reversed(FAMILIES) if not FAMILIES[name].matches_tip)
            what = f"{runtime or self.free_tip_reasons[0]} (the moment at the tip then depends on the whole motion)"
            raise InputError(f"{family} cannot carry {what}: use {free}", key=key)

    def with_tendons(self, **changes: Any) -> Self:
        """Return a copy of the finger with changes of every tendon; a finger without tendons is returned unchanged."""
        return self._with_each(lambda tendon: tendon.replaced(**changes))

    def with_drives(self, changed: Callable[[Any], Any]) -> Self:
        """A copy of the finger with changes of the drive of every tendon, if there are tendons."""
        return self._with_each(lambda tendon: tendon.replaced(drive=changed(tendon.drive)))

    def _with_each(self, changed: Callable[[Any], Any]) -> Self:
        tendons = self.tendons
        if isinstance(tendons, tuple):
            return self.replaced(tendons=tuple(map(changed, tendons)))
        return self if tendons is None else self.replaced(tendons=changed(tendons))

    def with_lags(self, time_constant: float | None) -> Self:
        """A copy whose tensions and pressures lag by a time constant [s]; None: they follow at once."""
        order = 2 if time_constant is None else self.drive_order
        changed = self.with_tendons(time_constant=time_constant, drive_order=order)
        return changed.replaced(pressure=tuple(c.replaced(time_constant=time_constant) for c in self.chambers) or None)

    def places_of(self, key: str) -> tuple[str, ...]:
        """Paths to the entries of a key that may hold one or several: tendons, pressure."""
        entries = getattr(self, key)
        if isinstance(entries, tuple):
            return tuple(f"{key}[{k}]" for k in range(len(entries)))
        return () if entries is None else (key,)

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """Bending moments of tendons and chambers."""
        length, tendons, none = self.rod.length, len(self.tendon_list), (0.0,) * len(self.chambers)
        of_tendons = (replace(channel, arms=channel.arms + none) for channel in channels(length, self.tendon_list))
        return (
            *of_tendons,
            *(chamber.channel(length, tendons + k, tendons + len(none)) for k, chamber in enumerate(self.chambers)),
        )

    def tendon_channels(self, *, apart: bool) -> tuple[Channel, ...]:
        """The moments of the tendons, one per shape, or ``apart`` one per tendon."""
        return channels(self.rod.length, self.tendon_list, apart=apart)

    @property
    def pulls(self) -> tuple[Pull, ...]:
        """Limits of each tendon's tension, then of each chamber's pressure, with its channel and arm."""
        limits = [(tendon.min_tension, tendon.max_tension) for tendon in self.tendon_list]
        limits += [(chamber.min_pressure, chamber.max_pressure) for chamber in self.chambers]
        places = (
            next((channel, channel.arms[k]) for channel in self.channels if channel.arms[k]) for k in range(len(limits))
        )
        return tuple(Pull(*limit, *place) for limit, place in zip(limits, places, strict=True))
