"""Number of steps of RK4 in a control period: as few as satisfy the tolerance of ``simulate`` in random motions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.learning.environments.plants import Plants, rows_of
from continuum_grasp.addons.learning.environments.sensing import Sensing
from continuum_grasp.base import Array, InputError
from continuum_grasp.scene import INTEGRATORS, Timing

_TOLERANCE: float = Timing.model_fields["tolerance"].default
"""Greatest error of the tip's position that steps in time may leave, per length [1], as ``time.tolerance`` has it."""
_SUBSTEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)
"""Steps of RK4 per period that are tried [1]."""
_PLANTS, _PERIODS, _HELD = 16, 100, 7
"""Plants and periods of the motions that are compared, and how long these hold a random command [1]."""


def check_stiffness(radius: float, period: float) -> None:
    """Refuse a plant whose fastest rate [1/s] is too fast, before anything is compiled."""
    if radius * period > (INTEGRATORS["rk4"].stable or 0.0) * _SUBSTEPS[-1]:
        raise _too_stiff(f"more than {_SUBSTEPS[-1]} steps of RK4 in a period of {period:g} s", radius)


def choose_substeps(plants: Plants, sensing: Sensing, change: Array | float, radius: float) -> tuple[int, float]:
    """Fewest steps per period that satisfy the tolerance, and the error that they leave, per length of the finger.

    ``change`` is the greatest change of a command in a period, ``radius`` the fastest rate [1/s].
    """
    count = len(plants.p)
    chosen = np.resize(np.unique(np.linspace(0, count - 1, min(count, _PLANTS)).astype(int)), _PLANTS)
    length = max(scene.finger.rod.length for scene in plants.scenes)
    low, high = np.array(plants.scenes[0].input_limits)
    commands = np.random.default_rng(0).uniform(low, high, (_PERIODS, _PLANTS, len(low)))
    commands = np.repeat(commands[::_HELD], _HELD, axis=0)
    # From gentle motions to those of the whole range of commands, in which a plant may leave that of its model.
    share = np.linspace(0.1, 1.0, _PLANTS)[:, None]
    rest = plants.model.rest_input
    commands = rest + share * (commands - rest)
    ends: dict[int, Array] = {}
    error = math.inf
    for substeps in _SUBSTEPS:
        for k in (substeps, 2 * substeps):
            if k not in ends:
                ends[k] = _tips(plants, sensing, change, chosen, commands, k)
        coarse = ends[substeps]
        fine = ends[2 * substeps]
        within: NDArray[np.bool_] = np.isfinite(fine[..., 0])
        # Steps that are too long for all plants lose them at once.
        # 0.1: least share of these periods in which plants must be within the range of their model
        if within.mean() >= 0.1 and np.isfinite(coarse[within]).all():
            # Of order 4: 16/15 of the difference to half the step.
            error = 16.0 / 15.0 * float(np.linalg.norm((coarse - fine)[within], axis=1).max()) / length
            if error <= _TOLERANCE:
                return substeps, error
    raise _too_stiff(
        f"more than {_SUBSTEPS[-1]} steps of RK4 in a period of {plants.period:g} s, which leave an error of "
        f"{error:.2g} of the length (expected {_TOLERANCE:g})",
        radius,
    )


def _too_stiff(needs: str, radius: float) -> InputError:
    return InputError(
        f"this plant needs {needs}; its fastest rate is {radius:.3g} 1/s: take fewer elements "
        "({family: matched_clothoid, elements: 2}), a softer contact_law or slower commands, or give substeps",
        key="plant.fidelity",
    )


def _tips(
    plants: Plants,
    sensing: Sensing,
    change: Array | float,
    chosen: NDArray[np.int64],
    commands: Array,
    substeps: int,
) -> Array:
    """Tips (periods, count, 2) [m] of plants under commands; NaN from where one leaves the range of its model."""
    count = len(chosen)
    periods = sensing.periods
    x = plants.start[chosen]
    held = np.tile(plants.model.rest_input, (count, 1))
    p, w = plants.p[chosen], plants.forces[chosen]
    readings = np.zeros((count, periods.sizes["y"]))
    rows = rows_of(plants.setpoints, chosen, np.zeros(count, dtype=np.int64))
    everything = np.tile([-np.inf, np.inf], (x.shape[1], 1)).T.copy()
    tips = np.full((len(commands), count, 2), np.nan)
    lost = np.zeros(count, dtype=np.bool_)
    for k, asked in enumerate(commands):
        u = np.clip(asked, held - change, held + change)
        _, stopped = periods(x, u, held, w, p, rows, everything, readings, substeps, plants.period / substeps)
        lost |= stopped > 0
        tips[k, ~lost] = readings[~lost, -2:]
        x[lost], held = plants.start[chosen][lost], u
    return tips
