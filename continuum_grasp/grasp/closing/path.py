"""The way into a grasp: fingers close quasi-statically from the open posture, meet the object and slide along it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from continuum_grasp import nlp
from continuum_grasp.arguments import check_arguments
from continuum_grasp.arrays import Array
from continuum_grasp.grasp.certificate.check import PENETRATION
from continuum_grasp.grasp.closing.energy import Closing, Sight, Sliding
from continuum_grasp.grasp.closing.result import ClosingPath, ClosingStatus
from continuum_grasp.grasp.closing.verdict import SNAPS, Ending, Step
from continuum_grasp.scene.grasp import ON_A_TABLE, GraspScene

_STICK, _PASSES = 1e-4, 2
"""Slip of a step up to which friction is not full, per length, and solutions of a step, each with the normal forces of
the one before: a step moves places by some percent."""
_HALVINGS = 5
"""Number of times that a step is halved that the solver cannot take."""
_OPENINGS = 10
"""Tensions of the opening tendons that are tried: tenths of their limits."""


@check_arguments
def closing_path(
    scene: GraspScene, arrays: Mapping[str, Any], *, steps: int = 40, table_friction: float | None = None
) -> ClosingPath:
    """Close the fingers of a grasp from their open posture, and see whether they end in it.

    All tensions grow together, from none to those of the grasp. Where unloaded fingers lie in the object they are first
    opened by the other tendons. Fingers touch the object and the supports, and pass through each other; tendons have no
    friction here.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping of str to ndarray
        A grasp of it, as `GraspResult` stores it.
    steps : int, optional
        Steps from no tension to that of the grasp.
    table_friction : float, optional
        Friction coefficient of the table that the object stands on and may slide on, where gravity is out of the plane;
        None: the object is held, and the path says how rough the table would have to be.

    Returns
    -------
    ClosingPath

    Raises
    ------
    InputError
        The object cannot be free.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.grasp import closing_path
    >>> grasp = cg.optimize_grasp("configs/grasp/mug.yaml")
    >>> path = closing_path(grasp.scene, grasp.arrays)
    >>> path.status.value, [f"{touch.station:.2f}" for touch in path.touches][:1]
    ('reached', ['0.06'])
    """
    ON_A_TABLE.check(scene, of={"closing.table_friction": "" if table_friction is None else "table_friction"})
    return _Walk(Closing(scene, arrays, table_friction), arrays, steps).path()


class _Walk:
    """Goes from the open posture to the tensions of the grasp."""

    def __init__(self, closing: Closing, arrays: Mapping[str, Array], steps: int) -> None:
        self.closing, self.arrays, self.steps = closing, arrays, steps
        self.full = np.concatenate([np.asarray(arrays[f"{f.name}.tensions"], dtype=float) for f in closing.fingers])
        self.opening = np.zeros_like(self.full)  # tensions at share -1
        self.taken: list[Step] = []

    def path(self) -> ClosingPath:
        """The whole path, as far as it goes."""
        begin = self._open()
        if begin is None:
            return self._ended(ClosingStatus.NOT_OPEN)
        shares = [*np.linspace(begin, 0.0, max(2, round(-begin * self.steps)) + 1)[1:-1]] if begin < 0.0 else []
        for share in [*shares, *np.linspace(0.0, 1.0, self.steps + 1)]:
            if share > begin and not self._advance(float(share)):
                return self._ended(ClosingStatus.STOPPED)
        return self._ended(None)

    def tensions(self, share: float) -> Array:
        """Tensions of all fingers in a row at a share."""
        return share * self.full if share >= 0.0 else -share * self.opening

    def _open(self) -> float | None:
        """Begin beside the object: unloaded, or with as little tension of the other tendons as that takes."""
        closing = self.closing
        for k, finger in enumerate(closing.fingers):
            used, tendons = finger.setup.finger.tendons_used, finger.setup.finger.tendon_list
            # The tendon that pulls less in the grasp is the one that opens.
            other = int(np.argmin(self.full[2 * k : 2 * k + 2]))
            if used in ("both", ("left", "right")[other]):
                self.opening[2 * k + other] = tendons[other].max_tension
        x, m = np.zeros(closing.problem.x.numel()), len(closing.pairs)
        if closing.free:
            x[-3:] = closing.grasped / closing.scale
        none = Sliding(np.zeros(m), np.zeros((2, m)), np.zeros((2, m)), np.zeros(m), _STICK)
        for share in np.linspace(0.0, -1.0, _OPENINGS + 1):
            held = closing.solve(self.tensions(share), none, closing.grasped, x, None, True)
            sight = closing.found(held.x, closing.grasped)
            self._deepest = float(sight.gaps.min(initial=0.0))
            if held.converged and self._deepest > -PENETRATION * closing.length:
                self._keep(float(share), held, sight, none)
                return float(share)
        return None

    def _keep(self, share: float, attempt: nlp.Attempt, sight: Sight, sliding: Sliding) -> None:
        slid = self.closing.slip(sight, sliding.tangents, sliding.at) - sliding.past
        friction = -sliding.forces * slid / np.hypot(slid, sliding.stick * self.closing.length)
        # The first shape was found through everything: nothing presses there.
        first = not self.taken
        normal = np.zeros(len(slid)) if first else self.closing.pressed(attempt)
        self._multipliers = None if first else attempt.multipliers
        self.taken.append(Step(share, self.tensions(share), attempt.x, sight, normal, friction))

    def _advance(self, share: float, halvings: int = 0) -> bool:
        """Take a step to a share, in halves where it cannot be taken at once."""
        closing, before = self.closing, self.taken[-1]
        pressed, start, near = before.normal, before.x, self._multipliers
        for _ in range(_PASSES):
            sliding = closing.sliding(before.sight, pressed, _STICK)
            attempt = closing.solve(self.tensions(share), sliding, before.sight.pose, start, near, False)
            if not attempt.converged:
                break
            pressed, start, near = closing.pressed(attempt), attempt.x, attempt.multipliers
        sight = closing.found(attempt.x, before.sight.pose)
        far = np.linalg.norm(sight.lines - before.sight.lines, axis=0).max() > SNAPS * closing.length
        # A jump may be the solver's: a finger that snaps does so in steps of any size.
        if halvings < _HALVINGS and (far or not attempt.converged):
            middle = 0.5 * (before.share + share)
            return self._advance(middle, halvings + 1) and self._advance(share, halvings + 1)
        if attempt.converged:
            self._keep(share, attempt, sight, sliding)
        return attempt.converged

    def _ended(self, status: ClosingStatus | None) -> ClosingPath:
        """Verdict from the steps taken; ``status`` where it stands already."""
        return Ending(self.closing, self.arrays, self.taken, self._deepest).path(status)
