"""Other controllers on the same plant: the paper's two arcs, and NMPC solved to convergence."""

from __future__ import annotations

from collections.abc import Callable

from continuum_grasp.closed_loop.converged import Converged
from continuum_grasp.closed_loop.result import ControlRun
from continuum_grasp.closed_loop.run import run_closed_loop
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.families import PAPER_FAMILY
from continuum_grasp.scene.simulate import Fidelity

__all__ = ["compared", "on_arcs", "with_state"]


def on_arcs(scene: ControlScene) -> ControlScene:
    """The same scene with a controller that knows the paper's two arcs, or as many as there are contacts to part."""
    fidelity = Fidelity(family=PAPER_FAMILY, elements=max(2, len(scene.contacts) + 1))
    return scene.model_copy(update={"fidelity": fidelity})


def with_state(scene: ControlScene) -> ControlScene:
    """The same scene with a controller that is given its state instead of measurements."""
    return scene.model_copy(update={"estimator": None})


def compared(scene: ControlScene, progress: Callable[[float], None] | None = None) -> dict[str, ControlRun]:
    """Closed loops of other controllers.

    Parameters
    ----------
    scene : ControlScene
        The scene.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    dict of str to ControlRun
        ``two arcs``: the same problem on the paper's elements. Then, both given the state so that nothing but the
        solver differs, ``with the state`` and ``converged``.
    """
    tell = progress or (lambda share: None)

    def part(k: int) -> Callable[[float], None]:
        return lambda share: tell((k + share) / 3.0)

    known = with_state(scene)
    return {
        "two arcs": run_closed_loop(on_arcs(scene), progress=part(0)),
        "with the state": run_closed_loop(known, progress=part(1)),
        "converged": run_closed_loop(known, controller=Converged(known), progress=part(2)),
    }
