"""The rod of a scene at time zero in dimensionless numbers: lengths per L, forces per EI / L^2, moments per EI / L."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.rod.dense_rod import with_places
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.loads import ForceLoad, Load, Samples, VectorSamples
from continuum_grasp.scene.simulate import Scene


@dataclass(frozen=True)
class RodProblem:
    """A clamped rod and its loads; planar vectors are complex numbers x + i y in the world's axes.

    Loads are (place, value), places from 0 to 1.
    """

    length: float  # L [m]
    stiffness: float  # EI [N m2]
    base: complex  # world position of the clamp [m]
    angle: float  # world angle of the clamp [rad]; the tangent at the angle psi is i exp(i psi)
    breaks: tuple[float, ...]  # places where something jumps
    weight: complex  # per length
    dead: tuple[tuple[float, complex], ...]  # of a fixed direction, weights of point masses among them
    following: tuple[tuple[float, complex], ...]  # that turn with their section: across + i along
    couples: tuple[tuple[float, float], ...]  # without that of the actuation
    drive: float  # tip moment of the actuation
    friction: float  # capstan coefficient [1]
    rest: tuple[tuple[float, float, float], ...]  # start, end and rest curvature of each piece

    @property
    def conservative(self) -> bool:
        """Whether all loads have a potential."""
        return not self.following and (self.friction == 0.0 or self.drive == 0.0)

    @classmethod
    def of(
        cls,
        finger: Finger,
        gravity: complex,
        *,
        base: tuple[complex, float] | None = None,
        dead: Sequence[tuple[float, complex]] = (),
        following: Sequence[tuple[float, complex]] = (),
        couples: Sequence[tuple[float, float]] = (),
        tip_moment: float = 0.0,
        marks: Sequence[float] = (),
    ) -> RodProblem:
        """The problem in dimensionless numbers, of SI ones; weights of the finger's point masses are added.

        ``base`` is the world position [m] and angle [rad] of the clamp, the finger's where not given; ``marks`` are
        further places [m] at which panels are to end.
        """
        rod, length = finger.rod, finger.rod.length
        force, moment = length**2 / rod.stiffness, length / rod.stiffness
        if gravity != 0.0:
            dead = [*((m.at, m.mass * gravity) for m in finger.masses), *dead]
        pieces = finger.curvature_pieces
        places = [*(at for at, _ in (*dead, *following, *couples)), *(a for a, _, _ in pieces), *marks]
        breaks = with_places((0.0, 1.0), sorted(at / length for at in places))

        # Places that are nearly the same become the same number: loads are compared with nodes between them.
        def placed(at: float) -> float:
            return float(breaks[np.abs(breaks - at / length).argmin()])

        position, angle = (complex(*finger.base.position), finger.base.angle) if base is None else base
        return cls(
            length=length,
            stiffness=rod.stiffness,
            base=position,
            angle=angle,
            breaks=tuple(breaks.tolist()),
            weight=rod.mass_per_length * gravity * length * force,
            dead=tuple((placed(at), value * force) for at, value in dead if value != 0.0),
            following=tuple((placed(at), value * force) for at, value in following if value != 0.0),
            couples=tuple((placed(at), value * moment) for at, value in couples if value != 0.0),
            drive=tip_moment * moment,
            friction=finger.tendon_pair.friction if finger.tendon_pair is not None else 0.0,
            rest=tuple((placed(a), placed(b), k * length) for a, b, k in pieces),
        )


def read_problem(scene: Scene, extra_loads: Sequence[Load] = ()) -> RodProblem:
    """The rod of a scene with the values of loads and inputs at time zero, and further loads."""
    length = scene.finger.rod.length
    dead: list[tuple[float, complex]] = []
    following: list[tuple[float, complex]] = []
    couples: list[tuple[float, float]] = []
    for k, load in enumerate((*scene.loads, *extra_loads)):
        if load.at > length * (1 + 1e-12):
            raise InputError(f"extra_loads[{k - len(scene.loads)}].at = {load.at} m is beyond the tip at {length} m")
        if isinstance(load, ForceLoad):
            (following if load.follows else dead).append((load.at, complex(*_at_zero(load.force))))
        else:
            couples.append((load.at, _at_zero(load.moment)[0]))
    return RodProblem.of(
        scene.finger,
        complex(*scene.gravity),
        dead=dead,
        following=following,
        couples=couples,
        tip_moment=_tip_moment(scene),
    )


def _tip_moment(scene: Scene) -> float:
    """Moment of the actuation at time zero [N m]; equation (42) for tendons."""
    actuation, tendons = scene.actuation, scene.finger.tendon_pair
    if actuation is None:
        return 0.0
    if actuation.tensions is not None and tendons is not None:
        first, second = (_at_zero(tension)[0] for tension in actuation.tensions)
        return (first - second) * tendons.offset
    return 0.0 if actuation.tip_moment is None else _at_zero(actuation.tip_moment)[0]


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
    from scipy.interpolate import BPoly, PchipInterpolator

    slopes = PchipInterpolator(times, values).derivative()(times)
    rises = 2.0 * np.abs(np.diff(values) / np.diff(times))
    slopes[1:-1] = np.sign(slopes[1:-1]) * np.minimum(np.abs(slopes[1:-1]), np.minimum(rises[:-1], rises[1:]))
    slopes[[0, -1]] = 0.0
    return float(BPoly.from_derivatives(times, np.stack([values, slopes, np.zeros_like(slopes)], axis=1))(0.0))
