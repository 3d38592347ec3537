"""Natural frequencies and mode shapes about an equilibrium.

Of a finger that has friction, or whose tendons are wound up, a small motion is between three limits: friction acts as
it does and the drives are held; all sticks, so that branches of dry friction add their stiffness, and tendons that are
wound up elongate locally with the finger's bend and add E A e^2; the drives are free to turn, with their inertia. Dry
friction of motors is left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array, CheckedArgument, check_arguments, named_value
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel, Memory
from continuum_grasp.results import Dimension, Picture, Result, Stored
from continuum_grasp.scene import Scene
from continuum_grasp.simulation.linearized import damping_matrix, in_mass_metric
from continuum_grasp.simulation.rest import RestingShape
from continuum_grasp.simulation.slack import least_pull
from continuum_grasp.simulation.static_shape import Equilibrium
from continuum_grasp.simulation.statics import equilibrium_of


@dataclass(frozen=True)
class Modes(Result):
    """Small undamped oscillations about an equilibrium.

    With friction as it acts at rest, and drives that are held. ``stuck_frequencies_hz`` belong to motions in which
    nothing slides or relaxes: branches of dry friction and relaxation add their stiffness, and a tendon in tension with
    friction and a winch elongates locally with the bend and adds E A e^2. A motion is between these two; larger ones
    slide.
    Where motors turn, ``free_frequencies_hz`` hold with the motors free under their command, their inertia among
    the modes, without their dry friction.

    Attributes
    ----------
    coordinates : (m, n) ndarray
        Modes in the bending coordinates, normalized by the mass matrix.
    equilibrium : Equilibrium
    scene : Scene
    statistics : mapping
    """

    kind: ClassVar[str] = "modes"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("frequencies_hz", "(mode,)", "Hz", "undamped natural frequencies, increasing; 0: unstable that way"),
        Stored("space_error", "(mode,)", "1", "estimated errors of the frequencies that the elements leave, relative"),
        Stored("damping_ratios", "(mode,)", "1", "modal damping ratios; NaN where the frequency is zero"),
        Stored("stuck_frequencies_hz", "(mode,)", "Hz", "the frequencies while nothing slides"),
        Stored("free_frequencies_hz", "(free_mode,)", "Hz", "the frequencies with motors that turn"),
        Stored("backbone", "(place, xy)", "m", "equilibrium shape, world"),
        Stored("shapes", "(mode, place, xy)", "1", "displacements of the backbone, each of greatest length one"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension("mode", "modes, from the lowest frequency", 1),
        Dimension("free_mode", "modes with motors that turn, from the lowest frequency"),
        Dimension("place", "places along the finger, evenly spaced from base to tip", "places", "m"),
        Dimension.XY,
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("modes", "continuum_grasp.plotting.motion:plot_modes", panels=True),
    )

    frequencies_hz: Array
    damping_ratios: Array
    coordinates: Array
    backbone: Array
    shapes: Array
    equilibrium: Equilibrium
    scene: Scene
    statistics: Mapping[str, Any] = field(default_factory=dict)
    stuck_frequencies_hz: Array | None = None
    free_frequencies_hz: Array | None = None

    @cached_property
    def space_error(self) -> Array:
        """Estimates of the errors of the frequencies (m,) that the elements leave, relative [1].

        As `Equilibrium.space_error`; of frequencies that are zero in truth, per the highest.
        """
        known = self.equilibrium.resolution
        if known is None or not len(known.frequencies):
            of = named_value("continuum_grasp.simulation.accuracy.resting:resolution_of")
            known = of(self.equilibrium, vibrates=True)
        errors = np.full(len(self.frequencies_hz), np.nan)
        errors[: len(known.frequencies)] = known.frequencies
        return errors

    @property
    def status(self) -> str:
        """``stable`` or ``unstable``; ``under_resolved`` if no number of elements keeps 1 % in the first two."""
        return self.equilibrium.status

    @property
    def outcome(self) -> str:
        """Status, or the error that the elements leave."""
        return self.equilibrium.outcome

    @property
    def stable(self) -> bool:
        """Whether the equilibrium is stable."""
        return self.equilibrium.stable

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the equilibrium."""
        return self.equilibrium.warnings

    @property
    def places(self) -> Array:
        """Positions along the finger (points,) [m] of ``backbone`` and ``shapes``."""
        return np.linspace(0.0, self.equilibrium.model.finger.rod.length, len(self.backbone))

    def pairs(self) -> dict[str, str]:
        """The lowest frequencies and their damping ratios."""

        def row(values: Array) -> str:
            return " ".join(f"{value:.4g}" for value in values[:6]) + (" ..." if len(values) > 6 else "")

        others = {"all stuck": self.stuck_frequencies_hz, "motors free": self.free_frequencies_hz}
        return {
            "frequencies": f"{row(self.frequencies_hz)} Hz",
            **{name: f"{row(values)} Hz" for name, values in others.items() if values is not None},
            "space error": row(self.space_error),
            "damping ratios": row(self.damping_ratios),
            "about a tip at": "({:.4f}, {:.4f}) m".format(*self.backbone[-1]),
        }


