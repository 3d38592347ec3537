"""Wrong laws of stiffness and damping are reported, right ones are not: data of other equations than the package's."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.stats

import continuum_grasp as cg
from continuum_grasp.identification import Poses, Reading, fit_damped_sine
from continuum_grasp.identification.blocks import Block, Entry
from continuum_grasp.identification.laws import _change, _trend, doubts_of_laws
from continuum_grasp.identification.problem import Problem
from tests.identification_cases import ROD, STIFFNESS
from tests.marks import few
from tests.rods import rod_scene

PULSATION = 20.0
"""Of the oscillator [rad/s]."""


def oscillation(linear: float, dry: float, drag: float) -> tuple[np.ndarray, np.ndarray]:
    """Swings of an oscillator, by short steps: x'' = -w^2 x - 2 w (linear) v - w^2 (dry) z - drag |v| v.

    z is a spring in series with a slider: it follows x, within +- 1 mm.
    """
    steps, last = 20_000, 2.0
    h, x, v, z, path = last / steps, 0.03, 0.0, 1e-3, []
    for k in range(steps):
        if k % 100 == 0:
            path.append(x)
        force = -(PULSATION**2) * (x + dry * z) - 2.0 * PULSATION * linear * v - drag * abs(v) * v
        v += h * force
        x += h * v
        z = min(max(z + h * v, -1e-3), 1e-3)
    return np.arange(len(path)) * 100 * h, np.array(path)


class Moved(Block):
    """A path that is predicted by the best damped sine, as a linear model would."""

    moves = True

    def __init__(self, t: np.ndarray, x: np.ndarray) -> None:
        self.name = "release"
        self.entries = [
            Entry("", "positions", "m", value, True, None, at, "x of tip") for at, value in zip(t, x, strict=True)
        ]
        sine = fit_damped_sine(t, x)
        turning = (-sine.decay_rate + 2j * np.pi * sine.frequency) * t
        basis = np.exp(turning)[:, None].view(float)
        self.predicted = basis @ np.linalg.lstsq(basis, x, rcond=None)[0]


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ({"linear": 0.03, "dry": 0.0, "drag": 0.0}, None),
        ({"linear": 0.01, "dry": 2.0, "drag": 0.0}, "dry friction"),
        ({"linear": 0.005, "dry": 0.0, "drag": 8.0}, "drag of the air"),
    ],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_damping_that_depends_on_the_amplitude_is_reported(law, words, seed):
    t, x = oscillation(**law)
    block = Moved(t, x + 2e-5 * np.random.default_rng(seed).standard_normal(x.size))
    found = [one for one in doubts_of_laws(Problem([block], [], "squares"), block.predicted) if "damping" in one]
    assert bool(found) == (words is not None)
    assert all(words in one for one in found)


@pytest.mark.parametrize("noise", [1e-4, 1e-3])
@pytest.mark.parametrize("seeds", few([15, 300], 1))
def test_noise_alone_makes_no_law_wrong_and_does_not_hide_a_drag(seeds, noise):
    """At most one false alarm in a hundred; nine of ten drags are noticed."""
    for law, least, most in (({"linear": 0.03, "drag": 0.0}, 0.0, 0.01), ({"linear": 0.005, "drag": 12.0}, 0.9, 1.0)):
        t, x = oscillation(dry=0.0, **law)
        found = 0
        for seed in range(seeds):
            block = Moved(t, x + noise * np.random.default_rng(seed).standard_normal(x.size))
            found += bool(doubts_of_laws(Problem([block], [], "squares"), block.predicted))
        assert least * seeds <= found <= most * seeds


@pytest.mark.parametrize(("share", "reported"), [(0.999, False), (1.001, True)])
@pytest.mark.parametrize("noise", [0, 40])
def test_a_trend_is_sure_from_student_s_t_on(share, reported, noise):
    """Ten points whose deviations are one, or estimated; t is that which two in a thousand exceed."""
    x, ones = np.linspace(-1.0, 1.0, 10), np.ones((10, 1))
    rest = np.where(np.arange(10) % 4 % 3 == 0, 1.0, -1.0)
    basis = np.linalg.qr(np.stack([ones[:, 0], x], axis=1))[0]
    rest -= basis @ (basis.T @ rest)
    freedom = noise or 8
    rest *= np.sqrt(8.0 if not noise else 4.0) / np.linalg.norm(rest)
    slope = share * scipy.stats.t.isf(1e-3, freedom) / np.linalg.norm(x)
    assert (_trend([(x, slope * x + rest, ones)], noise) is not None) == reported


@pytest.mark.parametrize(("share", "reported"), [(0.999, False), (1.001, True)])
def test_a_change_matters_from_a_tenth_on(share, reported):
    x = 1e3 * np.linspace(0.0, 1.0, 6)
    found = _change([(x, -share * 1e-4 * x, np.ones((6, 1)))], 1e3, 0)
    assert (found is not None) == reported


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda m: 8.0 * m, None),
        (lambda m: 8.0 * m + 20.0 * m**2, "softens where"),
        (lambda m: 8.0 * m - 20.0 * m**2, "stiffens where"),
        (lambda m: 8.0 * m + 0.05 * np.sign(np.gradient(m)), "the direction of loading, by 0.1"),
    ],
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stiffness_and_memory_of_shapes_at_rest(make, words, side):
    """Bends over moments, there and back, with noise of half a percent; of a mirrored finger the same is reported."""
    moments = 0.1 * np.concatenate([np.linspace(0.0, 1.0, 12), np.linspace(0.95, 0.0, 12)])
    bends = side * (make(moments) + 4e-3 * np.random.default_rng(1).standard_normal(moments.size))
    moments = side * moments
    scene = rod_scene(ROD, "arc", 2, gravity=(0.0, 0.0))
    fit = cg.identify(scene, Poses([Reading("bend", bends)], {"tip_moment": moments}), parameters=["bending_stiffness"])
    warnings = [one for one in fit.warnings if "law" in one or "memory" in one]
    assert len(warnings) == (words is not None)
    assert all(words in one for one in warnings)


@pytest.mark.parametrize("softening", [None, {"curvature": 0.5, "stiffness_ratio": 0.5}])
def test_a_wrong_law_of_stiffness_is_the_one_in_use(softening):
    """Bends that grow more slowly than the moment: a finger that softens bends less than so, as a linear one does."""
    moments = np.linspace(0.0, 0.1, 14)
    bends = 8.0 * moments - 20.0 * moments**2
    scene = rod_scene(ROD, "arc", 2, gravity=(0.0, 0.0), finger={"softening": softening})
    fit = cg.identify(scene, Poses([Reading("bend", bends)], {"tip_moment": moments}), parameters=["bending_stiffness"])
    (found,) = [one for one in fit.warnings if "law of stiffness" in one]
    assert "stiffens where" in found
    assert ("a linear law" in found) == (softening is None)
    assert ("with softening" in found) == (softening is not None)


def test_the_bend_of_one_joint():
    """Between two sections: moment times length over stiffness."""
    scene = rod_scene(ROD, "arc", 4, gravity=(0.0, 0.0))
    moments = np.array([0.02, 0.05])
    bends = moments * 0.15 / STIFFNESS
    poses = Poses([Reading("bend", bends, at=0.25, since=0.1)], {"tip_moment": moments})
    fit = cg.identify(scene, poses, parameters=["bending_stiffness"])
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-8)
