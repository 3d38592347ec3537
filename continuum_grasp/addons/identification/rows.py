"""Inputs, forces, parameters and equilibrium of each row of measurements as functions of the unknowns.

Equilibria are followed while loads and parameters change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.addons.identification.unknowns import DELAY, START, Unknown
from continuum_grasp.base import Array, InputError, SolverError, split_unit
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import Signals, equilibrium_under


def runtime_names(scene: Scene, unknowns: Sequence[Unknown], more: Sequence[str] = ()) -> tuple[str, ...]:
    """Parameters that the model keeps as run-time arguments."""
    targets = (unknown.target for unknown in unknowns if unknown.target not in (DELAY, START))
    # Of the place of the base both coordinates.
    names = (target[:-2] if target.startswith("base_position_") else target for target in targets)
    return tuple(dict.fromkeys((*scene.parameters, *names, *more)))


def set_by(unknowns: Sequence[Unknown], names: Sequence[str]) -> tuple[Array, Array]:
    """Entries of a model by unknowns: share of their own values (entries,), and derivatives (entries, unknowns)."""
    shares = np.ones(len(names))
    derivative = np.zeros((len(names), len(unknowns)))
    for k, unknown in enumerate(unknowns):
        if unknown.target not in (DELAY, START):
            at = names.index(unknown.target)
            shares[at], derivative[at, k] = float(unknown.added), unknown.factor
    return shares, derivative


_ITERATIONS = 25
"""Iterations of Newton's method, which takes a handful where it converges quadratically."""


class Dual(NamedTuple):
    """Numbers (size,), and their derivatives (size, unknowns) by the unknowns."""

    value: Array
    slope: Array


class Resting(NamedTuple):
    """A row at rest: z = [u, w, p], coordinates q, friction history (states + 1)."""

    z: Dual
    q: Dual
    history: Dual


