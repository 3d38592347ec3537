"""The motion of a finger, and whether its shapes stay where the model means something."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel, System
from continuum_grasp.results import Dimension, MotionResult, Picture, Stored
from continuum_grasp.scene import ForceLoad, Scene
from continuum_grasp.simulation.contacts import ContactHistory
from continuum_grasp.simulation.resolution import Resolution
from continuum_grasp.simulation.slack import SlackTime, slack_times


@dataclass(frozen=True)
class Trajectory(MotionResult):
    """Motion of a finger, and of its object if there is one, at T instants; SI units, world frame.

    Attributes
    ----------
    t, x, u, w : ndarray
        See the stored arrays; ``x_names``, ``u_names`` and ``w_names`` are the columns.
    model : FingerModel
    scene : Scene
    system : System or None
        The finger with its object; None without one.
    status : {"finished", "stopped", "under_resolved"}
        ``stopped``: the motion ended early; the error that was raised says why. ``under_resolved``: no number of
        elements that is tried keeps 1 %, or ``fidelity.tolerance``.
    warnings : tuple of str
    statistics : mapping
        Method, sub-steps, spectral radius, times.
    time_error : float
        Estimate of the greatest error of position that the steps in time leave, per length of the finger [1]: of the
        ends of the elements, and of the points of an object that moves. It is estimated with steps of two or four times
        the length (``reference``: with looser tolerances); infinite if these are unstable, nan without a comparison.
    space_error : float
        Estimate of the greatest error of position that the elements leave, per length of the finger [1]: of places
        along it, and of the points of an object that moves. It is taken from the same motion with every element halved
        (``time.space_error``, ``fidelity.tolerance``); infinite if that one fails, nan without a comparison.
    static_error : float
        Without ``space_error``: greatest error of position that the elements leave at rest under the first, last or
        held inputs and loads, per length [1], against the exact rod, or elements of half the length; infinite without
        such an equilibrium, nan with an object, or with more than four stated elements in a scene that the exact rod
        does not cover.
    resolution : Resolution or None
        Errors of the elements; errors at rest include the first natural frequencies about these shapes. None with an
        object.
    """

    kind: ClassVar[str] = "simulate"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("t", "(time,)", "s", "instants"),
        Stored("x", "(time, state)", "", "states"),
        Stored("u", "(time, input)", "", "inputs"),
        Stored("w", "(time, force_component)", "", "forces at contacts, tip and loads"),
        Stored("tip", "(time, xy)", "m", "world position of the tip"),
        Stored("kinetic", "(time,)", "J", "kinetic energy, with the object's"),
        Stored("potential", "(time,)", "J", "elastic energy and potential of the weight"),
        Stored(
            "object_pose",
            "(time, pose)",
            "",
            "pose of the object: x, y [m], angle [rad], and height [m] if it slides out",
        ),
        Stored("tensions", "(time, tendon)", "N", "tensions at the drives, of tendons with friction or on winches"),
        *ContactHistory.stored,
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension.TIME,
        Dimension("state", "bending coordinates, their rates, and what else moves", "x_names"),
        Dimension("input", "tendon tensions or tip moment, and their rates where the model needs them", "u_names"),
        Dimension("force_component", "forces and moments that act, in the world's axes", "w_names"),
        Dimension.XY,
        Dimension.POSE,
        Dimension("tendon", "tendons, that on the -X side first", 1),
        ContactHistory.dimension,
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("snapshots", "continuum_grasp.plotting.motion:plot_snapshots"),
        Picture("tip_path", "continuum_grasp.plotting.motion:plot_tip_path"),
        Picture("coordinates", "continuum_grasp.plotting.motion:plot_coordinates"),
        Picture("energy", "continuum_grasp.plotting.motion:plot_energy"),
        Picture("tensions", "continuum_grasp.plotting.motion:plot_tensions", needs="tensions"),
        Picture("tensions_along", "continuum_grasp.plotting.motion:plot_tensions_along", needs="tensions"),
        Picture("tension_loop", "continuum_grasp.plotting.motion:plot_tension_loop", needs="tensions"),
        Picture("contact_forces", "continuum_grasp.plotting.motion:plot_contact_forces", needs="contacts"),
    )
    frames: ClassVar[str] = "continuum_grasp.plotting.motion:motion_frames"
    page: ClassVar[str] = "motion"

    t: Array
    x: Array
    u: Array
    w: Array
    model: FingerModel
    scene: Scene
    system: System | None = None
    status: str = "finished"
    warnings: tuple[str, ...] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)
    time_error: float = math.nan
    space_error: float = math.nan
    static_error: float = math.nan
    resolution: Resolution | None = None

    def judged(self, resolution: Resolution, warnings: tuple[str, ...], **seconds: float) -> Trajectory:
        """Return the motion with measured errors, additional warnings, and the time of these measurements [s]."""
        statistics = {**self.statistics, **seconds}
        if note := resolution.note(self.model.family):
            statistics["fidelity"] = note
        return replace(
            self,
            status=Resolution.FAILED if resolution.fails else self.status,
            static_error=resolution.error if math.isnan(self.space_error) else math.nan,
            resolution=resolution,
            warnings=(*self.warnings, *resolution.warnings, *warnings),
            statistics=statistics,
        )

    @property
    def outcome(self) -> str:
        """Status, or the error that the elements leave."""
        return self.resolution.outcome if self.resolution is not None and self.resolution.fails else self.status

    @property
    def simulated(self) -> Scene:
        """The scene that was simulated."""
        return self.scene

    @property
    def moving(self) -> FingerModel | System:
        """Model that the states belong to: the system, or the finger alone."""
        return self.system or self.model

    @property
    def slack(self) -> list[SlackTime]:
        """Slack periods of tendons on winches and motors; tendons with commanded tension have none."""
        tensions = self.tensions
        return (
            []
            if tensions is None or not self.model.finger.winches
            else slack_times(self.model.finger, self.t, tensions)
        )

    @property
    def n(self) -> int:
        """Number of bending coordinates."""
        return self.model.n

    @property
    def x_names(self) -> list[str]:
        """Name and unit of each state."""
        return self.moving.x_names

    @property
    def u_names(self) -> list[str]:
        """Name and unit of each input."""
        return self.moving.u_names

    @property
    def w_names(self) -> list[str]:
        """Name and unit of each force component."""
        return self.moving.w_names

    @cached_property
    def core(self) -> Core:
        """The compiled model of the finger."""
        return Core(self.model)

    @cached_property
    def system_core(self) -> Core:
        """The compiled system; the compiled model without an object."""
        return self.core if self.system is None else Core(self.system)

    @property
    def q(self) -> Array:
        """Bending coordinates (T, n)."""
        return self.x[:, : self.n]

    @cached_property
    def acting(self) -> Array:
        """Inputs (T, nu) that act on the shape: with a tendon lag, the tensions that give the lagged moment."""
        acting: Array = self.model.acting_input(self.x.T, self.u.T).T
        return acting

    @cached_property
    def tip(self) -> Array:
        """Tip positions (T, 2) [m]."""
        return np.asarray(self.core.batch("tip", self.q, self.acting, None))

    @property
    def tensions(self) -> Array | None:
        """Tensions at the drives (T, tendons) [N] of tendons with friction or on winches; None of others."""
        return None if self._tensions is None else self._tensions[0]

    @property
    def tensions_along(self) -> list[tuple[Array, Array]] | None:
        """Per tendon places along the finger (K,) [m] and the tension there (T, K) [N], the drive's first.

        None where tendons have neither friction nor winches; without friction the tension is the same everywhere.
        """
        if self._tensions is None:
            return None
        at_drives, along = self._tensions
        places = self.model.tension_places()
        parts = np.split(along, np.cumsum([len(at) for at in places])[:-1], axis=1)
        return [
            (np.append(0.0, at), np.column_stack([at_drive, part]))
            for at, at_drive, part in zip(places, at_drives.T, parts, strict=True)
        ]

    @cached_property
    def _tensions(self) -> tuple[Array, Array] | None:
        if not self.model.structure.own_tendons:
            return None
        columns = self.x[:, : self.model.nx].T, self.u.T, np.tile(np.array(self.model.p_nominal)[:, None], len(self.t))
        at_drives, along = self.model.tensions()(*columns)
        return np.array(at_drives).T, np.array(along).T

    @cached_property
    def tip_angle(self) -> Array:
        """Angle of the tip against the base (T,) [rad]."""
        return np.asarray(np.sum(self.core.batch("bending", self.q, self.acting, None), axis=1))

    @cached_property
    def _energies(self) -> tuple[Array, Array]:
        kinetic, potential = self.system_core.batch("energy", self.x, self.u, None)
        return np.asarray(kinetic)[:, 0], np.asarray(potential)[:, 0]

    @property
    def kinetic(self) -> Array:
        """Kinetic energy (T,) [J], with the object's."""
        return self._energies[0]

    @property
    def potential(self) -> Array:
        """Elastic energy, with the energy of pressed surfaces, and potential of the weight (T,) [J]."""
        return self._energies[1]

    @cached_property
    def contacts(self) -> ContactHistory | None:
        """Forces at the contacts of the object; None without an object."""
        return None if self.system is None else ContactHistory.of(self.system_core, self.x, self.u, self.w)

    def backbone(self, indices: ArrayLike, points: int = 50) -> Array:
        """Backbones (len(indices), points, 2) at some of the instants [m]."""
        chosen = np.atleast_1d(np.asarray(indices, dtype=int))
        return self.core.backbones(self.q[chosen], self.acting[chosen], points)

    def loads_at(self, index: int) -> list[tuple[Array, Array, str]]:
        """Forces at one instant: position (2,) [m], force (2,) in the world [N], and kind.

        Contacts of the finger with an object act on the finger, supports on the object.
        """
        contact_forces = [] if self.contacts is None else self.contacts.at(index)
        finger_forces = acting_forces(self.core, self.q[index], self.acting[index], self.w[index])
        return finger_forces + [(at, force, kind) for at, force, kind in contact_forces if np.any(force != 0.0)]

    def pairs(self) -> dict[str, str]:
        """Time, where the tip ends, errors of the steps in time and of the elements, energy."""
        energy = (self.kinetic + self.potential)[[0, -1]]
        x, y = self.tip[-1]
        return {
            "time": f"{self.t[-1]:g} s in {len(self.t) - 1} steps",
            "tip at the end": f"({x:.4f}, {y:.4f}) m",
            "time error": error_text(self.time_error, self.length),
            "space error": self._space_error_text,
            "energy": f"{energy[0]:.6g} J at the start, {energy[1]:.6g} J at the end",
        }

    @property
    def _space_error_text(self) -> str:
        text = error_text(self.space_error, self.length)
        at_rest = error_text(self.static_error, self.length)
        return text if math.isnan(self.static_error) else f"{text} in motion, at rest {at_rest}"

    def details(self) -> dict[str, Any]:
        """Errors of the steps in time and of the elements, and the names of the columns."""
        return {
            "time_error": self.time_error,
            "space_error": self.space_error,
            "static_error": self.static_error,
            "slack": [
                {"tendon": each.tendon, "begins": each.begins, "ends": each.ends if each.ends < math.inf else None}
                for each in self.slack
            ],
            "model": {
                "family": self.model.family,
                "lengths": list(self.model.lengths),
                "x_names": self.x_names,
                "u_names": self.u_names,
                "w_names": self.w_names,
                "contact_names": [] if self.contacts is None else list(self.contacts.names),
            },
        }


