"""Slack and overload of tendons that winches and motors wind up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.scene import Finger, Tendon

_SLACK = 1e-7
"""Tension below which a tendon is slack, per ``max_tension`` [1]."""


def least_pull(tendon: Tendon) -> float:
    """Tension below which a tendon is slack [N]."""
    return _SLACK * tendon.max_tension


@dataclass(frozen=True)
class SlackTime:
    """A period with a slack tendon: it does not pull, and its friction forgets its past.

    Attributes
    ----------
    tendon : int
        Number of the tendon, from 1.
    begins, ends : float
        First slack instant, and first instant in tension after it [s]; infinite if the tendon stays slack.
    """

    tendon: int
    begins: float
    ends: float


def slack_times(finger: Finger, t: ArrayLike, tensions: ArrayLike) -> list[SlackTime]:
    """Return the slack periods of tendons, by tendon and instant, from tensions (T, tendons) at the drives [N]."""
    instants = np.asarray(t, dtype=float)
    times = list[SlackTime]()
    for k, tension in enumerate(np.asarray(tensions, dtype=float).T):
        slack = np.concatenate([[False], tension < least_pull(finger.tendon_list[k]), [False]])
        starts = np.flatnonzero(np.diff(slack.astype(int)) > 0)
        stops = np.flatnonzero(np.diff(slack.astype(int)) < 0)
        after = [*instants.tolist(), np.inf]
        times += [SlackTime(k + 1, after[a], after[b]) for a, b in zip(starts, stops, strict=True)]
    return times


def tension_warnings(finger: Finger, t: NDArray[np.float64], tensions: NDArray[np.float64] | None) -> tuple[str, ...]:
    """Warnings about tensions (T, tendons) [N] that winches and motors leave to the motion."""
    if tensions is None or not finger.winches:
        return ()
    warnings = []
    times = slack_times(finger, t, tensions)
    for k, tendon in enumerate(finger.tendon_list):
        tension = tensions[:, k]
        high = np.flatnonzero(tension > tendon.max_tension)
        if high.size:
            warnings.append(
                f"tendon {k + 1} exceeds max_tension = {tendon.max_tension:g} N at t = {t[high[0]]:g} s (greatest: "
                f"{tension.max():.3g} N)"
            )
        # One that is slack from the start on, as drives may leave it, does not go slack.
        begun = [each for each in times if each.tendon == k + 1 and each.begins > t[0]]
        if begun:
            again = f" until t = {begun[0].ends:g} s" if np.isfinite(begun[0].ends) else ""
            often = f" ({len(begun)} times in all)" if len(begun) > 1 else ""
            warnings.append(
                f"tendon {k + 1} goes slack at t = {begun[0].begins:g} s: nothing pulls there{again}{often}"
            )
    return tuple(warnings)
