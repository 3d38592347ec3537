"""Pressure and friction of touching surfaces, as expressions of gap, velocities and friction states.

Normal force: K. H. Hunt, F. R. E. Crossley, Coefficient of restitution interpreted as damping in vibroimpact,
J. Appl. Mech. 42 (1975), doi:10.1115/1.3423596, with a linear spring whose onset is rounded. Friction: an elastic
displacement with return to the cone, after P. Dupont, V. Hayward, B. Armstrong, F. Altpeter, Single state elastoplastic
friction models, IEEE Trans. Automat. Contr. 47 (2002), doi:10.1109/TAC.2002.1000274, here for one or two directions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from continuum_grasp.base import InputError, addons, named_value
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import ContactLaw, Rod

_SPRINGS_BACK = 0.2
"""Greatest slip per displacement and per time of the contact at which friction springs back, so that an object that
swings slowly in a hand does not creep [1]. It is also the share of friction that an open contact forgets in this time:
115 and 364 per second on pads of 2 and 20 N/mm."""


_ROUNDINGS = 18000.0
"""Lengths of the rounding of the onset in the finger's length, by default [1]: 10 um of 180 mm."""
_DISPLACEMENTS = 1800.0
"""Displacements before slip in the length of a finger, by default [1]: 0.1 mm of 180 mm."""


