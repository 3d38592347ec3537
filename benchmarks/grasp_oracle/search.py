"""Best grasp of one finger over all shapes that touch as asked, and what a grasp takes at least."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.grasp_oracle.forces import Balance, Forces
from benchmarks.grasp_oracle.geometry import CLEARANCE, Fingers, Posture
from benchmarks.grasp_oracle.numbers import Numbers
from benchmarks.grasp_oracle.rod import Array

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
    """The best found.

    Attributes
    ----------
    value : float
        Of what was aimed at.
    posture : Posture
    x : ndarray
        Tensions and contact forces [N].
    """

    value: float
    posture: Posture
    x: Array


class Search:
    """All shapes of one finger, scanned once.

    Parameters
    ----------
    numbers : Numbers
    count : int
        Places of the scan.
    """

    def __init__(self, numbers: Numbers, count: int = 180) -> None:
        self.numbers = numbers
        (self.hand,) = numbers.hands
        self.fingers = Fingers(numbers, self.hand)
        self.isolated = self.hand.family == "arc" and self.hand.middle
        self.count = count
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

    def allowed(self, posture: Posture, limits: Any) -> bool:
        """Whether a shape keeps strain and range."""
        return self.bend(posture) <= limits.bend and (
            math.isinf(limits.strain) or self.strain(posture) <= limits.strain
        )

    def _good(self, numbers: Numbers, clearance: float) -> list[Posture]:
        """Shapes of the scan that keep strain, range and depth."""
        pairs = zip(self.postures, self.depths, strict=True)
        return [p for p, deep in pairs if deep <= clearance and self.allowed(p, numbers.limits)]

    # -- aims ------------------------------------------------------------------------------------------------

    def best(self, aim: str = "sum", numbers: Numbers | None = None) -> Best | None:
        """Least of an aim of `Forces.least` over all shapes; None where no shape has forces that hold.

        Parameters
        ----------
        aim : str
        numbers : Numbers, optional
            The same scene with other limits.
        """
        numbers = numbers or self.numbers
        forces = Forces(numbers)
        sign = -1.0 if aim == "mass" else 1.0
        clearance = CLEARANCE * self.hand.length

        def value(posture: Posture, exact: bool = True) -> tuple[float, Array] | None:
            found = forces.least(self._balance(posture), aim, exact)
            return None if found is None else (sign * found[0], found[1])

        return self._over(self._good(numbers, clearance), value, numbers, clearance, sign)

    def least_measure(self, measure: Callable[[Posture], float], numbers: Numbers) -> Best | None:
        """Least of a measure of the shape alone (strain, bend) over all shapes with forces that hold within limits."""
        forces = Forces(numbers)

        def value(posture: Posture, exact: bool = True) -> tuple[float, Array] | None:
            found = forces.least(self._balance(posture), "sum", exact)
            return None if found is None else (measure(posture), found[1])

        clearance = CLEARANCE * self.hand.length
        return self._over(self._good(numbers, clearance), value, numbers, clearance, 1.0)

    def least_shape(self, measure: Callable[[Posture], float]) -> float | None:
        """Least of a measure over all shapes that touch and pass through nothing, whatever the forces."""

        def value(posture: Posture, exact: bool = True) -> tuple[float, Array]:
            return measure(posture), np.empty(0)

        clearance, free = CLEARANCE * self.hand.length, self.numbers.limited(strain=math.inf, bend=2.0 * math.pi)
        pairs = zip(self.postures, self.depths, strict=True)
        found = [(measure(posture), posture, None) for posture, deep in pairs if deep <= clearance]
        found.sort(key=lambda f: f[0])
        if not found or self.isolated:
            return found[0][0] if found else None
        refined = [r for _, start, _ in self._apart(found) for r in self._refined(start, value, free, clearance)]
        return float(min(r[0] for r in refined))

    def least_friction(self, numbers: Numbers) -> float:
        """Least friction coefficient with which any shape has forces that hold; infinite without one."""
        needed, held = math.inf, []
        for posture in self._good(numbers, CLEARANCE * self.hand.length):
            if math.isinf(needed) or self._holds(posture, numbers.limited(friction=needed * (1.0 - 1e-6))):
                found = self._friction(posture, numbers, needed)
                if found < needed:
                    needed = found
                    held.append((found, posture, None))
        if not held or self.isolated:
            return needed
        for _, start, _ in self._apart(held[::-1]):
            needed = min(needed, self._least_friction_near(start, numbers, needed))
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
            if near is None or self.fingers.depth([near])[0] > CLEARANCE * self.hand.length:
                return math.inf
            return self._friction(near, numbers, 1.5 * most) if self.allowed(near, numbers.limits) else math.inf

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

    def _over(self, good: list[Posture], value: Any, numbers: Numbers, clearance: float, sign: float) -> Best | None:
        if self._too_many():
            return self._at_crossings(good, value, numbers, clearance, sign)
        found = []
        for posture in good:
            got = value(posture, exact=self.isolated)
            if got is not None:
                found.append((got[0], posture, got[1]))
        found.sort(key=lambda f: f[0])
        if self.isolated:
            return Best(sign * found[0][0], found[0][1], found[0][2]) if found else None
        results = []
        for posture in self.unloaded:
            if self.fingers.depth([posture])[0] <= clearance and self.allowed(posture, numbers.limits):
                got = value(posture)
                if got is not None:
                    results.append((got[0], posture, got[1]))
        for _, start, _ in self._apart(found):
            results += self._refined(start, value, numbers, clearance)
        for start in self._slivers([f[1] for f in found], numbers, clearance):
            results += self._refined(start, value, numbers, clearance)
        if not results:
            return None
        best = min(results, key=lambda r: r[0])
        # Where two shapes of a curve merge, walking along it misses the last ones.
        near = best[1].u + self.step * np.linspace(-0.75, 0.75, DENSE)
        again = [p for p in self.fingers.at_places(near, best[1].side) if _alike(p, best[1])]
        for posture in again:
            if self.fingers.depth([posture])[0] <= clearance and self.allowed(posture, numbers.limits):
                got = value(posture)
                if got is not None and got[0] < best[0]:
                    best = (got[0], posture, got[1])
        return Best(sign * best[0], best[1], best[2])

    def _slivers(self, found: list[Posture], numbers: Numbers, clearance: float) -> list[Posture]:
        """Shapes that hold between places of the scan where none does."""
        forces = Forces(numbers)
        unit = max(numbers.scale, numbers.limits.mass * max(math.hypot(*numbers.gravity), numbers.lift))
        length = self.hand.length

        def excess(posture: Posture, deep: float | None = None) -> float:
            deep = self.fingers.depth([posture])[0] if deep is None else deep
            over = max((deep - clearance) / (0.02 * length), self.bend(posture) / numbers.limits.bend - 1.0)
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
        ranked = [
            (v, self.postures[k], None) for k, v in enumerate(values) if 0.0 < v < NEARLY and self._low(k, values)
        ]
        ranked.sort(key=lambda r: r[0])
        held = []
        for _, start, _ in self._apart(ranked, SLIVERS):
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
        return all(
            values[j] >= values[k]
            for j, q in enumerate(self.postures)
            if abs(q.u - p.u) < 1.5 * self.step and q.side == p.side and _alike(p, q)
        )

    def _from_nearest(self, walked: list[Posture], u: float) -> Posture | None:
        """The shape at a place, from the nearest of those known; it is stored with them."""
        like = min(walked, key=lambda p: abs(p.u - u))
        if like.u == u:
            return like
        near = self.fingers.near(like, u)
        if near is not None:
            walked.append(near)
        return near

    def _apart(self, found: list[Any], most: int = REFINED) -> list[Any]:
        """The best, each the best of its neighborhood."""
        chosen: list[Any] = []
        for item in found:
            p = item[1]
            near = (abs(q.u - p.u) < 4.5 * self.step and q.side == p.side and _alike(p, q) for _, q, _ in chosen)
            if not any(near):
                chosen.append(item)
            if len(chosen) == most:
                break
        return chosen

    def _refined(self, start: Posture, value: Any, numbers: Numbers, clearance: float) -> list[Any]:
        results, walked = [], [start]

        def at(u: float) -> float:
            posture = self._from_nearest(walked, u)
            if (
                posture is None
                or self.fingers.depth([posture])[0] > clearance
                or not self.allowed(posture, numbers.limits)
            ):
                return math.inf
            got = value(posture)
            if got is None:
                return math.inf
            results.append((got[0], posture, got[1]))
            return float(got[0])

        places = start.u + self.step * np.linspace(-1.0, 1.0, 9)
        values = [at(float(u)) for u in sorted(places, key=lambda u: abs(u - start.u))]
        best = sorted(places, key=lambda u: abs(u - start.u))[int(np.argmin(values))]
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
        planar = [k for k in range(len(balance.rows)) if np.abs(np.delete(balance.rows[k], _lifts(balance))).max() > 0]
        columns = [0] + [balance.first + 3 * c + j for c in range(len(balance.touches)) for j in (0, 1)]
        right = balance.right + self.numbers.limits.mass * balance.weight
        square = np.column_stack([balance.rows[np.ix_(planar, columns)], right[planar] / self.numbers.scale])
        left = np.linalg.svd(square[:, :-1])[0][:, -1]
        return float(np.linalg.det(square)), planar[int(np.argmax(np.abs(left)))]

    def _at_crossings(
        self, good: list[Posture], value: Any, numbers: Numbers, clearance: float, sign: float
    ) -> Best | None:
        found = []
        forces = Forces(numbers)
        for posture in good:
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
            if self.fingers.depth([last])[0] > clearance or not self.allowed(last, numbers.limits):
                continue
            got = forces.least(self._balance(last), "sum", drop=(self._excess(last)[1],))
            if got is not None:
                found.append((sign * got[0], last, got[1]))
        if not found:
            return None
        best = min(found, key=lambda f: f[0])
        return Best(sign * best[0], best[1], best[2])


def _alike(p: Posture, q: Posture) -> bool:
    return bool(np.abs(q.ends - p.ends).max() * p.lengths.sum() < 2.0)


def _lifts(balance: Balance) -> list[int]:
    return [balance.first + 3 * c + 2 for c in range(len(balance.touches))]


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
