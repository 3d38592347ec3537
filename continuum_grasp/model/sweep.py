"""Forward dynamics of many elements at a cost that grows with their number, by sweeps along the chain of links.

A body hinged to others is eliminated from the equations of the bodies before it (articulated bodies; R. Featherstone,
Rigid Body Dynamics Algorithms, 2008, doi:10.1007/978-1-4899-7560-7, chapter 7). Here a body is a flexible link, and
its bending coordinates are eliminated. Three kernels are functions of one link:

    outward     shape, inertia and forces of the link, of all links side by side
    inward      inertia P and force g that the start of the link feels of all that is beyond, coordinates eliminated
    onward      accelerations, from the start of the link to its end

The state of the sweep belongs to a section: its velocity, stored like the arms of ``link`` before the turn by a right
angle, its angular velocity, and the coordinates that its link shares with the one before. Weight is an acceleration of
the base. Everything is in the axes of the link at hand. It is as accurate as the dense solution: both lose the
condition of the mass matrix.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import casadi as ca

from continuum_grasp.base import Array
from continuum_grasp.model.equations import Equations

SECTION = 3
"""Entries of the velocity of a section: two of its position, one of its angle [1]."""


@dataclass(frozen=True)
class Kernels:
    """SX functions that make up a sweep; all arguments are columns.

    | function | inputs                              | outputs                                  |
    |----------|-------------------------------------|------------------------------------------|
    | head     | lag, u, p                           | drive, tip, tip_rate, base, lagging      |
    | carry    | spin, q, qd, row                    | spun                                     |
    | tip      | spin, lag, u, p                     | end                                      |
    | outward  | spin, q, qd, r, row, drive, p, part | shape, body                              |
    | turn     | turn, shape                         | turned                                   |
    | loads    | turns, x, u, w, p                   | force                                    |
    | inward   | end, shape, body, row, p, force     | handed, gain                             |
    | root     | end, base                           | start                                    |
    | onward   | start, shape, gain, row             | following, rates                         |

    q, qd and r are the local entries of full vectors, ``row`` describes the link, ``spin`` is the angular velocity
    of its start, ``turn`` its rotation, ``end`` what the inward sweep hands on, ``start``
    the accelerations at the start of a link, ``rates`` the rates of the coordinates that it does not share with the
    link before. ``turns`` belong to the loaded links, one after the other, ``force`` has a column per load, and
    per link where tendons with a tension of their own or dry friction act. Inputs of no
    use are empty. ``rows`` (N, T) are numbers of each link, ``loaded`` is the link of each load, and ``shared`` the
    number of coordinates that neighbors share.
    """

    head: ca.Function
    carry: ca.Function
    tip: ca.Function
    outward: ca.Function
    turn: ca.Function
    loads: ca.Function
    inward: ca.Function
    root: ca.Function
    onward: ca.Function
    rows: Array
    loaded: tuple[int, ...]
    shared: int
    unknowns: int

    section: ClassVar[int] = SECTION
    """Entries of the velocity of a section."""

    @classmethod
    def of_sweep(cls, name: str) -> Kernels | None:
        """Kernels behind a function that `sweep_function` has made; None of other functions."""
        return _SWEEPS.get(name)

    @property
    def links(self) -> int:
        return len(self.rows)

    @property
    def local(self) -> int:
        """Local coordinates of a link."""
        return int(self.outward.size1_in("q"))

    @property
    def stride(self) -> int:
        """Coordinates from one link to the next."""
        return self.local - self.shared

    @property
    def functions(self) -> tuple[ca.Function, ...]:
        """Functions of the sweep, all of them."""
        return tuple(function for function in vars(self).values() if isinstance(function, ca.Function))

    @cached_property
    def instructions(self) -> int:
        once = {f.name() for f in (self.head, self.tip, self.loads, self.root)}
        return sum(int(f.n_instructions()) * (1 if f.name() in once else self.links) for f in self.functions)


def digest(content: bytes) -> str:
    """Name of a content."""
    return hashlib.sha256(content).hexdigest()[:16]


_SWEEPS: dict[str, Kernels] = {}
"""Kernels by the name of their function: ``core`` and ``export`` replace it by one loop."""


def sweep_function(made: Kernels, eq: Equations, *, implicit: bool = False) -> ca.Function:
    """A sweep as CasADi's own loops: (x, u, w, p [, part, r]) -> rates of the unknowns' rates, and of the lag.

    x, u, w and p are as in the equations; ``part`` [s] and r (n), the rates, as in an implicit step.
    """
    x, u, w, p = (ca.MX.sym(key, getattr(eq, key).numel()) for key in "xuwp")
    inputs = {"x": x, "u": u, "w": w, "p": p}
    n, count, local = made.unknowns, made.links, made.local
    if implicit:
        inputs |= {"part": ca.MX.sym("part"), "r": ca.MX.sym("r", n)}
    drive, tip, tip_rate, base, lagging = made.head(x[2 * n : 2 * n + eq.lag.numel()], u, p)

    def windows(vector: ca.MX, tip: ca.MX) -> ca.MX:
        """Local entries of every link (L, N)."""
        whole, last = ca.vertcat(vector, tip), made.stride * (count - 1) + 1
        return ca.vertcat(*[whole[a : a + last : made.stride].T for a in range(local)])

    q, qd = windows(x[:n], tip), windows(x[n : 2 * n], tip_rate)
    # The tip that moves with the input is at the end of the step already.
    r = windows(inputs["r"], ca.MX.zeros(tip.numel())) if implicit else ca.MX(0, count)
    rows = ca.MX(ca.DM(made.rows.T))
    part = inputs.get("part", ca.MX(0, 1))
    same = [ca.repmat(each, 1, count) for each in (drive, p, part)]

    def from_base(state: ca.DM, function: ca.Function, *given: ca.MX) -> ca.MX:
        """Values that a function accumulates, at the start of every link and at the tip."""
        return ca.horzcat(state, function.mapaccum(count)(state, *given))

    *starts, last = ca.horzsplit(from_base(ca.DM.zeros(made.carry.size1_in("spin")), made.carry, q, qd, rows))
    spins, end = ca.horzcat(*starts), made.tip(last, x[2 * n : 2 * n + eq.lag.numel()], u, p)
    shape, body = made.outward.map(count)(spins, q, qd, r, rows, *same)
    force = ca.MX(made.inward.size1_in("force"), count)
    if made.loaded:
        turns = from_base(ca.DM([1.0, 0.0]), made.turn, shape)
        loads = made.loads(ca.vec(turns[:, list(made.loaded)]), x, u, w, p)
        columns: list[ca.MX] = [ca.MX.zeros(force.shape[0])] * count
        for link, load in zip(made.loaded, ca.horzsplit(ca.reshape(loads, force.shape[0], -1)), strict=True):
            columns[link] = columns[link] + load
        force = ca.horzcat(*columns)
    back = list(range(count - 1, -1, -1))
    handed = [each[:, back] for each in (shape, body, rows, same[1], force)]
    ends, gains = made.inward.mapaccum(count)(end, *handed)
    first = made.root(ends[:, -1], base)
    _, rates = made.onward.mapaccum(count)(first, shape, gains[:, back], rows)
    results = [ca.vertcat(first[SECTION:], ca.vec(rates))[:n], lagging]
    name = f"sweep_{digest(' '.join([f.name() for f in made.functions]).encode() + made.rows.tobytes())}"
    _SWEEPS[name] = made
    return ca.Function(name, list(inputs.values()), results, [*inputs], ["rates", "lagging"], {"never_inline": True})