class RestShapes:
    """Equilibria of rows of measurements, and their derivatives by the unknowns.

    Conditions (rows,) are values by row of the argument z = [u, w, p] of the model, by its names; all others are the
    scene's, at time zero. Each equilibrium is followed from another one of its row, ``start`` at first, in shorter
    steps of z where Newton's method fails: a finger that can buckle keeps to its branch. Rows in ``sequence`` are
    followed from one to the next instead, and the friction states with them. ``name`` is the data's name, for errors.
    InputError if a condition is unknown, or is to be estimated; SolverError if the scene has no equilibrium.
    """

    def __init__(
        self,
        scene: Scene,
        unknowns: Sequence[Unknown],
        name: str,
        conditions: Mapping[str, ArrayLike] | None = None,
        rows: int = 1,
        *,
        sequence: bool = False,
    ) -> None:
        conditions = conditions or {}
        key = f"{name}.conditions"
        self._sequence = sequence
        plain = FingerModel(scene, parameters=runtime_names(scene, unknowns), input_rates=False)
        entries = [split_unit(label)[0] for label in (*plain.u_names, *plain.w_names)]
        more = [target for target in conditions if target not in entries]
        for target in more:
            if target in {unknown.target for unknown in unknowns if not unknown.added}:
                raise InputError(f"{target} is both estimated and given by the data", key=key)
        try:
            # by the family of the model without these parameters: data must not change what is fitted
            model = FingerModel(
                scene, parameters=runtime_names(scene, unknowns, more), input_rates=False, family=plain.family
            )
        except InputError as error:
            where = f"inputs and forces: {', '.join(entries)}" if entries else "no inputs and forces"
            raise InputError(f"{error.message}; {where}", key=key) from None
        signals = Signals(scene, model)
        acting = signals.u(0.0)[0], signals.w(0.0)[0]
        names = [split_unit(label)[0] for label in (*model.u_names, *model.w_names, *model.p_names)]
        nominal = np.concatenate([*acting, model.p_nominal])
        self._table = np.tile(nominal, (rows, 1))
        for target, values in conditions.items():
            if target not in names:
                raise InputError(f"no entry {target!r}; expected one of {', '.join(names)}", key=key)
            self._table[:, names.index(target)] = np.asarray(values, dtype=float)
        self._own, self._derivative = set_by(unknowns, names)
        # Measured shapes were pulled, unless the scene says otherwise.
        start = equilibrium_under(model, *acting, **model.structure.friction_of(scene.initial, needed=False))
        fixed = [Dual(v, np.zeros((v.size, len(unknowns)))) for v in (nominal, start.q, start.history)]
        self.start = [Resting(*fixed)] * rows
        self._take(start.model)
        self._widen(np.array([unknown.start for unknown in unknowns]))

    def _widen(self, values: Array) -> None:
        """Extend the ranges of the elements to the shapes of all rows at some values of the unknowns."""
        while True:
            try:
                rows = self.all(values, self.start)
            except SolverError:  # the search tells what it cannot follow
                return
            use = np.max([self.use(row) for row in rows], axis=0)
            # 1.5: range per bend: other values of the unknowns bend further
            model = self.model.reaching(1.5 * use * self.model.ranges) if use.max() > 1.0 else self.model
            if model.ranges == self.model.ranges:
                self.start = rows
                return
            self._take(model)

    def _take(self, model: FingerModel) -> None:
        """Make the functions of a model of the finger."""
        self.model = model
        self._reach = model.structure.family.coordinate_size(min(model.ranges), max(model.lengths))
        q, u, w, p = symbols(model)
        z = ca.vertcat(u, w, p)
        count = self.start[0].history.value.size
        history = ca.SX.sym("history", count)
        still = ca.SX(model.n, 1)
        past = (history,) if count else ()
        missing = model.inverse_dynamics(q, still, still, u, w, p, *past)
        self._missing = Chained("missing", missing, q, z, history)
        # State of friction at the start of the next row, minus the sliding since the unloaded shape.
        carried = ca.SX(count, 1)
        if count:
            slid = model.sliding()(q, u, p)
            carried = ca.vertcat(model.structure.memory.clipped(history[:-1] + history[-1] * slid) - slid, 1.0)
        self._carried = Chained("carried", carried, q, z, history)

    def all(self, values: Array, last: Sequence[Resting]) -> list[Resting]:
        """The rows, followed from where they were ``last``; SolverError if one cannot be followed there."""
        rows = list[Resting]()
        for row, own in enumerate(last):
            # Of a sequence the first row has the scene's own history, each of the others that of the one before.
            carried = self._sequence and row > 0
            before = rows[-1] if carried else own
            rows.append(self.row(row, values, before, carried=carried))
        return rows

    def row(self, row: int, values: Array, before: Resting, *, carried: bool = False) -> Resting:
        """One row, in steps from another equilibrium, or with its friction ``carried`` on; errors as of ``all``."""
        z = Dual(self._own * self._table[row] + self._derivative @ values, self._derivative)
        done = 0.0
        step = 1.0
        state = before
        while done < 1.0:
            step = min(step, 1.0 - done)
            # the last step ends at z itself, not at a rounding of it
            target = z
            if step < 1.0 - done:
                target = Dual(*(a + (done + step) * (b - a) for a, b in zip(before.z, z, strict=True)))
            history = state.history
            if carried:
                # A history of directions is the scene's own, and does not depend on the unknowns.
                history = history._replace(value=self.model.history_of_states(history.value))
                history = self._carried(state.q, state.z, history)
            q = self._newton(state.q.value, target, history)
            if q is None:
                step *= 0.5
                # 1.0 / 1024.0: step along the path to new parameters below which it is lost: at a fold no step is short
                # enough
                if step < (1.0 / 1024.0):
                    raise SolverError(
                        "the equilibrium cannot be followed to these parameters",
                        status="path lost",
                        advice="bound the parameters, or start nearer to their values; a finger that buckles has no "
                        "single shape",
                    )
                continue
            # implicit function theorem: Q(q, z, history) = 0
            _, stiffness, *others = self._missing.parts(q, target, history)
            slope = -np.linalg.solve(stiffness, chained(others, (target, history)))
            state = Resting(target, Dual(q, np.asarray(slope)), history)
            done = done + step
            step = 2.0 * step
        return state

    def stable(self, resting: Resting) -> bool:
        """Whether every small displacement is driven back."""
        stiffness = self._missing.parts(resting.q, resting.z, resting.history)[1]
        return bool(np.linalg.eigvals(stiffness).real.min() > 0.0)

    def use(self, resting: Resting) -> Array:
        """Share of its bending range that each element uses (elements,)."""
        u, _, p = np.split(resting.z.value, np.cumsum([self.model.nu, self.model.nw]))
        return np.array(self.model.range_use(resting.q.value, u, p)).ravel()

    def _newton(self, q: Array, z: Dual, history: Dual) -> Array | None:
        for _ in range(_ITERATIONS):
            missing, stiffness, *_ = self._missing.parts(q, z, history)
            try:
                change = np.linalg.solve(stiffness, -missing.ravel())
            except np.linalg.LinAlgError:
                return None
            size = float(np.abs(change).max()) / self._reach
            # a step of half the bending range leads to another branch as well as to this one
            if not size < 0.5:  # NaN too
                return None
            q = q + change
            # 1e-11: last Newton step per bending range: the search for parameters, which converges to 1e-9, must not
            # see it
            if size <= 1e-11:
                return q
        return None


class Chained:
    """Function y of some columns, with its derivatives by each of them, as one of numbers with derivatives."""

    def __init__(self, name: str, y: ca.SX, *given: ca.SX) -> None:
        outputs = [ca.densify(v) for v in (y, *(ca.jacobian(y, argument) for argument in given))]
        self._function = ca.Function(name, list(given), ca.cse(outputs))

    def parts(self, *given: Dual | Array) -> list[Array]:
        """The column y (size, 1), and its derivative by each argument."""
        plain = [argument.value if isinstance(argument, Dual) else argument for argument in given]
        return [np.array(part) for part in self._function(*plain)]

    def __call__(self, *given: Dual | Array) -> Dual:
        """Value with derivatives by the unknowns; plain arrays do not depend on them."""
        y, *slopes = self.parts(*given)
        return Dual(y.ravel(), chained(slopes, given))


def chained(slopes: Sequence[Array], given: Sequence[Dual | Array]) -> Array:
    """Derivatives by the unknowns, from those by some columns."""
    first, *others = (by @ of.slope for by, of in zip(slopes, given, strict=True) if isinstance(of, Dual))
    return np.asarray(sum(others, first))


def symbols(model: FingerModel, first: str = "q") -> list[ca.SX]:
    """Symbols q, or x, and u, w and p of a model."""
    sizes = {first: model.n if first == "q" else model.nx, "u": model.nu, "w": model.nw, "p": model.np}
    return [ca.SX.sym(name, size) for name, size in sizes.items()]
