"""Predictions of one set of measurements as functions of the unknowns, for shapes at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.addons.identification.data import UNIT_OF, Data, Poses, TipPath
from continuum_grasp.addons.identification.numbers import MeasuredColumn, MeasuredSet
from continuum_grasp.addons.identification.observation import check_tensions, observed
from continuum_grasp.addons.identification.rows import Chained, Dual, Resting, RestShapes, symbols
from continuum_grasp.addons.identification.unknowns import Unknown
from continuum_grasp.addons.identification.vibrations import Vibrations
from continuum_grasp.base import Array, SolverError
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene


def measured_of(data: Poses | TipPath, at: Array, fitted: NDArray[np.bool_], length: float) -> MeasuredSet:
    """Table of what was measured of a finger of some length [m], row by row, or instant by instant; both are ``at``.

    Readings of one kind without a known deviation share one.
    """
    columns = list[MeasuredColumn]()
    moves = isinstance(data, TipPath)
    for reading in data.measured:
        what = reading.what if moves or reading.of_mode else reading.what.replace(" of ", " at ")
        group = what if reading.of_mode else f"{reading.kind} {'on paths' if moves else 'of poses'}"
        if reading.sigma is not None:
            group = f"{data.name}: {reading.kind if moves else what}"
        if reading.of_drive or reading.of_mode:
            place = None
        elif reading.at is None:
            place = length
        else:
            place = reading.at
        unit = UNIT_OF[reading.quantity]
        columns.append(MeasuredColumn(what, group, unit, reading.sigma, reading.quantity, place))
    values = np.stack([np.broadcast_to(reading.values, at.shape) for reading in data.measured], axis=1).astype(float)
    offsets = np.stack([np.broadcast_to(reading.offset, at.shape) for reading in data.measured], axis=1).astype(float)
    ordered = isinstance(data, TipPath) or data.sequence
    signals = () if isinstance(data, TipPath) else data.signals
    return MeasuredSet(data.name, tuple(columns), at, values, fitted, moves, ordered, offsets, signals)


class Drawn(NamedTuple):
    """Backbones (S, points, 2) [m] that are predicted, in rows or at instants ``at`` (S,) that were measured."""

    at: Array
    backbones: Array


class Bent(NamedTuple):
    """Shapes of a model in all rows or at all instants: coordinates, inputs and parameters (R, ...)."""

    model: FingerModel
    q: Array
    u: Array
    p: Array


_DRAWN, _POINTS = 8, 60
"""Most backbones of a set of measurements that are drawn, and points of each [1]: more hide one another."""


class MeasuredBlock:
    """A set of measurements, and the scene whose model predicts it."""

    measured: MeasuredSet
    data: Data
    scene: Scene
    own: Sequence[Unknown] = ()
    """Unknowns of this set alone, behind those that all blocks have."""
    plane: float | None = None
    """Direction in which it bends [rad], where fingers bend in several planes."""
    kinked = False
    """Whether its predictions have kinks, where friction turns along a motion."""
    free = False
    """Whether commands of the motion stay as they are, so that a part from its start may be fitted before the whole."""
    followed: Any = None
    """Shapes and steps of the last prediction, from which the next one is followed. Where these are set anew, it goes
    on from there, wherever searches have been meanwhile."""

    def __init__(self, scene: Scene, data: Data, unknowns: Sequence[Unknown], by: Sequence[int] | None = None) -> None:
        self.data = data
        self.scene = scene
        self.plane = data.plane

    @property
    def name(self) -> str:
        """Name of the set."""
        return self.measured.name

    def again(
        self,
        unknowns: Sequence[Unknown],
        *,
        data: Data | None = None,
        scene: Scene | None = None,
        by: Sequence[int] | None = None,
    ) -> Self:
        """The set with other unknowns, measured otherwise, or in another scene; errors as of a new one.

        Derivatives are ``by`` those unknowns alone that have these numbers, where given.
        """
        return type(self)(scene or self.scene, data or self.data, unknowns, by)

    def predict(self, values: Array, until: float = math.inf) -> tuple[Array, Array]:
        """Predictions (m,) and their derivatives (m, unknowns), by its own unknowns last, or by some of them; of a
        motion predictions up to an instant are right.

        Raises
        ------
        SolverError, NumericalError
            If there are none at these values.
        """
        raise NotImplementedError

    def bent(self, values: Array) -> Bent | None:
        """Shapes behind the predictions; None where they are not drawn, nor warned of."""
        return None

    def warnings(self, values: Array) -> tuple[str, ...]:
        """Warnings about shapes beyond the bending range or the strain limit."""
        bent = self.bent(values)
        if bent is None:
            return ()
        use = bent.model.range_use.map(len(bent.q))(bent.q.T, bent.u.T, bent.p.T)
        return bent.model.limit_warnings(np.array(use).T, self.measured.at if self.measured.moves else None)

    def drawn(self, values: Array) -> Drawn:
        """Backbones of some rows or instants, evenly spread; none where no point of the finger is measured."""
        bent = self.bent(values)
        if bent is None or all(column.place is None for column in self.measured.columns):
            return Drawn(np.zeros(0), np.zeros((0, _POINTS, 2)))
        last = len(bent.q) - 1
        core = Core(bent.model, compiled=False)
        chosen = np.unique(np.linspace(0, last, min(_DRAWN, last + 1)).round().astype(int))
        lines = [core.backbones(bent.q[[k]], bent.u[[k]], _POINTS, bent.p[k])[0] for k in chosen]
        return Drawn(self.measured.at[chosen], np.array(lines))


class PosesBlock(MeasuredBlock):
    """Shapes at rest, each row about an equilibrium of its own, and vibrations about them."""

    def __init__(self, scene: Scene, data: Poses, unknowns: Sequence[Unknown], by: Sequence[int] | None = None) -> None:
        super().__init__(scene, data, unknowns, by)
        self._by = slice(None) if by is None else list(by)
        rows = data.conditions, data.rows
        self._shapes = RestShapes(scene, unknowns, data.name, *rows, sequence=data.sequence)
        self.followed = self._shapes.start
        model = self._shapes.model
        still = [reading for reading in data.measured if not reading.of_mode]
        check_tensions(model, still, data.name)
        q, u, w, p = symbols(model)
        history = ca.SX.sym("history", len(model.friction_names) + bool(model.friction_names))
        past = (history,) if model.friction_names else ()
        beside = ca.SX.sym("offsets", len(still))

        def drives() -> list[ca.SX]:
            return [at_rest()(q, u, p, *past) for at_rest in (model.tensions_at_rest, model.drives_at_rest)]

        y = observed(model, still, q, u, p, drives, beside)
        self._observe = Chained("observation", y, q, ca.vertcat(u, w, p), history, beside)
        vibrations = [reading for reading in data.measured if reading.of_mode]
        self._vibrations = Vibrations(model, vibrations, len(unknowns), data.name) if vibrations else None
        self._places = np.argsort(np.argsort([reading.of_mode for reading in data.measured], kind="stable"))
        fitted = np.ones(data.rows, bool) if data.fitted is None else np.asarray(data.fitted, bool)
        self.measured = measured_of(data, np.arange(1.0, data.rows + 1.0), fitted, scene.finger.rod.length)
        self._offsets = self.measured.offsets[:, [not reading.of_mode for reading in data.measured]]

    def predict(self, values: Array, until: float = math.inf) -> tuple[Array, Array]:
        self.followed = self._shapes.all(values, self.followed)
        predictions = [self._row(row, resting) for row, resting in enumerate(self.followed)]
        return np.concatenate([y for y, _ in predictions]), np.concatenate([d for _, d in predictions])[:, self._by]

    def possible(self, tried: Sequence[Array]) -> tuple[NDArray[np.intp], Array]:
        """Rows (K,) that have a stable shape within the bending range at all of some values, and derivatives there.

        These are (values, K, readings, unknowns).
        """
        derivatives: dict[int, list[Array]] = {row: [] for row in range(len(self.measured.at))}
        last = list(self.followed)
        for values in tried:
            for row in list(derivatives):
                with suppress(SolverError):
                    last[row] = resting = self._shapes.row(row, values, last[row])
                    if self._shapes.use(resting).max() <= 1.0 and self._shapes.stable(resting):
                        derivatives[row].append(self._row(row, resting).slope)
                        continue
                del derivatives[row]
        slopes = np.array(list(derivatives.values()))
        return np.array(list(derivatives), dtype=np.intp), slopes.swapaxes(0, 1) if derivatives else slopes

    def bent(self, values: Array) -> Bent:
        self.followed = rows = self._shapes.all(values, self.followed)
        model = self._shapes.model
        u, _, p = np.split(np.array([row.z.value for row in rows]), np.cumsum([model.nu, model.nw]), axis=1)
        return Bent(model, np.array([row.q.value for row in rows]), u, p)

    def _row(self, row: int, resting: Resting) -> Dual:
        read = self._observe(resting.q, resting.z, resting.history, self._offsets[row])
        if self._vibrations is None:
            return read
        both = zip(read, self._vibrations.at(resting), strict=True)
        return Dual(*(np.concatenate(parts)[self._places] for parts in both))
