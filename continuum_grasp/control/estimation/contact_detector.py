"""Detection of contact by drives alone, in C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, Summarized, check_arguments, quoted
from continuum_grasp.control.arguments import vector
from continuum_grasp.control.compiled import Compiled, detector_source
from continuum_grasp.control.estimation.contact_model import ContactModel, contact_model_of
from continuum_grasp.core import precision_of
from continuum_grasp.model import Remade
from continuum_grasp.scene import ControlScene, scene_of
from continuum_grasp.simulation import Friction

_MOST = 1e9
"""``CONTACT_MOST`` of ``c/contact_detector.h`` [N]."""


class ResidualContact(IntEnum):
    """Contact shown by the residual of a contact detector."""

    FREE = 0
    """No more than a finger that touches nothing."""
    UNCERTAIN = 1
    """More, which may be a friction history that is not known: that of the start, or of a contact before."""
    DETECTED = 2
    """A contact."""
    MISSING = 3
    """Nothing: a measurement is missing, or beyond what its sensor can show."""
    LOST = 4
    """Nothing: the winches moved as no finger follows, until the detector is reset."""


@dataclass(frozen=True)
class DetectedContact(Summarized):
    """Contact after a measurement.

    One number, the excess tension, does not tell where a contact is and how strong: ``forces`` has an interval for each
    place, and those of several tendons agree at several places as a rule.

    Attributes
    ----------
    contact : Contact
        Whether there is one.
    residual : (D,) ndarray
        Tension in excess of that of the free finger, per drive [N]; on a pulley that of the difference of both.
    bounds : (D, 2) ndarray
        Least and greatest residual that the finger may have that touches nothing [N].
    places : (K,) ndarray
        Where a contact is considered, along the finger [m].
    gain : (D, K) ndarray
        Tension per force across the finger at each place [1].
    threshold : (K,) ndarray
        Least force across the finger that is detected at each place, either way from where the residual is now [N];
        infinite where none is felt.
    forces : (K, 2) ndarray
        Least and greatest force at each place that the residual allows [N], positive to the left, seen from the base to
        the tip, as tendon 1 bends the finger; NaN where none agrees with all drives.
    """

    contact: ResidualContact
    residual: Array
    bounds: Array
    places: Array
    gain: Array
    threshold: Array
    forces: Array

    def pairs(self) -> dict[str, str]:
        """Verdict, excess tensions and the forces that explain them."""
        forces = (
            f"{low:.3g} to {high:.3g} N at {at:g} m" for (low, high), at in zip(self.forces, self.places, strict=True)
        )
        return {
            "contact": self.contact.name.lower(),
            "residual": ", ".join(f"{value:.3g} N" for value in self.residual),
            "forces": "; ".join(forces),
            "place": "not known" if self.place is None else f"{self.place:g} m",
        }

    @property
    def detected(self) -> bool:
        """Whether there is a contact."""
        return self.contact is ResidualContact.DETECTED

    @property
    def place(self) -> float | None:
        """Place of the contact [m]; None where it may be at several of the places, or there is none."""
        possible = np.isfinite(self.forces).all(axis=1)
        return float(self.places[possible][0]) if self.detected and possible.sum() == 1 else None


def contact_parts(model: ContactModel) -> dict[str, int]:
    """Sizes of what the C writes of a contact, by name."""
    nd, nl = model.sizes["ND"], model.sizes["NL"]
    per_drive = dict.fromkeys(("residual", "low", "high"), nd)
    per_place = dict.fromkeys(("threshold", "least", "most"), nl)
    parts = {"verdict": 1, **per_drive, "gain": nd * nl, **per_place}
    return {f"contact_{name}": size for name, size in parts.items()}


def detected_contact(parts: Mapping[str, Array], places: Sequence[float]) -> DetectedContact:
    """Read what the C wrote of a contact."""
    numbers = {name.removeprefix("contact_"): value for name, value in parts.items() if name.startswith("contact_")}
    forces = np.stack([numbers["least"], numbers["most"]], axis=1)
    forces[forces[:, 0] > forces[:, 1]] = np.nan
    threshold = numbers["threshold"]
    return DetectedContact(
        ResidualContact(int(numbers["verdict"][0])),
        numbers["residual"],
        np.stack([numbers["low"], numbers["high"]], axis=1),
        np.array(places),
        numbers["gain"].reshape(numbers["residual"].size, -1, order="F"),
        np.where(threshold >= _MOST, np.inf, threshold),
        np.where(np.abs(forces) >= _MOST, np.copysign(np.inf, forces), forces),
    )


class ContactDetector(Remade, Summarized):
    """Detection of contact by what the drives feel: positions of winches, and torques or tensions.

    Parameters
    ----------
    scene : ControlScene or path-like
        The scene, with ``estimator.contact_detection``, or its YAML file.
    precision : {"double", "float"}
        Floating-point type of the C.

    Attributes
    ----------
    scene
        The scene.
    period : float
        Time from one measurement to the next [s].
    measurement_names : tuple of str
        Name and unit of each entry of a measurement.
    settings : dict
        Numbers of the detector, by the names in ``c/contact_detector.h``.

    Raises
    ------
    InputError
        If the scene has no contact detection, its pieces do not fit together, or there is no C compiler.

    Notes
    -----
    The residual is that of a momentum observer (A. De Luca and R. Mattone, doi:10.1109/ROBOT.2005.1570247; survey by S.
    Haddadin, A. De Luca and A. Albu-Schaeffer, doi:10.1109/TRO.2017.2723903). Its threshold follows from models of the
    finger with every uncertain number at either end of its range, whose friction states run along.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.control import ContactDetector
    >>> drive = {"kind": "motor", "winch_radius": 0.008, "inertia": 2e-6, "torque_max": 0.2, "pretension": 1.0}
    >>> tendons = {"offset": 0.005, "max_tension": 60.0, "axial_stiffness": 1e4, "series_stiffness": 3e4}
    >>> scene = cg.ControlScene(
    ...     finger={
    ...         "rod": {"length": 0.18, "linear_density": 0.034, "bending_stiffness": 6e-3},
    ...         "damping": {"material": 3e-5},
    ...         "tendons": {**tendons, "drive": drive},
    ...     },
    ...     gravity=(0.0, 0.0),
    ...     fidelity={"family": "clothoid", "elements": 2},
    ...     controller={"cost": {"tip_angle": {"running": 1.0}, "effort": 0.1}},
    ...     reference={"tip_angle": 0.0},
    ...     estimator={"measured": {"angle": 1e-4, "torque": 1e-4}, "contact_detection": {}},
    ... )
    >>> detector = ContactDetector(scene)
    >>> detector.measurement_names
    ('motor_angle_1 [rad]', 'motor_angle_2 [rad]', 'motor_torque_1 [N m]', 'motor_torque_2 [N m]')
    >>> detector.step([0.0, 0.0, 0.008, 0.008]).contact.name
    'FREE'
    """

    @check_arguments
    def __init__(self, scene: ControlScene | str | PathLike[str], *, precision: str = "double") -> None:
        self.scene = scene_of(scene, ControlScene)
        self._arguments = (self.scene,), {"precision": precision}  # no path, whose file may change
        self.model = contact_model_of(self.scene)
        self.precision = precision_of(precision)
        self.period, self.measurement_names = self.scene.controller.step, self.model.measurement_names
        self.settings, sizes = self.model.settings, self.model.sizes
        self._drives, self._nx = sizes["ND"], self.model.prediction.nx
        source, parts = detector_source(self.model, self.precision), contact_parts(self.model)
        self._c = Compiled(source, self.settings, {"y": sizes["NY"], "u": sizes["NU"]}, parts, "the contact detector")
        self._y, self._u = self._c.given
        self.reset()

    def headline(self) -> str:
        """Scene and period of the detector."""
        return quoted(self.scene.name, f"{1e3 * self.period:g} ms")

    def pairs(self) -> dict[str, str]:
        """Measured quantities."""
        return {"measures": ", ".join(self.measurement_names), "members": str(len(self.model.groups))}

    def reset(self, lengths: ArrayLike | None = None, reached_by: str | None = None) -> None:
        """Start again from a finger at rest that touches nothing.

        Parameters
        ----------
        lengths : (D,) array_like, optional
            What the winches have wound up [m], from where the drives are at zero; by default as in the initial pose.
        reached_by : {"pulling", "releasing"}, optional
            How the finger came to these lengths, for tendons with friction; by default that is not known.

        Raises
        ------
        InputError
            If lengths have another size.
        SolverError
            If no equilibrium is found there.
        """
        states = np.asarray(self.settings["first"])
        if lengths is not None or reached_by is not None:
            wound = self.model.lengths if lengths is None else vector("lengths", lengths, self._drives)
            friction: Friction | None = None if reached_by is None else {"reached_by": reached_by}
            states = self.model.first(wound, friction)
        self._c.give("cg_start", states.ravel())

    @check_arguments
    def start(self, state: ArrayLike) -> None:
        """Start again at a state of the prediction, as an estimator knows it.

        Parameters
        ----------
        state : (nx,) array_like
            State of the prediction, friction states included. Where ``history_known`` is false, friction may have any
            other history.

        Raises
        ------
        InputError
            If it has another size or is not finite.
        """
        z, indices = vector("state", state, self._nx), np.asarray(self.settings["from"])
        states, free = np.tile(z[indices], (len(self.model.groups), 1)), self.model.finger.friction_states
        if free and not self.settings["history_known"]:
            states[-2, -free:], states[-1, -free:] = 1.0, -1.0
        self._c.give("cg_start", states.ravel())

    def step(self, measurement: ArrayLike, u: ArrayLike | None = None) -> DetectedContact:
        """Update with a measurement; call it once per period.

        Parameters
        ----------
        measurement : array_like
            Measurement in the order of ``measurement_names``; NaN where a sensor has none, which leaves all as it was.
        u : (nu,) array_like, optional
            Input applied since the last step, for motors whose torque or current is not measured.

        Returns
        -------
        DetectedContact

        Raises
        ------
        InputError
            If something has the wrong shape, or u is not finite.
        """
        self._y[:] = vector("measurement", measurement, self._y.size, check=False)
        self._u[:] = 0.0 if u is None else vector("u", u, self._u.size)
        return detected_contact(self._c.step()[1], self.model.finger.places)

    def save_state(self) -> bytes:
        """Return all that the next step depends on."""
        return self._c.save(0)

    def restore(self, saved: bytes) -> None:
        """Continue from a saved state, which must be of the same problem, version and precision."""
        self._c.restore(saved)

    __getstate__ = save_state
    __setstate__ = restore
