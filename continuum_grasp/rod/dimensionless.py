"""The rod of a scene at time zero in dimensionless numbers: lengths per L, forces per EI / L^2, moments per EI / L.

EI is one number: of a rod whose stiffness changes along it the harmonic mean, with which a couple at the tip turns the
tip as far as on the uniform rod.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.rod.mesh import PanelMesh, panel_edges, with_places
from continuum_grasp.scene import (
    Consumer,
    Curve,
    Finger,
    ForceLoad,
    Load,
    MotorDrive,
    Profile,
    Samples,
    Scene,
    VectorSamples,
)

_PANELS, _NODES = 8, 16
"""Panels along the rod and their nodes, for means along it: exact to rounding unless a panel tapers to a tenth."""


class Cable(NamedTuple):
    """Elastic cable whose elongation makes the tension of a tendon that is wound up."""

    wound: float  # cable from where the straight rod has it just in tension [m]
    arm: float  # of its shape [m]
    series: float  # elongation per tension between drive and rod [m/N]
    elongation: float  # along the rod per its length [1/N]
    to: float  # where it ends, per the rod's length
    onset: float  # half the length in which it goes from slack to tension [m]


class TendonMoment(NamedTuple):
    """The bending moment of a tendon, or of some without friction that run alike."""

    shape: Curve  # along the rod in SI units
    amplitude: float  # where it has a cable: per newton of its tension
    friction: float = 0.0  # capstan coefficient [1], negative where it acts the other way
    conduit_bend: float = 0.0  # [rad]
    cable: Cable | None = None


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
    tendons: tuple[TendonMoment, ...]
    # Curvature from which on links touch, in SI units; signs of the curvatures that are stopped; stiffness added there.
    stops: tuple[Curve, tuple[float, ...], float] | None
    # Curvature at which tendons began to slide, in SI units; None: the unloaded rod's.
    slid_from: Callable[[Array], Array] | None = None

    @property
    def conservative(self) -> bool:
        """Whether all loads have a potential."""
        return not self.following and not self.has_friction

    @property
    def has_friction(self) -> bool:
        """Whether tendons have friction."""
        return any(tendon.friction for tendon in self.tendons)

    @property
    def loaded(self) -> bool:
        """Whether there are loads other than tendons and chambers."""
        return bool(self.weight or self.dead or self.levers or self.following or self.couples)

    @property
    def unpulled(self) -> RodProblem:
        """Return the rod under its loads, without tendons and chambers."""
        return replace(self, tendons=())

    def pulled(self, share: float) -> RodProblem:
        """Return the rod with a share [1] of what its tendons and chambers pull."""
        tendons = [
            each._replace(amplitude=share * each.amplitude)
            if each.cable is None
            else each._replace(cable=each.cable._replace(wound=share * each.cable.wound))
            for each in self.tendons
        ]
        return replace(self, tendons=tuple(tendons))

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
        wound: Sequence[float] | None = None,
        pressures: Sequence[float] | None = None,
        released: bool = False,
        marks: Sequence[float] = (),
    ) -> RodProblem:
        """The problem in dimensionless numbers, of SI ones; weights of the finger's bodies are added.

        ``base`` is the world position [m] and angle [rad] of the clamp, by default the finger's; ``tensions`` [N]
        belong to the finger's tendons and ``pressures`` [Pa] to its chambers, by default zero, or ``wound`` is
        wound-up cable [m]; with ``released`` tendons with friction have slid back from greater bends; ``marks`` are
        additional ends of panels [m]. Tendons have slid since the rod was unloaded.
        """
        profile = finger.profile
        length = finger.profile.length
        mesh = PanelMesh(panel_edges((0.0, *profile.breaks, length), length / _PANELS), _NODES)
        stiffness = length / float(mesh.weights @ (1.0 / profile.bending_stiffness(mesh.nodes)))
        mass = float(mesh.weights @ profile.linear_density(mesh.nodes))
        force = length**2 / stiffness
        moment = length / stiffness
        tendons = _tendons(
            finger, tensions, wound, pressures or [0.0] * len(finger.chambers), moment, -1.0 if released else 1.0
        )
        carried = [body for body in bodies(finger) if gravity != 0.0]
        dead = [*((body.at, body.mass * gravity) for body in carried), *dead]
        limit, stops = finger.stop_curvature, finger.stops
        places = [*(at for at, _ in (*dead, *following, *couples)), *profile.breaks, *marks]
        places += [at for tendon in tendons for at in tendon.shape.breaks]
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
            tendons=tuple(tendons),
            stops=None if limit is None or stops is None else (limit, stops.signs, stops.stiffness_ratio - 1.0),
        )


@dataclass(frozen=True)
class FastenedMass:
    """A mass fastened to a section."""

    at: float  # [m]
    mass: float  # [kg]
    lever: complex = 0.0  # from the backbone to its center of mass in the section's axes, across + i along [m]
    rotary_inertia: float = 0.0  # about the center of mass [kg m2]


def bodies(finger: Finger) -> list[FastenedMass]:
    """Point masses and the body at the tip."""
    point_masses = [FastenedMass(point.at, point.mass) for point in finger.masses]
    tip = finger.tip_body
    if tip is not None:
        point_masses.append(
            FastenedMass(finger.profile.length, tip.mass, complex(*tip.center_of_mass), tip.rotary_inertia)
        )
    return point_masses


def _tendons(
    finger: Finger,
    tensions: Sequence[float] | None,
    wound: Sequence[float] | None,
    pressures: Sequence[float],
    scale: float,
    way: float,
) -> list[TendonMoment]:
    """Moments of tendons and chambers, of tendons with one shape and without friction together, scaled."""
    tendons = [
        TendonMoment(pull.channel.shape, pull.channel.gain * pressure * scale)
        for pull, pressure in zip(finger.pulls[len(finger.tendon_list) :], pressures, strict=True)
        if pressure != 0.0
    ]
    for channel in finger.channels:
        free = 0.0
        for k, (arm, tendon) in enumerate(zip(channel.arms, finger.tendon_list, strict=False)):
            friction = math.copysign(tendon.friction, arm) * way
            tension = 0.0 if tensions is None else tensions[k]
            if arm == 0.0:
                continue
            if wound is not None and tendon.axial_stiffness is not None and tendon.series_stiffness is not None:
                to = tendon.end(finger.profile.length) / finger.profile.length
                elongations = 1.0 / tendon.series_stiffness, 1.0 / tendon.axial_stiffness
                cable = Cable(wound[k], arm, *elongations, to, finger.onset(tendon))
                tendons.append(TendonMoment(channel.shape, arm * scale, friction, tendon.conduit_bend, cable))
            elif tendon.friction == 0.0:
                free += arm * tension
            elif tension != 0.0:
                tendons.append(TendonMoment(channel.shape, arm * tension * scale, friction, tendon.conduit_bend))
        if free != 0.0:
            tendons.append(TendonMoment(channel.shape, free * scale))
    return tendons


_MOTORS = Consumer(
    "accuracy of motors",
    {"finger.tendons.drive": "the exact rod knows torques of motors, one per tendon: give family and elements"},
    where=lambda s: any(
        d.kind == "motor" and (d.arrangement == "one_pulley" or d.position_gain) for d in s.finger.winches
    ),
)


def _wound(scene: Scene, commands: Sequence[float]) -> tuple[list[float] | None, list[float] | None]:
    """Tensions [N] that motors leave, or cable that winches wind up [m], per tendon."""
    finger = scene.finger
    tendons, drives = finger.tendon_list, finger.winches
    pulley = drives[0].arrangement == "one_pulley"
    motors = [drive for drive in drives if isinstance(drive, MotorDrive)]
    if motors:
        _MOTORS.check(scene)
        return [max(torque / drive.winch_radius, 0.0) for torque, drive in zip(commands, motors, strict=True)], None
    starts = []
    for tendon, drive in zip(tendons, [drives[0]] * 2 if pulley else drives, strict=True):
        length = finger.rod.length if tendon.to is None else tendon.to
        compliance = 1.0 / (tendon.series_stiffness or 1.0) + length / (tendon.axial_stiffness or 1.0)
        starts.append(drive.pretension * compliance - drive.slack)
    lengths = [commands[0], -commands[0]] if pulley else list(commands)
    return None, [start + length for start, length in zip(starts, lengths, strict=True)]


def read_problem(scene: Scene, extra_loads: Sequence[Load] = ()) -> RodProblem:
    """The rod of a scene with the values of loads and inputs at time zero, and further loads."""
    scene.check_for_exact_rod()
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
    actuation = scene.actuation
    tensions = None
    wound = None
    inputs = {} if actuation is None else actuation.given
    commands = {key: [_at_zero(value)[0] for value in values] for key, values in inputs.items()}
    if drives := scene.finger.winches:
        tensions, wound = _wound(scene, commands.get(drives[0].key) or [0.0] * len(drives))
    couples += [(length, moment) for moment in commands.get("tip_moment", ())]
    tensions = commands.get("tensions", tensions)
    return RodProblem.of(
        scene.finger,
        complex(*scene.gravity),
        dead=dead,
        following=following,
        couples=couples,
        tensions=tensions,
        wound=wound,
        pressures=commands.get("pressures"),
        released=scene.initial.reached_by == "releasing",
    )


def _at_zero(value: float | tuple[float, float] | Samples | VectorSamples) -> tuple[float, ...]:
    """Entries of a value at time zero."""
    if isinstance(value, Samples):
        return (_sampled(value.times, value.values, value.interpolation),)
    if isinstance(value, VectorSamples):
        return tuple(_sampled(value.times, row, value.interpolation) for row in zip(*value.values, strict=True))
    return value if isinstance(value, tuple) else (float(value),)


def _sampled(times: Sequence[float], values: Sequence[float], kind: str) -> float:
    """A sampled function at time zero: steps, a polygon, or the quintic through both ends with their slopes,
    unaccelerated.

    The slopes follow F. N. Fritsch and J. Butland (1984, doi:10.1137/0905021), none at either end.
    """
    if kind == "hold":
        begun = [value for at, value in zip(times, values, strict=True) if at <= 0.0]
        return begun[-1] if begun else values[0]
    if times[0] >= 0.0 or times[-1] <= 0.0 or kind == "linear":
        return float(np.interp(0.0, times, values))
    from scipy.interpolate import BPoly, PchipInterpolator

    slopes = PchipInterpolator(times, values).derivative()(times)
    rises = 2.0 * np.abs(np.diff(values) / np.diff(times))
    slopes[1:-1] = np.sign(slopes[1:-1]) * np.minimum(np.abs(slopes[1:-1]), np.minimum(rises[:-1], rises[1:]))
    slopes[[0, -1]] = 0.0
    return float(BPoly.from_derivatives(times, np.stack([values, slopes, np.zeros_like(slopes)], axis=1))(0.0))