@check_arguments
def modes_of(scene: Scene, *, about: Equilibrium | None = None, points: int = 61) -> Modes:
    """Find the modes of a scene with its present elements; see `continuum_grasp.modes`."""
    rest = equilibrium_of(scene) if about is None else about
    model = rest.model
    q = rest.q
    u = rest.u
    p = rest.p
    core = Core(model, compiled=False)
    small = small_motions(rest)
    damping = damping_matrix(core, q, u, p)
    values, right, left = _eigen(small.mass, small.stiffness)
    pulsations = _pulsations(values)
    ratios = np.full(len(values), np.nan)
    moving = pulsations > 1e-9 * pulsations.max(initial=0.0)
    # The diagonal of the damping in the modes: what couples them is left out.
    modal_damping = np.einsum("ki,ij,kj->k", left, damping, right).real
    ratios[moving] = modal_damping[moving] / (2.0 * pulsations[moving])
    pulsations[~moving] = 0.0
    coordinates = np.ascontiguousarray(right.real)
    s = np.linspace(0.0, model.finger.rod.length, CheckedArgument("points", points).whole(2))[:, None]
    jacobians = np.asarray(core.batch("jacobian", q, u, s, p))
    shapes = np.einsum("sij,kj->ksi", jacobians, coordinates)
    shapes /= np.linalg.norm(shapes, axis=2).max(axis=1)[:, None, None]
    return Modes(
        pulsations / (2.0 * np.pi),
        ratios,
        coordinates,
        rest.backbone(points),
        shapes,
        rest,
        scene,
        stuck_frequencies_hz=None if small.stuck is None else _frequencies(small.mass, small.stuck),
        free_frequencies_hz=None if small.free is None else _frequencies(*small.free),
    )


_ROUNDING = 1e-7
"""Frequency per the greatest one below which it is rounding [1], by which squares are off by some 1e-16."""


def relative_errors(frequencies: Array, truth: Array, factor: float = 1.0) -> Array:
    """Relative errors of frequencies, times a factor; of one that is zero in truth, per the highest."""
    return np.asarray(
        factor * np.abs(frequencies - truth) / np.where(truth > 0.0, truth, max(float(truth.max()), 1e-300))
    )


def _pulsations(values: NDArray[Any]) -> Array:
    """Angular frequencies [rad/s] of their squares; zero where a square is negative, which marks instability."""
    return np.asarray(np.sqrt(values.astype(complex)).real)


def _frequencies(mass: Array, stiffness: Array) -> Array:
    """Natural frequencies [Hz]."""
    pulsations = _pulsations(_eigen(mass, stiffness)[0])
    pulsations[pulsations <= _ROUNDING * pulsations.max(initial=0.0)] = 0.0
    return pulsations / (2.0 * np.pi)


