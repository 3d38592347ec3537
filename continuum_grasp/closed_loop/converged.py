"""The same controller with every problem solved to convergence by IPOPT.

A real-time iteration is measured against it. It needs the state: an estimator is no part of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.closed_loop.run import run_closed_loop
from continuum_grasp.closed_loop.shooting import ShootingProblem
from continuum_grasp.control.command import Estimate, Plan
from continuum_grasp.control.ocp.stages import stages_of
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.status import Status
from continuum_grasp.errors import InputError
from continuum_grasp.model.remade import Remade
from continuum_grasp.nlp import Budget, Settings, new_solver
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.families import PAPER_FAMILY
from continuum_grasp.scene.simulate import Fidelity

__all__ = ["Converged", "compared", "on_arcs", "with_state"]

Array = NDArray[np.float64]

_SETTINGS = Settings(tolerance=1e-8, max_iterations=200, tuning={"ipopt": {"mu_strategy": "adaptive"}})
"""A period that takes more iterations counts as a failure."""


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


class Converged(Remade):
    """Nonlinear model predictive control without a time limit.

    Parameters
    ----------
    scene : ControlScene
        The scene; its estimator must be None.

    Attributes
    ----------
    stages : Stages
    prediction : Prediction
    period : float
        [s]

    Raises
    ------
    InputError
        If the scene has an estimator.
    """

    def __init__(self, scene: ControlScene) -> None:
        if scene.estimator is not None:
            raise InputError("NMPC to convergence is given the state: leave the estimator out", key="estimator")
        self.prediction = Prediction(scene)
        self.stages = stages_of(scene, self.prediction)
        self.period = scene.controller.step
        self._problem, self._solver = ShootingProblem(self.stages), new_solver(_SETTINGS)
        self._held = np.array([])
        self._last: tuple[Array, Array] | None = None
        self.failures = 0
        self.times: list[float] = []

    def __getstate__(self) -> tuple[Any, ...]:
        return self._held, self._last, self.failures, self.times.copy()

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self._held, self._last, self.failures, self.times = state

    @property
    def statistics(self) -> dict[str, Any]:
        """How often it was solved, how often not, and how long that took."""
        return {"steps": len(self.times), "failures": self.failures, "median_s": float(np.median(self.times or [0.0]))}

    def reset(self, state: ArrayLike | None = None, u: ArrayLike | None = None) -> None:
        """Forget the last plan; ``u`` (nu) is the input so far."""
        self._last = None
        self._held = np.array([]) if u is None else np.array(u, dtype=float)

    def step(self, measurement: ArrayLike, reference: ArrayLike, *, p: ArrayLike | None = None) -> _Command:
        """Solve for one command.

        Parameters
        ----------
        measurement : (nx,) array_like
            State of the prediction.
        reference : (N + 1, nr) array_like
            Setpoints of the nodes.
        p : (np,) array_like, optional
            Parameters; nominal where not given.

        Returns
        -------
        Command
            Where the solver did not converge, its status is ``ITERATION_LIMIT``, and the last iterate is applied within
            limits.
        """
        s, began = self.stages, perf_counter()
        state = np.asarray(measurement, dtype=float)
        held = self._held if self._held.size else np.clip(np.zeros(s.nu), s.u_min, s.u_max)
        x0 = np.concatenate([state, held[: s.nx - s.nd]])
        parameters = s.p_nominal if p is None else np.asarray(p, dtype=float)
        x, u = self._guess(x0, held)
        start = self._problem.start(x, u, x0, parameters, np.asarray(reference, dtype=float))
        found = self._solver.solve(self._problem.nlp, start, Budget())
        x, u, violation = self._problem.split(found.x)
        self._last = x, u
        self._held = np.clip(u[0], s.u_min, s.u_max)
        self.failures += not found.converged
        self.times.append(perf_counter() - began)
        return _Command(
            u=self._held,
            status=Status.SOLVED if found.converged else Status.ITERATION_LIMIT,
            plan=Plan(*self._last),
            estimate=Estimate(state, parameters, None),
            time=_Times(self.times[-1]),
            iterations=found.iterations,
            violation=violation,
        )

    def _guess(self, x0: Array, held: Array) -> tuple[Array, Array]:
        """The last plan, moved on by a period; at first the state as it is."""
        s = self.stages
        if self._last is None:
            return np.tile(x0, (s.stages + 1, 1)), np.tile(held, (s.stages, 1))
        x, u = self._last
        ahead = self.period / s.stage
        at = np.minimum(np.arange(s.stages + 1) + ahead, s.stages)
        moved = np.array([np.interp(at, np.arange(s.stages + 1), column) for column in x.T]).T
        return moved, u[np.minimum(at[:-1].astype(int), s.stages - 1)]


def on_arcs(scene: ControlScene) -> ControlScene:
    """The same scene with a controller that knows the paper's two arcs, or as many as there are contacts to part."""
    fidelity = Fidelity(family=PAPER_FAMILY, elements=max(2, len(scene.contacts) + 1))
    return scene.model_copy(update={"fidelity": fidelity})


def with_state(scene: ControlScene) -> ControlScene:
    """The same scene with a controller that is given its state instead of measurements."""
    return scene.model_copy(update={"estimator": None})


def compared(scene: ControlScene, progress: Callable[[float], None] | None = None) -> dict[str, ControlRun]:
    """Closed loops of other controllers.

    Parameters
    ----------
    scene : ControlScene
        The scene.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    dict of str to ControlRun
        ``two arcs``: the same problem on the paper's elements. Then, both given the state so that nothing but the
        solver differs, ``with the state`` and ``converged``.
    """
    tell = progress or (lambda share: None)

    def part(k: int) -> Callable[[float], None]:
        return lambda share: tell((k + share) / 3.0)

    known = with_state(scene)
    return {
        "two arcs": run_closed_loop(on_arcs(scene), progress=part(0)),
        "with the state": run_closed_loop(known, progress=part(1)),
        "converged": run_closed_loop(known, controller=Converged(known), progress=part(2)),
    }
