"""Motions that are hard to follow, against SciPy's integration under error control of what a model says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from itertools import pairwise, product
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.hard_cases import (
    FAMILIES,
    GRAVITY,
    LENGTH,
    MASS,
    REFUSED,
    RIGHT,
    WARNED,
    Attempt,
    Found,
    coordinates,
    nitinol,
    push,
)
from continuum_grasp.base import Array
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Samples, Scene, VectorSamples
from continuum_grasp.simulation import Signals, Trajectory, initial_state, integrate, modes
from tests.rods import HANGING, UPRIGHT

METHODS = ("auto", "rk4", "rodas", "reference")
Make = Callable[[str], Scene]
Measure = Callable[[Trajectory], float]


def moved(scene: Scene, method: str, measure: Measure) -> Found:
    """Simulate a scene, and measure the error."""
    timing = scene.time.model_copy(update={"method": method})
    path = integrate(scene.model_copy(update={"time": timing}))
    steps = (len(path.t) - 1) * int(path.statistics["substeps"])
    return Found(measure(path), steps, path.warnings)


def tip_error(path: Trajectory, wide: bool = False) -> float:
    """Greatest error of the tip against the truth, per length: of the same model, or ``wide`` of the same elements
    evaluated to rounding over six times the range.
    """
    scene = _timeless(path.scene)
    if wide:
        scene = scene.changed({"fidelity.bending_range": 6.0, "fidelity.accuracy": 1e-13})
    true = Trajectory(path.t, true_states(scene), path.u, path.w, FingerModel(scene), scene)
    return float(np.hypot(*(path.tip - true.tip).T).max() / LENGTH)


def state_error(path: Trajectory) -> float:
    """Greatest error of the coordinates against the truth, per greatest coordinate."""
    true = true_states(_timeless(path.scene), 1e-20)[:, : path.n]
    return float(np.abs(path.q - true).max() / np.abs(true).max())


def _timeless(scene: Scene) -> Scene:
    """The scene without the method, so that all methods share one truth."""
    return scene.model_copy(update={"time": scene.time.model_copy(update={"method": "auto"})})


def straightness(path: Trajectory, along: tuple[float, float]) -> float:
    """Greatest distance of the tip from where a straight finger has it, per length."""
    return float(np.hypot(*(path.tip / LENGTH - np.array(along)).T).max())


def energy_drift(path: Trajectory, least: float) -> float:
    """Greatest change of energy, per energy of the motion above the equilibrium's."""
    total = path.kinetic + path.potential
    return float(np.abs(total - total[0]).max() / (total[0] - least))


# Truth.


def _rate(scene: Scene, model: FingerModel) -> Callable[[float, Array], Array]:
    """State derivative of a model in its scene, on CasADi's virtual machine."""
    signals, (buffer, evaluate) = Signals(scene, model), model.forward_dynamics.buffer()
    given = [np.zeros(model.nx), signals.u(0.0)[0], signals.w(0.0)[0], np.array(model.p_nominal)]
    found = np.zeros(model.nx)
    for k, array in enumerate(given):
        if array.size:
            buffer.set_arg(k, memoryview(array))
    buffer.set_res(0, memoryview(found))

    def rate(t: float, x: Array, _: Any = buffer) -> Array:  # which has to live as long
        given[0][:] = x
        if not signals.constant:
            given[1][:], given[2][:] = signals.u(t)[0], signals.w(t)[0]
        evaluate()
        return found.copy()

    return rate


