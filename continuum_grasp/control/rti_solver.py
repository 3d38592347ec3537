"""Real-time iterations for a problem of one's own: the controller's C around any model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError, check_arguments, split_unit
from continuum_grasp.control.arguments import named
from continuum_grasp.control.command import Command
from continuum_grasp.control.compiled_controller import CompiledController
from continuum_grasp.control.ocp.control_problem import ControlProblem
from continuum_grasp.control.ocp.setpoints import Setpoints
from continuum_grasp.control.parts import ControllerCalls, ControlParts


class RtiSolver(CompiledController):
    """Real-time iterations of a problem, compiled (M. Diehl et al., doi:10.1016/S0959-1524(02)00023-1).

    A step linearizes the problem at the last plan, shifted in time, solves one QP, and takes the full step. The C is
    the code of ``Controller``, with its statuses: where a state is not finite, an iteration fails or a command was
    late, the solver follows the last plan to its end, then ramps to the safe input. A command is finite and within the
    bounds of the inputs.

    Parameters
    ----------
    problem : ControlProblem
        The problem.
    period : float, optional
        Time from one step to the next [s], at most a stage; a stage by default.
    safe : mapping of str to float, optional
        Safe input used when there is no plan, by name. Defaults to the admissible input closest to zero.
    sqp_iterations, start_iterations : int
        Iterations per step from the last plan, and from a plan at rest without a last plan.
    start_calls : int
        Steps over which the latter are spread, the fewest in the first: no step takes them all.
    iterations : int
        Greatest number of factorizations per QP.
    precision : {"double", "float"}
        Floating-point type of the C.
    check_gaps : bool
        Whether to check that plans are motions of the model, as dynamics with contacts require: half a horizon
        apart, and where one costs more than four times as much as any before. A plan that fails is replaced, and
        reported as ``Anomaly.PLAN_GAPS``. A check takes as long as a linearization.
    deadline : float
        Duration of a step after which its command counts as late [s]; never by default.

    Attributes
    ----------
    stages : Stages
        The problem's functions and numbers.

    Raises
    ------
    InputError
        If an argument is out of range, or there is no C compiler.

    Examples
    --------
    >>> import casadi as ca
    >>> import continuum_grasp as cg
    >>> angle, rate, torque = (ca.SX.sym(name) for name in ("angle", "rate", "torque"))
    >>> problem = cg.ControlProblem(
    ...     states=[angle, rate],
    ...     inputs=torque,
    ...     dynamics=[rate, torque - ca.sin(angle)],
    ...     cost={"angle": (angle, 10.0, 1.0), "rate": (rate, 0.1), "torque": (torque, 0.1)},
    ...     bounds={"torque": (-0.5, 0.5), "rate": (-1.0, 1.0)},
    ...     stages=20,
    ...     stage=0.1,
    ... )
    >>> solver = cg.rti(problem)
    >>> command = solver.step({"angle": 0.8, "rate": 0.0}, {"angle": 0.2})
    >>> command.status.name, round(command.inputs["torque"], 3)
    ('SOLVED', -0.5)
    >>> command.planned("angle").shape
    (21,)
    """

    _what = "the solver"
    _called = MappingProxyType({"measurement": "x", "p": "parameters"})

    @check_arguments
    def __init__(
        self,
        problem: ControlProblem,
        *,
        period: float | None = None,
        safe: Mapping[str, float] | None = None,
        sqp_iterations: int = 1,
        start_iterations: int = 5,
        start_calls: int = 1,
        iterations: int = 60,
        precision: str = "double",
        check_gaps: bool = False,
        deadline: float = math.inf,
    ) -> None:
        self.problem = problem
        s = replace(problem.stages, checks_gaps=check_gaps)
        near_zero = np.clip(np.zeros(s.nu), s.u_min, s.u_max)
        self.safe = near_zero if safe is None else named("safe", safe, s.u_names, near_zero)
        if np.any(self.safe < s.u_min) or np.any(self.safe > s.u_max):
            raise InputError("expected inputs within their bounds", key="safe")
        counts = {"sqp_iterations": sqp_iterations, "start_iterations": start_iterations}
        counts |= {"start_calls": start_calls, "iterations": iterations}
        calls = ControllerCalls(
            s.stage if period is None else CheckedArgument("period", period).number(),
            self.safe,
            s.stages * s.stage,
            **{key: CheckedArgument(key, count).whole() for key, count in counts.items()},
        )
        if start_calls > start_iterations:
            raise InputError(
                f"expected start_iterations = {start_iterations} or less, got {start_calls}", key="start_calls"
            )
        self._compile(ControlParts.of_problem(s, calls), precision, deadline)
        keys, widths = zip(*problem.cost_names, strict=True)
        self.nominal_setpoints = Setpoints(s.r_names, [(width, None) for width in widths], keys)
        self.cost_terms = self.nominal_setpoints.parts
        self.reset()

    def headline(self) -> str:
        """Problem of the solver."""
        return self.problem.headline()

    def pairs(self) -> dict[str, str]:
        """Names of its vectors, and how its steps ended."""
        counts = ", ".join(f"{count} {name}" for name, count in self.statistics["status"].items() if count)
        return {**self.problem.pairs(), "steps": counts or "none"}

    def reset(
        self, u: ArrayLike | Mapping[str, float] | None = None, guess: Mapping[str, ArrayLike] | None = None
    ) -> None:
        """Start again, at time zero.

        Parameters
        ----------
        u : (nu,) array_like or mapping of str to float, optional
            Input before; by default the safe one.
        guess : mapping of str to array_like, optional
            Plan from which the next step iterates, as often as from the last one (``sqp_iterations``), in place of one
            at rest: by name of a state N + 1 numbers, of an input N, or one number for all of them. Omitted names are
            zero, of inputs the safe one.

        Raises
        ------
        InputError
            If something has another size or other names, or is not finite.
        """
        initial_input: ArrayLike = self.safe
        if isinstance(u, Mapping):
            initial_input = named("u", u, self.stages.u_names)
        elif u is not None:
            initial_input = u
        before = CheckedArgument("u", initial_input).vector(self.stages.nu)
        self._start(np.zeros(self.stages.nd), before)
        if guess is not None:
            self._c.give("cg_guess", *self._guessed(guess, before))

    def _guessed(self, guess: Mapping[str, ArrayLike], before: Array) -> tuple[Array, Array]:
        """States and inputs over the horizon, each stage after the other."""
        s = self.stages
        x = np.zeros((s.stages + 1, s.nx))
        u = np.tile(self.safe, (s.stages, 1))
        courses = {split_unit(name).name: x[:, k] for k, name in enumerate(s.x_names[: s.nd])}
        courses |= {split_unit(name).name: u[:, k] for k, name in enumerate(s.u_names)}
        for name, value in guess.items():
            if name not in courses:
                raise InputError(f"expected some of {', '.join(courses)}, got {name!r:.60}", key="guess")
            course = courses[name]
            values = np.full(course.size, value) if np.ndim(value) == 0 else value
            course[:] = CheckedArgument(f"guess.{name}", values).vector(course.size)
        x[:, s.nd :] = np.vstack([before, u])[:, : s.nx - s.nd]
        return x.ravel(), u.ravel()

    def step(
        self,
        x: ArrayLike | Mapping[str, float],
        reference: ArrayLike | Mapping[str, Any] | None = None,
        parameters: ArrayLike | Mapping[str, float] | None = None,
        *,
        applied: ArrayLike | Mapping[str, float] | None = None,
        late: bool | None = None,
    ) -> Command:
        """Compute the input for a state; call it once per period.

        Parameters
        ----------
        x : (nx,) array_like or mapping of str to float
            The state, in the order of the problem's states or by name.
        reference : mapping, (nr,) or (N + 1, nr) array_like, optional
            Setpoints of this step: by the names of the cost (numbers, a function of time, or a row per node from now
            on), or of all residuals in the order of ``stages.r_names``; by default as set by ``reference``, else
            zero.
        parameters : mapping of str to float or (np,) array_like, optional
            Parameters; nominal by default, and where a name is left out.
        applied : (nu,) array_like or mapping of str to float, optional
            Input that was applied since the last step; the last command by default.
        late : bool, optional
            Whether the last command was late; by the deadline by default.

        Returns
        -------
        Command
            ``u``, or by name ``inputs``; ``status``; ``plan``, or by name ``planned``, and its ``gaps``; ``violated``
            rows.

        Raises
        ------
        InputError
            If a shape or a name is wrong. Numbers that are not finite do not raise: they are anomalies of the command.
        """
        return self._advance(x, reference, parameters, applied, late, None)


rti = RtiSolver  # what users call; the class is named where its objects are taken
