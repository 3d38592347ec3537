"""A package of a controller with a learned residual: kernels to the bit, commands and anomalies those of Python."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from continuum_grasp.control.controller import Controller
from continuum_grasp.control.status import Anomaly
from continuum_grasp.export import export_c
from continuum_grasp.scene.load import load
from tests.export.test_export_control import reference, values
from tests.export_cases import STRICT, WARNINGS, compile_programs, needs, run, shared_library

CONFIG = Path(__file__).parents[2] / "configs/mpc/learned_friction.yaml"
STATE = np.array([2.0, 1.8, 5.0, 4.0, 0.012, 0.0])


@pytest.mark.deep
@needs("cc")
def test_commands_and_anomalies_are_those_of_python(tmp_path):
    scene = load(CONFIG).changed({"estimator": None, "controller.horizon.stages": 6})
    package = tmp_path / "package"
    export_c(scene, package, real="double")
    finger, library = shared_library(package, tmp_path)
    control, other = Controller(scene, deadline=math.inf), finger.Controller(library)
    row = np.append([-0.05, 0.165], np.zeros(control.stages.nr - 2))
    rows, seen = np.tile(row, (7, 1)), set()
    for k in range(8):
        # Bent against its moment: a tenth beyond the logs, where the residual fades.
        state = STATE * (1.0 if k % 3 != 2 else (-1.0, -1.0, 1.0, 1.0, 3.0, 1.0))
        command, found = control.step(state, rows), other.step(finger.Measurement(*state), reference(finger, rows))
        assert values(found) == pytest.approx(command.u, rel=1e-9, abs=1e-9)
        said = bool(other.diagnosis().anomalies & Anomaly.UNFAMILIAR)
        assert said == (Anomaly.UNFAMILIAR in command.anomaly) == (k % 3 == 2)
        seen.add(said)
    assert seen == {True, False}


@pytest.mark.deep
@needs("gcc")
@pytest.mark.parametrize("real", ["double", "float"])
def test_every_vector_to_the_bit_without_a_warning(real, tmp_path):
    scene = load(CONFIG).changed({"controller.horizon.stages": 6})
    export_c(scene, tmp_path / "package", real=real)
    (program,) = compile_programs("gcc", tmp_path / "package", tmp_path, "main", *STRICT, *WARNINGS, "-O1")
    found = re.findall(r"^(\w+) +0 of +(\d+) cases failed", run(program), re.MULTILINE)
    assert [function for function, _ in found] == ["estimator_step", "mpc"]
