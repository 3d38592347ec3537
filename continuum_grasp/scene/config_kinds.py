"""Kinds of configurations: the core's, and kinds that add-ons announce."""

from __future__ import annotations

from functools import cache
from typing import Any

from continuum_grasp.base import ConfigurationKind, InputError, addons

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
        *("hand", "continuum_grasp.scene:HandScene", "a hand in space", "hand, object", "grasp"),
        required=("hand", "object"),
    ),
    ConfigurationKind(
        *("mpc", "continuum_grasp.scene:ControlScene", "a closed loop", "finger, controller", "mpc"),
        required=("controller",),
    ),
    ConfigurationKind(
        "finger", "continuum_grasp.scene:Finger", "a finger alone", "rod", None, required=("rod",), without=("finger",)
    ),
)


@cache
def kinds() -> dict[str, ConfigurationKind]:
    """Kinds of configurations by name, the core's first."""
    known = {kind.name: kind for kind in _CORE}
    for name, addon in addons().items():
        for kind in addon.kinds:
            if kind.name in known:
                raise InputError(f"add-on {name!r}: there is a kind of configuration {kind.name!r} already")
            known[kind.name] = kind
    return known


def kind_of(data: Any) -> ConfigurationKind:
    """Return the kind of a configuration: of the kinds that recognize its keys, the one that requires the most keys.

    A configuration that no kind recognizes is a scene for simulation.
    """
    keys = set(data) if isinstance(data, dict) else set()
    # Add-ons first: a plan or a sweep also has keys of scenes of the core.
    fitting = [kind for kind in reversed(kinds().values()) if kind.recognizes(keys)]
    return max(fitting, key=lambda kind: len(kind.required) + 0.5 * bool(kind.marks), default=kinds()["simulate"])
