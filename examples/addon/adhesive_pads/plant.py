"""A plant of your own: what a controller meets instead of the plants of the package."""

from __future__ import annotations

import numpy as np

from continuum_grasp.control import Command


class SlowBench:
    """A bench whose tensions follow the commands through a filter; its tip does not move. It has no finger model.

    Parameters
    ----------
    rest : (ny,) array
        Measurement at rest, in the order and units of ``controller.measurement_names``.
    share : float
        Share of the way to the commanded tensions that the bench covers in one period [1].
    """

    def __init__(self, rest: np.ndarray, share: float = 0.2) -> None:
        self.measured, self.share = np.array(rest, dtype=float), share
        self.commands: list[np.ndarray] = []

    def read(self) -> np.ndarray:
        """Return the newest measurement."""
        return self.measured

    def write(self, command: Command) -> None:
        """Take a command: the measured tensions follow it."""
        self.commands.append(np.array(command.u))
        count = len(command.u)
        self.measured[-count:] += self.share * (command.u - self.measured[-count:])
