"""Errors of the laws of tendon friction against a chain of guides, and a controller that meets such a chain.

Run ``OPENBLAS_NUM_THREADS=1 python -m benchmarks.bench_tendons`` in the root of the repository (10 min). A loop at rest
has inner loops; its error is the greatest difference per its range. tension: that of the drive goes to and fro; force:
12 N are held, and a force across the tip goes to and fro; wall: a winch closes the tip on a rigid wall, and the error
is that of the wall's force. Motions are those of two winches, 10 mm in 80 ms and 6 mm back.
"""

from __future__ import annotations

import argparse
import copy
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

import continuum_grasp as cg
from benchmarks.report import Report, Table
from tests.tendon_cases import LENGTH, OFFSET, STIFFNESS, Loaded, bend, finger, way
from tests.truth.tendon_motion import MovingFinger

CABLE = {"axial_stiffness": 1e4, "series_stiffness": 1 / 3e-5}
SERVO = {"kind": "length", "time_constant": 0.01}
FRICTIONS = (0.1, 0.3)
LAWS = [(2, 1), (2, 2), (2, 4), (4, 2)]
"""Elements, and cells of each."""
MOST = {"tension": (0.003, 0.025), "wall": (0.021, 0.07)}
"""Errors of two elements with two cells in a trial, per friction; rounded up."""
TENSIONS = {0.1: [1.0, 20.0, 6.0, 14.0, 1.0, 20.0], 0.3: [1.0, 26.0, 6.0, 16.0, 1.0, 26.0]}
FORCES = [0.0, 0.15, -0.15, 0.08, -0.08, 0.15]
WALL = -0.09
"""Place of the wall across the straight finger [m]."""
WOUND = [0.006, 0.0105, 0.0085, 0.0098, 0.0085, 0.0105]
SLACK = -0.03
"""What the other winch has let out [m]."""
FAR = 1e-7
"""Distance to the wall that is none [m]."""


class Chain:
    """The chain of guides with one tendon, moved so slowly that it is always at rest."""

    def __init__(self, friction: float, hinges: int) -> None:
        still = {"density": 1e-9, "damping": 1e-12, "tip_mass": 0.0, "time_step": 1.0}
        self.chain = MovingFinger(LENGTH, STIFFNESS, OFFSET, friction, sides=(1.0,), hinges=hinges, **still)

        self._at: dict[str, tuple[float, float]] = {}

    def _go(self, kind: str, value: float, force: float, parts: int = 1) -> None:
        """In smaller steps where all at once finds no state of the guides."""
        before = copy.deepcopy(self.chain.__dict__)
        start = self._at.get(kind, (value, force))
        try:
            for share in np.linspace(0.0, 1.0, parts + 1)[1:]:
                drum, push = (a + share * (b - a) for a, b in zip(start, (value, force), strict=True))
                self.chain.advance([(kind, drum)], (push, 0.0))
        except RuntimeError:
            if parts > 32:
                raise
            self.chain.__dict__.update(before)
            self._go(kind, value, force, 4 * parts)
        self._at = {kind: (value, force)}

    def pull(self, tension: float, force: float = 0.0) -> float:
        self._go("tension", tension, force)
        return self.chain.angle

    def wind(self, length: float, force: float) -> float:
        self._go("length", length, force)
        return float(self.chain.tip[0])


class Reduced:
    """The law of the package, with cells."""

    def __init__(self, friction: float, elements: int, cells: int, drive: dict[str, Any] | None) -> None:
        keys = {} if drive is None else {**CABLE, "drive": drive}
        own = finger(friction, friction_cells=cells, **keys)
        self.loaded = Loaded(
            cg.FingerModel(own, family="clothoid", elements=elements, gravity=(0, 0), bending_range=4.0 / elements)
        )

    def pull(self, tension: float, force: float = 0.0) -> float:
        self.loaded.move([tension, 0.0], (force, 0.0))
        return bend(self.loaded.model, self.loaded.q)

    def wind(self, length: float, force: float) -> float:
        self.loaded.move([length, SLACK], (force, 0.0))
        return float(np.array(self.loaded.model.tip(self.loaded.q, [0.0, 0.0], [])).ravel()[0])


