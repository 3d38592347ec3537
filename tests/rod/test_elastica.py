"""The elastica against elliptic integrals, shooting, SciPy's collocation and closed forms; the model against it."""

from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pytest
from scipy import integrate, optimize, special

from continuum_grasp.base import InputError, SolverError
from continuum_grasp.model import FingerModel
from continuum_grasp.rod import solve_elastica
from continuum_grasp.scene import Channel, Curve, ForceLoad, MomentLoad
from continuum_grasp.simulation import equilibrium, interpolate
from tests.closed_forms import rods as closed_forms
from tests.graded_rods import with_profile
from tests.marks import few
from tests.rods import HANGING, HORIZONTAL, UNIT, UPRIGHT, force, order, rod_scene, without_compiler  # noqa: F401

NONE = (0.0, 0.0)


def couple(at, moment):
    """A couple as in a configuration."""
    return {"kind": "moment", "at": at, "moment": moment}


def unit(*loads, gravity=NONE, **keys):
    """A scene with the unit rod."""
    return rod_scene(UNIT, gravity=gravity, loads=list(loads), **keys)


def tip_pose(found):
    """Tip of a rod along +X: across (towards +Y), along, turn."""
    return [found.tip[1], found.tip[0], float(found.angle(1.0)) - HORIZONTAL]


ROD = {"length": 0.6, "linear_density": 0.05, "bending_stiffness": 0.06}
BODY = {"mass": 0.02, "rotary_inertia": 1e-5, "center_of_mass": [0.01, 0.02]}
STOPS = {"curvature": [4.0, 9.0], "stiffness_ratio": 20.0}


def mixed(friction=0.0, follows=True, mirrored=False, elements=2, *, fidelity=None, **finger):
    """Everything at once, on a rod that is not the unit one."""
    m = -1.0 if mirrored else 1.0
    loads = [
        force(0.3, (m * 0.4, -0.3), follows),
        force(0.6, (m * 0.1, -0.2), follows),
        force(0.4125, (m * -0.3, 0.5)),
        couple(0.1875, m * 0.02),
        couple(0.6, m * -0.01),
    ]
    finger = {
        "rest_curvature": {"breaks": [0.15, 0.375], "values": [m * 1.2, m * -0.8, m * 2.0]},
        "masses": [{"at": 0.6, "mass": 0.02}, {"at": 0.225, "mass": 0.05}, {"at": 0.45, "mass": 0.01}],
        "tendons": {"offset": 0.005, "max_tension": 100.0, "friction": friction},
        "base": {"position": [m * 0.3, -0.2], "angle": m * -0.7},
        **finger,
    }
    tensions = [2.0, 9.0] if mirrored else [9.0, 2.0]
    return rod_scene(
        ROD,
        "clothoid",
        elements,
        gravity=(m * 1.2, -9.7),
        loads=loads,
        finger=finger,
        fidelity=fidelity,
        actuation={"tensions": tensions},
    )


def graded(friction=0.0, follows=True, **finger):
    """The same on a rod whose stiffness, density and rest curvature change and jump, one tendon pair ending inside."""
    return with_profile(
        mixed(friction, follows, tip_body=BODY, **finger),
        bending_stiffness=Curve((0.0, 0.25, 0.6), ((0.09, -0.1, 0.2), (0.03, -0.12, 0.2, -0.1))),
        linear_density=Curve((0.0, 0.25, 0.6), ((-2.8, -2.0), (-3.0, 0.0, -3.0, 2.0)), exponential=True),
        rest_curvature=Curve((0.0, 0.15, 0.375, 0.6), ((1.2, -3.0), (-0.8,), (2.0, 0.0, -9.0))),
        channels=[Channel(Curve((0.0, 0.4, 0.6), ((1.0, -1.5), (0.0,))), 0.4, (0.005, -0.005))],
    )


