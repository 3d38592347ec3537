"""Closed loops on which receding-horizon solvers are compared: problem, references, plant and what disturbs it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

import continuum_grasp as cg
from continuum_grasp.control.ocp.scene_problem import stages_of
from continuum_grasp.control.ocp.stages import Stages
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.scene.control import ControlScene

Array = NDArray[np.float64]

CONFIGS = Path(__file__).parents[1] / "configs"
FINER = 4
"""Runge-Kutta steps of the plant for one of the controller's model."""
MISMATCH = 1.03
"""Stiffness of the plant over that of the model."""
PULSE = slice(120, 126)
"""Control steps of a push that no solver knows of."""
NAMES = ("arcs", "jumps", "tendons", "lag")


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
        stages = self.stages
        x, u, p = ca.MX.sym("x", stages.nx), ca.MX.sym("u", stages.nu), ca.MX.sym("p", stages.np)
        count = FINER * stages.substeps
        following, advance = x, state_step(stages)
        for _ in range(count):
            following = advance(following, u, p, stages.stage / count)
        return ca.Function("plant", [x, u, p], [following], ["x", "u", "p"], ["xn"])

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


def case(name: str, *, steps: int = 400, seed: int = 0, horizon: int = 30, **changes: Any) -> Case:
    """One of ``NAMES``; ``changes`` as for its scene."""
    return {"arcs": arcs, "jumps": jumps, "tendons": tendons, "lag": lag}[name](
        steps=steps, seed=seed, horizon=horizon, **changes
    )


def arcs(
    *,
    steps: int = 400,
    seed: int = 0,
    horizon: int = 30,
    elements: int = 2,
    family: str = "arc",
    substeps: int | None = 1,
    bounds: str = "box",
    largest: float = 1.2,
    speed: float = 15.0,
    announced: bool = True,
) -> Case:
    """The problem of the trials: two arcs of nickel-titanium, tip moment, setpoints of bending that switch.

    Setpoints are drawn up to ``largest`` [rad]; ``announced`` ones are known over the horizon.
    ``bounds``: none, box (bending 1.5 rad and rates, as in the trials), or zones (box, and a half-plane that four
    sections of every element keep out of).
    """
    finger = cg.load(CONFIGS / "fingers" / "nitinol_60cm.yaml")
    scene = _scene(
        finger=finger,
        gravity=(0.0, -9.81),
        contacts=(0.3,) if elements % 2 == 0 else (),
        fidelity={"family": family, "elements": elements},
        controller={
            "horizon": {"stages": horizon, "stage": 0.01, "substeps": substeps},
            "cost": {
                "bending": {"running": 100.0, "terminal": 10.0},
                "effort": 1.0,
                "speed": {"running": 0.01, "terminal": 0.001},
            },
            "input": {"moment_max": 0.3, "time_constant": 0.02 if family == "matched_clothoid" else None},
            "bounds": _bounds(bounds, curvature=5.0, speed=speed),
        },
    )
    stages, prediction = _stages(scene)
    if family == "arc" and elements == 2 and bounds == "box":  # the second arc may be faster
        scale = np.array([1.0, 1.0, 1.0, 40.0 / speed])
        stages = replace(stages, c_min=-scale, c_max=scale)
    rng = np.random.default_rng(seed)
    targets = rng.uniform(-largest, largest, (steps // 50 + 1, 1)) * np.ones(elements) * 2.0 / elements
    rows = np.zeros((steps, stages.nr))
    rows[:, :elements] = np.repeat(targets, 50, axis=0)[:steps]
    known = np.vstack([rows, np.repeat(rows[-1:], horizon, axis=0)])
    ahead = [known[k : k + horizon + 1] if announced else known[k : k + 1] for k in range(steps)]
    references = np.stack([np.broadcast_to(r, (horizon + 1, stages.nr)) for r in ahead])
    what = f"NiTi rod, {elements} {family.replace('_', ' ')}s, tip moment"
    return _closed("arcs", what, scene, stages, prediction, references, np.zeros(1))


def jumps(*, steps: int = 400, seed: int = 0, horizon: int = 30) -> Case:
    """The same with setpoints that jump unannounced, so that rows are violated."""
    made = arcs(steps=steps, seed=seed, horizon=horizon, largest=1.0, announced=False)
    return replace(made, name="jumps", what=f"{made.what}; setpoints jump unannounced")


def lag(*, steps: int = 400, seed: int = 0, horizon: int = 30, elements: int = 2) -> Case:
    """The same rod of matched clothoids, whose tip moment follows with a lag."""
    made = arcs(
        steps=steps,
        seed=seed,
        horizon=horizon,
        elements=elements,
        family="matched_clothoid",
        substeps=None,
        largest=0.6,
        speed=40.0,
    )
    return replace(made, name="lag", what=f"{made.what} with lag")


def tendons(*, steps: int = 400, seed: int = 0, horizon: int = 30, elements: int = 2, zone: bool = False) -> Case:
    """The hand finger: two tendons with lag and rate limits, its tip on a circle."""
    del seed
    scene = cg.load(CONFIGS / "mpc" / "tip_circle.yaml")
    controller = scene.controller.model_dump()
    # The derivatives of sdirk2 leave out the last Newton correction, which other solvers are given.
    controller["horizon"] |= {"stages": horizon, "method": "rk4"}
    if zone:
        wall = {"type": "half_plane", "point": (-0.095, 0.0), "normal_angle": 0.0, "of": "backbone"}
        controller["bounds"]["keep_out"] = {"wall": wall}
    data = {**scene.model_dump(), "controller": controller, "parameters": ("bending_stiffness",)}
    data["fidelity"]["elements"] = elements
    scene = ControlScene.model_validate(data)
    stages, prediction = _stages(scene)
    circle = scene.reference.tip
    times = stages.stage * np.arange(steps + horizon + 1)
    angle = 2.0 * np.pi * circle.frequency * times + circle.phase
    rows = np.zeros((len(times), stages.nr))
    rows[:, 0] = circle.center[0] + circle.radius * np.cos(angle)
    rows[:, 1] = circle.center[1] + circle.radius * np.sin(angle)
    rows[:, 2:4] = stages.u_min
    references = np.stack([rows[k : k + horizon + 1] for k in range(steps)])
    what = f"hand finger, {elements} matched clothoids, two tendons with lag, tip on a circle"
    return _closed("tendons", what, scene, stages, prediction, references, stages.u_min)


def _scene(**data: Any) -> ControlScene:
    parameters = ("gravity", "bending_stiffness")
    return ControlScene.model_validate({"parameters": parameters, **data})


def _bounds(which: str, *, curvature: float, speed: float) -> dict[str, Any]:
    if which == "none":
        return {"curvature": None}
    found: dict[str, Any] = {"curvature": curvature, "speed": speed}
    if which == "zones":
        wall = {"type": "half_plane", "point": (0.0, -0.25), "normal_angle": np.pi / 2, "of": "backbone"}
        found["keep_out"] = {"floor": wall}
    return found


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
