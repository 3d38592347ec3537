"""Tendons with friction, exactly: a chain of many hinges with a guide at each, by complementarity.

It shares nothing with the package. Between two guides a tendon is elastic; at a guide it sticks, or slides at the
capstan limit against the direction of its sliding; at the drum it is slack where it would have to push. Shapes at rest
follow from each other: what the friction is depends on all before.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

MOST = 60
"""Newton steps from one shape to the next."""


@dataclass
class HingedFinger:
    """A straight elastic finger, clamped, without weight; hinges are in the middle of equal parts.

    ``sides`` are those of its tendons, +1 for one that bends positively. ``bends``: hinges; ``losses``: ln of the
    tension before a guide over that after it, per tendon and guide; ``slid``: how far a tendon has slid at a guide
    towards the base [m].
    """

    length: float
    stiffness: float  # [N m2]
    offset: float
    friction: float
    sides: tuple[float, ...] = (1.0, -1.0)
    axial_stiffness: float = 1e4  # [N]
    series_compliance: float = 3e-5  # [m/N]
    hinges: int = 80
    couple: float = 0.0  # at the tip [N m]
    pushes: tuple[tuple[float, float, float, float], ...] = ()
    """Further loads along it: position [m], force across and along the base's axes [N], couple [N m]."""
    branches: tuple[tuple[float, float], ...] = ()
    """Dry friction in bending: stiffness [N m2] and moment [N m] of stops, which every hinge has."""
    bends: np.ndarray = field(init=False)
    losses: np.ndarray = field(init=False)
    slid: np.ndarray = field(init=False)
    tensions: np.ndarray = field(init=False)  # at the drum [N]
    stops: np.ndarray = field(init=False)  # moments of the stops (branches, hinges) [N m]

    def __post_init__(self) -> None:
        self.bends = np.zeros(self.hinges)
        self.losses = np.zeros((len(self.sides), self.hinges))
        self._slides = np.zeros_like(self.losses)
        self.slid, self.tensions = np.zeros_like(self.losses), np.zeros(len(self.sides))
        self.stops = np.zeros((len(self.branches), self.hinges))

    @property
    def angle(self) -> float:
        """Of the tip [rad]."""
        return float(self.bends.sum())

    @property
    def tip(self) -> np.ndarray:
        """Position of the tip (2,) [m], from the base, which points along y."""
        return self._points(self.bends)[:, -1]

    def _points(self, bends):
        """Hinges and the tip (2, N + 1, ...)."""
        h = self.length / self.hinges
        angle = np.cumsum(bends, axis=0)
        ways = np.stack([-np.sin(angle), np.cos(angle)]) * h
        ways[:, -1] *= 0.5
        start = np.zeros_like(ways[:, :1])
        start[1] = 0.5 * h
        return np.concatenate([start, start + np.cumsum(ways, axis=1)], axis=1)

    def _state(self, bends, losses, drums):
        """Tensions at the drum (J, ...), in the middle of guides (J, N, ...), and how far all has slid."""
        h, e = self.length / self.hinges, self.offset
        after = np.exp(-np.cumsum(losses, axis=1))
        middle = after * np.exp(0.5 * losses)
        tensions, slid = [], []
        for j, side in enumerate(self.sides):
            kind, value = drums[j]
            drawn = h * after[j] / self.axial_stiffness
            drawn[-1] *= 0.5
            if kind == "tension":
                tension = value + 0.0 * bends[0]
            else:
                given = 0.5 * h / self.axial_stiffness + drawn.sum(axis=0) + self.series_compliance
                wound = value - side * e * bends.sum(axis=0)
                tension = np.where(wound.real > 0.0, wound / given, 0.0 * wound)
            tensions.append(tension)
            beyond = np.flip(np.cumsum(np.flip(bends, 0), axis=0), 0) - 0.5 * bends
            elastic = np.flip(np.cumsum(np.flip(drawn, 0), axis=0), 0) * tension
            slid.append(side * e * beyond + elastic)
        return np.array(tensions), np.array(tensions)[:, None] * middle, np.array(slid)

    def _missing(self, unknowns, drums, force, slides):
        n, count = self.hinges, len(self.sides)
        bends = unknowns[:n]
        losses = unknowns[n:].reshape((count, n, *unknowns.shape[1:]))
        _, middle, slid = self._state(bends, losses, drums)
        signs = np.array(self.sides).reshape((-1, *([1] * (middle.ndim - 1))))
        moment = self.offset * (signs * middle).sum(axis=0)
        points = self._points(bends)
        arms = points[:, -1:] - points[:, :-1]
        moment = moment + arms[0] * force[1] - arms[1] * force[0] + self.couple
        for at, fx, fy, couple in self.pushes:
            hinge = int(at * n / self.length - 0.5)  # the last one before it
            part = (at * n / self.length - 0.5 - hinge) * (2.0 if hinge == n - 1 else 1.0)  # half a part to the tip
            x, y = points[:, hinge] + part * (points[:, hinge + 1] - points[:, hinge])
            before = np.arange(n).reshape((-1, *([1] * (moment.ndim - 1)))) <= hinge
            moment = moment + before * ((x - points[0, :-1]) * fy - (y - points[1, :-1]) * fx + couple)
        balance = bends * (self.stiffness * self.hinges / self.length) - moment
        balance = balance + self._stopped(bends).sum(axis=0)
        # Where a guide slides, the capstan limit; elsewhere the tendon stays where it was.
        shape = (count, n, *([1] * (slid.ndim - 2)))
        limit, way = self.friction * bends * np.sign(bends.real), slides.reshape(shape)
        stuck = (slid - self.slid.reshape(shape)) / self.offset
        held = np.where(way == 0.0, stuck, losses - way * limit)
        guides = held.reshape(unknowns.shape[0] - n, *unknowns.shape[1:])
        return np.concatenate([balance * (self.length / self.stiffness), guides])

    def _stopped(self, bends):
        """Moments of the stops (branches, N, ...) after going from the shape at hand to other bends."""
        column = (-1, *([1] * (bends.ndim - 1)))
        moments = np.zeros((len(self.branches), *bends.shape), dtype=bends.dtype)
        for k, (stiffness, most) in enumerate(self.branches):
            sprung = self.stops[k].reshape(column) + stiffness * self.hinges / self.length * (
                bends - self.bends.reshape(column)
            )
            moments[k] = np.where(np.abs(sprung.real) < most, sprung, most * np.sign(sprung.real))
        return moments

    def move(self, drums, force=(0.0, 0.0)) -> None:
        """Go to rest under ``("tension", N)`` or ``("length", m)`` per tendon, and a force at the tip [N]."""
        x = np.concatenate([self.bends, self.losses.ravel()])
        seen, slides = set(), self._slides
        for _ in range(4 * self.losses.size):
            x = self._solved(x, drums, force, slides)
            bends, losses = x[: self.hinges], x[self.hinges :].reshape(self.losses.shape)
            tensions, _, slid = self._state(bends, losses, drums)
            limit, moved = self.friction * np.abs(bends), slid - self.slid
            over = np.where(slides == 0.0, np.abs(losses) - limit - 1e-10, 0.0).clip(0.0)
            back = np.where(slides != 0.0, -moved * slides - 1e-12, 0.0).clip(0.0) / self.offset
            changes = (over > 0.0) | (back > 0.0)
            if not changes.any():
                break
            if slides.tobytes() in seen:  # one guide at a time does not go in circles
                changes = (over == over.max()) if over.any() else (back == back.max())
            seen.add(slides.tobytes())
            slides = np.where(changes, np.where(slides == 0.0, np.sign(losses), 0.0), slides)
        else:
            raise RuntimeError("no equilibrium: the guides that slide do not settle")
        self.stops = self._stopped(bends)
        self.bends, self.losses, self.slid, self.tensions = bends, losses, slid, tensions
        self._slides = slides

    def _solved(self, x, drums, force, slides):
        step, size = 1e-30, x.size
        for _ in range(MOST):
            missing = self._missing(x, drums, force, slides)
            if np.abs(missing).max() < 1e-12:
                return x
            columns = self._missing(x[:, None] + 1j * step * np.eye(size), drums, force, slides)
            change = np.linalg.solve(columns.imag / step, -missing)
            x = x + change * min(1.0, 0.3 / np.abs(change[: self.hinges]).max(initial=1e-300))
        raise RuntimeError(f"no equilibrium: {np.abs(missing).max():.2g}")
