"""Errors of the families, at rest, in frequency and in motion, against the exact rod and a fine model.

The paper's rod, 0.6 m of NiTi, where it moves; loads at rest in units of E I / L^2. Also: what it costs to reach a
first frequency within 0.1 % and a tip within 1e-4 of the length.

``--graded`` takes rods that are not uniform instead, with loads in E I / L^2 of the base, and compares with clothoids
whose curvature, rather than moment, is linear, which the package does not have (``rod_shapes``).
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.report import Report, begun
from benchmarks.rod_shapes import RODS, ShapeRod
from continuum_grasp.base import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene
from continuum_grasp.simulation.accuracy.choice import Choice, Errors, errors_of
from continuum_grasp.simulation.accuracy.motion import TipMotion, evaluation_ns, pace, reference_motion, rms
from continuum_grasp.simulation.accuracy.truth import find_truth
from tests.rods import HANGING, HORIZONTAL, NITINOL, UNIT, UPRIGHT, force, rod_scene

MODELS = (
    *(("arc", n) for n in (2, 3, 4, 8, 16)),
    *(("clothoid", n) for n in (1, 2, 4)),
    *(("matched_clothoid", n) for n in (1, 2, 3, 4)),
)
STILL = {"time": {"duration": 1.0, "step": 0.005}}
COUNTS = (2, 4, 8)
"""Unknowns of the models of rods that are not uniform."""
ACCURACIES = (1e-9, 1e-7, 1e-5, 1e-3)
"""Of the evaluation; the first that an element has quadrature nodes for is taken."""


def scene(rod: dict[str, Any], angle: float = HORIZONTAL, mass: float = 0.0, **keys: Any) -> Scene:
    """A straight finger; weightless by default."""
    fidelity = {"family": None, "elements": None, "bending_range": None, **keys.pop("fidelity", {})}
    return rod_scene(rod, angle=angle, tip_mass=mass, fidelity=fidelity, **{"gravity": (0.0, 0.0), **keys})


def at_rest() -> dict[str, Scene]:
    """Loads under which the shape is compared."""
    weight = {"gravity": (0.0, -5.0)}
    return {
        **{f"tip force {a}": scene(UNIT, loads=[force(1.0, (0.0, float(a)))]) for a in (1, 2, 5, 10)},
        "following tip force 3": scene(UNIT, loads=[force(1.0, (3.0, 0.0), True)]),
        "force 5 at a contact": scene(UNIT, contacts=[0.45], loads=[force(0.45, (0.0, 5.0))]),
        "tip moment 1.5, force 2": scene(UNIT, loads=[force(1.0, (0.0, -2.0))], actuation={"tip_moment": 1.5}),
        "weight 5, horizontal": scene(UNIT, **weight),
        "weight 5, hanging": scene(UNIT, HANGING, loads=[force(1.0, (1.0, 0.0))], **weight),
        "weight 5, standing": scene(UNIT, UPRIGHT, loads=[force(1.0, (0.3, 0.0))], **weight),
        "weight 5, oblique": scene(UNIT, HORIZONTAL / 2, **weight),
    }


def moving() -> dict[str, Scene]:
    """Motions of the paper's rod over a second, undamped, from a straight start."""
    earth, start = {"gravity": (0.0, -9.81), **STILL}, {"initial": {"pose": "straight"}}
    found = {
        f"release, {1000 * m:.0f} g": scene(NITINOL, mass=m, fidelity={"bending_range": 3.1}, **earth, **start)
        for m in (0.0, 0.02, 0.05)
    }
    for seconds in (0.2, 0.02):
        ramp = {"times": [0.0, seconds], "values": [0.0, 0.05]}
        found[f"0.05 N m in {1000 * seconds:.0f} ms"] = scene(
            NITINOL, mass=0.01, actuation={"tip_moment": ramp}, **STILL, **start
        )
    push = {"times": [0.0, 0.1, 0.4, 0.5], "values": [[0.0, 0.0], [0.0, 0.5], [0.0, 0.5], [0.0, 0.0]]}
    found["0.5 N at a contact"] = scene(NITINOL, mass=0.01, contacts=[0.3], loads=[force(0.3, push)], **STILL, **start)
    return found


