"""The errors that the package raises on purpose."""

from __future__ import annotations

import copyreg
from collections.abc import Sequence
from typing import Any


class ContinuumGraspError(Exception):
    """Base class of every error that the package raises on purpose."""


class InputError(ContinuumGraspError, ValueError):
    """An error in the user's input.

    Parameters
    ----------
    message : str
        The fault, the expected value, and the given one.
    file, line, column, key : optional
        Where: path of the file, position in it (from 1), dotted path of the key.
    """

    def __init__(
        self,
        message: str,
        *,
        file: str | None = None,
        line: int | None = None,
        column: int | None = None,
        key: str | None = None,
    ) -> None:
        self.message = message
        self.file = file
        self.line = line
        self.column = column
        self.key = key
        place = ":".join(str(part) for part in (file, line, column) if part is not None)
        super().__init__(": ".join(part for part in (place, key, message) if part))

    def at(self, key: str | None) -> InputError:
        """Return the error with another key."""
        return InputError(self.message, file=self.file, line=self.line, column=self.column, key=key)


class SolverError(ContinuumGraspError, RuntimeError):
    """A solver did not reach its goal.

    Parameters
    ----------
    message : str
        The failed task.
    status : str
        The typed status of the solver.
    violated : sequence of str
        The violated constraints by name, with their amounts.
    advice : str
        A likely cause and what to try.
    result : object, optional
        The point it reached, for inspection.
    """

    def __init__(
        self,
        message: str,
        *,
        status: str,
        violated: Sequence[str] = (),
        advice: str = "",
        result: Any = None,
    ) -> None:
        self.status = status
        self.violated = tuple(violated)
        self.advice = advice
        self.result = result
        parts = [f"{message} (status: {status})"]
        if self.violated:
            parts.append("violated: " + "; ".join(self.violated))
        if advice:
            parts.append(advice)
        super().__init__("\n".join(parts))

    def __reduce__(self) -> tuple[Any, ...]:  # an error that a worker cannot send breaks the whole pool
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class NumericalError(ContinuumGraspError, ArithmeticError):
    """A computation left the range in which its numbers are valid.

    Parameters
    ----------
    message : str
        The fault and a remedy.
    time : float, optional
        Model time of the error [s].
    state : array_like, optional
        The last finite state.
    result : object, optional
        The result so far.
    """

    def __init__(self, message: str, *, time: float | None = None, state: Any = None, result: Any = None) -> None:
        self.time = time
        self.state = state
        self.result = result
        super().__init__(message)
