"""Errors of tendon friction against a chain of guides with the exact law.

Run ``OPENBLAS_NUM_THREADS=1 python -m benchmarks.bench_tendons`` in the root of the repository (10 min). A loop at rest
has inner loops; its error is the greatest difference per its range. tension: that of the drive goes to and fro, and the
angle is compared; force: 12 N are pulled and held, a force across the straight finger at its tip goes to and fro, and
the tip's place along it is compared; wall: a winch closes the tip on a rigid wall, whose force is compared.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import continuum_grasp as cg
from benchmarks.report import begun
from tests.tendon_cases import LENGTH, OFFSET, STIFFNESS, Loaded, bend, finger, way
from tests.truth.tendon import HingedFinger

CABLE = {"axial_stiffness": 1e4, "series_stiffness": 1 / 3e-5}
SERVO = {"kind": "length", "time_constant": 0.01}
FRICTIONS = (0.1, 0.3)
LAWS = {
    "always pulled in (earlier law)": (2, 0),
    "2 elements, 1 cell": (2, 1),
    "2 elements, 2 cells": (2, 2),
    "2 elements, 4 cells": (2, 4),
    "4 elements, 2 cells": (4, 2),
}
"""Elements, and cells of each; none: without a memory."""
MOST = {"tension": (0.003, 0.025), "force": (0.0052, 0.016), "wall": (0.021, 0.07)}
"""Errors of two elements with two cells in the trial that chose the law, per friction. Those of tensions (0.28, 2.4 %)
are reached at single points of the loop, and change by a tenth with where these lie."""
TENSIONS = {0.1: [0.5, 20.0, 6.0, 14.0, 0.5, 20.0], 0.3: [0.5, 26.0, 6.0, 16.0, 0.5, 26.0]}
FORCES = [0.0, 0.15, -0.15, 0.08, -0.08, 0.15]
WALL = -0.09
"""Place of the wall across the straight finger [m]."""
WOUND = [0.006, 0.0105, 0.0085, 0.0098, 0.0085, 0.0105]
SLACK = -0.03
"""What the other winch has let out [m]."""
FAR = 1e-7
"""Distance to the wall that is none [m]."""


class Chain:
    """The chain of guides with one tendon, at rest."""

    def __init__(self, friction: float, hinges: int) -> None:
        self.chain = HingedFinger(LENGTH, STIFFNESS, OFFSET, friction, sides=(1.0,), hinges=hinges)
        self._at: dict[str, tuple[float, float]] = {}

    def _go(self, kind: str, value: float, force: float, parts: int = 1) -> None:
        """In smaller steps where all at once finds no state of the guides."""
        start = self._at.get(kind, (value, force))
        try:
            for share in np.linspace(0.0, 1.0, parts + 1)[1:]:
                drum, push = (a + share * (b - a) for a, b in zip(start, (value, force), strict=True))
                self.chain.move([(kind, drum)], (push, 0.0))
                self._at = {kind: (drum, push)}
        except (RuntimeError, np.linalg.LinAlgError):
            if parts > 64:
                raise
            self._go(kind, value, force, 4 * parts)

    def pull(self, tension: float, force: float = 0.0) -> tuple[float, float]:
        self._go("tension", tension, force)
        return self.chain.angle, float(self.chain.tip[0])

    def wind(self, length: float, force: float) -> float:
        self._go("length", length, force)
        return float(self.chain.tip[0])


class Reduced:
    """The law of the package, with cells; without any, that of tendons that always slide towards their drives."""

    def __init__(self, friction: float, elements: int, cells: int, drive: dict[str, Any] | None) -> None:
        keys = {} if drive is None else {**CABLE, "drive": drive}
        own = finger(friction, friction_cells=cells or 2, **keys)
        model = cg.FingerModel(own, family="clothoid", elements=elements, gravity=(0, 0), bending_range=4.0 / elements)
        self.loaded = Loaded(model, memory=cells > 0)

    def _tip(self) -> float:
        return float(np.array(self.loaded.model.tip(self.loaded.q, [0.0, 0.0], [])).ravel()[0])

    def pull(self, tension: float, force: float = 0.0) -> tuple[float, float]:
        self.loaded.move([tension, 0.0], (force, 0.0))
        return bend(self.loaded.model, self.loaded.q), self._tip()

    def wind(self, length: float, force: float) -> float:
        self.loaded.move([length, SLACK], (force, 0.0))
        return self._tip()


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
    """The loops of a law."""
    one = make(False)
    found = {"tension": [one.pull(tension)[0] for tension in way(TENSIONS[friction], 1.0)]}
    one = make(False)
    pulled = [one.pull(tension)[1] for tension in way([0.5, 12.0], 1.0)]
    cycles = [one.pull(12.0, force)[1] for force in way(FORCES, 0.03)]
    found["force"], found["force alone"] = [*pulled, *cycles], cycles
    found["wall"] = against_wall(make(True), way([0.0005, *WOUND], 0.0005))
    return {name: np.array(values) for name, values in found.items()}


def main() -> None:
    asked, report = begun(__doc__, "tendons", hinges=60)
    rows: dict[str, list[Any]] = {law: [law] for law in LAWS}
    for k, friction in enumerate(FRICTIONS):
        exact = loops(friction, lambda _, mu=friction: Chain(mu, asked.hinges))
        for law, (elements, cells) in LAWS.items():
            found = loops(
                friction,
                lambda wound, mu=friction, n=elements, m=cells: Reduced(mu, n, m, SERVO if wound else None),
            )
            for name, values in found.items():
                error = float(np.abs(values - exact[name]).max() / np.ptp(exact[name]))
                rows[law].append(100 * error)
                if (elements, cells) == (2, 2) and name in MOST:
                    report.claim(f"{name}, friction {friction}: error per range", error, "<=", MOST[name][k])
            print(friction, law, rows[law][-len(found) :], flush=True)
    columns = [f"{name}, {mu} [%]" for mu in FRICTIONS for name in exact]
    note = (
        "Greatest difference from the chain per the range of the loop, with its inner loops. force: of the tip along "
        "the force, per the range with the pulling before; force alone: per that of the force's cycles. wall: of the "
        "wall's force."
    )
    report.table("Loops at rest", ["law", *columns], rows.values(), note)
    report.finish()


if __name__ == "__main__":
    main()
