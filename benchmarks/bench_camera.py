"""Shipped loops that hold a setpoint of the tip, with a camera that is a little off: where its tip comes to rest.

The plant is the scene's own (``SimulatedBench``), the camera is scaled about the base, turned about it, or shifted. The
setpoint is the one of the scene that bends the finger most, and it stands. A tip that two tendons or one drive move
stays on a curve: along it the measured tip has to reach the setpoint, across it stays what the camera is off there.
Three tendons move a tip both ways: there all distances count as along.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.bench_robustness import LOOPS
from benchmarks.harness import CONFIGS, spread
from benchmarks.mpc.world import World
from benchmarks.report import Report, begun
from continuum_grasp.base import Array
from continuum_grasp.closed_loop import SimulatedBench
from continuum_grasp.control import Controller, Health, Outputs, Setpoints
from continuum_grasp.scene import load

HELD = {"nitinol_moment": 14.0, "trunk_2m": 40.0, "spirob": 14.0, "winches": 10.0, "pulse": 8.0, "unknown_payload": 8.0}
"""How long a setpoint stands [s]: slow rods, and loops that learn slowly."""
OTHERS = 6.0
"""The same of other loops."""
BENT = {"pulse": (-0.0827, 0.1515), "keep_out": (-0.0524, 0.1694), "saturation": (-0.0524, 0.1694)}
"""Setpoints of loops whose own is straight (that of ``steady_tip``, the same finger) or out of reach (another) [m]."""
RESTS = 6000
"""Steps of the model until it rests: damped soft rods creep."""
LAST = 2.0
"""Time at the end over which the tip is averaged, whose noise sways it [s]."""
ASKED, SHARE = 5e-4, 2e-3
"""Distance along its path that a measured tip may be off: of a hand's finger [m], of longer ones per length."""


def scaled(factor: float) -> Callable[[Array], Array]:
    """A camera that reads distances from the base too long by a factor."""
    return lambda tip: factor * tip


def turned(degrees: float) -> Callable[[Array], Array]:
    """A camera that is turned about the base."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return lambda tip: np.array([[c, -s], [s, c]]) @ tip


def shifted(x_mm: float, y_mm: float) -> Callable[[Array], Array]:
    """A camera that is shifted, by millimeters."""
    return lambda tip: tip + 1e-3 * np.array([x_mm, y_mm])


CAMERAS: dict[str, Callable[[Array], Array]] = {
    "right": scaled(1.0),
    "scale +0.5 %": scaled(1.005),
    "scale +1 %": scaled(1.01),
    "scale -0.5 %": scaled(0.995),
    "scale -1 %": scaled(0.99),
    "turned 0.5 deg": turned(0.5),
    "turned 1 deg": turned(1.0),
    "turned -1 deg": turned(-1.0),
    "shift x 1 mm": shifted(1.0, 0.0),
    "shift y 1 mm": shifted(0.0, 1.0),
    "shift y -1 mm": shifted(0.0, -1.0),
    "shift y 2 mm": shifted(0.0, 2.0),
}


@dataclass
class Held:
    """Where a tip came to rest; pairs are distances along and across its path [m]."""

    loop: str
    length: float
    camera: str
    measured: Array
    """Measured tip from the setpoint."""
    off: Array
    """The camera's own error there."""
    true: float
    """Distance of the true tip from the setpoint."""
    health: dict[str, int]
    """Steps by health, over the same time."""


def farthest(loop: str, control: Controller, first: Array) -> Array:
    """The setpoint of the scene that is farthest from the tip at first."""
    if loop in BENT:
        return np.array(BENT[loop])
    scene = control.scene
    points = Setpoints.of(Outputs.of(scene.controller.cost, control.prediction), scene.reference)
    times = np.linspace(0.0, scene.duration, 200)
    tips = points.rows(times)[:, points.parts["tip"]]
    return np.asarray(tips[np.argmax(np.linalg.norm(tips - first, axis=1))])


