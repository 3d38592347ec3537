"""Natural frequencies and mode shapes about an equilibrium."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arguments import check_arguments, choice, whole
from continuum_grasp.core import Core
from continuum_grasp.results.declared import XY, Dimension, Picture, Stored
from continuum_grasp.results.result import Result
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.spectrum import damping_matrix, in_mass_metric
from continuum_grasp.simulation.static_shape import Equilibrium
from continuum_grasp.simulation.statics import equilibrium

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Modes(Result):
    """Small undamped oscillations about an equilibrium.

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
        Stored("damping_ratios", "(mode,)", "1", "modal damping ratios; NaN where the frequency is zero"),
        Stored("backbone", "(place, xy)", "m", "equilibrium shape, world"),
        Stored("shapes", "(mode, place, xy)", "1", "displacements of the backbone, each of greatest length one"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension("mode", "modes, from the lowest frequency", "numbers"),
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
    def numbers(self) -> NDArray[np.int64]:
        """Numbers of the modes (m,), from one."""
        return np.arange(1, len(self.frequencies_hz) + 1)

    @property
    def places(self) -> Array:
        """Positions along the finger (points,) [m] of ``backbone`` and ``shapes``."""
        return np.linspace(0.0, self.equilibrium.model.finger.rod.length, len(self.backbone))

    def pairs(self) -> dict[str, str]:
        """The lowest frequencies and their damping ratios."""

        def row(values: Array) -> str:
            return " ".join(f"{value:.4g}" for value in values[:6]) + (" ..." if len(values) > 6 else "")

        return {
            "frequencies": f"{row(self.frequencies_hz)} Hz",
            "damping ratios": row(self.damping_ratios),
            "about a tip at": "({:.4f}, {:.4f}) m".format(*self.backbone[-1]),
        }


@check_arguments
def modes(scene: Scene, *, about: Equilibrium | None = None, points: int = 61, friction: str = "stuck") -> Modes:
    """Find the modes of a scene without ``fidelity.tolerance``; see `continuum_grasp.modes`."""
    choice("friction", friction, ("stuck", "sliding"))
    found = equilibrium(scene) if about is None else about
    model, q, u, w, p = found.model, found.q, found.u, found.w, found.p
    core = Core(model, compiled=False)
    mass = core.mass_matrix(q, u, p)
    history = (_history(found, friction),) if found.history.size else ()
    stiffness = core.statics(q, u, w, p, *history)[1]
    damping = damping_matrix(core, q, u, p)
    values, right, left = _eigen(mass, stiffness)
    # The root of a negative square is imaginary: its real part, zero, marks what is unstable.
    pulsations = np.sqrt(values.astype(complex)).real
    ratios = np.full(len(values), np.nan)
    moving = pulsations > 1e-9 * pulsations.max(initial=0.0)
    # The diagonal of the damping in the modes: what couples them is left out.
    modal_damping = np.einsum("ki,ij,kj->k", left, damping, right).real
    ratios[moving] = modal_damping[moving] / (2.0 * pulsations[moving])
    pulsations[~moving] = 0.0
    coordinates = np.ascontiguousarray(right.real)
    s = np.linspace(0.0, model.finger.rod.length, whole("points", points, 2))[:, None]
    jacobians = np.asarray(core.batch("jacobian", q, u, s, p))
    shapes = np.einsum("sij,kj->ksi", jacobians, coordinates)
    shapes /= np.linalg.norm(shapes, axis=2).max(axis=1)[:, None, None]
    return Modes(pulsations / (2.0 * np.pi), ratios, coordinates, found.backbone(points), shapes, found, scene)


_WITHIN = 1.0 - 1e-9
"""Share of its range within which a friction state is that sticks [1]."""


def _history(about: Equilibrium, friction: str) -> Array:
    """Friction as functions of the model take it: moved by the bending where it sticks, held where it slides."""
    if friction == "sliding":
        return np.append(about.friction_states, 0.0)
    slid = np.ravel(about.model.sliding()(about.q, about.u, about.p))
    return np.append(_WITHIN * about.friction_states - slid, 1.0)


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
