"""A finger with one tendon on a motor, for detecting contact: its scene, and a chain of guides that is pushed."""

from __future__ import annotations

import math

import numpy as np

import continuum_grasp as cg
from continuum_grasp.closed_loop import PlantModel
from continuum_grasp.closed_loop.integration import ChainIntegration
from continuum_grasp.control import ContactDetector, DetectedContact
from tests.tendon_cases import CABLE, LENGTH, OFFSET, PASSIVE, ROD, STIFFNESS
from tests.truth.servo import ServoedChain
from tests.truth.tendon_motion import MovingFinger

RADIUS = 0.008
STEP, NOISE = 2.0 * math.pi / 16384, 2e-4
MOTOR = {
    "kind": "motor",
    "winch_radius": RADIUS,
    "inertia": 2e-6,
    "viscous_friction": 1e-5,
    "coulomb_friction": 2e-3,
    "torque_max": 0.4,
    "position_gain": 0.8,
    "rate_gain": 2.5e-3,
}
EXACT = {"bending_stiffness": 0.0, "tendon_friction": 0.0, "coulomb_friction": 0.0, "tension": 0.0}


def scene(
    friction=0.1, measured=None, detection=None, drive=None, input_limits=None, period=0.005, **estimator
) -> cg.ControlScene:
    return cg.ControlScene(
        finger={
            **PASSIVE,
            "tendons": [{**CABLE, "friction": friction, "drive": drive or MOTOR}],
        },
        gravity=(0.0, 0.0),
        fidelity={"family": "clothoid", "elements": 2},
        controller={
            "horizon": {"stages": 10, "stage": period},
            "cost": {"tip_angle": {"running": 1.0}, "effort": 0.1},
            "input": {"angles": (-1.5, 1.5)} if input_limits is None else input_limits,
        },
        reference={"tip_angle": 0.0},
        initial={"pose": "straight"},
        estimator={
            "measured": measured or {"angle": STEP / math.sqrt(12.0), "torque": NOISE},
            "contact_detection": detection or {},
            **estimator,
        },
    )


def plant(
    friction, *, stiffness=1.0, dry=1.0, payload=0.0, pushed=None, hinges=20, time_step=5e-4, **motor
) -> ServoedChain:
    """A chain of guides on its motor, other than the detector knows it by factors and a payload [kg]."""
    chain = MovingFinger(
        LENGTH,
        STIFFNESS * stiffness,
        OFFSET,
        friction,
        sides=(1.0,),
        hinges=hinges,
        time_step=time_step,
        tip_mass=0.002 + payload,
        pushed=pushed,
    )
    return ServoedChain(chain, 0.0, dry=2e-3 * dry, **motor)


def trial(
    found: ContactDetector, driven: ServoedChain, *, back=False, speed=0.0, jump=0.0, at=0.8, seed=0
) -> list[tuple[float, float, DetectedContact]]:
    """Instants, forces and reports of a finger that is bent, ``back`` a little, and pushed from ``at`` [s] on with
    ``speed`` [N/s], after a ``jump`` [N].
    """
    rng, step = np.random.default_rng(seed), driven.chain.time_step
    found.reset()
    rows = []
    over = 0.1 if back else 0.0
    for k in range(1, round(1.2 / step) + 1):
        t = k * step
        turned = (1.0 + over) * t / 0.4 if t < 0.4 else 1.0 + over * max(0.0, 1.0 - (t - 0.4) / 0.2)
        force = (jump + speed * (t - at)) if t > at else 0.0
        driven.advance(0.8 * turned, force)
        if k % round(found.period / step) == 0:
            rows.append((t, force, found.step(driven.readings(STEP, NOISE, rng))))
    return rows


PAIR = {**MOTOR, "pretension": 2.0}


def pair_scene(
    arrangement, friction=0.1, detection=None, *, payload=0.0, plant=None, loads=(), period=0.005, **factors
):
    """Two tendons on one pulley, or on a motor each, under gravity in the plane; ``factors`` on what is uncertain."""
    own = {name: factors.get(name, 1.0) for name in ("stiffness", "friction_factor", "dry")}
    drive = {**PAIR, "arrangement": arrangement, "coulomb_friction": 2e-3 * own["dry"]}
    given = scene(friction, detection=detection, period=period)
    return given.replaced(
        finger={
            **PASSIVE,
            "rod": {**ROD, "bending_stiffness": STIFFNESS * own["stiffness"]},
            "masses": [{"at": LENGTH, "mass": 0.002 + payload}],
            "tendons": {**CABLE, "friction": friction * own["friction_factor"], "drive": drive},
        },
        gravity=(0.0, -9.81),
        plant=plant or {},
        loads=tuple(loads),
    )


class PairPlant:
    """A chain of guides on its motors, which hold each command over a period; ``readings`` as sensors show them."""

    def __init__(self, arrangement, friction, **factors) -> None:
        given = pair_scene(arrangement, friction, plant={"guides": 16}, **factors)
        self.model = PlantModel(given)
        self.steps, self.x, self.period = ChainIntegration(self.model), self.model.start, given.controller.step
        names, self.time = self.model.system.x_names, 0.0
        self._angle = [k for k, name in enumerate(names) if name.startswith("motor_angle") and "rate" not in name]
        self._rate = [k + 1 for k in self._angle]
        self._torque = np.zeros(len(self._angle))

    def advance(self, bend) -> None:
        """A period; the antagonist's own motor pays out less than the other winds up."""
        u = np.array([bend, 0.15 - 0.7 * bend][: len(self._angle)])
        self.x = self.steps.advance(self.x, u, self.time, self.period, 8)[-1]
        self.time += self.period
        wanted = MOTOR["position_gain"] * (u - self.x[self._angle]) - MOTOR["rate_gain"] * self.x[self._rate]
        self._torque = np.clip(wanted, -MOTOR["torque_max"], MOTOR["torque_max"])

    def readings(self, rng) -> np.ndarray:
        """Angles by encoders [rad], torques [N m]."""
        noisy = self._torque + NOISE * rng.standard_normal(len(self._torque))
        return np.concatenate([STEP * np.round(self.x[self._angle] / STEP), noisy])


def wander(found: ContactDetector, plant: PairPlant, steps: int, rng) -> list[DetectedContact]:
    """Reports of a finger in random motion, that touches nothing."""
    found.reset()
    command, goal, speed, reports = 0.0, 0.0, 1.0, []
    for k in range(steps):
        if k % 80 == 0:  # every 0.4 s
            goal, speed = rng.uniform(-0.8, 0.8), rng.uniform(0.2, 2.0)
        command += float(np.clip(goal - command, -speed * plant.period, speed * plant.period))
        plant.advance(command)
        reports.append(found.step(plant.readings(rng)))
    return reports


def short_scene():
    """The scene with a controller of a short horizon."""
    horizon = {"stages": 4, "stage": 0.005}
    cost, limits = {"tip_angle": {"running": 1.0}, "effort": 0.1}, {"angles": (-1.5, 1.5)}
    return scene().replaced(controller={"horizon": horizon, "cost": cost, "input": limits})