def shot(scene, near):
    """World position of the tip by shooting from the tip to the base; the tip's angle and tension are sought nearby.

    Tendons slid since the loads alone bent the rod, whose shape is that of a rod without friction.
    """
    finger, profile = scene.finger, scene.finger.profile
    tendons, base = finger.tendons, finger.base
    length, g = profile.length, np.array(scene.gravity)
    tensions = scene.actuation.tensions if scene.actuation else (0.0, 0.0)
    pulls = [
        (channel.shape, arm * tension)
        for channel in finger.channels
        for arm, tension in zip(channel.arms, tensions, strict=True)
    ]
    friction, rounding = tendons.friction if tendons else 0.0, 1e-3 / length
    loaded = solve_elastica(scene.model_copy(update={"actuation": None})) if friction else near
    jumps = {0.0, length, *(k.at for k in scene.loads), *(m.at for m in finger.masses)}
    jumps |= {at for channel in finger.channels for at in channel.shape.breaks}
    places = sorted(jumps | set(profile.breaks), reverse=True)

    def at(s, state):
        """Jump of moment and force where something acts."""
        psi = state[0]
        turn = np.array([[math.cos(psi), -math.sin(psi)], [math.sin(psi), math.cos(psi)]])
        if s == length and finger.tip_body is not None:
            arm, weight = turn @ finger.tip_body.center_of_mass, finger.tip_body.mass * g
            state[1] += arm[0] * weight[1] - arm[1] * weight[0]
            state[3:5] += weight
        for load in scene.loads:
            if load.at == s and isinstance(load, ForceLoad):
                state[3:5] += turn @ load.force if load.follows else load.force
            elif load.at == s:
                state[1] += load.moment
        state[3:5] += sum(m.mass for m in finger.masses if m.at == s) * g
        return state

    def rate(s, state, low, tip):
        s, (psi, moment, lost, fx, fy) = max(s, low), state[:5]
        # the tendon on one side slid in and lost tension, that on the other was paid out and has more of it
        pull = sum(amplitude * shape(s) * math.exp(-lost * np.sign(amplitude)) for shape, amplitude in pulls)
        kappa = float(profile.rest_curvature(s) + (moment + pull) / profile.bending_stiffness(s))
        if finger.stops is not None:
            kappa = stopped(kappa, float(profile.rest_curvature(s)), float(finger.stop_curvature(s)))
        t = (-math.sin(psi), math.cos(psi))
        size = kappa**2 / math.hypot(kappa, rounding)
        weight = profile.linear_density(s) * g
        slid = tip - psi - (float(loaded.angle(length)) - float(loaded.angle(s))) if friction else 0.0
        way = slid / math.hypot(slid, 1e-3)
        return [kappa, t[1] * fx - t[0] * fy, friction * way * size, -weight[0], -weight[1], t[0], t[1]]

    def stopped(free, rest, limit):
        """Curvature of a rod with stops that would have another one without."""

        def missing(kappa):
            total = kappa - free
            for sign in finger.stops.signs:
                beyond = sign * kappa - limit
                root = math.hypot(beyond, 0.005 * limit)
                slope = 0.25 * (beyond + root) * (1.0 + beyond / root)  # of half the square of the rounded distance
                total += sign * (finger.stops.stiffness_ratio - 1.0) * slope
            return total

        return optimize.brentq(missing, min(free, rest) - 1e-3, max(free, rest) + 1e-3, xtol=1e-14)

    def base_of(unknown):
        state = np.array([unknown[0], 0.0, unknown[1], 0.0, 0.0, 0.0, 0.0])
        for high, low in itertools.pairwise(places):
            state = at(high, state)
            inside = (low + 1e-8 * length, unknown[0])  # where curves have the values of the side towards the tip
            run = integrate.solve_ivp(
                rate, (high, low), state, "DOP853", args=inside, rtol=1e-13, atol=1e-14, max_step=0.02 * length
            )
            state = run.y[:, -1]
        return state

    def missing(unknown):
        state = base_of(unknown)
        return [state[0] - base.angle, state[2]]

    root = optimize.root(missing, [float(near.angle(length)) + 1e-3, 0.1 * friction], tol=1e-12).x
    assert np.abs(missing(root)).max() < 1e-9
    return np.array(base.position) - base_of(root)[5:]


