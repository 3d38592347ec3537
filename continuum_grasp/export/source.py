"""What is given to be exported: a model, a scene, or the path of its file."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from continuum_grasp.control.controller import Controller
from continuum_grasp.control.estimation.estimator import Estimator
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.errors import InputError
from continuum_grasp.export.reals import Real
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.load import load
from continuum_grasp.scene.simulate import Scene

__all__ = ["Given", "Source", "source_of"]

_MEANT = re.compile(r"[^\w .,:;()+=%'/-]")
"""What may mean something in a comment of C, in XML, CMake, pkg-config or Markdown."""

_CUT = 0.25
"""Share of the rounding below which the terms of an arc's series are left out in single precision."""

Given = FingerModel | Scene | ControlScene | Controller | Estimator | str | os.PathLike[str]


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
    loop: ControlScene | None = None
    """The closed loop, where it is one."""

    @property
    def touching(self) -> bool:
        """Whether the scene has an object, which is no part of the model."""
        return self.configuration is not None and self.configuration.get("object") is not None


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
        return Source(_of_precision(given, real), "a continuum finger", "a FingerModel", None, None)
    if isinstance(given, (str, os.PathLike)):
        given = load(given)  # type: ignore[assignment, arg-type]
    if isinstance(given, (Controller, Estimator)):
        given = given.scene
    if isinstance(given, ControlScene):
        return _of_loop(given, real)
    if not isinstance(given, Scene):
        raise InputError(f"expected a FingerModel, a Scene, a closed loop or the path of its file, got {given!r:.80}")
    scene = given
    if scene.fidelity.tolerance is not None:
        from continuum_grasp.accuracy.resolve import resolve_fidelity

        scene, _ = resolve_fidelity(scene)
    model = _of_precision(FingerModel(scene), real)
    step = scene.time.step if scene.time is not None else None
    return Source(model, *_names(scene), step, scene.model_dump(mode="json"))


def _of_precision(model: FingerModel, real: Real) -> FingerModel:
    """The same model; of arcs in single precision with series that are cut there, unless an accuracy was asked for."""
    if real.name != "float" or model.family != "arc" or model.structure.accuracy is not None:
        return model
    finger, keywords = model.structure.asked
    return FingerModel(finger, **{**keywords, "accuracy": _CUT * real.epsilon})


def _of_loop(scene: ControlScene, real: Real) -> Source:
    """The closed loop, and the model that its controller predicts with."""
    fidelity = scene.fidelity
    if real.name == "float" and fidelity.family == "arc" and fidelity.accuracy is None:
        scene = scene.model_copy(update={"fidelity": fidelity.model_copy(update={"accuracy": _CUT * real.epsilon})})
    model = Prediction(scene).system.finger_model
    return Source(model, *_names(scene), None, scene.model_dump(mode="json"), scene)


def _names(scene: Scene | ControlScene) -> tuple[str, str]:
    """Title, and what the README says that it was made from."""
    title = " ".join(_MEANT.sub(" ", scene.name or "").split())
    return title or "a continuum finger", f"the scene '{title}'" if title else "a scene without a name"
