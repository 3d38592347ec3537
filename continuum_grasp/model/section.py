"""Cross-sections of a finger without elements: their numbers along the finger, for stages of exact rods."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from continuum_grasp.base import Array
from continuum_grasp.model.laws import laws_of
from continuum_grasp.model.parameters import Parameters
from continuum_grasp.model.pieces import DEGREE, CurvePiece, pieces_of
from continuum_grasp.model.section_form import SectionForm, antiderivative, law_with, numbers_of_law, polynomial
from continuum_grasp.model.tendon_friction import SlidingSet, sliding_sets
from continuum_grasp.scene import Finger

ROUNDING = 0.05
"""Width of the rounded corners of the direction of friction [1]. IPOPT needs second derivatives; a sharp corner changes
the least tension that moves a tip by 2e-5 (`tests/model/test_stage.py`, the nonlinear problem)."""


@dataclass(frozen=True)
class SectionPull:
    """A tension [N] or a pressure [Pa] that acts on a finger, as an unknown p from 0 to ``most``.

    ``p + least`` is the moment of a tendon at the base, or of a chamber along it, in units of the finger.
    """

    least: float
    most: float
    unit: float  # tension or pressure per p [N, Pa]
    channel: int  # whose shape the moment has
    side: float  # sign of the moment
    tendons: int | None  # set of tendons that slide alike

    def value(self, p: Any) -> Any:
        """Tension [N] or pressure [Pa] of an unknown; numbers, arrays or expressions."""
        return self.unit * (self.least + p)


@dataclass(frozen=True)
class Section:
    """The sections of one finger: a form, and its numbers on each piece.

    Places are from 0 at the base to 1 at the tip. Units are the finger's length [m], ``force`` [N], and ``moment``
    [N m]; masses are forces per m/s^2. On a piece, every curve is a polynomial of the distance from its start.
    """

    form: SectionForm
    length: float
    stiffness: float  # B0 [N m2], of the rod itself at the base
    pieces: tuple[CurvePiece, ...]
    pulls: tuple[SectionPull, ...]
    tip_mass: float  # masses at the tip, which no piece has
    tip_arms: tuple[float, float]  # mass of the body at the tip times where its center is: across and along
    rest_slides: tuple[float, ...]  # per set, length that the unloaded shape draws in, per arm [rad]
    _numbers: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, finger: Finger, *, rounding: float = ROUNDING, paths: bool = False) -> Section:
        """Make the sections of a finger.

        Parameters
        ----------
        finger
            Rod, tendons, chambers, masses and laws. Its base pose, its damping in motion and what tensions shorten it
            by have no effect here.
        rounding
            Width of the corners of the direction of friction [1]; 0: sharp ones.
        paths
            Whether tendons without friction have states of their paths, too: locked ones retain their lengths.
        """
        return _Making(finger, rounding, paths).section

    @property
    def key(self) -> str:
        """Name of the form: sections of the same key share all symbolic functions."""
        return self.form.key

    @property
    def moment(self) -> float:
        """Unit of moments [N m]."""
        return self.stiffness / self.length

    @property
    def force(self) -> float:
        """Unit of forces [N]."""
        return self.moment / self.length

    @property
    def places(self) -> tuple[float, ...]:
        """Ends of the pieces, from 0 to 1."""
        return (0.0, *(piece.end for piece in self.pieces))

    @property
    def mass(self) -> float:
        """Mass of the finger with all point masses and the body at the tip, as a force per m/s^2."""
        return float(self.form.at(1.0, self._numbers[-1]).mass) + self.tip_mass

    def piece_at(self, s: float) -> int:
        """Return the piece on which a place lies; at an end, the one on the base side."""
        return min(int(np.searchsorted(self.places[1:], s)), len(self.pieces) - 1)

    def numbers(self, piece: int) -> Array:
        """Return the numbers (m,) of a stage on a piece, in units of the finger."""
        return np.array(self._numbers[piece])

    def half_thickness(self, piece: int) -> Array:
        """Return the coefficients (5,) of half the outer thickness on a piece, per length."""
        coefficients = self.pieces[piece].polynomials[-1]
        return np.array([*coefficients, *[0.0] * (DEGREE + 1 - len(coefficients))])

    @property
    def pulled(self) -> Array:
        """History of a finger that its drives pulled one way from its unloaded shape: h = 1 and z = 0."""
        return np.array([1.0, *[0.0] * (len(self.form.history_names) - 1)])


class _Making:
    """The numbers of a finger in its own units."""

    def __init__(self, finger: Finger, rounding: float, paths: bool) -> None:
        self._finger, self._rounding, profile = finger, rounding, finger.profile
        self._length, self._stiffness = profile.length, profile.own_stiffness
        self._moment = self._stiffness / self._length
        self._per_mass = self._length**2 / self._stiffness
        parameters = Parameters(finger, (0.0, 0.0), (self._length,), ())
        # Laws that damp or relax exert nothing at rest.
        self._laws = [law for law in laws_of(finger, parameters) if law.kind in ("elastic", "friction")]
        self._apart = finger.tendon_channels(apart=True)
        alike = sliding_sets(self._apart, finger.tendon_list, frictional=False)
        # Winches ask for the paths of tendons without friction, too.
        self._sets = [each for each in alike if each.has_friction or finger.winches or paths]

    @cached_property
    def _pulls(self) -> tuple[SectionPull, ...]:
        channels, pulls = self._finger.channels, []
        for k, (least, most, channel, arm) in enumerate(self._finger.pulls):
            amplitude = channel.gain * arm
            unit, side = self._moment / abs(amplitude), 1.0 if amplitude > 0.0 else -1.0
            tendons = next((j for j, each in enumerate(self._sets) if k in each.tendons), None)
            pulls.append(SectionPull(least / unit, (most - least) / unit, unit, channels.index(channel), side, tendons))
        return tuple(pulls)

    @cached_property
    def _masses(self) -> list[tuple[float, float]]:
        """Places [m] and masses of the point masses before the tip."""
        is_tip, masses = self._finger.rod.is_tip, self._finger.masses
        return sorted((each.at, each.mass * self._per_mass) for each in masses if not is_tip(each.at))

    @cached_property
    def _pieces(self) -> tuple[CurvePiece, ...]:
        profile, length = self._finger.profile, self._length
        curves = [
            profile.bending_stiffness.scaled(1.0 / self._stiffness),
            profile.rest_curvature.scaled(length),
            profile.linear_density.scaled(length * self._per_mass),
            *(channel.shape for channel in self._finger.channels),
            *(curve.scaled(length) for law in self._laws for curve in law.own),
            profile.half_thickness.scaled(1.0 / length),
        ]
        return pieces_of(length, curves, dict.fromkeys(at for at, _ in self._masses))

    @cached_property
    def _form(self) -> SectionForm:
        used = zip(*(piece.polynomials[:-1] for piece in self._pieces), strict=True)
        return SectionForm(
            tuple(DEGREE if any(len(polynomial) > 1 for polynomial in curve) else 0 for curve in used),
            tuple((pull.channel, pull.side, pull.tendons) for pull in self._pulls),
            tuple((self._pulls[each.tendons[0]].channel, each.has_friction) for each in self._sets),
            tuple(replace(law_with(law, iter([0.0] * len(numbers_of_law(law)))), own=()) for law in self._laws),
            tuple(len(law.own) for law in self._laws),
            self._rounding,
        )

    def _of_set(self, tendons: SlidingSet) -> tuple[float, float, float]:
        """Friction, slide w per presliding, and bend of the conduit of a set."""
        first = tendons.tendons[0]
        arm = abs(self._apart[first].arms[first])
        return self._finger.tendon_list[first].friction, arm / tendons.presliding, tendons.conduit_bend

    def _numbers(self) -> Iterator[tuple[float, ...]]:
        units = {"N m2": self._stiffness, "N m": self._moment, "1": 1.0}
        of_laws = [float(value) / units[unit] for law in self._laws for value, unit in numbers_of_law(law)]
        of_sets = [number for each in self._sets for number in self._of_set(each)]
        after = (*of_laws, *of_sets, *(pull.least for pull in self._pulls))
        spread = 0.0
        for piece in self._pieces:
            # 1e-9: share of the length by which a place may be rounded
            points = sum(mass for at, mass in self._masses if at <= (piece.start + 1e-9) * self._length)
            curves = zip(piece.polynomials, self._form.degrees, strict=False)
            padded = [c for curve, degree in curves for c in (*curve, *[0.0] * (degree + 1 - len(curve)))]
            yield piece.start, spread + points, *padded, *after
            spread += float(polynomial(antiderivative(piece.polynomials[2]), piece.end - piece.start))

    @property
    def section(self) -> Section:
        """The sections of the finger."""
        finger, form = self._finger, self._form
        at_tip = [mass.mass for mass in finger.masses if finger.rod.is_tip(mass.at)]
        body, arms = finger.tip_body, (0.0, 0.0)
        if body is not None:
            at_tip.append(body.mass)
            across, along = (body.mass * self._per_mass * offset / self._length for offset in body.center_of_mass)
            arms = across, along
        slides = tuple(sum(_slide(piece, channel) for piece in self._pieces) for channel, _ in form.sets)
        numbers = tuple(self._numbers())
        tip = sum(at_tip) * self._per_mass
        return Section(form, self._length, self._stiffness, self._pieces, self._pulls, tip, arms, slides, numbers)


def _slide(piece: CurvePiece, channel: int) -> float:
    """Integral over a piece of the rest curvature times the shape of a channel."""
    rest, shape = (Polynomial(piece.polynomials[k]) for k in (1, 3 + channel))
    return float((rest * shape).integ()(piece.end - piece.start))
