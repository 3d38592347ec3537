"""Commands that show what is unknown of a finger and its drives, and how well they show it."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arguments import check_arguments
from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError
from continuum_grasp.identification.data import Reading, TipPath
from continuum_grasp.identification.inference import Inference, infer
from continuum_grasp.identification.path_block import PathBlock
from continuum_grasp.identification.read import plain_scene
from continuum_grasp.identification.segments import Design, Segment, patterns_of
from continuum_grasp.identification.unknowns import Unknown, read_unknowns
from continuum_grasp.results.declared import Dimension, File, Picture, Stored
from continuum_grasp.results.result import Result
from continuum_grasp.results.yaml_text import yaml_text
from continuum_grasp.scene.identify import Column, IdentifyScene, TipTrajectory
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.simulate import simulate
from continuum_grasp.simulation.trajectory import Trajectory

_ROUNDS = 30
"""Rounds of adjusting the segments' shares of time, which settle to a percent in a dozen."""
_LEAST = {"hold": 0.3, "loop": 1.1, "steps": 0.5, "sweep": 0.9}
"""Least share of time of a segment, per equal shares [1]: none is left out, since the values at which the information
is taken are guesses, a loop must stay slow, and a sweep swing."""
_LESS, _TRIES = 0.85, 12
"""Factor on the commands where the motion that they cause goes beyond a limit [1], and how often."""


@dataclass(frozen=True)
class ExcitationPlan(Result):
    """Commands over time, and the standard deviations that the unknowns will have.

    Attributes
    ----------
    names, units : tuple of str
        Of the n unknowns.
    segments : tuple of Segment
        Parts of the commands: name, what it shows, start and end [s].
    command_names : tuple of str
        Name and unit of each command.
    rehearsal : Trajectory
        The motion that the commands cause, at the values that the scene has.
    scene : Scene
        With the commands in it, for `simulate`.
    status : str
    warnings : tuple of str
        What these commands cannot show, and where the motion goes beyond a limit.
    statistics : mapping
    """

    kind: ClassVar[str] = "excitation"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("t", "(time,)", "s", "instants"),
        Stored("commands", "(time, command)", "", "what the drives are commanded"),
        Stored(
            "values", "(unknown,)", "", "unknowns at which the deviations are predicted: of the scene, or the start"
        ),
        Stored("deviations", "(unknown,)", "", "standard deviations that they will have"),
        Stored("shares", "(unknown, segment)", "1", "of the information on each unknown, from each segment"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension("time", "instants", "t", "s"),
        Dimension("command", "commands of the drives", "command_names"),
        Dimension("unknown", "what is to be estimated", "unknown_names"),
        Dimension("segment", "segments of the commands", "segment_names"),
    )
    texts: ClassVar[tuple[File, ...]] = (
        File("excitation.csv", "identification.excitation:csv_of"),
        File("excitation.yaml", "identification.excitation:yaml_of"),
    )
    pictures: ClassVar[tuple[Picture, ...]] = (Picture("excitation", "plotting.identification:plot_excitation"),)

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    deviations: Array
    shares: Array
    segments: tuple[Segment, ...]
    t: Array
    commands: Array
    command_names: tuple[str, ...]
    rehearsal: Trajectory
    scene: Scene
    status: str
    warnings: tuple[str, ...]
    statistics: Mapping[str, Any]

    @property
    def unknown_names(self) -> tuple[str, ...]:
        """Name and unit of each unknown."""
        return tuple(f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True))

    @property
    def segment_names(self) -> tuple[str, ...]:
        """Names of the segments."""
        return tuple(one.name for one in self.segments)

    @property
    def shown_in(self) -> tuple[str, ...]:
        """Per unknown the segment that shows most of it per second; none for what cannot be seen."""
        rates = self.shares / np.array([one.end - one.start for one in self.segments])
        return tuple(self.segments[int(np.argmax(row))].name if np.any(row > 0.0) else "none" for row in rates)

    def pairs(self) -> dict[str, str]:
        """Unknowns with the deviations that they will have."""
        rows = zip(self.names, self.values, self.deviations, self.units, strict=True)
        return {name: f"{value:.4g} +/- {deviation:.2g} {unit}" for name, value, deviation, unit in rows}

    def details(self) -> dict[str, Any]:
        """Unknowns and segments as plain data."""
        keys = ("name", "unit", "value", "deviation", "shown_in")
        rows = zip(self.names, self.units, self.values, self.deviations, self.shown_in, strict=True)
        return {
            "unknowns": [dict(zip(keys, row, strict=True)) for row in rows],
            "segments": [one._asdict() for one in self.segments],
        }


