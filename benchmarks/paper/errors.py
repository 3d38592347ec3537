"""Errors of the paper's own equations in a scene, as printed and corrected."""

from __future__ import annotations

from benchmarks.paper.model import VARIANTS, PaperModel
from continuum_grasp.accuracy.choice import Errors, errors_of
from continuum_grasp.accuracy.truth import Truth
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene

__all__ = ["paper_errors"]


def paper_errors(scene: Scene, truth: Truth) -> dict[str, Errors]:
    """Errors of two exact arcs, and of each variant of the paper's equations, against the exact rod.

    Parameters
    ----------
    scene : Scene
        With ``fidelity`` of two arcs; forces and masses at contact and tip alone.
    truth : Truth
        Of that scene.
    """
    held = scene.model_copy(update={"loads": truth.loads})
    models = {"two arcs": FingerModel(held, input_rates=False)}
    for variant in VARIANTS:
        models[variant] = PaperModel(held, variant, gravity_across=variant == "appendix_printed")
    return {name: errors_of(model, truth, moves=scene.time is not None) for name, model in models.items()}