@dataclass(frozen=True)
class TouchLaw:
    """Forces of surfaces that touch, by a contact law; parameters that the law omits have the scale of a finger's
    rod.
    """

    law: ContactLaw
    rod: Rod

    @cached_property
    def time(self) -> float:
        """Time of one radian of the oscillation of the rod's mass on the contact's spring [s]: 0.6 ms for 6 g, 20
        N/mm.
        """
        return math.sqrt(self.rod.mass / self.law.stiffness)

    @property
    def rounding(self) -> float:
        """Gap at the onset of the force, and least depth with a linear force [m]."""
        return self.rod.length / _ROUNDINGS if self.law.rounding is None else self.law.rounding

    @property
    def displacement(self) -> float | None:
        """Displacement before slip [m]; None where friction has no state."""
        # A friction force that is a function of the slip speed alone needs no state.
        if self.law.slip_speed is not None:
            return None
        return self.rod.length / _DISPLACEMENTS if self.law.presliding is None else self.law.presliding

    def normal_force(self, gap: Scalar, gap_rate: Scalar) -> Scalar:
        """Normal force [N], zero or positive, of a gap [m], negative where the surfaces overlap, and its rate [m/s]."""
        # The spring's slope rises smoothly, as 3 t^2 - 2 t^3, over a gap from +rounding to -rounding: derivatives for
        # implicit steps and optimizers stay continuous.
        law, rounding = self.law, self.rounding
        t, beyond = self._onset(gap)
        depth = 2.0 * rounding * t**3 * (1.0 - 0.5 * t) + beyond
        if law.dissipation == 0.0:
            return law.stiffness * depth
        # Hunt and Crossley: dissipation in proportion to the depth, so no force jumps at the touch; no pull at the
        # release.
        return law.stiffness * depth * ca.fmax(0.0, 1.0 - law.dissipation * gap_rate)

    def stored_energy(self, gap: Scalar) -> Scalar:
        """Energy of the spring in normal direction [J]."""
        rounding = self.rounding
        t, beyond = self._onset(gap)
        return self.law.stiffness * (
            (2.0 * rounding) ** 2 * t**4 * (0.25 - 0.1 * t) + beyond * (0.5 * beyond + rounding)
        )

    def _onset(self, gap: Scalar) -> tuple[ca.SX, ca.SX]:
        """Share of the onset, 0 to 1, and the depth beyond it [m]."""
        rounding = self.rounding
        t = ca.fmin(ca.fmax((0.5 / rounding) * (rounding - gap), 0.0), 1.0)
        return ca.SX(t), ca.SX(ca.fmax(-gap - rounding, 0.0))

    def friction_share(self, z: Sequence[Scalar], v: Sequence[Scalar]) -> list[Scalar]:
        """Friction force per direction, as a share of the limit: a vector of size up to one that points with the slip.

        Friction states ``z`` [1] and slip ``v`` [m/s] have an entry per direction; there are no states with a slip
        speed.
        """
        law = self.law
        # Without states: Coulomb's law rounded off at the slip speed, which creeps under any load.
        if self.displacement is None:
            size = ca.sqrt(_square(v) + (law.slip_speed**2 if law.slip_speed else 0.0))
            return [each / size for each in v]
        if law.dissipation == 0.0:
            return list(z)
        elastic = self._elastic_velocity(z, v)
        damped = [each + law.dissipation * rate for each, rate in zip(z, elastic, strict=True)]
        # The elastic displacement is damped by the coefficient of the normal direction; the sum must not leave the
        # cone.
        size = ca.sqrt(ca.fmax(1.0, _square(damped)))
        return [each / size for each in damped]

    def viscous_friction(self, pressed: Scalar, v: Sequence[Scalar]) -> list[Scalar]:
        """Force of a film between the surfaces against slip v [m/s], per direction [N]; none where the law has no
        film.
        """
        return [self.law.viscous * pressed * each for each in v] if self.law.viscous else []

    def friction_rate(self, gap: Scalar, z: Sequence[Scalar], v: Sequence[Scalar]) -> list[Scalar]:
        """Rates of the friction states [1/s].

        While the surfaces touch, z' = (v - lost z) / displacement. At a slow slip, lost is b(|z|) max(0, v.z), where b
        rises smoothly from 0 at half the cone to 1 on it: below half the contact springs back, whatever shakes it. At a
        fast one it is |v|, so that the state is linear in z, and takes the contact's time at least to turn. Either way
        z stays in the unit disc and turns into the direction of a steady slip. An open contact forgets.
        """
        displacement, rounding = self.displacement, self.rounding
        if displacement is None:
            return []
        # Zero at a gap of three times the rounding, and 1 wherever a force acts.
        near = ca.fmin(ca.fmax((0.5 / rounding) * (3.0 * rounding - gap), 0.0), 1.0)
        touching = near * near * (3.0 - 2.0 * near)
        fast, speed = self._fast(v)
        # One displacement of slip turns the state at any slow speed; a fast one takes at least the contact's time: the
        # rate of the states would otherwise grow with the speed of slip, and set the step of explicit integrators.
        pace = touching / (displacement + self.time * fast * speed)
        # An open contact forgets its tangential displacement, so that it touches without a stale force.
        fade = (1.0 - touching) * (_SPRINGS_BACK / self.time)
        elastic = self._elastic_velocity(z, v)
        return [pace * rate - fade * each for each, rate in zip(z, elastic, strict=True)]

    def _elastic_velocity(self, z: Sequence[Scalar], v: Sequence[Scalar]) -> list[Scalar]:
        """Part of the slip that goes into the elastic displacement [m/s]."""
        # 0.5: share of the cone up to which friction is elastic: a contact that bears less does not creep, however it
        # is shaken, and above it the onset of slip is smooth
        low = 0.5**2
        t = ca.fmin(ca.fmax((_square(z) - low) / (1.0 - low), 0.0), 1.0)
        outward = sum(a * b for a, b in zip(z, v, strict=True))
        fast, speed = self._fast(v)
        # b(|z|) max(0, v.z): only slip that loads the contact further is lost.
        slow_loss = t * t * (3.0 - 2.0 * t) * ca.fmax(0.0, outward)
        lost = slow_loss + fast * (speed - slow_loss)
        return [b - lost * a for a, b in zip(z, v, strict=True)]

    def _fast(self, v: Sequence[Scalar]) -> tuple[Scalar, Scalar]:
        """Whether a slip is fast, from 0 to 1, and its speed [m/s]."""
        # Fourth powers: a sharp but smooth switch that needs no root of the speed. Slower ones spring back without
        # loss below the elastic share: a held object that swings slowly does not creep.
        limit = _SPRINGS_BACK * (self.displacement or 0.0) / self.time
        square = _square(v)
        fourth = square * square
        return fourth / (fourth + limit**4), self.speed_of(v)

    def speed_of(self, v: Sequence[Scalar]) -> Scalar:
        """Speed of a slip v [m/s] by direction, differentiable at rest [m/s]."""
        # 1e-9: of the speed that passes the rounding in the contact's time: far below any slip that matters
        return ca.sqrt(_square(v) + (1e-9 * self.rounding / self.time) ** 2)


def touch_law_of(law: ContactLaw, rod: Rod) -> TouchLaw:
    """Return the contact law of a finger with this rod: our own, or the law of an add-on.

    InputError if no installed add-on has it.
    """
    if law.law is None:
        return TouchLaw(law, rod)
    known = {name: place for addon in addons().values() for name, place in addon.contact_laws.items()}
    if law.law not in known:
        there = ", ".join(known) or "no add-on has one"
        raise InputError(f"no installed add-on provides the law {law.law!r:.60} ({there})", key="contact_law.law")
    found: TouchLaw = named_value(known[law.law])(law, rod)
    return found


def _square(values: Sequence[Scalar]) -> Scalar:
    return sum(value * value for value in values)
