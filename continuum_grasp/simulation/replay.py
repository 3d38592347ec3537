"""Inputs of a plan or a closed loop as a scene to simulate."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Actuation, CommandedScene, Samples, Scene, Timing

_PARTS = 4
"""Number of samples of a lagging tip moment within an interval that is no longer than the lag [1].

The tip of test_a_plan_is_simulated_under_its_own_inputs was off by 2e-4 of the length with 1, by 8e-6 with 4, and by
2e-4 with 8: sub-steps then meet the quintics where these have no acceleration."""
_AFTER = 1e-9
"""Time after which the first input acts [s], the least between samples: drives begin at the input before the motion."""


def scene_under(
    scene: CommandedScene, t: ArrayLike, u: ArrayLike, *, plant: Scene | None = None, linear: bool = False
) -> Scene:
    """Return a scene for simulation under inputs (N, nu), or (N + 1, nu), at instants t (N + 1,) [s].

    Inputs are constant from one instant to the next, or ``linear`` in between. Drives begin like the scene's, at the
    input before the motion. Output steps are the equal intervals. ``plant`` replaces the finger of the scene.
    """
    plain = plant or scene.simulated
    finger = scene.finger
    instants = np.asarray(t, dtype=float)
    duration = float(instants[-1] - instants[0])
    count = len(instants) - 1
    if not count:
        raise InputError("the motion has only one instant")
    least, most = ([getattr(each, side) for each in finger.inputs] for side in ("least", "most"))
    rows = np.clip(np.asarray(u, dtype=float), least, most)
    if len(rows) < len(instants):
        rows = np.vstack([rows, rows[-1:]])
    before = np.array(scene.initial_input)
    kind: Literal["smooth", "linear", "hold"] = "linear" if linear else "hold"
    if "tip_moment" in finger.input_keys and scene.lag is not None:
        instants, rows, kind = *_lagging(instants, rows, float(before[0]), scene.lag, linear), "smooth"
    elif not linear:
        instants = np.insert(instants, 1, instants[0] + _AFTER)
        rows = np.vstack([before, rows])
    times = tuple(instants.tolist())
    columns = [Samples(times=times, values=tuple(column), interpolation=kind) for column in rows.T.tolist()]
    timing = Timing(duration=duration, step=duration / count)
    replayed = plain.replaced(actuation=Actuation.of(finger.input_keys, columns), time=timing)
    if replayed.fidelity.elements is not None or replayed.fidelity.tolerance is not None:
        return replayed
    # The inputs were chosen for these elements.
    return replayed.replaced(fidelity=replayed.fidelity.replaced(elements=FingerModel(plain).lengths))


def _lagging(t: Array, u: Array, before: float, lag: float, linear: bool) -> tuple[Array, Array]:
    """Instants (M,) and moments (M, 1) of a drive 1/(T s + 1)^2 that rests at first, under commands (N + 1, 1)."""
    from scipy.signal import StateSpace, lsim

    drive = StateSpace([[0.0, 1.0], [-1.0 / lag**2, -2.0 / lag]], [[0.0], [1.0 / lag**2]], [[1.0, 0.0]], [[0.0]])
    state = np.array([before, 0.0])
    times = [t[0]]
    moments = [before]
    parts = max(_PARTS, math.ceil(float(np.diff(t).max()) / lag))
    for k in range(len(t) - 1):
        within = np.linspace(0.0, t[k + 1] - t[k], parts + 1)
        command = np.linspace(u[k, 0], u[k + 1, 0] if linear else u[k, 0], parts + 1)
        _, moment, states = lsim(drive, command, within, state)
        state = states[-1]
        times += (t[k] + within[1:]).tolist()
        moments += np.ravel(moment)[1:].tolist()
    return np.array(times), np.array(moments)[:, None]
