"""A plant of one's own: what a controller meets in place of the package's plants."""

from __future__ import annotations

import numpy as np

from continuum_grasp.control import Command


class SlowBench:
    """A bench whose tip follows the commanded tensions like a spring behind a filter: no finger model at all.

    It has what `continuum_grasp.closed_loop.run_hardware` asks of a driver: ``read`` and ``write``.

    Parameters
    ----------
    rest : (ny,) array
        Measurement at rest, in the order of ``controller.measurement_names``.
    share : float
        Share of the way to the commanded tensions that is gone in one period.
    """

    def __init__(self, rest: np.ndarray, share: float = 0.2) -> None:
        self.measured, self.share = np.array(rest, dtype=float), share
        self.commands: list[np.ndarray] = []

    def read(self) -> np.ndarray:
        """Return the newest measurement."""
        return self.measured

    def write(self, command: Command) -> None:
        """Take a command: measured tensions follow it, the tip stays where it is."""
        self.commands.append(np.array(command.u))
        count = len(command.u)
        self.measured[-count:] += self.share * (command.u - self.measured[-count:])