def against_wall(given: Any, lengths: Sequence[float]) -> list[float]:
    """Force of a rigid wall on the tip [N] along the way, by secants from the state before."""
    found, force = [], 0.0
    for length in lengths:
        before = copy.deepcopy(given.__dict__)

        def gap(pushed: float, before: dict[str, Any] = before, length: float = length) -> float:
            given.__dict__.update(copy.deepcopy(before))
            return float(given.wind(length, pushed)) - WALL

        # From the force before: without any a tendon that is pressed far may go slack.
        last, past = force, gap(force)
        guess = force + (0.002 if past < 0.0 else -0.5 * force)
        for _ in range(40):
            if abs(past) < FAR or (last == 0.0 and past >= 0.0):
                break
            now = gap(guess)
            slope = (now - past) / (guess - last)
            last, past, guess = guess, now, max(guess - now / slope, 0.0)
        force = last
        found.append(force)
    return found


def loops(friction: float, make: Callable[[bool], Any]) -> dict[str, np.ndarray]:
    """The three loops of a law."""
    one = make(False)
    found = {"tension": [one.pull(tension) for tension in way(TENSIONS[friction], 1.0)]}
    one = make(False)
    for tension in way([1.0, 12.0], 1.0):
        one.pull(tension)
    found["force"] = [one.pull(12.0, force) for force in way(FORCES, 0.02)]
    found["wall"] = against_wall(make(True), way([0.0005, *WOUND], 0.0005))
    return {name: np.array(values) for name, values in found.items()}


def moved(friction: float, cells: int) -> tuple[float, float, float]:
    """Greatest errors of angle [rad] and tip [mm], and that of tensions in the mean [N], of two winches."""
    keys = {**CABLE, "friction_cells": cells, "drive": {**SERVO, "pretension": 2.0}}
    at = {"times": (0.0, 0.08, 0.16)}
    scene = cg.Scene(
        finger=finger(friction, **keys),
        gravity=(0.0, 0.0),
        actuation={"lengths": [at | {"values": (0.0, s * 0.010, s * 0.004)} for s in (1, -1)]},
        time={"duration": 0.3, "step": 1e-3},
        fidelity={"family": "clothoid"},
    )
    motion = cg.simulate(scene)
    wound = motion.x[:, [2 * motion.n, 2 * motion.n + 2]] + motion.model.structure.winches[0].start
    chain = MovingFinger(LENGTH, STIFFNESS, OFFSET, friction, hinges=40)
    chain.start([("length", y) for y in wound[0]])
    exact = []
    for a, b in pairwise(wound):
        for share in (0.25, 0.5, 0.75, 1.0):
            chain.advance([("length", y) for y in a + share * (b - a)])
        exact.append((chain.angle, *chain.tip, *chain.tensions))
    truth = np.array(exact)
    bends = [bend(motion.model, q) for q in motion.q[1:]]
    return (
        float(np.abs(bends - truth[:, 0]).max()),
        float(1e3 * np.linalg.norm(motion.tip[1:] - truth[:, 1:3], axis=1).max()),
        float(np.sqrt(np.mean((motion.tensions[1:] - truth[:, 3:]) ** 2))),
    )


class ChainPlant:
    """The chain of guides as a plant: tensions that lag behind their commands, and late measurements of the tip."""

    def __init__(self, friction: float, hinges: int, lag: float, delay: float) -> None:
        self.chain = MovingFinger(LENGTH, STIFFNESS, OFFSET, friction, hinges=hinges)
        self._lag, self._tensions, self._rates = lag, np.ones(2), np.zeros(2)
        late = round(delay / self.chain.time_step) + 1
        self._seen = [self._now()] * late

    def _now(self) -> np.ndarray:
        return np.array([*self.chain.tip, *self._tensions])

    def measure(self) -> np.ndarray:
        return self._seen[0]

    def advance(self, u: np.ndarray, period: float) -> None:
        step = self.chain.time_step
        for _ in range(round(period / step)):
            change = (u - self._tensions) / self._lag**2 - 2.0 * self._rates / self._lag
            self._rates = self._rates + step * change
            self._tensions = self._tensions + step * self._rates
            self.chain.advance([("tension", float(tension)) for tension in self._tensions])
            self._seen = [*self._seen[1:], self._now()]


