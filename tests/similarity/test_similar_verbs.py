"""Shipped motions and grasps in other units: a finger of millimeters and one of meters obey the same laws.

Sizes are powers of two, so that what has no unit of its own is the same to the bit but for what libraries round.
"""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.scene import load
from tests.rods import ROOT
from tests.similarity.similar import larger, power

SMALL, LARGE = {"L": -6, "M": -17, "T": -3}, {"L": 4, "M": 12, "T": 3}
NO_GRASP = ("heavy_bottle", "slippery_bottle")
WEIGHED = ("box_edge", "mug_robust", "mug_steady")
"""Scenes with several objectives, whose weights are numbers of their author and per newton: sizes that keep it."""
KEEPING = {"L": -6, "M": 0, "T": -3}, {"L": 4, "M": 2, "T": 3}
STEPS = 30
"""Of a motion [1]: enough for contacts, friction and slack to act."""
pytestmark = pytest.mark.filterwarnings("ignore:.*is in (milli)?meters:UserWarning")


def names_of(kind, *, but=()):
    quick = {"swing_against_disc", "mug"}
    names = sorted(path.stem for path in (ROOT / "configs" / kind).glob("*.yaml") if path.stem not in but)
    return [pytest.param(name, marks=() if name in quick else pytest.mark.deep) for name in names]


@pytest.mark.parametrize("sizes", [SMALL, LARGE], ids=["small", "large"])
@pytest.mark.parametrize("name", names_of("simulate"))
def test_a_motion_is_that_of_another_size(name, sizes):
    scene = load(ROOT / f"configs/simulate/{name}.yaml")
    time = scene.time
    few = time.replaced(duration=min(time.duration, STEPS * time.step), space_error=False)
    scene = scene.replaced(time=few, fidelity=scene.fidelity.replaced(tolerance=None))
    one, other = cg.simulate(scene), cg.simulate(larger(scene, sizes))
    length, unit = scene.finger.rod.length, 2.0 ** power("m", sizes)
    assert other.t * 2.0 ** -sizes["T"] == pytest.approx(one.t, rel=1e-15)
    assert np.abs(np.asarray(other.tip) / unit - np.asarray(one.tip)).max() < 1e-9 * length
    assert len(other.warnings) == len(one.warnings)


@pytest.mark.parametrize("sizes", [SMALL, LARGE], ids=["small", "large"])
@pytest.mark.parametrize("name", names_of("grasp", but=NO_GRASP))
def test_a_grasp_is_that_of_another_size(name, sizes):
    scene = load(ROOT / f"configs/grasp/{name}.yaml")
    sizes = KEEPING[sizes is LARGE] if name in WEIGHED else sizes
    one, other = cg.optimize_grasp(scene), cg.optimize_grasp(larger(scene, sizes))
    assert (other.status, other.certificate.passed) == (one.status, one.certificate.passed)
    units = {"tensions": power("N", sizes), "pose": power("m", sizes)}
    for key, value in one.arrays.items():
        if key.endswith("tensions"):
            expected = np.asarray(value) * 2.0 ** units["tensions"]
            assert other.arrays[key] == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())
        if key.endswith("backbone"):
            places = np.asarray(value)[..., :3] * 2.0 ** units["pose"]  # beside them angles
            assert np.abs(other.arrays[key][..., :3] - places).max() < 1e-6 * np.abs(places).max()


@pytest.mark.deep
@pytest.mark.parametrize("sizes", [{**SMALL, "T": -4}, {**LARGE, "T": 2}], ids=["small", "large"])
@pytest.mark.parametrize(
    ("name", "of_input", "flat"),
    [("tip_to_point", "N", 1e-3), ("past_a_post", "N", 2e-4), ("release", "m", 4e-3), ("close_on_mug", "N", 1e-9)],
)
def test_a_plan_is_that_of_another_size(name, of_input, flat, sizes):
    """As far as its solver goes: an optimum is flat, of the share ``flat`` of the greatest input.

    Rounding decides which plan closes on the mug: starts that differ by 1e-15 end 0.14 % apart in effort. In other
    units no number of its problem and its start differs, nor does its plan.
    """
    scene = load(ROOT / f"configs/plan/{name}.yaml")
    one, other = cg.plan(scene), cg.plan(larger(scene, sizes, of_input=of_input))
    assert other.status == one.status
    assert other.duration * 2.0 ** -sizes["T"] == pytest.approx(one.duration, rel=2e-4)
    assert other.u * 2.0 ** -power(of_input, sizes) == pytest.approx(one.u, abs=flat * np.abs(one.u).max())
