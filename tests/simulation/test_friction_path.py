"""Friction counts from the unloaded shape along a path: by the capstan law by hand, slow motions, and fine steps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.rod import solve_elastica
from continuum_grasp.simulation import equilibrium_path, equilibrium_under
from tests.marks import few

LENGTH, STIFFNESS, OFFSET, FRICTION = 0.18, 4e-3, 4e-3, 0.35
ROD = {"length": LENGTH, "bending_stiffness": STIFFNESS, "linear_density": 0.03}
S_SHAPE = {"breaks": [LENGTH / 2], "values": [12.0, -16.0]}
PULLED = {"pose": "equilibrium", "reached_by": "pulling"}


def scene(rest, tensions, *, elements=4, initial=None, gravity=(0.0, 0.0), rod=ROD, **keys):
    damping = keys.pop("damping", {"material": 6e-4})
    tendons = {"offset": OFFSET, "max_tension": 60.0, "friction": keys.pop("friction", FRICTION)}
    return cg.Scene(
        finger={"rod": rod, "damping": damping, "rest_curvature": rest, "tendons": tendons, **keys.pop("finger", {})},
        gravity=gravity,
        actuation={"tensions": tensions},
        initial=PULLED if initial is None else initial,
        fidelity={"elements": elements},
        **keys,
    )


def by_hand(rest, tensions, way=1.0):
    """Tip of a rod without loads: the capstan law along it, integrated from the base.

    ``way`` is 1 where the first tendon was pulled, and the other one paid out, since the rod was at rest; else -1.
    """

    def curvature(s):
        return rest if np.isscalar(rest) else rest["values"][int(np.searchsorted(rest["breaks"], s, side="right"))]

    def slope(s, y):
        bent = curvature(s) + OFFSET * (y[1] - y[2]) / STIFFNESS
        lost = way * FRICTION * abs(bent)
        return [bent, -lost * y[1], lost * y[2], -np.sin(y[0]), np.cos(y[0])]

    y = np.array([0.0, *tensions, 0.0, 0.0])
    edges = [0.0, *([] if np.isscalar(rest) else rest["breaks"]), LENGTH]
    for a, b in pairwise(edges):
        inside = b - 1e-12 * LENGTH if b < LENGTH else b  # a jump belongs to what follows
        y = solve_ivp(slope, (a, inside), y, rtol=1e-10, atol=1e-13, max_step=LENGTH / 50).y[:, -1]
    return y[3:]


RESTS = [-14.0, S_SHAPE, -4.0, 6.0, {"breaks": [LENGTH / 2], "values": [-12.0, 16.0]}]


@pytest.mark.parametrize("rest", few(RESTS, 2))
@pytest.mark.parametrize("elements", few([2, 8, 4, 3], 1))
def test_a_preshaped_finger_obeys_the_capstan_law_within_its_stated_error(rest, elements):
    for reached_by, way in (("pulling", 1.0), ("releasing", -1.0)):
        found = cg.equilibrium(
            scene(rest, [9.0, 0.0], elements=elements, initial={"pose": "equilibrium", "reached_by": reached_by})
        )
        off = np.linalg.norm(found.tip - by_hand(rest, [9.0, 0.0], way)) / LENGTH
        assert found.friction_states == pytest.approx(way)
        assert off < max(2.0 * found.space_error, 1e-6)
        assert off < 0.1 / elements**2


def test_mirrored_fingers_bend_to_the_other_side():
    other = {"breaks": S_SHAPE["breaks"], "values": [-v for v in S_SHAPE["values"]]}
    one, mirrored = (cg.equilibrium(scene(*given)).tip for given in ((S_SHAPE, [9.0, 1.0]), (other, [1.0, 9.0])))
    assert mirrored == pytest.approx([-one[0], one[1]], abs=1e-9)
    assert one == pytest.approx(by_hand(S_SHAPE, [9.0, 1.0]), abs=1e-3 * LENGTH)


@pytest.mark.parametrize("rest", [-14.0, S_SHAPE])
def test_the_exact_rod_slides_from_its_shape_at_rest(rest):
    for reached_by, way in (("pulling", 1.0), ("releasing", -1.0)):
        given = scene(rest, [9.0, 1.0], initial={"pose": "equilibrium", "reached_by": reached_by})
        assert solve_elastica(given, tolerance=1e-7).tip == pytest.approx(by_hand(rest, [9.0, 1.0], way), abs=2e-6)


LIFTED = {"gravity": (9.81, 0.0), "rod": {**ROD, "linear_density": 0.2}}
"""A finger that sags to the side on which it is not pulled, by more than it is pulled back."""


def test_a_finger_that_sags_is_pulled_from_where_it_sags():
    """Its tendon slides towards the base though it ends on the other side of its shape at rest, as the rod's does."""
    given = scene(0.0, [1.5, 0.0], elements=8, **LIFTED)
    found, rod = cg.equilibrium(given), solve_elastica(given, tolerance=1e-6)
    assert found.tip[0] > 0.2 * LENGTH
    assert found.friction_states == pytest.approx(1.0)
    assert np.linalg.norm(found.tip - rod.tip) < 1e-3 * LENGTH


