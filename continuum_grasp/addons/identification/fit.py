"""Result of an identification, and a scene with estimated values in it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.addons.identification.comparison import Predicted
from continuum_grasp.addons.identification.inference import Inference
from continuum_grasp.addons.identification.searches import LawTrial
from continuum_grasp.addons.identification.unknowns import ALONG, DELAY, LAG, Unknown
from continuum_grasp.base import Array, InputError
from continuum_grasp.model import Parameters
from continuum_grasp.results import Dimension, File, Picture, Stored
from continuum_grasp.scene import FingerScene


@dataclass(frozen=True)
class Fit(Predicted):
    """Estimated parameters with their uncertainty, and how well the model predicts the data.

    Attributes
    ----------
    names, units : tuple of str
        Names and units of the n parameters.
    freedom : int
        Degrees of freedom of the residuals' scatter; fewer where residuals are correlated in time.
    sets, predictions, drawn, scene
        As in `Comparison`.
    targets : tuple of (str, float, bool)
        Per parameter, the model's parameter that it sets, its factor, and whether it adds to the scene's value.
    set_names : tuple of str
        Name, set and unit of each set's own unknowns: parameters that are estimated per set, and estimated starts.
    status : {"converged", "implausible"}
        ``implausible``: this finger cannot have the measurements: they lie beyond its length, or the best
        parameters miss them by far. Failures of the search raise ``SolverError``.
    reason : str
        Reason why the measurements are implausible; empty where they are plausible.
    causes : tuple of str
        Slips in the data that explain them, with the remaining misfit.
    laws : tuple of LawTrial
        Laws that were tried, with their errors of fitted and held-out data; none where there is only one.
    accepted : bool
        Whether estimates may be used although they are implausible.
    warnings : tuple of str
    statistics : mapping
    """

    kind: ClassVar[str] = "identify"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("values", "(parameter,)", "", "estimates"),
        Stored(
            "deviations",
            "(parameter,)",
            "",
            "their standard deviations; infinite where the data do not see a parameter",
        ),
        Stored("intervals", "(parameter, interval)", "", "95 % confidence intervals, by Student's t"),
        Stored("correlation", "(parameter, other)", "1", "correlation of the estimates"),
        Stored(
            "singular_values",
            "(parameter,)",
            "1",
            "singular values of the Jacobian, scaled by the data's deviations and typical parameters",
        ),
        Stored(
            "sigma", "(measurement,)", "", "standard deviations of the measured numbers, known or from the residuals"
        ),
        Stored("set_values", "(set_parameter,)", "", "estimates of each set's own unknowns"),
        Stored("set_deviations", "(set_parameter,)", "", "their standard deviations"),
        *Predicted.stored,
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension("parameter", "estimated parameters", "parameter_names"),
        Dimension("other", "the same", "parameter_names"),
        Dimension("interval", "ends of an interval", ("low", "high")),
        Dimension("set_parameter", "each set's own unknowns", "set_names"),
        *Predicted.dimensions,
    )
    texts: ClassVar[tuple[File, ...]] = (
        File("identified_finger.yaml", "continuum_grasp.addons.identification.fit:finger_text", needs="usable"),
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("residuals", "continuum_grasp.addons.identification.pictures:plot_residuals"),
        *Predicted.pictures,
    )

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    deviations: Array
    intervals: Array
    correlation: Array
    singular_values: Array
    freedom: float
    sigma: Array
    targets: tuple[tuple[str, float, bool], ...]
    set_names: tuple[str, ...] = ()
    set_values: Array = field(default_factory=lambda: np.zeros(0))
    set_deviations: Array = field(default_factory=lambda: np.zeros(0))
    status: str = "converged"
    reason: str = ""
    causes: tuple[str, ...] = ()
    accepted: bool = False
    laws: tuple[LawTrial, ...] = ()
    warnings: tuple[str, ...] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float:
        """Estimate of a parameter by its name."""
        return float(self.values[self.names.index(name)])

    @property
    def usable(self) -> bool | None:
        """True where the estimates may be used; None where the measurements are implausible, and not accepted."""
        return True if self.accepted or self.status == "converged" else None

    @property
    def verdict(self) -> str:
        """Status, why, and likely causes, in a sentence; empty where the measurements are plausible."""
        if not self.reason:
            return ""
        causes = " or ".join(self.causes) or "none of the usual slips of axes, signs, columns and units explains it"
        return f"{self.status}: {self.reason}; likely cause: {causes}"

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Name and unit of each parameter."""
        return tuple(f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True))

    def pairs(self) -> dict[str, str]:
        """Estimates with their standard deviations, and the errors of fitted data."""
        errors = [f"{of.name}: {of.rms:.3g} {of.unit} r.m.s. of {of.count}" for of in self.errors]
        return {**dict(list(estimate_texts(self, 6).items())[:5]), "errors": "; ".join(errors)}

    def apply(self, scene: FingerScene | None = None) -> Any:
        """A scene with the estimates in it.

        The delay of the drives becomes ``estimator.delay`` of a closed loop, in whole periods, since the loop cannot
        tell it from the age of a measurement; other scenes have no place for it.

        Parameters
        ----------
        scene : FingerScene, optional
            Any scene of one finger, such as a simulation or a closed loop; by default the identification's scene.

        Returns
        -------
        Scene of the same class

        Raises
        ------
        InputError
            If the scene does not take a value, or the measurements are implausible and that was not accepted.
        """
        if not self.usable:
            raise InputError(f"{self.verdict}; correct the data, or accept implausible data", key="data")
        return applied(self.scene if scene is None else scene, self.targets, self.values)

    def details(self) -> dict[str, Any]:
        """The identified finger, None where an estimate is out of a finger's range, and the summary."""
        finger, _ = _plain_finger(self)
        return {"identified_finger": finger, **self.summary()}

    def summary(self) -> dict[str, Any]:
        """Parameters and errors as plain data."""
        intervals = [list(interval) for interval in self.intervals]
        estimated = {"name": self.names, "unit": self.units, "value": self.values, "deviation": self.deviations}
        of_sets = {"name": self.set_names, "value": self.set_values, "deviation": self.set_deviations}
        return {
            "parameters": table_of(**estimated, interval=intervals),
            "correlation": self.correlation,
            "singular_values": self.singular_values,
            "freedom": self.freedom,
            "reason": self.reason,
            "causes": list(self.causes),
            "laws": [trial._asdict() for trial in self.laws],
            "errors": [dict(vars(channel)) for channel in self.errors],
            "holdout_errors": [dict(vars(channel)) for channel in self.holdout_errors],
            "sets": table_of(**of_sets),
            **super().details(),
        }


