"""Controlled fingers for the tests of estimators and controllers, and plants that are integrated by scipy."""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from continuum_grasp.control import Prediction
from continuum_grasp.scene import ControlScene, Damping, Fidelity, Finger, Tendons
from continuum_grasp.scene import Rod as RodValue
from tests.tendon_cases import PASSIVE

ROD = Finger(
    rod=RodValue(length=0.6, linear_density=0.0203, bending_stiffness=0.0471, rotary_inertia=1e-8),
    damping=Damping(material=2e-4),
)
HAND = Finger(
    rod=RodValue(length=0.18, linear_density=0.034, bending_stiffness=6.11e-3, rotary_inertia=2.6e-7, diameter=0.0012),
    damping=Damping(material=3e-5),
    strain_limit=0.06,
    tendons=Tendons(offset=0.005, min_tension=1.0, max_tension=60.0, time_constant=0.02),
)


def rod_scene(**changes) -> ControlScene:
    """Two arcs under gravity with a tip moment; changes override."""
    given = {
        "finger": ROD,
        "gravity": (0.0, -9.81),
        "fidelity": Fidelity(family="arc", elements=2),
        "controller": {
            "horizon": {"stages": 15, "stage": 0.01},
            "cost": {"tip": {"running": 2e3, "terminal": 20.0}, "effort": 0.1},
            "input": {"moment_max": 0.3, "rate_max": 3.0},
        },
        "reference": {"tip": (0.3, 0.4)},
        "initial": {"pose": "straight"},
        "estimator": {"measured": {"tip": 1e-3}},
    }
    return ControlScene(**{**given, **changes})


SENSED = {"measured": {"tip": 1e-3, "bending": {"at": (0.3, 0.6), "std": 0.01}}}
UNKNOWN = {"tip_force": 0.1, "bending_stiffness": 0.1}


def sensed_rod_scene(estimator=None, **changes) -> ControlScene:
    """The rod with a camera and two angles, under an unknown tip force and with an uncertain stiffness."""
    asked = {**SENSED, "disturbances": UNKNOWN, **(estimator or {})}
    return rod_scene(parameters=("bending_stiffness",), estimator=asked, **changes)


BEND = 1.2
"""Of the whole rod at the setpoint of ``swing_scene`` [rad]."""
TARGET = (-0.6 * (1.0 - np.cos(BEND)) / BEND, 0.6 * np.sin(BEND) / BEND)


def swing_scene(rod=None, controller=None, **changes) -> ControlScene:
    """The rod in a horizontal plane; its tip is measured, and goes to the end of an arc."""
    asked = {
        "horizon": {"stages": 15, "stage": 0.01},
        "cost": {"tip": {"running": 2e4, "terminal": 200.0}, "effort": 0.01},
        "input": {"moment_max": 0.3, "rate_max": 3.0},
    }
    finger = ROD if rod is None else ROD.model_copy(update={"rod": ROD.rod.model_copy(update=rod)})
    given = {
        "finger": finger,
        "gravity": (0.0, 0.0),
        "controller": {**asked, **(controller or {})},
        "reference": {"tip": TARGET},
        "estimator": {"measured": {"tip": 1e-4}, "disturbances": {"tip_moment": 0.05}},
    }
    return rod_scene(**{**given, **changes})


def hand_scene(**changes) -> ControlScene:
    """Two clothoids with tendons that lag, in a horizontal plane; changes override."""
    given = {
        "finger": HAND,
        "gravity": (0.0, 0.0),
        "fidelity": Fidelity(family="matched_clothoid", elements=2),
        "controller": {
            "horizon": {"stages": 15, "stage": 0.01},
            "cost": {"tip": {"running": 2e5, "terminal": 2e3}, "effort": 0.01, "input_rate": 1e-4},
            "input": {"rate_max": 600.0},
        },
        "reference": {"tip": (-0.08, 0.12)},
        "estimator": {"measured": {"tip": 3e-4, "tension": 0.1}, "disturbances": {"tip_moment": 0.02}},
    }
    return ControlScene(**{**given, **changes})


