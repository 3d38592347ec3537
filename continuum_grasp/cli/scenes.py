"""Reading the configuration that a verb needs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from continuum_grasp.cli.output import Output
    from continuum_grasp.scene.simulate import Scene

__all__ = ["simulation_scene"]


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
    from continuum_grasp.scene.load import scene_of
    from continuum_grasp.scene.simulate import Scene

    scene = scene_of(config, Scene, changes or ())
    if scene.fidelity.tolerance is None:
        return scene, ""
    from continuum_grasp.accuracy.resolve import resolve_fidelity

    with output.busy("choosing the model"):
        scene, note = resolve_fidelity(scene, vibrates=vibrates)
    output.say(f"fidelity: {note}")
    return scene, note