@pytest.mark.parametrize("load", [1e-3, 0.3, 5.0, 300.0])
def test_the_bent_cantilever_is_that_of_thirty_digits(load):
    pose = closed_forms.bent_by_tip_force(load)
    with mpmath.workdps(40):
        gap = mpmath.mpf(math.pi / 2 - pose.angle)

        def integrals(g):
            m = mpmath.cos(g / 2) ** 2
            start = mpmath.asin(mpmath.sqrt(1 / (2 * m)))
            return mpmath.ellipk(m) - mpmath.ellipf(start, m), mpmath.ellipe(m) - mpmath.ellipe(start, m)

        root = mpmath.sqrt(load)
        bracket = (gap * (1 - mpmath.mpf("1e-6")), gap * (1 + mpmath.mpf("1e-6")))
        gap = mpmath.findroot(lambda g: integrals(g)[0] - root, bracket, solver="anderson")
        across = float(1 - 2 * integrals(gap)[1] / root)
    assert pose.across == pytest.approx(across, abs=1e-12)


@pytest.mark.parametrize("load", [0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 100.0])
def test_tip_force_agrees_with_elliptic_integrals(load):
    found, pose = solve_elastica(unit(force(1.0, (0.0, load)))), closed_forms.bent_by_tip_force(load)
    assert tip_pose(found) == pytest.approx([pose.across, pose.along, pose.angle], abs=1e-12)
    assert found.stable
    assert found.error < 1e-10


@pytest.mark.parametrize("moment", [-0.5, 1.0, 2.0 * math.pi, 15.0])
@pytest.mark.parametrize("source", ["actuation", "couple", "rest"])
def test_end_moment_and_rest_curvature_make_a_circle(moment, source):
    scene = {
        "actuation": lambda: unit(actuation={"tip_moment": moment}),
        "couple": lambda: unit(couple(1.0, moment)),
        "rest": lambda: unit(finger={"rest_curvature": moment}),
    }[source]()
    found, pose = solve_elastica(scene), closed_forms.bent_by_moment(moment)
    assert tip_pose(found) == pytest.approx([pose.across, pose.along, pose.angle], abs=1e-13)
    assert found.elastic_energy == pytest.approx(0.0 if source == "rest" else 0.5 * moment**2, abs=1e-12)
    s = np.linspace(0.0, 1.0, 7)
    center = found.position(s) - [0.0, 1.0 / moment]
    assert np.hypot(*center.T) == pytest.approx(1.0 / abs(moment), abs=1e-13)


@pytest.mark.parametrize("case", ["tip force", "inner force", "couple", "weight"])
def test_small_loads_give_the_formulas_of_beams(case):
    errors = []
    for size in (0.2, 0.1, 0.05):
        scene, pose = {
            "tip force": (unit(force(1.0, (0.0, size))), closed_forms.small_bend_by_force(size)),
            "inner force": (unit(force(0.4, (0.0, size))), closed_forms.small_bend_by_force(size, 0.4)),
            "couple": (unit(couple(0.3, size)), closed_forms.small_bend_by_moment(size, 0.3)),
            "weight": (unit(gravity=(0.0, size)), closed_forms.small_bend_by_weight(size)),
        }[case]
        found = tip_pose(solve_elastica(scene))
        errors.append(abs(found[0] - pose.across))
        assert found[2] == pytest.approx(pose.angle, abs=0.1 * size**2)
    assert np.all(order(errors) > 2.95)