ARCS_LOOP = {
    "finger": {
        **PASSIVE,
        "rod": {**PASSIVE["rod"], "diameter": 0.0012},
        "tendons": {"offset": 0.005, "min_tension": 1.0, "max_tension": 60.0, "time_constant": 0.02},
    },
    "gravity": (0.0, 0.0),
    "fidelity": {"family": "arc", "elements": 2},
    "controller": {
        "horizon": {"stages": 10, "stage": 0.01},
        "cost": {"tip": {"running": 2e4, "terminal": 2e3}, "speed": 0.02, "effort": 1e-3, "input_rate": 5e-5},
        "input": {"rate_max": 600.0},
    },
}
"""Keys of a closed loop of small models in a horizontal plane, but for a reference: two arcs on tendons that lag."""
ARCS_ESTIMATOR = {
    "measured": {"tip": 3e-4, "tension": 0.1, "bending": {"at": (0.09, 0.18), "std": 0.003}},
    "disturbances": {"tip_moment": 0.01},
    "acceleration_std": 1.0,
    "delay": 0.01,
}


class Reality:
    """The model of a scene as a plant, with parameters of its own, integrated by scipy."""

    def __init__(self, scene: ControlScene, x0, p=None) -> None:
        self.model = Prediction(scene)
        self.p = np.array(self.model.p_nominal if p is None else p, dtype=float)
        self.x = np.array(x0, dtype=float)
        self._rate = _buffered(self.model.dynamics)

    def advance(self, u, time: float) -> None:
        """Hold an input for a time."""
        found = solve_ivp(
            lambda t, x: self._rate(x, u, self.p), (0.0, time), self.x, method="LSODA", rtol=1e-9, atol=1e-11
        )
        self.x = found.y[:, -1]

    @property
    def tip(self):
        """World position of the tip."""
        return np.array(self.model.tip(self.x, np.zeros(self.model.nu), self.p)).ravel()


def _buffered(function: ca.Function):
    return lambda *given: np.array(function(*given)).ravel()


CABLE = {"offset": 0.005, "max_tension": 60.0, "friction": 0.15, "axial_stiffness": 1e4, "series_stiffness": 3.3e4}
_WINCH = {"kind": "length", "time_constant": 0.02, "rate_max": 0.1, "pretension": 2.0}
_MOTOR = {
    "kind": "motor",
    "winch_radius": 0.008,
    "inertia": 2e-6,
    "viscous_friction": 2e-4,
    "coulomb_friction": 2e-3,
    "presliding_angle": 0.01,
    "torque_max": 0.25,
    "pretension": 2.0,
}
_SERVO = {"position_gain": 2.0, "rate_gain": 0.01}
DRIVES = {
    "winches": (_WINCH, {"lengths": (-0.012, 0.012)}),
    "pulley": ({**_WINCH, "arrangement": "one_pulley"}, {"lengths": (-0.012, 0.012)}),
    "torques": (_MOTOR, {}),
    "servos": ({**_MOTOR, **_SERVO}, {"angles": (-1.0, 1.5)}),
    "servo": ({**_MOTOR, **_SERVO, "arrangement": "one_pulley"}, {"angles": (-1.5, 1.5)}),
    "geared": ({**_MOTOR, "arrangement": "one_pulley", "backlash": 0.02, "gear_stiffness": 20.0}, {}),
}
"""Drive of both tendons, and the limits of the input that a controller needs for it."""


def driven_scene(name, *, tendons=None, controller=None, **changes) -> ControlScene:
    """The hand finger whose tendons have friction and a drive; changes override."""
    drive, limits = DRIVES[name]
    asked = {
        "horizon": {"stages": 20, "stage": 0.01},
        "cost": {"tip": 2e4, "speed": 0.02, "input_rate": 1.0},
        "input": limits,
    }
    given = {
        "finger": HAND.replaced(tendons=Tendons(**{**CABLE, "drive": drive, **(tendons or {})})),
        "gravity": (0.0, 0.0),
        "fidelity": Fidelity(family="clothoid", elements=2),
        "controller": {**asked, **(controller or {})},
        "reference": {"tip": (-0.06, 0.16)},
    }
    return ControlScene(**{**given, **changes})
