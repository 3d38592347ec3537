"""Cases that are hard for a model of a finger, each with a truth that the model did not produce.

An attempt at a case says what came out, at which cost, and whether it can be believed. Scenes are of the paper's rod.
"""

from __future__ import annotations

import math
import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from continuum_grasp.base import InputError, NumericalError, SolverError
from continuum_grasp.scene import Scene
from tests.rods import NITINOL, force, rod_scene

RIGHT, REFUSED, WARNED, WRONG = "right", "refused", "warned", "WRONG"
PATIENCE = 900
"""Seconds after which an attempt counts as hanging."""


@dataclass(frozen=True)
class Found:
    """What an attempt found."""

    error: float
    """Against the truth, in the case's own measure."""
    steps: int
    """Steps of integration, or iterations."""
    said: tuple[str, ...] = ()
    """Warnings."""


@dataclass(frozen=True)
class Attempt:
    """A case for one family and method."""

    case: str
    family: str
    method: str
    run: Callable[[], Found]
    limit: float
    """Greatest error of a right answer."""
    expected: tuple[str, ...] = (RIGHT,)
    """Verdicts that are no surprise."""

    @property
    def name(self) -> str:
        """Case, family and method."""
        return ", ".join((self.case, self.family, self.method))


def judge(attempt: Attempt) -> tuple[float, int, str]:
    """Make an attempt; nothing that goes wrong in it gets out. Error, steps, and the verdict, by its first word."""
    error, steps = math.nan, 0
    try:
        with _patience(), warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found = attempt.run()
        error, steps = float(found.error), found.steps
        said = [*found.said, *(str(warning.message) for warning in caught)]
        verdict = _verdict(error, attempt.limit, said)
    except (InputError, NumericalError, SolverError) as refusal:
        verdict = f"{REFUSED}: {_first(str(refusal))}"
    except TimeoutError:
        verdict = f"{WRONG}: no answer in {PATIENCE} s"
    except Exception as failure:  # that there are none is what is being measured
        verdict = f"{WRONG}: {type(failure).__name__}: {_first(str(failure))}"
    return error, steps, verdict


def _verdict(error: float, limit: float, said: list[str]) -> str:
    if not math.isfinite(error):
        return f"{WRONG}: not a number"
    if said:
        return f"{WARNED}: {_first(said[0])}"
    return RIGHT if error <= limit else f"{WRONG}: error {error:.2g} over {limit:.2g}"


def _first(text: str, most: int = 150) -> str:
    line = text.partition("\n")[0]
    return line if len(line) <= most else line[: most - 3] + "..."


@contextmanager
def _patience() -> Iterator[None]:
    """Raise TimeoutError after a while."""

    def ring(number: int, frame: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


# Scenes.

FAMILIES = ("arc", "clothoid", "matched_clothoid")
LENGTH = NITINOL["length"]
STIFFNESS = 60e9 * math.pi * 0.002**4 / 64
MASS = 6450.0 * math.pi * 0.002**2 / 4 * LENGTH
GRAVITY = (0.0, -9.81)


def nitinol(
    family: str,
    elements: Any = 2,
    *,
    damping: float = 0.0,
    bending_range: float | None = None,
    finger: dict[str, Any] | None = None,
    **keys: Any,
) -> Scene:
    """A scene with the 0.6 m rod, by default without gravity; further keys as of ``rod_scene``."""
    body, fidelity = {"damping": {"material": damping}, **(finger or {})}, {"bending_range": bending_range}
    return rod_scene(NITINOL, family, elements, finger=body, fidelity=fidelity, **{"gravity": (0.0, 0.0), **keys})


def push(x: float, y: float) -> dict[str, Any]:
    """A dead force on the tip in the world's axes [N]."""
    return force(LENGTH, [x, y])


def coordinates(family: str, bends: tuple[float, ...], lengths: tuple[float, ...]) -> list[float]:
    """Coordinates of a shape by the bends of its elements [rad]; clothoids bend evenly from node to node."""
    if family == "arc":
        return list(bends)
    nodes = [bend / length for bend, length in zip(bends, lengths, strict=True)]
    return nodes if family == "matched_clothoid" else [*nodes, 0.0]