@check_arguments
def design_excitation(scene: IdentifyScene) -> ExcitationPlan:
    """Design commands from which the unknowns of a scene can be estimated.

    Slow loops with an inner loop, steps and sweeps to each side, and of both tendons together, as far as ``reach`` of
    the limits allows. Fisher's information of the readings, those of the first data of ``kind: trajectory`` with their
    ``sigma``, gives the standard deviations of the unknowns before anything is measured, and the share of time of each
    segment (A-optimal by multiplicative updates, V. Fedorov, 1972).

    Parameters
    ----------
    scene : IdentifyScene

    Returns
    -------
    ExcitationPlan

    Raises
    ------
    InputError
        If no path is among the data, or the deviation of a reading is not stated.
    SolverError, NumericalError
        If the finger has no motion under the commands.

    Examples
    --------
    >>> from continuum_grasp.identification import IdentifyScene, design_excitation
    >>> scene = IdentifyScene(
    ...     finger={"rod": {"length": 0.2, "linear_density": 0.03, "bending_stiffness": 0.005}},
    ...     gravity=(0.0, 0.0),
    ...     fidelity={"family": "arc", "elements": 1},
    ...     estimate=[{"name": "bending_stiffness"}, {"name": "material_damping", "start": 1e-4}],
    ...     data=[{"kind": "trajectory", "sigma": 1e-3}],  # of the tip [m]
    ...     excitation={"duration": 2.0, "sample": 0.01},
    ... )
    >>> plan = design_excitation(scene)
    >>> plan.segment_names[:3], bool(plan.deviations[0] < 1e-4)
    (('hold', 'loop to the left', 'loop to the right'), True)
    """
    logged = _logged(scene)
    unknowns = read_unknowns(scene, scene.estimate)
    design = Design(plain_scene(scene), patterns_of(scene), scene.excitation)

    def information(rehearsal: Trajectory) -> Array:
        return _information(rehearsal, logged, unknowns)

    return excitation_of(design, unknowns, information, design.within)


def excitation_of(
    design: Design,
    unknowns: Sequence[Unknown],
    information: Callable[[Trajectory], Array],
    allowed: Callable[[Trajectory], bool],
) -> ExcitationPlan:
    """Plan of a design: shares of time by Fisher's information, and commands as large as a rehearsal is allowed to be.

    ``information`` gives the derivatives (T, readings, n) of readings after each sample of a rehearsal, per standard
    deviation.
    """
    values = np.array([one.start for one in unknowns])
    weights, scale = np.ones(len(design.parts)) / len(design.parts), 1.0
    least = np.array([_LEAST[part.form] for part in design.parts]) / len(design.parts)
    for last in (False, True):
        rehearsal = simulate(design.scene(weights, scale))
        for _ in range(_TRIES):
            if allowed(rehearsal):
                break
            scale *= _LESS
            rehearsal = simulate(design.scene(weights, scale))
        jacobian, segments = information(rehearsal), design.segments(weights)
        own = [(rehearsal.t[1:] > one.start) & (rehearsal.t[1:] <= one.end) for one in segments]
        if not last:
            weights = _shares_of_time(jacobian, own, np.array([one.typical for one in unknowns]), least)
    found = _predicted(unknowns, values, jacobian.reshape(-1, len(unknowns)))
    warnings = [one.replace("the data", "these commands") for one in found.warnings]
    each = np.stack([np.sum(jacobian[rows] ** 2, axis=(0, 1)) for rows in own], axis=1)
    labels = tuple(one.label for one in rehearsal.scene.finger.inputs)
    return ExcitationPlan(
        names=tuple(one.name for one in unknowns),
        units=tuple(one.unit for one in unknowns),
        values=values,
        deviations=found.deviations,
        shares=each / np.maximum(each.sum(axis=1, keepdims=True), 1e-300),
        segments=segments,
        t=rehearsal.t,
        commands=rehearsal.u[:, : len(labels)],
        command_names=labels,
        rehearsal=rehearsal,
        scene=rehearsal.scene,
        status="designed",
        warnings=(*warnings, *rehearsal.warnings),
        statistics={"readings": len(jacobian) * jacobian.shape[1], "scale": scale},
    )


