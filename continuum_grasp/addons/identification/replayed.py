"""A log of a finger through its controller: what that would have believed and commanded, and which sensor disagrees."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from continuum_grasp.addons.identification.comparison import Predicted
from continuum_grasp.addons.identification.numbers import MeasuredColumn, MeasuredSet
from continuum_grasp.addons.identification.periods import (
    DISAGREE,
    LATER,
    SWAPPED,
    Periods,
    Retuned,
    disagreement,
    innovations,
)
from continuum_grasp.base import Array, check_arguments, split_unit
from continuum_grasp.control import ControlLog
from continuum_grasp.results import Dimension, File, Picture, Stored
from continuum_grasp.scene import ControlScene, scene_of


class Suspicion(NamedTuple):
    """Sensors read otherwise: mean squared normalized innovation of all that is compared then, and of it as logged."""

    what: str
    after: float
    before: float


@dataclass(frozen=True)
class Replay(Predicted):
    """K periods of a log as a controller would have seen them; its predictions are the expected measurements.

    Attributes
    ----------
    frozen : tuple of str
        Channels that repeat one reading, where ``estimator.frozen`` looks for them.
    suspicions : tuple of Suspicion
        Each channel left out, and channels of a sensor swapped, the most likely one first.
    retuned : tuple of Retuned
        Noise of each channel, delay of measurements, lag of the drives.
    health : tuple of str
        As in `ControlRun`.
    status : {"consistent", "sensor", "mismatch"}
        Sensors and model agree; or all but one do, named by ``suspects``; or no sensor alone explains it.
    """

    kind: ClassVar[str] = "replay"
    stored: ClassVar[tuple[Stored, ...]] = (
        *Predicted.stored,
        Stored("t", "(period,)", "s", "instants of the controller, from the first of the log on"),
        Stored("innovation", "(period, compared)", "", "measured less expected; NaN without either"),
        Stored("innovation_std", "(period, compared)", "", "their standard deviations; NaN where none was compared"),
        Stored("u", "(period, input)", "", "commands that the controller gives"),
        Stored("logged", "(period, input)", "", "commands of the log; NaN where it has none"),
        Stored("estimate", "(period, model_state)", "", "estimated states of the controller's model"),
        Stored("std", "(period, estimated)", "", "standard deviations of states and disturbances"),
        Stored("health", "(period,)", "text", "whether sensors, model and call rate agreed"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        *Predicted.dimensions,
        Dimension("period", "instants of the controller", "t", "s"),
        Dimension("compared", "quantities that are compared with the model", "compared_names"),
        Dimension("input", "inputs of the finger", "u_names"),
        Dimension("model_state", "states of the controller's model", "estimated_names"),
        Dimension("estimated", "states, then disturbances", "estimated_names"),
    )
    texts: ClassVar[tuple[File, ...]] = (
        File("report.txt", "continuum_grasp.addons.identification.replayed:Replay.report"),
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("series", "continuum_grasp.addons.identification.pictures:plot_series", panels=True),
        Picture("innovations", "continuum_grasp.addons.identification.pictures:plot_innovations", panels=True),
    )
    predicted: ClassVar[str] = "believed"

    scene: ControlScene  # type: ignore[assignment]
    t: Array
    innovation: Array
    innovation_std: Array
    u: Array
    logged: Array
    estimate: Array
    std: Array
    health: tuple[str, ...]
    frozen: tuple[str, ...]
    suspicions: tuple[Suspicion, ...]
    retuned: tuple[Retuned, ...]
    compared_names: tuple[str, ...]
    u_names: tuple[str, ...]
    estimated_names: tuple[str, ...]
    status: str
    warnings: tuple[str, ...] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def suspects(self) -> tuple[str, ...]:
        """Sensors without which, or read otherwise, others agree; several where the log does not tell them apart."""
        if self.status != "sensor":
            return ()
        if self.frozen:
            return self.frozen
        alike = [
            # 1.2: disagreements within this factor of the least are alike: the log does not tell which of the sensors
            # it is
            suspicion.what
            for suspicion in self.suspicions
            if suspicion.after <= 1.2 * self.suspicions[0].after
        ]
        # Without either of two that are swapped, the others agree too; swapped back, nothing need be left out.
        return tuple([what for what in alike if what.endswith(SWAPPED)] or alike)

    def pairs(self) -> dict[str, str]:
        """Verdict, the disagreement that each suspicion leaves, commands, and numbers of the log beside those set."""
        both = np.isfinite(self.logged)
        off = float(np.abs((self.u - self.logged)[both]).max()) if both.any() else math.nan
        return {
            "periods": f"{len(self.t)} of {1e3 * self.scene.controller.step:g} ms",
            "sensors": self.status if not self.suspects else f"suspect: {' or '.join(self.suspects)}",
            **{
                suspicion.what: f"disagreement {suspicion.before:.3g} becomes {suspicion.after:.3g}"
                for suspicion in self.suspicions
            },
            "commands": f"{off:.3g} {split_unit(self.u_names[0]).unit} off the log's at most",
            **{parameter.name: str(parameter) for parameter in self.retuned},
        }

    def report(self) -> str:
        """The pairs as text."""
        return "".join(f"{name}: {value}\n" for name, value in self.pairs().items())

    def details(self) -> dict[str, Any]:
        """Suspicions and numbers of the log, as plain data."""
        suspicions = [suspicion._asdict() for suspicion in self.suspicions]
        retuned = [parameter._asdict() for parameter in self.retuned]
        return {"suspects": list(self.suspects), "suspicions": suspicions, "retuned": retuned}


@check_arguments
def replay(
    scene: ControlScene | str | PathLike[str],
    log: ControlLog | str | PathLike[str],
    *,
    progress: Callable[[float], None] | None = None,
) -> Replay:
    """Run a log through estimator, supervisor and controller of a scene, as if it were live.

    Each period takes the last sample of each channel since the period before; a channel that has none is absent. The
    finger gets the commands of the log, or the replayed ones where the log has none.

    Parameters
    ----------
    scene : ControlScene or path-like
        The scene, with an estimator, or its YAML file. Setpoints are its own, from the first instant of the log on.
    log : ControlLog or path-like
        Measurements: a `ControlLog`, or a table with a column ``t``, measurements by their names, and commands by
        the names of inputs behind ``commanded_``; instants may be uneven, cells empty. Numbers count as the model
        does, whatever the ``mounting``.
    progress : callable, optional
        Called with the share done so far, 0 to 1.

    Returns
    -------
    Replay

    Raises
    ------
    InputError
        If the scene has no estimator, or the log has none of its measurements.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> run = cg.run_closed_loop(cg.load("configs/mpc/steady_tip.yaml", ["duration=0.3"]))
    >>> found = cg.replay("configs/mpc/steady_tip.yaml", run.log)
    >>> found.status, bool(abs(found.u - run.u).max() < 1e-9)
    ('consistent', True)
    """
    known = scene_of(scene, ControlScene)
    periods = Periods(known, log)
    controller = periods.controller
    y = periods.measured()
    estimation = periods.estimation
    commands = periods.run(y)
    with_variances = innovations(commands)
    statistics = controller.statistics
    std = np.sqrt(np.where(with_variances[:, 1] > 0.0, with_variances[:, 1], np.nan))
    innovation = np.where(np.isfinite(std), with_variances[:, 0], np.nan)
    disagreements = disagreement(with_variances)
    suspicions = list[Suspicion]()
    report = progress or (lambda share: None)
    trials = periods.trials(y)
    for k, (what, other) in enumerate(trials):
        # A quantity of which a part is left out is not compared: its disagreement is NaN.
        after = disagreement(innovations(periods.run(other)))
        suspicions.append(Suspicion(what, float(np.nanmean(after)), float(np.nanmean(disagreements))))
        report((k + 1.0) / (len(trials) + LATER))
    suspicions.sort(key=lambda suspicion: suspicion.after)
    frozen = periods.frozen()
    status = "consistent" if np.nanmax(disagreements) <= DISAGREE else "mismatch"
    # 0.5: part of the disagreement that is left where the sensor at fault is left out, at most
    explained = bool(suspicions) and suspicions[0].after < 0.5 * suspicions[0].before
    if frozen or (status == "mismatch" and explained):
        status = "sensor"
    seen = np.nan_to_num(y) @ estimation.mixing.T
    name = log.name if isinstance(log, ControlLog) else Path(log).stem
    sets = list[MeasuredSet]()
    believed = list[Array]()
    for j, (what, unit) in enumerate(map(split_unit, estimation.y_names)):
        there = np.isfinite(std[:, j])
        numbers = seen[there, j, None]
        fitted = np.ones(there.sum(), dtype=bool)
        sets.append(
            MeasuredSet(name, (MeasuredColumn(what, what, unit),), periods.t[there], numbers, fitted, moves=True)
        )
        believed.append(seen[there, j] - innovation[there, j])
    return Replay(
        sets=tuple(sets),
        predictions=np.concatenate(believed),
        drawn=(),
        scene=known,
        t=periods.t,
        innovation=innovation,
        innovation_std=std,
        u=np.array([command.u for command in commands]),
        logged=periods.logged,
        estimate=np.array([command.estimate.x for command in commands]),
        std=np.array([command.estimate.std for command in commands]),
        health=tuple(command.health.name.lower() for command in commands),
        frozen=frozen,
        suspicions=tuple(suspicions),
        retuned=(*periods.noises(), periods.delay(), *periods.lag()),
        compared_names=estimation.y_names,
        u_names=controller.stages.u_names,
        estimated_names=controller.estimated_names,
        status=status,
        warnings=periods.warnings,
        statistics={**statistics, **periods.reported},
    )
