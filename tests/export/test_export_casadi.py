"""Functions as files of CasADi: what is loaded computes what the model does."""

from __future__ import annotations

import json

import casadi as ca
import numpy as np
import pytest
from typer.testing import CliRunner

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.cli import app
from tests.export_cases import scene


@pytest.mark.parametrize("name", ["tendons", "contact"])
def test_what_is_loaded_computes_what_the_model_does(name, tmp_path):
    """All functions, at random points; the manifest has their inputs and the names of entries."""
    model, draws = cg.FingerModel(scene(name)), np.random.default_rng(1)
    made = cg.export_casadi(model, tmp_path)
    listed = json.loads((tmp_path / "MANIFEST.json").read_text(encoding="utf-8"))
    assert listed == made.manifest
    assert set(listed["functions"]) == set(cg.FingerModel.function_names())
    assert listed["entries"]["x"] == model.x_names
    assert list(listed["nominal_parameters"]) == model.p_names
    for key, about in listed["functions"].items():
        function = getattr(model, key)
        loaded = ca.Function.load(str(tmp_path / f"{key}.casadi"))
        assert (list(about["inputs"]), list(about["outputs"])) == (function.name_in(), function.name_out())
        point = [0.1 * draws.uniform(0.1, 1.0, size) for size in about["inputs"].values()]
        for ours, theirs in zip(function.call(point), loaded.call(point), strict=True):
            np.testing.assert_array_equal(np.array(theirs), np.array(ours))


def test_unknown_functions_are_refused(tmp_path):
    with pytest.raises(InputError, match="expected some of forward_dynamics"):
        cg.export_casadi(scene("tendons"), tmp_path, what=["tips"])


def test_by_command(tmp_path):
    line = ["export", "configs/mpc/tip_arc.yaml", "--to", "casadi", "--what", "tip,energy", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 0, done.output
    assert 'casadi.Function.load("tip.casadi")' in done.output
    refused = CliRunner().invoke(app, [*line, "--hinges", "3"])
    assert (refused.exit_code, "--hinges: has no effect on --to casadi" in refused.output) == (2, True)
