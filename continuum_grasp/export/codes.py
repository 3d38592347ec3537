"""What the functions of a package return."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Code"]


class Code(IntEnum):
    """Zero: done; above: the output is good, with a warning; below: the output was not touched."""

    text: str

    def __new__(cls, value: int, text: str) -> Code:
        """A code with its explanation."""
        made = int.__new__(cls, value)
        made._value_ = value
        made.text = text
        return made

    OK = 0, "done"
    WARN_COARSE_STEP = 1, "done; the step is stable but too long to be accurate"
    WARN_LEFT_RANGE = 2, "done; the state (of a step: the next one) is out of range, and no step will take it"
    WARN_ITERATION_LIMIT = 3, "done; the command is of a new plan that was not solved to its tolerance"
    WARN_BOUND_LEFT = 4, "done; the command is of a new plan that leaves a soft bound"
    WARN_PREVIOUS_PLAN = 5, "no new plan; the command is of the last one"
    WARN_SAFE_RAMP = 6, "no plan; the command is on the way to the safe one"
    WARN_ESTIMATE_RESTARTED = 7, "the estimate was not finite or out of its range; the estimator started again"
    WARN_BEYOND_LIMIT = 8, "done; the command is on its way to a limit that it is beyond, as fast as its rate allows"
    ERR_NULL = -1, "a pointer is null"
    ERR_NON_FINITE = -2, "an input or a parameter is NaN or infinite"
    ERR_RANGE = -3, "an input or a parameter is out of its range"
    ERR_STEP = -4, "the step is not above zero or too long to be stable"
    ERR_RESULT = -5, "the result is not finite"
    ERR_ABI = -6, "what is passed was not initialised, or by another version of this library"
    ERR_CONFIGURATION = -7, "the library was made from another configuration than its caller was compiled for"
