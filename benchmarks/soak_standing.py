"""A million steps of shipped loops at setpoints that stand, on fingers that are stiffer or softer by up to a fifth.

Each setpoint is the tip of the plant at rest under an input within the limits, at a pose within the constraints: the
plant itself reaches it. ``OFFSET`` while its true tip is nearer than the limit is a false alarm, a tip that is off by
twice the limit without it is silent. Of every tenth setpoint the tip is moved across its path by 3 to 8 % of the
length, where no input leads it: there ``OFFSET`` must come, with a cause in the plan (``UNREACHED`` or ``LIMITED``).
Sensors have the noise that the scene states. Nothing may trip.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from benchmarks.harness import CONFIGS, spread
from benchmarks.mpc.world import World
from benchmarks.report import Report, begun
from continuum_grasp.base import Array
from continuum_grasp.control import Controller, Health, OffsetCause
from continuum_grasp.scene import ControlScene, load

STANDS = 1000
"""Steps of a setpoint: a shipped loop counts as settled after 130 to 190, evidence takes 15 windows of 20 to 31."""
SLOW = 1e-3
"""Change of the tip over the last tenth of these, per length, up to which it does."""
INNER = (0.05, 0.7)
"""Share of the range of an input from which inputs of setpoints are drawn: what is left is for the wrong stiffness."""
MEAN = 150
"""Steps over which the true tip is averaged, about the five windows of the supervisor."""
WRONG = 0.2
"""Greatest share by which the stiffness is wrong."""
BEYOND, ACROSS = 0.1, (0.03, 0.08)
"""Share of setpoints off the path of the tip, and their distance from it, per length."""


def loops() -> tuple[str, ...]:
    """Names of shipped loops with an estimator and a setpoint of the tip."""
    found = []
    for path in sorted((CONFIGS / "mpc").glob("*.yaml")):
        scene = load(path)
        if isinstance(scene, ControlScene) and scene.estimator is not None and scene.reference.tip is not None:
            found.append(path.stem)
    return tuple(found)


@dataclass
class Counts:
    """What happened."""

    steps: int = 0
    setpoints: int = 0
    beyond: int = 0
    off: int = 0
    false: int = 0
    trips: int = 0
    silent: int = 0
    causes: Counter[str] = field(default_factory=Counter)
    health: Counter[str] = field(default_factory=Counter)
    worst: float = 0.0
    seconds: float = 0.0
    examples: list[str] = field(default_factory=list)

    def example(self, text: str) -> None:
        """Keep the first ones."""
        if len(self.examples) < 8:
            self.examples.append(text)


class Standing:
    """One controller that holds one setpoint after the other."""

    def __init__(self, name: str, seed: int) -> None:
        self.control = Controller(CONFIGS / "mpc" / f"{name}.yaml", deadline=math.inf)
        self.world, self.rng, self.counts = World(self.control), np.random.default_rng(seed), Counts()
        self.stages, scene = self.control.stages, self.control.scene
        self.nominal = np.array(self.stages.p_nominal)
        self.plant_p = self.nominal.copy()
        self.noise = np.array([scene.measurement_std(each) for each in self.control.measurement_names])
        self.tip = self.control.measurement_names.index("tip_x [m]")
        self.aim = self.stages.r_names.index("tip_x [m]")
        self.row = self.control.nominal_setpoints.rows(np.zeros(1))[0].copy()
        self.length, self.limit = scene.finger.rod.length, float(self.control.parts.supervisor["offset"])

    def _stiffness(self) -> None:
        for k, name in enumerate(self.stages.p_names):
            if name.startswith("bending_stiffness"):
                self.plant_p[k] = self.nominal[k] * (1.0 + self.rng.uniform(-WRONG, WRONG))

    def _rest(self, u: Array) -> Array | None:
        """Tip of the plant at rest under an input; None where it does not come to rest, or leaves the constraints."""
        world, stages = self.world, self.stages
        tips = world.rest(u, self.plant_p)[:, self.tip : self.tip + 2]
        if not world.sound() or not np.ptp(tips[-len(tips) // 10 :], axis=0).max() < SLOW * self.length:
            return None
        x = np.concatenate([world.z[: world.nx], u])[: stages.nx]
        rows = np.array(stages.cost(x, u, self.plant_p, self.row, np.ones(stages.nr))[3]).ravel()
        inside = np.all(rows <= stages.c_max) and np.all(rows >= stages.c_min)
        return np.array(tips[-1]) if inside else None

    def _input(self) -> Array:
        """An input well within its limits; winches and drives that pull against each other by opposite lengths."""
        low, high = self.stages.u_min, self.stages.u_max
        share = self.rng.uniform(*INNER, size=self.stages.nu)
        if np.all(low < 0.0):  # lengths and moments count from rest
            sign = np.where(np.arange(self.stages.nu) % 2, -1.0, 1.0) * self.rng.choice([-1.0, 1.0])
            return np.asarray(sign * share[0] * high)
        return np.asarray(low + share * (high - low))

    def setpoint(self) -> tuple[Array, bool]:
        """A setpoint, and whether the plant reaches it."""
        while True:
            u = self._input()
            tip = self._rest(u)
            if tip is None:
                continue
            if self.rng.random() >= BEYOND or self.stages.nu > 2:  # three tendons move a tip both ways
                return tip, True
            near = self._rest(u + 0.02 * (self.stages.u_max - self.stages.u_min) * np.array([1.0, -1.0])[: u.size])
            if near is None:
                continue
            along = (near - tip) / np.linalg.norm(near - tip)
            side = self.rng.choice([-1.0, 1.0]) * self.rng.uniform(*ACROSS) * self.length
            return tip + side * np.array([-along[1], along[0]]), False

    def hold(self) -> None:
        """Hold a setpoint, on another finger, from rest."""
        counts, world, control = self.counts, self.world, self.control
        self._stiffness()
        aim, reached = self.setpoint()
        counts.setpoints += 1
        counts.beyond += not reached
        world.reset()
        u = np.clip(np.zeros(self.stages.nu), self.stages.u_min, self.stages.u_max)
        for _ in range(10):  # until measurements that are late show nothing of the last one
            world.z[:] = world.first
            y = world.step(u, self.plant_p)
        control.reset(u=u)
        row, off, causes, limit = self.row.copy(), list[Array](), set[OffsetCause](), self.limit
        row[self.aim : self.aim + 2] = aim
        for _ in range(STANDS):
            command = control.step(y + self.noise * self.rng.normal(size=y.size), row)
            counts.steps += 1
            counts.health[command.health.name.lower()] += 1
            if command.health == Health.TRIPPED:
                counts.trips += 1
                counts.example(f"tripped ({command.trip.name.lower()}), setpoint {aim.round(4)}")
                return
            if command.health == Health.OFFSET:
                if not causes and (near := float(np.linalg.norm(np.mean(off[-MEAN:], axis=0)))) < limit:
                    counts.false += 1
                    counts.example(f"false: {1e3 * near:.2f} mm off, setpoint {aim.round(4)}")
                causes.add(OffsetCause(command.offset_cause))
            y = world.step(command.u, self.plant_p)
            off.append(y[self.tip : self.tip + 2] - aim)
        distance = float(np.linalg.norm(np.mean(off[-MEAN:], axis=0)))
        names = ", ".join(sorted(cause.name.lower() for cause in causes))
        if reached:
            counts.worst = max(counts.worst, distance)
            counts.off += bool(causes)
            if causes or distance > 2.0 * limit:
                counts.example(f"{1e3 * distance:.2f} mm off, {names or 'not reported'}, setpoint {aim.round(4)}")
            counts.silent += not causes and distance > 2.0 * limit
            return
        counts.causes[names or "none"] += 1
        if distance > 2.0 * limit and (not causes or OffsetCause.UNEXPECTED in causes):
            counts.silent += not causes
            counts.example(f"beyond: {1e3 * distance:.2f} mm off, {names or 'not reported'}, setpoint {aim.round(4)}")


def counts_of(task: tuple[str, int, int]) -> Counts:
    """The counts of a loop: its name, steps, seed."""
    name, steps, seed = task
    standing, began = Standing(name, seed), time.process_time()
    while standing.counts.steps < steps:
        standing.hold()
    standing.counts.seconds = time.process_time() - began
    return standing.counts


_NOTE = (
    "off: setpoints within reach at which OFFSET was reported; worst: distance of the tip from one within reach at the "
    "end; beyond: setpoints off the path of the tip, with the causes of their OFFSET; then steps by health."
)


def add(report: Report, found: dict[str, Counts], steps: int) -> None:
    """Claims and tables."""
    report.claim("steps", sum(counts.steps for counts in found.values()), ">=", steps)
    report.claim("trips", sum(counts.trips for counts in found.values()), "<=", 0)
    report.claim("OFFSET of tips nearer than the limit", sum(c.false for c in found.values()), "<=", 0)
    report.claim("tips off by twice the limit, not reported", sum(c.silent for c in found.values()), "<=", 0)
    causes = sorted({cause for counts in found.values() for cause in counts.causes})
    columns = [
        "loop",
        "steps",
        "setpoints",
        "off",
        "false",
        "trips",
        "worst mm",
        "beyond",
        *causes,
        *(h.name.lower() for h in Health),
    ]
    table = report.table("Setpoints that stand", columns, note=_NOTE)
    for name, counts in found.items():
        row = [
            name,
            counts.steps,
            counts.setpoints,
            counts.off,
            counts.false,
            counts.trips,
            1e3 * counts.worst,
            counts.beyond,
        ]
        table.add(*row, *(counts.causes[c] for c in causes), *(counts.health[h.name.lower()] for h in Health))
    examples = [[name, text] for name, counts in found.items() for text in counts.examples]
    if examples:
        report.table("Examples", ["loop", ""], examples)


def main() -> None:
    """Run all loops and write the report."""
    asked, report = begun(
        __doc__,
        "soak_standing",
        steps=(1_000_000, "of all loops together"),
        loops=(loops(), ""),
        jobs=(1, "processes at once"),
        seed=0,
    )
    tasks = [(name, math.ceil(asked.steps / len(asked.loops)), asked.seed + k) for k, name in enumerate(asked.loops)]
    found: dict[str, Counts] = {}
    for (name, *_), counts, error in spread(counts_of, tasks, asked.jobs):
        if error is None:
            found[name] = counts
            print(
                name,
                counts.steps,
                "steps,",
                counts.false,
                "false,",
                counts.trips,
                "trips,",
                counts.seconds,
                "s",
                flush=True,
            )
        else:
            report.claim(f"{name}: ended with {error}", 1, "<=", 0)
            print(name, "ended with", error, flush=True)
    add(report, {name: found[name] for name in asked.loops if name in found}, asked.steps)
    report.finish()


if __name__ == "__main__":
    main()
