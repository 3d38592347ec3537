"""What users hold is shown in less than a kilobyte, and as it is written in Python where that is short."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.scene import Value

ROOT = Path(__file__).parents[1]
SHIPPED = sorted(path for path in (ROOT / "configs").glob("*/*.yaml") if path.parent.name not in ("fingers", "sweep"))
NAMES = {name: getattr(cg, name) for name in cg.__all__}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_scenes_are_shown_in_short(path: Path) -> None:
    scene = cg.load(path)
    assert len(repr(scene)) < 1000
    assert str(scene) == repr(scene)
    assert repr(scene).startswith(type(scene).__name__)
    assert len(repr(scene)) <= 200 or "\n  name" in repr(scene)


@pytest.mark.parametrize(
    "value",
    [
        cg.Rod(length=0.6, linear_density=0.02, bending_stiffness=0.05),
        cg.BasePose(),
        cg.ForceLoad(at=0.6, force=(0.2, 0.0)),
        cg.Finger(
            rod=cg.Rod(length=0.6, diameter=0.002, density=6450.0, youngs_modulus=6e10),
            masses=(cg.PointMass(at=0.6, mass=0.02),),
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_short_values_are_shown_as_they_are_written(value: Value) -> None:
    assert eval(repr(value), dict(NAMES)) == value
    assert "None" not in repr(value)  # what has its default is left out


def test_models_and_cores_are_shown_by_their_vectors() -> None:
    model = cg.FingerModel(cg.load(ROOT / "configs/simulate/tendon_step.yaml"), elements=16, family="arc")
    system = cg.System(cg.load(ROOT / "configs/simulate/swing_against_disc.yaml"))
    for shown in (model, system, cg.compile(model, [])):
        assert len(repr(shown)) < 1000
        assert f"{shown.model.nx if shown.__class__.__name__ == 'Core' else shown.nx}: " in repr(shown)
    assert repr(model).startswith("FingerModel of 16 x arc, ")


def test_controllers_and_what_they_return_are_shown_by_their_names() -> None:
    controller = cg.Controller(ROOT / "configs/mpc/steady_tip.yaml", deadline=np.inf)
    assert "tip_x [m], tip_y [m], tension_1 [N], tension_2 [N]" in repr(controller)
    command = controller.step([0.0, 0.18, 1.0, 1.0])
    assert repr(command).startswith("Command solved\n  u ")
    assert "1 solved" in repr(controller)
    assert "anomalies" in repr(controller.step([np.nan] * 4))
    estimator = cg.Estimator(controller.scene)
    found = estimator.step([0.0, 0.18, 1.0, 1.0], [1.0, 1.0])
    assert "used, used, used, used" in repr(found)
    for shown in (controller, command, estimator, found):
        assert len(repr(shown)) < 1000
        assert "<table>" in shown._repr_html_()
