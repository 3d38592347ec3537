"""A scene with a tolerance becomes one with a model, chosen once and remembered."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import casadi as ca

from continuum_grasp import __version__
from continuum_grasp.accuracy.choose import choose_fidelity
from continuum_grasp.core.cache import private_folder
from continuum_grasp.scene.simulate import Fidelity, Initial, Scene, Timing

__all__ = ["resolve_fidelity"]


def resolve_fidelity(scene: Scene, *, vibrates: bool = False) -> tuple[Scene, str]:
    """The scene with what its tolerance asks for, and what was chosen and why.

    The choice is stored in the user's cache folder, by the content of the scene and of this package.

    Parameters
    ----------
    scene : Scene
    vibrates : bool
        Whether modes are asked for: the first two frequencies must meet the tolerance, whether the scene moves or not.

    Returns
    -------
    scene : Scene
        Without a tolerance; as it was where it had none.
    note : str
        What was chosen and why; empty where there was nothing to choose.

    Raises
    ------
    InputError, SolverError
        As ``choose_fidelity``.
    """
    if scene.fidelity.tolerance is None:
        return scene, ""
    asked = _swinging(scene) if vibrates else scene
    key = _key(asked)
    file = private_folder("choices") / f"{key}.json"
    known = _read(file, key)
    if known is None:
        from continuum_grasp.results import replacing

        chosen = choose_fidelity(asked)
        known = {"key": key, "fidelity": chosen.scene.fidelity.model_dump(mode="json"), "note": str(chosen)}
        with replacing(file) as temporary:
            temporary.touch(mode=0o600)
            temporary.write_text(json.dumps(known))
    fidelity = Fidelity.model_validate(known["fidelity"])
    return scene.model_copy(update={"fidelity": fidelity}), str(known["note"])


def _swinging(scene: Scene) -> Scene:
    """The scene as one whose modes matter, about its equilibrium where it does not move."""
    changed: dict[str, Any] = {"fidelity": scene.fidelity.model_copy(update={"frequencies": 2})}
    if scene.time is None:
        changed |= {"initial": Initial(pose="equilibrium"), "time": Timing(duration=1.0, step=0.01)}
    return scene.model_copy(update=changed)


def _read(file: Path, key: str) -> dict[str, Any] | None:
    """A record that is whole and about this very scene."""
    try:
        known = json.loads(file.read_text())
        Fidelity.model_validate(known["fidelity"])
        return known if known["key"] == key and isinstance(known["note"], str) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _key(scene: Scene) -> str:
    """Hash of everything that the choice depends on."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256(f"{__version__} {ca.CasadiMeta.version()}\n".encode())
    for folder in ("accuracy", "rod", "model", "simulation"):
        for file in sorted((package / folder).rglob("*.py")):
            digest.update(file.read_bytes())
    digest.update(scene.model_copy(update={"name": None}).model_dump_json().encode())
    return digest.hexdigest()
