"""Contact detected by motor angle and torque alone, on a chain of guides that is not the detector's model.

Run ``OPENBLAS_NUM_THREADS=1 python -m benchmarks.bench_contact`` in the root of the repository (5 min). One tendon on a
motor bends the finger by 1.3 rad; angles come from an encoder of 14 bits, torques have noise of 0.2 mN m. A push
grows by 1 N/s, in the middle by 3 N/s. ``default``: the plant is less stiff by 20 %, its tendon friction greater by
50 % and the motor's dry friction by 30 %, as the detector's defaults allow; ``identified``: errors of 2, 10 and 10 %
are allowed, and the plant has none. Free motions are random, under gravity, of
chains with two tendons on one pulley or on a motor each, with payloads, random within the defaults or at their ends.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from benchmarks.report import Report, begun
from continuum_grasp.control import ContactDetector, ResidualContact
from tests.contact_cases import EXACT, RADIUS, PairPlant, pair_scene, plant, scene, trial, wander

TRIAL = {0.05: (19, 69), 0.1: (38, 137), 0.2: (76, 275), 0.3: (115, 413)}
"""Frictions, and the least forces at tip and middle in the trial with an unknown history [mN]."""
IDENTIFIED = {"bending_stiffness": 0.02, "tendon_friction": 0.1, "coulomb_friction": 0.1, "tension": 0.03}
PLACES = {"tip": (1, None, 1.0), "middle": (0, 10, 3.0)}
"""Entry of the detector's places, hinges before the push, and how fast it grows [N/s]."""
BENT = 0.00695
"""Cable wound up at 1.3 rad [m]."""
LATEST = 0.05
"""Time after three times the threshold in which a contact has to be detected [s]."""


def thresholds(friction: float) -> list[float]:
    """Half the loop of the tension [N], and least forces at the tip and in the middle [mN] by what is not known."""
    found = []
    for history_known, asked in ((False, EXACT), (True, EXACT), (True, IDENTIFIED), (True, {})):
        own = ContactDetector(scene(friction, detection=asked | {"history_known": history_known}))
        torque = 0.0
        for _ in range(2):  # the second time with the torque that holds the free finger, which is no contact
            own.reset([BENT], reached_by="pulling" if history_known else None)
            for _ in range(100):
                feels = own.step([BENT / RADIUS, torque])
                torque -= 0.2 * RADIUS * feels.residual[0]
        half = 0.5 * float(np.ptp(feels.bounds))
        if asked is EXACT:
            # Of the history alone, and of the motor's dry friction alone.
            dry, noise = own.settings["dry"][0], own.settings["noise"][0]
            half = dry if history_known else half - dry - noise
            found += [half] * (not history_known)
        found += [1e3 * half / abs(feels.gain[0, place]) for place in (1, 0)]
    return found


def pushes(friction: float, name: str, place: str) -> list[list[Any]]:
    """Rows of pushes at a place: both ways, from both histories."""
    at, pushed, speed = PLACES[place]
    asked, wrong = ({}, {"stiffness": 0.8, "dry": 1.3}) if name == "default" else (IDENTIFIED, {})
    own, rows = ContactDetector(scene(friction, detection=asked)), list[list[Any]]()
    for back in (False, True):
        for way in (1.0, -1.0):
            driven = plant(friction * (1.5 if wrong else 1.0), pushed=pushed, time_step=1e-3, **wrong)
            reports = trial(own, driven, back=back, speed=way * speed)
            free = [feels for _, force, feels in reports if force == 0.0]
            threshold = float(free[-1].threshold[at])
            first = next(((t, force, feels) for t, force, feels in reports if force and feels.detected), None)
            late = 1.2 if first is None else first[0] - 0.8 - 3.0 * threshold / speed
            words = name, str(friction), place, "releasing" if back else "pulling", "helps" if way > 0 else "opposes"
            felt, *forces = [np.nan] * 3 if first is None else 1e3 * np.array([first[1], *first[2].forces[at]])
            alarms = sum(feels.contact is not ResidualContact.FREE for feels in free)
            rows.append([", ".join(words), 1e3 * threshold, felt, 1e3 * late, *forces, alarms])
    return rows


def free_motion(steps: int, seed: int) -> tuple[int, int, float]:
    """Alarms, uncertain steps, and the greatest residual per bound, of a random plant in random motion."""
    rng = np.random.default_rng(seed)
    arrangement, friction = ("one_pulley", "per_tendon")[seed % 2], (0.05, 0.1, 0.2, 0.3)[seed // 2 % 4]
    own = ContactDetector(pair_scene(arrangement, friction, detection={"payload": 0.002}))
    if seed % 3 == 0:  # every error at one of its ends
        sides = rng.integers(0, 2, 4)
        factors = np.array([[0.8, 1.2], [0.5, 1.5], [0.7, 1.3], [0.0, 0.002]])[range(4), sides]
    else:
        factors = rng.uniform((0.8, 0.5, 0.7, 0.0), (1.2, 1.5, 1.3, 0.002))
    names = ("stiffness", "friction_factor", "dry", "payload")
    plant_ = PairPlant(arrangement, friction, **dict(zip(names, factors.tolist(), strict=True)))
    found = wander(own, plant_, steps, rng)
    use = max(float((feels.residual[:, None] / feels.bounds).max()) for feels in found)
    return (
        sum(feels.contact is ResidualContact.DETECTED for feels in found),
        sum(feels.contact is ResidualContact.UNCERTAIN for feels in found),
        use,
    )


def _touched(report: Report) -> None:
    """Tables of thresholds and pushes."""
    kinds = ("history unknown", "dry friction", "identified", "default")
    columns = [f"{what}, {at}" for what in kinds for at in PLACES]
    least = report.table("Least forces that are detected [mN]", ["friction", "half the loop [N]", *columns])
    for friction, known in TRIAL.items():
        least.add(friction, *thresholds(friction))
        for value, wanted, at in zip(least.rows[-1][2:4], known, PLACES, strict=True):
            what = f"history unknown, friction {friction}, {at}: off the trial"
            report.claim(what, abs(value / wanted - 1.0), "<=", 0.06)
    columns = ["", "threshold [mN]", "detected at [mN]", "after three times the threshold [ms]", "force, least [mN]"]
    table = report.table("Pushes", [*columns, "force, most [mN]", "alarms before"])
    for name, friction, place in product(("identified", "default"), (0.1, 0.3), PLACES):
        for row in pushes(friction, name, place):
            table.add(*row)
    latest = 1e-3 * max(row[3] for row in table.rows)
    report.claim("latest detection after three times the threshold [s]", latest, "<=", LATEST)
    report.claim("alarms before pushes", sum(row[-1] for row in table.rows), "<=", 0)


def main() -> None:
    plants = (50, "plants of 2000 steps each")
    given, report = begun(__doc__, "contact", plants=plants, free=(False, "free motion alone"))
    if not given.free:
        _touched(report)
    found = []
    for seed in range(given.plants):
        found.append(free_motion(2000, seed))
        print(seed, found[-1], flush=True)
    (alarms, uncertain, use), steps = zip(*found, strict=True), 2000 * given.plants
    columns = ["steps", "alarms", "uncertain", "greatest residual per bound"]
    report.table("Free motion", columns, [[steps, sum(alarms), sum(uncertain), float(max(use))]])
    report.claim(f"false alarms in {steps} steps", sum(alarms), "<=", 0)
    report.finish()


if __name__ == "__main__":
    main()
