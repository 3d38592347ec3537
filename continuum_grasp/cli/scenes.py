"""Reading the configuration that a verb needs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from continuum_grasp.errors import InputError

if TYPE_CHECKING:
    from continuum_grasp.cli.output import Output
    from continuum_grasp.scene.grasp import GraspScene
    from continuum_grasp.scene.simulate import Scene

__all__ = ["grasp_scene", "other_kind", "plain_scene", "simulation_scene"]


def simulation_scene(
    config: Path, changes: Iterable[str] | None, output: Output, *, vibrates: bool = False
) -> tuple[Scene, str]:
    """A scene for simulation, modes and code generation, its tolerance turned into a model; what was chosen and why.

    Raises
    ------
    InputError
        Where the file is wrong or of another kind.
    SolverError
        Where no model keeps the tolerance.
    """
    scene = plain_scene(config, changes)
    if scene.fidelity.tolerance is None:
        return scene, ""
    from continuum_grasp.accuracy.resolve import resolve_fidelity

    with output.busy("choosing the model"):
        scene, note = resolve_fidelity(scene, vibrates=vibrates)
    output.say(f"fidelity: {note}")
    return scene, note


def plain_scene(config: Path, changes: Iterable[str] | None) -> Scene:
    """A scene as it is written.

    Raises
    ------
    InputError
        Where the file is wrong or of another kind.
    """
    from continuum_grasp.scene.load import load
    from continuum_grasp.scene.simulate import Scene

    loaded = load(config, changes or ())
    if isinstance(loaded, Scene):
        return loaded
    raise other_kind(config, "a scene (finger, gravity, ...)", loaded)


def grasp_scene(config: Path, changes: Iterable[str] | None) -> GraspScene:
    """A scene for the grasp optimiser.

    Raises
    ------
    InputError
        Where the file is wrong or of another kind.
    """
    from continuum_grasp.scene.grasp import GraspScene
    from continuum_grasp.scene.load import load

    loaded = load(config, changes or ())
    if isinstance(loaded, GraspScene):
        return loaded
    raise other_kind(config, "a grasp (finger, object, ...)", loaded)


def other_kind(config: Path, wanted: str, loaded: object) -> InputError:
    """That a file is of another kind than a command takes, and which command takes it."""
    from continuum_grasp.scene.load import kind_of_scene

    got, command = _KINDS[kind_of_scene(loaded)]  # type: ignore[arg-type]
    advice = f" (continuum-grasp {command})" if command else ""
    return InputError(f"expected {wanted}, got {got}{advice}", file=str(config))


_KINDS = {
    "simulate": ("a scene without an object", "simulate"),
    "identify": ("an identification", "identify"),
    "grasp": ("a grasp", "grasp"),
    "mpc": ("a closed loop", "mpc"),
    "mission": ("a mission", "mpc"),
    "plan": ("a plan", "plan"),
    "sweep": ("a sweep", "sweep"),
    "finger": ("a finger alone", None),
}
"""What the kinds of configurations are, and the commands for them."""
