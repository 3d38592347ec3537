"""Interface of a flexible link to the chain, whatever curvature it has.

A link is a piece of rod with a few bending coordinates of its own (its *local coordinates*). All vectors are in the
axes of its start section (X along the tangent there) and from its start. The derivative of a point with respect to a
bending coordinate is stored *before* its turn by a right angle: ``dr/dq = perp(arm)``, because the derivative of a
tangent is the tangent turned by 90 degrees. Scalar products of derivatives are then scalar products of arms, and no
sign ever has to be changed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from continuum_grasp.model.planar import ZERO, Rotation, Scalar, Vec


def is_end(fraction: Scalar) -> bool:
    """Whether a fraction of a link's length is a number that means its end section."""
    # A run-time fraction is an SX, whose comparison would be an expression.
    return isinstance(fraction, float) and fraction == 1.0


@dataclass(frozen=True)
class LinkSection:
    """A cross-section of a link; tuples have an entry per local coordinate."""

    position: Vec  # from the start of the link
    rotation: Rotation  # from the section's axes to the link's
    arms: tuple[Vec, ...]  # dr/dq = perp(arm)
    angles: tuple[Scalar, ...]  # derivative of the bending angle


@dataclass(frozen=True)
class Inertia:
    """Mass integrals of a link about its start; tuples have an entry per local coordinate."""

    mass: Scalar
    first: Vec  # integral of r dm
    second: Scalar  # integral of |r|^2 dm, and rotary inertia
    arms: tuple[Vec, ...]  # integral of arm dm
    swing: tuple[Scalar, ...]  # integral of r . arm dm (= r x dr/dq), and rotary inertia
    matrix: tuple[tuple[Scalar, ...], ...]  # integrals of arm_a . arm_b dm, and rotary inertia


@dataclass(frozen=True)
class Bias:
    """Integrals of a link's velocity-product acceleration, with the sign reversed (centripetal, towards the start)."""

    end: Vec  # at the end section
    force: Vec  # integral over dm
    moment: Scalar  # integral of r x ( ) dm
    generalized: tuple[Scalar, ...]  # per local coordinate: integral of dr/dq . ( ) dm


class Link(ABC):
    """A flexible link; see the module's text for its conventions."""

    @property
    @abstractmethod
    def end(self) -> LinkSection:
        """The end section."""

    @abstractmethod
    def section(self, fraction: Scalar) -> LinkSection:
        """The section at a fraction of the length, 0 at the start and 1 at the end."""

    @abstractmethod
    def bend(self, fraction: Scalar) -> Scalar:
        """Bending angle from the start to the section at a fraction of the length [rad]."""

    @property
    @abstractmethod
    def curvatures(self) -> list[Scalar]:
        """Curvature [1/m] at the ``places`` of the family, then wherever else it may be greatest."""

    @abstractmethod
    def section_bias(self, fraction: Scalar, omega: Scalar, rates: Sequence[Scalar]) -> Vec:
        """Reversed velocity-product acceleration of a section.

        ``omega`` is the angular velocity of the start section, ``rates`` are rates of the local coordinates.
        """

    @property
    @abstractmethod
    def inertia(self) -> Inertia:
        """Mass integrals of the link's rod."""

    @abstractmethod
    def bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Bias:
        """Velocity-product terms of the link's rod."""


