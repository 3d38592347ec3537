"""Parts of a controller, each alone; from inside: its C, and noise and dynamics put in where excitation is judged."""

from __future__ import annotations

import math
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.control import Controller
from continuum_grasp.control.compiled import controller_source
from continuum_grasp.control.estimation import excitation
from tests.control.test_controller import ADAPTING
from tests.control_cases import swing_scene


def test_sensitivities_at_rest_are_weighed_by_the_deviation_of_their_mean(monkeypatch):
    """A lag of first order over 50 ms of what an error e' = a e + g n makes, by its closed form; three deviations."""
    a, g, slope, std, r = 0.7, 0.4, 2.0, 0.03, 1.0 - 0.01 / 0.06
    of_error = (g * std) ** 2 / (1.0 - a**2)
    of_mean = ((1.0 - r) * slope) ** 2 * of_error * (1.0 + a * r) / ((1.0 - r**2) * (1.0 - a * r))
    # Sensitivities of a state, slope z^2 / 2, at 1 and at 2.
    step = lambda z, *_: (z, np.array([[1.0, slope * z[0] ** 2 / 2.0], [0.0, 1.0]]))  # noqa: E731
    estimation = SimpleNamespace(nx=1, nz=2, adapted=[SimpleNamespace(state=1)], step=step)
    rod = SimpleNamespace(natural_time=0.05 / 0.65)
    scene = SimpleNamespace(controller=SimpleNamespace(step=0.01), finger=SimpleNamespace(rod=rod))
    monkeypatch.setattr(excitation, "noise_of", lambda *_: (None, np.ones(2), np.array([std**2])))
    monkeypatch.setattr(excitation, "_rests", lambda *_: [(np.array([at]), None) for at in (1.0, 2.0)])
    monkeypatch.setattr(excitation, "_stationary", lambda *_: (np.array([[a]]), np.array([[g]])))
    found = excitation.quiet_sensitivities(scene, SimpleNamespace(p_nominal=()), estimation, 1)
    assert np.abs(found).ravel() == pytest.approx([1.0 / (3.0 * math.sqrt((1.0 + 4.0) * of_mean))], rel=1e-6)


STRICT = "-std=c99 -fsyntax-only -Werror -Wall -Wextra -Wpedantic -Wconversion -Wdouble-promotion -Wshadow"


GENERATED = "-Wno-unused-parameter -Wno-unused-function -Wno-unused-variable"
"""What the code around estimator and controller needs."""


COMPILED = {
    "estimator": {},
    "adapted parameters": ADAPTING,
    "scenarios": {"controller": {"scenarios": ({}, {"stiffness": 2.0})}, "estimator": None},
}


@pytest.mark.parametrize("changes", COMPILED.values(), ids=COMPILED)
@pytest.mark.parametrize("precision", ["double", "float"])
def test_compilers_have_nothing_to_say(precision, changes, tmp_path):
    control = Controller(swing_scene(**changes), deadline=math.inf)
    file = tmp_path / "controller.c"
    file.write_text(controller_source(control.parts, precision))
    done = subprocess.run(["cc", *STRICT.split(), *GENERATED.split(), str(file)], capture_output=True, text=True)
    assert not done.stderr
