"""Motion as SciPy integrates it, step by step under error control, from what a model says of the accelerations."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Samples, Scene, VectorSamples
from continuum_grasp.simulation.initial import initial_state
from continuum_grasp.simulation.signals import Signals

Array = NDArray[np.float64]


class Rate:
    """State derivative of a model in its scene, on the virtual machine."""

    def __init__(self, scene: Scene, model: FingerModel) -> None:
        self._signals = Signals(scene, model)
        self._constant = self._signals.constant
        self._buffer, self._evaluate = model.forward_dynamics.buffer()
        self._in = [np.zeros(model.nx), self._signals.u(0.0)[0], self._signals.w(0.0)[0], np.array(model.p_nominal)]
        self._out = np.zeros(model.nx)
        for k, array in enumerate(self._in):
            if array.size:
                self._buffer.set_arg(k, memoryview(array))
        self._buffer.set_res(0, memoryview(self._out))

    def __call__(self, t: float, x: Array) -> Array:
        self._in[0][:] = x
        if not self._constant:
            self._in[1][:] = self._signals.u(t)[0]
            self._in[2][:] = self._signals.w(t)[0]
        self._evaluate()
        return self._out.copy()


@lru_cache(maxsize=64)
def true_states(scene: Scene, method: str = "DOP853", relative: float = 1e-11, smallest: float = 1e-13) -> Array:
    """States (T, nx) at the output instants of a scene; integration starts anew at every instant of a sampled load."""
    model, time = FingerModel(scene), scene.time
    if time is None:
        raise ValueError("a motion needs time")
    rate, x = Rate(scene, model), initial_state(scene, model)
    instants = np.linspace(0.0, time.duration, round(time.duration / time.step) + 1)
    states, edges = [x], [0.0, *_corners(scene, time.duration), time.duration]
    for begin, end in pairwise(edges):
        within = instants[(instants > begin) & (instants <= end)]
        wanted = within if len(within) and within[-1] == end else np.append(within, end)
        done = solve_ivp(rate, (begin, end), x, method, t_eval=wanted, rtol=relative, atol=smallest)
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
