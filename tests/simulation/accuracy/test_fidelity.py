"""A tolerance becomes a model, the cheapest within it; from inside: speeds and errors are put in, and a record read.

A tolerance becomes a model: within it, the cheapest, aligned with what bends the finger, remembered.
"""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from benchmarks.bench_fidelity import again, cheaper, random_scene
from benchmarks.rod_shapes import RODS
from continuum_grasp.core.cache import cache_folder
from continuum_grasp.model import FingerModel
from continuum_grasp.rod import natural_frequencies, solve_elastica
from continuum_grasp.simulation import choose_fidelity, resolve_fidelity
from continuum_grasp.simulation.accuracy import choose, motion
from continuum_grasp.simulation.accuracy.choice import RANGES, _bending_range
from continuum_grasp.simulation.accuracy.truth import load_cases
from tests.marks import few
from tests.rods import NITINOL, ROOT, UNIT, force, rod_scene, without_compiler  # noqa: F401

pytestmark = pytest.mark.usefixtures("without_compiler")


def scene(tolerance=None, **keys):
    """The paper's rod, horizontal; moving where ``time`` is given."""
    fidelity = {"bending_range": None, "tolerance": tolerance}
    return rod_scene(NITINOL, None, None, fidelity=fidelity, **keys)


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("CONTINUUM_GRASP_CACHE", str(tmp_path / "cache"))


@pytest.mark.deep
@pytest.mark.parametrize(("seed", "tolerance"), few([(seed, (2e-2, 5e-3, 1e-3)[seed % 3]) for seed in range(15)], 6))
def test_the_choice_keeps_the_tolerance(seed, tolerance):
    """Measured again by the public way, against the exact rod at other places and its frequencies."""
    check(choose_fidelity(random_scene(seed), tolerance), tolerance)


TENDONS = [
    {"offset": [0.009, 0.005], "to": 0.6, "max_tension": 100.0},
    {"offset": [-0.009, -0.002], "max_tension": 100.0},
]
GRADED = {
    "step": {"rod": RODS["step"], "loads": [force(1.0, (0.02, 0.3))]},
    "moving cone with two ends of tendons": {
        "rod": RODS["cone 0.25"],
        "gravity": (0.0, -1.0),
        "finger": {"tendons": TENDONS},
        "actuation": {"tensions": [{"times": [0.0, 0.5, 1.0], "values": [0.0, 10.0, 5.0]}, 2.0]},
        "time": {"duration": 1.0, "step": 0.01},
    },
    "steep cone": {"rod": RODS["cone 0.1"], "gravity": (0.0, -4.0)},
}


@pytest.mark.deep
@pytest.mark.parametrize("case", few(GRADED, 2))
def test_the_choice_keeps_the_tolerance_of_a_graded_rod(case):
    keys = {"gravity": (0.0, 0.0), **GRADED[case]}
    given = rod_scene(keys.pop("rod"), None, None, fidelity={"bending_range": None}, **keys)
    check(choose_fidelity(given, 3e-3), 3e-3)


def check(chosen, tolerance):
    """Measure again by the public way."""
    assert again(chosen) <= tolerance * (1 + 1e-6)
    moving = chosen.scene
    if moving.time is not None:
        rod = solve_elastica(moving)
        found = cg.modes(moving).frequencies_hz[0]
        assert found == pytest.approx(natural_frequencies(moving.finger, rod)[0], rel=tolerance)


@pytest.mark.deep
@pytest.mark.parametrize("seed", few([1, 4, 8, 12, 20], 2))
def test_nothing_cheaper_would_have_done(seed):
    assert cheaper(choose_fidelity(random_scene(seed), 5e-3)) == ""


@pytest.mark.deep
def test_a_tighter_tolerance_costs_more():
    costs = [
        choose_fidelity(scene(time={"duration": 1.0, "step": 0.01}), t).best.cost for t in (5e-2, 1e-2, 1e-3, 1e-4)
    ]
    assert costs == sorted(costs)
    assert len(set(costs)) == len(costs)


def test_elements_end_where_the_finger_is_loaded():
    """With its boundary at the force, one linear piece and no curvature beyond it, the shape is all but exact."""
    pushed = scene(gravity=(0.0, 0.0), loads=[force(0.23, (0.0, 0.5))])
    chosen = choose_fidelity(pushed, 1e-4)
    assert chosen.best.choice.aligned
    assert np.any(np.isclose(np.cumsum(chosen.best.choice.lengths), 0.23))


@pytest.mark.parametrize("elements", [5, (0.1, 0.2, 0.3)])
def test_elements_that_are_fixed_stay(elements):
    fixed = scene(tip_mass=0.02)
    fixed = fixed.model_copy(update={"fidelity": fixed.fidelity.model_copy(update={"elements": elements})})
    lengths = choose_fidelity(fixed, 2e-2).scene.fidelity.elements
    assert lengths == pytest.approx((0.12,) * 5 if elements == 5 else elements)


@pytest.mark.deep
def test_modes_are_held_to_the_tolerance_though_nothing_moves():
    """Hertz of the weightless clamped rod: 3.5160 and 22.0345 over 2 pi, times sqrt(EI / rho A L^4)."""
    still = rod_scene(UNIT, None, None, gravity=(0.0, 0.0), fidelity={"bending_range": None, "tolerance": 0.01})
    found = cg.modes(still).frequencies_hz
    assert found[:2] * 2 * np.pi == pytest.approx([3.51602, 22.03449], rel=0.01)