def _logged(scene: IdentifyScene) -> TipTrajectory:
    """The data that will be logged."""
    for k, one in enumerate(scene.data):
        if isinstance(one, TipTrajectory):
            wanted = [(f"data[{k}].sigma", one.sigma)] if one.x is not None or one.y is not None else []
            wanted += [(f"data[{k}].measured[{j}].sigma", reading.sigma) for j, reading in enumerate(one.measured)]
            if any(isinstance(of.at, Column) or isinstance(of.offset, Column) for of in one.readings):
                raise InputError("before anything is measured places are numbers, not columns", key=f"data[{k}]")
            for key, sigma in wanted:
                if sigma is None:
                    raise InputError("deviations cannot be predicted without that of every reading", key=key)
            return one
    raise InputError("an excitation is designed for readings: data: [{kind: trajectory, ...}]", key="data")


def _information(rehearsal: Trajectory, logged: TipTrajectory, unknowns: Sequence[Unknown]) -> Array:
    """Derivatives (T, readings, n) of what will be logged, per standard deviation."""
    t = rehearsal.t[1:]
    none = np.zeros(t.size)
    readings = [Reading(m.quantity, none, m.place, m.sigma, m.since, m.of) for m in logged.readings]
    block = PathBlock(rehearsal.scene, TipPath(t, measured=readings, name="excitation"), unknowns)
    _, slopes = block.predict(np.array([one.start for one in unknowns]))
    sigma = np.array([entry.sigma for entry in block.entries], dtype=float)
    return np.asarray((slopes / sigma[:, None]).reshape(t.size, -1, len(unknowns)))


def _predicted(unknowns: Sequence[Unknown], values: Array, jacobian: Array) -> Inference:
    """Deviations that least squares will report where residuals scatter as stated."""
    rows = len(jacobian)
    residuals = np.full(rows, np.sqrt(max(rows - len(unknowns), 0) / rows))
    free = [one._replace(lower=-np.inf, upper=np.inf) for one in unknowns]
    return infer(free, values, jacobian, residuals)


def _shares_of_time(jacobian: Array, segments: Sequence[NDArray[np.bool_]], sizes: Array, least: Array) -> Array:
    """Shares of time that make the sum of the squared deviations, relative to the sizes, least."""
    scaled = jacobian * sizes
    each = np.array([np.einsum("tri,trj->ij", scaled[own], scaled[own]) / max(own.sum(), 1) for own in segments])
    weights = np.full(len(each), 1.0 / len(each))
    for _ in range(_ROUNDS):
        total = np.einsum("s,sij->ij", weights, each)
        # Directions that nothing shows have no say.
        inverse = np.linalg.pinv(total, rcond=1e-12, hermitian=True)
        gain = np.einsum("ij,sjk,ki->s", inverse, each, inverse)
        weights = _at_least(weights * np.sqrt(np.maximum(gain, 0.0)), least)
    return weights


def _at_least(weights: Array, least: Array) -> Array:
    """Shares of one in proportion to weights, but for those that would be below their least one."""
    low = np.zeros(weights.size, dtype=bool)
    while True:
        rest = (1.0 - least[low].sum()) / max(float(weights[~low].sum()), 1e-300)
        found = np.where(low, least, rest * weights)
        if not np.any(found < least):
            return found
        low |= found < least


def csv_of(plan: ExcitationPlan) -> str:
    """The commands as a table for the drives' controller, and for a log."""
    text = io.StringIO()
    rows, header = np.column_stack([plan.t, plan.commands]), ",".join(["t [s]", *plan.command_names])
    np.savetxt(text, rows, delimiter=",", fmt="%.9g", header=header, comments="")
    return text.getvalue()


def yaml_of(plan: ExcitationPlan) -> str:
    """The scene with the commands, which ``simulate`` reads."""
    lines = [f"# {one.start:g} to {one.end:g} s: {one.name}, {one.shows}" for one in plan.segments]
    return "\n".join([*lines, yaml_text(plan.scene.model_dump(mode="json", exclude_unset=True), exact=True)])
