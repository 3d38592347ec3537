"""The fixed-step integrators: one line each for whoever chooses, describes or bounds a step.

The steps themselves are expressions in ``core/integrators/NAME.py``.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Integrator:
    """Properties of a method that need no equations."""

    text: str
    order: int
    """Power of the step in the error of a smooth motion."""
    evaluations: int
    """Evaluations of the dynamics per step; for iterative methods the usual number."""
    stable: float | None = None
    """Greatest product of step and spectral radius at which it is stable; None: it is implicit, any step is stable."""
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


# rk4 is stable up to 2.83 where eigenvalues are imaginary (undamped) and up to 2.79 where they are real (overdamped);
# between them, at a damping ratio of 0.54, up to 2.62.
INTEGRATORS = {
    "rk4": Integrator("the classical explicit Runge-Kutta method", 4, 4, stable=2.7, differentiates=True),
    "rodas": Integrator("linearly implicit, L-stable, stiffly accurate", 4, 6),
    "implicit_midpoint": Integrator(
        "symplectic; the energy of undamped motions does not drift",
        2,
        5,
        symplectic=True,
        failure="Newton's method did not converge within a step",
    ),
    "extrapolated_euler": Integrator(
        "linearly implicit in the finger's own elasticity and damping alone, at linear cost with many elements",
        2,
        3,
        partial=True,
    ),
    "ros2": Integrator(
        "implicit in the finger's own elasticity and damping alone", 2, 2, partial=True, simulates=False
    ),
    "sdirk2": Integrator("diagonally implicit, L-stable", 2, 4, simulates=False, differentiates=True),
    "sdirk2_contact": Integrator(
        "as sdirk2, with a third Newton iteration for stiff contacts", 2, 6, simulates=False, differentiates=True
    ),
}
SIMULATION_METHODS = tuple(name for name, method in INTEGRATORS.items() if method.simulates)
CONTROL_METHODS = tuple(name for name, method in INTEGRATORS.items() if method.differentiates)