def _eigen(mass: Array, stiffness: Array) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Squared pulsations, increasing, and right and left modes as rows, with left . M . right = 1."""
    root, scaled, symmetric = in_mass_metric(mass, stiffness)
    if symmetric:
        values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
        return values, (root.T @ vectors).T, (root.T @ vectors).T
    values, vectors = np.linalg.eig(scaled)
    order = np.argsort(values.real)
    values = values[order]
    vectors = vectors[:, order]
    return values, (root.T @ vectors).T, np.linalg.inv(vectors) @ root


@dataclass(frozen=True)
class SmallMotions:
    """Return mass and stiffness (n, n) of the bending coordinates, also for stuck friction, and for drives that turn.

    ``stuck`` is None where nothing has friction, or its stiffness is not known, as with tendons whose tension
    is commanded.
    """

    mass: Array
    stiffness: Array
    stuck: Array | None = None  # stiffness (n, n)
    free: tuple[Array, Array] | None = None  # mass and stiffness with the angles of motors; None where none turn


def frequencies_of(rest: RestingShape) -> Array:
    """Natural frequencies (n,) [Hz] about a shape at rest, increasing; zero if unstable."""
    small = small_motions(rest)
    return _frequencies(small.mass, small.stiffness)


def small_motions(equilibrium: RestingShape) -> SmallMotions:
    model = equilibrium.model
    q = equilibrium.q
    u = equilibrium.u
    w = equilibrium.w
    p = equilibrium.p
    core = Core(model, compiled=False)
    n = model.n
    mass = core.mass_matrix(q, u, p)
    friction = equilibrium.friction_states
    if not model.structure.winches:
        # Friction acts as it does at rest.
        history = (np.append(friction, 0.0),) if friction.size else ()
        held = core.statics(q, u, w, p, *history)[1]
        return SmallMotions(mass, held, held + _held(model, p) if model.structure.has_stateful_laws else None)
    of_tendons = model.structure.tendon_friction_states
    states = Memory.state_of(friction[:of_tendons]), friction[of_tendons:]
    x = np.concatenate([q, np.zeros(n), model.drives_at(q, u, friction), *states])
    stiffness, _, inertia, passive = (np.array(value) for value in model.stiffness_of_drives()(x, u, w, p))
    free = None
    if inertia.size:
        both = np.zeros_like(stiffness)
        both[:n, :n], both[n:, n:] = mass, np.diag(inertia.ravel())
        free = both, stiffness
    slides = model.friction_names or model.structure.has_stateful_laws
    stuck = passive + _glued(model, equilibrium, x) + _held(model, p) if slides else None
    return SmallMotions(mass, stiffness[:n, :n], stuck, free)


def _glued(model: FingerModel, rest: RestingShape, x: Array) -> Array:
    """Stiffness of tendons in tension: of those with friction as if they were glued to the finger all along."""
    made = model.structure
    total = np.zeros((model.n, model.n))
    tensions = np.array(model.tensions()(x, rest.u, rest.p)[0]).ravel()
    frictional = {tendon for cells in made.cell_sets for tendon in cells.tendons}
    for k, (tendon, tension) in enumerate(zip(model.finger.tendon_list, tensions, strict=True)):
        if tension < least_pull(tendon) or tendon.axial_stiffness is None:
            continue
        shape = made.own_tendons[k].shape
        arm = made.own_tendons[k].arms[k]
        drawn = np.zeros(model.n)
        for element in range(len(made.lengths)):
            local = list(made.family.local(element))
            for s, weights in made.mesh.panels(element, shape, made.mesh.stiffness).nodes():
                bent = arm * shape(s) * made.family.shapes_at(element, s)[:-1]
                drawn[local] += bent @ weights
                if k in frictional:
                    total[np.ix_(local, local)] += tendon.axial_stiffness * (bent * weights) @ bent.T
        if k not in frictional:
            total += np.outer(drawn, drawn) / tendon.compliance(made.length)
    return total


def _held(model: FingerModel, p: Array) -> Array:
    """Stiffness that laws of the sections add while nothing slides or relaxes."""
    made = model.structure
    total = np.zeros((model.n, model.n))
    for placed in made.laws:
        held = float(ca.Function("held", [made.parameters.symbol], [ca.SX(placed.law.held)])(p))
        for port in placed.ports if held else ():
            local = list(made.family.local(port.element))
            shapes = np.array(port.shapes, dtype=float)
            total[np.ix_(local, local)] += held * port.measure * np.outer(shapes, shapes)
    return total
