"""The numbers of grasp quality, on either side of each; from inside: outcomes of the conic solver are put in.

The numbers of grasp quality: each decides otherwise on either side of it, or keeps a promise.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.grasp.quality import conic
from continuum_grasp.grasp.quality.conic import solve_conic
from continuum_grasp.grasp.quality.contact_set import ContactSet
from continuum_grasp.grasp.quality.resistance import _Limits
from continuum_grasp.scene import Box
from tests import certificate_cases as cases


def believed(excess, monkeypatch):
    """Whether an optimum is believed that breaks a bound of one by a part of one and the number."""
    x = (1.0 + excess) / (1.0 - excess)
    found = SimpleNamespace(status="Solved", x=[x], obj_val_dual=-x)
    monkeypatch.setattr(conic.clarabel, "DefaultSolver", lambda *_: SimpleNamespace(solve=lambda: found))
    return solve_conic([-1.0], np.zeros((0, 1)), [], [], 0.0, 1.0).optimal


def test_points_that_break_a_limit_are_no_optima(monkeypatch):
    assert believed(0.99e-6, monkeypatch)
    assert not believed(1.01e-6, monkeypatch)


def shortfall_believed(gap, monkeypatch):
    """Whether the number 0.5 is believed to be the least one where the dual problem leaves a gap."""
    found = SimpleNamespace(status="AlmostSolved", x=[0.5], obj_val_dual=0.5 - gap)
    monkeypatch.setattr(conic.clarabel, "DefaultSolver", lambda *_: SimpleNamespace(solve=lambda: found))
    return solve_conic([1.0], np.zeros((0, 1)), [], [], 0.0, 1.0).optimal


def test_points_that_may_be_bettered_are_no_optima(monkeypatch):
    assert shortfall_believed(1.4e-6, monkeypatch)
    assert not shortfall_believed(1.6e-6, monkeypatch)


# -- limits of disturbances ----------------------------------------------------------------------------------------


def limits_of(**changes):
    """The limits of one contact that presses with a newton, and of one finger."""
    limits = object.__new__(_Limits)
    values = {
        "names": ("a.tip",),
        "setups": (SimpleNamespace(name="a"),),
        "scale": 1.0,
        "forces": np.array([[1.0, 0.0, 0.0]]),
        "friction": np.ones(1),
        "normal_max": np.ones(1),
        "low": np.zeros(1),
        "high": np.full(1, math.inf),
        "spare": np.zeros(1),
        "ranges": np.array([[-9.0, 9.0]]),
        "reach": np.full(4, math.inf),
    }
    vars(limits).update(values | changes)
    return limits


def names_a_limit(**changes):
    limits = limits_of(**changes)
    return bool(limits._reached(limits.forces, np.zeros(1), np.zeros(4)))


def is_limited(most):
    """Whether a disturbance counts as limited that changes a contact's force by this multiple of its greatest one."""
    one, no = np.ones((1, 1)), np.zeros((3, 1))
    unit = SimpleNamespace(forces=np.array([[[1.0], [0.0]]]), differences=one, pose=no, bends=0.0 * one)
    limits = limits_of(ranges=np.array([[-most, most]]), unit=unit, retensioned=unit, free=np.zeros(0, int))
    return math.isfinite(limits.greatest(np.ones(1))[0])


def is_no_corner(away):
    """Whether a contact so far from the corner of a box, per size of the box, is on a face."""
    box = Box(shape="box", width=0.06, height=0.08, mass=0.3, position=(0.0, 0.0))  # of size 0.05
    contact = ("a", (0.03, 0.04 - away * 0.05), (1.0, 0.0), (1.0, 0.0, 0.0), math.nan, 0)
    scene = cases.make_scene(cases.make_finger((0.5, 0.5)), box)
    return ContactSet(scene, {"object.pose": np.zeros(3), **cases.contact_arrays([contact])}).curvature(0) == 0.0


LIMITS = [
    ("force that is left before a contact parts", 1e-6,
     lambda x: not names_a_limit(forces=np.array([[1.0, 0.0, 0.0]]), low=np.array([1.0 - x]))),
    ("friction that is left before a contact slips", 1e-6,
     lambda x: not names_a_limit(forces=np.array([[1.0, 1.0 - x, 0.0]]))),
    ("force that is left before a contact is pressed too hard", 1e-6,
     lambda x: not names_a_limit(high=np.array([1.0 + x]))),
    ("tension that is left, per range", 1e-6,
     lambda x: not names_a_limit(ranges=np.array([[-1.0, x / (1.0 - x)]]))),
    ("multiple of a contact's force that counts as unlimited", 1e4, lambda x: not is_limited(x)),
    ("distance from a corner", 1e-6, is_no_corner),
]  # fmt: skip


@pytest.mark.parametrize(("limit", "decides"), [row[1:] for row in LIMITS], ids=[row[0] for row in LIMITS])
def test_quality_is_otherwise_on_either_side_of_a_limit(limit, decides):
    assert decides(1.001 * limit)
    assert not decides(0.999 * limit)
