"""Outcomes of a mission on many plants."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.addons.mission.plant import PlantVariation
from continuum_grasp.addons.mission.scene import MissionScene
from continuum_grasp.addons.mission.verdict import MissionVerdict
from continuum_grasp.results import Dimension, File, Picture, Result, Stored


@dataclass(frozen=True)
class Outcome:
    """A plant, and the outcome of the mission on it; ``error`` has the reason for a missing verdict."""

    variation: PlantVariation
    verdict: MissionVerdict | None
    error: str = ""

    @property
    def succeeded(self) -> bool:
        """As `MissionVerdict.succeeded`; false where there is no verdict."""
        return self.verdict is not None and self.verdict.succeeded

    @property
    def text(self) -> str:
        """The plant and what became of the object, in one line."""
        v = self.variation
        shares = {"stiffness": v.stiffness, "damping": v.damping, "mass": v.mass, "friction": v.friction}
        if v.tendon_friction != 1.0:
            shares["tendon friction"] = v.tendon_friction
        if v.friction_fall:
            shares["friction falls by"] = v.friction_fall
        plant = ", ".join(f"{name} {value:.3f}" for name, value in shares.items() if value is not None)
        x, y = (1e3 * value for value in v.shift)
        ending = self.error.partition("\n")[0]
        if self.verdict is not None:
            ending = f"{self.verdict.word}, sunk {1e3 * self.verdict.sunk:.3g} mm"
            ending = "; ".join([ending, *(f"{name}: {text}" for name, text in self.verdict.texts.items())])
        return f"{plant}, shifted by ({x:+.2f}, {y:+.2f}) mm: {ending}"


@dataclass(frozen=True)
class Summary:
    """Many plants in numbers; of those that have a verdict, whose attributes they are of."""

    plants: int  # number of plants
    held: int  # of those on which the object was never dropped
    succeeded: int  # of those that also let it go, did not trip, and turned it before where that was asked for
    force_error_median: float
    force_error_worst: float
    estimate_error_worst: float
    estimate_error_normalized: float  # root mean square of the estimate's error per its stated standard deviation [1]
    sunk_worst: float
    moved_worst: float
    slip_margin_least: float
    fallbacks: int  # fallback commands on all plants together
    failed: tuple[int, ...]  # which plants did not succeed
    turned: int | None = None  # number of plants on which it was turned as asked; None where that was not asked for
    turn_error_median: float | None = None  # of the object's angle before it was grasped, without its sign [rad]
    turn_error_worst: float | None = None

    def pairs(self) -> dict[str, str]:
        """Values with their units, by name."""
        head = {"held": f"{self.held} of {self.plants} plants"}
        if self.turned is not None and self.turn_error_median is not None and self.turn_error_worst is not None:
            head["turned"] = (
                f"{self.turned} of {self.plants}, {math.degrees(self.turn_error_median):.2g} deg off (median), "
                f"{math.degrees(self.turn_error_worst):.2g} deg at worst"
            )
        done = "held and released" if self.turned is None else "turned, held and released"
        return {
            **head,
            done: f"{self.succeeded} of {self.plants}",
            "held force": f"{100 * self.force_error_median:.1f} % off its setpoint (median of plants), "
            f"{100 * self.force_error_worst:.1f} % at worst",
            "its estimate": f"{100 * self.estimate_error_worst:.1f} % off at worst, "
            f"{self.estimate_error_normalized:.2g} stated standard deviations (r.m.s.)",
            "sunk": f"{1e3 * self.sunk_worst:.3g} mm at worst",
            "moved": f"{1e3 * self.moved_worst:.3g} mm at worst",
            "slip margin": f"{self.slip_margin_least:.2f} of the friction cone at least",
            "fallbacks": f"{self.fallbacks}",
        }


@dataclass(frozen=True)
class TrialsResult(Result, Sequence[Outcome]):
    """A mission on many plants: a sequence of `Outcome`.

    Attributes
    ----------
    scene : MissionScene
    outcomes : tuple of Outcome
        In the order of ``variations``.
    status : {"finished", "interrupted"}
    """

    kind: ClassVar[str] = "mpc"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("stiffness", "(plant,)", "1", "bending stiffness relative to the controller's finger"),
        Stored("damping", "(plant,)", "1", "damping relative to the controller's finger"),
        Stored("mass", "(plant,)", "1", "mass of the object relative to the mission's"),
        Stored("friction", "(plant,)", "1", "friction of the object relative to the mission's"),
        Stored("shift_x", "(plant,)", "m", "error of the object's place, world x"),
        Stored("shift_y", "(plant,)", "m", "the same, world y"),
        Stored("succeeded", "(plant,)", "1", "whether the object was held and let go, without a trip"),
        Stored("held", "(plant,)", "1", "whether the object was never dropped"),
        Stored("released", "(plant,)", "1", "whether nothing of the finger touched it in the end"),
        Stored("sunk", "(plant,)", "m", "greatest height that it lost between lift and lowering"),
        Stored("moved", "(plant,)", "m", "greatest distance that it moved in the plane while it was held"),
        Stored("force_error", "(plant,)", "1", "greatest error of the held contact force, per setpoint"),
        Stored("force_mean_error", "(plant,)", "1", "error of its mean, per setpoint"),
        Stored("force_estimate_error", "(plant,)", "1", "error of the mean of its estimate, per setpoint"),
        Stored("force_estimate_std", "(plant,)", "1", "standard deviation that the estimator states, per setpoint"),
        Stored("slip_margin", "(plant,)", "1", "least share of the friction cone that was left while nothing pulled"),
        Stored("pulled_margin", "(plant,)", "1", "the same while something pulled"),
        Stored("fallbacks", "(plant,)", "1", "commands that were not of a new plan"),
        Stored("turn_error", "(plant,)", "rad", "error of the object's angle after a turn, before it was grasped"),
        Stored("turn_end_error", "(plant,)", "rad", "the same at the end of the mission"),
        Stored("turn_reason", "(plant,)", "text", "reason for a failed turn; empty where there is none"),
        Stored("tripped", "(plant,)", "text", "reason for a trip; empty where there is none"),
        Stored("refused", "(plant,)", "text", "reason for an object that was not lifted; empty where it was"),
        Stored("doubted", "(plant,)", "text", "contradictions to the lift; empty where there are none"),
        Stored("slipped", "(plant,)", "text", "noticed slip, and the response; empty where there is none"),
        Stored("drop", "(plant,)", "text", "reason for a drop; empty where there is none"),
        Stored("touching", "(plant,)", "text", "parts that were not released, and why; empty where all were"),
        Stored("error", "(plant,)", "text", "reason for a missing verdict"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (Dimension("plant", "plants, in the order of the draws"),)
    texts: ClassVar[tuple[File, ...]] = (File("trials.csv", "continuum_grasp.addons.mission.outcomes:trials_csv"),)
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("trials", "continuum_grasp.addons.mission.pictures:plot_trials", panels=True),
    )

    scene: MissionScene
    outcomes: tuple[Outcome, ...]
    status: str = "finished"
    warnings: tuple[str, ...] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.outcomes)

    def __getitem__(self, index: Any) -> Any:
        return self.outcomes[index]

    @property
    def outcome(self) -> str:
        """Number of plants that succeeded."""
        done = "held and released" if self.scene.turn is None else "turned, held and released"
        return f"{sum(outcome.succeeded for outcome in self.outcomes)} of {len(self)} plants {done} the object"

    def stored_arrays(self) -> dict[str, Any]:
        """Variation and verdict of every plant; NaN, and false, where there is none."""
        rows = [_row(outcome) | {"succeeded": outcome.succeeded} for outcome in self.outcomes]
        columns: dict[str, Any] = {}
        for stored in self.stored:
            kind: type = (
                str if stored.unit == "text" else bool if stored.name in ("succeeded", "held", "released") else float
            )
            columns[stored.name] = np.array(
                [row.get(stored.name, "" if kind is str else None) for row in rows], dtype=kind
            )
        return columns

    @cached_property
    def summary(self) -> Summary:
        """All plants in numbers; of those that have a verdict."""
        judged = [outcome.verdict for outcome in self.outcomes if outcome.verdict is not None]

        def column(name: str) -> np.ndarray:
            values = np.abs(np.array([getattr(verdict, name) for verdict in judged], dtype=float))
            values = values[~np.isnan(values)]  # a mission that was dropped early has no hold
            return values if values.size else np.array([np.nan])

        turns = [verdict.turned for verdict in judged if verdict.turned is not None]
        away = np.abs([turn.error for turn in turns if not np.isnan(turn.error)])
        return Summary(
            plants=len(self),
            held=sum(verdict.held for verdict in judged),
            succeeded=sum(outcome.succeeded for outcome in self.outcomes),
            force_error_median=float(np.median(column("force_error"))),
            force_error_worst=float(column("force_error").max()),
            estimate_error_worst=float(column("force_estimate_error").max()),
            estimate_error_normalized=float(
                np.sqrt(np.mean((column("force_estimate_error") / column("force_estimate_std")) ** 2))
            ),
            sunk_worst=float(column("sunk").max()),
            moved_worst=float(column("moved").max()),
            slip_margin_least=float(column("slip_margin").min()),
            fallbacks=sum(verdict.fallbacks for verdict in judged),
            failed=tuple(k for k, outcome in enumerate(self.outcomes) if not outcome.succeeded),
            turned=sum(turn.achieved for turn in turns) if turns else None,
            turn_error_median=float(np.median(away)) if away.size else None,
            turn_error_worst=float(away.max()) if away.size else None,
        )

    def pairs(self) -> dict[str, str]:
        """Summary of the plants, as names and values."""
        return self.summary.pairs()

    def details(self) -> dict[str, Any]:
        """The summary, and the seed of the draws."""
        return {"seed": self.scene.trials.seed, "summary": asdict(self.summary)}


def _row(outcome: Outcome) -> dict[str, Any]:
    """Plant and verdict by name."""
    variation = asdict(outcome.variation)
    x, y = variation.pop("shift")
    judged: dict[str, Any] = {}
    if (verdict := outcome.verdict) is not None:
        judged = (
            asdict(verdict)
            | dict.fromkeys(("tripped", "refused", "doubted", "slipped", "drop", "touching"), "")
            | verdict.explained
        )
        del judged["turned"]
        if (turned := verdict.turned) is not None:
            judged |= {"turn_error": turned.error, "turn_end_error": turned.end_error, "turn_reason": turned.reason}
    return {**variation, "shift_x": x, "shift_y": y, **judged, "error": outcome.error.replace("\n", " ")}


def trials_csv(result: TrialsResult) -> str:
    """All plants as CSV, one line each."""
    rows = [_row(outcome) for outcome in result]
    names = list(dict.fromkeys(name for row in rows for name in row))

    def cell(value: Any) -> Any:
        return f"{value:.9g}" if isinstance(value, float) else value

    return result.as_csv(names, [[cell(row.get(name)) for name in names] for row in rows])
