"""Find the shape of a finger with friction, by equilibria along a path of inputs and loads.

Friction has a memory: the same tensions hold a finger in many shapes, and the path decides which one. In the unloaded
shape nothing has slid. Weight and loads come first, with idle drives, then the inputs of the drives.

Each leg of the path is one equilibrium, with a stop operator per friction state, driven by the sliding from the start
to the end of the leg. This is exact as long as no section slides to and fro within the leg. The rates of sliding at
both ends reveal such a section, and so does the end of two halves of the leg; the leg is then split in halves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array, SolverError
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.simulation.rest import EquilibriumSearch, LoadState, RestingShape

_HALVINGS = 8
"""Greatest number of halvings of a leg: 2 N of a pull of 500 N, or 20 um (a usual presliding) of 5 mm of sliding."""
_ROUGH = 2e-5
"""Greatest change of the shape by a reversal within a leg, per bending range [1]. Loops of random fingers then end
within 5e-5 of the length of loops in 24 times as many legs, by ``-m deep -k random_loop`` of the tests."""
_SAME = 1e-6
"""Difference of friction states [1] that has no effect."""
_NEARBY = 1e-4
"""Share of a leg for finite differences along it [1]: small against the rounded onset of slack tendons, large against
rounding errors."""
_PLACES = np.linspace(0.0, 1.0, 9)[1:]
"""Places along a leg at which sliding is compared, as shares of the leg [1]."""


@dataclass(frozen=True)
class _Place:
    """Shape on the path with its friction states."""

    under: LoadState
    q: Array
    states: Array


class FrictionPath:
    """Equilibria of a model along a path of loads, each with the friction from the path so far.

    The path begins in the unloaded shape. A generalized force holds this shape under the first load and fades along the
    first leg. Shapes have a warning once a section slid to and fro within the shortest leg.
    """

    def __init__(self, model: FingerModel, first: LoadState, *, stable: bool = True, side: int = 1) -> None:
        self._stable, self._side = stable, side
        self._take(model)
        self._missed = 0.0  # greatest error of a friction state [1] by reversals within the shortest leg
        self._count = len(model.friction_names)
        none, rest = np.zeros(self._count), EquilibriumSearch(model, first, np.zeros(0)).rest()
        place = _Place(first, rest, none)
        missing, _ = self._statics(place, first)
        self._place = replace(place, under=replace(first, held=-missing))

    def _take(self, model: FingerModel) -> None:
        self._model = model
        self._core = Core(model, compiled=False)

    @property
    def q(self) -> Array:
        """Current shape (n,) on the path."""
        return self._place.q

    @property
    def loaded(self) -> bool:
        """Whether the first load moves the finger out of its unloaded shape."""
        held, (_, stiffness) = np.abs(self._place.under.held), self._statics(self._place, self._place.under)
        # 1e-9: negligible bend per bending range: above rounding
        return bool(held.max() > 1e-9 * np.abs(stiffness).max() * self._reach)

    @property
    def _reach(self) -> float:
        made = self._model.structure
        return float(made.family.coordinate_size(min(made.spans), max(made.lengths)))

    def go(self, end: LoadState, guess: Array | None = None) -> RestingShape:
        """Follow the path to another load; the last search begins at the ``guess``, if given.

        Raises
        ------
        SolverError
            If the path is lost.
        """
        found = self._leg(self._place, end, guess, _HALVINGS)
        self._place = self._at(end, found)
        return replace(found, warnings=(*found.warnings, *self._warnings))

    @property
    def _warnings(self) -> tuple[str, ...]:
        if not self._missed:
            return ()
        return (
            f"friction is rough: sections slide to and fro within 1/{2**_HALVINGS} of a leg of the path, as in a jump "
            f"to another shape, which changes friction states by up to {self._missed:.2g}: state a path of smaller "
            "steps (initial.path), or simulate the motion",
        )

    def released(self, pulled: RestingShape, before: Array) -> RestingShape:
        """Find the shape after release: all sections that slid from the shape ``before`` (n,) to a pulled one have slid
        back.

        A section that did not slide has no direction, and so no friction.
        """
        found, none = pulled, np.zeros(1)
        under = LoadState(pulled.u, pulled.w, pulled.p)
        # 8: searches until the directions of friction settle: the shape decides them, and seldom changes them
        for _ in range(8):
            slid = self._slid(found.q, under) - self._slid(before, under)
            # 1e-6: negligible sliding per range: far above rounding
            history = np.append(np.where(np.abs(slid) > 1e-6, -np.sign(slid), 0.0), none)
            if np.array_equal(history, found.history):
                break
            search = EquilibriumSearch(self._model, under, history)
            found = search.find(found.q, self._stable, self._side)
        return found

    @staticmethod
    def _at(under: LoadState, found: RestingShape) -> _Place:
        states = found.model.friction_states_after(found.q, under.u, under.p, found.history)
        return _Place(under, found.q, states)

    def _slid(self, q: Array, under: LoadState) -> Array:
        return self._model.slid(q, under.u, under.p)

    def _history(self, place: _Place, states: Array) -> Array:
        """Return the history that makes friction a stop operator, driven by the sliding from a place on the path."""
        return np.append(states - self._slid(place.q, place.under), 1.0) if self._count else np.zeros(0)

    def _statics(self, place: _Place, under: LoadState, turns: NDArray[np.bool_] | bool = False) -> tuple[Array, Array]:
        """Return missing force and stiffness if all sections that slide at a place continue to slide, except those that
        turn.
        """
        # 1e-6: beyond its range, a state does not change with sliding
        share = np.where(np.abs(place.states) >= 1.0, np.where(turns, 1.0 - 1e-6, 1.0 + 1e-6), 1.0)
        history = (self._history(place, share * place.states),) if self._count else ()
        missing, stiffness = self._core.statics(place.q, under.u, under.w, under.p, *history)
        return missing + under.held, stiffness

    def _leg(
        self, start: _Place, end: LoadState, guess: Array | None, halvings: int, known: RestingShape | None = None
    ) -> RestingShape:
        """Follow the path to a load; ``known`` is its shape by one leg, if that is found already."""
        whole = known or self._one_leg(start, end, guess, needed=not halvings or not self._count)
        if whole is not None and not self._count:
            return whole
        middle = start.under.towards(end, 0.5)
        half = self._one_leg(start, middle, None) if whole else None
        other = self._one_leg(self._at(middle, half), end, guess) if half else None
        rough, leaves, missed = True, False, 1.0
        if whole is not None and half is not None and other is not None:
            places = start, self._at(middle, half), self._at(end, other)
            one = self._at(end, whole).states
            others = [(places[-1], one), *((pair[1], self._turned(*pair)) for pair in pairwise(places))]
            missed = max(float(np.abs(place.states - states).max()) for place, states in others)
            rough = any(self._effect(*pair) > _ROUGH for pair in others)
            # A section that leaves the end of its range may first have slid on, which halves of the whole leg share.
            leaves = halvings == _HALVINGS and bool(np.any((np.abs(start.states) >= 1.0) & (one != start.states)))
        if not rough and other is not None and not (leaves and halvings):
            return other
        if not halvings and whole is not None:
            self._missed = max(self._missed, missed if rough else 0.0)
            return other or whole
        first = self._leg(start, middle, None, halvings - 1, half)
        return self._leg(self._at(middle, first), end, guess, halvings - 1, other if first is half else None)

    def _one_leg(
        self, start: _Place, end: LoadState, guess: Array | None, *, needed: bool = False
    ) -> RestingShape | None:
        """Find the shape at the end of a leg, as if no section slid to and fro; None if there is none."""
        search = EquilibriumSearch(self._model, end, self._history(start, start.states))
        try:
            found = search.find(start.q if guess is None else guess, self._stable, self._side)
        except SolverError:
            if needed:
                raise
            return None
        if found.model is not self._model:  # extend the ranges of the elements: the leg bends them further
            self._take(found.model)
        return found

    def _effect(self, place: _Place, states: Array) -> float:
        """Return the bend [1], per bending range, by which other friction states change the shape at a place.

        The effect of an error only fades later, since friction states follow the sliding as stop operators do.
        """
        if np.abs(states - place.states).max() < _SAME:
            return 0.0
        missing, stiffness = self._statics(place, place.under)
        other, _ = self._statics(replace(place, states=states), place.under)
        try:
            change = np.linalg.solve(stiffness, other - missing)
        except np.linalg.LinAlgError:
            return 1.0
        return float(np.abs(change).max() / self._reach)

    def _turned(self, start: _Place, end: _Place) -> Array:
        """Return the friction states (states,) at a place if sections slide to and fro before that, by the cubic
        through the sliding and its rates at both ends.
        """
        change = self._slid(end.q, end.under) - self._slid(start.q, start.under)
        rates = [
            self._rates(start, end.under, _NEARBY),
            self._rates(end, start.under, -_NEARBY),
        ]
        # Slopes up to thrice the secant, to the same side, leave a cubic monotone (F. N. Fritsch, R. E. Carlson, 1980,
        # doi:10.1137/0717021), as fading friction does.
        first, last = (
            np.where(rate * change > 0.0, np.sign(change) * np.minimum(np.abs(rate), 3.0 * np.abs(change)), rate)
            for rate in rates
        )
        states = start.states
        before: Array = np.zeros(self._count)
        for t in _PLACES:
            slid = t * (1.0 - t) ** 2 * first + t**2 * (3.0 - 2.0 * t) * change - t**2 * (1.0 - t) * last
            states, before = np.clip(states + slid - before, -1.0, 1.0), slid
        return states

    def _rates(self, place: _Place, other: LoadState, share: float) -> Array:
        """Return the rates of sliding (states,) at a place per leg, towards another load or, for a negative share, away
        from it.
        """
        near, turns = place.under.towards(other, abs(share)), np.zeros(self._count, dtype=bool)
        rates = np.zeros(self._count)
        # 4: searches for the sections that turn; where they are not found, halves of the leg differ
        for _ in range(4):
            missing, stiffness = self._statics(place, place.under, turns)
            try:
                change = np.linalg.solve(stiffness, missing - self._statics(place, near, turns)[0])
            except np.linalg.LinAlgError:
                return np.zeros(self._count)
            rates = (self._slid(place.q + change, near) - self._slid(place.q, place.under)) / share
            back = (np.abs(place.states) >= 1.0) & (rates * place.states < 0.0) & ~turns
            if share < 0.0 or not back.any():
                break
            turns |= back
        return rates
