"""What is given to be exported: a model, a scene, or the path of its file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from continuum_grasp.errors import InputError
from continuum_grasp.export.reals import Real
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.load import scene_of
from continuum_grasp.scene.simulate import Scene

__all__ = ["Given", "Source", "source_of"]

Given = FingerModel | Scene | str | os.PathLike[str]


@dataclass(frozen=True)
class Source:
    """A model with what is known of where it comes from."""

    model: FingerModel
    title: str
    name: str
    """What the README says that it was made from."""
    step: float | None
    configuration: Mapping[str, Any] | None
    """The resolved scene as plain values."""


def source_of(given: Given, real: Real) -> Source:
    """The model to export.

    In single precision the series of arcs are cut where rounding would hide what is left, unless the scene says
    otherwise.

    Raises
    ------
    InputError
        If it is nothing that can be exported.
    SolverError
        If no model keeps the scene's tolerance.
    """
    if isinstance(given, FingerModel):
        return Source(given, "a continuum finger", "a FingerModel", None, None)
    if not isinstance(given, (Scene, str, os.PathLike)):
        raise InputError(f"expected a FingerModel, a Scene or the path of its file, got {given!r:.80}")
    scene = scene_of(given)
    if scene.fidelity.tolerance is not None:
        from continuum_grasp.fidelity.resolve import resolve_fidelity

        scene, _ = resolve_fidelity(scene)
    arcs = scene.fidelity.family == "arc"
    cut = real.epsilon / 4 if real.name == "float" and arcs and scene.fidelity.accuracy is None else None
    model = FingerModel(scene, accuracy=cut) if cut is not None else FingerModel(scene)
    title = " ".join(scene.name.split()) if scene.name else "a continuum finger"
    name = f"the scene '{title}'" if scene.name else "a scene without a name"
    step = scene.time.step if scene.time is not None else None
    return Source(model, title.replace("*/", ""), name, step, scene.model_dump(mode="json"))