def controlled(friction: float, known: float, hinges: int) -> list[float]:
    """Distance of the tip from each of two setpoints of ``tip_steps`` 0.45 s after it came [mm]."""
    changes: dict[str, Any] = {"finger.tendons.friction": known, "duration": 1.4}
    if known:
        changes |= {"fidelity.family": "clothoid", "finger.tendons.friction_cells": 1}
    scene = cg.load("configs/mpc/tip_steps.yaml", changes)
    controller = cg.Controller(scene, deadline=math.inf)
    plant = ChainPlant(friction, hinges, 0.02, 0.01)
    controller.reset(u=plant.measure()[2:])
    names = [name.partition(" ")[0] for name in controller.measurement_names]
    order = [("tip_x", "tip_y", "tension_1", "tension_2").index(name) for name in names]
    found, period = [], controller.period
    # the controller moves on before the setpoint does, which it sees coming
    setpoints = {0.55: (-0.0827, 0.1515), 1.35: (0.0682, 0.1614)}
    for k in range(round(scene.duration / period)):
        plant.advance(controller.step(plant.measure()[order]).u, period)
        for at, place in setpoints.items():
            if abs((k + 1) * period - at) < 0.5 * period:
                found.append(float(1e3 * np.linalg.norm(plant.chain.tip - place)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hinges", type=int, default=60)
    hinges = parser.parse_args().hinges
    report = Report("tendons", 0)
    rows: dict[tuple[int, int], list[Any]] = {law: [f"{law[0]} elements, {law[1]} cells"] for law in LAWS}
    for k, friction in enumerate(FRICTIONS):
        exact = loops(friction, lambda _, mu=friction: Chain(mu, hinges))
        for elements, cells in LAWS:
            found = loops(
                friction, lambda wound, mu=friction, n=elements, m=cells: Reduced(mu, n, m, SERVO if wound else None)
            )
            for name, values in found.items():
                error = float(np.abs(values - exact[name]).max() / np.ptp(exact[name]))
                rows[elements, cells].append(100 * error)
                if (elements, cells) == (2, 2) and name in MOST:
                    report.claim(f"{name}, friction {friction}: error per range", error, "<=", MOST[name][k])
        print(friction, [row[-3:] for row in rows.values()], flush=True)
    columns = [f"{name}, {mu} [%]" for mu in FRICTIONS for name in ("tension", "force", "wall")]
    report.tables.append(Table("Loops at rest", ["law", *columns], list(rows.values())))
    motions = [[f"friction {mu}, {cells} cells", *moved(mu, cells)] for mu in (0.15, 0.3) for cells in (1, 2)]
    report.tables.append(Table("Two winches", ["", "angle [rad]", "tip [mm]", "tensions, r.m.s. [N]"], motions))
    for row, (angle, tip, tension) in zip(motions[1::2], ((0.007, 2.2, 0.33), (0.019, 3.0, 0.66)), strict=True):
        for what, value, limit in zip(("angle", "tip", "tension"), row[1:], (angle, tip, tension), strict=True):
            report.claim(f"two winches, {row[0]}: {what}", value, "<=", limit)
    held = [
        [f"friction {mu}, controller assumes {known}", *controlled(mu, known, 40)]
        for mu, known in ((0.0, 0.0), (0.15, 0.0), (0.3, 0.0), (0.15, 0.15), (0.075, 0.15), (0.225, 0.15))
    ]
    columns = ["", "first setpoint [mm]", "second setpoint [mm]"]
    note = "Tip and tensions are measured, 10 ms late; the chain has 40 guides."
    report.tables.append(Table("A controller on the chain", columns, held, note))
    for file in report.write():
        print(file)
    print(report.status)


if __name__ == "__main__":
    main()
