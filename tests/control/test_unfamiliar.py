"""A controller with a learned residual: the anomaly beyond its logs, and that it then is as one without."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from continuum_grasp.control.compiled import controller_source
from continuum_grasp.control.controller import Controller
from continuum_grasp.control.estimation.model import estimation_of
from continuum_grasp.control.settings import controller_fields
from continuum_grasp.control.status import Anomaly
from continuum_grasp.scene.load import load
from tests.control.test_controller import GENERATED, STRICT
from tests.marks import few

CONFIG = Path(__file__).parents[2] / "configs/mpc/learned_friction.yaml"


def scenes():
    """The closed loop, with its state measured, with its residual, without, and with one whose logs are elsewhere."""
    scene = load(CONFIG).changed({"estimator": None, "controller.horizon.stages": 10})
    residual = scene.fidelity.residual
    away = tuple(c + 40.0 * s for c, s in zip(residual.center, residual.scale, strict=True))
    elsewhere = residual.replaced(center=away, weights=tuple(tuple(1e3 * w for w in row) for row in residual.weights))
    return [scene.changed({"fidelity.residual": one}) for one in (residual, None, elsewhere)]


@pytest.mark.deep
def test_beyond_the_logs_it_is_reported_and_the_command_is_that_without():
    own, plain, elsewhere = (Controller(scene, deadline=np.inf) for scene in scenes())
    state = np.array([2.0, 1.8, 5.0, 4.0, 0.012, 0.0])
    setpoints = np.append([-0.05, 0.165], np.zeros(own.stages.nr - 2))
    commands = [control.step(state, setpoints) for control in (own, plain, elsewhere)]
    assert [Anomaly.UNFAMILIAR in command.anomaly for command in commands] == [False, False, True]
    assert commands[2].u == pytest.approx(commands[1].u, abs=1e-9)
    assert commands[2].plan.x == pytest.approx(commands[1].plan.x, abs=1e-9)
    assert np.abs(commands[0].u - commands[1].u).max() > 0.01
    assert any("beyond the logs of the learned residual" in text for text in commands[2].anomalies)
    assert elsewhere.statistics["anomalies"]["unfamiliar"] == 1
    # A finger that is flung out of the logs, and back into them.
    far = own.step(state * [4.0, -4.0, 1.0, 1.0, 1.0, 1.0], setpoints)
    assert Anomaly.UNFAMILIAR in far.anomaly
    assert Anomaly.UNFAMILIAR not in own.step(state, setpoints).anomaly


@pytest.mark.deep
@pytest.mark.parametrize("real", few(["double", "float"], 1))
def test_a_strict_compiler_has_nothing_to_say(real, tmp_path):
    control = Controller(load(CONFIG).changed({"controller.horizon.stages": 10}), deadline=np.inf)
    scene, model, stages = control.scene, control.prediction, control.stages
    estimation = estimation_of(scene, model, stages.method)
    fields = controller_fields(scene, model, stages, estimation, real)
    file = tmp_path / "controller.c"
    file.write_text(controller_source(stages, estimation, 1, fields, real, None, model.residual_distance))
    done = subprocess.run(["cc", *STRICT.split(), *GENERATED.split(), str(file)], capture_output=True, text=True)
    assert not done.stderr
