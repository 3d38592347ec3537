"""The result of a design."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np

from continuum_grasp.addons.design.evaluation import Evaluation, Signs
from continuum_grasp.addons.design.scene import DESIGN_QUANTITIES, Design
from continuum_grasp.addons.design.space import DesignSpace
from continuum_grasp.base import Array
from continuum_grasp.grasp import GraspResult
from continuum_grasp.results import Dimension, File, Picture, Result, Stored

_HEAD = """\
# The best design found: values of the variables, cost, quantities of every case, sensitivities. SI units. `set` are the
# values as changes of the scene; result.npz holds every design tried, grasp_CASE/ the grasps.
"""


class DesignStatus(StrEnum):
    """Outcome of the search for a design."""

    OPTIMAL = "optimal"
    """A local optimum whose grasps full searches confirm."""
    FEASIBLE = "feasible"
    """All limits hold, but the search ended before it settled."""
    LIMITS_VIOLATED = "limits_violated"
    """No design was found for which all limits hold; the result is the closest one."""
    NO_GRASP = "no_grasp"
    """None of the designs tried holds every object."""


@dataclass(frozen=True)
class WorstCase:
    """A combination of greatest errors of manufacture.

    Attributes
    ----------
    signs : tuple of float
        Per tolerated number, its error as a part of the greatest one.
    cost, violation : float
        With these errors, grasps solved anew; infinite where there is no grasp.
    bound : float
        Cost of the worst combination to first order, from the design without errors.
    message : str
        Why there is no grasp; empty where there is one.
    """

    signs: Signs
    cost: float
    violation: float
    bound: float
    message: str


@dataclass(frozen=True)
class Influence:
    """Change of the cost with one number.

    Attributes
    ----------
    key, unit : str
    value : float
        SI.
    slope : float
        Change of the cost per SI unit of the number.
    per_percent : float
        Change of the cost where a variable grows by 1 % of its range, linear or in ratios; of a number with errors,
        for 1 % of its greatest error.
    at : str
        ``least`` or ``greatest`` where the variable is at that bound; empty between.
    """

    key: str
    unit: str
    value: float
    slope: float
    per_percent: float
    at: str


@dataclass(frozen=True)
class DesignResult(Result):
    """A design: values of the variables, cost, quantities of every case, sensitivities.

    Attributes
    ----------
    scene : Design
        The scene as given.
    status : Status
    message : str
        One sentence on how it ended.
    best, first : Evaluation, optional
        The best design, and the one at the start, with all derivatives; None where there was no grasp.
    worst_cases : tuple of WorstCase
        Combinations of errors of manufacture, the worst first; empty without tolerances.
    switches : tuple of str
        Designs where a full search found better grasps than the ones followed.
    acting : dict of str to int
        For cases whose grasps must hold for many errors or friction states: number of different sets that decided the
        grasps of the designs tried.
    grasps, before : dict of str to GraspResult
        The grasps of the best design, and the grasps at the start, by case.
    statistics : dict
        Designs tried, full searches, runs of the solver.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> config = {
    ...     "scene": "configs/grasp/mug_arcs.yaml",
    ...     "variables": {"finger.base.angle": {"min": -1.65, "max": -1.5}},  # rad
    ...     "minimize": "tension",
    ...     "solver": {"starts": 1},
    ... }
    >>> found = cg.optimize_design(config)
    >>> [one.key for one in found.influences], found.best.cost < found.first.cost
    (['finger.base.angle'], True)
    """

    kind: ClassVar[str] = "design"
    stored: ClassVar[tuple[Stored, ...]] = (
        Stored("keys", "(variable,)", "text", "key path of each variable"),
        Stored("start", "(variable,)", "", "values of the variables at the start, SI"),
        Stored("optimum", "(variable,)", "", "values of the variables at the best design, SI"),
        Stored("gradient", "(variable,)", "", "change of the cost per SI unit of each variable at the best design"),
        Stored("tried", "(design, variable)", "", "values of the variables that were tried, in order, SI"),
        Stored("costs", "(design,)", "", "cost of each design tried; NaN where there was no grasp"),
        Stored("violations", "(design,)", "1", "greatest violation of a limit, as a part of it"),
        Stored("rounds", "(design,)", "1", "0 for trial designs, else the round of improvement"),
    )
    dimensions: ClassVar[tuple[Dimension, ...]] = (
        Dimension("variable", "variables of the design", "labels"),
        Dimension("design", "designs in the order in which they were tried"),
    )
    texts: ClassVar[tuple[File, ...]] = (File("result.yaml", "continuum_grasp.addons.design.result:DesignResult.yaml"),)
    pictures: ClassVar[tuple[Picture, ...]] = (
        Picture("design", "continuum_grasp.addons.design.pictures:plot_design", needs="cases", panels=True),
    )

    scene: Design
    status: DesignStatus
    message: str
    space: DesignSpace = field(repr=False)
    best: Evaluation | None
    first: Evaluation | None
    coordinates: Array = field(repr=False)
    costs: Array
    violations: Array
    rounds: Array
    worst_cases: tuple[WorstCase, ...] = ()
    switches: tuple[str, ...] = ()
    acting: Mapping[str, int] = field(default_factory=dict)
    grasps: Mapping[str, GraspResult] = field(default_factory=dict, repr=False)
    before: Mapping[str, GraspResult] = field(default_factory=dict, repr=False)
    statistics: Mapping[str, Any] = field(default_factory=dict)

    @property
    def solved(self) -> bool:
        """Whether there is a design for which all limits hold."""
        return self.status in (DesignStatus.OPTIMAL, DesignStatus.FEASIBLE)

    @property
    def keys(self) -> list[str]:
        """Key paths of the variables."""
        return [coordinate.key for coordinate in self.space.coordinates]

    @property
    def labels(self) -> list[str]:
        """Key paths of the variables with their units."""
        return [f"{coordinate.key} [{coordinate.unit or '1'}]" for coordinate in self.space.coordinates]

    @property
    def values(self) -> dict[str, float]:
        """Values of the variables and of what follows them at the best design, by key, SI; empty without one."""
        if self.best is None:
            return {}
        values = dict(zip(self.keys, self._values(self.best.coordinates).tolist(), strict=True))
        return values | self.space.keys.followed(values)

    def _values(self, coordinates: Array) -> Array:
        pairs = zip(self.space.coordinates, coordinates, strict=True)
        return np.array([coordinate.way.value(float(u)) for coordinate, u in pairs])

    @property
    def start(self) -> Array:
        """Values of the variables at the start (n,), SI."""
        return np.array(self.space.start)

    @property
    def optimum(self) -> Array | None:
        """Values of the variables at the best design (n,), SI."""
        return None if self.best is None else self._values(self.best.coordinates)

    @property
    def tried(self) -> Array:
        """Values of the variables that were tried (designs, n), SI."""
        return np.array([self._values(design) for design in self.coordinates]).reshape(-1, len(self.keys))

    @property
    def gradient(self) -> Array | None:
        """Change of the cost per SI unit of each variable (n,)."""
        slopes = [influence.slope for influence in self.influences[: len(self.keys)]]
        return None if self.best is None else np.array(slopes)

    @property
    def influences(self) -> tuple[Influence, ...]:
        """Change of the least cost with each variable, and with the tolerated numbers beside them.

        The other variables stay at their optimum: where none is at a bound and no limit acts, variables have none.
        """
        if self.best is None:
            return ()
        total = self.best.slope
        influences = []
        for k, (coordinate, u) in enumerate(zip(self.space.coordinates, self.best.coordinates.tolist(), strict=True)):
            value = coordinate.way.value(u)
            slope = float(total[k]) / coordinate.way.slope(value)
            if u < 1e-6:
                at = "least"
            elif u > 1.0 - 1e-6:
                at = "greatest"
            else:
                at = ""
            influences.append(Influence(coordinate.key, coordinate.unit, value, slope, 0.01 * float(total[k]), at))
        count = len(self.space.coordinates)
        for k, tolerated in enumerate(self.space.tolerated):
            if tolerated.key not in self.keys:
                value = tolerated.nominal
                change = float(total[count + k])
                slope = change / tolerated.way.error(value)
                influences.append(Influence(tolerated.key, tolerated.unit, value, slope, 0.01 * change, ""))
        return tuple(influences)

    @property
    def active(self) -> tuple[str, ...]:
        """Limits that the best design just satisfies."""
        rows = () if self.best is None else self.best.limits
        return tuple(dict.fromkeys(f"{row.name} ({row.case})" for row in rows if row.value < 1e-4))

    @property
    def cases(self) -> dict[str, dict[str, float]]:
        """Quantities of the best design without errors, by case and name, SI."""
        if self.best is None:
            return {}
        return {case.case: dict(case.quantities) for case in self.best.cases if not any(case.signs)}

    @property
    def kinks(self) -> tuple[str, ...]:
        """Cases whose grasps other errors or friction states decide than at the start, or than at designs between:
        their cost has kinks there, and its derivatives hold on one side.
        """
        if self.best is None or self.first is None:
            return ()
        first = {case.case: set(case.acting) for case in self.first.cases if not any(case.signs)}
        last = {case.case: set(case.acting) for case in self.best.cases if not any(case.signs)}
        kinks = []
        for case, count in self.acting.items():
            if count > 1:
                words = "others than" if first.get(case) != last.get(case) else "the same as"
                kinks.append(
                    f"{case}: {count} different sets of errors or friction states decide the grasps of the designs "
                    f"tried, {words} at the start decide the best; the cost has kinks between them"
                )
        return tuple(kinks)

    def parts(self) -> Mapping[str, Result]:
        """The grasps, in folders of their own."""
        return {f"grasp_{name}": grasp for name, grasp in self.grasps.items()}

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings before the design is built."""
        warnings = [f"{name}: {text}" for name, grasp in self.grasps.items() for text in grasp.warnings]
        if len(warnings) > 3:  # cases of one finger have the same as a rule
            warnings = [*warnings[:3], f"and {len(warnings) - 3} more of this kind, see grasp_CASE/"]
        lost = [case for case in self.worst_cases if case.message]
        if lost:
            warnings.append(
                f"{len(lost)} of {len(self.worst_cases)} combinations of errors lose a grasp: {lost[0].message}"
            )
        return tuple(warnings)

    def pairs(self) -> dict[str, str]:
        """Values of the variables, cost before and after, and limits of the design."""
        if self.best is None:
            return {"message": self.message}
        rows = {}
        for influence, before in zip(self.influences, self.start.tolist(), strict=False):
            bound = f", at its {influence.at} value" if influence.at else ""
            unit = f" {influence.unit}" if influence.unit else ""
            rows[influence.key] = f"{influence.value:.6g}{unit} (start {before:.6g}{bound})"
        before = "" if self.first is None else f" (start {self.first.cost:.6g})"
        rows["cost"] = f"{self.best.cost:.6g}{before}: {self.scene.minimize}, {self.best.worst.case}"
        for name, values in list(self.cases.items())[:6]:
            said = (f"{key} {value:.5g} {DESIGN_QUANTITIES[key][0]}".rstrip() for key, value in values.items())
            rows[name] = ", ".join(said)
        if self.active:
            rows["active limits"] = "; ".join(self.active)
        if self.kinks:
            rows["kinks"] = "; ".join(self.kinks)
        if self.worst_cases:
            worst = self.worst_cases[0]
            rows["worst errors"] = f"cost {worst.cost:.6g}, to first order {worst.bound:.6g}"
        effort = self.statistics
        rows["effort"] = f"{effort['full_searches']} full searches, {effort['solver_runs']} runs from nearby grasps"
        return rows

    def yaml(self) -> str:
        """The design as YAML."""
        about = {"status": self.status.value, "message": self.message, "set": self.values, **self.details()}
        return self.as_yaml(about | {"statistics": dict(self.statistics)}, _HEAD)

    def details(self) -> dict[str, Any]:
        """Values, quantities of the cases, sensitivities, combinations of errors."""
        return {
            "message": self.message,
            "values": self.values,
            "cost": None if self.best is None else self.best.cost,
            "cases": self.cases,
            "influences": [dict(vars(influence)) for influence in self.influences],
            "active": list(self.active),
            "worst_cases": [
                {
                    **vars(case),
                    "signs": list(case.signs),
                    "cost": case.cost if np.isfinite(case.cost) else None,
                    "violation": case.violation if np.isfinite(case.violation) else None,
                }
                for case in self.worst_cases
            ],
            "switches": list(self.switches),
            "kinks": list(self.kinks),
        }
