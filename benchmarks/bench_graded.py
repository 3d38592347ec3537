"""Rods that are not uniform: errors of frequencies and poses by family, elements and mesh, against the exact rod.

Run ``python -m benchmarks.bench_graded`` in the root of the repository. Lengths in L, loads in EI / L^2 of the base.
Arcs and moment-linear elements are the package's models; what it does not have, plain clothoids (curvature linear) and
moment-linear elements with a known tip alone, is computed by numpy (``rod_shapes``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from benchmarks.bench_accuracy import Case, scene
from benchmarks.report import Report, arguments
from benchmarks.rod_shapes import RODS, ShapeRod, equal_lengths, wavelength_lengths
from continuum_grasp.accuracy.choice import Errors, errors_of
from continuum_grasp.errors import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Fidelity, Scene
from tests.rods import force

COUNTS = (2, 4, 8)
ACCURACIES = (1e-9, 1e-7, 1e-5, 1e-3)
"""Of the evaluation, the first that an element has quadrature nodes for."""
MARGIN = 1.3
"""Declared bend of elements per that of the exact rod: coarse models bend further."""
Lengths = Callable[[Scene, int], list[float]]


def across(value: float) -> dict[str, Any]:
    """A force across at the tip."""
    return force(1.0, (0.0, value))


def couple(at: float, value: float) -> dict[str, Any]:
    """A couple whose shape the model knows."""
    return {"kind": "moment", "at": at, "moment": value, "input": True}


def pulled(moment: float, *, end: float = 1.0, slope: float = 0.0) -> dict[str, Any]:
    """A tendon with that moment at the base, whose offset falls by a slope per that at the base."""
    offset = 0.01
    tendon = {"offset": [offset, offset * (1.0 - slope * end)], "to": end, "max_tension": 1e6}
    pull = moment / offset * math.sqrt(1.0 + (offset * slope) ** 2)
    return {"finger": {"tendons": [tendon]}, "actuation": {"tensions": [pull]}}


def at_rest() -> dict[str, Scene]:
    """Loads under which the place of the tip is compared."""
    weight = {"gravity": (0.0, -0.8)}
    jump = {"rest_curvature": {"breaks": [0.4], "values": [0.5, -1.5]}}
    stepped = {"gravity": (0.0, -0.3), "finger": jump}
    bent = {"rest_curvature": [0.0, 6.0]}
    curled = {**RODS["wedge 0.25"], "sections": [{**RODS["wedge 0.25"]["sections"][0], **bent}]}
    return {
        "uniform, tip force 2": scene(RODS["uniform"], loads=[across(2.0)]),
        "wedge 0.25, tip force 0.5": scene(RODS["wedge 0.25"], loads=[across(0.5)]),
        "cone 0.25, tip force 0.3": scene(RODS["cone 0.25"], loads=[across(0.3)]),
        "cone 0.25, weight 4": scene(RODS["cone 0.25"], gravity=(0.0, -4.0)),
        "cone 0.1, weight 4": scene(RODS["cone 0.1"], gravity=(0.0, -4.0)),
        "cone 0.25, tendon to the tip, tip force -0.1": scene(
            RODS["cone 0.25"], loads=[across(-0.1)], **pulled(0.25, slope=0.75)
        ),
        "cone 0.25, tendon to 0.6, tip force -0.1": scene(
            RODS["cone 0.25"], loads=[across(-0.1)], **pulled(0.25, end=0.6, slope=0.75)
        ),
        "cone 0.25, couple 0.5 at 0.5, weight 0.8": scene(RODS["cone 0.25"], loads=[couple(0.5, 0.5)], **weight),
        "uniform, couple 0.5 at 0.5, weight 0.8": scene(RODS["uniform"], loads=[couple(0.5, 0.5)], **weight),
        "uniform, tendon to 0.6, tip force -0.7": scene(
            {**RODS["uniform"], "diameter": 0.02}, loads=[across(-0.7)], **pulled(1.2, end=0.6)
        ),
        "step, tip force 0.3": scene(RODS["step"], loads=[across(0.3)]),
        "step, rest curvature 0.5 and -1.5, tip force -0.2, weight 0.3": scene(
            RODS["step"], loads=[across(-0.2)], **stepped
        ),
        "wedge 0.25, rest curvature 0 to 6, weight 1": scene(curled, gravity=(0.0, -1.0)),
    }


class Rod(Case):
    """A rod that is not uniform, and its truth."""

    def model(self, family: Any, lengths: Sequence[float], *, moves: bool) -> Errors:
        """Errors of the package's model."""
        edges = np.concatenate([[0.0], np.cumsum(lengths)])
        reach = max(h * self.truth.curvature_reach(a, a + h, False) for a, h in zip(edges, lengths, strict=False))
        for accuracy in ACCURACIES:
            fidelity = Fidelity(
                family=family, elements=tuple(lengths), accuracy=accuracy, bending_range=max(0.1, MARGIN * reach)
            )
            given = self.scene.model_copy(update={"fidelity": fidelity, "loads": self.truth.loads})
            try:
                found = errors_of(FingerModel(given, input_rates=False), self.truth, moves=moves)
            except InputError:
                continue
            if math.isfinite(found.tip):  # else more nodes than an element has
                return found
        return Errors(math.nan, math.nan, np.full(2, math.nan), math.nan)

    def shapes(self, family: str, matched: str, count: int, lengths: Lengths) -> ShapeRod:
        """The projection of the exact rod."""
        return ShapeRod(self.scene, lengths(self.scene, count), family, matched)

    def shape_tip(self, rod: ShapeRod) -> float:
        """Error of a projection's tip per length."""
        try:
            found = rod.tip(rod.rest())
        except (RuntimeError, np.linalg.LinAlgError):
            return math.nan
        return float(np.linalg.norm(found - self.truth.cases[0].backbone[-1]))

    def shape_frequencies(self, rod: ShapeRod) -> np.ndarray:
        """Relative errors of a projection's frequencies."""
        true = self.truth.cases[0].frequencies_hz
        return np.abs(rod.frequencies(rod.rest()) / true - 1.0)