@pytest.mark.parametrize("case", ["Euler", "Greenhill", "Greenhill with tip mass", "tip mass alone"])
@pytest.mark.parametrize("change", [-1e-6, 1e-6])
def test_stability_ends_at_the_critical_load(case, change):
    if case == "Euler":
        load = closed_forms.euler_load(1.0, 1.0)
        scene = unit(force(1.0, (0.0, -load * (1.0 + change))), angle=UPRIGHT)
    else:
        density = 1e-12 if case == "tip mass alone" else 0.7
        mass = 0.0 if case == "Greenhill" else 0.4
        length = closed_forms.greenhill_length(2.0, density, 9.81, tip_mass=mass)
        rod = {"length": length * (1.0 + change), "linear_density": density, "bending_stiffness": 2.0}
        scene = rod_scene(rod, angle=UPRIGHT, tip_mass=mass)
    straight = solve_elastica(scene, stable=False)
    assert straight.stable == (change < 0.0)
    assert abs(straight.margin) < 1e-5
    assert straight.elastic_energy == pytest.approx(0.0, abs=1e-20)


def test_critical_lengths_have_their_known_values():
    zero = special.jn_zeros(0, 1)[0]
    zero = optimize.brentq(lambda x: special.jv(-1.0 / 3.0, x), 1.0, zero)
    assert closed_forms.greenhill_length(1.0, 1.0, 1.0) == pytest.approx(
        (9.0 / 4.0 * zero**2) ** (1.0 / 3.0), rel=1e-13
    )
    assert closed_forms.greenhill_length(1.0, 0.0, 1.0, tip_mass=1.0) == pytest.approx(0.5 * math.pi, rel=1e-13)


@pytest.mark.parametrize("angle", [0.3, 1.5, 2.8])
@pytest.mark.parametrize("side", [1, -1])
def test_a_column_buckles_to_the_side_that_is_asked_for(angle, side):
    load, pose = closed_forms.buckled_column(angle)
    found = solve_elastica(unit(force(1.0, (0.0, -load)), angle=UPRIGHT), side=side)
    assert [-side * found.tip[0], found.tip[1]] == pytest.approx([pose.across, pose.along], abs=1e-11)
    assert side * float(found.angle(1.0)) == pytest.approx(angle, abs=1e-11)
    assert found.stable


@pytest.mark.parametrize("kind", ["callable", "array"])
def test_a_guess_chooses_the_branch(kind):
    """The second buckled shape: three quarter waves, unstable."""
    load, pose = closed_forms.buckled_column(1.0)
    scene = unit(force(1.0, (0.0, -9.0 * load)), angle=UPRIGHT)

    def wave(s):
        return 1.2 * np.sin(1.5 * np.pi * np.asarray(s))

    guess = wave if kind == "callable" else wave(np.linspace(0.0, 1.0, 30))
    second = solve_elastica(scene, guess=guess, stable=False)
    assert second.tip == pytest.approx([-pose.across / 3.0, pose.along], abs=1e-11)
    assert second.stable is False
    first = solve_elastica(scene, guess=guess)
    assert first.stable
    assert first.energy < second.energy
    again = solve_elastica(scene, guess=first.angle)
    assert again.tip == pytest.approx(first.tip, abs=1e-11)


def test_beyond_the_last_load_the_rod_keeps_its_rest_shape():
    scene = unit(force(0.4, (1.0, 9.0)), couple(0.55, 2.0), finger={"rest_curvature": 0.7})
    s = np.linspace(0.55, 1.0, 20)
    assert solve_elastica(scene).curvature(s) == pytest.approx(np.full(20, 0.7), abs=1e-12)


SHOT = {
    "own weight": unit(gravity=(3.0, -12.0), angle=0.4),
    "hanging with a tip mass": unit(gravity=(2.0, -9.81), angle=HANGING, tip_mass=0.8),
    "following across": unit(force(1.0, (6.0, 0.0), True)),
    "following far round": unit(force(1.0, (30.0, 4.0), True)),
    "following inside": unit(force(0.35, (-9.0, -5.0), True), force(0.8, (2.0, 1.0))),
    "beyond a fold": unit(force(1.0, (-4.36, 0.2)), gravity=(0.0, -6.04), angle=-2.85, finger={"rest_curvature": 2.78}),
    "mixed": mixed(),
    "mixed dead": mixed(follows=False),
    "mixed with friction": mixed(friction=0.3),
    "graded": graded(follows=False),
    "graded with friction": graded(friction=0.3),
    "graded with stops": graded(stops=STOPS),
}


