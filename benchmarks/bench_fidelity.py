"""Whether a tolerance chooses rightly: within it, and nothing cheaper would have done.

Random scenes, each with one of some tolerances; the chosen model is measured again against the exact rod at other
places, and every cheaper choice on the list of up to one element more (arcs: as long as they may be cheaper) is
measured too.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from benchmarks.report import begun
from continuum_grasp.base import SolverError
from continuum_grasp.rod import solve_elastica
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import Chosen, choose_fidelity, equilibrium
from continuum_grasp.simulation.accuracy.choice import assess, choices, open_families
from continuum_grasp.simulation.accuracy.choose import allowed_accuracies
from continuum_grasp.simulation.accuracy.elements import COUNTS, coordinates_near

TOLERANCES = (2e-2, 5e-3, 1e-3, 1e-4)
PLACES = 173


def random_scene(seed: int) -> Scene:
    """A finger with random size, masses, rest curvature, loads, contacts and gravity; it moves in half of the cases.

    Loads, weights and rest curvatures bend it by angles of about one radian.
    """
    random = np.random.default_rng(seed)
    length, stiffness = 10 ** random.uniform(-1.2, 0.2), 10 ** random.uniform(-3.0, 0.0)
    force, moment = stiffness / length**2, stiffness / length
    weight = force * 10 ** random.uniform(-2.0, 0.3)
    scene: dict[str, Any] = {
        "finger": {
            "rod": {
                "length": length,
                "linear_density": weight / (9.81 * length),
                "bending_stiffness": stiffness,
            },
            "base": {"position": [0.0, 0.0], "angle": random.uniform(-np.pi, np.pi)},
            "masses": _masses(random, length, weight, force),
            "rest_curvature": _rest(random, length),
        },
        "gravity": [0.0, -9.81] if random.random() < 0.8 else [0.0, 0.0],
        "loads": [_load(random, length, force, moment) for _ in range(random.integers(0, 3))],
        "contacts": [length * random.uniform(0.25, 0.75)] if random.random() < 0.4 else [],
        "initial": {"pose": "equilibrium"},
    }
    if random.random() < 0.5:
        scene["time"] = {"duration": 1.0, "step": 0.01}
    if random.random() < 0.3:
        scene["actuation"] = {"tip_moment": float(random.normal() * moment)}
    return Scene.model_validate(scene)


def _masses(random: np.random.Generator, length: float, weight: float, force: float) -> list[dict[str, float]]:
    masses = []
    if random.random() < 0.5:
        masses.append({"at": length, "mass": min(weight * 10 ** random.uniform(-1.0, 1.0), force) / 9.81})
    if random.random() < 0.3:
        masses.append({"at": length * random.uniform(0.2, 0.9), "mass": weight * random.uniform(0.1, 0.5) / 9.81})
    return masses


def _rest(random: np.random.Generator, length: float) -> Any:
    kind = random.random()
    if kind < 0.25:
        return random.uniform(-1.5, 1.5) / length
    if kind < 0.4:
        values = (random.uniform(-1.5, 1.5, 2) / length).tolist()
        return {"breaks": [length * random.uniform(0.2, 0.8)], "values": values}
    return 0.0


def _load(random: np.random.Generator, length: float, force: float, moment: float) -> dict[str, Any]:
    at = length if random.random() < 0.4 else length * random.uniform(0.1, 0.95)
    if random.random() < 0.3:
        return {"kind": "moment", "at": at, "moment": float(random.normal() * 0.7 * moment)}
    value = (1.2 * force * random.normal(size=2)).tolist()
    return {"kind": "force", "at": at, "force": value, "follows": bool(random.random() < 0.3)}


def again(chosen: Chosen) -> float:
    """Error of the equilibrium at time zero per length, by the public way and at other places."""
    scene = chosen.scene
    rod = solve_elastica(scene)
    # So that both are on one branch.
    near = chosen.truth.cases[0].rod
    found = equilibrium(scene, guess=coordinates_near(chosen.best.choice.model, near.angle, near.curvature))
    s = np.linspace(0.0, scene.finger.rod.length, PLACES)
    return float(np.linalg.norm(found.backbone(PLACES) - rod.position(s), axis=1).max()) / scene.finger.rod.length


def cheaper(chosen: Chosen) -> str:
    """A choice on the list that costs less and meets the tolerance; empty where there is none.

    More terms are not tried where those that are left out cannot be what is wrong.
    """
    scene, best, tolerance = chosen.best.choice.scene, chosen.best, chosen.tolerance
    accuracies = allowed_accuracies(scene, tolerance)
    most_instructions = (2.0 if scene.time is not None else 1.0) * best.instructions
    for family in open_families(scene):
        most = 32 if family == "arc" else best.choice.elements + 1
        counts = [count for count in COUNTS if count <= most]
        for coarse in choices(scene, chosen.truth, family, accuracies[0], counts=counts):
            before = 0
            for accuracy in accuracies:
                choice = coarse.with_accuracy(accuracy)
                if choice.instructions >= most_instructions:
                    break
                if choice.instructions == before:
                    continue
                before = choice.instructions
                found = assess(choice, chosen.truth, stop_at=3.0 * max(tolerance, accuracy))
                if found.cost < 0.999 * best.cost and found.within(tolerance, scene.fidelity.frequencies):
                    return str(choice)
                if found.shape > 3.0 * max(tolerance, accuracy):
                    break
    return ""


def main() -> None:
    """Choose for every scene, check, and write the report."""
    asked, report = begun(__doc__, "fidelity", seed=0, scenes=200)
    columns = ["scene", "tolerance", "family", "elements", "accuracy", "instructions", "error / L", "frequency"]
    table = report.table("What was chosen", [*columns, "choosing [s]", "cheaper"])
    for number, tolerance in zip(range(asked.scenes), itertools.cycle(TOLERANCES), strict=False):
        seed = asked.seed + number
        scene = random_scene(seed)
        try:
            chosen = choose_fidelity(scene, tolerance)
        except SolverError as error:
            report.missing.append(f"scene {seed}, tolerance {tolerance:g}: {str(error).splitlines()[0]}")
            continue
        best, choice = chosen.best, chosen.best.choice
        frequency = float(best.frequencies[0]) if scene.time is not None else float("nan")
        made = seed, tolerance, choice.family, choice.elements, choice.accuracy, best.instructions
        table.add(*made, again(chosen), frequency, chosen.seconds, cheaper(chosen) or "-")
    count, seconds = max(len(table.rows), 1), [row[8] for row in table.rows]
    met = 100.0 * sum(row[6] <= row[1] * (1 + 1e-6) for row in table.rows) / count
    dominated = 100.0 * sum(row[9] != "-" for row in table.rows) / count
    report.claim("scenes that meet their tolerance, per cent", met, ">=", 99.0)
    report.claim("scenes for which nothing cheaper would do, per cent", 100.0 - dominated, ">=", 90.0)
    table.note = (
        f"{len(seconds)} scenes; choosing took {np.median(seconds):.2f} s (median), {max(seconds):.2f} s at most."
    )
    report.finish()


if __name__ == "__main__":
    main()
