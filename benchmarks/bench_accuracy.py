"""Errors of the families, at rest, in frequency and in motion, against the exact rod and a fine model.

Run ``python -m benchmarks.bench_accuracy`` in the root of the repository. The paper's rod, 0.6 m of NiTi, where it
moves; loads at rest in units of E I / L^2. Also: what it costs to reach a first frequency within 0.1 % and a tip within
1e-4 of the length, and whether errors fall at the order that theory says.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.paper import paper_errors
from benchmarks.report import Report, Table, arguments
from continuum_grasp.accuracy.choice import Choice, errors_of
from continuum_grasp.accuracy.motion import Motion, evaluation_ns, pace, reference_motion, rms
from continuum_grasp.accuracy.truth import find_truth
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene
from tests.rods import HANGING, HORIZONTAL, NITINOL, UNIT, UPRIGHT, force, rod_scene

MODELS = (
    *(("arc", n) for n in (2, 3, 4, 8, 16)),
    *(("clothoid", n) for n in (1, 2, 4)),
    *(("matched_clothoid", n) for n in (1, 2, 3, 4)),
)
STILL = {"time": {"duration": 1.0, "step": 0.005}}


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
        self.motion: Motion | None = reference_motion(given, self.truth) if given.time is not None else None

    def choice(self, family: Any, elements: int) -> Choice | None:
        """That family with that many elements, as exact as it gets; None where contacts ask for more."""
        if elements <= len(self.scene.contacts):
            return None
        lengths = FingerModel(self.scene, family="arc", elements=elements).lengths
        reach = self.scene.fidelity.bending_range or min(4.0, 8.0 / elements)
        return Choice(self.scene, family, lengths, False, 1e-9, reach)

    def tip(self, family: Any, elements: int) -> float:
        """Error of the tip at rest per length."""
        choice = self.choice(family, elements)
        return math.nan if choice is None else errors_of(self._static(choice), self.truth, moves=False).tip

    def frequencies(self, family: Any, elements: int) -> np.ndarray:
        """Relative errors of the first two."""
        choice = self.choice(family, elements)
        assert choice is not None
        return errors_of(self._static(choice), self.truth, moves=True).frequencies

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


def table(title: str, columns: dict[str, Callable[[Any, int], float]], note: str = "") -> Table:
    """One row per model, one column per case."""
    rows = [
        [f"{n} {family}", n + (family == "clothoid"), *(column(family, n) for column in columns.values())]
        for family, n in MODELS
    ]
    return Table(title, ["model", "unknowns", *columns], rows, note)


def cheapest(report: Report, vibrating: Case, still: dict[str, Case]) -> None:
    """Cost of 0.1 % in the first frequency and 1e-4 of the length in every pose at rest."""
    rows, cost = [], {}
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
                cost[family] = int(model.forward_dynamics.n_instructions())
                rows.append([f"{n} {family}", frequency, tip, cost[family], evaluation_ns(model)])
                break
        else:
            report.missing.append(f"{family}: not within 0.1 % and 1e-4 with {counts[-1]} elements")
    report.table(
        "0.1 % in frequency and 1e-4 L at rest", ["model", "frequency 1", "tip / L", "instructions", "ns"], rows
    )
    if "arc" in cost and "matched_clothoid" in cost:
        share = cost["matched_clothoid"] / cost["arc"]
        report.claim("instructions of matched clothoids for 0.1 % and 1e-4 L, per those of arcs", share, "<=", 0.1)


def orders(report: Report, vibrating: Case, pushed: Case) -> None:
    """Observed orders between finer and finer elements, until rounding."""
    rows = []
    for family, expected, counts in (
        ("arc", 2, (8, 16, 32, 64)),
        ("clothoid", 4, (4, 8, 16, 32)),
        ("matched_clothoid", 4, (4, 8, 16, 32)),
    ):
        for name, error in (
            ("frequency 1", lambda n, f=family: float(vibrating.frequencies(f, n)[0])),
            ("tip force 2", lambda n, f=family: pushed.tip(f, n)),
        ):
            errors = [error(n) for n in counts]
            found = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
            rows.append([family, name, str(list(counts)), *errors, found[0], found[1]])
            report.claim(f"order of {family}, {name}, less {expected}", abs(found[1] - expected), "<=", 0.4)
    columns = ["family", "error of", "elements", *(f"error {k + 1}" for k in range(4)), "order", "order, finer"]
    report.table("Order of convergence", columns, rows)


def of_the_paper(release: Scene) -> Table:
    """The paper's equations in a release, as printed and corrected."""
    arcs = release.fidelity.model_copy(update={"family": "arc", "elements": 2})
    found = paper_errors(release.model_copy(update={"fidelity": arcs}), find_truth(release))
    rows = [[name, one.tip, one.shape, *one.frequencies] for name, one in found.items()]
    note = "doi:10.1155/2014/308283, as printed and corrected; see docs/errata.md. At rest, and about it."
    return Table("The paper's equations", ["model", "tip / L", "shape / L", "frequency 1", "frequency 2"], rows, note)


def main() -> None:
    """Measure and write the report."""
    arguments(__doc__)
    report = Report("accuracy", 0)
    still = {name: Case(given) for name, given in at_rest().items()}
    vibrating = Case(scene(UNIT).model_copy(update={"time": scene(NITINOL, **STILL).time}))
    modes = {f"mode {k + 1}": lambda f, n, k=k: 100.0 * vibrating.frequencies(f, n)[k] for k in range(2)}
    report.tables.append(table("Natural frequencies, per cent", modes, "Clamped, weightless."))
    report.tables.append(table("Tip at rest, error / L", {name: case.tip for name, case in still.items()}))
    swings = {name: Case(given) for name, given in moving().items()}
    notes = ", ".join(f"{name} {600 * case.motion.error:.1g} mm" for name, case in swings.items() if case.motion)
    title = "Motion over 1 s, r.m.s. error of the tip [mm]"
    note = f"Against 12 free clothoids, whose estimated errors are: {notes}."
    report.tables.append(table(title, {name: case.swing for name, case in swings.items()}, note))
    report.tables.append(of_the_paper(moving()["release, 20 g"]))
    cheapest(report, vibrating, still)
    orders(report, vibrating, still["tip force 2"])
    report.finish()


if __name__ == "__main__":
    main()
