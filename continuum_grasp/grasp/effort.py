"""Work of the search: what a start may cost, when one is skipped, what each effort tries, as measured on scenes."""

from __future__ import annotations

from dataclasses import dataclass

from continuum_grasp.grasp.certificate.space import CREEPS

LEAST_IN_SPACE = 1.05 * CREEPS
"""Least eigenvalue of motions out of the plane that is asked for where an unstable grasp is made stable [E I / L]: more
than the search's tolerance can undo."""
LINKS = 12
"""Links of the chains whose least eigenvalue is differentiated for that."""
HELD = 3
"""Grasps from which another scene starts, such as one with stations, or next to which a robust one is sought: of nearby
branches another may be best for it. Of robust ones with stations, that
with one holds after 1.5 s, that with two after 3 s, that with four does not after 17 s (preshaped)."""
FIRST_CAP = 80
"""Iterations of a start, or with limits relaxed, where 98 % of the starts that give a grasp take fewer (50 scenes):
from good starts IPOPT needs a median of 12 and 17 at the 95th percentile (400 random scenes), at most 52 from the best
of shipped scenes and 76 of 36 random ones of several fingers. Beyond 100 rounding decides where it ends, which then
differs between a scene and its mirror image."""
OPEN = 0.02
"""Part by which a start must be better for the search not to be complete without it; likewise a lower bound."""
PATIENCE = 7
"""Iterations that bring a start no nearer to its constraints with limits relaxed, after which its run ends. Of 256
scenes (one finger, two, parts) none loses its best grasp, which one does with 5 before any grasp; a violation that must
halve within 10 iterations, whatever it does meanwhile, loses one, too."""
STANDSTILL = 3
"""Iterations in a row that leave a violation the same, after which a run ends: of runs that give a grasp none of 33 (33
scenes), where 2 lose the best of another, and with limits relaxed 8 of 183 (26 scenes), in half of the iterations."""
CLOSEST = 2
"""Starts that are tried in any case with limits relaxed; as many more where these give no grasp."""

SURE, UNFOLLOWED, BALANCED = 1.02, 0.97, 1e-5
"""Tension of a settled exact rod per tension of the best grasp up to which it is tried, and from which down a grasp is
not optimal: elements take up to 2 % more or less than exact rods do; residual up to which that rod holds at all: with
2e-5 the tension of some is 15 % too low."""


@dataclass(frozen=True)
class EffortLimits:
    """Limits of an effort."""

    settled: int  # fingers that hold the object, or nearly do, from which their models start
    places: int  # of an object or a base that may move, at which these are sought


EFFORTS: dict[str, EffortLimits] = {
    "quick": EffortLimits(settled=4, places=1),
    "normal": EffortLimits(settled=8, places=5),
    "thorough": EffortLimits(settled=24, places=10),
}
"""Limits of each effort."""
