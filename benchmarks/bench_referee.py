"""An outside referee: the cases of cosseratbench, solved by this package, by MuJoCo's cable and by PyElastica.

Run ``python -m benchmarks.bench_referee`` (10 min) with an interpreter that has ``pip install "cosseratbench[all]"
"mujoco<4"`` beside the package (tried: cosseratbench 0.3.0, whose cable needs an element that MuJoCo 4 took away).
Scenes, references and errors are the referee's. Its cantilever is judged by linear theory, so a column adds the error
against the exact elastica. Two of its experiments are planar rods held at one end, which ``cosserat_adapter`` can
describe; the report lists the others with the reason.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any

import numpy as np
from cosseratbench import registry
from cosseratbench.experiment import Experiment, Result, run

from benchmarks.cosserat_adapter import ContinuumGrasp
from benchmarks.elastica import elastica_deflection
from benchmarks.report import Report, begun

ELEMENTS = (1, 2, 4, 8)
"""Of ours."""
OTHERS = ("mujoco", "pyelastica")
"""Solvers that the referee brings and that pip installs."""
FITTING = ("cantilever", "pendulum")
"""Experiments whose rods are planar, held at one end, and touch nothing."""
STIFFNESSES = (1e6, 1e7, 1e8)
"""Young's moduli of the pendulum that the referee proposes [Pa]."""
EXACT = "error_against_the_exact_elastica"
"""Our column beside the referee's."""


@dataclass(frozen=True)
class Entry:
    """A solver with its settings."""

    label: str
    solver: Any
    nodes: int | None


def load_of(scenario: Any) -> float:
    """Force at the tip times length squared over bending stiffness [1]."""
    (rod,) = scenario.rods
    stiffness = rod.material.youngs_modulus * rod.second_moment_of_area
    return float(np.linalg.norm(rod.loads[0].force) * rod.length**2 / stiffness)


def exact_error(scenario: Any, trajectory: Any) -> float:
    """Relative error of the tip's deflection in the last frame of the cantilever."""
    expected = scenario.rods[0].length * elastica_deflection(load_of(scenario))
    return float(abs(-trajectory.positions[0][-1, -1, 2] / expected - 1.0))


def entries(experiment: Experiment, report: Report, doubled: bool) -> list[Entry]:
    """Ours with several numbers of elements; the others as they come and, if ``doubled``, with twice the elements."""
    found = [Entry(f"this package, {n} clothoid{'s' * (n > 1)}", ContinuumGrasp(n), None) for n in ELEMENTS]
    for name in OTHERS:
        try:
            solver = registry.load_solver(name)
        except ImportError as error:
            report.missing.append(f"{name}: {error}")
            continue
        for nodes in (experiment.n_elements, 2 * experiment.n_elements)[: 1 + doubled]:
            found.append(Entry(f"{name}, {nodes} elements", solver, nodes))
    return found


def measure(report: Report, name: str, values: dict[str, float], title: str, doubled: bool = True) -> dict[str, Result]:
    """One scene by all, and its table."""
    experiment = registry.load_experiment(name)
    if name == "cantilever":
        experiment = replace(experiment, metrics={EXACT: exact_error, **experiment.metrics})
    metrics = list(experiment.metrics)
    table = report.table(title, ["", *(text.replace("_", " ") for text in metrics), "wall time [s]"])
    results = {}
    doubled = doubled and experiment.values(**values) == experiment.values()
    for entry in entries(experiment, report, doubled):
        result = run(experiment, entry.solver, values=values, n_elements=entry.nodes)
        results[entry.label] = result
        failure = result.failure or ", ".join(result.missing)
        cells = [failure, *[None] * (len(metrics) - 1)] if failure else [result.metrics[key] for key in metrics]
        table.add(entry.label, *cells, result.wall_time)
    return results


def main() -> None:
    """Measure what fits, list what does not, write the report."""
    asked, report = begun(
        __doc__,
        "referee",
        stiffnesses=(list(STIFFNESSES), "of the pendulum [Pa]"),
        once=(False, "the pendulum not with twice the elements"),
    )
    report.machine |= {package: version(package) for package in ("cosseratbench", *OTHERS)}
    held = measure(report, "cantilever", {}, "Cantilever: a small force at the tip")
    load = load_of(registry.load_experiment("cantilever").scenario)
    linear = abs(load / 3.0 / elastica_deflection(load) - 1.0)
    report.tables[-1].note = (
        "Tip deflection error is the referee's, against the linear theory of Euler and Bernoulli, which is itself off "
        f"by {linear:.2g}. The exact elastica neither extends nor shears; PyElastica's rod does, which adds "
        "about 0.1 % to its deflection, and its clamped element, as MuJoCo's, does not bend."
    )
    error = held[f"this package, {ELEMENTS[1]} clothoids"].metrics[EXACT]
    report.claim("cantilever, 2 clothoids: error of the tip's deflection against the exact elastica", error, "<=", 1e-5)
    for modulus in asked.stiffnesses:
        values = {"youngs_modulus": modulus}
        title = f"Pendulum: a hanging cable of {modulus:g} Pa, against linear theory"
        swung = measure(report, "pendulum", values, title, not asked.once)
        error = swung[f"this package, {ELEMENTS[2]} clothoids"].metrics["period_error"]
        report.claim(f"pendulum of {modulus:g} Pa, 4 clothoids: error of the period", error, "<=", 1e-3)
    table = report.table("Experiments outside of this package's model", ["experiment", "why"])
    for name in registry.names("cosseratbench.experiments"):
        if name not in FITTING:
            result = run(registry.load_experiment(name), ContinuumGrasp())
            table.add(name, f"needs {', '.join(result.missing)}")
    table.note = "A capability that the experiment asks for; where it asks for none, what our adapter takes."
    report.finish()


if __name__ == "__main__":
    main()