def frequencies(report: Report) -> None:
    """Errors of the first two natural frequencies of the straight rods."""
    rows = []
    for name, rod in RODS.items():
        case = Rod(scene(rod))
        for count in COUNTS:
            equal, graded = (lengths(case.scene, count) for lengths in (equal_lengths, wavelength_lengths))
            found = [
                case.model("arc", equal, moves=True).frequencies,
                case.shape_frequencies(case.shapes("clothoid", "tip", count, equal_lengths)),
                case.model("matched_clothoid", equal, moves=True).frequencies,
                case.model("matched_clothoid", graded, moves=True).frequencies,
            ]
            rows.append([name, count, *np.concatenate(found).tolist()])
    kinds = ("arcs", "curvature linear", "moment linear", "the same, mesh rule")
    columns = [f"{kind}, mode {mode}" for kind in kinds for mode in (1, 2)]
    note = (
        "Relative errors. Curvature linear and moment linear with the tip's curvature known (`matched_clothoid`). The "
        "mesh rule, the default, makes elements of equal integral of (rho A / EI)^(1/4); the others are equally long."
    )
    report.table("Natural frequencies of straight rods, by unknowns", ["rod", "unknowns", *columns], rows, note)
    by = {(row[0], row[1]): row for row in rows}
    jump = by["step", 4]
    report.claim("step, 4 unknowns, mode 1: moment linear per curvature linear", jump[6] / jump[4], "<=", 0.01)
    report.claim("step, 4 unknowns, mode 1: moment linear", jump[6], "<=", 5e-4)
    cone = by["cone 0.25", 4]
    report.claim("cone 0.25, 4 unknowns, mode 1: curvature linear per moment linear", cone[4] / cone[6], "<=", 1.0)
    report.claim("cone 0.25, 4 unknowns, mode 1: mesh rule per equal lengths", cone[8] / cone[6], "<=", 0.5)


def poses(report: Report) -> None:
    """Errors of the tip at rest."""
    rows = []
    for name, given in at_rest().items():
        case = Rod(given)
        for count in COUNTS:
            equal, graded = (lengths(given, count) for lengths in (equal_lengths, wavelength_lengths))
            rows.append(
                [
                    name,
                    count,
                    case.model("arc", equal, moves=False).tip,
                    case.shape_tip(case.shapes("clothoid", "tip", count, equal_lengths)),
                    case.shape_tip(case.shapes("moment", "tip", count, equal_lengths)),
                    case.model("matched_clothoid", equal, moves=False).tip,
                    case.model("matched_clothoid", graded, moves=False).tip,
                ]
            )
    columns = ["arcs", "curvature linear", "moment linear", "inputs known", "the same, mesh rule"]
    note = (
        "Distance of the tip from that of the exact rod, per length. Inputs known: what tendons and couples bend is in "
        "the shape (`matched_clothoid`); before it only the curvature that they give the tip. A dash: refused, an "
        "element's length times its greatest curvature is more than a turn."
    )
    report.table("Tip at rest, error / L", ["rod and load", "unknowns", *columns], rows, note)
    by = {(row[0], row[1]): row for row in rows}
    for name in by:
        row = by[name]
        if name[1] == 4 and ("tendon to 0.6" in name[0] or "couple" in name[0]):
            report.claim(f"{name[0]}, 4 unknowns: inputs known per moment linear", row[5] / row[4], "<=", 0.05)
    report.claim("step, tip force 0.3, 4 unknowns: moment linear", by["step, tip force 0.3", 4][5], "<=", 1e-5)


PARTS = {"frequencies": frequencies, "poses": poses}


def measured(part: str) -> Report:
    """The tables and limits of one part."""
    report = Report("graded", 0)
    PARTS[part](report)
    return report


def main() -> None:
    """Measure everything and write the report."""
    asked = arguments(__doc__, only=(tuple(PARTS), ""), jobs=2)
    report = Report("graded", 0)
    with ProcessPoolExecutor(asked.jobs) as pool:
        for found in pool.map(measured, asked.only):
            report.tables += found.tables
            report.claims += found.claims
    report.finish()


if __name__ == "__main__":
    main()
