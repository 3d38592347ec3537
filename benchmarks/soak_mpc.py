"""A million steps of controllers in closed loops, with everything wrong that a controller may be given.

Scenes run in worker processes, so that a crash is seen; references, disturbances, pushes and what is injected are drawn
at random. After every step: the command is finite and within the limits of input and rate, the status is one of the
documented ones, and each fault injected shows among the anomalies. A controller that trips is left to its ramp for a
while and then begins anew.

With ``--nominal`` nothing is injected; references jump, and fingers are stiffer or softer by up to a fifth: nothing may
trip.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.harness import CONFIGS, spread
from benchmarks.mpc import cases as mpc_cases
from benchmarks.mpc.world import World
from benchmarks.report import Report, begun
from continuum_grasp.base import Array
from continuum_grasp.control import Anomaly, CommandStatus, Controller, Health

SCENES = {
    "circle": ("mpc/tip_circle.yaml", "double", 0.25),
    "circle, float": ("mpc/tip_circle.yaml", "float", 0.1),
    "zones": ("mpc/keep_out.yaml", "double", 0.15),
    "contact": ("mpc/wrap_post.yaml", "double", 0.1),
    "saturation": ("mpc/saturation.yaml", "double", 0.1),
    "moment": ("mpc/nitinol_moment.yaml", "double", 0.15),
    "state": ("", "double", 0.15),
}
"""File, precision and share of the steps; state: arcs whose whole state is measured, with no estimator."""
EVENTS = {
    "NaN in the measurement": (Anomaly.MISSING, 0.02),
    "no measurement": (Anomaly.MISSING, 0.01),
    "infinite measurement": (Anomaly.ABSURD, 0.01),
    "measurement beyond its range": (Anomaly.ABSURD, 0.02),
    "bad setpoint": (Anomaly.BAD_SETPOINTS, 0.01),
    "bad parameter": (Anomaly.BAD_PARAMETERS, 0.01),
    "bad applied input": (Anomaly.BAD_APPLIED, 0.01),
    "late command": (Anomaly.LATE, 0.01),
}
"""What is injected, the anomaly that must show, and how often."""
BURST, LONGEST = 0.001, 80
"""How often one of them lasts, and for how many steps at most."""
OUTLIER = 0.01
"""How often a measurement jumps within its range; whether that can be noticed depends on what the estimator knows."""
DRIVE = 0.005
"""How often the drive applies another input than the command, and says so."""
RAMP = 100
"""Steps after which a controller that tripped begins anew; its ramp takes half a second."""
FINGER = 2000
"""Steps after which another finger is tried where nothing is injected."""
STILL = 10
"""Steps for which it rests before."""
WRONG = 0.2
"""Greatest share by which the stiffness is wrong without injected faults."""
SAVED = 5000
"""Steps between two checks that a restored state gives the same command."""
ROUNDING = {"double": 1e-12, "float": 3e-7}
"""Of limits, as a share of them."""


@dataclass
class Counts:
    """What happened."""

    steps: int = 0
    broken: Counter[str] = field(default_factory=Counter)
    injected: Counter[str] = field(default_factory=Counter)
    unseen: Counter[str] = field(default_factory=Counter)
    statuses: Counter[str] = field(default_factory=Counter)
    anomalies: Counter[str] = field(default_factory=Counter)
    health: Counter[str] = field(default_factory=Counter)
    trips: int = 0
    outliers: int = 0
    outliers_seen: int = 0
    plant_resets: int = 0
    restored: int = 0
    seconds: float = 0.0
    examples: list[str] = field(default_factory=list)

    def fault(self, what: str, text: str) -> None:
        """Count a broken promise and keep the first ones."""
        self.broken[what] += 1
        if len(self.examples) < 20:
            self.examples.append(f"step {self.steps}: {what}: {text}")


class Soak:
    """One controller in a closed loop with a random world."""

    def __init__(self, name: str, seed: int, nominal: bool = False) -> None:
        self.nominal, self.tripped = nominal, 0
        file, self.precision, _ = SCENES[name]
        scene: Any = CONFIGS / file if file else _measured_state()
        self.control = Controller(scene, precision=self.precision, deadline=math.inf)
        self.world, self.rng, self.counts = World(self.control), np.random.default_rng(seed), Counts()
        stages, ranges = self.control.stages, self.world.ranges
        self.stages, self.p = stages, np.array(stages.p_nominal)
        self.references, self.far = self._targets()
        self.reference = self.references[0]
        self.noise = 1e-4 * np.minimum(np.abs(ranges.measurement[:, 1]), 10.0)
        self.plant_p = self.p.copy()
        self.rate = np.full(stages.nu, self.control.scene.controller.input.rate_max or np.inf)
        self.events = list(EVENTS)
        self.chances = np.array([chance for _, chance in EVENTS.values()])
        self.safe = np.clip(np.zeros(stages.nu), stages.u_min, stages.u_max)
        self.before, self.old = self.safe, 0
        self.applied: Array | None = None
        self.measurement = self.world.step(self.before, self.p)
        self.burst: tuple[str, int] = ("", 0)

    def _targets(self) -> tuple[Array, Array]:
        """Setpoints that random shapes and inputs have, and some that nothing can reach."""
        stages, model, limits = self.stages, self.control.prediction, self.world.ranges.r
        shapes, rows = model.shapes(64), []
        for shape in shapes:
            u = self.rng.uniform(stages.u_min, stages.u_max)
            x = np.concatenate([model.at_rest(shape, u), u if stages.nx > model.nx else []])
            rows.append(np.array(stages.outputs(x, u, self.p)).ravel())
        far = [self.rng.uniform(*np.clip(limits, -1e3, 1e3).T) for _ in range(4)]
        return np.array(rows), np.vstack([*far, limits[:, 1], limits[:, 0]])

    # -- what goes in -------------------------------------------------------------------------------------------------

    def _beyond(self, low: float, high: float) -> float:
        """A number outside a range, near or far."""
        width = max(high - low, 1e-9)
        far = width * 10.0 ** self.rng.uniform(-3.0, 12.0)
        return float(high + far if self.rng.random() < 0.5 else low - far)

    def _bad(self, values: Array, limits: Array) -> Array:
        """Values of which one is not finite or beyond its limits."""
        found, k = values.copy(), self.rng.integers(len(values))
        found[k] = self.rng.choice([math.nan, math.inf, -math.inf, self._beyond(*limits[k])])
        return found

    def _events(self) -> set[str]:
        hits = self.rng.random(len(self.events)) < self.chances
        chosen = {name for name, hit in zip(self.events, hits, strict=True) if hit}
        if self.burst[1] > 0:
            chosen.add(self.burst[0])
            self.burst = (self.burst[0], self.burst[1] - 1)
        elif self.rng.random() < BURST:
            self.burst = (str(self.rng.choice(self.events)), int(self.rng.integers(2, LONGEST)))
        return chosen

    def _inputs(self) -> tuple[dict[str, Any], set[str], bool]:
        """Arguments of a step, what was injected in them, and whether a measurement jumps."""
        rng, ranges, stages = self.rng, self.world.ranges, self.stages
        chosen = set() if self.nominal else self._events()
        measurement = self.measurement + self.noise * rng.normal(size=len(self.noise))
        if self.nominal:
            return {"measurement": measurement, "reference": self.reference, "late": False}, set(), False
        size, limits = len(measurement), ranges.measurement
        jumps = rng.random() < OUTLIER
        if jumps:
            k = rng.integers(size)
            measurement[k] = rng.uniform(*(0.5 * limits[k] + 0.5 * measurement[k]))
        kinds = [n for n in self.events[:4] if n in chosen and n != "no measurement"]
        for place, name in zip(rng.permutation(size), kinds, strict=False):  # each has an entry of its own
            if name.startswith("NaN"):
                measurement[place] = math.nan
            elif name.startswith("infinite"):
                measurement[place] = rng.choice([-math.inf, math.inf])
            else:
                measurement[place] = self._beyond(*limits[place])
        reference = self.reference
        if rng.random() < 0.02:  # every node another
            reference = self.references[rng.integers(len(self.references), size=stages.stages + 1)]
        if "bad setpoint" in chosen:
            reference = np.array(np.broadcast_to(reference, (stages.stages + 1, stages.nr)))
            reference = self._bad(reference.ravel(), np.tile(ranges.r, (stages.stages + 1, 1))).reshape(reference.shape)
        p = self._bad(self.p, ranges.p) if "bad parameter" in chosen else self.p
        applied = None
        if "bad applied input" in chosen:
            applied = self._bad(self.before, ranges.applied)
        elif self.applied is not None:
            applied = self.before = self.applied
        given = {"reference": reference, "p": p, "applied": applied, "late": "late command" in chosen}
        given["measurement"] = None if "no measurement" in chosen else measurement
        if given["measurement"] is None:
            chosen -= set(self.events[:4]) - {"no measurement"}
        elif len(chosen & set(self.events[:4])) > size:
            chosen -= set(self.events[:4])
        return given, chosen, jumps and not chosen & set(self.events[:4])

    def _change(self) -> None:
        """Another setpoint, disturbance, push."""
        rng, world = self.rng, self.world
        if rng.random() < 0.02:
            some = self.far if rng.random() < 0.05 and not self.nominal else self.references
            self.reference = some[rng.integers(len(some))]
        if self.nominal:
            if self.counts.steps % FINGER == 0:
                self._next_finger()
            return
        if rng.random() < 0.005 and len(world.z) > world.nx:
            world.z[world.nx :] = 0.02 * rng.uniform(*world.ranges.disturbances.T)
        if rng.random() < 0.005:
            world.z[: world.nx] += 0.003 * world.ranges.x[:, 1] * rng.normal(size=world.nx)
        if not world.sound():
            world.reset()
            self.counts.plant_resets += 1

    def _next_finger(self) -> None:
        """Another plant at rest, and a controller that begins anew."""
        for k, name in enumerate(self.stages.p_names):
            if name.startswith("bending_stiffness"):
                self.plant_p[k] = self.p[k] * (1.0 + self.rng.uniform(-WRONG, WRONG))
        self.before = self.safe
        for _ in range(STILL):  # until measurements that are late show nothing of the last one
            self.world.z[:] = self.world.first
            self.measurement = self.world.step(self.before, self.plant_p)
        self.control.reset(u=self.before)

    # -- a step -------------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """One period."""
        counts, control = self.counts, self.control
        given, injected, jumps = self._inputs()
        saved = control.save_state() if counts.steps % SAVED == 0 else None
        command = control.step(**given)
        self._check(command, injected)
        counts.outliers += jumps
        counts.outliers_seen += jumps and bool(command.anomaly & (Anomaly.OUTLIER | Anomaly.REOPENED | Anomaly.ABSURD))
        if saved is not None:
            after = control.save_state()
            control.restore(saved)
            again = control.step(**given)
            if not (np.array_equal(again.u, command.u) and again.status == command.status):
                counts.fault("restored state gives another command", f"{again.u} instead of {command.u}")
            if control.save_state() != after:
                counts.fault("restored state gives another state", "")
            counts.restored += 1
        self.before, self.applied = command.u.copy(), None
        if not np.isfinite(self.before).all():
            self.before = self.safe
        elif self.rng.random() < DRIVE and not self.nominal:
            self.applied = self.rng.uniform(self.stages.u_min, self.stages.u_max)
        self.measurement = self.world.step(self.before if self.applied is None else self.applied, self.plant_p)
        self._change()
        self.tripped = self.tripped + 1 if command.health == Health.TRIPPED else 0
        counts.trips += self.tripped == 1
        if self.tripped > RAMP:
            control.reset(u=np.clip(self.before, self.stages.u_min, self.stages.u_max))
        counts.steps += 1

    def _check(self, command: Any, injected: set[str]) -> None:
        counts, stages, u = self.counts, self.stages, command.u
        slack = ROUNDING[self.precision] * np.maximum(np.abs(stages.u_min), np.abs(stages.u_max))
        if not np.isfinite(u).all():
            counts.fault("command not finite", str(u))
        elif (u < stages.u_min - slack).any() or (u > stages.u_max + slack).any():
            counts.fault("command beyond its limits", f"{u}")
        most = self.rate * self.control.period * (1.0 + 1e-6) + 2.0 * slack
        if not (np.abs(u - self.before) <= most).all():
            counts.fault("command beyond its rate", f"{self.before} to {u}, most {most}")
        anomaly = command.anomaly
        for name in injected:
            counts.injected[name] += 1
            if not anomaly & EVENTS[name][0]:
                counts.unseen[name] += 1
                counts.fault("injected and not in the status", f"{name}, {command.anomalies}")
        counts.statuses[CommandStatus(command.status).name.lower()] += 1
        counts.health[command.health.name.lower()] += 1
        if command.health == Health.TRIPPED and command.status is not CommandStatus.SAFE_RAMP:
            counts.fault("tripped, but no safe ramp", str(command))
        self.old = self.old + 1 if command.status is CommandStatus.PREVIOUS_PLAN else 0
        if self.old * self.control.period > stages.stages * stages.stage + 1e-9:
            counts.fault("plan used beyond its end", f"for {self.old} steps")
        for bit in anomaly:
            counts.anomalies[(bit.name or "").lower()] += 1

    def run(self, steps: int) -> Counts:
        """So many of them."""
        began = time.perf_counter()
        for _ in range(steps):
            self.step()
        self.counts.seconds = time.perf_counter() - began
        return self.counts


def _measured_state() -> Any:
    """Arcs whose whole state is measured; their moment has a rate limit."""
    return mpc_cases.arcs(steps=1).scene.changed({"controller.input.rate_max": 10.0})


def counts_of(task: tuple[str, int, int, bool]) -> Counts:
    """The counts of a scene: its name, steps, seed, and whether nothing is injected."""
    name, steps, seed, nominal = task
    return Soak(name, seed, nominal).run(steps)


def add(report: Report, found: dict[str, Counts], nominal: bool) -> None:
    """Claims and tables."""
    if nominal:
        report.claim("trips", sum(counts.trips for counts in found.values()), "<=", 0)
    report.claim("steps", sum(counts.steps for counts in found.values()), ">=", 1_000_000)
    broken = sum(counts.broken.total() for counts in found.values())
    report.claim("broken promises (commands, statuses, restored states)", broken, "<=", 0)
    injected, unseen = (sum(getattr(c, name).total() for c in found.values()) for name in ("injected", "unseen"))
    report.claim(f"injected anomalies that no status shows, of {injected}", unseen, "<=", 0)
    columns = ["scene", "steps", "broken", "injected", *(s.name.lower() for s in CommandStatus), "jumps reported"]
    columns += ["plant resets", "restored", "us per step"]
    note = (
        "jumps reported: of measurements that jump within their range, those that the status calls outliers, which an "
        "estimator that is unsure or a controller without one cannot; us per step: with plant and checks, in Python."
    )
    table = report.table("Steps", columns, note=note)
    for name, counts in found.items():
        statuses = [counts.statuses[status.name.lower()] for status in CommandStatus]
        row = [name, counts.steps, counts.broken.total(), counts.injected.total(), *statuses]
        seen = f"{counts.outliers_seen}/{counts.outliers}"
        table.add(*row, seen, counts.plant_resets, counts.restored, 1e6 * counts.seconds / counts.steps)
    kinds = {
        "injected": ("Injected", list(EVENTS)),
        "health": ("Health", [health.name.lower() for health in Health]),
        "anomalies": ("Anomalies reported", [(a.name or "").lower() for a in Anomaly]),
    }
    for key, (title, names) in kinds.items():
        rows = [[kind, *(getattr(counts, key)[kind] for counts in found.values())] for kind in names]
        rows += [["trips", *(counts.trips for counts in found.values())]] * (key == "health")
        report.table(title, ["", *found], rows)
    examples = [[name, text] for name, counts in found.items() for text in counts.examples]
    if examples:
        report.table("Broken", ["scene", ""], examples)


def main() -> None:
    """Run all scenes and write the report."""
    asked, report = begun(
        __doc__,
        lambda asked: "soak_nominal" if asked.nominal else "soak_mpc",
        steps=(1_000_000, "of all scenes together"),
        scenes=(tuple(SCENES), ""),
        jobs=(1, "processes at once"),
        seed=0,
        nominal=(False, "inject nothing: no trip is allowed"),
    )
    report.machine["flags"] = "of the package"
    whole = sum(SCENES[name][2] for name in asked.scenes)
    tasks = [
        (name, math.ceil(asked.steps * SCENES[name][2] / whole), asked.seed + k, asked.nominal)
        for k, name in enumerate(asked.scenes)
    ]
    found: dict[str, Counts] = {}
    for (name, *_), counts, error in spread(counts_of, tasks, asked.jobs):
        if error is None:
            found[name] = counts
            print(name, counts.steps, "steps,", counts.broken.total(), "broken", flush=True)
        else:
            report.claim(f"{name}: crashes", 1, "<=", 0)
            print(name, "ended with", error, flush=True)
    add(report, {name: found[name] for name in asked.scenes if name in found}, asked.nominal)
    report.finish()


if __name__ == "__main__":
    main()
