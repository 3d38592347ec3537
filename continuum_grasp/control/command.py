"""The command of a controller, with its status, plan and diagnosis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from continuum_grasp.base import Array, InputError, Summarized, split_unit
from continuum_grasp.control.estimation.adaptation import Adapted
from continuum_grasp.control.parts import ControlParts
from continuum_grasp.control.status import (
    Anomaly,
    CommandStatus,
    Health,
    OffsetCause,
    Sight,
    Trip,
    health_text,
    texts,
)

_HEALTH = tuple(Health)


class HorizonPlan(NamedTuple):
    """States (N + 1, nx) and inputs (N, nu) over the horizon."""

    x: Array
    u: Array


class StateEstimate(NamedTuple):
    """Estimate that the plan starts from: state of the prediction (nx), and parameters with the estimated disturbances
    (np).

    ``std`` (nz) and ``covariance`` (nz, nz) are of states and disturbances at the time of the measurement; None without
    an estimator.
    """

    x: Array
    p: Array
    std: Array | None = None
    covariance: Array | None = None


class ContactForces(NamedTuple):
    """Estimated normal forces at the possible contacts of finger and object, in the order of
    ``Prediction.contact_names``.

    ``force`` (C) [N] and its uncertainty: ``std`` (C) [N] and ``covariance`` (C, C) [N2], from the slope of the forces
    along states and disturbances and the covariance of these.
    """

    force: Array
    std: Array
    covariance: Array


class Times(NamedTuple):
    """Durations of the phases [s]."""

    estimate: float
    prepare: float
    feedback: float


class Command(Summarized):
    """The command of a controller for one period.

    Attributes
    ----------
    u : (nu,) ndarray
        Inputs to apply until the next command, of a finger tip moment [N m], tensions [N], or what its drives take;
        finite, within the rate limit, and within the limits of the input unless ``Anomaly.BEYOND_LIMIT`` reports that
        ``change`` moved one past the last command, or that ``reset`` was given an input beyond one.
    status : Status
        Origin of the command: a new plan, the previous one, or the safe ramp.
    health : Health
        Whether sensors, model and call rate agree, and the tip reaches a setpoint that stands; ``suspect`` names the
        part that does not, ``health_text`` explains it.
    """

    # Numbers stay in the memory of the C until they are read, so that a loop pays only for the numbers that it reads.
    __slots__ = ("_control", "_out", "_places", "health", "status", "u")

    def __init__(self, control: ControlParts, places: dict[str, slice], status: CommandStatus, out: Array) -> None:
        self._control, self._places, self._out = control, places, out
        self.status = status
        self.health = _HEALTH[int(self._number("health"))]
        self.u = self._part("u")

    def with_input(self, u: Array, status: CommandStatus | None = None) -> Command:
        """Return a copy with another input (nu), for example in the coordinates of a bench, and optionally another
        status.
        """
        out = self._out.copy()
        out[self._places["u"]] = u
        return Command(self._control, self._places, self.status if status is None else status, out)

    def headline(self) -> str:
        """Status and health of the command."""
        health = f"{self.health.name.lower()} ({self.suspect})" if self.health else ""
        return self.quoted(None, self.status.name.lower(), health)

    def pairs(self) -> dict[str, str]:
        """One line: command, iterations, time, anomalies."""
        rows = {
            "u": ", ".join(f"{value:.6g}" for value in self.u),
            "iterations": f"{self.iterations}",
            "time": f"{1e3 * sum(self.time):.3g} ms",
            "violation": f"{self.violation:.3g} of the scale of a soft constraint",
        }
        if self.violated:
            rows["violated"] = ", ".join(self.violated)
        rows |= {name: str(value) for name, value in self.adapted.items()}
        return {**rows, **({"anomalies": "; ".join(self.anomalies)} if self.anomaly else {})}

    def _part(self, name: str) -> Array:
        return self._out[self._places[name]]

    def _number(self, name: str) -> float:
        return float(self._out[self._places[name].start])

    @property
    def fallback(self) -> bool:
        """Whether there was no new plan."""
        return self.status.fallback

    @property
    def plan(self) -> HorizonPlan:
        """Last plan, of the first scenario if there are several; all zero without a plan."""
        x, u = self._part("plan_x"), self._part("plan_u")
        return HorizonPlan(x.reshape(-1, self._control.stages.nx), u.reshape(-1, self._control.stages.nu))

    @property
    def inputs(self) -> dict[str, float]:
        """The command by name of its entries."""
        return {
            split_unit(name).name: value
            for name, value in zip(self._control.stages.u_names, self.u.tolist(), strict=True)
        }

    def planned(self, name: str) -> Array:
        """Return the course of an input (N,), or of a state (N + 1,), in the last plan.

        ``InputError`` if neither has the name.
        """
        s = self._control.stages
        for values, labels in zip(self.plan[::-1], (s.u_names, s.x_names), strict=True):
            order = [split_unit(label).name for label in labels]
            if name in order:
                return values[:, order.index(name)]
        known = ", ".join(dict.fromkeys(split_unit(label).name for label in (*s.u_names, *s.x_names)))
        raise InputError(f"expected one of {known}, got {name!r:.60}", key="name")

    @property
    def gaps(self) -> dict[str, float]:
        """By how much the last plan is no motion of the model: by name of a state, the largest over the stages.

        A gap is the difference, in the unit of the state, between the end of a stage by the model, from the plan's
        state and input, and the plan's next state. Full steps close them as they converge. Computed when it is read,
        with the parameters of this step: as many evaluations of the model as there are stages.

        Examples
        --------
        >>> import casadi as ca
        >>> import continuum_grasp as cg
        >>> angle, torque = ca.SX.sym("angle [rad]"), ca.SX.sym("torque")
        >>> problem = cg.ControlProblem(
        ...     states=angle,
        ...     inputs=torque,
        ...     dynamics=torque - ca.sin(angle),
        ...     cost={"angle": (angle, 1.0), "torque": (torque, 1.0)},
        ...     stages=10,
        ...     stage=0.1,
        ... )
        >>> solver = cg.rti(problem)
        >>> bool(solver.step([0.8]).gaps["angle"] < 1e-6)
        True
        """
        s = self._control.stages
        plan = self.plan
        p = self._part("p")
        if s.scenarios is not None:  # the plan of the first
            p = s.scenarios.scale[0] * p + s.scenarios.shift[0]
        largest = np.abs(s.ends(plan.x[:-1], plan.u, p) - plan.x[1:]).max(axis=0).tolist()
        return {split_unit(name).name: value for name, value in zip(s.x_names, largest, strict=True)}

    @property
    def violated(self) -> dict[str, float]:
        """Rows that the plan violates: by name, the largest violation in shares of the row's scale."""
        excess = self._part("excess").tolist()
        return {name: value for name, value in zip(self._control.stages.c_names, excess, strict=True) if value > 0.0}

    @property
    def estimate(self) -> StateEstimate:
        """State and parameters."""
        x = self._part("x")[: self._control.stages.nd]
        p = self._part("p")
        then = self._part("then")
        if not then.size:
            return StateEstimate(x, p)
        root = self._part("upper").reshape(then.size, -1) * np.sqrt(np.maximum(self._part("diagonal"), 0.0))
        covariance = root @ root.T
        return StateEstimate(x, p, np.sqrt(np.diag(covariance)), covariance)

    @property
    def adapted(self) -> dict[str, Adapted]:
        """Parameters of ``estimator.adapt`` by name: value, standard deviation, and whether measurements tell it."""
        estimate = self.estimate
        filtered = self._control.estimation
        if filtered is None or estimate.std is None:
            return {}
        return {each.name: each.read(estimate.p, self._part("then"), estimate.std) for each in filtered.adapted}

    @property
    def contact_forces(self) -> ContactForces | None:
        """Normal forces on the object and how well they are known; None without an object or an estimator."""
        estimate = self.estimate
        filtered = self._control.estimation
        if filtered is None or filtered.contact_forces is None or estimate.covariance is None:
            return None
        # Disturbances are constant from the measurement on.
        z = np.concatenate([estimate.x, self._part("then")[estimate.x.size :]])
        force, slope = (np.array(value) for value in filtered.contact_forces(z, self.u, estimate.p))
        covariance = slope @ estimate.covariance @ slope.T
        return ContactForces(force.ravel(), np.sqrt(np.diag(covariance)), covariance)

    @property
    def time(self) -> Times:
        """Durations of the phases."""
        return Times(*(1e-9 * self._part("ticks")).tolist())

    @property
    def iterations(self) -> int:
        """Factorizations of the QPs of this call, in addition to the one of each preparation."""
        return int(self._number("iterations"))

    @property
    def violation(self) -> float:
        """Largest violation of a soft constraint, in shares of its scale."""
        return self._number("violation")

    @property
    def residual(self) -> float:
        """Largest residual of the optimality conditions, relative."""
        return self._number("residual")

    @property
    def cost(self) -> float:
        """Cost of the QP at its solution."""
        return self._number("cost")

    @property
    def suspect(self) -> str | None:
        """Quantity that contradicts the model most (tip, tension, bending or call rate), or the reading that is
        frozen, where the health or the trip is about it.
        """
        sensor, entry = int(self._number("sensor")), int(self._number("entry"))
        if entry >= 0 and (self.health == Health.FROZEN or self.trip == Trip.UNSEEN):
            return self._control.measurement_names[entry].split(" ")[0]
        names = self._control.watched
        return names[sensor] if self.health and 0 <= sensor < len(names) else None

    @property
    def trip(self) -> Trip:
        """Why the controller is tripped."""
        return Trip(int(self._number("reason")))

    @property
    def rung(self) -> int:
        """Number of times that the weight of the command's rate is raised fourfold: 0 to 3."""
        return int(self._number("rung"))

    @property
    def mismatch(self) -> float:
        """Mean squared normalized innovation of the sensor that contradicts the model most; about 1 if they agree."""
        return self._number("mismatch")

    @property
    def sight(self) -> Sight:
        """Worth of the estimate now; ``health`` may be of an earlier contradiction."""
        return Sight(int(self._number("sight")))

    @property
    def doubt(self) -> str:
        """Reason for doubt about the estimate, in words; empty without doubt."""
        if self.sight is Sight.SEES:
            return ""
        if self.sight is Sight.CONTRADICTED:
            return f"{self.suspect} contradicts the model"
        if Anomaly.BLIND in self.anomaly:
            return "nothing was measured"
        if self.trip:
            return f"the controller is tripped ({self.trip.name.lower()})"
        if self.health is Health.FROZEN:
            return "a reading is frozen"
        if self.status is CommandStatus.SAFE_RAMP:
            return "no plan was found for a whole horizon"
        return "no sensor shows the shape"

    @property
    def activity(self) -> float:
        """Mean squared change of the command, per that at its rate limit."""
        return self._number("activity")

    @property
    def health_text(self) -> str:
        """The health in words, with its likely cause; empty for OK."""
        return health_text(
            self.health,
            self.suspect,
            self.trip,
            int(self._number("ahead")),
            self.missed,
            self.offset,
            self.offset_cause,
        )

    @property
    def offset(self) -> float:
        """Distance between the measured tip and a constant setpoint that the loop had time to reach [m].

        It is a mean over five windows of the supervisor; 0 if the tip does not stay away.
        """
        return self._number("offset")

    @property
    def offset_cause(self) -> OffsetCause:
        """Why the tip stays away from its setpoint."""
        return OffsetCause(int(self._number("cause")))

    @property
    def anomaly(self) -> Anomaly:
        """Anomalies of this call."""
        return Anomaly(int(self._number("anomalies")))

    @property
    def anomalies(self) -> tuple[str, ...]:
        """Anomalies as text. An anomaly of a measurement starts with the measurement's name."""
        verdicts = self._part("verdict").tolist()
        return texts(int(self._number("anomalies")), verdicts, self._control.measurement_names, self.missed)

    @property
    def missed(self) -> float:
        """Number of calls missed before this one, by the clock of ``time``, possibly a fraction; 0 without a missed
        call.
        """
        return self._number("missed")

    @property
    def innovation(self) -> tuple[Array, Array]:
        """Measured minus expected of each compared quantity, taken one by one, and its variance (0: not compared)."""
        return self._part("innovation"), self._part("innovation_variance")
