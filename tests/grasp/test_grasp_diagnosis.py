"""Why there is no grasp: repairs that are none are not offered, the balance against tilting is."""

from __future__ import annotations

import math

import pytest
from grasp_scenes import UPRIGHT, WEIGHTLESS, make_scene

from benchmarks.grasp_oracle.numbers import numbers
from benchmarks.grasp_oracle.search import Search
from continuum_grasp.grasp import Status, optimize_grasp
from continuum_grasp.grasp.reasons.reach import out_of_reach
from continuum_grasp.scene.grasp_options import GraspContacts, OutOfPlaneGravity


def middle_only(friction, gravity=UPRIGHT, family="arc", **changes):
    contacts = GraspContacts(friction=friction, normal_force_max=30.0, tip="off")
    return make_scene(family, gravity, contacts=contacts, **changes)


@pytest.mark.parametrize("angle", [0.0, 1.5, 3.0])
def test_what_can_be_turned_towards_the_base_is_not_out_of_reach(angle):
    """A bar whose frame is at one end: whether it reaches the base's surroundings depends on its angle alone."""
    corners = [(0.0, -0.01), (0.1, -0.01), (0.1, 0.01), (0.0, 0.01)]

    def reason(x):
        bar = {"shape": "polygon", "vertices": corners, "mass": 0.1, "position": (x, 0.0), "angle": angle}
        free = {"free": {"angle": (-3.2, 3.2)}}
        return out_of_reach(make_scene(gravity=WEIGHTLESS, base_y=0.0, supports={}, object=bar | free))

    reach = 0.95 * 0.18 + 0.006  # a middle contact is on, which touches up to there
    assert reason(reach + 0.099) is None  # turned by half a turn from the x axis, it is 1 mm within
    assert reason(reach + 0.115) is not None
    assert reason(reach + 0.115).needed == pytest.approx(reach)


@pytest.mark.deep
@pytest.mark.parametrize("family", ["matched_clothoid", "arc"])
@pytest.mark.parametrize("friction", [0.5, 1.5])
def test_no_mass_at_all_is_no_repair(family, friction):
    result = optimize_grasp(middle_only(friction, family=family), raise_on_failure=False)
    assert not result.solved
    named = [one for reason in result.reasons for one in (reason, *reason.also)]
    assert named
    assert all(one.needed > 0.1 * one.limit for one in named if one.name == "mass")


@pytest.mark.deep
def test_tilt_balance_is_named_with_the_moment_that_is_missing():
    """Two contacts bear the weight: finger at the normal n, palm at m. Of all shares that add up to the weight W,
    equal ones leave the least moment, R W |n + m| / 2; the arc that touches the mug fixes n.
    """
    scene = middle_only(1.5)
    (touch,) = {round(float(p.ends[0, 0] * p.lengths[0]), 9) for p in Search(numbers(scene)).postures if p.side == 1}
    n = scene.finger.base.angle + touch
    least = 0.04 * 0.3 * 9.81 * 0.5 * math.hypot(math.cos(n) - 1.0, math.sin(n))
    result = optimize_grasp(scene, raise_on_failure=False)
    assert result.status is Status.INFEASIBLE
    reason = next(r for r in result.reasons if r.key == "gravity.tilt")
    assert reason.needed == pytest.approx(least, rel=1e-4)
    assert reason.unit == "N m"
    assert f"{least:.3g} N m" in reason.text
    assert "gravity.tilt: ignore" in result.advice
    ignoring = OutOfPlaneGravity(mode="out_of_plane", magnitude=9.81, tilt="ignore")
    assert optimize_grasp(middle_only(1.5, ignoring)).solved


@pytest.mark.deep
def test_tilt_is_no_reason_where_it_is_ignored_or_harmless():
    ignoring = OutOfPlaneGravity(mode="out_of_plane", magnitude=9.81, tilt="ignore")
    ignored = optimize_grasp(middle_only(0.5, ignoring), raise_on_failure=False)
    heavy = optimize_grasp(make_scene("arc", UPRIGHT, mass=1.2), raise_on_failure=False)
    for result in (ignored, heavy):
        assert result.status is Status.INFEASIBLE
        assert "gravity.tilt" not in [reason.key for reason in result.reasons]
