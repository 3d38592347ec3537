"""Work of the search: what a start may cost, when one is skipped, what each effort tries, as measured on scenes."""

from __future__ import annotations

import math
from dataclasses import dataclass

HELD = 3
"""Grasps from which another scene starts, such as one with stations, or next to which a robust one is sought: of nearby
branches another may be best for it; as many starts, nearest to their constraints, where few elements hold nothing, and
for all limits relaxed at once. Of robust ones with stations, that with one holds after 1.5 s, that with two after 3 s,
that with four does not after 17 s (preshaped)."""
EXCHANGE_CAP, FIRST_CAP = 25, 80
"""Iterations of an exchange of fingers, and of a rough start before there is a grasp, of which it then gets as many as
an exact one, or with limits relaxed, where 98 % of the starts that give a grasp take fewer (50 scenes): from good
starts IPOPT needs a median of 12 and 17 at the 95th percentile (400 random scenes), at most 52 from the best of shipped
scenes and 76 of 36 random ones of several fingers. Beyond 100, of exchanges beyond 25, rounding decides where it ends,
which then differs between a scene and its mirror image."""
PRUNE_FACTOR = 1.5
"""Estimated tension, per that of the best grasp, up to which a start is worth trying: the estimates are no
bounds, and those of rough starts are off by tens of percent."""
SKIP_FACTOR, OPEN = 1.1, 0.02
"""Estimated tension of a basin, per that of the best grasp, up to which it is solved at all, and the part by which it
must be better for the search not to be complete without it; likewise a lower bound. Of 300 scenes of two elements 95 %
of the estimates were less than 4 % above the tension found, 99 % less than 7 %; with four they are 6 times too high in
the median, so that all basins are solved."""
COARSE = 4
"""Elements with which grasps of fingers with more are found first. From there 20 of 22 scenes with eight needed 5
iterations in the median, and none was worse than from a scan of postures."""
PATIENCE, IMPATIENT = 7, 4
"""Iterations that bring a start no nearer to its constraints, after which its run ends, and where there is a grasp of
one finger. Of 256 scenes (one finger, two, parts) none loses its best grasp, which one does with 5 before any grasp,
and others with 3 thereafter, or with 4 for two fingers; a violation that must halve within 10 iterations, whatever it
does meanwhile, loses one, too."""
STANDSTILL = 3
"""Iterations in a row that leave a violation the same, after which a run ends: of runs that give a grasp none of 33 (33
scenes), where 2 lose the best of another, and with limits relaxed 8 of 183 (26 scenes), in half of the iterations."""
WORSE = 1.05
"""Objective, per the least there is, from which on guarded places are not moved any more: they only raise it."""
CLOSEST = 2
"""Starts that are tried in any case: of basins, however far from balance they are, though those of two elements with
more than ``NEARLY_BALANCED`` most likely have no grasp; and with a limit relaxed, or all of them."""
UNLIKELY = 0.2
"""Imbalance with more elements from which on a start is skipped but for the first two: of 68 scanned starts that gave a
grasp (158 scenes of one finger) nine had more than 0.06, and one of them more than 0.13, a second one of its scene; two
thirds of the iterations were spent beyond 0.2 in scenes without a grasp, a sixth in others."""
DOUBTED = 1
"""Rough starts of a set of contacts that lead to nothing better, after which scanned postures of more than two elements
count as the best although some led nowhere: of 111 scenes of one finger two take 9 and 57 % less tension from the first
of these starts; eight find one more, in twice the time."""

SURE, UNFOLLOWED, BALANCED = 1.02, 0.97, 2e-4
"""Tension of a settled exact rod per that of the best grasp up to which it is tried, and from which down a grasp is not
optimal: elements take up to 2 % more or less than exact rods do; residual up to which that rod holds at all."""


@dataclass(frozen=True)
class EffortLimits:
    """Limits of an effort."""

    basins: int  # per set of contacts, that are solved
    starts: int  # rough ones per set of contacts
    iterations: float  # after the first grasp, from which on no start is tried
    always_rough: bool  # whether rough starts are tried where postures are scanned, too
    # Rough starts of one finger's set of contacts that led to nothing better one after the other, after which, with a
    # grasp, no more are tried: of 158 scenes one has its best grasp after 3 of them, none after more.
    in_vain: float
    # Exchanges of a finger between grasps that led to nothing better one after the other, after which no more are
    # tried: of 16 scenes of three fingers three have a better grasp from the first to the fourth, by 9 to 53 %.
    exchanges: int
    settled: int  # exact rods that hold the object from which the fingers' own models start
    places: int  # of an object or a base that may move, at which exact rods are sought


EFFORTS: dict[str, EffortLimits] = {
    "quick": EffortLimits(
        basins=3, starts=2, iterations=150, always_rough=False, in_vain=4, exchanges=3, settled=4, places=1
    ),
    "normal": EffortLimits(
        basins=12,
        starts=8,
        iterations=600,
        always_rough=False,
        in_vain=4,
        exchanges=6,
        settled=8,
        places=3,
    ),
    "thorough": EffortLimits(
        basins=12,
        starts=24,
        iterations=math.inf,
        always_rough=True,
        in_vain=math.inf,
        exchanges=24,
        settled=24,
        places=10,
    ),
}
"""Limits of each effort. Of 1,000 scenes of one finger 95 % take less than 140 iterations."""
