"""How one mission went on many plants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from continuum_grasp.mission.plant import Variation
from continuum_grasp.mission.verdict import Verdict

__all__ = ["Outcome", "Summary", "save_trials", "summarize"]


@dataclass(frozen=True)
class Outcome:
    """One plant, and how the mission went on it; ``error`` says why there is no verdict."""

    variation: Variation
    verdict: Verdict | None
    error: str = ""

    @property
    def succeeded(self) -> bool:
        """Held from lift to lowering, and let go."""
        return self.verdict is not None and self.verdict.succeeded

    @property
    def text(self) -> str:
        """The plant and what became of the object, in one line."""
        v = self.variation
        shares = {"stiffness": v.stiffness, "damping": v.damping, "mass": v.mass, "friction": v.friction}
        plant = ", ".join(f"{name} {value:.3f}" for name, value in shares.items() if value is not None)
        x, y = (1e3 * value for value in v.shift)
        found = self.error.partition("\n")[0]
        if self.verdict is not None:
            found = f"{self.verdict.word}, sunk {1e3 * self.verdict.sunk:.3g} mm"
        return f"{plant}, shifted by ({x:+.2f}, {y:+.2f}) mm: {found}"


@dataclass(frozen=True)
class Summary:
    """Many plants in numbers; of those that have a verdict.

    Attributes
    ----------
    plants, held, succeeded : int
        All of them; those on which the object was never dropped; those that also let it go in the end.
    force_error_median, force_error_worst, estimate_error_worst : float
        Of the held contact force, per setpoint; see ``Verdict``.
    sunk_worst, moved_worst : float
        [m]
    slip_margin_least : float
        Share of the friction cone.
    fallbacks : int
        On all plants together.
    failed : tuple of int
        Those that did not succeed, by number.
    """

    plants: int
    held: int
    succeeded: int
    force_error_median: float
    force_error_worst: float
    estimate_error_worst: float
    sunk_worst: float
    moved_worst: float
    slip_margin_least: float
    fallbacks: int
    failed: tuple[int, ...]

    def pairs(self) -> dict[str, str]:
        """Values with their units, by name."""
        return {
            "held": f"{self.held} of {self.plants} plants",
            "held and released": f"{self.succeeded} of {self.plants}",
            "held force": f"{100 * self.force_error_median:.1f} % off its setpoint (median of plants), "
            f"{100 * self.force_error_worst:.1f} % at worst",
            "its estimate": f"{100 * self.estimate_error_worst:.1f} % off at worst",
            "sunk": f"{1e3 * self.sunk_worst:.3g} mm at worst",
            "moved": f"{1e3 * self.moved_worst:.3g} mm at worst",
            "slip margin": f"{self.slip_margin_least:.2f} of the friction cone at least",
            "fallbacks": f"{self.fallbacks}",
        }


def summarize(outcomes: Sequence[Outcome]) -> Summary:
    """Many plants in numbers."""
    judged = [outcome.verdict for outcome in outcomes if outcome.verdict is not None]

    def column(name: str) -> np.ndarray:
        values = np.abs(np.array([getattr(verdict, name) for verdict in judged], dtype=float))
        values = values[~np.isnan(values)]
        return values if values.size else np.array([np.nan])

    return Summary(
        plants=len(outcomes),
        held=sum(verdict.held for verdict in judged),
        succeeded=sum(outcome.succeeded for outcome in outcomes),
        force_error_median=float(np.median(column("force_error"))),
        force_error_worst=float(column("force_error").max()),
        estimate_error_worst=float(column("force_estimate_error").max()),
        sunk_worst=float(column("sunk").max()),
        moved_worst=float(column("moved").max()),
        slip_margin_least=float(column("slip_margin").min()),
        fallbacks=sum(verdict.fallbacks for verdict in judged),
        failed=tuple(k for k, outcome in enumerate(outcomes) if not outcome.succeeded),
    )


def save_trials(outcomes: Sequence[Outcome], folder: str | Path) -> Path:
    """Write ``trials.csv`` into a folder, one line per plant.

    Returns
    -------
    pathlib.Path
        The file.
    """
    from continuum_grasp.results import begin_run, write_text

    rows: list[dict[str, object]] = []
    for outcome in outcomes:
        own = asdict(outcome.variation)
        x, y = own.pop("shift")
        judged = asdict(outcome.verdict) if outcome.verdict is not None else {}
        rows.append({**own, "shift_x": x, "shift_y": y, **judged, "error": outcome.error.replace("\n", " ")})
    columns = list(dict.fromkeys(name for row in rows for name in row))
    lines = [",".join(columns), *(",".join(_cell(row.get(name, "")) for name in columns) for row in rows)]
    return write_text("\n".join(lines) + "\n", begin_run(folder, "mpc") / "trials.csv")


def _cell(value: object) -> str:
    text = "" if value is None else f"{value:.9g}" if isinstance(value, float) else str(value)
    return '"' + text.replace('"', '""') + '"' if "," in text or '"' in text else text
