"""A residual that was learned, and how much it improves one-step predictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.results.declared import Dimension, File, Picture, Stored
from continuum_grasp.results.result import Result
from continuum_grasp.results.yaml_text import yaml_text
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.learned_residual import LearnedResidual

Array = NDArray[np.float64]


class OneStepError(NamedTuple):
    """Errors of one step in a log: r.m.s. of the tip's position [m] and velocity [m/s], without and with the residual.

    ``beyond`` is the share of its periods that are beyond the trust region [1].
    """

    log: str
    steps: int
    position: float
    position_with: float
    velocity: float
    velocity_with: float
    beyond: float
    holdout: bool


@dataclass(frozen=True)
class ResidualFit(Result):
    """A residual that was learned, and how much it improves one-step predictions.

    Attributes
    ----------
    residual : LearnedResidual or None
        None where nothing was learned.
    errors : tuple of OneStepError
        Of each log, those that were held out last.
    scene : ControlScene
        Without a residual.
    status : {"learned", "nothing_learned"}
        The latter where more than 70 % of the one-step errors of the tip's velocity are left, or predictions over ten
        periods get worse: the model is as good as the logs show, or they show too little.
    warnings : tuple of str
    statistics : mapping

    Examples
    --------
    >>> from continuum_grasp.identification import learn_residual
    >>> fit = learn_residual("configs/mpc/learned_friction.yaml", ["configs/mpc/learned_friction_log.csv"])
    >>> fit.status, len(fit.residual.coordinates)
    ('learned', 2)
    """

    kind: ClassVar[str] = "identify"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("without", "(step, tip)", "", "one-step errors of the model"),
        Stored("with_residual", "(step, tip)", "", "one-step errors of the model with the residual"),
        Stored("distance", "(step,)", "1", "distance from the logs, per that from which on the residual fades"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension("step", "periods, log by log"),
        Dimension("tip", "of the tip", ("x [m]", "y [m]", "x_rate [m/s]", "y_rate [m/s]")),
    )
    texts: ClassVar[tuple[File, ...]] = (File("residual.yaml", "identification.residual:residual_text"),)
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("one_step_errors", "plotting.identification:plot_one_step_errors"),
    )

    residual: LearnedResidual | None
    errors: tuple[OneStepError, ...]
    without: Array
    with_residual: Array
    distance: Array
    scene: ControlScene
    status: str
    warnings: tuple[str, ...] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)

    def headline(self) -> str:
        """Size of the residual, and number of logs."""
        return f"{self.status.replace('_', ' ')}, {sum(not one.holdout for one in self.errors)} logs"

    def pairs(self) -> dict[str, str]:
        """Errors of one step in each log, without and with the residual."""
        names = [one.log for one in self.errors]
        return {
            (
                one.log if names.count(one.log) == 1 else f"{one.log} {k + 1}"
            ): f"tip {1e3 * one.position:.3g} -> {1e3 * one.position_with:.3g} mm, "
            f"{1e3 * one.velocity:.3g} -> {1e3 * one.velocity_with:.3g} mm/s{', held out' if one.holdout else ''}"
            for k, one in enumerate(self.errors)
        }

    def apply(self, scene: Any = None) -> Any:
        """A scene with the residual in its ``fidelity``; that of the logs where not given.

        Raises
        ------
        InputError
            If nothing was learned.
        """
        if self.residual is None:
            raise InputError("nothing was learned from these logs: the model predicts them as well without a residual")
        return (self.scene if scene is None else scene).changed({"fidelity.residual": self.residual})

    def details(self) -> dict[str, Any]:
        """Errors of each log, as plain data."""
        return {"errors": [one._asdict() for one in self.errors]}


def residual_text(fit: ResidualFit) -> str:
    """The residual as YAML, to which ``fidelity.residual`` of a configuration may refer by its path."""
    if fit.residual is None:
        return "# Nothing was learned: the model predicts these logs as well without a residual.\n"
    head = f"# Learned from {', '.join(one.log for one in fit.errors if not one.holdout)}.\n"
    head += "".join(f"# {name}: {text}\n" for name, text in fit.pairs().items())
    return head + yaml_text({"schema_version": 1, **fit.residual.model_dump(mode="json")}, exact=True)
