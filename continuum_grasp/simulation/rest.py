"""A finger at rest under constant loads, also beyond buckling.

1. Pseudo-transient continuation from the start: steps of a motion without inertia, whose shift falls with the residual,
   down to Newton's method (C. T. Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35 (1998), doi:10.1137/S0036142996304796).
2. Judge the stability: by the least stiffness, or, without a potential, by the poles of the motion.
3. An unstable one is left along its weakest direction, and 1 follows.

Friction is given here; ``friction_path`` computes it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from continuum_grasp.base import Array, SolverError, check_arguments
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Fidelity
from continuum_grasp.simulation.linearized import damping_matrix, in_mass_metric, poles

_NEAR = 1e4
"""Missing force per tolerance below which a search looks at the sizes of forces anew [1]."""
_TOLERANCE = 1e-11
"""Missing force per size of the forces that balance [1]; a few digits above rounding."""
_MAX_ITERATIONS = 500
"""Iterations after which the search is given up [1]."""
_MOST_PARTS = 12
"""Parts of a step that are tried [1]: down to 1/2048 of it. Of the 197 searches of ``-m deep -k path_of_equilibria`` of
the tests, with a presliding of 1 um, none fails; with whole steps, 28 of 214 do."""
_NEAR_BUCKLING, _NEAR_BUCKLING_ARCS = 0.02, 0.25
"""Least stiffness per stiffness of the unloaded finger [1] below which the shape is sensitive to the model's own
error; the second for families of order 2, arcs, divided by the square of their number. Column under P: below 0.02, 2
matched clothoids have errors of 4e-3 to 4e-2 of the length; arcs shift the buckling load by 0.21 of it over the square
of their number."""


@dataclass(frozen=True)
class LoadState:
    """Loads of a finger at rest: input u (nu,), forces w (nw,), parameters p (np,), and optionally another generalized
    force ``held`` (n,).
    """

    u: Array
    w: Array
    p: Array
    held: Array | float = 0.0

    def towards(self, other: LoadState, share: float) -> LoadState:
        """Interpolate linearly to other loads by a share [1]."""
        return LoadState(
            self.u + share * (other.u - self.u),
            self.w + share * (other.w - self.w),
            self.p + share * (other.p - self.p),
            self.held + share * (other.held - self.held),
        )


@dataclass(frozen=True)
class RestingShape:
    """A shape with balanced forces on the finger; `Equilibrium` is the result for users."""

    q: Array
    u: Array
    w: Array
    p: Array
    stable: bool
    margin: float
    residual: float
    iterations: int
    model: FingerModel
    warnings: tuple[str, ...] = ()
    history: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def friction_states(self) -> Array:
        """Direction of friction, per friction state, from -1 to 1 [1]."""
        return self.model.friction_after(self.q, self.u, self.p, self.history)

    @cached_property
    def tensions(self) -> Array | None:
        """Tensions (tendons,) at the drives [N]; None of a finger without tendons."""
        count = len(self.model.finger.tendon_list)
        if not self.model.structure.own_tendons:
            return self.u[:count] if count else None
        history = (self.history,) if self.history.size else ()
        return np.array(self.model.tensions_at_rest()(self.q, self.u, self.p, *history)).ravel()

    @property
    def tip(self) -> Array:
        """World position of the tip [m]."""
        return np.array(self.model.tip(self.q, self.u, self.p)).ravel()

    @check_arguments
    def backbone(self, points: int = 50) -> Array:
        """World positions (points, 2) along the backbone [m]."""
        core = Core(self.model, compiled=False)
        return np.asarray(core.backbones(self.q[None], self.u[None], points, self.p)[0])


class EquilibriumSearch:
    """Equilibria of a model under loads; ``history`` belongs to its friction."""

    def __init__(self, model: FingerModel, under: LoadState, history: Array) -> None:
        self._held, self._history = under.held, history
        self._u, self._w, self._p = under.u, under.w, under.p
        self._friction = (history,) if history.size else ()
        self._take(model)

    def _take(self, model: FingerModel) -> None:
        self._model = model
        self._core = Core(model, compiled=False)

    def rest(self) -> Array:
        """The unloaded shape: elastic forces vanish."""
        force, stiffness = self._elasticity()
        return np.asarray(-np.linalg.solve(stiffness, force))

    def _statics(self, q: Array) -> tuple[Array, Array]:
        """Return the missing force in a shape, and its derivative."""
        missing, stiffness = self._core.statics(q, self._u, self._w, self._p, *self._friction)
        return missing + self._held, stiffness

    def _elasticity(self) -> tuple[Array, Array]:
        """Elastic force at q = 0 and its derivative; it is linear in q."""
        force = np.asarray(self._core.elastic(np.zeros(self._model.n), self._u, self._p))
        columns = [self._core.elastic(e, self._u, self._p) - force for e in np.eye(self._model.n)]
        return force, np.array(columns).T

    def find(self, start: Array, stable: bool, side: int) -> RestingShape:
        """Equilibrium from a start; see ``equilibrium``."""
        try:
            q, iterations = self._descend(start, 0)
            margin, direction, steady = self._stability(q)
            if stable and not steady:
                # The sign of an eigenvector is arbitrary, so the largest component defines both sides.
                kick = direction * side * (1.0 if direction[np.argmax(np.abs(direction))] > 0 else -1.0)
                # 1e-3: displacement along the weakest direction with which an unstable equilibrium is left, per typical
                # coordinate: large against rounding, small against the buckled shape
                size = 1e-3 * self._reach() / max(np.abs(kick).max(), 1e-300)
                q, iterations = self._descend(q + size * kick, iterations)
                margin, _, steady = self._stability(q)
            warnings = (*self._checked(q), *self._buckling(q, margin))
            missing = self._statics(q)[0]
        except np.linalg.LinAlgError as error:
            raise SolverError(
                "no equilibrium found",
                status="singular",
                violated=[f"mass or stiffness matrix ({error})"],
                advice="a bending stiffness or mass is so small or large that the matrices have no usable numbers, or "
                "the start is bent too far: check units, or give a guess nearer to the shape",
            ) from error
        residual = float(np.abs(missing).max() / max(self._scales(q)))
        inputs = self._u, self._w, self._p
        return RestingShape(q, *inputs, steady, margin, residual, iterations, self._model, warnings, self._history)

    def _checked(self, q: Array) -> tuple[str, ...]:
        """Return the warnings of a shape; SolverError if elements bend beyond 40 rad."""
        use = np.asarray(self._core.range_use(q, self._u, self._p))
        if use.max() > 1.0:
            k = int(use.argmax())
            raise SolverError(
                "the equilibrium bends an element beyond the range of its model",
                status="beyond the bending range",
                violated=[
                    f"element {k + 1} is bent by {use[k] * self._model.ranges[k]:.3g} rad, expected at most "
                    f"{self._model.ranges[k]:.3g} rad"
                ],
                advice="take more elements, lower the loads, or give a guess nearer to the shape",
            )
        return self._model.limit_warnings(use[None])

    def _reaching(self, q: Array) -> bool:
        """Extend the ranges of the elements to a shape; return whether a range has grown."""
        ranges = np.array(self._model.ranges)
        bends = ranges * np.asarray(self._core.range_use(q, self._u, self._p))
        if np.all((bends <= ranges) | (ranges >= Fidelity.WIDEST)):
            return False
        # 2.0: range per bend or range so far: neighbors bend next, and few models are made until the shape is reached
        wider = self._model.reaching(2.0 * np.maximum(bends, ranges))
        if wider.ranges == self._model.ranges:
            return False
        self._take(wider)
        return True

    def _buckling(self, q: Array, margin: float) -> tuple[str, ...]:
        """Warning about a shape whose least stiffness the loads have nearly used up."""
        mass = self._core.mass_matrix(q, self._u, self._p)
        unloaded = float(np.linalg.eigvalsh(in_mass_metric(mass, self._elasticity()[1])[1])[0])
        coarse = self._model.structure.family.order <= 2
        arcs = _NEAR_BUCKLING_ARCS / len(self._model.lengths) ** 2 if coarse else 0.0
        if not abs(margin) < max(_NEAR_BUCKLING, arcs) * unloaded:
            return ()
        return (
            f"the loads are near a buckling load: the least stiffness is {margin / unloaded:.1g} of its value for the "
            "unloaded finger, and small errors of loads, stiffness and elements change the shape by percents of the "
            "length",
        )

    def _reach(self) -> float:
        """Typical size of a bending coordinate."""
        made = self._model.structure
        return float(made.family.coordinate_size(min(made.spans), max(made.lengths)))

    def _descend(self, start: Array, iterations: int) -> tuple[Array, int]:
        q = start.copy()
        self._reaching(q)
        missing, stiffness = self._statics(q)
        mass = self._core.mass_matrix(q, self._u, self._p)
        if not (np.all(np.isfinite(missing)) and np.all(np.isfinite(stiffness)) and np.all(np.isfinite(mass))):
            raise np.linalg.LinAlgError("not finite at the start")
        # Steps with K + shift M.
        squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness))
        rate, weakest = float(np.abs(squares).max()), float(squares.real.min())
        shift, (forces, floor), falls = rate, self._scales(q), False
        for count in range(iterations, iterations + _MAX_ITERATIONS):
            # What Newton's method still lowers, or did not try yet, is no rounding.
            scale = forces if falls or shift > 1e-9 * rate else max(forces, floor)
            if np.abs(missing).max() <= _TOLERANCE * scale and shift < 1e-3 * rate:
                return q, count
            # Directions that the loads make unstable are turned, so that the step still goes down the energy.
            limit = 0.25 * self._reach()
            change = np.linalg.solve(stiffness + (shift + 2.0 * max(0.0, -weakest)) * mass, -missing)
            change *= min(1.0, limit / max(np.abs(change).max(), 1e-300))
            trial, after, stiffness_after = self._stepped(q, change, missing)
            if not np.all(np.isfinite(after)):
                shift = 10.0 * max(shift, rate)
                continue
            before_size, after_size = np.abs(missing).max(), np.abs(after).max()
            q, missing, stiffness = trial, after, stiffness_after
            if self._reaching(q):
                missing, stiffness = self._statics(q)
            mass = self._core.mass_matrix(q, self._u, self._p)
            weakest = float(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.min())
            shift = float(np.clip(shift * min(0.5, after_size / max(before_size, 1e-300)), 1e-12 * rate, rate))
            falls = bool(after_size < 0.1 * before_size)
            # Far from a solution the sizes of forces decide nothing.
            if after_size <= _NEAR * _TOLERANCE * max(forces, floor):
                forces, floor = self._scales(q)
            # Too far: back towards the damped motion.
            if after_size > max(2.0 * before_size, _TOLERANCE * forces, _TOLERANCE * floor):
                shift = min(10.0 * max(shift, 1e-6 * rate), rate)
        raise SolverError(
            "no equilibrium found",
            status="iteration limit",
            violated=[f"generalized force missing: {np.abs(missing).max():.3g} (scale {scale:.3g})"],
            advice="take more elements, lower the loads, or give a guess nearer to the shape",
        )

    def _stepped(self, q: Array, change: Array, missing: Array) -> tuple[Array, Array, Array]:
        """Take a step, or the part of it along which the missing force does work; return the shape, the missing force
        there and the stiffness.

        Friction that turns within a small slide acts against a whole step, and against the next one back.
        """
        ahead, behind, share = 0.0, 1.0, 1.0
        work = float(missing @ change)
        for _ in range(_MOST_PARTS):
            trial = q + share * change
            after, stiffness = self._statics(trial)
            left = float(after @ change) / work if work else 0.0
            # -0.5, 0.5: work along the step, per that at its start, between which a part of a step is long enough
            if left >= -0.5 and (share == 1.0 or left < 0.5):
                break
            ahead, behind = (ahead, share) if left < 0.0 else (share, behind)
            share = 0.5 * (ahead + behind)
        return trial, after, stiffness

    def _scales(self, q: Array) -> tuple[float, float]:
        """Size of the forces that balance, and that below which they may be rounding."""
        core, u, w, p = self._core, self._u, self._w, self._p
        balance, stiffness = self._statics(q)
        # Differences of the balance give external forces and weight; to build functions of them takes a tenth of a
        # search.
        without = core.statics(q, u, np.zeros_like(w), p, *self._friction)[0]
        elastic, actuation = core.elastic(q, u, p), core.actuation(q, u, p, *self._friction)
        parts = [
            self._held,
            elastic,
            core.elastic(np.zeros_like(q), u, p),
            without - elastic + actuation,
            actuation,
            balance - self._held - without,
        ]
        # Where nothing loads the finger, or tendons pull alike: a bend of a part in 1e4 of the range, of which the
        # tolerance is rounding.
        floor = 1e-4 * np.abs(stiffness).max() * self._reach()
        return float(max(np.abs(part).max(initial=0.0) for part in parts)), float(floor)

    def _stability(self, q: Array) -> tuple[float, Array, bool]:
        """Smallest stiffness eigenvalue in the metric of the mass matrix, its direction, and the verdict."""
        _, stiffness = self._statics(q)
        mass = self._core.mass_matrix(q, self._u, self._p)
        root, scaled, symmetric = in_mass_metric(mass, stiffness)
        values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
        margin, direction = float(values[0]), np.asarray(root.T @ vectors[:, 0])
        if symmetric:
            return margin, direction, margin > 0.0
        # Without a potential the energy decides nothing: flutter shows in the motion alone (H. Ziegler, 1952).
        eigenvalues = poles(mass, stiffness, damping_matrix(self._core, q, self._u, self._p))
        return margin, direction, bool(eigenvalues.real.max() <= 1e-9 * np.abs(eigenvalues).max())
