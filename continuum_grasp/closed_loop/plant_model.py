"""A plant: a finger that differs from the controller's, its surroundings, and the drive between command and tendon.

Add-ons announce plants of their own; ``plant.guides`` takes one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError, addons, named_value
from continuum_grasp.closed_loop.plant_scene import plant_scene
from continuum_grasp.closed_loop.plant_steps import PlantIntegration, cheapest_steps
from continuum_grasp.control import Outputs, Prediction, Quantities
from continuum_grasp.model import Lag, Memory, Remade, System, column
from continuum_grasp.scene import (
    FAMILIES,
    ControlScene,
    Measured,
    Scene,
)
from continuum_grasp.simulation import Signals, initial_state

_LAG = "drive_time_constant"
"""Parameter that is the lag of commanded tensions."""


def _lag_of(control: ControlScene, plant: Scene) -> Array | None:
    """Lags of the tensions, or of the tip moment [s]; pressures of chambers are states of the system."""
    lags = [tendon.time_constant for tendon in plant.finger.tendon_list]
    if "tip_moment" in plant.finger.input_keys:
        lags = [control.plant.time_constant or control.controller.input.time_constant]
    known = [lag for lag in lags if lag is not None]
    return np.array(known) if known and len(known) == len(lags) else None


_SHAPES = 4
"""Number of shapes in the search for the fastest rate: each costs a linearization of the fine model on the virtual
machine."""


def _announced(name: str) -> type[PlantModel]:
    """Return the plant that an add-on announces; InputError if no such add-on is installed."""
    known = {key: place for addon in addons().values() for key, place in addon.plants.items()}
    if name not in known:
        raise InputError("no installed add-on provides this plant", key=f"plant.{name}")
    kind: type[PlantModel] = named_value(known[name])
    return kind


class PlantModel(Remade):
    """The plant as functions of its state x (nx), the command u (nu), forces w (nw) and parameters p.

    x has the system's state, then, where the drive lags, the tensions or the tip moment that it exerts, and their rates
    unless it is of first order. ``given`` is the plant's finger in its surroundings, where it differs from
    ``plant_scene``. Assign to ``p`` to change the ``parameters`` of finger and object without a new compilation;
    ``drive_time_constant`` of commanded tensions is the last one there. ``falls``: w has a last entry ``friction_fall
    [1]``, the share by which friction is below the parameter ``friction_factor``. ``outside`` adds entries of w by
    name, as functions of instants [s], to the scene's loads. Elements cover at least the bends ``reached`` (elements,)
    [rad].

    A scene with ``plant.guides`` takes the plant of an add-on.
    """

    system: System
    """Finger and object; plants of add-ons have another object with the same functions here."""
    INTEGRATION: ClassVar[str] = "continuum_grasp.closed_loop:Integration"
    """Integrator (plant or shared plants, name of the method), as ``module:name``."""
    FALL: ClassVar[str] = "friction_fall [1]"
    """Entry of w that reduces the friction of all contacts below ``friction_factor``, as a share of it."""
    WRENCH: ClassVar[tuple[str, ...]] = ("object_force_x [N]", "object_force_y [N]", "object_moment [N m]")
    """Entries of w of what pulls at an object that moves."""

    def __new__(cls, scene: ControlScene, *arguments: Any, **named: Any) -> Self:
        kind: type[Any] = cls if scene.plant.guides is None else _announced("guides")
        made: Self = super().__new__(kind, scene, *arguments, **named)
        return made

    def __init__(
        self,
        scene: ControlScene,
        given: Scene | None = None,
        parameters: Sequence[str] = (),
        object_parameters: Sequence[str] = (),
        falls: bool = False,
        reached: Sequence[float] | None = None,
    ) -> None:
        self._reached = reached
        self.control, self.scene = scene, self.plant_scene(scene) if given is None else given
        varies = given is None and scene.object_moves
        finger = self.scene.finger
        self._order = scene.plant_order
        self._lag = _lag_of(scene, self.scene)
        self._lags = 0 if self._lag is None else len(self._lag)
        varied_lag = _LAG in parameters and not finger.winches and self._lag is not None
        self.parameters = tuple(name for name in parameters if not (varied_lag and name == _LAG))
        self.finger_parameters = len(self.parameters)
        self.object_parameters = ("object_mass", "friction_factor") if varies else tuple(object_parameters)
        self.system = self._system()
        self.u_names = tuple(self.system.u_names[: len(finger.input_keys)])
        lagging = [Lag(self._order).names(name) for name in self.u_names[: self._lags]]
        self.x_names = (*self.system.x_names, *(name for names in zip(*lagging, strict=True) for name in names))
        self.w_names = (*self.system.w_names, *([self.FALL] if falls else []))
        self.nx = len(self.x_names)
        self.nu = len(self.u_names)
        self.nw = len(self.w_names)
        self._x = ca.SX.sym("x", self.nx)
        self._u = ca.SX.sym("u", self.nu)
        self._w = ca.SX.sym("w", self.nw)
        self._p = ca.SX.sym("p", self.system.np + varied_lag)
        self.command = self._u
        self.symbols = (self._x, self._u, self._w, self._p)
        # Arguments of the system's equations: its known loads, and the present parameters.
        self._loads = self._w[: self.system.nw]
        self._now = ca.SX(self._p[: self.system.np])
        if falls:
            self._now[self.finger_parameters + self.object_parameters.index("friction_factor")] *= 1.0 - self._w[-1]
        self.p: Array = np.array(self.system.p_nominal)
        if varies:
            # Run-time numbers, so that plants that differ in them share one compiled integrator.
            self.p[-2:] *= (scene.plant.object_mass, scene.plant.object_friction)
        # Arguments of the drive's equations: numbers, or the run-time argument.
        self._time: ca.DM | ca.SX = ca.DM() if self._lag is None else ca.DM(self._lag)
        if varied_lag and self._lag is not None:
            self.p = np.append(self.p, self._lag[0])
            self._time = self._p[-1]
        self.outside: dict[str, Callable[[Array], Array]] = {}
        self._integrations: dict[str, Any] = {}
        self._signals = Signals(self.scene, self.system.finger_model, nw=self.system.nw)

    def integration(self, method: str) -> Any:
        """The integrator of the plant by a method, made once."""
        if method not in self._integrations:
            self._integrations[method] = named_value(self.INTEGRATION)(self, method)
        return self._integrations[method]

    @staticmethod
    def plant_scene(scene: ControlScene) -> Scene:
        """Build the plant's finger in its surroundings, with the input at rest and the loads that the controller does
        not know.
        """
        return plant_scene(scene)

    @property
    def _unlagged(self) -> Scene:
        """The plant's scene without the lag, which is the plant's own: its sensors read every tension."""
        return self.scene.replaced(finger=self.scene.finger.with_tendons(time_constant=None, drive_order=2))

    def _system(self) -> System:
        """The finger in its surroundings, without the lag."""
        finger = self.scene.finger
        # A matched tip moves with its moment: without a lag of second order it would jump.
        jumps = self._lag is None or self._order == 1 or bool(finger.chambers)
        family = self.control.plant.fidelity.family or FAMILIES.default(free_tip=jumps or finger.moves_with_free_tip)
        return System(
            self._unlagged,
            family=family,
            input_rates=FAMILIES[family].matches_tip or None,
            parameters=self.parameters,
            object_parameters=self.object_parameters,
            reached=self._reached,
        )

    def __getstate__(self) -> tuple[Array, dict[str, Callable[[Array], Array]]]:
        return self.p.copy(), dict(self.outside)

    def __setstate__(self, state: tuple[Array, dict[str, Callable[[Array], Array]]]) -> None:
        self.p, self.outside = state

    # -- the drive ----------------------------------------------------------------------------------------------------

    @property
    def drive(self) -> ca.SX:
        """Tensions [N] or tip moment [N m] that the drive exerts; then the commanded pressures of chambers [Pa]."""
        lagging = ca.vertsplit(self._x)[self.system.nx : self.system.nx + self._lags]
        return ca.vertcat(ca.SX(0, 1), *lagging, *ca.vertsplit(self._u)[self._lags :])

    @cached_property
    def _drive_rates(self) -> ca.SX:
        """Return the rates of the drive's states: of its forces, and of their rates unless the drive is of first
        order.
        """
        if self._lag is None:
            return ca.SX(0, 1)
        states = ca.vertsplit(self._x[self.system.nx :], self._lags)
        return column(Lag.rates(states, self._u[: self._lags], self._time))

    @cached_property
    def acting(self) -> ca.SX:
        """Return the input of the system: the force of the drive, and its rate and acceleration if the system needs
        them.
        """
        return ca.vertcat(self.drive, self._drive_rates)[: self.system.nu]

    @property
    def named_states(self) -> dict[str, ca.SX]:
        """Entries of x by name; of a drive that lags also the moments that act, and their rates."""
        states = dict(zip(self.x_names, ca.vertsplit(self._x), strict=True))
        if self._lag is None:
            return states
        channels = [channel for channel in self.scene.finger.channels if channel.time_constant is not None]
        tensions = [channel.arms[: self._lags] for channel in channels if any(channel.arms[: self._lags])] or [(1.0,)]
        for k, of in enumerate(tensions):
            name = "tip_moment" if len(channels) < 2 else f"moment_{k + 1}"
            states[f"{name} [N m]"] = ca.mtimes(ca.DM(of).T, self.drive[: self._lags])
            states[f"{name}_rate [N m/s]"] = ca.mtimes(ca.DM(of).T, self._drive_rates[: self._lags])
        return states

    @cached_property
    def tensions(self) -> ca.SX:
        """Tension of each tendon at its drive [N]."""
        finger = self.system.finger_model
        if not finger.structure.own_tendons:
            return self.drive[: self.nu - len(self.scene.finger.chambers)]
        x, u, p = self._of_system
        return ca.SX(finger.tensions()(x[: finger.nx], u, p[: finger.np])[0])

    def friction_along(self, tendon: int, start: float, end: float) -> ca.SX:
        """Direction of friction on a tendon between two positions [m], on average: 1 where it slides to the base."""
        made = self.system.finger_model.structure
        names = self.named_states
        for number, cells in enumerate(made.cell_sets):
            if tendon not in cells.tendons:
                continue
            side = cells.sides[cells.tendons.index(tendon)]
            edges = np.cumsum([0.0, *(cell.length for cell in cells.cells)])
            shares = np.clip(np.minimum(edges[1:], end) - np.maximum(edges[:-1], start), 0.0, None)
            states = [names[name] for name in cells.names(number + 1)[-len(cells.cells) :]]
            mean: ca.SX = ca.dot(ca.DM(shares), ca.vertcat(*map(Memory.direction, states))) / max(shares.sum(), 1e-9)
            return side * mean
        return ca.SX(0.0)

    # -- functions ----------------------------------------------------------------------------------------------------

    def function(self, name: str, **outputs: ca.SX) -> ca.Function:
        """Make a function (x, u, w) of expressions of the plant, at the present values of ``p``."""
        values = ca.substitute([ca.densify(ca.SX(v)) for v in outputs.values()], [self._p], [ca.SX(ca.DM(self.p))])
        return ca.Function(name, [self._x, self._u, self._w], ca.cse(values), ["x", "u", "w"], list(outputs))

    def _of_all(self, name: str, **outputs: ca.SX) -> ca.Function:
        """Make a function (x, u, w, p) of expressions of the plant."""
        values = ca.cse([ca.densify(ca.SX(v)) for v in outputs.values()])
        return ca.Function(name, [*self.symbols], values, ["x", "u", "w", "p"], list(outputs))

    @property
    def _of_system(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        return self._x[: self.system.nx], self.acting, self._now

    @cached_property
    def _rate(self) -> ca.SX:
        x, u, p = self._of_system
        return ca.vertcat(self.elements.forward_dynamics(x, u, self._loads, p), self._drive_rates)

    @property
    def _bending_rate(self) -> ca.SX:
        """Return the rates of the states that angles along the finger depend on."""
        return self._rate

    @property
    def first_other(self) -> int:
        """Index of the first state after bends, their rates and the other states that integrators treat with them."""
        return 2 * self.system.n

    @property
    def elements(self) -> System:
        """System of a plant that has a differential equation; TypeError of others."""
        return self.system

    @cached_property
    def forward_dynamics(self) -> ca.Function:
        """State derivative."""
        return self._of_all("forward_dynamics", xd=self._rate)

    @cached_property
    def touching_dynamics(self) -> ca.Function:
        """Return the state derivative, and the force of the finger on the object."""
        return self._of_all("touching_dynamics", xd=self._rate, exerted=self._exerted)

    def implicit(self, touching: bool = False) -> ca.Function:
        """``(x, u, w, p, part) -> k``, as `System.implicit` with the drive's own rates; of a ``touching`` system
        also the force of the finger on the object.
        """
        x, u, p = self._of_system
        part = ca.SX.sym("part")
        rates = ca.vertcat(self.elements.implicit()(x, u, self._loads, p, part), self._drive_rates)
        values = {"k": rates, **({"exerted": self._exerted} if touching else {})}
        names = ["x", "u", "w", "p", "part"]
        return ca.Function("implicit", [*self.symbols, part], ca.cse([*values.values()]), names, [*values])

    @property
    def _exerted(self) -> ca.SX:
        indices = [k for k, name in enumerate(self.system.touch_names) if name.startswith("finger.")]
        return self._wrench(
            self.touch["force"][:, indices], self.touch["point"][:, indices], self.touch["lift"][indices]
        )

    def _wrench(self, force: ca.SX, point: ca.SX, lift: ca.SX) -> ca.SX:
        """World force [N], moment about the object's center of mass [N m], and force out of the plane [N], of forces
        (2, C) at points (2, C) [m] and of those out of the plane (C).
        """
        if self.scene.object is None or not self.scene.object_moves:
            return ca.SX(4, 1)
        pose = self.object_pose
        along, across = self.scene.object.com
        c = ca.cos(pose[2])
        s = ca.sin(pose[2])
        arms = point - (pose[:2] + ca.vertcat(c * along - s * across, s * along + c * across))
        moments = arms[0, :] * force[1, :] - arms[1, :] * force[0, :]
        return ca.vertcat(ca.sum2(force), ca.sum2(moments), ca.sum1(ca.vec(lift)))

    @cached_property
    def linearization(self) -> ca.Function:
        """Jacobians of the state derivative with respect to state and input."""
        a, b = (ca.jacobian(self._rate, v) for v in (self._x, self._u))
        return self._of_all("linearization", A=a, B=b)

    @cached_property
    def internal(self) -> ca.Function:
        """(x, u, p) -> mass matrix of the finger, its stiffness and its damping."""
        values = [ca.densify(e) for e in self.elements.internal(*self._of_system)]
        return ca.Function("internal", [self._x, self._u, self._p], values, ["x", "u", "p"], ["M", "K", "D"])

    @cached_property
    def tip(self) -> ca.SX:
        """World position of the tip (2) [m]."""
        return self.system.tip(*self._of_system)

    def sections(self, at: Sequence[float]) -> tuple[ca.SX, ca.SX]:
        """World positions (2, K) [m] and angles (K) [rad] of sections at positions along the finger [m]."""
        r, angle = self.system.sections(tuple(at))(*self._of_system)
        return r, angle

    def angle_rates(self, at: Sequence[float]) -> ca.SX:
        """Rates of the angles of sections [rad/s]."""
        return ca.jtimes(self.sections(at)[1], self._x, self._bending_rate)

    @cached_property
    def curvature(self) -> ca.SX:
        """Curvature at the nodes of clothoids, or of each arc [1/m]."""
        return self.system.curvature(*self._of_system)

    @cached_property
    def range_use(self) -> ca.SX:
        """Share of its bending range that each element uses."""
        return self.system.range_use(*self._of_system)

    @cached_property
    def touch(self) -> dict[str, ca.SX]:
        """All contacts, by the names of the outputs of ``System.touch``."""
        x, u, p = self._of_system
        return dict(zip(self.system.touch.name_out(), self.system.touch(x, u, self._loads, p), strict=True))

    def tracked(self, key: str, name: str) -> ca.SX:
        """An output of ``System.touch`` at the contacts that a term of the controller's cost follows, in its order."""
        contacts = self.control.controller.cost.tracked_contacts(key, self.control.contact_names)
        return self.touch[name][[self.system.touch_names.index(self._own_name(contact)) for contact in contacts]]

    @property
    def object_pose(self) -> ca.SX:
        """Return the pose of a moving object: x, y [m] and angle [rad], and its height [m] if it has one."""
        return self._x[self.system.object_states]

    def _own_name(self, name: str) -> str:
        """The name that a contact of the controller has here, where the finger may have more of them."""
        if name == "finger.tip":
            return name
        at = self.control.contacts[int(name.rpartition(".")[2]) - 1]
        nearest = int(np.argmin(np.abs(np.array(self.scene.contacts) - at)))
        return f"finger.{nearest + 1}"

    # -- values -------------------------------------------------------------------------------------------------------

    @cached_property
    def rest_input(self) -> Array:
        """Input at time zero: least tensions, or no moment."""
        inputs: Array = self._signals.u(0.0)[0][: self.nu]
        return inputs

    @cached_property
    def start(self) -> Array:
        """State at time zero (nx)."""
        return self.start_of(self.scene)

    def start_of(self, scene: Scene) -> Array:
        """State at time zero (nx) of a scene that differs from this plant's scene by values of parameters."""
        model = self.system.finger_model
        pose = list(scene.start_pose) or None
        drive_states = np.zeros(self.nx - self.system.nx)
        drive_states[: self._lags] = self.rest_input[: self._lags]
        return np.concatenate([self._begun(initial_state(scene, model), pose), drive_states])

    def _begun(self, finger: Array, pose: list[float] | None) -> Array:
        """State of the system at time zero, by the state of the finger alone and the pose of an object that moves."""
        return np.concatenate([finger, self.elements.state(pose=pose)[self.system.finger_model.nx :]])

    def forces(self, t: ArrayLike) -> Array:
        """Forces w (T, nw) at instants (T,) [s]."""
        known = self._signals.w(t)
        rows: Array = np.zeros((len(known), self.nw))
        rows[:, : known.shape[1]] = known
        instants = np.atleast_1d(np.asarray(t, dtype=float))
        for name, function in self.outside.items():
            rows[:, self.w_names.index(name)] += function(instants)
        return rows

    @property
    def steady(self) -> bool:
        """Whether no load varies."""
        return self._signals.constant and not self.outside

    # -- for controllers ----------------------------------------------------------------------------------------------

    def quantities(self, prediction: Prediction, u: Any, rate: Any) -> Quantities:
        """Quantities that cost terms and sensors are computed from; bending is per element of the controller's
        model.

        Commands and their rates are expressions, or (K, nu) over time.
        """
        finger = self.scene.finger
        # Where the controller's elements end, since the plant's are others.
        at = np.minimum(np.cumsum(prediction.system.finger_model.lengths), finger.rod.length).tolist()

        def by_element(values: ca.SX) -> ca.SX:
            whole = ca.vertcat(0.0, values)
            return whole[1:] - whole[:-1]

        return Quantities(
            length=finger.rod.length,
            tip=lambda: self.tip,
            sections=self.sections,
            object_pose=lambda: self.object_pose,
            bending=lambda: by_element(self.sections(at)[1] - finger.base.angle),
            bending_rate=lambda: by_element(self.angle_rates(at)),
            contact_force=lambda: self.tracked("contact_force", "normal_force"),
            gap=lambda: self.tracked("gap", "gap"),
            input=u,
            input_rate=rate,
        )

    def tracked_expression(self, prediction: Prediction, held: ca.SX, stage: float) -> ca.SX:
        """Tracked quantities (nr), from its x, u, w and p and the input before, ``held`` (nu).

        Terms of the input use the command; its rate is per ``stage`` [s], as the controller's.
        """
        cost = self.control.controller.cost
        quantities = self.quantities(prediction, self.command, (self.command - held) / stage)
        return ca.SX(ca.vertcat(*[term.value(quantities, cost) for term in Outputs.of(cost, prediction).terms]))

    def sensor_expressions(self, measured: Measured, prediction: Prediction) -> dict[str, dict[str, ca.SX]]:
        """Expression of each number that an estimator measures, by its name and unit, by sensor."""
        finger = self.scene.finger
        values = ca.vertsplit(self.tensions)
        names = [f"tension_{k + 1} [N]" for k in range(len(values))] if finger.winches else self.u_names[: len(values)]
        tensions = dict(zip(names, values, strict=True))
        motors = self.system.finger_model.structure.motors
        shape = self.quantities(prediction, self.command, None)
        return shape.sensed(measured, motors, self.named_states, self.command, tensions)

    def method_for(self, period: float) -> PlantIntegration:
        """Choose the cheapest stable steps."""
        return PlantIntegration(*self.steps_for(period))

    def steps_for(self, period: float) -> tuple[str, int, float]:
        """Method, steps per period and fastest rate; plants of add-ons have their own."""
        rate = self._fastest_rate()
        return *cheapest_steps(self.elements, rate, period), rate

    def _fastest_rate(self) -> float:
        """Greatest eigenvalue of the motion [1/s] about some shapes at rest, where the model's numbers are finite."""
        system = self.elements
        w = self.forces(0.0)[0]
        greatest = 0.0
        for q in system.finger_model.sample_shapes(self.start[: system.n])[:_SHAPES]:
            x = self.start.copy()
            x[: system.n] = q
            slope = np.array(self.linearization(x, self.rest_input, w, self.p)[0])
            if np.all(np.isfinite(slope)):
                greatest = max(greatest, float(np.abs(np.linalg.eigvals(slope)).max()))
        return greatest