@pytest.mark.parametrize("case", few(sorted(SHOT, key=lambda case: "friction" in case), 6))
def test_shooting_arrives_at_the_same_tip(case):
    scene = SHOT[case]
    found = solve_elastica(scene)
    assert found.tip == pytest.approx(shot(scene, found), abs=2e-10 * scene.finger.rod.length)


def test_own_weight_agrees_with_scipys_collocation():
    found, start = solve_elastica(unit(gravity=(0.0, -12.0))), np.linspace(0.0, 1.0, 101)

    def rate(s, y):
        return np.array([y[1], 12.0 * (1.0 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(a, b):
        return np.array([a[0], b[1], a[2], a[3]])

    guess = np.vstack([-start, start - 1.0, start, 0.0 * start])
    run = integrate.solve_bvp(rate, ends, start, guess, tol=1e-10, max_nodes=100000)
    assert run.success
    assert found.tip == pytest.approx(run.y[2:, -1], abs=1e-9)


@pytest.mark.parametrize("case", [mixed, graded])
def test_energy_changes_by_the_displacement_under_the_load(case):
    step, scene = 1e-4, case(follows=False)

    def slope(change):
        high, low = (solve_elastica(scene, extra_loads=change(h), tolerance=1e-12) for h in (step, -step))
        return (high.energy - low.energy) / (2.0 * step)

    found = solve_elastica(scene)
    for axis, along in enumerate(((1.0, 0.0), (0.0, 1.0))):
        for at in (0.6, 0.25):
            moved = slope(lambda h, at=at, along=along: [ForceLoad(at=at, force=(h * along[0], h * along[1]))])
            assert -moved == pytest.approx(found.position(at)[axis], abs=1e-7)
    turned = slope(lambda h: [MomentLoad(at=0.35, moment=h)])
    assert -turned == pytest.approx(float(found.angle(0.35)) + 0.7, abs=1e-6)


def test_energy_is_that_of_its_parts():
    found, s = solve_elastica(unit(gravity=(1.0, -7.0), tip_mass=0.3)), np.linspace(0.0, 1.0, 20001)
    height = integrate.simpson(found.position(s) @ [-1.0, 7.0], x=s) + 0.3 * found.tip @ [-1.0, 7.0]
    elastic = integrate.simpson(0.5 * found.curvature(s) ** 2, x=s)
    assert found.elastic_energy == pytest.approx(elastic, rel=1e-12)
    assert found.energy == pytest.approx(elastic + height, rel=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_the_mirror_image_is_an_equilibrium_of_the_mirrored_scene(friction):
    s = np.linspace(0.0, 0.6, 13)
    one, other = solve_elastica(mixed(friction)), solve_elastica(mixed(friction, mirrored=True))
    assert other.position(s) == pytest.approx(one.position(s) * [-1.0, 1.0], abs=1e-10)
    assert other.curvature(s) == pytest.approx(-one.curvature(s), abs=1e-8)


@pytest.mark.parametrize("case", [*SHOT, "strong", "buckled"])
@pytest.mark.parametrize("tolerance", few([1e-6, 1e-3, 1e-9], 1))
def test_the_estimated_error_bounds_the_error(case, tolerance):
    further = {"strong": unit(force(1.0, (3.0, 200.0))), "buckled": unit(gravity=(0.0, -8.5), angle=UPRIGHT)}
    scene = (SHOT | further)[case]
    exact, found = solve_elastica(scene, tolerance=1e-12), solve_elastica(scene, tolerance=tolerance)
    assert np.abs(found.tip - exact.tip).max() <= found.error + exact.error
    assert found.error <= tolerance * scene.finger.rod.length


@pytest.mark.parametrize("case", ["mixed", "mixed dead", "mixed with friction", "graded", "graded with stops"])
def test_the_derivative_is_exact_and_symmetric_without_following_loads(case):
    equations, rng = solve_elastica(SHOT[case]).equations, np.random.default_rng(1)
    mesh, problem = equations.mesh, equations.problem
    curvature, change = rng.normal(size=(2, mesh.size))
    balance, step = equations.balance(curvature), 1e-5
    sides = [equations.balance(curvature + sign * step * change).missing for sign in (1, -1)]
    assert balance.slope @ change == pytest.approx((sides[0] - sides[1]) / (2 * step), abs=1e-7)
    energies = [equations.energy(curvature + sign * step * change) for sign in (1, -1)]
    weighted = mesh.weights[:, None] * balance.slope
    assert np.allclose(weighted, weighted.T, atol=1e-12) == problem.conservative
    if problem.conservative:
        power = mesh.weights * balance.missing @ change
        assert (energies[0] - energies[1]) / (2 * step) == pytest.approx(power, abs=1e-8)


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
@pytest.mark.parametrize("shift", [0.0, 0.4, 1.3, 2.9, 9.0])
def test_sampled_loads_and_inputs_have_their_values_at_time_zero(interpolation, shift):
    times, values = np.array([0.0, 1.0, 1.7, 3.0]) - shift, [[1.0, 2.0], [4.0, 0.5], [5.0, 1.0], [2.0, 1.5]]
    samples = {"times": times.tolist(), "interpolation": interpolation}
    scene = unit(
        force(1.0, {**samples, "values": values}), actuation={"tip_moment": {**samples, "values": [0, 2, 3, 1]}}
    )
    value = interpolate(scene.loads[0].force, [0.0])[0][0]
    moment = interpolate(scene.actuation.tip_moment, [0.0])[0][0]
    problem = solve_elastica(scene).equations.problem
    assert problem.dead == ((1.0, pytest.approx(complex(*value), rel=1e-14)),)
    assert dict(problem.couples).get(1.0, 0.0) == pytest.approx(moment, rel=1e-14)


@pytest.mark.deep
def test_the_finger_model_agrees_with_the_elastica(without_compiler):  # noqa: F811
    """Clothoids, the short ones over the jumps of curvature that continuous curvatures cannot follow."""
    jumps, half, errors = (0.15, 0.1875, 0.375), 1e-4, []
    edges = [0.0, 0.0375, 0.075, *jumps[:2], 0.225, 0.2625, 0.3, 0.3375, jumps[2], 0.4125, 0.45, 0.525, 0.6]
    for halved in (False, True):
        if halved:
            edges = sorted([*edges, *(0.5 * (a + b) for a, b in itertools.pairwise(edges))])
        split = sorted([*set(edges).difference(jumps), *(at + sign * half for at in jumps for sign in (-1, 1))])
        scene = mixed(elements=np.diff(split).tolist(), fidelity={"accuracy": 1e-10})
        truth, found = solve_elastica(scene), equilibrium(scene)
        backbone = found.backbone(13) - truth.position(np.linspace(0.0, 0.6, 13))
        errors.append(np.abs(backbone).max() / 0.6)
    assert len(found.model.lengths) == 29
    assert errors[0] < 2e-6
    assert errors[1] < 2e-7
    assert order(errors)[0] > 3.2  # 3.4: the short elements, which are not halved, have a share of their own


@pytest.mark.deep
def test_wrong_questions_are_refused():
    scene = unit(force(1.0, (0.0, 1.0)))
    for keys, message in [
        ({"tolerance": 0.0}, "tolerance"),
        ({"side": 2}, "side"),
        ({"guess": [0.0]}, "guess"),
        ({"guess": lambda s: s[:5]}, "guess"),
        ({"guess": [0.0, math.nan]}, "guess"),
        ({"extra_loads": [ForceLoad(at=2.0, force=(1.0, 0.0))]}, r"extra_loads\[0\]"),
    ]:
        with pytest.raises(InputError, match=message):
            solve_elastica(scene, **keys)
    with pytest.raises(InputError, match="lengths"):
        solve_elastica(scene).position(1.001)
    with pytest.raises(SolverError, match="units") as caught:
        solve_elastica(unit(force(1.0, (0.0, 1e9))))
    assert caught.value.status == "resolution limit"


def worst(scene) -> float:
    """Greatest error of the backbone of the scene's model [m]."""
    found, exact = equilibrium(scene), solve_elastica(scene)
    return float(np.hypot(*(found.backbone(101) - exact.position(np.linspace(0.0, 1.0, 101))).T).max())


@pytest.mark.parametrize("at", few([0.35, 0.2, 0.7], 1))
@pytest.mark.parametrize("family", [None, "clothoid", "arc"])
def test_default_elements_serve_loads_within_the_finger(at, family, without_compiler):  # noqa: F811
    """Force and couple each; contacts and couples may coincide. Arcs make the circles of a couple exactly."""
    for load, gain, count in ((force(at, (0.0, 2.0)), 4.0, 2), (couple(at, 1.0), 20.0, 3)):
        if family == "arc" and load["kind"] == "force":
            continue  # the error of two arcs is larger than what a boundary changes
        plain, own = (
            rod_scene(UNIT, family, elements, gravity=NONE, loads=[load], contacts=contacts)
            for elements, contacts in ((2, ()), (None, ()))
        )
        model = FingerModel(own)
        edges = np.cumsum(model.lengths)
        if family == "arc" or load["kind"] == "force":
            assert len(model.lengths) == 2
            assert edges[0] == pytest.approx(at)
        else:
            assert len(model.lengths) == count
            assert edges[:2] == pytest.approx([at - 0.01, at + 0.01])
        assert worst(own) < worst(plain) / gain
    touched = rod_scene(UNIT, family, None, gravity=NONE, loads=[couple(at, 1.0)], contacts=(at,))
    assert worst(touched) < 6e-4
    held = rod_scene(UNIT, family, None, initial={"pose": "equilibrium", "held_by": [force(at, (0.0, 1.0))]})
    heavy = rod_scene(UNIT, family, None, finger={"masses": [{"at": at, "mass": 1.0}]})
    for scene in (held, heavy):
        assert FingerModel(scene).lengths == pytest.approx((at, 1.0 - at))


def test_what_leaves_no_length_for_an_element_makes_none():
    loads = [force(0.01, (0.0, 1.0)), force(0.5, (0.0, 1.0)), force(0.51, (0.0, 1.0)), couple(0.995, 1.0)]
    assert FingerModel(rod_scene(UNIT, None, None, loads=loads)).lengths == pytest.approx((0.5, 0.5))
    many = [force(at, (0.0, 0.01)) for at in np.linspace(0.01, 0.99, 99)]
    lengths = FingerModel(rod_scene(UNIT, None, None, loads=many)).lengths
    assert len(lengths) <= 64
    assert min(lengths) >= 0.02 - 1e-9


@pytest.mark.parametrize("family", ["clothoid", "arc"])
def test_tendon_friction_makes_the_order_two(family, without_compiler):  # noqa: F811
    tendons = {"offset": 0.01, "max_tension": 500.0, "friction": 0.1}
    errors = [
        worst(
            rod_scene(
                UNIT,
                family,
                elements,
                gravity=(0.0, -2.0),
                finger={"tendons": tendons},
                actuation={"tensions": [150.0, 0.0]},
                initial={"pose": "straight", "reached_by": "pulling"},
            )
        )
        for elements in (2, 4, 8)
    ]
    assert np.all(np.abs(order(errors) - 2.0) < 0.2)


@pytest.mark.parametrize("s", [-1e-9, 1.0 + 1e-9])
def test_places_beyond_the_ends_are_refused(s):
    found = solve_elastica(unit())
    assert found.position(np.clip(s, 0.0, 1.0)) == pytest.approx([np.clip(s, 0.0, 1.0), 0.0], abs=1e-9)
    with pytest.raises(InputError, match=r"between 0 and 1\.0 m"):
        found.position(s)
