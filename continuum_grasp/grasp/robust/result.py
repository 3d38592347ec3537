"""Results for a grasp whose object is not as it should be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from continuum_grasp.base import Array, Summarized, amount_text
from continuum_grasp.grasp.object_supports import TouchedPlace

ERRORS = ("x", "y", "angle", "radius", "friction", "mass")
"""Errors, in the order of the columns."""


@dataclass(frozen=True)
class GraspTrials:
    """A grasp, tried with errors of its object.

    Attributes
    ----------
    tension : float
        Sum of its tensions as the scene is [N].
    margins : ndarray, shape (draws,)
        Least friction margin of each draw with these tensions, negative where a contact slips [1]; minus infinity where
        one parts or no posture balances, NaN where the solver has no answer.
    corner_margins : ndarray, shape (corners,)
        As ``margins``, at all corners of the bounds with the least friction.
    alone : dict of str to float
        Least margin with each bound's error alone, at its ends.
    worst : str
        The corner with the least reserve: errors of the object and friction states.
    weakest : dict of str to int
        Number of failing draws that fail first at each contact; with the name "balance", for want of any
        posture that balances.
    """

    tension: float
    margins: Array = field(repr=False)
    corner_margins: Array = field(repr=False)
    alone: Mapping[str, float]
    weakest: Mapping[str, int]
    worst: str = ""

    @property
    def held(self) -> int:
        """Draws that hold with the tensions fixed."""
        return int((self.margins >= 0.0).sum())

    @property
    def holds(self) -> bool:
        """Whether all draws and all corners hold with the tensions fixed."""
        return self.held == self.margins.size and bool((self.corner_margins >= 0.0).all())

    @property
    def least(self) -> float:
        """Least margin of all draws and corners [1]."""
        return float(np.nanmin(np.concatenate([self.margins, self.corner_margins])))


@dataclass(frozen=True)
class Robustness(Summarized):
    """Errors that a grasp sought for errors of its object bears, and errors that the best one without errors
    bears.

    Attributes
    ----------
    errors : ndarray, shape (draws, 6 + S)
        The draws: x, y [m], angle [rad], shares of size, friction and mass [1], and S friction states.
    nominal : Trials
        Trials of the best grasp without errors, with the first draws.
    robust : Trials or None
        Trials of the grasp that holds at all corners; None where none was found.
    active : ndarray, shape (K, 6 + S)
        Corners that are part of its problem.
    nominal_arrays : mapping
        Arrays of the nominal grasp, as `GraspResult.arrays`.
    touching : sequence of mapping
        Contacts that are on in the posture of each corner of ``active`` (K), and their places on the object.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> scene = cg.load("configs/grasp/mug_arcs.yaml").changed({"robust": {"friction": 0.1, "draws": 10}})
    >>> found = cg.optimize_grasp(scene).robustness
    >>> found.robust.held, found.nominal.held < 10, found.robust.tension > found.nominal.tension
    (10, True, True)
    """

    errors: Array
    nominal: GraspTrials
    robust: GraspTrials | None
    active: Array
    nominal_arrays: Mapping[str, Array] = field(repr=False)
    touching: Sequence[Mapping[str, TouchedPlace]] = field(repr=False)

    @property
    def names(self) -> tuple[str, str, str]:
        """Tried errors, and names of the nominal and of the robust grasp."""
        if self.errors[:, : len(ERRORS)].any():
            return "Errors of the object", "without errors", "for all errors"
        return "Friction states", "as pulled", "for any friction"

    def arrays(self) -> dict[str, Array]:
        """Stored arrays of the draws, where there is a grasp for all errors."""
        if self.robust is None:
            return {}
        margins = {"robust.margins": self.robust.margins, "robust.nominal_margins": self.nominal.margins}
        object_errors, states = np.split(self.errors, [len(ERRORS)], axis=1)
        drawn = {"robust.errors": object_errors} | ({"robust.friction_states": states} if states.size else {})
        return {**drawn, **margins}

    def warnings(self) -> list[str]:
        """Warnings before this grasp is relied on."""
        trials = self.robust
        if trials is None or trials.holds:
            return []
        unknown = int(np.isnan(trials.margins).sum())
        failed = trials.margins.size - trials.held - unknown
        answers = f", and {unknown} have no answer" if unknown else ""
        return [f"of {trials.margins.size} draws within robust {failed} do not hold with these tensions{answers}"]

    def headline(self) -> str:
        """Draws that hold."""
        if self.robust is None:
            return "no grasp holds at all corners"
        return f"{self.robust.held} of {self.robust.margins.size} draws hold"

    def pairs(self) -> dict[str, str]:
        """Nominal and robust grasp side by side."""
        return {name: f"{nominal} nominal, {robust} robust" for name, nominal, robust in self.rows()}

    def rows(self) -> list[tuple[str, str, str]]:
        """Compared quantities: name, and values of the nominal and of the robust grasp."""
        both = (self.nominal, self.robust)

        def row(name: str, text: Any) -> tuple[str, str, str]:
            nominal, robust = ("" if trials is None else str(text(trials)) for trials in both)
            return name, nominal, robust

        return [
            row("sum of tensions", lambda trials: amount_text(trials.tension, "N", ".2f")),
            row("draws held, tensions fixed", lambda trials: f"{trials.held} of {trials.margins.size}"),
            row("least margin, draws and corners", lambda trials: _margin(trials.least)),
            *(
                row(f"least margin, {name} alone", lambda trials, name=name: _margin(trials.alone[name]))
                for name in self.nominal.alone
            ),
            row("least reserve at", lambda trials: trials.worst or "-"),
            row("fails first", _weakest),
        ]

    def data(self) -> dict[str, Any]:
        """The results as plain data."""

        def of(trials: GraspTrials) -> dict[str, Any]:
            return {
                "tension": trials.tension,
                "draws": int(trials.margins.size),
                "held": trials.held,
                "least_margin": trials.least,
                "corners": int(trials.corner_margins.size),
                "corners_held": int((trials.corner_margins >= 0.0).sum()),
                "least_margin_alone": dict(trials.alone),
                "least_reserve_at": trials.worst,
                "fails_first": dict(trials.weakest),
            }

        compared = {"nominal": of(self.nominal)}
        return compared if self.robust is None else {**compared, "robust": of(self.robust)}


def _weakest(trials: GraspTrials) -> str:
    ranked = sorted(trials.weakest.items(), key=lambda pair: -pair[1])
    return ", ".join(f"{name} ({count})" for name, count in ranked[:3]) or "-"


def _margin(value: float) -> str:
    if value == -np.inf:
        return "no posture, or a contact parts"
    return "no answer" if np.isnan(value) else f"{value:.1%}"
