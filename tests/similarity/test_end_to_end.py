"""Fingers of 1 mm and of 10 m, of the same materials as a hand's: moved, holding, controlled, exported."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.export import export_c
from continuum_grasp.scene import load
from tests.export_cases import compile_programs, needs, run
from tests.rods import ROOT
from tests.similarity.similar import larger

LENGTH = 0.18
pytestmark = [pytest.mark.deep, pytest.mark.filterwarnings("ignore::UserWarning")]


def of_length(path: str, length: float):
    """A shipped scene of the hand finger, scaled: times as lengths, masses as their cube."""
    k = math.log2(length / LENGTH)
    return larger(load(ROOT / "configs" / path), {"L": k, "M": 3.0 * k, "T": k})


@needs("cc")
@pytest.mark.parametrize("length", [0.001, 10.0])
def test_a_finger_of_another_size_works_from_motion_to_c(length, tmp_path):
    r = length / LENGTH
    steps = [cg.simulate(of_length("simulate/tendon_step.yaml", one)) for one in (LENGTH, length)]
    assert np.asarray(steps[1].tip) == pytest.approx(r * np.asarray(steps[0].tip), abs=1e-6 * length)
    held = [cg.optimize_grasp(of_length("grasp/mug.yaml", one)) for one in (LENGTH, length)]
    assert held[1].certificate.passed
    assert held[1].status == held[0].status
    assert held[1].tension == pytest.approx(r**2 * held[0].tension, rel=1e-6)
    scene = of_length("mpc/tip_steps.yaml", length)
    loop = cg.run_closed_loop(scene)
    assert (loop.ended, loop.missed) == ("finished", ())
    export_c(scene, tmp_path / "package")
    # The package's own test: vectors of the functions, and steps of the controller.
    (program,) = compile_programs("cc", tmp_path / "package", tmp_path, "main", "-O1", "-lm")
    run(program)