TURNS = {
    name: scene(
        -12.32 * side,
        [3.49, 9.42][::side],
        elements=2,
        friction=0.373,
        gravity=(0.0, -24.5),
        finger={"base": {"angle": 0.68 * side}},
        damping={"material": 6e-4, **dry},
    )
    for name, side, dry in (
        ("one way", 1, {}),
        ("mirrored", -1, {}),
        ("dry", 1, {"dry_friction": [{"stiffness": 1e-3, "moment": 2e-3}]}),
    )
}
"""Fingers whose sections slide back before their tensions are reached: one leg alone is wrong by 3e-3 of the length."""


@pytest.mark.parametrize("name", few(TURNS, 1))
def test_pulling_is_a_path_of_many_small_pulls(name):
    """Steps of a tenth, in which what one leg overlooks is small."""
    given = TURNS[name]
    model = cg.FingerModel(given, input_rates=False)
    found = cg.equilibrium(given, model=model)
    steps = [share * found.u for share in np.linspace(0.0, 1.0, 11)]
    small = equilibrium_under(model, found.u, found.w, reached_by="path", path=steps)
    assert found.tip == pytest.approx(small.tip, abs=5e-4 * LENGTH)
    assert found.friction_states == pytest.approx(small.friction_states, abs=0.1)


def test_a_stated_path_is_followed():
    """20 N, then 12 N, and 20 N again, as the factors of a path of equilibria say."""
    through = [{"tensions": [20.0, 0.0]}, {"tensions": [12.0, 0.0]}]
    initial = {"pose": "equilibrium", "reached_by": "path", "path": through}
    found = [cg.equilibrium(scene(-3.0, [tension, 0.0], initial=initial)) for tension in (16.0, 20.0)]
    factors = equilibrium_path(scene(-3.0, [20.0, 0.0]), [1.0, 0.6, 0.8, 1.0])
    assert found[0].tip == pytest.approx(factors[2].tip, abs=1e-9)
    # Return-point memory: at 20 N the inner loop is nearly forgotten.
    assert found[1].tip == pytest.approx(factors[3].tip, abs=1e-4 * LENGTH)
    assert found[1].tip == pytest.approx(factors[0].tip, abs=1e-2 * LENGTH)
    assert np.linalg.norm(factors[2].tip - cg.equilibrium(scene(-3.0, [16.0, 0.0])).tip) > 1e-3 * LENGTH


def test_a_motion_begins_where_its_path_ended():
    through = [{"tensions": ["20 N", 0.0]}]
    initial = {"pose": "equilibrium", "reached_by": "path", "path": through}
    time = {"duration": 0.2, "step": 0.02}
    motion = cg.simulate(scene(-3.0, [12.0, 0.0], elements=2, initial=initial, time=time))
    assert motion.tip == pytest.approx(np.tile(motion.tip[0], (len(motion.t), 1)), abs=1e-5 * LENGTH)


@pytest.mark.parametrize(
    ("initial", "words"),
    [
        ({"reached_by": "path"}, "path and reached_by: path need each other"),
        ({"path": [{"tensions": [1.0, 0.0]}]}, "path and reached_by: path need each other"),
        ({"reached_by": "path", "path": [{"tensions": [1.0]}]}, r"initial.path\[0\].tensions"),
        ({"reached_by": "path", "path": [{"tensions": [1.0, 70.0]}]}, r"initial.path\[0\].tensions\[1\]"),
        ({"reached_by": "path", "path": [{"lengths": [1.0, 0.0]}]}, r"initial.path\[0\].lengths"),
        ({"pose": "rest", "reached_by": "path", "path": [{"tensions": [1.0, 0.0]}]}, "needs pose: equilibrium"),
        (
            {"reached_by": "path", "path": [{"tensions": [{"times": [0, 1], "values": [0, 1]}, 0.0]}]},
            "must be constant",
        ),
    ],
)
def test_paths_that_do_not_fit_are_refused(initial, words):
    with pytest.raises(ValueError, match=words):
        scene(0.0, [5.0, 0.0], initial={"pose": "equilibrium", **initial})


@pytest.mark.parametrize(
    ("drive", "actuation"),
    [
        ({"kind": "length", "time_constant": 0.02, "pretension": 2.0}, {"lengths": [-5e-3]}),
        (
            {"kind": "motor", "winch_radius": 8e-3, "inertia": 2e-6, "torque_max": 0.5, "position_gain": 2.0},
            {"angles": [-0.6]},
        ),
    ],
    ids=["length", "angle"],
)
def test_winches_pull_from_where_the_unloaded_shape_has_them(drive, actuation):
    """A tendon that a preshape of -2.5 rad draws out by 10 mm is pulled by 5 mm at a command of -5 mm."""
    keys = {"offset": OFFSET, "max_tension": 60.0, "axial_stiffness": 1e4, "series_stiffness": 3e4}
    finger = {"rod": ROD, "rest_curvature": -14.0, "tendons": [{**keys, "friction": FRICTION, "drive": drive}]}
    given = cg.Scene(finger=finger, gravity=(0.0, 0.0), actuation=actuation, initial=PULLED, fidelity={"elements": 4})
    found = cg.equilibrium(given)
    assert found.friction_states == pytest.approx(1.0)
    assert found.tip == pytest.approx(by_hand(-14.0, [*found.tensions, 0.0]), abs=5e-4 * LENGTH)