def table_of(**columns: Iterable[Any]) -> list[dict[str, Any]]:
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def estimate_texts(result: Any, digits: int) -> dict[str, str]:
    """Values of a result's unknowns with their standard deviations and units, by name."""
    rows = zip(result.names, result.values, result.deviations, result.units, strict=True)
    return {name: f"{value:.{digits}g} +/- {deviation:.2g} {unit}" for name, value, deviation, unit in rows}


def estimates(unknowns: Sequence[Unknown], values: Array, inference: Inference) -> dict[str, Any]:
    """Fields of a `Fit`, of the first unknowns, from some values and the inference about all."""
    count = len(unknowns)
    return {
        "names": tuple(unknown.name for unknown in unknowns),
        "units": tuple(unknown.unit for unknown in unknowns),
        "targets": tuple((unknown.target, unknown.factor, unknown.added) for unknown in unknowns),
        "values": values[:count],
        "deviations": inference.deviations[:count],
        "intervals": inference.intervals[:count],
        "correlation": inference.correlation[:count, :count],
        "singular_values": inference.singular_values,
        "freedom": inference.freedom,
    }


def _plain_finger(fit: Fit) -> tuple[dict[str, Any] | None, str]:
    """The identified finger as plain data; None, and why, where an estimate is out of a finger's range."""
    try:
        return fit.apply().finger.model_dump(mode="json", exclude_unset=True), ""
    except InputError as error:
        return None, str(error)


def finger_text(fit: Fit) -> str:
    """The identified finger as YAML, to which the ``finger`` of any configuration may refer by its path."""
    finger, why = _plain_finger(fit)
    if finger is None:
        return f"# Not a finger: {why}\n"
    head = f"# Identified from {', '.join(name for name, _ in fit.blocks)}.\n"
    head += "".join(f"# {name}: {text}\n" for name, text in estimate_texts(fit, 6).items())
    return fit.as_yaml({"schema_version": 1, **finger}, head, exact=True)


def applied(scene: Any, targets: Sequence[tuple[str, float, bool]], values: Array) -> Any:
    """The scene with values of unknowns in it, given what each sets, the factor to that, and whether it is added."""
    for (target, factor, added), value in zip(targets, values.tolist(), strict=True):
        if target == DELAY and getattr(scene, "estimator", None) is not None:
            period = scene.controller.step
            scene = scene.changed({"estimator.delay": period * round(value / period)})
        elif target == LAG and not (scene.finger.tendons or scene.finger.chambers):
            scene = scene.changed({"controller.input.time_constant": value})
        elif target not in (DELAY, ALONG):
            changes = _changes(scene, target, factor * value, added)
            scene = scene.changed({f"finger.{key}": new for key, new in changes.items()})
    return scene


def _changes(scene: FingerScene, target: str, value: float, added: bool) -> Mapping[str, Any]:
    """Changes of a finger by a run-time parameter of the model, as in ``FingerModel(..., parameters=...)``."""
    finger = scene.finger
    x, y = finger.base.position
    if added and target == "base_angle":
        return {"base.angle": finger.base.angle + value}
    if added:
        return {"base.position": (x + value, y) if target == "base_position_x" else (x, y + value)}
    if target in ("bending_stiffness", "linear_density", "rotary_inertia"):
        return {f"rod.{key}": number for key, number in _rod(scene, target, value).items()}
    if target == "tip_mass":
        others = [mass for mass in finger.masses if not finger.rod.is_tip(mass.at)]
        return {"masses": [*others, {"at": finger.rod.length, "mass": value}]}
    numbers = Parameters.numbers_of(finger)
    if target not in numbers:
        raise InputError(f"no value of the scene corresponds to {target}")
    return dict.fromkeys(numbers[target].places(finger), value)


def _rod(scene: FingerScene, target: str, value: float) -> dict[str, float]:
    """Changes of a finger's rod in its own terms: section and material, or linear density and bending stiffness.

    The values are factors for a graded rod.
    """
    rod = scene.finger.rod
    if rod.graded:
        if target == "bending_stiffness" and isinstance(rod.youngs_modulus, float) and rod.one_modulus:
            return {"youngs_modulus": value * rod.youngs_modulus}
        return {f"factors.{target}": value * float(getattr(rod.factors, target))}
    if target == "rotary_inertia" or not (isinstance(rod.youngs_modulus, float) and isinstance(rod.density, float)):
        return {target: value}
    # of a rod that is given by its section, the section stays and the material changes
    if target == "bending_stiffness":
        return {"youngs_modulus": value * rod.youngs_modulus / rod.stiffness}
    # in the model the rotary inertia stays while the linear density changes
    return {"rotary_inertia": rod.inertia_per_length, "density": value * rod.density / rod.mass_per_length}
