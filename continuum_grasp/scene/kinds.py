"""Kinds of configurations: how each is recognized, its class, and the verb that runs it."""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from continuum_grasp.base import InputError, command_line

if TYPE_CHECKING:
    from pydantic import BaseModel


class _Kind(NamedTuple):
    module: str
    model: str
    words: str
    keys: str
    """Some by which the kind is recognized."""
    command: str | None
    """Verb that runs the kind; None: a finger alone is not run."""

    @property
    def expected(self) -> str:
        """Expected kind of file, as errors name it."""
        return f"{self.words} ({self.keys}, ...)"


KINDS = {
    "simulate": _Kind("simulate", "Scene", "a scene", "finger, gravity", "simulate"),
    "identify": _Kind("identify", "IdentifyScene", "an identification", "finger, estimate", "identify"),
    "grasp": _Kind("grasp", "GraspScene", "a grasp", "finger, object", "grasp"),
    "mpc": _Kind("control", "ControlScene", "a closed loop", "finger, controller", "mpc"),
    "mission": _Kind("mission", "MissionScene", "a mission", "grasp, controller", "mpc"),
    "plan": _Kind("plan", "PlanScene", "a plan", "finger, goal", "plan"),
    "sweep": _Kind("sweep", "Sweep", "a sweep", "scene, vary", "sweep"),
    "design": _Kind("design", "Design", "a design", "scene, variables, minimize", "design"),
    "finger": _Kind("finger", "Finger", "a finger alone", "rod", None),
}
"""Kinds of configurations, by name."""
DEFINITIONS = "definitions.json"
"""File beside the schemas of all kinds, with the definitions that they share."""


def model_of(kind: str) -> type[BaseModel]:
    if kind not in KINDS:
        raise InputError(f"no such kind of configuration: expected one of {', '.join(KINDS)}, got {kind!r}")
    # A kind's module is loaded with its first file: a simulation needs none of those of control.
    module = import_module(f"continuum_grasp.scene.{KINDS[kind].module}")
    model: type[BaseModel] = getattr(module, KINDS[kind].model)
    return model


def kind_of(data: Any) -> str:
    """Kind of a configuration, as in `KINDS`, by its keys."""
    keys = set(data) if isinstance(data, dict) else set()
    marks = {
        "mission": {"controller", "grasp"} <= keys,
        "mpc": "controller" in keys,
        "plan": "goal" in keys,
        "design": {"variables", "minimize"} & keys,
        "sweep": {"scene", "vary", "sample"} & keys,
        # A simulation with an object has a contact law, a grasp never.
        "grasp": "object" in keys and "contact_law" not in keys,
        "identify": {"estimate", "data"} & keys,
        "finger": "rod" in keys and "finger" not in keys,
    }
    return next((kind for kind, there in marks.items() if there), "simulate")


def each_of(kind: type | tuple[type, ...]) -> tuple[type, ...]:
    return kind if isinstance(kind, tuple) else (kind,)


def other_kind(file: str | os.PathLike[str], wanted: type | tuple[type, ...], loaded: BaseModel) -> InputError:
    """The error that a file is of another kind than those wanted, and which command takes it."""
    names = [accepted.__name__ for accepted in each_of(wanted)]
    asked = [kind for kind in KINDS.values() if kind.model in names]
    got = KINDS[kind_of_scene(loaded)]
    advice = f" ({command_line(got.command)})" if got.command else ""
    expected = " or ".join(kind.expected for kind in asked)
    return InputError(f"expected {expected}, got {got.words}{advice}", file=os.fspath(file))


def kind_of_scene(loaded: BaseModel) -> str:
    return next(name for name, kind in KINDS.items() if kind.model == type(loaded).__name__)
