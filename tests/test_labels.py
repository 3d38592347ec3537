"""What users hold is shown in less than a kilobyte, and as it is written in Python where that is short."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import amount_text, prefixed
from continuum_grasp.scene import Value, to_si

ROOT = Path(__file__).parents[1]
SHIPPED = sorted(path for path in (ROOT / "configs").glob("*/*.yaml") if path.parent.name not in ("fingers", "sweep"))
NAMES = {name: getattr(cg, name) for name in cg.__all__}


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (30e-6, "N", "30 µN"),
        (-30e-6, "N", "-30 µN"),
        (2e-9, "N", "0.002 µN"),
        (0.05, "N", "50 mN"),
        (0.1, "N", "0.1 N"),
        (0.0, "N", "0 N"),
        (25.0, "N", "25 N"),
        (1.186e-7, "N m", "0.119 µN m"),
        (0.003, "J", "3 mJ"),
        (0.003, "m", "0.003 m"),
        (0.003, "kg", "0.003 kg"),
        (0.003, "rad", "0.003 rad"),
        (0.003, "N/s", "3 mN/s"),
        (6e4, "Pa", "60 kPa"),
        (2.5e5, "Pa", "0.25 MPa"),
        (50.0, "Pa", "50 Pa"),
        (1e6, "Pa/s", "1 MPa/s"),
        (np.inf, "N", "inf N"),
        (0.25, "", "0.25"),
    ],
)
def test_small_forces_are_written_in_parts_of_a_newton(value: float, unit: str, text: str) -> None:
    assert amount_text(value, unit) == text


@pytest.mark.parametrize("force", [3e-8, 3.7e-5, 9.99e-5, 1e-4, 0.0193, 0.0999, 0.1, 7.5, 1200.0])
def test_what_is_written_is_the_force_and_a_scene_may_have_it(force: float) -> None:
    """The text is read by the parser of configurations, which is other code."""
    assert to_si(amount_text(force, "N", ".6g"), "N") == pytest.approx(force, rel=1e-5)
    assert to_si(amount_text(force, "N m", ".6g"), "N m") == pytest.approx(force, rel=1e-5)
    factor, unit = prefixed("N", force)
    assert to_si(f"1 {unit}", "N") == pytest.approx(1.0 / factor, rel=1e-12)
    assert factor * force >= 0.1 or unit == "µN"
    assert factor * force < 100.0 or unit == "N"


def test_fixed_decimals_are_of_newtons() -> None:
    assert amount_text(12.3456, "N", ".2f") == "12.35 N"
    assert amount_text(0.0456, "N", ".2f") == "45.6 mN"
    assert amount_text(-0.0456, "N", "+.1f") == "-45.6 mN"
    assert amount_text(0.0456, "N", "+.1f") == "+45.6 mN"


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
