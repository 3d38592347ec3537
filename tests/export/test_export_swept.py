"""Packages of many elements, whose dynamics are a loop over the links; from inside: the C of the loop alone."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.core import CReal
from continuum_grasp.export.swept import SweptKernel
from continuum_grasp.model import FingerModel, Kernels
from continuum_grasp.scene import ForceLoad
from tests.export_cases import MANY
from tests.model.test_many_elements import COUNT, model_of, state_of


@pytest.mark.parametrize(("family", "name"), MANY.values())
def test_the_reference_is_the_model(family, name):
    model = model_of(family, name)
    x, u, w, _ = state_of(model)
    driven = model.drive_rates if model._equations.drives_feel_motion else None
    kernel = SweptKernel("dynamics", Kernels.of(model._equations), "", driven)
    rows = {"x": x[None], "u": u[None], "w": w[None], "p": np.zeros((1, 0))}
    found = kernel.evaluate(CReal.KINDS["double"], **rows)["xd"][0]
    true = np.array(model.forward_dynamics(x, u, w, [])).ravel()
    assert np.abs(found - true).max() <= 1e-8 * np.abs(true).max()


def test_code_does_not_grow_with_the_elements():
    def lines(count: int) -> int:
        finger = model_of("arc", "bare").finger
        model = FingerModel(finger, family="arc", elements=count, loads=(ForceLoad(at=0.6, force=(0.0, 0.0)),))
        kernel = SweptKernel("dynamics", Kernels.of(model._equations), "")
        return kernel.c_source("finger", CReal.KINDS["float"]).count("\n")

    assert lines(4 * COUNT) <= lines(COUNT)
