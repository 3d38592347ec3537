"""Closed loops on which receding-horizon solvers are compared: problem, references, plant and what disturbs it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

import continuum_grasp as cg
from benchmarks.harness import CONFIGS
from continuum_grasp.base import Array
from continuum_grasp.control import ControlProblem, Prediction, Stages, stages_of
from continuum_grasp.scene import ControlScene

FINER = 4
"""Runge-Kutta steps of the plant for one of the controller's model."""
MISMATCH = 1.03
"""Stiffness of the plant over that of the model."""
PULSE = slice(120, 126)
"""Control steps of a push that no solver knows of."""
HEAVIER = 1.1
"""Mass of the plant's pole, or payload, over that of the model, where the model is no continuum finger."""
RODS: dict[str, tuple[str, dict[str, Any]]] = {
    "arcs": ("", {}),
    "jumps": ("; setpoints jump unannounced", {"largest": 1.0, "announced": False}),
    "lag": (" with lag", {"family": "matched_clothoid", "substeps": None, "largest": 0.6, "speed": 40.0}),
}
"""Words on a loop of the rod, and in what it differs from the first one: rows are violated, the moment lags."""
FINGERS = ("arcs", "jumps", "tendons", "lag")
NAMES = (*FINGERS, "cart_pole", "two_links")


@dataclass(frozen=True)
class Case:
    """One closed loop; the control period is a stage."""

    name: str
    what: str
    scene: ControlScene | None
    stages: Stages
    x0: Array
    u0: Array
    p: Array
    """Parameters that the solver is given, (np)."""
    plant_p: Array
    """Those of the plant, (steps, np)."""
    references: Array
    """Setpoints over the horizon at each step, (steps, N + 1, nr)."""

    @property
    def steps(self) -> int:
        """Control steps."""
        return len(self.references)

    def plant(self) -> ca.Function:
        """(x, u, p) -> xn after a stage, by finer Runge-Kutta steps."""
        return whole_stage("plant", self.stages, FINER * self.stages.substeps)

    def cost(self, x: Array, u: Array) -> float:
        """Cost of a closed loop with states x (steps + 1, nx) and inputs u (steps, nu), penalties included."""
        return float(self.stage_costs(x, u).sum())

    def stage_costs(self, x: Array, u: Array) -> Array:
        """The same, step by step, (steps)."""
        stages, steps = self.stages, len(u)
        cost = stages.cost.map(steps)
        wanted = self.references[:steps, 0].T
        value, _, _, c, _ = cost(x[:steps].T, u.T, self.p, wanted, stages.weights)
        left = outside(stages, np.array(c).T)
        found: Array = np.array(value)[0] + left @ stages.linear + 0.5 * left**2 @ stages.quadratic
        return found

    def excess(self, x: Array, u: Array) -> float:
        """Farthest that a row leaves its bounds, share of the bound's scale."""
        rows = self.stages.rows.map(len(u))
        c = np.array(rows(x[: len(u)].T, u.T, self.p)).T
        return float(outside(self.stages, c).max(initial=0.0))


def outside(stages: Stages, rows: Array) -> Array:
    """How far rows (..., nc) are outside their bounds."""
    found: Array = np.maximum(0.0, np.maximum(stages.c_min - rows, rows - stages.c_max))
    return found


def state_step(stages: Stages) -> ca.Function:
    """(x, u, p, h) -> xn: one Runge-Kutta step without its derivatives."""
    x, u, p, h = (ca.SX.sym(name, stages.step.size1_in(k)) for k, name in enumerate("xuph"))
    return ca.Function("state_step", [x, u, p, h], [stages.step(x, u, p, h)[0]], ["x", "u", "p", "h"], ["xn"])


def whole_stage(name: str, stages: Stages, count: int, **options: Any) -> ca.Function:
    """(x, u, p) -> xn after a stage in so many Runge-Kutta steps."""
    x, u, p = ca.MX.sym("x", stages.nx), ca.MX.sym("u", stages.nu), ca.MX.sym("p", stages.np)
    following, advance = x, state_step(stages)
    for _ in range(count):
        following = advance(following, u, p, stages.stage / count)
    return ca.Function(name, [x, u, p], [following], ["x", "u", "p"], ["xn"], options)


def case(name: str, *, steps: int = 400, seed: int = 0) -> Case:
    """One of ``NAMES``; the seed draws setpoints of rods."""
    if name in RODS:
        words, changes = RODS[name]
        made = arcs(steps=steps, seed=seed, **changes)
        return replace(made, name=name, what=made.what + words)
    return {"tendons": tendons, "cart_pole": cart_pole, "two_links": two_links}[name](steps=steps)