def path(control: Controller, u: Array) -> Array:
    """Unit vector along which inputs move the tip of the model at rest: the second tendon pulls as the first gives."""
    world, low, high = World(control), control.stages.u_min, control.stages.u_max
    change = 0.02 * (high - low) * np.array([1.0, -1.0])[: u.size]
    k = control.measurement_names.index("tip_x [m]")
    ends = []
    for sign in (1.0, -1.0):
        tips = world.rest(np.clip(u + sign * change, low, high), control.stages.p_nominal, RESTS)[:, k : k + 2]
        ends.append(tips[-1])
    moved = ends[0] - ends[1]
    return np.asarray(moved / np.linalg.norm(moved))


def split(distance: Array, along: Array | None) -> Array:
    """A distance along the path of the tip and across it; all of it along where the tip goes both ways."""
    if along is None:
        return np.array([np.linalg.norm(distance), 0.0])
    return np.array([along @ distance, along[0] * distance[1] - along[1] * distance[0]])


def held_of(task: tuple[str, Sequence[str]]) -> list[Held]:
    """All cameras of a loop."""
    loop, cameras = task
    scene = load(CONFIGS / "mpc" / f"{loop}.yaml")
    control = Controller(scene, deadline=math.inf)
    k, ends = control.measurement_names.index("tip_x [m]"), []
    aim = farthest(loop, control, np.array(SimulatedBench(scene).read())[k : k + 2])
    steps, last = round(HELD.get(loop, OTHERS) / control.period), round(LAST / control.period)
    for name in cameras:
        control.reset()
        control.reference(tip=tuple(aim))
        bench, tips = SimulatedBench(scene), np.empty((steps, 2, 2))
        health = Counter[str]()
        for step in range(steps):
            y = np.array(bench.read(), dtype=float)
            true = y[k : k + 2].copy()
            y[k : k + 2] = CAMERAS[name](true)
            tips[step] = true, y[k : k + 2]
            command = control.step(y)
            if step >= steps - last:
                health[Health(command.health).name] += 1
            bench.write(command)
            bench.idle()
        ends.append((name, *np.mean(tips[-last:], axis=0), dict(health)))
    along = path(control, np.array(command.u)) if command.u.size <= 2 else None
    return [
        Held(
            loop,
            scene.finger.rod.length,
            name,
            split(seen - aim, along),
            split(seen - true, along),
            float(np.linalg.norm(true - aim)),
            health,
        )
        for name, true, seen, health in ends
    ]


def add(report: Report, found: Sequence[Held]) -> None:
    """Claims and tables."""
    for loop in dict.fromkeys(each.loop for each in found):
        rows = [each for each in found if each.loop == loop]
        worst, limit = max(abs(each.measured[0]) for each in rows), max(ASKED, SHARE * rows[0].length)
        report.claim(f"{loop}: measured tip off its setpoint, along its path [mm]", 1e3 * worst, "<=", 1e3 * limit)
    tripped = sum("TRIPPED" in each.health for each in found)
    report.claim("trips", tripped, "<=", 0)
    columns = ["loop", "camera", "measured, along", "across", "camera off, along", "across", "true tip", "health"]
    note = (
        "Mean of the last two seconds, in mm: measured tip from the setpoint, the camera's own error, true tip from it."
    )
    table = report.table("Tips at rest", columns, note=note)
    for each in found:
        health = ", ".join(f"{name.lower()} {count}" for name, count in each.health.items())
        table.add(each.loop, each.camera, *(1e3 * d for d in (*each.measured, *each.off, each.true)), health)


def main() -> None:
    """Run the loops asked for and write the report."""
    asked, report = begun(__doc__, "camera", loops=(LOOPS, ""), cameras=(tuple(CAMERAS), ""), jobs=1)
    found: dict[str, list[Held]] = {}
    for (loop, _), held, error in spread(held_of, [(loop, asked.cameras) for loop in asked.loops], asked.jobs):
        if error is not None:
            raise error
        found[loop] = held
        print(loop, "held", flush=True)
    add(report, [each for loop in asked.loops for each in found[loop]])
    report.finish()


if __name__ == "__main__":
    main()
