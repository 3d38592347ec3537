"""Kinds of configurations: those of the core, and those that add-ons announce."""

from __future__ import annotations

import os
from functools import cache
from typing import TYPE_CHECKING, Any

from continuum_grasp.base import ConfigurationKind, InputError, addons, command_line, named_value

if TYPE_CHECKING:
    from pydantic import BaseModel

_CORE = (
    ConfigurationKind(
        "simulate", "continuum_grasp.scene:Scene", "a scene", "finger, gravity", "simulate", without=("rod",)
    ),
    ConfigurationKind(
        # A simulation with an object has a contact law, a grasp never.
        *("grasp", "continuum_grasp.scene:GraspScene", "a grasp", "finger, object", "grasp"),
        required=("object",),
        without=("contact_law",),
    ),
    ConfigurationKind(
        *("mpc", "continuum_grasp.scene:ControlScene", "a closed loop", "finger, controller", "mpc"),
        required=("controller",),
    ),
    ConfigurationKind(
        "finger", "continuum_grasp.scene:Finger", "a finger alone", "rod", None, required=("rod",), without=("finger",)
    ),
)
DEFINITIONS = "definitions.json"
"""File beside the schemas of all kinds, with the definitions that they share."""


@cache
def kinds() -> dict[str, ConfigurationKind]:
    """Kinds of configurations by name, those of the core first."""
    known = {kind.name: kind for kind in _CORE}
    for name, addon in addons().items():
        for kind in addon.kinds:
            if kind.name in known:
                raise InputError(f"add-on {name!r}: there is a kind of configuration {kind.name!r} already")
            known[kind.name] = kind
    return known


def model_of(kind: str) -> type[BaseModel]:
    """Class of a kind's scenes, which is loaded with its first file."""
    if kind not in kinds():
        raise InputError(f"no such kind of configuration: expected one of {', '.join(kinds())}, got {kind!r}")
    model: type[BaseModel] = named_value(kinds()[kind].model)
    return model


def kind_of(data: Any) -> str:
    """Kind of a configuration by its keys: the one that requires most of those that are there.

    What no other kind recognizes is a scene for simulation.
    """
    keys = set(data) if isinstance(data, dict) else set()
    # Add-ons first: a plan or a sweep has keys of scenes of the core beside its own.
    fitting = [kind for kind in reversed(kinds().values()) if kind.recognizes(keys)]
    asked = [(len(kind.required) + 0.5 * bool(kind.marks), kind.name) for kind in fitting]
    return max(asked, key=lambda pair: pair[0])[1] if asked else "simulate"


def each_of(kind: type | tuple[type, ...]) -> tuple[type, ...]:
    return kind if isinstance(kind, tuple) else (kind,)


def other_kind(file: str | os.PathLike[str], wanted: type | tuple[type, ...], loaded: BaseModel) -> InputError:
    """The error that a file is of another kind than those wanted, and which command takes it."""
    names = [accepted.__name__ for accepted in each_of(wanted)]
    asked = [kind for kind in kinds().values() if _class_name(kind) in names]
    got = kinds()[kind_of_scene(loaded)]
    advice = f" ({command_line(got.command)})" if got.command else ""
    expected = " or ".join(kind.expected for kind in asked)
    return InputError(f"expected {expected}, got {got.words}{advice}", file=os.fspath(file))


def kind_of_scene(loaded: BaseModel) -> str:
    return next(name for name, kind in kinds().items() if _class_name(kind) == type(loaded).__name__)


def exported_by(given: Any) -> str:
    """Function by which exports take a scene, or its result, as a closed loop, as an add-on announces it.

    Empty where none does.
    """
    of = type(given).__name__
    return next((kind.loop for kind in kinds().values() if of in (_class_name(kind), kind.result)), "")


def _class_name(kind: ConfigurationKind) -> str:
    return kind.model.partition(":")[2]
