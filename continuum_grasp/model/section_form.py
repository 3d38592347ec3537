"""Expressions of the cross-sections of a finger: the curvature under a moment, and the losses of the tendons.

These expressions know neither elements nor stages. They take the same laws, tendons and friction as the elements do:

    B(s) (k + sum of SectionLaw.moment(k)) = M + sum over pulls of side shape(s) (p + least) exp(-side l)

k is the curvature above the one at rest, M the moment that the part beyond s exerts, and p the moment of a pull at the
base above its least one. Per set of tendons that slide alike, with the total curvature kappa,

    l' = mu d rounded(kappa),  w' = -shape k,  w(L) = 0,  d = clip(z + h w arm / presliding),

where exp(-l) is the share of the drive's tension that arrives at s, and ``w arm`` is how far the tendon has slid there
since the unloaded shape. ``z`` and ``h`` state the history (``Memory``).

All is in units of the finger: length L, moment B0 / L, force B0 / L^2, with the bending stiffness B0 of the rod itself
at the base. Gravity stays in m/s^2, so that a mass has the unit of force per m/s^2.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import islice
from typing import Any

import casadi as ca

from continuum_grasp.model.laws.section import Bend, SectionLaw
from continuum_grasp.model.memory import Memory
from continuum_grasp.model.planar import Scalar, column
from continuum_grasp.model.tendon_friction import rounded

NEWTON = 12
"""Newton steps from a moment to a curvature [1], before the two that have derivatives; `tests/model/test_section.py`
measures what they leave."""
_GRID = 2.0**36
"""Inverse of the rounding of a curvature times the length before the last two Newton steps [1]: 1e-11."""


def scalars(values: Any) -> list[Scalar]:
    """Entries of a column of CasADi, or of a sequence of numbers."""
    return [values[k] for k in range(values.numel())] if hasattr(values, "numel") else list(values)


def polynomial(coefficients: Sequence[Scalar], at: Scalar) -> Scalar:
    """Value of a polynomial by its coefficients, the constant first."""
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = value * at + coefficient
    return value


def antiderivative(coefficients: Sequence[Scalar]) -> list[Scalar]:
    """Coefficients of the integral of a polynomial from zero on."""
    return [0.0, *(c / (k + 1) for k, c in enumerate(coefficients))]


def numbers_of_law(law: SectionLaw) -> list[tuple[Scalar, str]]:
    """Numbers of a law with their units, in the order of `law_with`."""
    numbers = list[tuple[Scalar, str]]()
    for name, units in law.units.items():
        value = getattr(law, name)
        if isinstance(units, str):
            numbers.append((value, units))
        else:
            numbers += [pair for branch in value for pair in zip(branch, units, strict=True)]
    return numbers


def law_with(law: SectionLaw, entries: Iterator[Scalar]) -> SectionLaw:
    """The law with other numbers, which are taken from ``entries``."""
    fields = dict[str, Any]()
    for name, units in law.units.items():
        if isinstance(units, str):
            fields[name] = next(entries)
        else:
            fields[name] = tuple(tuple(next(entries) for _ in units) for _ in getattr(law, name))
    return replace(law, **fields)


@dataclass(frozen=True)
class SectionPlace:
    """Numbers of a section at a place."""

    stiffness: Scalar
    rest: Scalar  # curvature
    mass: Scalar  # from the base to the place
    shapes: Sequence[Scalar]  # of the moment of each channel
    own: Sequence[Sequence[Scalar]]  # per law


@dataclass(frozen=True)
class _Numbers:
    """Numbers of a piece by their meaning, in their order."""

    start: Scalar
    mass: Scalar  # before the start
    curves: Sequence[Sequence[Scalar]]  # coefficients
    laws: Sequence[SectionLaw]
    tendons: Sequence[tuple[Scalar, ...]]  # per set friction, slide per presliding, bend of the conduit
    least: Sequence[Scalar]  # per pull


@dataclass(frozen=True)
class SectionForm:
    """A section without its numbers: sections of equal forms share all symbolic functions.

    ``degrees`` belong to the polynomials of the stiffness, the rest curvature, the mass per length, the shape of each
    channel, and the curves of each law.
    """

    degrees: tuple[int, ...]
    pulls: tuple[tuple[int, float, int | None], ...]  # channel, side, set of each
    sets: tuple[tuple[int, bool], ...]  # channel of each, and whether it has friction
    laws: tuple[SectionLaw, ...]  # all their numbers are zero
    curves: tuple[int, ...]  # of each law
    rounding: float

    @property
    def key(self) -> str:
        """A short name, the same for equal forms in every process."""
        return hashlib.sha1(repr(self).encode()).hexdigest()[:12]

    # -- layout ---------------------------------------------------------------------------------------------------

    @property
    def sliding_names(self) -> tuple[str, ...]:
        """States of the tendons in their order: the loss l of each set with friction, then its slide w."""
        names = [[f"loss_{k}"] * friction + [f"slide_{k}"] for k, (_, friction) in enumerate(self.sets, start=1)]
        return tuple(name for of_set in names for name in of_set)

    @property
    def history_names(self) -> tuple[str, ...]:
        """Entries of a history: h, then z of each set with friction and of each branch of dry friction."""
        tendons = [f"z_{k}" for k, (_, friction) in enumerate(self.sets, start=1) if friction]
        return ("moved", *tendons, *(name for law in self.laws for name in law.names(1)))

    @property
    def size(self) -> int:
        """Count of the numbers of a piece."""
        of_laws = sum(len(numbers_of_law(law)) for law in self.laws)
        return 2 + sum(degree + 1 for degree in self.degrees) + of_laws + 3 * len(self.sets) + len(self.pulls)

    def _split(self, numbers: Any) -> _Numbers:
        entries = iter(scalars(numbers))
        return _Numbers(
            next(entries),
            next(entries),
            [list(islice(entries, degree + 1)) for degree in self.degrees],
            [law_with(law, entries) for law in self.laws],
            [tuple(islice(entries, 3)) for _ in self.sets],
            list(entries),
        )

    # -- expressions ----------------------------------------------------------------------------------------------

    def at(self, s: Scalar, numbers: Any) -> SectionPlace:
        """Evaluate the curves at a place on the piece that has the numbers."""
        known = self._split(numbers)
        distance = s - known.start
        stiffness, rest, _, *values = (polynomial(curve, distance) for curve in known.curves)
        mass = known.mass + polynomial(antiderivative(known.curves[2]), distance)
        channels = len(values) - sum(self.curves)
        own = iter(values[channels:])
        return SectionPlace(stiffness, rest, mass, values[:channels], [list(islice(own, n)) for n in self.curves])

    def _slides(self, sliding: Any) -> Iterator[tuple[Scalar, Scalar]]:
        """Loss of each set, zero without friction, and its slide."""
        entries = iter(scalars(sliding))
        for _, friction in self.sets:
            yield (next(entries) if friction else 0.0), next(entries)

    def load(self, place: SectionPlace, moment: Scalar, pulls: Any, sliding: Any, numbers: Any) -> Scalar:
        """Add the moments of the pulls at a place to the moment that the part beyond it exerts."""
        grown = [
            ca.exp(loss) if friction else 1.0
            for (loss, _), (_, friction) in zip(self._slides(sliding), self.sets, strict=True)
        ]
        for (channel, side, tendons), p, least in zip(
            self.pulls, scalars(pulls), self._split(numbers).least, strict=True
        ):
            tension = p + least
            if tendons is not None and self.sets[tendons][1]:
                tension = tension / grown[tendons] if side > 0.0 else tension * grown[tendons]
            moment = moment + side * place.shapes[channel] * tension
        return moment

    def curvature(
        self, s: Scalar, moment: Scalar, pulls: Any, sliding: Any, numbers: Any, history: Any
    ) -> tuple[Scalar, Scalar]:
        """Compute the curvature at a place above the one at rest, and the total curvature."""
        place = self.at(s, numbers)
        bend = self.bent(place, self.load(place, moment, pulls, sliding, numbers), numbers, history)
        return bend, place.rest + bend

    def bent(self, place: SectionPlace, load: Scalar, numbers: Any, history: Any) -> Scalar:
        """Compute the curvature above the one at rest, under a load."""
        ratio = load / place.stiffness
        if not self.laws:
            return ratio
        own = [value for of_law in place.own for value in of_law]
        given = [place.rest, column(own), column(scalars(numbers)), column(scalars(history))]
        start, bounded, newton = _inverse(self)
        bend, low, high = start(ratio, *given)
        for _ in range(NEWTON):
            bend, low, high = bounded(bend, low, high, ratio, *given)
        # The derivative of a floor is zero: all derivatives pass through the last two steps alone. These have the exact
        # first and second ones, since a Newton step from a solution does not depend on where it starts.
        bend = ca.floor(_GRID * bend) / _GRID
        for _ in range(2):
            bend = newton(bend, ratio, *given)
        return bend

    def resisting(self, bend: Scalar, rest: Scalar, own: Sequence[Scalar], numbers: Any, history: Any) -> Scalar:
        """Compute the moment against a curvature above the one at rest, per stiffness of the section."""
        moved, *states = scalars(history)
        left = iter(states[sum(friction for _, friction in self.sets) :])
        values, total = iter(own), bend
        memory = Memory(1.0, moved, rounding=self.rounding)
        for law, count in zip(self._split(numbers).laws, self.curves, strict=True):
            seen = Bend(bend, rest, 0.0, memory, list(islice(values, count)), [next(left) for _ in law.names(1)])
            total = total + law.moment(seen)
        return total

    def _directions(self, slides: Sequence[Scalar], states: Sequence[Scalar], moved: Scalar) -> list[Scalar]:
        return Memory(1.0, moved, rounding=self.rounding).ways(states, lambda: slides, eased=True)

    def sliding_rates(
        self, place: SectionPlace, bend: Scalar, sliding: Any, numbers: Any, history: Any
    ) -> list[Scalar]:
        """Compute the derivatives of the states of the tendons along the finger, by the curvature above rest."""
        moved, *states = scalars(history)
        left, rates = iter(states), list[Scalar]()
        for (channel, friction), (mu, per_slide, _), (_, slide) in zip(
            self.sets, self._split(numbers).tendons, self._slides(sliding), strict=True
        ):
            if friction:
                (way,) = self._directions([per_slide * slide], [next(left)], moved)
                rates.append(mu * way * rounded(bend + place.rest, 1.0))
            rates.append(-1.0 * place.shapes[channel] * bend)
        return rates

    def first_losses(self, sliding: Any, numbers: Any, history: Any) -> list[Scalar]:
        """Compute the loss of each set with friction where it enters the finger: its conduit causes it.

        The friction states z of this history belong to the conduits.
        """
        moved, *states = scalars(history)
        left, losses = iter(states), list[Scalar]()
        for (_, friction), (mu, per_slide, conduit), (_, slide) in zip(
            self.sets, self._split(numbers).tendons, self._slides(sliding), strict=True
        ):
            if friction:
                (way,) = self._directions([per_slide * slide], [next(left)], moved)
                losses.append(mu * conduit * way)
        return losses


@cache
def _inverse(form: SectionForm) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Functions that find the curvature above rest that resists a moment per stiffness.

    The first one starts: it gives a curvature and two bounds of the solution. The second one takes a Newton step and
    moves the bounds closer; a step that leaves the bounds goes to their middle. The third one takes a Newton step.
    """
    names = "bend", "low", "high", "ratio", "rest"
    bend, low, high, ratio, rest = (ca.SX.sym(name) for name in names)
    own, numbers = ca.SX.sym("own", sum(form.curves)), ca.SX.sym("numbers", form.size)
    history = ca.SX.sym("history", len(form.history_names))
    given = [rest, own, numbers, history]
    moment = form.resisting(bend, rest, scalars(own), numbers, history)
    missing, slope = ratio - moment, ca.gradient(moment, bend)
    step = bend + missing / slope
    below, above = ca.if_else(missing < 0.0, low, bend), ca.if_else(missing > 0.0, high, bend)
    inside = ca.logic_and(step >= below, step <= above)
    halved = ca.if_else(inside, step, 0.5 * (below + above))
    # The moment rises by slopes between these.
    slopes = [law.slopes for law in form._split(numbers).laws]
    least, greatest = (sum(bounds, 1.0) for bounds in zip(*slopes, strict=True))
    left = ratio - ca.substitute(moment, bend, 0.0)
    ends = left / least, left / greatest
    return (
        ca.Function("start", [ratio, *given], [ends[1], ca.fmin(*ends), ca.fmax(*ends)]),
        ca.Function("bounded", [bend, low, high, ratio, *given], [halved, below, above]),
        ca.Function("newton", [bend, ratio, *given], [step]),
    )
