"""Motion of fingers whose tendons have friction, exactly: a chain of hinges with mass, a guide at each.

It shares nothing with the package. Pieces between hinges are uniform bars; time is discretized by backward differences
of second order. At the end of every step each guide sticks, or slides at the capstan limit against the direction in
which the tendon slid in the step (complementarity); a tendon that would have to push is slack.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tests.truth.tendon import HingedFinger

MOST = 600
"""Newton steps of a step in time."""
TOGETHER = 20
"""Newton steps up to which all guides are decided anew in each; later one at a time, which does not go in circles."""
PRESSED = 2e-4
"""Sliding that counts as much as a loss of one where a guide's state is decided [m]."""


@dataclass
class MovingFinger(HingedFinger):
    """The finger of ``HingedFinger``, moving: ``density`` of the rod, its damping, a mass at the tip.

    ``time_step`` is that of ``advance``, ``rates`` those of the bends; a force acts at the end of as many pieces as
    ``pushed``, None: at the tip.
    """

    density: float = 0.034  # [kg/m]
    damping: float = 3e-5  # [N m2 s]
    tip_mass: float = 0.002  # [kg]
    time_step: float = 2.5e-4  # [s]
    pushed: int | None = None
    time: float = 0.0
    rates: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        n, h = self.hinges, self.length / self.hinges
        self.rates = np.zeros(n)
        self._before = self.bends.copy(), self.rates.copy()  # bends and rates of the step before
        lengths = np.full(n, h)
        lengths[-1] = 0.5 * h
        # Points are at the ends of pieces, of which the first is fixed; velocities are linear between them.
        points = np.zeros((n + 1, n + 1))
        for k, part in enumerate(lengths):
            points[k : k + 2, k : k + 2] += self.density * part / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
        points[n, n] += self.tip_mass
        below = np.tril(np.ones((n, n)))
        self._lengths, self._sum = lengths, below
        self._weights = (below.T @ points[1:, 1:] @ below) * np.outer(lengths, lengths)
        self._falls = np.tril(np.ones((n, n)), -1) + 0.5 * np.eye(n)
        self._beyond = 0.5 * np.eye(n) + np.triu(np.ones((n, n)), 1)

    def start(self, drums: Sequence[tuple[str, float]]) -> None:
        """Straight and at rest under drums that pull equally, without friction so far."""
        self.tensions, _, self.slid = self._state(self.bends, self.losses, drums)

    def _inertia(self, bends):
        """Mass matrix of the absolute angles of the pieces, and what squares of their rates exert (as a matrix)."""
        angles = np.cumsum(bends)
        between = angles[:, None] - angles[None, :]
        return self._weights * np.cos(between), self._weights * np.sin(between)

    def _tendon(self, j, bends, losses, drum):
        """Tension, its slopes by bends and losses; shares in the middle of guides; sliding and its slopes."""
        n, h, e, side = self.hinges, self.length / self.hinges, self.offset, self.sides[j]
        after = np.exp(-np.cumsum(losses))
        middle = after * np.exp(0.5 * losses)
        drawn = h * after / self.axial_stiffness
        drawn[-1] *= 0.5
        rest = np.cumsum(drawn[::-1])[::-1]
        kind, value = drum
        by_bends, by_losses = np.zeros(n), np.zeros(n)
        if kind == "tension":
            tension = value
        else:
            given = 0.5 * h / self.axial_stiffness + rest[0] + self.series_compliance
            wound = value - side * e * bends.sum()
            tension = max(wound, 0.0) / given
            if wound > 0.0:
                by_bends, by_losses = np.full(n, -side * e / given), tension / given * rest
        slid = side * e * (self._beyond @ bends) + tension * rest
        k = np.arange(n)
        slopes = side * e * self._beyond + np.outer(rest, by_bends)
        loss_slopes = np.outer(rest, by_losses) - tension * rest[np.maximum(k[:, None], k[None, :])]
        return tension, by_bends, by_losses, middle, slid, slopes, loss_slopes

    def advance(self, drums: Sequence[tuple[str, float]], force=(0.0, 0.0)) -> None:
        """One step in time: at its end the drums are at ``("tension", N)`` or ``("length", m)``, under a force.

        ``force`` [N] may be a function of the position and velocity; it gives the force and its slope by the
        position.
        """
        n, step, count = self.hinges, self.time_step, len(self.sides)
        old, old_rates = self.bends, self.rates
        before, before_rates = self._before
        first = self.time == 0.0
        lead = 1.0 if first else 1.5

        def rate(new, now, past):
            return (new - now) / step if first else (1.5 * new - 2.0 * now + 0.5 * past) / step

        bends, losses = old + step * old_rates, self.losses.copy()
        slid_before = self.slid
        stiff, damped = self.stiffness * n / self.length, self.damping * n / self.length
        total = n * (1 + count)
        slides = self._slides
        settled = False
        for turn in range(MOST):
            rates = rate(bends, old, before)
            accelerations = rate(rates, old_rates, before_rates)
            mass, swing = self._inertia(bends)
            spun = np.cumsum(rates)
            inertia = mass @ np.cumsum(accelerations) + swing @ spun**2
            angles = np.cumsum(bends)
            ways = np.stack([-np.cos(angles), -np.sin(angles)]) * self._lengths
            jacobian = ways[:, : self.pushed] @ self._sum[: self.pushed]  # of where it is pushed by the bends
            pressed, slope = np.asarray(force) if not callable(force) else None, np.zeros((2, 2))
            if callable(force):
                pressed, slope = force(
                    self._points(bends)[:, -1 if self.pushed is None else self.pushed], jacobian @ rates
                )
            missing = np.zeros(total)
            matrix = np.zeros((total, total))
            missing[:n] = self._sum.T @ inertia + stiff * bends + damped * rates - jacobian.T @ pressed
            own = (lead / step) ** 2 * (self._sum.T @ mass @ self._sum)
            own += 2.0 * (lead / step) * (self._sum.T @ (swing * spun) @ self._sum) - jacobian.T @ slope @ jacobian
            own[np.diag_indices(n)] += stiff + damped * lead / step
            matrix[:n, :n] = own
            found = [self._tendon(j, bends, losses[j], drums[j]) for j in range(count)]
            tensions, slid = np.array([one[0] for one in found]), np.array([one[4] for one in found])
            limit = self.friction * np.abs(bends)
            tried = losses + (slid - slid_before) / PRESSED
            over = np.abs(tried) - limit
            wanted = np.where(over > 0.0, np.sign(tried), 0.0)
            wanted = np.where((tensions <= 0.0)[:, None] & (wanted == 0.0), 1.0, wanted)
            if self.friction == 0.0:
                wanted[:] = 1.0
            if turn < TOGETHER:
                changed, slides = (wanted != slides).any(), wanted
            else:
                # A guide that slides the wrong way sticks first. What is not solved says nothing yet.
                differs = np.where(wanted != slides, np.abs(over) + 1e-12, 0.0)
                changed = not settled or differs.max() > 1e-7
                if settled and changed:
                    slides = np.where(differs == differs.max(), np.where(slides == 0.0, wanted, 0.0), slides)
            for j, side in enumerate(self.sides):
                at = slice(n * (1 + j), n * (2 + j))
                tension, by_bends, by_losses, middle, _, slopes, loss_slopes = found[j]
                arm = side * self.offset
                missing[:n] -= arm * tension * middle
                matrix[:n, :n] -= arm * np.outer(middle, by_bends)
                matrix[:n, at] = -arm * (np.outer(middle, by_losses) - tension * middle[:, None] * self._falls)
                stuck = slides[j] == 0.0
                missing[at] = np.where(stuck, (slid[j] - slid_before[j]) / self.offset, losses[j] - slides[j] * limit)
                matrix[at, :n] = np.where(stuck[:, None], slopes / self.offset, 0.0)
                matrix[at, :n] -= np.diag(np.where(stuck, 0.0, slides[j] * self.friction * np.sign(bends)))
                matrix[at, at] = np.where(stuck[:, None], loss_slopes / self.offset, np.eye(n))
            change = np.linalg.solve(matrix, -missing)
            change *= min(1.0, 0.2 / np.abs(change[:n]).max(initial=1e-300))
            bends = bends + change[:n]
            losses = losses + change[n:].reshape(count, n)
            settled = np.abs(change[:n]).max() < 1e-9 and np.abs(change[n:]).max() < 1e-7
            if settled and not changed:
                break
        else:
            raise RuntimeError(f"no step at {self.time:g} s: {np.abs(change).max():.2g}")
        self._before = old, old_rates
        self.rates = rate(bends, old, before)
        self.bends, self.losses, self.slid, self.tensions = bends, losses, slid, tensions
        self._slides = slides
        self.time += step

    @property
    def tip_velocity(self) -> np.ndarray:
        """Velocity of the tip (2,) [m/s]."""
        angles = np.cumsum(self.bends)
        return np.stack([-np.cos(angles), -np.sin(angles)]) * self._lengths @ np.cumsum(self.rates)
