"""Missions of two fingers whose object and fingers are drawn at random: how many hold and release.

Run ``python -m benchmarks.bench_missions`` in the root of the repository (a quarter of an hour on one core, most of it
to compile controllers and plants). Each mission is ``configs/mission/pinch.yaml`` with another object and other
fingers, which differ from each other; its grasp is optimized and certified for 10 % more mass and 10 % less friction.
Missions are drawn until as many as asked for have a verified grasp, and these are carried out; a draw without one is
in the table with its status. All that is known before a run is in the column "before".

``--slip`` instead carries shipped missions out on plants whose friction falls in the middle of the hold, as planned and
with ``slip`` (hours on one core), and says of each plant whether its grasp would hold it there by its certificate.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.harness import CONFIGS
from benchmarks.report import Report, begun, plain
from continuum_grasp.addons.mission import Outcome, PlantVariation, run_mission, run_trials
from continuum_grasp.addons.mission.assignment import LARGEST, Assignment
from continuum_grasp.addons.mission.budget import held_resistance, plant_friction, plant_mass
from continuum_grasp.addons.mission.causes import FALLEN
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.plant import reserve
from continuum_grasp.base import ContinuumGraspError
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import load

SCENE = CONFIGS / "mission/pinch.yaml"
SEED = 20274
ELEMENTS = 4
"""Clothoids of each finger of the plant [1]: half of those of the shipped mission, which compile for a minute."""
DRAWS = 3
"""Missions that are drawn at most, per mission that is asked for."""
COLUMNS = ["object", "fingers: length [mm], stiffness [N m2]", "grasp", "mission", "sunk [mm]", "moved [mm]"]
COLUMNS += ["force off [%]", "slip margin", "while pulled", "fallbacks", "before"]


WATCHED = "slip={height: 0.1 mm}"
SLIPS = (("mug", 0.3, 100), ("mug", 0.5, 20), ("mug_servo", 0.3, 12), ("pinch", 0.3, 12))
"""Missions whose friction falls, by which share, and on how many plants."""
PLANNED = 6
"""Plants that are held as planned, the first ones of each."""
SLIP_SEED = 20281
"""Seed of their draws: no constant of the answer was chosen on these."""
HOLDS = ("as it is", "squeezed", "neither")
"""By which normal forces the certificate holds a plant with the friction that is left, pulls included."""
OUTCOMES = ("held", "squeezed and held", "set down", "fell while set down", "dropped")


def drawn(rng: np.random.Generator) -> tuple[str, str, dict[str, Any]]:
    """Object and fingers in words, and the changes to the scene."""
    shape = str(rng.choice(["circle", "ellipse", "box"]))
    height, mass, friction = rng.uniform(0.040, 0.075), rng.uniform(0.05, 0.20), rng.uniform(0.35, 0.80)
    gap, place, wide = rng.uniform(0.006, 0.014), rng.uniform(0.90, 1.02), rng.uniform(0.7, 1.2)
    lengths, stiffness = rng.uniform(0.075, 0.110, 2), rng.uniform(2.5e-2, 6.0e-2, 2)
    reach = float(lengths.max())
    size = {"diameter": height} if shape == "circle" else {"width": wide * height, "height": height}
    body = {"shape": shape, **size, "mass": 1.1 * mass, "position": [place * reach, 0.0]}
    body |= {"free": {"x": [0.6 * reach, 1.15 * reach]}} | ({"corner_radius": 0.006} if shape == "box" else {})
    fingers = {}
    for name, side, length, own in zip(("lower", "upper"), (-1.0, 1.0), lengths, stiffness, strict=True):
        # The tips of the straight fingers are side by side, each as far from the object; the disc's radius is 6 mm.
        base = [float(reach - length), float(side * (0.5 * height + 0.006 + gap))]
        fingers[name] = {
            "extends": "../fingers/stiff_finger.yaml",
            "rod": {"length": length, "linear_density": 0.047, "bending_stiffness": own}
            | {"rotary_inertia": 2.6e-7, "diameter": 0.002},
            "damping": {"material": 4.9e-3 * own},
            "masses": [{"at": length, "mass": 0.002}],
            "base": {"position": base, "angle": -0.5 * np.pi},
        }
    changes = {
        "grasp.fingers": fingers,
        "grasp.object": body,
        "object_mass": mass,
        "contact_law.friction": friction,
        "grasp.contacts.friction": 0.9 * friction,
        "plant.fidelity.elements": ELEMENTS,
        "estimator.measured.bending.at": (np.linspace(0.15, 1.0, 6) * lengths.min()).tolist(),
    }
    extent = " x ".join(f"{1e3 * each:.0f}" for each in size.values())
    words = f"{shape}, {extent} mm, {1e3 * mass:.0f} g, friction {friction:.2f}, {1e3 * gap:.0f} mm off"
    own_words = "; ".join(f"{1e3 * a:.0f}, {b:.3f}" for a, b in zip(lengths, stiffness, strict=True))
    return words, own_words, plain(changes)


def carried_out(changes: dict[str, Any]) -> tuple[list[Any], bool | None]:
    """Columns of the table from the grasp on, and whether it was held and released; None where nothing was run."""
    try:
        scene = load(SCENE, changes)
        grasp = optimize_grasp(scene.grasp)
        if not grasp.solved:
            return [grasp.status.value, *[""] * 7, grasp.advice.partition("\n")[0]], None
        run = run_mission(scene, grasp=grasp)
        verdict, before = run.verdict, "; ".join(one.text for one in run.exceeded)
    except ContinuumGraspError as error:
        return ["", type(error).__name__, *[""] * 6, str(error).partition("\n")[0]], None
    row = ["verified", verdict.word if verdict.drop is None else f"{verdict.word}: {verdict.drop.text}"]
    row += [1e3 * verdict.sunk, 1e3 * verdict.moved, 1e2 * verdict.force_error, verdict.slip_margin]
    return [*row, verdict.pulled_margin, verdict.fallbacks, before], verdict.succeeded


def holds(assignments: Sequence[Assignment], variation: PlantVariation) -> str:
    """Entry of ``HOLDS`` for a plant; squeezing scales all contact forces alike, as if loads were smaller."""
    of, mission = assignments[0], assignments[0].mission
    names = [contact.name for contact in of.grasp.contacts]
    friction = (1.0 - variation.friction_fall) * plant_friction(mission, variation, names)
    mass, evenly = plant_mass(mission, variation), of.grasp.quality.resistance.tendons != "locked"
    asked = mission.pull_share * np.minimum(of.resisted.factors, LARGEST)
    for word, more in zip(HOLDS, (0.0, min(reserve(one) for one in assignments)), strict=False):
        most = mission.drive_tension
        there = held_resistance(of.grasp, friction, mass / (1.0 + more), max_tension=most, evenly=evenly)
        if np.all((1.0 + more) * np.asarray(there.factors) >= asked * (1.0 - 1e-6)):
            return word
    return HOLDS[-1]


def outcome(one: Outcome) -> str:
    """Entry of ``OUTCOMES`` of a plant."""
    verdict = one.verdict
    if verdict is None or not verdict.held:
        fell = verdict is not None and verdict.sunk < FALLEN and verdict.drop is not None
        return "fell while set down" if fell else "dropped"
    return "set down" if verdict.set_down else "squeezed and held" if verdict.slipped else "held"


def slip_table(report: Report, name: str, fall: float, found: dict[bool, Sequence[Outcome]]) -> None:
    """Add outcomes of a mission by what its certificate says, held as planned (False) and watched (True)."""
    title = f"{name}: friction falls by {100 * fall:.0f} % in the hold"
    table = report.table(title, ["", "certificate holds it", "plants", *OUTCOMES], note=f"With {WATCHED}.")
    assignments = assign(load(CONFIGS / f"mission/{name}.yaml"))
    for watched, outcomes in found.items():
        counts = Counter((holds(assignments, one.variation), outcome(one)) for one in outcomes)
        worst = [1e3 * one.verdict.sunk for one in outcomes if one.verdict is not None and one.verdict.held]
        for word in HOLDS:
            row = [counts[word, what] for what in OUTCOMES]
            table.add("slip answered" if watched else "as planned", word, sum(row), *row)
        most = max(worst, default=np.nan)
        table.add("", "all, and sunk at worst where held [mm]", len(outcomes), most, *[""] * 4)


def slips(report: Report) -> None:
    """Carry missions out whose friction falls."""
    for name, fall, count in SLIPS:
        changes = [f"trials.seed={SLIP_SEED}", f"trials.friction_fall={fall}"]
        found = dict[bool, Sequence[Outcome]]()
        for watched, plants in ((False, min(count, PLANNED)), (True, count)):
            own = [*changes, f"trials.count={plants}", *[WATCHED] * watched]
            found[watched] = run_trials(load(CONFIGS / f"mission/{name}.yaml", own))
        slip_table(report, name, fall, found)
        lost = sum(outcome(one) == "dropped" for one in found[True])
        report.claim(f"{name}, friction {100 * fall:.0f} % less, slip answered: dropped", lost, "<=", 0)


def missions(report: Report, count: int, only: list[int]) -> None:
    """Draw and carry out missions, or some of the draws."""
    rng, done = np.random.default_rng(report.seed), list[bool]()
    table = report.table("Missions of two fingers drawn at random", COLUMNS, note=__doc__.partition("\n")[0])
    for k in range(1, DRAWS * count + 1):
        body, fingers, changes = drawn(rng)
        if only and k not in only:
            continue
        found, succeeded = carried_out(changes)
        table.add(body, fingers, *found)
        done += [] if succeeded is None else [succeeded]
        if len(done) == count:
            break
    report.claim("held and released", sum(done), ">=", count)


def main() -> None:
    """Carry missions out, and write the report."""
    asked, report = begun(
        __doc__,
        lambda asked: "mission_slip" if asked.slip else "missions",
        missions=(10, "how many are carried out"),
        seed=SEED,
        only=([int], "these draws alone, counted from 1"),
        slip=(False, "plants whose friction falls, instead"),
    )
    warnings.simplefilter("ignore")
    if asked.slip:
        report.seed = SLIP_SEED
        slips(report)
    else:
        missions(report, asked.missions, asked.only)
    report.finish()


if __name__ == "__main__":
    main()
