"""A controller whose every problem is iterated to convergence.

A real-time iteration is measured against it. It needs the state: an estimator is no part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.arguments import check_arguments
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.closed_loop.run import run_closed_loop
from continuum_grasp.control.command import Estimate, Plan
from continuum_grasp.control.ocp.scene_problem import stages_of
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.rti.iteration import STATUS, RealTimeIteration
from continuum_grasp.control.status import Health, Status
from continuum_grasp.errors import SolverError
from continuum_grasp.model.remade import Remade
from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.families import PAPER_FAMILY
from continuum_grasp.scene.simulate import Fidelity

Array = NDArray[np.float64]

_ITERATIONS = 200
"""Linearizations of a period [1]; one that takes more counts as a failure."""

_CONVERGED = Consumer(
    "mpc --compare, NMPC to convergence",
    refused={
        "estimator": "NMPC to convergence is given the state: leave the estimator out",
        "controller.scenarios": "NMPC to convergence is for one plant: leave scenarios out",
    },
    unneeded={
        **dict.fromkeys(
            [
                f"controller.{key}"
                for key in ("iterations", "sqp_iterations", "start_calls", "start_iterations", "supervisor")
            ],
            "of the real-time iteration, in whose place every problem is solved to convergence",
        ),
        **dict.fromkeys(("plant.noise", "plant.seed", "plant.delay"), "the state is given exactly, and at once"),
        "name": "a title alone",
    },
)


class _Times(NamedTuple):
    total: float


@dataclass(frozen=True)
class _Command:
    u: Array
    status: Status
    plan: Plan
    estimate: Estimate
    time: _Times
    iterations: int
    violation: float
    anomalies: tuple[str, ...] = ()
    health: Health = Health.OK
    health_text: str = ""
    mismatch: float = 0.0
    activity: float = 0.0
    contact_forces: None = None
    adapted: Mapping[str, Any] = field(default_factory=dict)


class Converged(Remade):
    """Nonlinear model predictive control without a time limit, of a scene without an estimator."""

    estimated_names: tuple[str, ...] = ()
    _last: tuple[Array, Array] | None

    @check_arguments
    def __init__(self, scene: ControlScene) -> None:
        _CONVERGED.check(scene)
        self.prediction = Prediction(scene)
        self.stages = stages_of(scene, self.prediction)
        self.period = scene.controller.step
        self._iteration = RealTimeIteration(self.stages)
        self.failures = 0
        self.times: list[float] = []
        self.reset()

    def __getstate__(self) -> tuple[Any, ...]:
        return self._held, self._last, self.failures, self.times.copy()

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self._held, self._last, self.failures, self.times = state

    @property
    def statistics(self) -> dict[str, Any]:
        """Counts of solved and unsolved problems, and times."""
        return {"steps": len(self.times), "failures": self.failures, "median_s": float(np.median(self.times or [0.0]))}

    def reset(self, state: ArrayLike | None = None, u: ArrayLike | None = None) -> None:
        """Forget the last plan; ``u`` (nu) is the input so far, zero or the nearest bound by default."""
        s = self.stages
        self._last = None
        self._held = np.clip(np.zeros(s.nu), s.u_min, s.u_max) if u is None else np.array(u, dtype=float)

    def step(self, measurement: ArrayLike, reference: ArrayLike, *, p: ArrayLike | None = None) -> _Command:
        """Solve for one command from the state (nx), setpoints of the nodes (N + 1, nr) and parameters (np).

        Where the iterations do not settle, the status is ``ITERATION_LIMIT`` and the last plan is applied.
        """
        s, rti, began = self.stages, self._iteration, perf_counter()
        state = np.asarray(measurement, dtype=float)
        x0 = np.concatenate([state, self._held[: s.nx - s.nd]])
        parameters = s.p_nominal if p is None else np.asarray(p, dtype=float)
        # The last plan, moved on by a period; at first the state as it is.
        rti.reset(x0, self._held)
        if self._last is not None:
            for now, before in zip(rti.plan, self._last, strict=True):
                now[:] = before
            rti.shift(self.period / s.stage)
        try:
            found = rti.iterate(x0, reference, parameters, iterations=_ITERATIONS)
            settled, iterations, violation = STATUS[found.status] != "iteration limit", found.iterations, found.violation
        except SolverError:
            settled, iterations, violation = False, _ITERATIONS, np.inf
        x, u = (part.copy() for part in rti.plan)
        self._last = x, u
        self._held = np.clip(u[0], s.u_min, s.u_max)
        self.failures += not settled
        self.times.append(perf_counter() - began)
        return _Command(
            u=self._held,
            status=Status.SOLVED if settled else Status.ITERATION_LIMIT,
            plan=Plan(x, u),
            estimate=Estimate(state, parameters),
            time=_Times(self.times[-1]),
            iterations=iterations,
            violation=violation,
        )


def compared(scene: ControlScene, progress: Callable[[float], None] | None = None) -> dict[str, ControlRun]:
    """Run the closed loops of other controllers; ``progress`` is called with the share that is done.

    ``two arcs``: the same problem on the paper's elements, or as many as there are contacts to part. Then, both given
    the state so that nothing but the solver differs, ``with the state`` and ``converged``.
    """

    def part(k: int) -> Callable[[float], None]:
        return lambda share: progress((k + share) / 3.0) if progress else None

    arcs = Fidelity(family=PAPER_FAMILY, elements=max(2, len(scene.contacts) + 1))
    on_arcs, known = scene.model_copy(update={"fidelity": arcs}), scene.model_copy(update={"estimator": None})
    converged = Converged(known)  # first: what it refuses need not wait for two runs
    return {
        "two arcs": run_closed_loop(on_arcs, progress=part(0)),
        "with the state": run_closed_loop(known, progress=part(1)),
        "converged": run_closed_loop(known, controller=converged, progress=part(2)),
    }