class ShortenedLink(Link):
    """A link that keeps a share of its length; it bends as before, and what lies along it comes nearer.

    Its rotary inertia, some thousandths of the rest, is scaled as the squares of distances are.
    """

    def __init__(self, link: Link, share: Scalar) -> None:
        self._link, self._share = link, share

    def _of(self, section: LinkSection) -> LinkSection:
        arms = tuple(arm.scaled(self._share) for arm in section.arms)
        return replace(section, position=section.position.scaled(self._share), arms=arms)

    @cached_property
    def end(self) -> LinkSection:
        return self._of(self._link.end)

    def section(self, fraction: Scalar) -> LinkSection:
        return self._of(self._link.section(fraction))

    def bend(self, fraction: Scalar) -> Scalar:
        return self._link.bend(fraction)

    @property
    def curvatures(self) -> list[Scalar]:
        return self._link.curvatures

    def section_bias(self, fraction: Scalar, omega: Scalar, rates: Sequence[Scalar]) -> Vec:
        return self._link.section_bias(fraction, omega, rates).scaled(self._share)

    @cached_property
    def inertia(self) -> Inertia:
        inertia, square = self._link.inertia, self._share * self._share
        return Inertia(
            mass=inertia.mass,
            first=inertia.first.scaled(self._share),
            second=square * inertia.second,
            arms=tuple(arm.scaled(self._share) for arm in inertia.arms),
            swing=tuple(square * swing for swing in inertia.swing),
            matrix=tuple(tuple(square * entry for entry in row) for row in inertia.matrix),
        )

    def bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Bias:
        bias, square = self._link.bias(omega, rates), self._share * self._share
        return Bias(
            end=bias.end.scaled(self._share),
            force=bias.force.scaled(self._share),
            moment=square * bias.moment,
            generalized=tuple(square * force for force in bias.generalized),
        )


@dataclass(frozen=True)
class Attached:
    """A rigid body at a section, in the axes of that; without inertia and distance a point mass."""

    mass: Scalar  # [kg]
    rotary_inertia: Scalar = 0.0  # about its center of mass [kg m2]
    center: Vec = ZERO  # [m]


@dataclass(frozen=True)
class LoadedLink:
    """A link with the bodies that it carries, at fractions of its length."""

    link: Link
    attached: tuple[tuple[Scalar, Attached], ...] = ()

    def _bodies(self) -> Iterator[tuple[Scalar, Attached, LinkSection]]:
        """Return the fraction of each body's place, the body, and its center of mass as a section of the link."""
        for fraction, body in self.attached:
            section = self.link.section(fraction)
            lever = section.rotation.apply(body.center)
            arms = tuple(arm + lever.scaled(angle) for arm, angle in zip(section.arms, section.angles, strict=True))
            yield fraction, body, replace(section, position=section.position + lever, arms=arms)

    def inertia(self) -> Inertia:
        """Mass integrals with the bodies."""
        total = self.link.inertia
        for _, body, at in self._bodies():
            turned, here = body.rotary_inertia, list(zip(at.arms, at.angles, strict=True))
            r, arms = at.position.scaled(body.mass), [arm.scaled(body.mass) for arm in at.arms]
            total = Inertia(
                mass=total.mass + body.mass,
                first=total.first + r,
                second=total.second + r.dot(at.position) + turned,
                arms=tuple(a + b for a, b in zip(total.arms, arms, strict=True)),
                swing=tuple(s + r.dot(arm) + turned * turn for s, (arm, turn) in zip(total.swing, here, strict=True)),
                matrix=tuple(
                    tuple(m + pull.dot(arm) + turned * a * b for m, (arm, b) in zip(row, here, strict=True))
                    for row, pull, a in zip(total.matrix, arms, at.angles, strict=True)
                ),
            )
        return total

    def bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Bias:
        """Velocity-product terms with the bodies."""
        total = self.link.bias(omega, rates)
        for fraction, body, at in self._bodies():
            lever = self.link.section(fraction).rotation.apply(body.center)
            spin = sum((angle * rate for angle, rate in zip(at.angles, rates, strict=True)), omega)
            pulled = self.link.section_bias(fraction, omega, rates) + lever.scaled(spin * spin)
            force = pulled.scaled(body.mass)
            total = replace(
                total,
                force=total.force + force,
                moment=total.moment + at.position.cross(force),
                # perp(arm) . force = arm x force: why generalized forces are cross products of arms
                generalized=tuple(q + arm.cross(force) for q, arm in zip(total.generalized, at.arms, strict=True)),
            )
        return total
