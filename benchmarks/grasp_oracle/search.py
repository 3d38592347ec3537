"""Best grasp of one finger over all shapes that touch as asked, and what a grasp takes at least."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.grasp_oracle.forces import Balance, Forces
from benchmarks.grasp_oracle.geometry import CLEARANCE, Fingers, Posture
from benchmarks.grasp_oracle.numbers import Limits, Numbers
from benchmarks.grasp_oracle.rod import Array

Measure = Callable[[Posture], float]
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
REFINED = 6
"""Starts of the refinement."""
SLIVERS = 12
"""Shapes of the scan that nearly hold, near which one that holds is sought."""
MANY = 120
"""Planes per cone from which on the search for the least friction begins anew with few."""
DENSE = 31
"""Places of a last scan next to the best."""
NEARLY = 5.0
"""Excess of forces over their limits up to which a shape between two of the scan may keep them all."""
NARROW = 0.15
"""The same of depth (per 2 % of the length), bend and strain, which change less from one shape to the next."""


@dataclass(frozen=True)
class Best:
    """The best found."""

    value: float
    """Of what was aimed at."""
    posture: Posture
    x: Array = field(default_factory=lambda: np.empty(0))
    """Tensions and contact forces [N]."""


Value = Callable[..., Best | None]
"""What a shape is worth, the less the better; None where no forces hold. ``exact``: cut the cones until they hold."""


class Search:
    """All shapes of one finger, scanned once at ``count`` places."""

    def __init__(self, numbers: Numbers, count: int = 180) -> None:
        self.numbers = numbers
        (self.hand,) = numbers.hands
        self.fingers = Fingers(numbers, self.hand)
        self.isolated = self.hand.family == "arc" and self.hand.middle
        self.clearance = CLEARANCE * self.hand.length
        if self.isolated:
            self.postures = self.fingers.arcs()
            self.step = 0.0
        elif self.hand.middle:
            self.postures = self.fingers.clothoids(count)
            self.step = 1.0 / count
        elif self.hand.family == "arc":
            self.postures = self.fingers.free_arcs(2 * count)
            self.step = 4.0 * math.pi / (2 * count - 1)
        else:
            raise ValueError("clothoids that touch with the tip alone have shapes of two parameters")
        self.depths = self.fingers.depth(self.postures) if self.postures else np.empty(0)
        # Single shapes, between those of the scan: the finger touches without force.
        weightless = numbers.lift == 0.0 and not any(numbers.gravity)
        self.unloaded = self.fingers.unloaded() if weightless and self.hand.tip and not self.hand.middle else []
        self._balances: dict[int, tuple[Posture, Balance]] = {}
        self._cuts: dict[str, list[float]] = {}

    # -- measures of a shape -----------------------------------------------------------------------------------

    def strain(self, posture: Posture) -> float:
        """Greatest bending strain of a shape [1], or its curvature times the length where the rod has no radius."""
        return float(np.abs(posture.ends).max()) * (self.hand.radius or self.hand.length)

    def bend(self, posture: Posture) -> float:
        """Greatest bend of an element: its length times its greatest curvature [rad]."""
        return float(np.abs(posture.ends * posture.lengths[:, None]).max())

    def allowed(self, posture: Posture, limits: Limits) -> bool:
        """Whether a shape keeps strain and range."""
        return self.bend(posture) <= limits.bend and (
            math.isinf(limits.strain) or self.strain(posture) <= limits.strain
        )

    def _keeps(self, posture: Posture, limits: Limits) -> bool:
        """Whether a shape keeps depth, strain and range."""
        return self.fingers.depth([posture])[0] <= self.clearance and self.allowed(posture, limits)

    def _good(self, limits: Limits) -> list[Posture]:
        """Shapes of the scan that keep these."""
        pairs = zip(self.postures, self.depths, strict=True)
        return [p for p, deep in pairs if deep <= self.clearance and self.allowed(p, limits)]

    # -- aims ------------------------------------------------------------------------------------------------

    def best(self, aim: str = "sum", numbers: Numbers | None = None, measure: Measure | None = None) -> Best | None:
        """Least of an aim of `Forces.least` over all shapes; None where no shape has forces that hold.

        ``numbers`` is the same scene with other limits; of a ``measure`` of the shape alone the least is sought in
        place of the aim's.
        """
        numbers = numbers or self.numbers
        forces, sign = Forces(numbers), -1.0 if aim == "mass" else 1.0

        def value(posture: Posture, exact: bool = True) -> Best | None:
            found = forces.least(self._balance(posture), aim, exact)
            if found is None:
                return None
            return Best(sign * found[0] if measure is None else measure(posture), posture, found[1])

        if self._too_many():
            return self._at_crossings(numbers)
        best = self._over(value, numbers)
        return None if best is None else replace(best, value=sign * best.value)

    def least_shape(self, measure: Measure) -> float | None:
        """Least of a measure over all shapes that touch and pass through nothing, whatever the forces."""

        def value(posture: Posture, exact: bool = True) -> Best:
            return Best(measure(posture), posture)

        free = self.numbers.limited(strain=math.inf, bend=2.0 * math.pi).limits
        pairs = zip(self.postures, self.depths, strict=True)
        found = sorted((value(p) for p, deep in pairs if deep <= self.clearance), key=lambda best: best.value)
        if not found or self.isolated:
            return found[0].value if found else None
        return min(r.value for start in self._apart(found) for r in self._refined(start.posture, value, free))

    def least_friction(self, numbers: Numbers) -> float:
        """Least friction coefficient with which any shape has forces that hold; infinite without one."""
        needed, held = math.inf, []
        for posture in self._good(numbers.limits):
            if math.isinf(needed) or self._holds(posture, numbers.limited(friction=needed * (1.0 - 1e-6))):
                found = self._friction(posture, numbers, needed)
                if found < needed:
                    needed = found
                    held.append(Best(found, posture))
        if not held or self.isolated:
            return needed
        for start in self._apart(held[::-1]):
            needed = min(needed, self._least_friction_near(start.posture, numbers, needed))
        for _ in range(8):  # until no other shape does with a little less
            other = self.best("sum", numbers.limited(friction=0.997 * needed))
            if other is None:
                break
            needed = min(0.997 * needed, self._least_friction_near(other.posture, numbers, needed))
        return needed

    def _least_friction_near(self, start: Posture, numbers: Numbers, most: float) -> float:
        """Least coefficient on the curve of shapes through one."""
        walked = [start]

        def value(u: float) -> float:
            near = self._from_nearest(walked, u)
            if near is None or not self._keeps(near, numbers.limits):
                return math.inf
            return self._friction(near, numbers, 1.5 * most)

        return _golden(value, start.u - self.step, start.u + self.step, 18)[1]

    def _friction(self, posture: Posture, numbers: Numbers, high: float) -> float:
        """Least coefficient of one shape, by halving."""
        low, top = 0.0, min(high, 16.0)
        if not self._holds(posture, numbers.limited(friction=top)):
            return math.inf
        for _ in range(26):
            middle = 0.5 * (low + top)
            low, top = (low, middle) if self._holds(posture, numbers.limited(friction=middle)) else (middle, top)
            if top - low < 1e-5 * top:
                break
        return top

    def _holds(self, posture: Posture, numbers: Numbers) -> bool:
        if max(map(len, self._cuts.values()), default=0) > MANY:
            self._cuts.clear()
        return Forces(numbers, self._cuts).least(self._balance(posture)) is not None

    def _balance(self, posture: Posture) -> Balance:
        key = id(posture)
        if key not in self._balances:  # the shape is stored too, so that its id stays its own
            self._balances[key] = (posture, Balance(self.numbers, [posture]))
        return self._balances[key][1]

    # -- along the curves of shapes ----------------------------------------------------------------------------

    def _over(self, value: Value, numbers: Numbers) -> Best | None:
        good = self._good(numbers.limits)
        found = [best for posture in good if (best := value(posture, exact=self.isolated)) is not None]
        found.sort(key=lambda best: best.value)
        if self.isolated:
            return found[0] if found else None
        unloaded = (value(posture) for posture in self.unloaded if self._keeps(posture, numbers.limits))
        results = [best for best in unloaded if best is not None]
        starts = [best.posture for best in self._apart(found)]
        for start in starts + self._slivers([best.posture for best in found], numbers):
            results += self._refined(start, value, numbers.limits)
        if not results:
            return None
        best = min(results, key=lambda one: one.value)
        # Where two shapes of a curve merge, walking along it misses the last ones.
        near = best.posture.u + self.step * np.linspace(-0.75, 0.75, DENSE)
        like = best.posture
        for posture in self.fingers.at_places(near, like.side):
            if _alike(posture, like) and self._keeps(posture, numbers.limits):
                got = value(posture)
                best = got if got is not None and got.value < best.value else best
        return best

    def _slivers(self, found: list[Posture], numbers: Numbers) -> list[Posture]:
        """Shapes that hold between places of the scan where none does."""
        forces = Forces(numbers)
        unit = max(numbers.scale, numbers.limits.mass * max(math.hypot(*numbers.gravity), numbers.lift))
        length = self.hand.length

        def excess(posture: Posture, deep: float | None = None) -> float:
            deep = self.fingers.depth([posture])[0] if deep is None else deep
            over = max((deep - self.clearance) / (0.02 * length), self.bend(posture) / numbers.limits.bend - 1.0)
            if math.isfinite(numbers.limits.strain):
                over = max(over, self.strain(posture) / numbers.limits.strain - 1.0)
            if over > NARROW:
                return math.inf
            got = forces.least(self._balance(posture), "slack", exact=False)
            return math.inf if got is None else float(max(over, (got[0] - 1e-9 * unit) / unit))

        known = {id(p) for p in found}
        values = np.array(
            [0.0 if id(p) in known else excess(p, d) for p, d in zip(self.postures, self.depths, strict=True)]
        )
        nearly = [k for k, v in enumerate(values) if 0.0 < v < NEARLY and self._low(k, values)]
        ranked = sorted((Best(values[k], self.postures[k]) for k in nearly), key=lambda best: best.value)
        held = []
        for start in [best.posture for best in self._apart(ranked, SLIVERS)]:
            walked = [start]

            def at(u: float, walked: list[Posture] = walked) -> float:
                near = self._from_nearest(walked, u)
                return math.inf if near is None else excess(near)

            _golden(at, start.u - self.step, start.u + self.step, 26, enough=0.0)
            held += [p for p in walked if excess(p) <= 0.0][:1]
        return held

    def _low(self, k: int, values: Array) -> bool:
        """Whether no neighbor of a shape of the scan has a lower value."""
        p = self.postures[k]
        near = (values[j] for j, q in enumerate(self.postures) if self._neighbors(p, q, 1.5))
        return all(value >= values[k] for value in near)

    def _neighbors(self, p: Posture, q: Posture, steps: float) -> bool:
        """Whether two shapes of one curve are less than so many steps apart."""
        return abs(q.u - p.u) < steps * self.step and q.side == p.side and _alike(p, q)

    def _from_nearest(self, walked: list[Posture], u: float) -> Posture | None:
        """The shape at a place, from the nearest of those known; it is stored with them."""
        like = min(walked, key=lambda p: abs(p.u - u))
        if like.u == u:
            return like
        near = self.fingers.near(like, u)
        if near is not None:
            walked.append(near)
        return near

    def _apart(self, found: list[Best], most: int = REFINED) -> list[Best]:
        """The best, each the best of its neighborhood."""
        chosen: list[Best] = []
        for item in found:
            if not any(self._neighbors(item.posture, one.posture, 4.5) for one in chosen):
                chosen.append(item)
            if len(chosen) == most:
                break
        return chosen

    def _refined(self, start: Posture, value: Value, limits: Limits) -> list[Best]:
        results, walked = [], [start]

        def at(u: float) -> float:
            posture = self._from_nearest(walked, u)
            got = value(posture) if posture is not None and self._keeps(posture, limits) else None
            if got is None:
                return math.inf
            results.append(got)
            return float(got.value)

        places = sorted(start.u + self.step * np.linspace(-1.0, 1.0, 9), key=lambda u: abs(u - start.u))
        best = places[int(np.argmin([at(float(u)) for u in places]))]
        _golden(at, best - 0.25 * self.step, best + 0.25 * self.step, 24)
        return results

    def _too_many(self) -> bool:
        """Whether the forces have more equations than unknowns, so that single shapes of the curve are left."""
        contacts = int(self.hand.middle) + int(self.hand.tip) + len(self.numbers.rests)
        equations = 3 + {"arc": 2, "clothoid": 3, "matched_clothoid": 3}[self.hand.family]
        return 1 + 2 * contacts < equations

    def _excess(self, posture: Posture) -> tuple[float, int]:
        """Signed measure of how far the equations contradict each other; which one is best left out."""
        balance = self._balance(posture)
        lifts = range(balance.first + 2, balance.width, 3)
        planar = [k for k in range(len(balance.rows)) if np.abs(np.delete(balance.rows[k], lifts)).max() > 0]
        columns = [0] + [balance.first + 3 * c + j for c in range(len(balance.touches)) for j in (0, 1)]
        right = balance.right + self.numbers.limits.mass * balance.weight
        square = np.column_stack([balance.rows[np.ix_(planar, columns)], right[planar] / self.numbers.scale])
        left = np.linalg.svd(square[:, :-1])[0][:, -1]
        return float(np.linalg.det(square)), planar[int(np.argmax(np.abs(left)))]

    def _at_crossings(self, numbers: Numbers) -> Best | None:
        """The least sum of tensions where the equations agree."""
        found = []
        forces = Forces(numbers)
        for posture in self._good(numbers.limits):
            ahead = self.fingers.near(posture, posture.u + self.step)
            if ahead is None:
                continue
            low, high = self._excess(posture)[0], self._excess(ahead)[0]
            if (low > 0) == (high > 0):
                continue
            a, b, last = posture.u, ahead.u, posture
            for _ in range(60):
                middle = 0.5 * (a + b)
                between = self.fingers.near(last, middle)
                if between is None:
                    break
                last = between
                a, b = (middle, b) if (self._excess(between)[0] > 0) == (low > 0) else (a, middle)
            if self._keeps(last, numbers.limits):
                got = forces.least(self._balance(last), "sum", drop=(self._excess(last)[1],))
                found += [] if got is None else [Best(got[0], last, got[1])]
        return min(found, key=lambda best: best.value, default=None)


def _alike(p: Posture, q: Posture) -> bool:
    return bool(np.abs(q.ends - p.ends).max() * p.lengths.sum() < 2.0)


def _golden(
    f: Callable[[float], float], low: float, high: float, steps: int, enough: float = -math.inf
) -> tuple[float, float]:
    """Place and value of the least of a function with one valley, infinite values being hills."""
    a, b = low, high
    c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    fc, fd = f(c), f(d)
    middle = f(0.5 * (a + b))
    best = (0.5 * (a + b), middle)
    for _ in range(steps):
        if min(fc, fd, middle) <= enough:
            break
        if fc < fd or (math.isinf(fc) and math.isinf(fd) and best[0] < 0.5 * (a + b)):
            b, d, fd = d, c, fc
            c = b - GOLDEN * (b - a)
            fc = f(c)
        else:
            a, c, fc = c, d, fd
            d = a + GOLDEN * (b - a)
            fd = f(d)
        for place, value in ((c, fc), (d, fd)):
            if value < best[1]:
                best = (place, value)
    return best
