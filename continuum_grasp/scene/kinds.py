"""The kinds of configurations: what they are called, and which class and command they have."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from continuum_grasp.errors import InputError

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
    """The model of a kind of configuration."""
    if kind not in KINDS:
        raise InputError(f"no such kind of configuration: expected one of {', '.join(KINDS)}, got {kind!r}")
    # A kind's module is loaded with its first file: a simulation needs none of those of control.
    module = import_module(f"continuum_grasp.scene.{KINDS[kind].module}")
    model: type[BaseModel] = getattr(module, KINDS[kind].model)
    return model
