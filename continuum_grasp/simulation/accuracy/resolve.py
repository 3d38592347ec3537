"""From a scene's tolerance to a model: what was chosen once is remembered, and nothing that measures models loaded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import casadi as ca

from continuum_grasp import __version__
from continuum_grasp.base import named_value
from continuum_grasp.core import Cache
from continuum_grasp.scene import Fidelity, Initial, Scene, Timing

_CHOOSER = "continuum_grasp.simulation.accuracy.choose:choose_fidelity"
"""Function `Scene` -> `Chosen`; loaded, with the exact rod that it measures by, where a choice is not yet known."""


def resolve_fidelity(scene: Scene, *, vibrates: bool = False) -> tuple[Scene, str]:
    """Return the scene with the fidelity that its tolerance requires, and a note on the choice and its reason.

    The choice is stored in the user's cache folder, by the content of the scene and of this package. ``vibrates``: the
    user wants modes, so the first two frequencies must meet the tolerance, whether the scene moves or not. The note is
    empty if nothing was left to choose. Errors are as in ``choose_fidelity``.
    """
    if scene.fidelity.tolerance is None:
        return scene, ""
    asked = scene
    if vibrates:
        changed: dict[str, Any] = {"fidelity": scene.fidelity.model_copy(update={"frequencies": 2})}
        # Frequencies count where a scene moves: one that does not swings about its equilibrium.
        if scene.time is None:
            changed |= {"initial": Initial(pose="equilibrium"), "time": Timing(duration=1.0, step=0.01)}
        asked = scene.model_copy(update=changed)

    def choose(work: Path) -> Path:
        chosen = named_value(_CHOOSER)(asked)
        written = work / "choice.json"
        written.write_text(json.dumps([chosen.scene.fidelity.model_dump(mode="json"), str(chosen)]), encoding="utf-8")
        written.chmod(0o600)
        return written

    maker = f"{__version__} {ca.CasadiMeta.version()}"
    # The code of what measures too: another version may find other errors. Not the name, which changes nothing.
    code = Cache.hash_of_code("rod", "model", "scene", "simulation")
    identity = "\n".join([maker, code, asked.model_copy(update={"name": None}).model_dump_json()])
    entry = Cache("choices", ".choice").entry(identity, choose, maker)
    known, note = json.loads(entry.read_text(encoding="utf-8"))
    return scene.model_copy(update={"fidelity": Fidelity.model_validate(known)}), str(note)
