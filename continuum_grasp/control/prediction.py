"""The model of a controller: states, inputs, parameters that change at run time, and the state at the start."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, NumericalError, check_arguments
from continuum_grasp.model import Contacts, FingerModel, Motor, Remade, System, Winch
from continuum_grasp.scene import (
    FAMILIES,
    Actuation,
    CommandedScene,
    ForceLoad,
    Initial,
    LengthDrive,
    MomentLoad,
    MotorDrive,
    Scene,
)
from continuum_grasp.simulation import initial_state

_OFFSET = "tip_offset [m]"
"""Parameter that is the error of the measured tip across its path."""
_LAG = "drive_time_constant"
"""Parameter that is the time constant of the drive."""

SLACK_STIFFNESS = 3e-3
"""Share of their stiffness that tendons keep while winches let them go [1]. Without any, no derivative says that
winding up bends the finger, and it stays where it is, with pretension too where a plan lets it go: of eight plants of
``configs/mpc/winches.yaml`` four stayed 94 mm off. With a third, 1 mm of slack takes 0.4 s in place of 0.2 s. A cable
of 20 N/mm that is 1 mm slack seems to push by 0.06 N."""


def _lets_go(drive: LengthDrive | MotorDrive) -> bool:
    """Whether no tendon of a drive may pull: one pulley pulls one tendon or the other, unless both have slack."""
    return drive.arrangement != "one_pulley" or drive.slack > 0.0


class DriveState(NamedTuple):
    """A state of the model by which a drive follows its commands.

    A bending moment, a tension or a pressure that follows the inputs late, a length, or the angle of a motor.
    """

    state: int  # index in x
    arms: tuple[float, ...]  # of what follows the inputs: amount per input (nu); else zero
    most: float  # greatest magnitude that can be reached
    lag: float  # time constant [s]
    rate: tuple[int, ...]  # index of its rate in x; none of a pressure, whose lag is of first order


class Prediction(Remade):
    """The model of a controller or of a plan, from its scene.

    Attributes
    ----------
    system : System
        Finger and, where the scene has one, object.
    x_names, u_names, p_names : tuple of str
        Name and unit of each entry.
    p_nominal : tuple of float
        Nominal parameters: those that the scene names, then known forces (zero), then the missing tip moment (zero).

    Notes
    -----
    x is the system's state; for a finger without tendons whose input lags, tip moment and its rate follow its q and qd.
    u is the command: the tip moment, tensions, or the inputs of winches and motors, one entry per drive. All
    functions take (x, u, p).
    """

    @check_arguments
    def __init__(self, scene: CommandedScene) -> None:
        self.scene = scene
        finger, fidelity = scene.predicted_finger, scene.fidelity
        self._couple = "tip_moment" in scene.disturbances
        self._offset = "tip_offset" in scene.disturbances
        tip_force = bool(scene.contacts) or "tip_force" in scene.disturbances
        moved = "object_position" in scene.disturbances
        stations = (*(f"{k + 1}" for k in range(len(scene.contacts))), "tip")
        friction = map(Contacts.friction_parameter, stations) if "contact_friction" in scene.disturbances else ()
        self._own_lag = scene.lag if "tip_moment" in finger.input_keys else None
        matches_tip = FAMILIES[scene.model_family].matches_tip
        system = System(
            finger,
            surroundings=scene.surroundings,
            object_parameters=(*(("object_x", "object_y") if moved else ()), *friction),
            contacts=scene.contacts,
            gravity=scene.gravity,
            family=scene.model_family,
            elements=fidelity.elements,
            bending_range=fidelity.bending_range,
            accuracy=fidelity.accuracy,
            slack_stiffness=SLACK_STIFFNESS * any(map(_lets_go, finger.winches)),
            # The lag of a tip moment is not in the system.
            parameters=[name for name in scene.model_parameters if self._own_lag is None or name != _LAG],
            loads=[MomentLoad(at=finger.rod.length, moment=0.0)] if self._couple else [],
            tip_force=tip_force,
            input_rates=(matches_tip and self._own_lag is not None) or None,
        )
        reached = scene.reached(system.finger_model.ranges)
        self.system = system = system if reached is None else system.reaching(reached)
        lag_names = ["tip_moment [N m]", "tip_moment_rate [N m/s]"] if self._own_lag is not None else []
        self.x_names = (*system.x_names, *lag_names)
        self.u_names = tuple(system.u_names[: len(scene.input_limits[0])])
        extra = {"missing_tip_moment [N m]": 0.0} if self._couple else {}
        if self._offset:
            extra[_OFFSET] = 0.0
        if self._own_lag is not None and _LAG in scene.model_parameters:
            extra[f"{_LAG} [s]"] = self._own_lag
        self.p_names = (*system.p_names, *system.w_names, *extra)
        self.p_nominal = (*system.p_nominal, *[0.0] * system.nw, *extra.values())
        self.nx, self.nu, self.np = len(self.x_names), len(self.u_names), len(self.p_names)
        self.x, self.u, self.p = (_symbols(names) for names in (self.x_names, self.u_names, self.p_names))

    @property
    def driven(self) -> tuple[DriveState, ...]:
        """States of the drives: moments, tensions where tendons have friction, and positions of winches and motors."""
        driven = (
            r"(tip_)?moment(_\d+)? \[N m\]|tension_\d+ \[N\]|length_\d+ \[m\]|motor_angle_\d+ \[rad\]|"
            r"pressure_\d+ \[Pa\]"
        )
        # Those of lags come first; of winches there are no others before them.
        states = [k for k, name in enumerate(self.x_names) if re.fullmatch(driven, name)]
        winches = self.system.finger_model.structure.winches
        limits = self.scene.input_limits
        drives = [(arms, lag) for arms, lag in _drives(self.scene) if lag is not None]
        drive_states = [
            DriveState(
                state,
                arms,
                self.scene.greatest_sum(arms, *limits),
                lag,
                (state + 1,) if "_rate [" in "".join(self.x_names[state + 1 : state + 2]) else (),
            )
            for state, (arms, lag) in zip(states, drives, strict=False)
        ]
        wound = zip(winches, states[len(drives) :], strict=True)
        return (*(self._wound(k, winch, state) for k, (winch, state) in enumerate(wound)), *drive_states)

    def _wound(self, number: int, winch: Winch, state: int) -> DriveState:
        """Position of a winch: commanded, or as far as a motor turns when it bends the finger over its range."""
        least, greatest = self.scene.input_limits
        follows = tuple(float(k == number) for k in range(self.nu)) if np.isinf(winch.drive.limit) else ()
        reach = max(-least[number], greatest[number])
        if isinstance(winch, Motor) and not follows:
            finger = self.scene.finger
            bend = sum(self.system.finger_model.ranges)
            paths = [finger.tendon_list[k].greatest_offset * bend for k in winch.tendons]
            elongation = winch.drive.torque_max / (winch.radius * float(winch.stiffness))
            reach = (max(paths) + elongation + abs(float(winch.start))) / winch.radius
        return DriveState(state, follows or (0.0,) * self.nu, reach, winch.time_constant, (state + 1,))

    # -- what the system takes ----------------------------------------------------------------------------------------

    @cached_property
    def _moment(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Acting tip moment, its rate and acceleration, where the lag is not in the system."""
        time = self.p[-1] if f"{_LAG} [s]" in self.p_names else self._own_lag or 1.0
        moment, rate = self.x[-2], self.x[-1]
        # A critically damped lag, as of tendons: its moment has a continuous rate, which a matched tip needs.
        return moment, rate, (self.u - moment) / time**2 - 2.0 * rate / time

    @cached_property
    def arguments(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Arguments x, u, w and p of the system."""
        system = self.system
        couple = [self.p[system.np + system.nw]] if self._couple else []
        values = [self.u] if self._own_lag is None else [*self._moment]
        # The missing tip moment is constant over the horizon: it adds to the input and not to its derivatives, which
        # the system takes as far as its inputs have rates.
        blocks = [ca.vertcat(v, *[c if k == 0 else 0.0 for c in couple]) for k, v in enumerate(values)]
        u = ca.vertcat(*blocks)[: system.nu]
        return self.x[: system.nx], u, self.p[system.np : system.np + system.nw], self.p[: system.np]

    @property
    def _of_system(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The function without w, on which shapes do not depend."""
        x, u, _, p = self.arguments
        return x, u, p

    def _function(self, name: str, **outputs: ca.SX) -> ca.Function:
        values = ca.cse([ca.densify(ca.SX(v)) for v in outputs.values()])
        return ca.Function(name, [self.x, self.u, self.p], values, ["x", "u", "p"], list(outputs))

    # -- functions ----------------------------------------------------------------------------------------------------

    @cached_property
    def dynamics(self) -> ca.Function:
        """Time derivative of x."""
        return self._function("dynamics", xd=self.rates(self.system.forward_dynamics(*self.arguments)))

    def rates(self, of_system: ca.SX) -> ca.SX:
        """Time derivative of x from the derivative of the system's part of it."""
        return ca.vertcat(of_system, *([] if self._own_lag is None else self._moment[1:]))

    @cached_property
    def tip(self) -> ca.Function:
        """World position of the tip, r (2) [m], as a camera sees it that is off by the parameter ``tip_offset``."""
        tip = self.system.tip(*self._of_system)
        if self._offset:
            # The path of a finger that bends evenly by phi is normal to 2/3 phi: a moment at the tip of a straight beam
            # moves it by L phi / 2 aside and L phi^2 / 6 back. At 1.5 rad, 0.01 rad are left.
            across = self.scene.finger.base.angle + ca.sum1(self.system.bending(*self._of_system)) * (2.0 / 3.0)
            tip += self.p[self.p_names.index(_OFFSET)] * ca.vertcat(-ca.sin(across), ca.cos(across))
        return self._function("tip", r=tip)

    def sections(self, at: tuple[float, ...]) -> ca.Function:
        """World positions r (2, K) [m] and angles (K) [rad] of the sections at positions along the finger [m]."""
        r, angle = self.system.sections(at)(*self._of_system)
        return self._function("sections", r=r, angle=angle)

    @cached_property
    def bending(self) -> ca.Function:
        """Bending angle of each element [rad]."""
        return self._function("bending", bend=self.system.bending(*self._of_system))

    @cached_property
    def bending_rate(self) -> ca.Function:
        """Rate of the bending angle of each element [rad/s]."""
        bend = self.system.bending(*self._of_system)
        return self._function("bending_rate", rate=ca.jtimes(bend, self.x, self.dynamics(self.x, self.u, self.p)))

    @cached_property
    def curvature(self) -> ca.Function:
        """Curvature at the nodes of clothoids, or of each arc [1/m]."""
        return self._function("curvature", kappa=self.system.curvature(*self._of_system))

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Places where the finger may touch the object."""
        return tuple(name for name in self.system.touch_names if name.startswith("finger."))

    @cached_property
    def contact_force(self) -> ca.Function:
        """Normal force at each place where the finger may touch the object, known forces included [N]."""
        touch = self.system.touch(*self.arguments)
        known = self.arguments[2]
        forces = [touch[1][k] for k in range(len(self.contact_names))]
        if known.numel():
            # A force known at the same place stands for contact too: its part along the object's outward normal adds.
            forces = [f + ca.dot(touch[6][:, k], known[2 * k : 2 * k + 2]) for k, f in enumerate(forces)]
        return self._function("contact_force", f=ca.vertcat(*forces))

    @cached_property
    def gap(self) -> ca.Function:
        """Distance of each place where the finger may touch the object from its surface [m], negative if pressed in."""
        return self._function("gap", gap=self.system.touch(*self.arguments)[0][: len(self.contact_names)])

    @cached_property
    def tensions(self) -> ca.Function:
        """Tension of each tendon at its drive [N], of fingers with tendon friction or winches."""
        x, _, p = self._of_system
        finger = self.system.finger_model
        tensions = finger.tensions()(x[: finger.nx], ca.SX.zeros(finger.nu), p[: finger.np])[0]
        return self._function("tensions", tensions=tensions)

    @property
    def servo_torques(self) -> ca.SX:
        """Torques that position servos ask for, as shares of what their motors have; none without such servos [1]."""
        shares: list[ca.SX] = []
        drives = self.scene.finger.winches
        for k, (drive, at) in enumerate(zip(drives, self.driven, strict=False)):
            if isinstance(drive, MotorDrive) and drive.position_gain is not None:
                angle = self.x[at.state]
                rate = self.x[at.state + 1]
                asked = drive.position_gain * (self.u[k] - angle) - drive.rate_gain * rate
                shares.append(asked / drive.torque_max)
        return ca.vertcat(ca.SX(0, 1), *shares)

    # -- states -------------------------------------------------------------------------------------------------------

    def at_rest(
        self, q: ArrayLike, u: ArrayLike, friction: ArrayLike | None = None, *, pulled: float | None = None
    ) -> Array:
        """Build the state at rest with coordinates q (n) and drives settled at the input u (nu).

        ``friction`` has the state of each friction cell of the tendons; by default zero, as of one that never
        slid. ``pulled``: winches not where u leaves them, but where (the first of) their tendons have this tension [N].
        """
        shape, inputs = np.asarray(q, dtype=float), np.asarray(u, dtype=float)
        lag_states = [] if self._own_lag is None else [inputs[0], 0.0]
        # The system's inputs may go on with their rates and a missing moment, both zero.
        padded = np.zeros(self.system.nu)
        padded[: inputs.size] = inputs
        state = self.system.state(q=shape.tolist(), u=padded.tolist(), friction=friction, pulled=pulled)
        return np.array([*state, *lag_states])

    def shapes(self, count: int | None = None) -> Array:
        """Sample coordinates (count, n) of the straight finger and of shapes within half the bending range; all by
        default.
        """
        return self.system.finger_model.sample_shapes()[:count]

    def first_state(self) -> Array:
        """Compute the state (nx) of the scene's initial pose at rest, under the scene's ``rest_input``.

        Coordinates and friction states of ``initial`` belong to the plant's model. They are used where the controller's
        model has as many; otherwise the state is at the unloaded shape, and tendons have not slid.
        ``SolverError`` where an initial equilibrium is not found.
        """
        initial, finger = self.scene.initial, self.system.finger_model
        coordinates, cells = initial.q, initial.friction_states
        if coordinates is not None and len(coordinates) != finger.n:
            initial = initial.replaced(pose="rest", q=None, qd=None)
        if cells is not None and len(cells) != len(finger.friction_names):
            initial = initial.without_history
        return self.start_state(initial, self.scene.rest_input)

    def start_state(self, initial: Initial, u: Sequence[float], loads: Sequence[ForceLoad] = ()) -> Array:
        """Compute the state (nx) of an initial pose under an input (nu) and loads.

        Errors are as in ``initial_state``.
        """
        finger = self.system.finger_model
        scene = self.scene
        # Equilibria are of the finger alone, as in simulated scenes.
        alone = Scene(
            finger=scene.finger,
            gravity=scene.gravity,
            contacts=scene.contacts,
            fidelity=scene.fidelity,
            actuation=Actuation.of(scene.finger.input_keys, u),
            initial=initial,
            loads=tuple(loads),
        )
        rest_model = FingerModel(
            alone,
            family=finger.family,
            elements=finger.lengths,
            accuracy=finger.structure.accuracy,
            input_rates=False,  # nothing moves
        )
        start = initial_state(alone, rest_model)
        x = self.at_rest(start[: finger.n], u, start[rest_model.nx - len(rest_model.friction_names) :])
        x[finger.n : 2 * finger.n] = start[finger.n : 2 * finger.n]
        return x

    def eigenvalues(self, u_min: Array, u_max: Array, p: Array | None = None) -> Array:
        """Find the eigenvalues of the linearized motion [1/s], over inputs (nu) within their limits.

        With the nominal parameters, or others p (np).

        Taken over shapes within half the bending range, at rest and, under quadratic damping, springing back, with all
        contacts closed where there is an object, and with tendons that stick and that slide; ``NumericalError`` where
        the model's numbers are not finite.
        """
        symbols = [self.x, self.u, self.p]
        touch_law = self.system.touch_law
        if touch_law is None:
            jacobian = ca.jacobian(self.dynamics(*symbols), self.x)
        else:
            # As if every contact were pressed, wherever the finger is: open contacts are not stiff, and their damping,
            # which sets the fastest rate, grows with the force.
            gap = self.system.touch(*self.arguments)[0]
            pressed = gap + (touch_law.rounding + self.system.greatest_press / touch_law.law.stiffness)
            jacobian = self.system.pressed_linearization(*self.arguments, pressed)
        linearized = ca.Function("jacobian", symbols, [jacobian])
        n = self.system.n
        of_system = ca.Function("of_system", symbols, [*self._of_system])
        # The seed is fixed: the number of steps follows, and with it the generated C, which must repeat.
        rng = np.random.default_rng(0)
        eigenvalues = [np.zeros(1) if self.scene.lag is None else np.array([-1.0 / self.scene.lag])]
        finger, greatest_tension = (
            self.system.finger_model,
            max((tendon.max_tension for tendon in self.scene.finger.tendon_list), default=0.0),
        )
        cells = len(finger.friction_names)
        parameters = np.array(self.p_nominal) if p is None else p
        for shape in self.shapes():
            u = rng.uniform(u_min, u_max)
            pull = rng.uniform(0.0, greatest_tension) if finger.structure.winches else None
            for friction in finger.structure.stiffest_friction:
                # Winches are not where u leaves them, by which tendons would be far too tight in most of the shapes.
                x = self.at_rest(shape, u, np.full(cells, friction), pulled=pull)
                x[n : 2 * n] = self.system.rates_sprung_back(
                    *(np.array(v).ravel() for v in of_system(x, u, parameters))
                )
                a = np.array(linearized(x, u, parameters))
                if not np.all(np.isfinite(a)):
                    raise NumericalError("the linearized motion is not finite", state=shape)
                eigenvalues.append(np.linalg.eigvals(a))
        return np.concatenate(eigenvalues).astype(complex)

    def fastest_rate(self, u_min: Array, u_max: Array, p: Array | None = None) -> float:
        """Largest absolute value of the `eigenvalues` [1/s]."""
        return float(np.abs(self.eigenvalues(u_min, u_max, p)).max())


def _symbols(names: Sequence[str]) -> ca.SX:
    """A column of symbols of these names."""
    return ca.vertcat(ca.SX(0, 1), *map(ca.SX.sym, names))


def _drives(scene: CommandedScene) -> list[tuple[tuple[float, ...], float | None]]:
    """Arms and time constant [s] of each moment that the inputs exert, or of each tension or pressure."""
    finger = scene.finger
    inputs = len(finger.input_keys)
    if "tip_moment" in finger.input_keys:
        return [((1.0,), scene.lag)]
    drives = [(channel.arms, channel.time_constant) for channel in finger.channels if any(channel.arms)]
    if finger.has_tendon_friction or finger.winches:
        lags = [] if finger.winches else [tendon.time_constant for tendon in finger.tendon_list]
        lags += [chamber.time_constant for chamber in finger.chambers]
        drives = [(tuple(np.eye(inputs)[k - len(lags)].tolist()), lag) for k, lag in enumerate(lags)]
    return drives
