"""Solver options that plans and grasps have in common."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.scene.value import Duration, Value

Method = Literal["ipopt", "sqp"]
"""Solvers of nonlinear problems: each is a file of `continuum_grasp.nlp` with that name."""


class SolverOptions(Value):
    """A solver of nonlinear problems, and what all its runs may spend."""

    method: Method = "ipopt"
    """ipopt: an interior-point method; sqp: sequential quadratic programming, for starts near a solution."""
    max_iterations: Annotated[int, Field(ge=1, le=100_000)]
    """Greatest number of iterations of one solver run."""
    max_total_iterations: Annotated[int, Field(ge=1, le=10_000_000)]
    """Iterations of the whole search: counted work, so that the result does not depend on how fast or busy
    the machine is."""
    time_limit: Duration = 3600.0
    """Emergency stop of the whole search by the clock [s]; the status is then ``stopped``, or ``feasible`` where
    there was a solution by then."""
