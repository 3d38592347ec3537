"""A controller whose every problem is iterated to convergence.

A real-time iteration is measured against it. It needs the state: an estimator is no part of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.closed_loop.run import run_closed_loop
from continuum_grasp.control.controller import Controller
from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.families import PAPER_FAMILY
from continuum_grasp.scene.simulate import Fidelity

_ITERATIONS = {"sqp_iterations": 20, "start_iterations": 100, "start_calls": 1, "iterations": 100}
"""Linearizations of a period, and of the first one; factorizations of a QP [1]: the most that a scene may ask for."""

_CONVERGED = Consumer(
    "mpc --compare, NMPC to convergence",
    refused={
        "estimator": "NMPC to convergence is given the state: leave the estimator out",
        "controller.scenarios": "NMPC to convergence is for one plant: leave scenarios out",
    },
    unneeded={
        **dict.fromkeys(
            [
                f"controller.{key}"
                for key in ("iterations", "sqp_iterations", "start_calls", "start_iterations", "supervisor")
            ],
            "of the real-time iteration, in whose place every problem is solved to convergence",
        ),
        **dict.fromkeys(("plant.noise", "plant.seed", "plant.delay"), "the state is given exactly, and at once"),
        "name": "a title alone",
    },
)


def converged(scene: ControlScene) -> Controller:
    """Make a controller of a scene without an estimator that has no time limit."""
    _CONVERGED.check(scene)
    settings = {**_ITERATIONS, "supervisor": False}
    return Controller(scene.changed({f"controller.{key}": v for key, v in settings.items()}), deadline=math.inf)


def compared(scene: ControlScene, progress: Callable[[float], None] | None = None) -> dict[str, ControlRun]:
    """Run the closed loops of other controllers; ``progress`` is called with the share that is done.

    ``two arcs``: the same problem on the paper's elements, or as many as there are contacts to part. Then, both given
    the state so that nothing but the solver differs, ``with the state`` and ``converged``.
    """

    def part(k: int) -> Callable[[float], None]:
        return lambda share: progress((k + share) / 3.0) if progress else None

    arcs = Fidelity(family=PAPER_FAMILY, elements=max(2, len(scene.contacts) + 1))
    on_arcs, known = scene.model_copy(update={"fidelity": arcs}), scene.model_copy(update={"estimator": None})
    to_convergence = converged(known)  # first: what it refuses need not wait for two runs
    return {
        "two arcs": run_closed_loop(on_arcs, progress=part(0)),
        "with the state": run_closed_loop(known, progress=part(1)),
        "converged": run_closed_loop(known, controller=to_convergence, progress=part(2)),
    }