class Case:
    """A scene and its truth."""

    def __init__(self, given: Scene) -> None:
        self.scene, self.truth = given, find_truth(given)
        self.motion: TipMotion | None = reference_motion(given, self.truth) if given.time is not None else None

    def lengths(self, elements: int) -> tuple[float, ...]:
        """Lengths of so many elements [m]: of equal parts of the local wavelength, where contacts do not divide it."""
        return FingerModel(self.scene, family="arc", elements=elements).lengths

    def choice(self, family: Any, elements: int, accuracy: float = ACCURACIES[0]) -> Choice | None:
        """That family with that many elements, by default as exact as it gets; None where contacts ask for more."""
        if elements <= len(self.scene.contacts):
            return None
        reach = self.scene.fidelity.bending_range or min(4.0, 8.0 / elements)
        return Choice(self.scene, family, self.lengths(elements), False, accuracy, reach)

    def errors(self, family: Any, elements: int, *, moves: bool) -> Errors:
        """Errors at rest and, where it ``moves``, of frequencies; NaN where the model is refused."""
        for accuracy in ACCURACIES:
            choice = self.choice(family, elements, accuracy)
            if choice is None:
                break
            with contextlib.suppress(InputError):
                found = errors_of(self._static(choice), self.truth, moves=moves)
                if math.isfinite(found.tip):  # else more nodes than an element has
                    return found
        return Errors(math.nan, math.nan, np.full(2, math.nan), math.nan)

    def tip(self, family: Any, elements: int) -> float:
        """Error of the tip at rest per length."""
        return self.errors(family, elements, moves=False).tip

    def frequencies(self, family: Any, elements: int) -> np.ndarray:
        """Relative errors of the first two."""
        return self.errors(family, elements, moves=True).frequencies

    def linear_curvature(self, elements: int) -> tuple[float, np.ndarray]:
        """Errors of tip and frequencies, at rest, of as many elements whose curvature is linear."""
        rod, true = ShapeRod(self.scene, self.lengths(elements), "clothoid"), self.truth.cases[0]
        try:
            rest = rod.rest()
        except (RuntimeError, np.linalg.LinAlgError):
            return math.nan, np.full(2, math.nan)
        off = float(np.linalg.norm(rod.tip(rest) - true.backbone[-1]))
        return off, np.abs(rod.frequencies(rest) / true.frequencies_hz - 1.0)

    def _static(self, choice: Choice) -> FingerModel:
        given = self.scene.model_copy(update={"fidelity": choice.fidelity, "loads": self.truth.loads})
        return FingerModel(given, input_rates=False)

    def swing(self, family: Any, elements: int) -> float:
        """R.m.s. error of the tip in motion [mm]."""
        choice = self.choice(family, elements)
        if choice is None or self.motion is None or (family == "arc" and elements > 8):
            return math.nan
        posed = self.scene.model_copy(update={"fidelity": choice.fidelity})
        return 1e3 * rms(pace(posed, choice.model).tip - self.motion.tip)


def compare(report: Report, title: str, columns: dict[str, Callable[[Any, int], float]], note: str = "") -> None:
    """Add a table with one row per model, one column per case."""
    table = report.table(title, ["model", "unknowns", *columns], note=note)
    for family, n in MODELS:
        table.add(f"{n} {family}", n + (family == "clothoid"), *(column(family, n) for column in columns.values()))


def cheapest(report: Report, vibrating: Case, still: dict[str, Case]) -> None:
    """Cost of 0.1 % in the first frequency and 1e-4 of the length in every pose at rest."""
    columns, cost = ["model", "frequency 1", "tip / L", "instructions", "ns"], {}
    table = report.table("0.1 % in frequency and 1e-4 L at rest", columns)
    for family, counts in (
        ("arc", (16, 20, 24, 28, 32, 40, 48, 56, 64)),
        ("matched_clothoid", (1, 2, 3, 4, 6)),
        ("clothoid", (1, 2, 3, 4, 6)),
    ):
        for n in counts:
            frequency = float(vibrating.frequencies(family, n)[0])
            tip = max(case.tip(family, n) for case in still.values())
            if frequency <= 1e-3 and tip <= 1e-4:
                model = FingerModel(vibrating.scene, family=family, elements=n)
                cost[family] = model.instructions
                table.add(f"{n} {family}", frequency, tip, cost[family], evaluation_ns(model))
                break
        else:
            report.missing.append(f"{family}: not within 0.1 % and 1e-4 with {counts[-1]} elements")
    if "arc" in cost and "matched_clothoid" in cost:
        share = cost["matched_clothoid"] / cost["arc"]
        report.claim("instructions of matched clothoids for 0.1 % and 1e-4 L, per those of arcs", share, "<=", 0.2)


