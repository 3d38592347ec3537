"""The certificate's own search for friction states with which a grasp does not hold.

At a vertex of the friction states the statics are linear to first order, so that the greatest reserve of the cones over
all postures that balance is, for any other vertex, a problem of a few unknowns. It is solved for all vertices where
there are not too many, else descended from many by its slope; the worst are verified by postures of their own, and the
search goes on from the worst of those.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.check import CONES, EQUILIBRIUM, Check
from continuum_grasp.grasp.certificate.postures import Posture, Postures
from continuum_grasp.grasp.certificate.recomputed import OF_CONTACTS, RecomputedGrasp, known_contacts
from continuum_grasp.grasp.certificate.surfaces import PlacedObject

Array = NDArray[Any]
Arrays = Mapping[str, Array]

MOST = 24
"""Postures that are sought in all: 4 to 10 are enough as a rule."""
EACH = 3
"""Vertices that are verified of those that are worst about one posture, to first order."""
WORSE = 1e-5
"""Reserve by which a vertex must be worse than those known [1]."""
_ALL, _DRAWN = 9, 64
"""States up to whose number all vertices are compared to first order, and random ones from which it is descended."""
_DESCENTS = 4
"""Rounds of that descent: two are enough as a rule."""
_SETS = 3
"""Sets of contacts that are tried where the first does not hold."""
_TOUCHES = 1e-3
"""Gap, per length of the finger, up to which a contact that is clear may touch instead."""


@dataclass(frozen=True)
class StateSearch:
    """What the certificate's own search found.

    Attributes
    ----------
    tried : int
        Vertices of the friction states that were verified by postures of their own.
    unsettled : int
        Of these, those to which no posture was found.
    states : ndarray, shape (K,)
        The worst of all, those that are stored included.
    reserve : float
        By how much all friction cones could be narrower there, per greatest force [1].
    part : float
        The greatest part of a limit that its posture takes; above 1 the grasp does not hold.
    violated : str
        Which check that is.
    """

    tried: int
    unsettled: int
    states: Array
    reserve: float
    part: float
    violated: str

    @property
    def holds(self) -> bool:
        """Whether the grasp holds there."""
        return self.part <= 1.0

    @property
    def words(self) -> str:
        """The same in words."""
        missing = f", {self.unsettled} of them without an answer" if self.unsettled else ""
        worst = f"worst {signs(self.states)} with a reserve of {self.reserve:.2%} of the greatest force"
        broken = "" if self.holds else f", where it does not hold: {self.violated}, {self.part:.3g} times its limit"
        return f"searched {self.tried} sets of friction states{missing}, {worst}{broken}"

    def data(self) -> dict[str, Any]:
        """The same as plain data."""
        return {**asdict(self), "states": self.states.tolist(), "holds": self.holds}

    def check(self) -> Check:
        """That as a check."""
        return Check("held with the worst friction states that the certificate finds", self.part, 1.0, "1", "limits")


@dataclass(frozen=True)
class _Known:
    """A posture that was found, and the check that it takes the greatest part of."""

    posture: Posture
    part: float
    violated: str

    @property
    def holds(self) -> bool:
        """Whether all checks pass."""
        return self.part <= 1.0

    @property
    def reserve(self) -> float:
        """Of the cones; where other limits are exceeded, less than that with which any cone holds."""
        return self.posture.reserve if self.holds else min(self.posture.reserve, -CONES * self.part)


def search_states(
    grasp: RecomputedGrasp, held: Sequence[tuple[Array, Arrays]], parts: Callable[[Arrays], dict[str, float]]
) -> StateSearch:
    """Seek the worst friction states of a grasp.

    Parameters
    ----------
    grasp : RecomputedGrasp
        As it is reached.
    held : sequence of (ndarray, shape (K,), mapping)
        Vertices that are verified already, and their postures.
    parts : callable
        The parts of its limits that a posture takes, by check.
    """
    return _Search(grasp, held, parts).run()


def signs(states: Sequence[float] | Array) -> str:
    """Friction states from base to tip, by sign alone where all are at their limits."""
    if all(abs(z) == 1.0 for z in states):
        return "".join("+" if z > 0.0 else "-" for z in states)
    return " ".join(f"{z:+.3g}" for z in states)


class _Search:
    def __init__(
        self, grasp: RecomputedGrasp, held: Sequence[tuple[Array, Arrays]], parts: Callable[[Arrays], dict[str, float]]
    ) -> None:
        self.grasp, self.postures, self.parts = grasp, Postures(grasp), parts
        self.stored = list(held)
        self.known: dict[bytes, _Known] = {}
        self.tried = self.unsettled = 0
        self.random = np.random.default_rng(0)

    def run(self) -> StateSearch:
        """Search from the worst posture that is stored, from fingers that were pulled, and from those released."""
        least = [self._reserve(arrays) for _, arrays in self.stored]
        for k in dict.fromkeys([int(np.argmin(least)), 0, min(1, len(self.stored) - 1)]):
            states, arrays = self.stored[k]
            found = self._verified(states, [arrays])
            # What is stored passed its checks, whatever is found next to it.
            if found is not None and not found.holds:
                del self.known[states.tobytes()]
        done: set[bytes] = set()
        while self.tried < MOST:
            order = sorted(self.known.values(), key=lambda one: one.reserve)
            base = next((one for one in order if one.posture.states.tobytes() not in done), None)
            if base is None or not order[0].holds:
                break
            done.add(base.posture.states.tobytes())
            worst = order[0].reserve
            for states in self._candidates(base.posture)[: min(EACH, MOST - self.tried)]:
                found = self._verified(states, self._near(states))
                if found is not None and found.reserve < worst - WORSE:
                    break
                # Those that are no worse lead nowhere: the next base is one of the first three.
                done.add(states.tobytes())
        k = int(np.argmin(least))
        worst_one = min(self.known.values(), key=lambda one: one.reserve, default=None)
        if worst_one is None or least[k] < worst_one.reserve:
            states, arrays = self.stored[k]
            taken = self.parts(arrays)
            violated = max(taken, key=lambda name: taken[name])
            return StateSearch(self.tried, self.unsettled, states, least[k], taken[violated], violated)
        posture = worst_one.posture
        own = posture.states, posture.reserve, worst_one.part, worst_one.violated
        return StateSearch(self.tried, self.unsettled, *own)

    def _reserve(self, arrays: Arrays) -> float:
        """Of the cones of a posture as it is stored."""
        forces = np.asarray(arrays["contact_forces"], dtype=float)
        friction = np.array([self.grasp.scene.held_friction(str(name)) for name in arrays["contact_names"]])
        spare = friction * forces[:, 0] - np.hypot(forces[:, 1], forces[:, 2])
        return float(spare.min(initial=np.inf)) / self.grasp.force_scale

    def _candidates(self, posture: Posture) -> list[Array]:
        """Vertices that are not known, the worst to first order about a posture first."""
        model = posture.model()
        count = self.postures.count
        if count <= _ALL:
            tried = np.array(list(product((1.0, -1.0), repeat=count)))
            reserves = model.reserves(tried).reserve
        else:
            turned = posture.states * np.where(np.eye(count), -1.0, 1.0)
            drawn = self.random.choice([-1.0, 1.0], (_DRAWN, count))
            tried = np.concatenate([[states for states, _ in self.stored], turned, drawn])
            rounds = []
            for _ in range(_DESCENTS):
                found = model.reserves(tried)
                rounds.append((found.reserve, tried))
                slopes = model.slopes(found)
                tried = np.where(slopes > 0.0, -1.0, np.where(slopes < 0.0, 1.0, tried))
            reserves = np.concatenate([reserve for reserve, _ in rounds])
            tried = np.concatenate([each for _, each in rounds])
        tried, first = np.unique(tried, axis=0, return_index=True)
        order = np.argsort(reserves[first], kind="stable")
        stored = {states.tobytes() for states, _ in self.stored}
        return [tried[k] for k in order if tried[k].tobytes() not in self.known.keys() | stored]

    def _near(self, states: Array) -> list[Arrays]:
        """Postures next to which one is sought, the nearest first, one for each set of contacts."""
        every = [*self.stored, *((one.posture.states, one.posture.arrays) for one in self.known.values())]
        every.sort(key=lambda one: int((one[0] != states).sum()))
        found: dict[frozenset[str], Arrays] = {}
        for _, arrays in every:
            found.setdefault(frozenset(str(name) for name in arrays["contact_names"]), arrays)
        return list(found.values())

    def _verified(self, states: Array, near: Sequence[Arrays]) -> _Known | None:
        """The posture with states, of those of several sets of contacts the best; None where there is none."""
        self.tried += 1
        best: _Known | None = None
        left: list[Arrays] = list(near)
        sets: set[frozenset[str]] = set()
        while left and len(sets) < _SETS + len(near):
            begin = left.pop(0)
            names = frozenset(str(name) for name in begin["contact_names"])
            if names in sets:
                continue
            sets.add(names)
            for deep in (False, True):
                posture = self.postures.at(states, begin, deep=deep)
                if posture is None:
                    continue
                taken = self.parts(posture.arrays)
                violated = max(taken, key=lambda name: taken[name])
                one = _Known(posture, taken[violated], violated)
                if best is None or one.reserve > best.reserve:
                    best = one
                    left += [] if one.holds else self._switched(posture)
                if one.holds:
                    break
            if best is not None and best.holds:
                break
        if best is None:
            self.unsettled += 1
            return None
        self.known[states.tobytes()] = best
        return best

    def _switched(self, posture: Posture) -> Iterator[Arrays]:
        """The posture without one contact that does not press, and with one more that the finger nearly makes or
        passes, where the scene leaves these open.
        """
        arrays, scene = posture.arrays, self.grasp.scene
        names = [str(name) for name in arrays["contact_names"]]
        known = known_contacts(scene)
        forces = np.asarray(arrays["contact_forces"])[:, 0]
        for k in np.argsort(forces):
            owner = known[names[k]][1]
            alone = sum(known[name][1] == owner for name in names) == 1
            presses = forces[k] >= EQUILIBRIUM * self.grasp.force_scale
            if names[k] in self._open and not alone and not presses:
                yield _without(arrays, int(k))
        body = PlacedObject(scene.object, arrays["object.pose"])
        for name in sorted(self._open - set(names)):
            _, owner, joint, _ = known[name]
            finger = self.grasp.fingers[owner or 0]
            s = float(np.sum(arrays[f"{finger.name}.lengths"][:joint]))
            line = arrays[f"{finger.name}.backbone"]
            center = np.array([[np.interp(s, line[:, 0], line[:, column]) for column in (1, 2)]])
            part = int(np.argmin(body.distances(center)[:, 0]))
            found = body.nearest(center, part)
            if found.distance[0] - float(finger.skin(s)) < _TOUCHES * finger.length:
                yield _with(arrays, name, found.point[0], found.normal[0], s, part)

    @cached_property
    def _open(self) -> set[str]:
        """Names of the contacts that may be on or off."""
        return {name for setup in self.grasp.setups for name, switch in setup.switches.items() if switch == "auto"}


def _without(arrays: Arrays, contact: int) -> dict[str, Array]:
    """A posture's arrays without one of its contacts."""
    return {k: np.delete(v, contact, axis=0) if k in OF_CONTACTS else v for k, v in arrays.items()}


def _with(arrays: Arrays, name: str, point: Array, normal: Array, at: float, part: int) -> dict[str, Array]:
    """A posture's arrays with one more contact, which does not press yet."""
    more: dict[str, Any] = {"names": [name], "positions": [point], "normals": [normal], "forces": [np.zeros(3)]}
    more |= {"stations": [at], "parts": [part]}
    return {**arrays, **{f"contact_{key}": np.append(arrays[f"contact_{key}"], v, axis=0) for key, v in more.items()}}