@lru_cache(maxsize=64)
def true_states(scene: Scene, smallest: float = 1e-13) -> Array:
    """States (T, nx) at the output instants of a scene; integration starts anew at every instant of a sampled load."""
    model, time = FingerModel(scene), scene.time
    rate, x = _rate(scene, model), initial_state(scene, model)
    instants = np.linspace(0.0, time.duration, round(time.duration / time.step) + 1)
    states, edges = [x], [0.0, *_corners(scene, time.duration), time.duration]
    for begin, end in pairwise(edges):
        within = instants[(instants > begin) & (instants <= end)]
        wanted = within if len(within) and within[-1] == end else np.append(within, end)
        done = solve_ivp(rate, (begin, end), x, "DOP853", t_eval=wanted, rtol=1e-11, atol=smallest)
        if not done.success:
            raise RuntimeError(f"no truth: {done.message}")
        x = done.y[:, -1]
        states += list(done.y.T[: len(within)])
    return np.array(states)


def _corners(scene: Scene, duration: float) -> list[float]:
    """Instants within the motion at which sampled loads and inputs turn."""
    actuation = scene.actuation
    inputs = (actuation.tensions or (actuation.tip_moment,)) if actuation is not None else ()
    loads = (load.force if load.kind == "force" else load.moment for load in scene.loads)
    times = {t for v in (*inputs, *loads) if isinstance(v, Samples | VectorSamples) for t in v.times}
    return sorted(t for t in times if 0.0 < t < duration)


# Scenes.


def nearly_straight(family: str) -> Scene:
    """Bends of 1e-6 rad; far above the reference's absolute tolerance of 1e-12."""
    q = coordinates(family, (1e-6, -0.5e-6), (0.3, 0.3))
    return nitinol(family, initial={"q": q}, time={"duration": 0.1, "step": 1e-4})


def _released(
    family: str, elements: Any = 2, *, tip_mass: float = 0.0, pull: Any = (0.1, 0.0), duration: float = 0.2
) -> Scene:
    """Hanging, pulled at the tip and let go."""
    initial = {"pose": "equilibrium", "held_by": [push(*pull)]}
    time = {"duration": duration, "step": 0.001}
    return nitinol(family, elements, angle=HANGING, gravity=GRAVITY, tip_mass=tip_mass, initial=initial, time=time)


def swinging(family: str, periods: int) -> Scene:
    """Undamped swing in the first mode, 50 states per period."""
    scene = _released(family, tip_mass=0.02)
    period = 1.0 / float(modes(scene.replaced(initial={"pose": "straight"})).frequencies_hz[0])
    step = round(period / 50, 6)
    return scene.replaced(time=scene.time.replaced(duration=round(50 * periods * step, 9), step=step))


def reversed_contact(family: str, rise: float) -> Scene:
    """A contact force of 0.5 N that is turned round within ``rise`` seconds."""
    force = {"times": [0.0, 0.1, 0.1 + rise, 1.0], "values": [[0.0, 0.5], [0.0, 0.5], [0.0, -0.5], [0.0, -0.5]]}
    load = {"kind": "force", "at": 0.3, "force": {**force, "interpolation": "linear"}}
    keys = {"contacts": [0.3], "loads": [load], "time": {"duration": 0.3, "step": 0.001}}
    return nitinol(family, damping=1e-4, tip_mass=0.01, bending_range=3.0, **keys)


def tension_step(family: str, rise: float, interpolation: str = "linear", lag: float | None = None) -> Scene:
    """The tension goes from its least to its greatest value within ``rise`` seconds."""
    pulled = {"times": [0.0, 0.05, 0.05 + rise], "values": [0.0, 0.0, 40.0], "interpolation": interpolation}
    tendons = {"offset": 0.005, "max_tension": 40.0, "time_constant": lag}
    return nitinol(
        family,
        damping=1e-4,
        tip_mass=0.01,
        bending_range=4.0,
        finger={"tendons": tendons},
        actuation={"tensions": [pulled, 0.0]},
        time={"duration": 0.3, "step": 0.001},
    )


# Attempts.