def graded_rods() -> dict[str, Scene]:
    """Loads at rest of rods that are not uniform."""

    def across(value: float) -> dict[str, Any]:
        return {"loads": [force(1.0, (0.0, value))]}

    cone, step, offset = RODS["cone 0.25"], RODS["step"], 0.01
    couple = {"kind": "moment", "at": 0.5, "moment": 0.5, "input": True}
    tendon = {"offset": [offset, 0.55 * offset], "to": 0.6, "max_tension": 1e6}
    pulled = {"finger": {"tendons": [tendon]}, "actuation": {"tensions": [0.25 / offset]}}
    jump = {"rest_curvature": {"breaks": [0.4], "values": [0.5, -1.5]}}
    return {
        "wedge 0.25, tip force 0.5": scene(RODS["wedge 0.25"], **across(0.5)),
        "cone 0.25, tip force 0.3": scene(cone, **across(0.3)),
        "cone 0.25, weight 4": scene(cone, gravity=(0.0, -4.0)),
        "cone 0.1, weight 4": scene(RODS["cone 0.1"], gravity=(0.0, -4.0)),
        "cone 0.25, tendon to 0.6, tip force -0.1": scene(cone, **across(-0.1), **pulled),
        "cone 0.25, couple 0.5 at 0.5, weight 0.8": scene(cone, loads=[couple], gravity=(0.0, -0.8)),
        "step, tip force 0.3": scene(step, **across(0.3)),
        "step, rest curvature 0.5 and -1.5, weight 0.3": scene(step, finger=jump, gravity=(0.0, -0.3)),
    }


def graded(report: Report) -> None:
    """Errors of rods that are not uniform, by the rule of equal wavelengths for the lengths of elements."""
    kinds = ("arcs", "curvature linear", "moment linear")
    columns = ["rod", "unknowns", *(f"{kind}, mode {mode}" for kind in kinds for mode in (1, 2))]
    note = "Relative errors. Moment linear: `matched_clothoid`, which knows what tendons and couples bend."
    straight = report.table("Natural frequencies of straight rods, by unknowns", columns, note=note)
    for name, rod in RODS.items():
        case = Case(scene(rod))
        for count in COUNTS:
            arcs, ours = (case.frequencies(family, count) for family in ("arc", "matched_clothoid"))
            straight.add(name, count, *arcs, *case.linear_curvature(count)[1], *ours)
    bent = report.table("Tip at rest, error / L", ["rod and load", "unknowns", *kinds])
    for name, given in graded_rods().items():
        case = Case(given)
        for count in COUNTS:
            ours = case.tip("matched_clothoid", count)
            bent.add(name, count, case.tip("arc", count), case.linear_curvature(count)[0], ours)
    steps = next(row for row in straight.rows if row[:2] == ["step", 4])
    report.claim("step, 4 unknowns, mode 1: moment linear per curvature linear", steps[6] / steps[4], "<=", 0.01)
    for row in bent.rows:
        if row[1] == 4 and ("tendon" in row[0] or "couple" in row[0]):
            report.claim(f"{row[0]}, 4 unknowns: moment linear per curvature linear", row[4] / row[3], "<=", 0.05)


def uniform(report: Report) -> None:
    """Errors of the uniform rod, what they cost, and how they fall."""
    still = {name: Case(given) for name, given in at_rest().items()}
    vibrating = Case(scene(UNIT).model_copy(update={"time": scene(NITINOL, **STILL).time}))
    modes = {f"mode {k + 1}": lambda f, n, k=k: 100.0 * vibrating.frequencies(f, n)[k] for k in range(2)}
    compare(report, "Natural frequencies, per cent", modes, "Clamped, weightless.")
    compare(report, "Tip at rest, error / L", {name: case.tip for name, case in still.items()})
    swings = {name: Case(given) for name, given in moving().items()}
    notes = ", ".join(f"{name} {600 * case.motion.error:.1g} mm" for name, case in swings.items() if case.motion)
    title = "Motion over 1 s, r.m.s. error of the tip [mm]"
    note = f"Against 12 free clothoids, whose estimated errors are: {notes}."
    compare(report, title, {name: case.swing for name, case in swings.items()}, note)
    cheapest(report, vibrating, still)


def main() -> None:
    """Measure and write the report."""
    named = ("accuracy", "graded")
    asked, report = begun(__doc__, lambda asked: named[asked.graded], graded=(False, "rods that are not uniform"))
    (graded if asked.graded else uniform)(report)
    report.finish()


if __name__ == "__main__":
    main()
