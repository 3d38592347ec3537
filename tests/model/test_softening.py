"""A material that softens: bends by closed form, energy, and what refuses it."""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.identification import Poses, Reading
from continuum_grasp.base import InputError
from continuum_grasp.rod import solve_elastica
from continuum_grasp.simulation import equilibrium_under
from tests.truth.differences import differences

LENGTH, STIFFNESS, CORNER, RATIO = 0.2, 0.01, 4.0, 0.25
"""m, N m2, 1/m, 1."""


def scene(**softening) -> cg.Scene:
    own = {"curvature": CORNER, "stiffness_ratio": RATIO, "rounding": 0.001, **softening}
    rod = {"length": LENGTH, "linear_density": 0.02, "bending_stiffness": STIFFNESS}
    finger = {"rod": rod, "softening": own, "rest_curvature": 1.0}
    return cg.Scene(finger=finger, gravity=(0.0, 0.0), fidelity={"family": "arc", "elements": 1})


def exact(moment):
    """Bend of a rod of constant curvature: linear to the corner, and on with a part of the stiffness."""
    size = np.abs(moment) / STIFFNESS
    above = np.where(size < CORNER, size, CORNER + (size - CORNER) / RATIO)
    return LENGTH * (1.0 + np.sign(moment) * above)


@pytest.mark.parametrize("moment", [0.02, 0.06, -0.06])
def test_bends_by_closed_form(moment):
    model = cg.FingerModel(scene(), tip_force=False)
    found = equilibrium_under(model, [moment], [])
    bend = float(np.array(model.bending(found.q, [moment], [])).sum())
    assert bend == pytest.approx(float(exact(moment)), abs=1e-3)


def test_the_elastic_force_is_the_gradient_of_the_energy():
    model = cg.FingerModel(scene(rounding=0.3), family="clothoid", elements=2, gravity=(0.0, 0.0), tip_force=False)
    q = np.array([3.0, 7.0, -6.0])
    (slope,) = differences(lambda q: float(model.energy([*q, 0.0, 0.0, 0.0], [0.0], [])[1]), q, 1e-5)
    assert np.array(model.elastic(q, [0.0], [])).ravel() == pytest.approx(slope, rel=1e-7)


@pytest.mark.deep
def test_a_linear_law_is_refuted_and_the_softening_found():
    moments = np.linspace(0.005, 0.08, 16)
    data = Poses([Reading("bend", exact(moments))], {"tip_moment": moments})
    linear = cg.identify(scene().changed({"finger.softening": None}), data, parameters=["bending_stiffness"])
    assert any("softens where it is bent far" in one for one in linear.warnings)
    start = scene(curvature=6.0, stiffness_ratio=0.5)
    names = ["bending_stiffness", "softening_curvature", "softening_ratio"]
    fit = cg.identify(start, data, parameters=names)
    assert fit.values == pytest.approx([STIFFNESS, CORNER, RATIO], rel=5e-3)
    assert not any("linear law" in one for one in fit.warnings)
    assert fit.apply().finger.softening.stiffness_ratio == fit["softening_ratio"]


def test_the_exact_rod_refuses_it():
    with pytest.raises(InputError, match="does not know a material that softens"):
        solve_elastica(scene())