def arcs(
    *,
    steps: int = 400,
    seed: int = 0,
    horizon: int = 30,
    family: str = "arc",
    substeps: int | None = 1,
    zones: bool = False,
    largest: float = 1.2,
    speed: float = 15.0,
    announced: bool = True,
) -> Case:
    """The problem of the trials: two arcs of nickel-titanium, tip moment, setpoints of bending that switch.

    Setpoints are drawn up to ``largest`` [rad]; ``announced`` ones are known over the horizon. Bounded are bending
    (1.5 rad) and rates, as in the trials; with ``zones`` also a half-plane that four sections of every element keep out
    of.
    """
    bounds: dict[str, Any] = {"curvature": 5.0, "speed": speed}
    if zones:
        wall = {"type": "half_plane", "point": (0.0, -0.25), "normal_angle": np.pi / 2, "of": "backbone"}
        bounds["keep_out"] = {"floor": wall}
    scene = ControlScene.model_validate(
        {
            "finger": cg.load(CONFIGS / "fingers" / "nitinol_60cm.yaml"),
            "parameters": ("gravity", "bending_stiffness"),
            "gravity": (0.0, -9.81),
            "contacts": (0.3,),
            "fidelity": {"family": family, "elements": 2},
            "controller": {
                "horizon": {"stages": horizon, "stage": 0.01, "substeps": substeps},
                "cost": {
                    "bending": {"running": 100.0, "terminal": 10.0},
                    "effort": 1.0,
                    "speed": {"running": 0.01, "terminal": 0.001},
                },
                "input": {"moment_max": 0.3, "time_constant": 0.02 if family == "matched_clothoid" else None},
                "bounds": bounds,
            },
        }
    )
    stages, prediction = _stages(scene)
    if family == "arc" and not zones:  # the second arc may be faster
        scale = np.array([1.0, 1.0, 1.0, 40.0 / speed])
        stages = replace(stages, c_min=-scale, c_max=scale)
    rng = np.random.default_rng(seed)
    rows = np.zeros((steps, stages.nr))
    rows[:, :2] = np.repeat(rng.uniform(-largest, largest, (steps // 50 + 1, 1)), 50, axis=0)[:steps]
    known = np.vstack([rows, np.repeat(rows[-1:], horizon, axis=0)])
    ahead = [known[k : k + horizon + 1] if announced else known[k : k + 1] for k in range(steps)]
    references = np.stack([np.broadcast_to(r, (horizon + 1, stages.nr)) for r in ahead])
    what = f"NiTi rod, 2 {family.replace('_', ' ')}s, tip moment"
    return _closed("arcs", what, scene, stages, prediction, references, np.zeros(1))


def tendons(*, steps: int = 400, horizon: int = 30) -> Case:
    """The hand finger: two tendons with lag and rate limits, its tip on a circle."""
    circle = {"center": (-0.0827, 0.1515), "radius": 0.02, "frequency": 1.0, "phase": 0.6}  # m, Hz, rad
    scene = cg.load(CONFIGS / "mpc" / "tip_arc.yaml").changed({"reference": {"tip": circle}})
    controller = scene.controller.model_dump()
    # The derivatives of sdirk2 leave out the last Newton correction, which other solvers are given.
    controller["horizon"] |= {"stages": horizon, "method": "rk4"}
    data = {**scene.model_dump(), "controller": controller, "parameters": ("bending_stiffness",)}
    scene = ControlScene.model_validate(data)
    stages, prediction = _stages(scene)
    times = stages.stage * np.arange(steps + horizon + 1)
    angle = 2.0 * np.pi * circle["frequency"] * times + circle["phase"]
    rows = np.zeros((len(times), stages.nr))
    rows[:, :2] = circle["center"] + circle["radius"] * np.column_stack([np.cos(angle), np.sin(angle)])
    rows[:, 2:4] = stages.u_min
    references = np.stack([rows[k : k + horizon + 1] for k in range(steps)])
    what = "hand finger, 2 matched clothoids, two tendons with lag, tip on a circle"
    return _closed("tendons", what, scene, stages, prediction, references, stages.u_min)


def cart_pole(*, steps: int = 400) -> Case:
    """From hanging to upright; then the position's setpoint switches every two seconds, unannounced."""
    x = ca.SX.sym("x", 4)
    position, angle, speed, rate = ca.vertsplit(x)
    force, pole = ca.SX.sym("force"), ca.SX.sym("pole")
    cart, length, gravity = 1.0, 0.5, 9.81  # kg, m, m/s2
    sine, cosine = ca.sin(angle), ca.cos(angle)
    swing, mass = force + pole * sine * length * rate**2, cart + pole * sine**2
    turned = ((cart + pole) * gravity * sine - cosine * swing) / (mass * length)
    problem = ControlProblem(
        states=x,
        inputs=force,
        parameters=pole,
        nominal={"pole": 0.2},
        dynamics=[speed, rate, (swing - pole * gravity * sine * cosine) / mass, turned],
        cost={
            "position": (position, 1.0, 1.0),
            "upright": (ca.sin(angle / 2), 40.0, 40.0),
            "rates": (ca.vertcat(speed, rate), 0.1, 1.0),
            "force": (force, 0.01),
        },
        bounds={"force": (-12.0, 12.0), "x_0": (-0.5, 0.5)},
        stages=25,
        stage=0.04,
        substeps=2,
    )
    wanted = np.where(np.arange(steps) < 100, 0.0, 0.3 * (-1.0) ** (np.arange(steps) // 50))
    references = np.zeros((steps, 26, 5))
    references[:, :, 0] = wanted[:, None]
    return _other("cart_pole", "cart-pole, swing-up and steps", problem, [0.0, np.pi - 0.1, 0.0, 0.0], references)


def two_links(*, steps: int = 400) -> Case:
    """The tip on a circle that a wall cuts, which is announced."""
    q, qd, torque, payload = ca.SX.sym("q", 2), ca.SX.sym("qd", 2), ca.SX.sym("torque", 2), ca.SX.sym("payload")
    l1, l2, m1, m2, rotor, damping = 0.05, 0.04, 0.03, 0.02, 5e-5, 1e-3  # m, kg, kg m2, N m s
    a, b = q[0], q[0] + q[1]
    tip = ca.vertcat(l1 * ca.cos(a) + l2 * ca.cos(b), l1 * ca.sin(a) + l2 * ca.sin(b))
    middles = [0.5 * l1 * ca.vertcat(ca.cos(a), ca.sin(a)), tip - 0.5 * l2 * ca.vertcat(ca.cos(b), ca.sin(b))]
    bodies = [(m1, middles[0]), (m2, middles[1]), (payload, tip)]
    turning = (m1 * l1**2 * qd[0] ** 2 + m2 * l2**2 * (qd[0] + qd[1]) ** 2) / 24 + 0.5 * rotor * ca.sumsqr(qd)
    kinetic = turning + sum(0.5 * m * ca.sumsqr(ca.jtimes(r, q, qd)) for m, r in bodies)
    potential = sum(9.81 * m * r[1] for m, r in bodies)
    momentum = ca.gradient(kinetic, qd)
    known = torque - damping * qd - ca.gradient(potential, q) + ca.gradient(kinetic, q) - ca.jtimes(momentum, q, qd)
    problem = ControlProblem(
        states=ca.vertcat(q, qd),
        inputs=torque,
        parameters=payload,
        nominal={"payload": 0.04},
        dynamics=ca.vertcat(qd, ca.solve(ca.jacobian(momentum, qd), known)),
        cost={"tip": (tip, 1e4, 1e3), "qd": (qd, 1e-3), "torque": (torque, 10.0)},
        bounds={"torque_0": (-0.08, 0.08), "torque_1": (-0.05, 0.05), "q_1": (0.05, 2.5)},
        rows={"wall": (tip[0], -ca.inf, 0.075)},
        stages=30,
        stage=0.01,
        substeps=2,
    )
    phase = 0.04 * (np.arange(steps)[:, None] + np.arange(31))
    references = np.zeros((steps, 31, 6))
    references[:, :, 0], references[:, :, 1] = 0.06 + 0.02 * np.cos(phase), 0.02 + 0.02 * np.sin(phase)
    return _other("two_links", "two rigid links, tip on a circle cut by a wall", problem, [-0.6, 1.5, 0, 0], references)


def _other(name: str, what: str, problem: ControlProblem, x0: Any, references: Array) -> Case:
    """The loop of a model that is no continuum finger."""
    s = problem.stages
    heavier = np.tile(HEAVIER * s.p_nominal, (len(references), 1))
    return Case(name, what, None, s, np.array(x0, float), np.zeros(s.nu), s.p_nominal, heavier, references)


def _stages(scene: ControlScene) -> tuple[Stages, Prediction]:
    prediction = Prediction(scene)
    return stages_of(scene, prediction), prediction


def _closed(
    name: str,
    what: str,
    scene: ControlScene,
    stages: Stages,
    prediction: Prediction,
    references: Array,
    u0: Array,
) -> Case:
    """The loop of a problem: a stiffer plant that is pushed for a while, from rest."""
    start = prediction.at_rest(np.zeros(prediction.system.finger_model.n), u0)
    x0 = np.concatenate([start, u0 if stages.nx > len(start) else []])
    steps = len(references)
    plant_p = np.tile(stages.p_nominal, (steps, 1))
    names = [label.split(" ")[0] for label in stages.p_names]
    plant_p[:, names.index("bending_stiffness")] *= MISMATCH
    for push, size in (("contact_1_y", 0.05), ("missing_tip_moment", 0.02)):
        if push in names:
            plant_p[PULSE, names.index(push)] = size
    return Case(name, what, scene, stages, x0, u0, stages.p_nominal, plant_p, references)
