"""Plans of a finger with tendon friction that begins bent, on two winches or on one pulley: released, bent again,
through straight, and on the pulley from straight.

Run ``OPENBLAS_NUM_THREADS=1 python -m benchmarks.bench_plans`` in the root of the repository (10 min). Cases are
random: friction 0.1 to 0.3, one or two friction cells, two arcs or two clothoids, 0.3 to 0.6 s, least effort or least
input rate. Goals are where the finger stands after a slow change of its drives, so that they can be held. Each plan is
played by another integrator (LSODA, 1e-7): how far the tip is from its goal at the end, and how far it moves on in
0.2 s with drives that stand.

Presses: a finger of 0.2 m that is to press with its tip, held, on an object beside the path of the tip: polygons with
3 to 6 sharp corners, a disc with a box, wavy outlines; with and without friction, 0.1 to 0.6 N. Judged by the force
that is left 0.2 s after the end.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import continuum_grasp as cg
from benchmarks.report import begun
from continuum_grasp.addons.planning import PlanScene
from continuum_grasp.addons.planning.guess import first_state_of_plan
from continuum_grasp.base import Array
from continuum_grasp.control import Prediction
from continuum_grasp.scene import Tendons
from tests.control_cases import CABLE, DRIVES, HAND

LEAST_PULL = 6e-4
"""Cable by which the other winch is wound further than the bend asks for [m]."""


def case(seed: int, drive: str) -> tuple[str, PlanScene]:
    """What happens, and a scene of it with its goal, under one of ``tests.control_cases.DRIVES``."""
    rng = np.random.default_rng(seed)
    friction, cells = rng.uniform(0.1, 0.3), int(rng.integers(1, 3))
    family = ["arc", "clothoid"][seed % 2]
    side = rng.choice([-1, 1])
    kinds = ["release", "release", "through straight", "bent again"]
    if drive != "winches":
        kinds += ["from straight", "from straight"]
    kind = kinds[int(rng.integers(0, len(kinds)))]
    begin, reached_by = rng.uniform(0.004, 0.008), "pulling"
    if kind == "release":
        end = begin * rng.uniform(0.1, 0.75)
    elif kind == "through straight":
        end = -rng.uniform(0.002, 0.006)
    elif kind == "from straight":
        begin, end = 0.0, begin
    else:
        begin, end, reached_by = begin * rng.uniform(0.2, 0.7), begin, "releasing"
    if kind == "release" and rng.uniform() < 0.2:
        reached_by = "releasing"
    duration, objective = rng.uniform(0.3, 0.6), str(rng.choice(["least_effort", "least_input_rate"]))
    own, form = DRIVES[drive]
    first, last = (wound(bend, side, drive) for bend in (begin, end))
    scene = PlanScene(
        finger=HAND.replaced(tendons=Tendons(**{**CABLE, "drive": own, "friction": friction, "friction_cells": cells})),
        gravity=(0.0, 0.0),
        fidelity={"family": family, "elements": 2},
        initial={"pose": "equilibrium", "reached_by": reached_by},
        input={**form, "form": "linear", "initial": first},
        goal={"tip": {"value": (0.0, 0.18), "weight": 1e6}, "end": "held"},
        objective=objective,
        duration=duration,
        intervals=20,
    )
    share = np.linspace(0.0, 1.0, 41)
    smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    slow = np.array(first) + smooth[:, None] * (np.array(last) - np.array(first))
    goal = played(scene, 2.0 * duration * share, slow, [0.0, 2.0 * duration + 1.0])[1]
    return kind, scene.replaced(goal={"tip": {"value": tuple(goal.tolist()), "weight": 1e6}, "end": "held"})


def wound(bend: float, side: int, drive: str) -> tuple[float, ...]:
    """Commands that wind up so much cable [m]: on both winches, on a pulley, or of its motor [rad]."""
    if drive == "winches":
        return (bend, -bend + float(np.sign(bend)) * LEAST_PULL)[::side]
    return (side * bend / DRIVES[drive][0].get("winch_radius", 1.0),)


def played(scene: PlanScene, t: Array, u: Array, times: list[float]) -> Array:
    """Tips (T, 2) [m] at instants, under inputs that are linear between nodes and stand after them."""
    model = Prediction(scene)
    start, p = first_state_of_plan(scene, model)[0], np.array(model.p_nominal)

    def inputs(at: float) -> list[float]:
        return [float(np.interp(at, t, column)) for column in u.T]

    def slope(at: float, x: Array) -> Array:
        return np.array(model.dynamics(x, inputs(at), p)).ravel()

    found = solve_ivp(slope, (0.0, times[-1]), start, method="LSODA", rtol=1e-7, atol=1e-9, t_eval=times).y.T
    return np.array([np.array(model.tip(x, inputs(at), p)).ravel() for at, x in zip(times, found, strict=True)])


def row(seed: int, drive: str) -> list[Any]:
    """A line of the table of a drive."""
    kind, scene = case(seed, drive)
    tendons, began = scene.finger.tendons, time.thread_time()
    found = cg.plan(scene, raise_on_failure=False)
    spent = time.thread_time() - began
    _, end, later = played(scene, np.asarray(found.t), np.asarray(found.u), [0.0, found.t[-1], found.t[-1] + 0.2])
    goal = np.array(scene.goal.tip.value)
    settings = [f"{tendons.friction:.2f}, {tendons.friction_cells}", scene.fidelity.family, scene.objective]
    off = 1e6 * np.linalg.norm(end - goal), 1e6 * np.linalg.norm(later - end)
    return [seed, kind, *settings, found.status.value, *map(float, off), spent]


def press(seed: int) -> tuple[str, PlanScene]:
    """Kind of an object, and a scene in which the tip is to press on it."""
    rng, length = np.random.default_rng(seed), 0.2
    kind, size = ("polygon", "union", "outline")[seed % 3], rng.uniform(0.02, 0.045)
    if kind == "union":
        box = {"shape": "box", "width": size * rng.uniform(0.8, 1.6), "height": size * rng.uniform(0.5, 1.0)}
        box |= {"position": tuple((size * rng.uniform(-0.5, 0.5, 2)).tolist()), "angle": rng.uniform(0.0, 3.0)}
        members = [{"shape": "circle", "diameter": size * rng.uniform(0.8, 1.4)}, box]
        shape: dict[str, Any] = {"shape": "union", "center_of_mass": (0.0, 0.0), "members": members}
    else:
        count, waves = (int(rng.integers(3, 7)), 0) if kind == "polygon" else (60, int(rng.integers(3, 8)))
        angle = 2.0 * np.pi / count * (np.arange(count) + rng.uniform(0.0, 0.5, count) * (kind == "polygon"))
        radius = rng.uniform(0.6, 1.0, count) if kind == "polygon" else 1.0 + 0.12 * np.cos(waves * angle)
        corners = size * radius * np.array([np.cos(angle), np.sin(angle)])
        shape = {"shape": "polygon", "vertices": [tuple(corner) for corner in corners.T.tolist()]}
    # The tip at a bend that is constant along the finger, and the way on which it gets there.
    bend = rng.uniform(0.5, 1.8)
    tip = length / bend * np.array([1.0 - np.cos(bend), np.sin(bend)])
    way = np.array([np.sin(bend), np.cos(bend)]) - tip / length
    way /= np.hypot(*way)
    at = tip + size * (rng.uniform(0.7, 1.0) * way + rng.uniform(-0.4, 0.4) * np.array([-way[1], way[0]]))
    law = {"stiffness": 2e3, "friction": float(rng.choice([0.0, 0.4])), "slip_speed": 0.01, "rounding": 3e-4}
    rod = {"length": length, "linear_density": 0.03, "bending_stiffness": 0.01}
    tendons = {"offset": 0.006, "max_tension": 40.0, "time_constant": 0.02}
    return kind, PlanScene(
        finger={"rod": rod, "half_thickness": 0.006, "damping": {"material": 6e-5}, "tendons": tendons},
        gravity=(0.0, 0.0),
        object={**shape, "mass": 0.1, "position": tuple(at.tolist())},
        contact_law=law,
        fidelity={"family": "clothoid", "elements": 2},
        goal={"contact_force": {"value": [rng.uniform(0.1, 0.6)], "weight": 1e6}, "end": "held"},
        duration=0.5,
        intervals=25,
    )


def press_row(seed: int) -> list[Any]:
    """A line of the table of presses."""
    kind, scene = press(seed)
    began = time.thread_time()
    found = cg.plan(scene, raise_on_failure=False)
    spent, model, x = time.thread_time() - began, found.prediction, found.x[-1]
    p = np.array(model.p_nominal)

    def slope(at: float, x: Array) -> Array:
        return np.array(model.dynamics(x, found.u[-1], p)).ravel()

    x = solve_ivp(slope, (0.0, 0.2), x, method="LSODA", rtol=1e-7, atol=1e-9).y[:, -1]
    force = float(model.contact_force(x, found.u[-1], p))
    asked = scene.goal.targets["contact_force"][0]
    return [seed, kind, scene.contact_law.friction, asked, found.status.value, force, spent]


def main() -> None:
    asked, report = begun(__doc__, "plans", count=(20, "cases"), presses=(12, "cases that press"))
    columns = ["seed", "", "friction, cells", "family", "objective", "status"]
    columns += ["off its goal [um]", "moves on by [um]", "processor time [s]"]
    for drive, title, share in (("winches", "Two winches", 0.9), ("pulley", "One pulley", 1.0)):
        table = report.table(title, columns)
        for seed in range(asked.count):
            table.add(*row(seed, drive))
        if not asked.count:
            continue
        good = [one for one in table.rows if one[5] in ("feasible", "optimal")]
        report.claim(f"share of plans that were found, {title.lower()}", len(good) / asked.count, ">=", share)
        report.claim(f"their tips move on by [um], {title.lower()}", max(one[7] for one in good), "<=", 180.0)
    columns = ["seed", "", "friction", "asked [N]", "status", "0.2 s after the end [N]", "processor time [s]"]
    table = report.table("Presses", columns)
    for seed in range(asked.presses):
        table.add(*press_row(seed))
    good = [one for one in table.rows if one[4] in ("feasible", "optimal")]
    if good:
        report.claim("share of presses that were found", len(good) / asked.presses, ">=", 0.75)
        report.claim("greatest error of their forces [1]", max(abs(one[5] / one[3] - 1.0) for one in good), "<=", 0.1)
    report.finish()


if __name__ == "__main__":
    main()