def test_the_peak_of_a_short_load_is_a_load_case():
    """However many samples there are."""
    times = [0.1 * k for k in range(15)]
    for peak in (1, 2, 7):
        values = [[0.0, 0.5 if k == peak else 0.0] for k in range(15)]
        pushed = force(0.6, {"times": times, "values": values, "interpolation": "linear"})
        posed = scene(gravity=(0.0, 0.0), loads=[pushed], time={"duration": 1.5, "step": 0.01})
        names = [name for name, _ in load_cases(posed)]
        assert f"t = {times[peak]:g} s" in names
        assert len(names) <= 12


@pytest.mark.deep
def test_a_moving_scene_gets_a_range_that_its_motion_keeps():
    heavy = scene(tip_mass=0.05, time={"duration": 1.0, "step": 0.005}, tolerance=5e-3)
    motion = cg.simulate(heavy)
    assert motion.warnings == ()
    assert motion.scene.fidelity.tolerance is None
    assert "tolerance of 0.005" in motion.statistics["fidelity"]


@pytest.mark.usefixtures("own_cache")
def test_a_choice_is_remembered(monkeypatch):
    wanted = scene(1e-3)
    first, note = resolve_fidelity(wanted)

    def never(_):
        raise AssertionError("measured again")

    monkeypatch.setattr(choose, "choose_fidelity", never)
    renamed = wanted.model_copy(update={"name": "another name"})
    assert resolve_fidelity(wanted) == (first, note)
    assert resolve_fidelity(renamed)[0].fidelity == first.fidelity
    with pytest.raises(AssertionError):
        resolve_fidelity(scene(2e-3))


@pytest.mark.usefixtures("own_cache")
@pytest.mark.parametrize(
    ("suffix", "spoilt"), [(".json", '{"key": "another"}'), (".choice", '[{"family": "none"}, "made up"]')]
)
def test_a_spoilt_record_is_measured_again(suffix, spoilt):
    wanted = scene(1e-2)
    first = resolve_fidelity(wanted)
    (record,) = cache_folder("choices").glob(f"*{suffix}")
    whole = record.read_text()
    record.write_text(spoilt)
    assert resolve_fidelity(wanted) == first
    assert record.read_text() == whole


def test_a_tolerance_that_nothing_keeps_is_said():
    tight = rod_scene(NITINOL, "arc", None, fidelity={"bending_range": None}, tip_mass=0.02)
    with pytest.raises(cg.SolverError, match="no choice of fidelity meets the tolerance of 1e-08") as caught:
        choose_fidelity(tight, 1e-8)
    assert caught.value.status == "tolerance not reached"
    assert caught.value.result.choice.elements == 16
    assert "leave fidelity.family open" in str(caught.value)


def test_a_choice_is_reported_where_none_was_made():
    with pytest.raises(cg.InputError, match="choose_fidelity"):
        FingerModel(scene(1e-2))
    with pytest.raises(cg.InputError, match="needs a tolerance"):
        choose_fidelity(scene())
    for wrong in (0.0, -1.0, 2.0, "1 %"):
        with pytest.raises(cg.InputError, match=r"tolerance: expected a (number or None|.* above 0 and up to 0\.5)"):
            choose_fidelity(scene(), wrong)
    with pytest.raises(ValueError, match=r"initial\.q: .* give a pose, or fidelity\.family and elements"):
        scene(initial={"q": [0.1, 0.1]}, tolerance=1e-2)


@pytest.mark.parametrize(("share", "chosen"), [(0.999, 2), (1.001, 3)])
def test_the_declared_range_leaves_a_margin_of_a_tenth(share, chosen):
    """Over what the exact rod bends: 1.1 times as much decides between two ranges."""

    class Bent:
        def curvature_reach(self, start, end, moving):
            return share * RANGES[2] / 1.1 / 0.1

    assert _bending_range(scene(), Bent(), (0.1, 0.1)) == RANGES[chosen]


@pytest.mark.parametrize(("share", "substeps"), [(0.999, 4), (1.001, 5)])
def test_the_pace_is_that_of_the_fewest_steps_within_the_tolerance(share, substeps, monkeypatch):
    """Of a motion whose error is known: that of four sub-steps decides."""
    model = cg.FingerModel(cg.Finger(rod=cg.Rod(length=0.2, linear_density=0.03, bending_stiffness=0.006)))

    class Known:
        constant = True

        def __init__(self, *_):
            pass

        def u(self, t):
            return np.zeros((len(t), 1))

        w = u

        def rollout(self, x0, instants, step, *, u, w, substeps):
            off = share * 0.2e-4 / (4.0**-4 - 8.0**-4) * substeps**-4.0
            return np.full((instants + 1, model.nx), off)

        def batch(self, name, q, u, p):
            return q[:, :1] * [0.6, 0.8]

    for name in ("Core", "Signals", "initial_state"):
        monkeypatch.setattr(motion, name, Known)
    monkeypatch.setattr(motion, "timing_of_comparison", lambda scene: cg.Timing(duration=1.0, step=0.01))
    monkeypatch.setattr(motion, "evaluation_ns", lambda model: 1.0)
    assert motion.pace(None, model, 1e-4).steps_per_second == substeps / 0.01