def test_the_exact_rod_names_sections_that_slide_back():
    """Its friction follows from its first and last shape, so that it is no judge of a path that turns."""
    given = TURNS["one way"]
    assert "sections slide back" in solve_elastica(given, tolerance=1e-6).warnings[0]
    assert not solve_elastica(scene(S_SHAPE, [9.0, 1.0]), tolerance=1e-6).warnings
    halves = cg.equilibrium(given.replaced(fidelity={"elements": 4})).tip - cg.equilibrium(given).tip
    assert cg.equilibrium(given).space_error == pytest.approx(np.linalg.norm(halves) / LENGTH, rel=1.0)


def test_the_exact_rod_follows_no_path():
    initial = {"pose": "equilibrium", "reached_by": "path", "path": [{"tensions": [1.0, 0.0]}]}
    with pytest.raises(InputError, match="follows no path"):
        solve_elastica(scene(0.0, [5.0, 0.0], initial=initial))


def random_scene(seed):
    """Preshaped to one side, as an S, or in three parts; graded, dry in bending, with weight and a force, by chance."""
    r = np.random.default_rng(seed)
    stiffness = STIFFNESS * np.exp(r.uniform(-0.5, 0.7))
    side = float(r.choice([-1.0, 1.0]))
    rest = [
        float(r.uniform(-14.0, 14.0)),
        {"breaks": [LENGTH * float(r.uniform(0.3, 0.7))], "values": [side * 12.0, -side * float(r.uniform(4.0, 14.0))]},
        {"breaks": [0.06, 0.12], "values": r.uniform(-12.0, 12.0, 3).tolist()},
    ][int(r.integers(3))]
    rod = {**ROD, "bending_stiffness": stiffness}
    if r.random() < 0.3:
        curves = {
            "bending_stiffness": [2.0 * stiffness, stiffness, 0.6 * stiffness],
            "linear_density": [0.04, 0.03, 0.02],
        }
        rod = {"length": LENGTH, "samples": {"at": [0.0, LENGTH / 2, LENGTH], **curves}}
    damping = {"material": 6e-4}
    if r.random() < 0.4:
        damping["dry_friction"] = [{"stiffness": 0.3 * stiffness, "moment": float(r.uniform(1e-3, 1e-2))}]
    tip = {"kind": "force", "at": LENGTH, "force": r.uniform(-0.1, 0.1, 2).tolist()}
    pulls = [float(r.uniform(2.0, 9.0)), float(r.choice([0.0, r.uniform(0.0, 7.0)]))]
    return pulls[:: int(side)], {
        "rest": rest,
        "elements": int(r.integers(1, 9)),
        "friction": float(r.uniform(0.05, 0.5)),
        "rod": rod,
        "damping": damping,
        "loads": [tip] if r.random() < 0.5 else [],
        "gravity": [(0.0, 0.0), (0.0, -9.81), (9.81, 0.0)][int(r.integers(3))],
        "finger": {"base": {"angle": float(r.uniform(-3.0, 3.0))}},
    }


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(16))
def test_an_equilibrium_is_the_end_of_a_slow_motion(seed):
    pulls, keys = random_scene(seed)
    found = cg.equilibrium(scene(tensions=pulls, **keys))
    # Pulled smoothly: a pull that ends at once overshoots by inertia, and sections slide back.
    rising = [{"times": [0.0, 16.0], "values": [0.0, pull]} for pull in pulls]
    motion = cg.simulate(scene(tensions=rising, **keys, time={"duration": 20.0, "step": 0.05, "tolerance": 1e-6}))
    # Both have the same elements: the path of friction alone could tell them apart.
    assert motion.tip[-1] == pytest.approx(found.tip, abs=5e-5 * LENGTH)


@pytest.mark.deep
@pytest.mark.parametrize("seed", [None, 2, 3, 19, 28, 31])
def test_a_random_loop_takes_as_many_legs_as_it_needs(seed):
    """Sections that slide back, or slide on before they slide back, within a leg: against 24 times as many legs."""
    pulls, keys = ([20.0, 0.0], {"rest": -3.0}) if seed is None else random_scene(seed)
    turns = [0.0, 1.0, 0.4, 0.7, 1.0]
    fine = [0.0, *(share for pair in pairwise(turns) for share in np.linspace(*pair, 25)[1:])]
    given = scene(tensions=pulls, **keys)
    exact = equilibrium_path(given, fine)[::24]
    for found, true in zip(equilibrium_path(given, turns), exact, strict=True):
        assert not [text for text in found.warnings if "friction is rough" in text]
        assert found.tip == pytest.approx(true.tip, abs=5e-5 * LENGTH)