def error_text(error: float, length: float) -> str:
    """An estimated error of position per length as users read it."""
    if math.isnan(error):
        return "not measured"
    size = f"about {error:.2g} of the length, {1e3 * error * length:.2g} mm"
    return size if math.isfinite(error) else "cannot be estimated"


def acting_forces(core: Core, q: Array, u: Array, w: Array, p: Array | None = None) -> list[tuple[Array, Array, str]]:
    """Forces on a finger at coordinates q (n,), acting inputs u and forces w; as ``Trajectory.loads_at``."""
    model: FingerModel = core.model
    places = [(at, "contact", 2 * k, False) for k, at in enumerate(model.contacts)]
    if model.structure.tip_force:
        places.append((model.finger.rod.length, "tip", 2 * len(places), False))
    for load, (_, start) in zip(model.loads, model.load_entries, strict=True):
        if isinstance(load, ForceLoad):
            places.append((load.at, "load", start, load.follows))
    forces = []
    for at, kind, start, follows in places:
        force = w[start : start + 2]
        if follows:  # across and along the section
            angle = float(core.orientation(q, u, [at], p)[0])
            c, s = np.cos(angle), np.sin(angle)
            force = np.array([[c, -s], [s, c]]) @ force
        forces.append((np.asarray(core.position(q, u, [at], p)), force, kind))
    return [(at, force, kind) for at, force, kind in forces if np.any(force != 0.0)]
