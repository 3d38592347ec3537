"""Families of curvature, integrators and solvers by name: what a scene must know of each, and where its equations are.

Steps of integrators are expressions in ``core/integrators/NAME.py``, solvers are files of `continuum_grasp.nlp`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, WithJsonSchema
from pydantic_core import PydanticCustomError

from continuum_grasp.scene.value import Duration, Value


@dataclass(frozen=True)
class CurvatureFamily:
    """Properties of a curvature family that scenes use."""

    equations: str
    """Module and name of the subclass of ``model.family.Family``, imported when a model is built."""
    matches_tip: bool = False
    """Whether the curvature at the tip, its last coordinate, is not free but set by the moment balance there. The tip
    then moves with its moment, which must be continuous, and tendons have no friction."""
    one_turn: bool = False
    """Whether an element bends by ``ONE_TURN`` at most."""
    even: bool = False
    """Whether the curvature is the same all along an element."""


ONE_TURN = 6.3
"""Greatest bend of an element that is evaluated by quadrature [rad]: the table of node counts ends there."""


class Families(dict[str, CurvatureFamily]):
    """Families by name."""

    @staticmethod
    def default(*, free_tip: bool) -> str:
        """Name the default family of a model: the finest one that allows its tip moment.

        ``free_tip``: that moment may jump, or depends on the shape by tendon friction.
        """
        return "clothoid" if free_tip else "matched_clothoid"


FAMILIES = Families(
    arc=CurvatureFamily("continuum_grasp.model.arc:ArcFamily", even=True),
    clothoid=CurvatureFamily("continuum_grasp.model.moment_linear:MomentLinearFamily", one_turn=True),
    matched_clothoid=CurvatureFamily(
        "continuum_grasp.model.moment_linear:MomentLinearFamily", matches_tip=True, one_turn=True
    ),
)
"""All families by name, from coarse to fine; a new one is a line here."""


def _known(name: str) -> str:
    if name not in FAMILIES:
        *others, last = (repr(each) for each in FAMILIES)
        expected = f"{', '.join(others)} or {last}"
        raise PydanticCustomError("literal_error", "Input should be {expected}", {"expected": expected})
    return name


FamilyName = Annotated[str, AfterValidator(_known), WithJsonSchema({"enum": list(FAMILIES), "type": "string"})]
"""A name of ``FAMILIES``."""


@dataclass(frozen=True)
class Integrator:
    """Properties of a method that need no equations."""

    text: str
    order: int
    """Power of the step in the error of a smooth motion."""
    evaluations: int
    """Evaluations of the dynamics per step; for iterative methods the usual number."""
    stable: float | None = None
    """Greatest product of step and spectral radius for stability; None: the method is implicit, and any step is
    stable."""
    target: float = math.inf
    """Product of step and spectral radius for its steps: well below ``stable``; infinite for implicit methods."""
    partial: bool = False
    """Implicit in the finger's own elasticity and damping alone; all else, drives and contacts too, limits the step."""
    simulates: bool = True
    """Offered as ``time.method``; its file has ``step``."""
    differentiates: bool = False
    """Offered as ``horizon.method``; its file has ``differentiated_step``."""
    symplectic: bool = False
    """Preserves the symplectic form, and so the energy of a conservative motion within a bound."""
    failure: str = "the motion is not finite"
    """Cause where a step gives no finite state."""


# rk4 is stable up to 2.83 for imaginary eigenvalues (undamped) and up to 2.79 for real ones (overdamped);
# between them, at a damping ratio of 0.54, up to 2.62.
INTEGRATORS = {
    "rk4": Integrator("the classical explicit Runge-Kutta method", 4, 4, stable=2.7, target=1.0, differentiates=True),
    "rodas": Integrator("linearly implicit, L-stable, stiffly accurate", 4, 6),
    "implicit_midpoint": Integrator(
        "symplectic; the energy of undamped motions does not drift",
        2,
        5,
        symplectic=True,
        failure="Newton's method did not converge within a step",
    ),
    "extrapolated_euler": Integrator(
        "linearly implicit in the finger's elasticity and damping only, at linear cost with many elements",
        2,
        3,
        partial=True,
    ),
    "ros2": Integrator("implicit in the finger's elasticity and damping only", 2, 2, partial=True, simulates=False),
    "sdirk2": Integrator("diagonally implicit, L-stable", 2, 4, simulates=False, differentiates=True),
    "sdirk2_contact": Integrator(
        "as sdirk2, with a third Newton iteration for stiff contacts", 2, 6, simulates=False, differentiates=True
    ),
}


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
    """Emergency stop of the whole search by the clock [s]; the status is then ``stopped``, or ``feasible`` with a
    solution found until then."""