def motion_attempts() -> Iterator[Attempt]:
    """All attempts at motions."""
    still = partial(straightness, along=(1.0, 0.0))
    straight = partial(nitinol, time={"duration": 0.5, "step": 0.01})
    yield from _all("straight exactly", straight, still, 1e-15)
    standing = partial(nitinol, angle=UPRIGHT, gravity=GRAVITY, tip_mass=0.1, time={"duration": 1.0, "step": 0.01})
    yield from _all("standing exactly, beyond buckling", standing, partial(straightness, along=(0.0, 1.0)), 1e-15)
    yield from _all("nearly straight, 1e-6 rad", nearly_straight, state_error, 1e-4)
    unequal = (0.594, 0.006)
    released = partial(_released, elements=unequal, tip_mass=0.02)
    yield from _all("one element 1 % of the other", released, tip_error, 1e-4)
    released = partial(_released, elements=unequal, duration=0.05)
    yield from _all("light short tip, 30 kHz", released, tip_error, 1e-4)
    released = partial(_released, tip_mass=100 * MASS, pull=(6.0, 0.0), duration=1.0)
    yield from _all("100-fold tip mass", released, tip_error, 1e-4)
    for family in FAMILIES:
        scene = swinging(family, 1000)
        least = _least_energy(scene)
        for method in METHODS:
            run = partial(moved, scene, method, partial(energy_drift, least=least))
            yield Attempt("1,000 periods without damping: energy", family, method, run, 0.01, _fixed(method))
    for rise, words in ((1e-3, "in 1 ms"), (2e-9, "in 2 ns")):
        make = partial(reversed_contact, rise=rise)
        sudden = None if rise == 1e-3 else dict.fromkeys(FAMILIES, (WARNED,))
        yield from _all(f"contact force reversed {words}", make, tip_error, 1e-3, sudden)
    kinks = {"arc": (WARNED,), "clothoid": (WARNED,), "matched_clothoid": (REFUSED,)}
    yield from _all("tension 0 to 40 N in 2 ns", partial(tension_step, rise=2e-9), tip_error, 1e-2, kinks)
    smooth = partial(tension_step, rise=0.02, interpolation="smooth")
    yield from _all("tension 0 to 40 N in 20 ms", smooth, tip_error, 1e-3)
    lagged = partial(tension_step, rise=1e-3, lag=5e-3)
    yield from _all("tension 0 to 40 N in 1 ms, lag of 5 ms", lagged, tip_error, 1e-3)
    yield from _beyond_the_range()


def _all(
    case: str, make: Make, measure: Measure, limit: float, expected: dict[str, tuple[str, ...]] | None = None
) -> Iterator[Attempt]:
    for family, method in product(FAMILIES, METHODS):
        verdicts = (expected or {}).get(family, _fixed(method))
        yield Attempt(case, family, method, partial(_made, make, family, method, measure), limit, verdicts)


def _fixed(method: str) -> tuple[str, ...]:
    """Steps of a given length may leave more than ``time.tolerance``, and say so."""
    return (RIGHT, WARNED) if method in ("rk4", "rodas") else (RIGHT,)


def _made(make: Make, family: str, method: str, measure: Measure) -> Found:
    return moved(make(family), method, measure)


def _least_energy(scene: Scene) -> float:
    """Potential energy of the hanging finger at rest [J]."""
    model = FingerModel(scene)
    return float(model.energy(np.zeros(model.nx), np.zeros(model.nu), model.p_nominal)[1])


def _beyond_the_range() -> Iterator[Attempt]:
    """A start bent to the range and beyond it, and let go."""
    for share in (1.0, 1.2, 2.9, 3.1):
        for family in FAMILIES:
            run = partial(_made, partial(_bent, share=share), family, "auto", partial(tip_error, wide=True))
            yield Attempt(f"let go at {share:g} times the range", family, "auto", run, 1e-3, (RIGHT, WARNED))


def _bent(family: str, share: float) -> Scene:
    reach = 1.0
    q = coordinates(family, (share * reach, share * reach), (0.3, 0.3))
    time = {"duration": 0.2, "step": 0.001}
    return nitinol(family, bending_range=reach, damping=1e-3, tip_mass=0.02, initial={"q": q}, time=time)
