"""Result of commissioning: how a bench is mounted, and the configuration that is corrected by it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from continuum_grasp.addons.identification.commissioning.bench import BIAS, CAMERA, FRICTION, ZERO
from continuum_grasp.addons.identification.fit import Fit, applied, estimate_texts
from continuum_grasp.base import InputError
from continuum_grasp.control import ControlLog
from continuum_grasp.results import File, Picture
from continuum_grasp.scene import ControlScene, Mounting


class Alternative(NamedTuple):
    """A way in which the bench may be connected: in words, and how far it misses the tip (r.m.s.) [m]."""

    what: str
    missed: float


@dataclass(frozen=True)
class Commissioning(Fit):
    """Mounting of a bench, with intervals, and the configuration that is corrected by it.

    Attributes
    ----------
    mounting : Mounting
    alternatives : tuple of Alternative
        Connections that fit the log equally, the best one first; only one where the log decides.
    undetermined : tuple of str
        Facts that the log does not show, in sentences.
    log : ControlLog or None
        The log of a simulated plant.
    status : {"identified", "undecided", "mismatch"}
        All connections are known; or several fit, or a drive moves nothing; or none fits this finger.
    """

    kind: ClassVar[str] = "commission"
    texts: ClassVar[tuple[File, ...]] = (
        File(
            "commissioned.yaml",
            "continuum_grasp.addons.identification.commissioning.result:configuration_text",
            needs="usable",
        ),
        File("report.txt", "continuum_grasp.addons.identification.commissioning.result:report_text"),
        File("log.csv", "continuum_grasp.addons.identification.commissioning.result:log_text", needs="log"),
    )
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("series", "continuum_grasp.addons.identification.pictures:plot_series", panels=True),
        Picture("residuals", "continuum_grasp.addons.identification.pictures:plot_residuals"),
    )

    scene: ControlScene  # type: ignore[assignment]
    mounting: Mounting = field(default_factory=Mounting)
    alternatives: tuple[Alternative, ...] = ()
    undetermined: tuple[str, ...] = ()
    log: ControlLog | None = None

    @property
    def usable(self) -> bool | None:
        """True where the configuration may be used; None where connections are not known."""
        return True if self.status == "identified" else None

    def apply(self, scene: Any = None) -> Any:
        """A closed loop with mounting, stiffness, damping, lag and, in whole periods, delay of the bench in it.

        Raises
        ------
        InputError
            If the connections are not known.
        """
        if not self.usable:
            raise InputError(f"the bench is {self.status}: {'; '.join(self.undetermined)}", key="log")
        rows = zip(self.targets, self.values.tolist(), strict=True)
        model_rows = [(of, value) for of, value in rows if of[0] not in (*CAMERA, ZERO, BIAS, FRICTION)]
        corrected = applied(
            self.scene if scene is None else scene, [of for of, _ in model_rows], np.array([v for _, v in model_rows])
        )
        return corrected.changed({"mounting": self.mounting})

    def pairs(self) -> dict[str, str]:
        """Connections, numbers with their deviations, and how well they predict the log."""
        ways = {
            f"way {k + 1}": f"{alternative.what}; {1e3 * alternative.missed:.2g} mm"
            for k, alternative in enumerate(self.alternatives)
        }
        return {
            **(ways if len(ways) > 1 else {"connected": ways["way 1"]}),
            **estimate_texts(self, 4),
            **({"undetermined": "; ".join(self.undetermined)} if self.undetermined else {}),
        }

    def details(self) -> dict[str, Any]:
        """Mounting, alternatives and the summary as plain data."""
        return {
            "mounting": self.mounting.model_dump(mode="json"),
            "alternatives": [alternative._asdict() for alternative in self.alternatives],
            "undetermined": list(self.undetermined),
            **self.summary(),
        }


def configuration_text(result: Commissioning) -> str:
    """The corrected configuration as YAML."""
    plain = result.apply().model_dump(mode="json", exclude_unset=True)
    return result.as_yaml({"schema_version": 1, **plain}, exact=True)


def report_text(result: Commissioning) -> str:
    """Numbers with intervals, and what the log does not tell."""
    rows = [("status", result.status), *result.pairs().items()]
    lines = [f"{name}: {value}" for name, value in rows]
    ends = zip(result.names, result.intervals, result.units, strict=True)
    lines += [f"{name}: {low:.4g} to {high:.4g} {unit} (95 %)" for name, (low, high), unit in ends]
    return "\n".join([*lines, *result.warnings, ""])


def log_text(result: Commissioning) -> str:
    """The log of a simulated plant."""
    return "" if result.log is None else result.log.text()
