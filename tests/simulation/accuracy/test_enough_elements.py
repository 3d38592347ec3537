"""Elements are raised until the error that they leave is below 1 %, or the result says that it is not.

Columns about their buckling load against elliptic integrals and Greenhill's constant, stepped rods against transfer
matrices, motions against their period.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy import optimize

import continuum_grasp as cg
from tests.closed_forms.rods import buckled_column, euler_load
from tests.marks import few
from tests.rods import without_compiler  # noqa: F401

pytestmark = pytest.mark.usefixtures("without_compiler")

LENGTH, STIFFNESS, DENSITY = 0.2, 0.006, 0.03
GREENHILL, BECK = 7.8373474, 20.0510
"""Weight of the tallest column, per EI / L^2, and following force under which it flutters; A. G. Greenhill, 1881."""


def column(share: float, *, by: str = "force", hangs: bool = False, **keys) -> cg.Scene:
    """A column under a share of its buckling load: a force on its tip, or its weight."""
    rod = {"length": LENGTH, "linear_density": DENSITY, "bending_stiffness": STIFFNESS}
    down = 1.0 if hangs else -1.0
    loads, gravity = [], (0.0, 0.0)
    if by == "force":
        loads = [{"kind": "force", "at": LENGTH, "force": (0.0, down * share * euler_load(STIFFNESS, LENGTH))}]
    else:
        gravity = (0.0, down * share * GREENHILL * STIFFNESS / (DENSITY * LENGTH**3))
    finger = {"rod": rod, "base": {"angle": math.pi if hangs else 0.0}}
    return cg.Scene(finger=finger, gravity=gravity, loads=loads, **keys)


def across(share: float) -> float:
    """Deflection of the tip of the buckled column, per length."""
    load = share * math.pi**2 / 4
    angle = optimize.brentq(lambda angle: buckled_column(angle)[0] - load, 1e-6, 3.0, xtol=1e-13)
    return buckled_column(angle)[1].across


@pytest.mark.parametrize("hangs", [False, True])
@pytest.mark.parametrize(("share", "error"), [(1.00001, 0.01), (1.0005, 0.01), (1.01, 0.01), (1.3, 0.005)])
def test_a_column_above_its_buckling_load_buckles_to_the_side_that_is_asked_for(share, error, hangs):
    tips = []
    for side in (1, -1):
        found = cg.equilibrium(column(share, hangs=hangs), side=side)
        assert found.status == "stable"
        tips.append(found.tip[0] / LENGTH)
    assert tips[0] == pytest.approx(-tips[1], rel=1e-6)
    assert abs(tips[0]) == pytest.approx(across(share), abs=error)


@pytest.mark.parametrize("share", [0.9, 0.999, 0.9999])
@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_a_column_below_its_buckling_load_stands(share, family):
    found = cg.equilibrium(column(share, fidelity={"family": family}))
    assert found.status == "stable"
    assert found.tip == pytest.approx([0.0, LENGTH], abs=1e-9)
    assert len(found.model.lengths) == 2


@pytest.mark.parametrize(
    ("family", "elements", "share"),
    few([(f, n, share) for f in ("arc", "clothoid") for n in (1, 2, 3, 4, 8) for share in (1.0005, 1.01)], 6),
)
def test_no_stated_elements_call_a_column_stable_that_stands_above_its_buckling_load(family, elements, share):
    """They buckle, or are reported unstable with the number of elements that does."""
    found = cg.equilibrium(column(share, fidelity={"family": family, "elements": elements}))
    assert len(found.model.lengths) == elements
    stands = abs(found.tip[0]) < 1e-6 * LENGTH
    assert found.stable != stands
    off = abs(abs(found.tip[0]) / LENGTH - across(share))
    said = [text for text in found.warnings if text.startswith(f"{elements} element")]
    assert bool(said) == (off > 0.01 or stands)
    assert found.status == ("unstable" if stands else "stable")


@pytest.mark.parametrize("share", [0.99, 0.9999, 1.0005, 1.01, 1.1])
def test_a_column_under_its_own_weight_buckles_at_the_load_of_greenhill(share):
    found = cg.equilibrium(column(share, by="weight"))
    assert found.status == "stable"
    assert (abs(found.tip[0]) > 1e-3 * LENGTH) == (share > 1.0)
    straight = cg.equilibrium(column(share, by="weight"), stable=False)
    assert abs(straight.tip[0]) < 1e-9 * LENGTH
    assert straight.stable == (share < 1.0)


def test_arcs_that_cannot_settle_it_say_so_first():
    found = cg.equilibrium(column(1.0005, fidelity={"family": "arc"}))
    assert (found.status, found.stable) == ("under_resolved", False)
    assert found.headline() == "not within 1 %: 16 elements leave a shape that is unstable, near a critical load"
    assert found.warnings[-1].startswith(found.headline())


def test_tendons_of_equal_pull_do_not_buckle_a_column():
    """Guided along the backbone, they follow it: their pull has no moment on the straight finger, nor beside it."""
    rod = {"length": LENGTH, "linear_density": DENSITY, "bending_stiffness": STIFFNESS}
    tendons = {"offset": 0.005, "max_tension": 100.0}
    pull = 20.0 * euler_load(STIFFNESS, LENGTH)
    scene = cg.Scene(finger={"rod": rod, "tendons": tendons}, gravity=(0.0, 0.0), actuation={"tensions": [pull, pull]})
    found = cg.equilibrium(scene)
    assert found.status == "stable"
    assert found.tip == pytest.approx([0.0, LENGTH], abs=1e-9)


@pytest.mark.parametrize(("share", "elements"), [(0.9, 2), (0.995, 4), (1.005, 4)])
def test_a_following_force_makes_a_column_flutter_at_the_load_of_beck(share, elements):
    """Two clothoids flutter at 1.006 of it; M. Beck, 1952."""
    load = {"kind": "force", "at": LENGTH, "force": (0.0, -share * BECK * STIFFNESS / LENGTH**2), "follows": True}
    scene = column(0.0, fidelity={"family": "clothoid"}).replaced(loads=[load])
    found = cg.equilibrium(scene, stable=False)
    assert found.stable == (share < 1.0)
    assert len(found.model.lengths) >= elements
    stated = cg.equilibrium(scene.replaced(fidelity={"family": "clothoid", "elements": 2}), stable=False)
    assert stated.stable == (share < 1.0)


def stepped(ratio: float, *, soft_tip: bool = True, **keys) -> cg.Scene:
    """A rod whose halves have a ratio of stiffness, without gravity."""
    halves = [STIFFNESS, STIFFNESS / ratio]
    sections = [
        {"to": at, "bending_stiffness": value, "linear_density": DENSITY}
        for at, value in zip((0.5 * LENGTH, LENGTH), halves if soft_tip else halves[::-1], strict=True)
    ]
    return cg.Scene(finger={"rod": {"length": LENGTH, "sections": sections}}, gravity=(0.0, 0.0), **keys)


def frequencies(ratio: float, soft_tip: bool) -> np.ndarray:
    """First two natural frequencies [Hz] of the stepped cantilever, by the transfer matrices of its halves."""
    halves = [STIFFNESS, STIFFNESS / ratio] if soft_tip else [STIFFNESS / ratio, STIFFNESS]

    def transfer(pulsation: float, stiffness: float) -> np.ndarray:
        """From deflection, slope, moment and shear at the start of a half to those at its end (W. T. Thomson, 1950)."""
        wave = (DENSITY * pulsation**2 / stiffness) ** 0.25
        angle = 0.5 * wave * LENGTH
        c, s = 0.5 * (math.cosh(angle) + math.cos(angle)), 0.5 * (math.sinh(angle) + math.sin(angle))
        d, e = 0.5 * (math.cosh(angle) - math.cos(angle)), 0.5 * (math.sinh(angle) - math.sin(angle))
        k = stiffness
        return np.array(
            [
                [c, s / wave, d / (k * wave**2), e / (k * wave**3)],
                [wave * e, c, s / (k * wave), d / (k * wave**2)],
                [k * wave**2 * d, k * wave * e, c, s / wave],
                [k * wave**3 * s, k * wave**2 * d, wave * e, c],
            ]
        )

    def free(pulsation: float) -> float:
        """Determinant that vanishes where a moment and a shear at the clamp leave none at the tip."""
        whole = transfer(pulsation, halves[1]) @ transfer(pulsation, halves[0])
        block = whole[2:, 2:]
        return float(np.linalg.det(block / np.abs(block).max(axis=1)[:, None]))

    unit = math.sqrt(min(halves) / (DENSITY * LENGTH**4))
    grid = unit * np.geomspace(0.3, 100.0, 600)
    values = [free(pulsation) for pulsation in grid]
    changes = [k for k in range(len(grid) - 1) if values[k] * values[k + 1] < 0.0][:2]
    return np.array([optimize.brentq(free, grid[k], grid[k + 1]) for k in changes]) / (2.0 * math.pi)


@pytest.mark.parametrize("soft_tip", [True, False])
@pytest.mark.parametrize("ratio", [1.0, 10.0, 1e3, 1e6])
def test_the_first_two_frequencies_of_a_stepped_rod_are_within_one_percent(ratio, soft_tip):
    true = frequencies(ratio, soft_tip)
    found = cg.modes(stepped(ratio, soft_tip=soft_tip))
    assert found.status == "stable"
    assert found.frequencies_hz[:2] == pytest.approx(true, rel=0.01)
    assert found.space_error[:2] == pytest.approx(np.abs(found.frequencies_hz[:2] / true - 1.0), abs=1e-6)


@pytest.mark.parametrize("about", [False, True])
def test_stated_elements_are_retained_and_the_number_that_does_is_named(about):
    """Two clothoids leave 5 % in the second frequency of a rod whose base is a millionth as stiff as its tip."""
    scene = stepped(1e6, soft_tip=False, fidelity={"elements": 2})
    found = cg.modes(scene, about=cg.equilibrium(scene) if about else None)
    (warning,) = found.warnings
    assert warning == "2 elements leave natural frequency 2 wrong by 5.2 %: fidelity.elements: 4 keeps 1 %"
    assert (found.status, len(found.equilibrium.model.lengths)) == ("stable", 2)
    true = frequencies(1e6, False)
    named = cg.modes(scene.replaced(fidelity={"elements": 4}))
    assert named.warnings == ()
    assert named.frequencies_hz[:2] == pytest.approx(true, rel=0.01)


def test_a_motion_has_the_period_of_the_stepped_rod():
    """Released from a pull across its tip, in elements whose first frequency is within 1 %."""
    held = [{"kind": "force", "at": LENGTH, "force": (1e-4, 0.0)}]
    true = frequencies(1e3, True)
    time = {"duration": 3.0 / true[0], "step": 0.02 / true[0]}
    scene = stepped(1e3, initial={"pose": "equilibrium", "held_by": held}, time=time)
    motion = cg.simulate(scene)

    def missed(first: float) -> float:
        """What cosines of the first two frequencies miss of the tip's deflection."""
        waves = np.cos(2.0 * math.pi * motion.t[:, None] * [first, true[1]])
        return float(np.linalg.lstsq(waves, motion.tip[:, 0])[1][0])

    fitted = optimize.minimize_scalar(missed, bounds=(0.95 * true[0], 1.05 * true[0]), method="bounded").x
    assert fitted == pytest.approx(true[0], rel=0.01)
    assert motion.static_error < 0.01
    assert motion.resolution is not None
    assert motion.resolution.frequencies[0] < 0.01


def test_a_number_that_is_open_is_that_of_the_stored_result_and_the_same_again(tmp_path):
    found = cg.equilibrium(column(1.0005))
    assert len(found.model.lengths) == 4
    assert "2 elements leave a shape that is unstable" in found.statistics["fidelity"]
    folder = found.save(tmp_path / "run")
    config = json.loads((folder / "meta.json").read_text(encoding="utf-8"))["config"]
    assert len(config["fidelity"]["elements"]) == 4
    again = cg.equilibrium(cg.Scene.model_validate(config))
    assert again.q == pytest.approx(found.q)
