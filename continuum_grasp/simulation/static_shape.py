"""A shape at rest as a result: its stored arrays, texts and pictures."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.base import Array, named_value
from continuum_grasp.core import Core
from continuum_grasp.results import Dimension, Picture, Result, Stored
from continuum_grasp.scene import Scene
from continuum_grasp.simulation.resolution import Resolution
from continuum_grasp.simulation.rest import RestingShape
from continuum_grasp.simulation.resting import states_of_motors
from continuum_grasp.simulation.tension_limits import TensionLimit, tension_limits
from continuum_grasp.simulation.trajectory import acting_forces, error_text


@dataclass(frozen=True)
class Equilibrium(RestingShape, Result):
    """A shape at rest.

    Attributes
    ----------
    scene : Scene or None
        None for a model without a scene.
    stable : bool
        Whether the tangent stiffness is positive definite (conservative loads), or no eigenvalue of the linearized
        motion has a positive real part (following loads, tendon friction); also false if the exact rod, or more
        elements, are unstable there.
    margin : float
        Smallest eigenvalue of the stiffness in the metric of the mass matrix [rad2/s2]; negative when unstable.
    residual : float
        Largest missing generalized force, relative to the largest balanced one.
    history : (states + 1,) ndarray
        History of friction, as an argument of the model's functions; empty without friction.
    warnings : tuple of str
        Too few elements, elements beyond the strain limit, a near buckling load, `limits`.
    resolution : Resolution or None
        Errors that the elements leave; None for a model without a scene.
    limits : tuple of TensionLimit
        Tendons pulled harder than their ``max_tension``, and tendons that winches and motors leave slack.
    """

    kind: ClassVar[str] = "equilibrium"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("q", "(coordinate,)", "", "bending coordinates"),
        Stored("u", "(input,)", "", "input that it is an equilibrium of"),
        Stored("w", "(force_component,)", "", "forces and moments that it is an equilibrium of"),
        Stored("p", "(parameter,)", "", "parameters of the model"),
        Stored("friction_states", "(friction_cell,)", "1", "direction of friction, per friction state"),
        Stored("tensions", "(tendon,)", "N", "tensions at the drives"),
        Stored("commands", "(drive, end)", "", "least and greatest command under which motors stay where they are"),
        Stored("tip", "(xy,)", "m", "world position of the tip"),
        Stored("places", "(place,)", "m", "positions along the finger, from base to tip"),
        Stored("shape", "(place, xy)", "m", "world positions of the backbone there"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension("coordinate", "bending angles or nodal curvatures", "model.q_names"),
        Dimension("input", "tendon tensions or tip moment", "model.u_names"),
        Dimension("force_component", "forces and moments that act, in the world's axes", "model.w_names"),
        Dimension("parameter", "run-time parameters", "model.p_names"),
        Dimension("friction_cell", "states of friction of the tendons and in bending", "model.friction_names"),
        Dimension("tendon", "tendons, that on the -X side first", 1),
        Dimension("drive", "motors", 1),
        Dimension("end", "least and greatest"),
        Dimension("place", "places along the finger", "places", "m"),
        Dimension.XY,
    )
    pictures: ClassVar[tuple[Picture, ...]] = (Picture("shape", "continuum_grasp.plotting.motion:plot_shape"),)

    scene: Scene | None = None
    resolution: Resolution | None = None

    @classmethod
    def of(cls, found: RestingShape, scene: Scene | None = None, resolution: Resolution | None = None) -> Equilibrium:
        """Return a shape at rest as a result, with its scene if it has one."""
        result = cls(**{each.name: getattr(found, each.name) for each in fields(RestingShape)}, scene=scene)
        result = replace(result, warnings=(*found.warnings, *map(str, result.limits)))
        return result if resolution is None else result.judged(resolution)

    def judged(self, resolution: Resolution) -> Equilibrium:
        """Return the equilibrium with measured errors, and with the confirmed verdict on stability."""
        known = () if self.resolution is None else self.resolution.warnings
        others = (text for text in self.warnings if text not in known)
        stable = self.stable and resolution.stable is not False
        return replace(self, resolution=resolution, stable=stable, warnings=(*others, *resolution.warnings))

    @property
    def limits(self) -> tuple[TensionLimit, ...]:
        """Limits that tensions exceed, and tendons that are slack."""
        return tension_limits(self.model.finger, self.tensions)

    @cached_property
    def commands(self) -> Array | None:
        """Return the least and greatest command (motors, 2) that hold the motors here; None without motors.

        Dry friction of a motor holds it under every command between them: torque [N m], current [A] or angle [rad]. A
        motor that winds up the tendon arrives here with the greatest command, and with the least one if it lets out
        the tendon. If a motor cannot hold (``torque_max``), both are nan. If a servo holds with its full torque, the
        angle has no bound on this side.
        """
        motors = self.model.structure.motors
        if self.tensions is None or not motors:
            return None
        drives = self.model.drives_at(self.q, self.u, self.friction_states, p=self.p)
        friction = dict(zip(self.model.p_names, self.p.tolist(), strict=True)).get("drive_coulomb_friction [N m]")
        tensions = self.tensions.tolist()
        states = zip(motors, states_of_motors(self.model, np.array(drives)), strict=True)
        return np.array(
            [motor.holding(at.tolist(), [tensions[k] for k in motor.tendons], friction) for motor, at in states]
        )

    @cached_property
    def space_error(self) -> float:
        """Estimate of the greatest error of position that the elements leave, per length of the finger [1].

        From the exact rod near the shape or, in scenes that it does not cover, from the equilibrium with every element
        halved. Infinite if none exists, nan if a model or friction states belong to these elements alone.
        """
        if self.resolution is not None and not np.isnan(self.resolution.error):
            return self.resolution.error
        error: float = named_value("continuum_grasp.simulation.accuracy.resting:resolution_of")(self).error
        return error

    def details(self) -> dict[str, Any]:
        """Error of the elements."""
        return {"space_error": self.space_error}

    @property
    def status(self) -> str:
        """``stable`` or ``unstable``; ``under_resolved`` if no number of elements keeps 1 % of the length."""
        if self.resolution is not None and self.resolution.fails:
            return Resolution.FAILED
        return "stable" if self.stable else "unstable"

    @property
    def outcome(self) -> str:
        """Status, or the error that the elements leave."""
        return self.resolution.outcome if self.resolution is not None and self.resolution.fails else self.status

    @property
    def statistics(self) -> dict[str, Any]:
        """Effort and quality of the search, and the reason for the number of elements."""
        effort = {"iterations": self.iterations, "residual": self.residual, "margin": self.margin}
        note = "" if self.resolution is None else self.resolution.note(self.model.family)
        return {**effort, "fidelity": note} if note else effort

    def pairs(self) -> dict[str, str]:
        """Position of the tip, stiffness and accuracy."""
        x, y = self.tip
        return {
            "tip": f"({x:.4f}, {y:.4f}) m",
            "margin": f"{self.margin:.4g} rad2/s2",
            "residual": f"{self.residual:.1e} of the forces that balance",
            "space error": error_text(self.space_error, self.model.finger.rod.length),
            "model": f"{len(self.model.lengths)} x {self.model.family}",
        }

    @property
    def places(self) -> Array:
        """Positions along the finger (50,) [m] of ``shape``."""
        return np.linspace(0.0, self.model.finger.rod.length, 50)

    @property
    def shape(self) -> Array:
        """World positions (50, 2) of the backbone [m]."""
        return self.backbone()

    @property
    def forces(self) -> list[tuple[Array, Array, str]]:
        """Forces that act: position (2,) [m], force (2,) in the world [N], and kind."""
        return acting_forces(Core(self.model, compiled=False), self.q, self.u, self.w, self.p)
