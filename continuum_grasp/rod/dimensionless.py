"""The rod of a scene at time zero in dimensionless numbers: lengths per L, forces per EI / L^2, moments per EI / L."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.scene.loads import ForceLoad, Load, Samples, VectorSamples
from continuum_grasp.scene.simulate import Scene

__all__ = ["RodProblem", "read_problem"]

_SAME_PLACE = 1e-9
"""Places nearer to each other than this share of the length are one."""


@dataclass(frozen=True)
class RodProblem:
    """A clamped rod and its loads; planar vectors are complex numbers x + i y in the world's axes.

    Attributes
    ----------
    length : float
        L [m].
    stiffness : float
        EI [N m2].
    base : complex
        World position of the clamp [m].
    angle : float
        World angle of the clamp [rad]; the tangent at the angle psi is i exp(i psi).
    breaks : tuple of float
        Places where something jumps, from 0 to 1.
    weight : complex
        Weight per length.
    dead : tuple of (float, complex)
        Places and values of forces whose direction is fixed, weights of point masses among them.
    following : tuple of (float, complex)
        Places and values (across + i along) of forces that turn with their section.
    couples : tuple of (float, float)
        Places and values of couples, without that of the actuation.
    drive : float
        Tip moment of the actuation.
    friction : float
        Capstan coefficient [1].
    rest : tuple of (float, float, float)
        Start, end and rest curvature of each piece.
    """

    length: float
    stiffness: float
    base: complex
    angle: float
    breaks: tuple[float, ...]
    weight: complex
    dead: tuple[tuple[float, complex], ...]
    following: tuple[tuple[float, complex], ...]
    couples: tuple[tuple[float, float], ...]
    drive: float
    friction: float
    rest: tuple[tuple[float, float, float], ...]

    @property
    def conservative(self) -> bool:
        """Whether all loads have a potential."""
        return not self.following and (self.friction == 0.0 or self.drive == 0.0)


def read_problem(scene: Scene, extra_loads: Sequence[Load] = ()) -> RodProblem:
    """The rod of a scene with the values of loads and inputs at time zero.

    Parameters
    ----------
    scene : Scene
        Its ``fidelity``, ``contacts``, ``parameters``, ``initial`` and ``time`` say nothing about the rod's statics.
    extra_loads : sequence of loads
        Loads that act besides the scene's.

    Returns
    -------
    RodProblem

    Raises
    ------
    InputError
        If an extra load is beyond the tip.
    """
    finger, rod = scene.finger, scene.finger.rod
    length, stiffness = rod.length, rod.stiffness
    force, moment = length**2 / stiffness, length / stiffness
    gravity = complex(*scene.gravity)
    dead: list[tuple[float, complex]] = []
    following: list[tuple[float, complex]] = []
    couples: list[tuple[float, float]] = []
    if gravity != 0.0:
        dead += [(m.at / length, m.mass * gravity * force) for m in finger.masses]
    for k, load in enumerate((*scene.loads, *extra_loads)):
        if load.at > length * (1 + 1e-12):
            raise InputError(f"extra_loads[{k - len(scene.loads)}].at = {load.at} m is beyond the tip at {length} m")
        if isinstance(load, ForceLoad):
            value = complex(*_at_zero(load.force)) * force
            (following if load.follows else dead).append((load.at / length, value))
        else:
            couples.append((load.at / length, _at_zero(load.moment)[0] * moment))
    rest = tuple((a / length, b / length, k * length) for a, b, k in finger.curvature_pieces)
    breaks = _distinct([at for at, _ in (*dead, *following, *couples)] + [a for a, _, _ in rest])

    def snapped(at: float) -> float:
        return min(breaks, key=lambda edge: abs(edge - at))

    return RodProblem(
        length=length,
        stiffness=stiffness,
        base=complex(*finger.base.position),
        angle=finger.base.angle,
        breaks=breaks,
        weight=rod.mass_per_length * gravity * length * force,
        dead=tuple((snapped(at), value) for at, value in dead if value != 0.0),
        following=tuple((snapped(at), value) for at, value in following if value != 0.0),
        couples=tuple((snapped(at), value) for at, value in couples if value != 0.0),
        drive=_tip_moment(scene) * moment,
        friction=finger.tendons.friction if finger.tendons is not None else 0.0,
        rest=tuple((snapped(a), snapped(b), k) for a, b, k in rest),
    )


def _tip_moment(scene: Scene) -> float:
    """Moment of the actuation at time zero [N m]; equation (42) for tendons."""
    actuation, tendons = scene.actuation, scene.finger.tendons
    if actuation is None:
        return 0.0
    if actuation.tensions is not None and tendons is not None:
        first, second = (_at_zero(tension)[0] for tension in actuation.tensions)
        return (first - second) * tendons.offset
    return 0.0 if actuation.tip_moment is None else _at_zero(actuation.tip_moment)[0]


def _distinct(places: Sequence[float]) -> tuple[float, ...]:
    """Places inside (0, 1) in order, with both ends."""
    edges = [0.0]
    for at in sorted(places):
        if at > edges[-1] + _SAME_PLACE and at < 1.0 - _SAME_PLACE:
            edges.append(at)
    return (*edges, 1.0)


def _at_zero(value: float | tuple[float, float] | Samples | VectorSamples) -> tuple[float, ...]:
    """Entries of a value at time zero."""
    if isinstance(value, Samples):
        return (_sampled(value.times, value.values, value.interpolation == "smooth"),)
    if isinstance(value, VectorSamples):
        smooth = value.interpolation == "smooth"
        return tuple(_sampled(value.times, row, smooth) for row in zip(*value.values, strict=True))
    return value if isinstance(value, tuple) else (float(value),)


def _sampled(times: Sequence[float], values: Sequence[float], smooth: bool) -> float:
    """A sampled function at time zero: a polygon, or the quintic through both ends with their slopes, unaccelerated.

    The slopes are those of F. N. Fritsch and J. Butland (1984, doi:10.1137/0905021), none at either end.
    """
    if times[0] >= 0.0 or times[-1] <= 0.0 or not smooth:
        return float(np.interp(0.0, times, values))
    steps, rises = np.diff(times), np.diff(values)
    k = int(np.searchsorted(times, 0.0, side="right")) - 1

    def slope(j: int) -> float:
        if j == 0 or j == len(times) - 1:
            return 0.0
        before, after = rises[j - 1] / steps[j - 1], rises[j] / steps[j]
        if before * after <= 0.0:
            return 0.0
        share = (steps[j - 1] + 2.0 * steps[j]) / (3.0 * (steps[j - 1] + steps[j]))
        mean = before * after / (share * after + (1.0 - share) * before)
        return float(np.sign(mean) * min(abs(mean), 2.0 * abs(before), 2.0 * abs(after)))

    x, start, end = -times[k] / steps[k], slope(k) * steps[k], slope(k + 1) * steps[k]
    # Hermite basis of fifth degree without second derivatives at the ends.
    rise = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    first, second = x - x**3 * (6.0 - 8.0 * x + 3.0 * x**2), -(x**3) * (4.0 - 7.0 * x + 3.0 * x**2)
    return float(values[k] + rise * rises[k] + first * start + second * end)
