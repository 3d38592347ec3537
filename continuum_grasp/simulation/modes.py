"""Natural frequencies and mode shapes about an equilibrium."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arguments import check_arguments, whole
from continuum_grasp.core import Core
from continuum_grasp.results.declared import XY, Dimension, Picture, Stored, maker_of
from continuum_grasp.results.result import Result
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.driven_modes import small_motions
from continuum_grasp.simulation.spectrum import in_mass_metric
from continuum_grasp.simulation.static_shape import Equilibrium
from continuum_grasp.simulation.statics import equilibrium

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Modes(Result):
    """Small undamped oscillations about an equilibrium.

    With friction as it acts at rest, and drives that are held. ``stuck_frequencies_hz`` are those of motions in which
    nothing slides or relaxes: branches of dry friction and relaxation add their stiffness, and a taut tendon that has
    friction and a winch elongates locally with the bend and adds E A e^2. A motion is between these two; larger ones
    slide.
    Where motors turn, ``free_frequencies_hz`` are those with the motors free under their command, their inertia among
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
        XY,
    )
    pictures: ClassVar[tuple[Picture, ...]] = (Picture("modes", "plotting.motion:plot_modes", panels=True),)

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

        As `Equilibrium.space_error`; of frequencies that are zero with halved elements, per the highest.
        """
        return np.asarray(maker_of("accuracy.space:error_of_modes")(self))

    @property
    def status(self) -> str:
        """``stable`` or ``unstable``: what the equilibrium is."""
        return "stable" if self.stable else "unstable"

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
def modes(scene: Scene, *, about: Equilibrium | None = None, points: int = 61) -> Modes:
    """Find the modes of a scene without ``fidelity.tolerance``; see `continuum_grasp.modes`."""
    found = equilibrium(scene) if about is None else about
    model, q, u, p = found.model, found.q, found.u, found.p
    core, small = Core(model, compiled=False), small_motions(found)
    values, right, left = _eigen(small.mass, small.stiffness)
    pulsations = _pulsations(values)
    ratios = np.full(len(values), np.nan)
    moving = pulsations > 1e-9 * pulsations.max(initial=0.0)
    # The diagonal of the damping in the modes: what couples them is left out.
    modal_damping = np.einsum("ki,ij,kj->k", left, small.damping, right).real
    ratios[moving] = modal_damping[moving] / (2.0 * pulsations[moving])
    pulsations[~moving] = 0.0
    coordinates = np.ascontiguousarray(right.real)
    s = np.linspace(0.0, model.finger.rod.length, whole("points", points, 2))[:, None]
    jacobians = np.asarray(core.batch("jacobian", q, u, s, p))
    shapes = np.einsum("sij,kj->ksi", jacobians, coordinates)
    shapes /= np.linalg.norm(shapes, axis=2).max(axis=1)[:, None, None]
    return Modes(
        pulsations / (2.0 * np.pi),
        ratios,
        coordinates,
        found.backbone(points),
        shapes,
        found,
        scene,
        stuck_frequencies_hz=None if small.stuck is None else _frequencies(small.mass, small.stuck),
        free_frequencies_hz=None if small.free is None else _frequencies(*small.free),
    )


_ROUNDING = 1e-7
"""Frequency per the greatest one below which it is that of rounding [1], by which squares are off by some 1e-16."""


def _pulsations(values: NDArray[Any]) -> Array:
    """Angular frequencies [rad/s] of their squares; zero where a square is negative, which marks what is unstable."""
    return np.asarray(np.sqrt(values.astype(complex)).real)


def _frequencies(mass: Array, stiffness: Array) -> Array:
    """Natural frequencies [Hz]."""
    found = _pulsations(_eigen(mass, stiffness)[0])
    found[found <= _ROUNDING * found.max(initial=0.0)] = 0.0
    return found / (2.0 * np.pi)


def _eigen(mass: Array, stiffness: Array) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Squared pulsations, increasing, and right and left modes as rows, with left . M . right = 1."""
    root, scaled, symmetric = in_mass_metric(mass, stiffness)
    if symmetric:
        values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
        return values, (root.T @ vectors).T, (root.T @ vectors).T
    values, vectors = np.linalg.eig(scaled)
    order = np.argsort(values.real)
    values, vectors = values[order], vectors[:, order]
    return values, (root.T @ vectors).T, np.linalg.inv(vectors) @ root
