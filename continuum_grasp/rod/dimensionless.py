"""The rod of a scene at time zero in dimensionless numbers: lengths per L, forces per EI / L^2, moments per EI / L.

EI is one number: of a rod whose stiffness changes along it the harmonic mean, with which a couple at the tip turns the
tip as far as that of the uniform rod.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.rod.dense_rod import Mesh, panel_edges, with_places
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.loads import ForceLoad, Load, Samples, VectorSamples
from continuum_grasp.scene.profile import Curve, Profile
from continuum_grasp.scene.simulate import Scene

_PANELS, _NODES = 8, 16
"""Panels along the rod and their nodes, for means along it: exact to rounding unless a panel tapers to a tenth."""


@dataclass(frozen=True)
class RodProblem:
    """A clamped rod and its loads; planar vectors are complex numbers x + i y in the world's axes.

    Loads are (place, value), places from 0 to 1.
    """

    length: float  # L [m]
    stiffness: float  # EI [N m2], the harmonic mean along the rod
    profile: Profile  # the rod along its length, in SI units
    base: complex  # world position of the clamp [m]
    angle: float  # world angle of the clamp [rad]; the tangent at the angle psi is i exp(i psi)
    breaks: tuple[float, ...]  # places where something jumps
    weight: complex  # of the rod without its masses
    dead: tuple[tuple[float, complex], ...]  # of a fixed direction, weights of bodies among them
    # Dead forces again whose points of action are off the backbone: place, distance in the section's axes, force.
    levers: tuple[tuple[float, complex, complex], ...]
    following: tuple[tuple[float, complex], ...]  # that turn with their section: across + i along
    couples: tuple[tuple[float, float], ...]
    # Moments of tendons: shape along the rod in SI units, amplitude, and capstan coefficient [1], negative for tendons
    # on the other side; of those without friction that run alike together.
    drives: tuple[tuple[Curve, float, float], ...]
    # Curvature from which on links touch, in SI units; signs of the curvatures that are stopped; stiffness added there.
    stops: tuple[Curve, tuple[float, ...], float] | None

    @property
    def conservative(self) -> bool:
        """Whether all loads have a potential."""
        return not self.following and not any(friction for *_, friction in self.drives)

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
        tensions: Sequence[float] | None = None,
        marks: Sequence[float] = (),
    ) -> RodProblem:
        """The problem in dimensionless numbers, of SI ones; weights of the finger's bodies are added.

        ``base`` is the world position [m] and angle [rad] of the clamp, the finger's where not given; ``tensions`` [N]
        are those of the finger's tendons, zero where not given; ``marks`` are further places [m] at which panels are to
        end.
        """
        profile, length = finger.profile, finger.profile.length
        mesh = Mesh(panel_edges((0.0, *profile.breaks, length), length / _PANELS), _NODES)
        stiffness = length / float(mesh.weights @ (1.0 / profile.bending_stiffness(mesh.nodes)))
        mass = float(mesh.weights @ profile.linear_density(mesh.nodes))
        force, moment = length**2 / stiffness, length / stiffness
        drives = [] if tensions is None else _drives(finger, tensions, moment)
        carried = [body for body in bodies(finger) if gravity != 0.0]
        dead = [*((body.at, body.mass * gravity) for body in carried), *dead]
        limit, stops = finger.stop_curvature, finger.stops
        places = [*(at for at, _ in (*dead, *following, *couples)), *profile.breaks, *marks]
        places += [at for shape, *_ in drives for at in shape.breaks]
        places += [] if limit is None else limit.breaks
        breaks = with_places((0.0, 1.0), sorted(at / length for at in places))

        # Places that are nearly the same become the same number: loads are compared with nodes between them.
        def placed(at: float) -> float:
            return float(breaks[np.abs(breaks - at / length).argmin()])

        position, angle = (complex(*finger.base.position), finger.base.angle) if base is None else base
        return cls(
            length=length,
            stiffness=stiffness,
            profile=profile,
            base=position,
            angle=angle,
            breaks=tuple(breaks.tolist()),
            weight=mass * gravity * force,
            dead=tuple((placed(at), value * force) for at, value in dead if value != 0.0),
            levers=tuple(
                (placed(body.at), body.lever / length, body.mass * gravity * force) for body in carried if body.lever
            ),
            following=tuple((placed(at), value * force) for at, value in following if value != 0.0),
            couples=tuple((placed(at), value * moment) for at, value in couples if value != 0.0),
            drives=tuple(drives),
            stops=None if limit is None or stops is None else (limit, stops.signs, stops.stiffness_ratio - 1.0),
        )


@dataclass(frozen=True)
class Body:
    """A mass fastened to a section."""

    at: float  # [m]
    mass: float  # [kg]
    lever: complex = 0.0  # from the backbone to its center of mass in the section's axes, across + i along [m]
    rotary_inertia: float = 0.0  # about the center of mass [kg m2]


def bodies(finger: Finger) -> list[Body]:
    """Point masses and the body at the tip."""
    found, tip = [Body(point.at, point.mass) for point in finger.masses], finger.tip_body
    if tip is not None:
        found.append(Body(finger.profile.length, tip.mass, complex(*tip.center_of_mass), tip.rotary_inertia))
    return found


def _drives(finger: Finger, tensions: Sequence[float], scale: float) -> list[tuple[Curve, float, float]]:
    """Moments of the tendons, of those with one shape and without friction together; amplitudes are scaled."""
    found = []
    for channel in finger.channels:
        pulls = [(arm * tension, arm) for arm, tension in zip(channel.arms, tensions, strict=True)]
        free = sum(pull for (pull, _), own in zip(pulls, finger.tendon_list, strict=True) if own.friction == 0.0)
        if free != 0.0:
            found.append((channel.shape, free * scale, 0.0))
        for (pull, arm), own in zip(pulls, finger.tendon_list, strict=True):
            if own.friction > 0.0 and pull != 0.0:
                side = math.copysign(own.friction, arm)
                found.append((channel.shape, pull * scale, side))
    return found


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
    actuation, tensions = scene.actuation, None
    if scene.finger.softening is not None:
        raise InputError("the exact rod knows a linear material, and stops: leave it out", key="finger.softening")
    if scene.finger.winches:
        raise InputError(
            "the exact rod knows commanded tensions alone: leave the drive out", key="finger.tendons.drive"
        )
    if actuation is not None and actuation.tip_moment is not None:
        couples.append((length, _at_zero(actuation.tip_moment)[0]))
    if actuation is not None and actuation.tensions is not None:
        tensions = [_at_zero(tension)[0] for tension in actuation.tensions]
    return RodProblem.of(
        scene.finger,
        complex(*scene.gravity),
        dead=dead,
        following=following,
        couples=couples,
        tensions=tensions,
    )


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
