"""Tangent of a grasp: how the object moves and forces change under small loads, and whether motions raise the energy.

The rows of a small motion are solved for loads on the object and couples on the sections at all nodes. Displacements
per load are the compliance S. Where a motion of an energy E has the norm m' m with m = D w, w the turns of the nodes,
the shift and the turn of the object, the stiffnesses are the inverses of the eigenvalues of D S D': a negative one is a
motion that lowers the energy. Directions that contacts hold have the eigenvalue zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from continuum_grasp.base import Array
from continuum_grasp.grasp.judge.borne_push import bears
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.clearance import places_of_nodes
from continuum_grasp.grasp.rods.motion import ContactMotion, GraspMotion, TendonBehavior
from continuum_grasp.grasp.rods.numbers import FingerNumbers
from continuum_grasp.grasp.rods.places import FingerPlaces
from continuum_grasp.grasp.rods.problem import GraspRods

Entries = tuple[Any, Any, Any]
"""Rows, columns and values of a sparse matrix."""
IDLE = 1e-6
"""Normal force per force unit up to which a contact bears nothing."""
HELD = 1e-4
"""Compliance, per the greatest of a bent finger, below which contacts hold a motion [1]: forces of contacts lower the
stiffness by at most their size times the length, a few hundred E I / L, and what contacts hold has up to 8e-5 of either
sign from loads at nodes (`free_base`, `mug_steady`)."""
SHIFT = 0.25
"""Shift of the object, per length of the first finger, that counts as much as a turn by 1 rad."""


@dataclass(frozen=True, eq=False)
class RodGraspResponse:
    """Changes by K loads.

    Attributes
    ----------
    shift : ndarray, shape (3, K)
        Of the object's center of mass [m].
    turn : ndarray, shape (3, K)
        Of the object [rad].
    forces : dict of str to ndarray, shape (4, K)
        Of N, f, g and tau of each contact [N], along directions that turn with it.
    """

    shift: Array
    turn: Array
    forces: dict[str, Array]


class GraspTangent:
    """Linear answers of a grasp at a solution.

    Parameters
    ----------
    problem : GraspRods
    x : ndarray
        Its unknowns.
    tendons : TendonBehavior
        What tendons do: their tensions or their lengths stay.

    Raises
    ------
    ValueError
        Nothing presses against the object.
    """

    def __init__(self, problem: GraspRods, x: Array, tendons: TendonBehavior = TendonBehavior.CONSTANT) -> None:
        self.problem, self.x = problem, x
        idle = [name for name, at in problem.contacts.items() if x[at[0]] * problem.numbers.force <= self._least]
        if len(idle) == len(problem.contacts):
            raise ValueError("no contact presses against the object: there is no grasp to move")
        self.motion = GraspMotion(problem, idle, tendons=tendons)
        self._columns = {place: k for k, place in enumerate(self.motion.changing.tolist())}
        self._places = {row: k for k, row in enumerate(self.motion.rows.tolist())}
        self._matrix = self._assembled()

    @property
    def _least(self) -> float:
        """Normal force up to which a contact is idle [N]."""
        return IDLE * self.problem.numbers.force

    def _assembled(self) -> csc_matrix:
        problem, motion = self.problem, self.motion
        jacobian = problem.nlp.functions["jac_g"](self.x, problem.parameters)[1].sparse().tocsr()
        own = jacobian[motion.rows][:, motion.changing].tocoo()
        entries: list[Entries] = [(own.row, own.col, own.data)]
        count = len(motion.rows)
        for row, force, give in motion.gaps:
            entries.append(([self._places[row]], [self._columns[force]], [give]))
        for places in motion.locks:
            entries.append(([count] * len(places), [self._columns[place] for place in places], [1.0] * len(places)))
            count += 1
        for contact in motion.of_contacts:
            entries += self._of_contact(contact, range(count, count + len(contact.rows)))
            count += len(contact.rows)
        rows, columns, values = (np.concatenate(parts) for parts in zip(*entries, strict=True))
        size = len(motion.changing)
        if count != size:
            raise ValueError(f"a small motion has {count} rows for {size} changes")
        return csc_matrix((values, (rows, columns)), shape=(size, size))

    def _of_contact(self, contact: ContactMotion, rows: Sequence[int]) -> list[Entries]:
        """Entries of a contact, whose own rows are given."""
        values = np.concatenate([self.x[contact.unknowns], np.zeros(len(contact.changes))])
        slope = contact.kind.slope(values, contact.data, self.problem.table)[:, len(contact.unknowns) :]
        forces = [self._columns[force] for force in contact.forces.tolist()]
        columns = np.array([self._columns.get(place, -1) for place in contact.changes.tolist()])
        moves = np.flatnonzero(columns >= 0)
        i, j = np.meshgrid([*rows, *self._moments(contact.balance)], columns[moves], indexing="ij")
        block = slope[[*contact.rows, *contact.balance]][:, moves]
        return [(rows, forces, np.full(len(forces), contact.give)), (i.ravel(), j.ravel(), block.ravel())]

    def _moments(self, rows: list[int]) -> list[int]:
        """Rows of the system of the moments (3 to 5) on the object."""
        return [self._places[int(self.problem.balance[row])] for row in rows]

    @cached_property
    def _solver(self) -> Any:
        return splu(self._matrix)

    def solved(self, loads: Array) -> Array:
        """Changes (changing, K) of the unknowns by loads (changing, K) on the rows."""
        return np.asarray(self._solver.solve(np.ascontiguousarray(loads)))

    # -- the object ----------------------------------------------------------------------------------------------

    def to_loads(self, loads: Array) -> Array:
        """Changes (changing, K) of the unknowns by loads (K, 6) on the object [F0, F0 size]."""
        right = np.zeros((len(self.motion.changing), len(loads)))
        rows, wanted = self.problem.balance.tolist(), self.motion.balance.tolist()
        for row in wanted:
            # The balance has the load among its parts.
            right[self._places[row]] = -loads[:, rows.index(row)]
        return self.solved(right)

    @property
    def _wrenches(self) -> tuple[list[int], Array]:
        """Components of a wrench (of 6) that move the object, and their units [N, N m]."""
        numbers = self.problem.numbers
        own = [0, 1, 5] if self.problem.geometry.dimensions == 2 else list(range(6))
        units = numbers.force * np.array([1.0, 1.0, 1.0, numbers.size, numbers.size, numbers.size])
        return own, units[own]

    def by_wrenches(self) -> tuple[Array, Array]:
        """Changes (changing, m) of the unknowns by each force and moment that moves the object [F0, F0 size], and its
        motion (m, m): shift of the center of mass [object size] and turn.
        """
        own, _ = self._wrenches
        changes = self.to_loads(np.eye(6)[own])
        return changes, np.concatenate(self._moved(changes))[own]

    @cached_property
    def response(self) -> RodGraspResponse:
        """Changes by forces along x, y, z [1 N] and moments about them [1 N m] at the object's center of mass: K = 6.

        A planar grasp does not answer to what leads out of its plane: zeros.
        """
        numbers = self.problem.numbers
        units = numbers.force * np.array([1.0, 1.0, 1.0, numbers.size, numbers.size, numbers.size])
        return self._seen(self.to_loads(np.diag(1.0 / units)))

    def by_tensions(self) -> RodGraspResponse:
        """Changes by each pull of each finger [1 N, 1 Pa of chambers], one finger after the other."""
        problem = self.problem
        pulls = np.concatenate([part.pulls for part in problem.parts])
        units = [pull.unit for finger in problem.numbers.fingers for pull in finger.section.pulls]
        jacobian = problem.nlp.functions["jac_g"](self.x, problem.parameters)[1].sparse().tocsr()
        loads = np.zeros((len(self.motion.changing), len(pulls)))
        loads[: len(self.motion.rows)] = -jacobian[self.motion.rows][:, pulls].toarray() / np.array(units)
        return self._seen(self.solved(loads))

    def _seen(self, changes: Array) -> RodGraspResponse:
        """Changes of unknowns as motions and forces in SI units."""
        problem = self.problem
        forces = {name: np.zeros((4, changes.shape[1])) for name in problem.contacts}
        for name, at in problem.contacts.items():
            unit = problem.numbers.force * problem.numbers.unit(name)
            for k, place in enumerate(at.tolist()):
                if place in self._columns:
                    forces[name][k] = unit * changes[self._columns[place]]
        shift, turn = self._moved(changes)
        return RodGraspResponse(problem.numbers.size * shift, turn, forces)

    def _moved(self, changes: Array) -> tuple[Array, Array]:
        """Shift (3, K) of the center of mass [object size] and turn (3, K) of the object."""
        problem, geometry, numbers = self.problem, self.problem.geometry, self.problem.numbers
        pose = changes[[self._columns[place] for place in problem.pose.tolist()]]
        none = np.zeros(changes.shape[1])
        turn = np.array([part + none for part in geometry.object_turn(self.x[problem.pose], pose)])
        axes: Array = np.array(geometry.turn(self.x[problem.pose], numbers.axes), dtype=float)
        place = np.array([part + none for part in geometry.place(pose)])
        return place + np.cross(turn, axes @ numbers.center, axis=0), turn

    # -- stability -----------------------------------------------------------------------------------------------

    @cached_property
    def compliance(self) -> Array:
        """Displacements by loads: turns of nodes [rad per E I / L], then shift and turn of the object
        in `SHIFT` lengths of the first finger and in radians, all loads per E I / L of the first finger.
        """
        problem, geometry = self.problem, self.problem.geometry
        first = problem.numbers.fingers[0]
        loads, turns = list[tuple[int, int, float]](), list[Array]()
        count = 0
        for finger, part in zip(problem.numbers.fingers, problem.parts, strict=True):
            ends = self._moment_rows(finger.name)[[node - 1 for node in self._seen_nodes(finger, part)]]
            for row in ends.ravel().tolist():
                loads.append((self._places[row], count, first.moment / finger.moment))
                count += 1
        own, units = self._wrenches
        lengths = np.array([*[first.length * SHIFT] * geometry.dimensions, *[1.0] * len(geometry.moments)])
        for row, unit, length in zip(self.motion.balance.tolist(), units, lengths, strict=True):
            loads.append((self._places[row], count, -first.moment / unit / length))
            count += 1
        rows, columns, values = zip(*loads, strict=True)
        right = np.zeros((len(self.motion.changing), count))
        right[list(rows), list(columns)] = values
        changes = self.solved(right)
        for finger, part in zip(problem.numbers.fingers, problem.parts, strict=True):
            turns += [self._turned(changes, finger, part, node) for node in self._seen_nodes(finger, part)]
        shift, turn = self._moved(changes)
        moved = np.concatenate([problem.numbers.size * shift, turn])[own] / lengths[:, None]
        return np.concatenate([*turns, moved])

    @staticmethod
    def _seen_nodes(finger: FingerNumbers, part: FingerPlaces) -> list[int]:
        """Nodes whose turns count: none of a middle contact, which moves along the finger, where curvature jumps."""
        jumps = part.touching[: len(finger.middles)]
        return [node for node in range(1, len(part.nodes)) if node not in jumps]

    def _moment_rows(self, finger: str) -> Array:
        """Rows (stages, moments) of the moments of a finger's stages."""
        moments = self.problem.geometry.moments
        return np.array([b.rows.ravel()[moments] for b in self.problem.blocks if b.name == f"rod, {finger}"])

    def _turned(self, changes: Array, finger: FingerNumbers, part: FingerPlaces, node: int) -> Array:
        """Turns (moments, K) of the section that is at a node: the node itself moves along the finger."""
        geometry, span, at = self.problem.geometry, part.span_of(node), part.nodes[node]
        own = changes[[self._columns[place] for place in at[: geometry.oriented].tolist()]]
        _, u = span.shares(node)
        for share, end in zip((1.0 - u, u), span.ends.tolist(), strict=True):
            if end in self._columns:
                unknowns = self.x[[*at, *span.force, *part.pulls, *span.ends]]
                data = np.array([*finger.acting(span.piece), u])
                rates = kinds.rate_kind(geometry, finger.section.form).value(unknowns, data, np.zeros(0))
                own = own - share * np.outer(rates, changes[self._columns[end]])
        turn = geometry.section_turn(self.x[at], own)
        return np.array([turn[k] for k in range(3 - len(geometry.moments), 3)])

    @cached_property
    def _weighed(self) -> Array:
        """Compliance by the norm of motions: of fingers, L times the square of the change of curvature."""
        problem, count = self.problem, len(self.problem.geometry.moments)
        parts = []
        for k, (finger, part) in enumerate(zip(problem.numbers.fingers, problem.parts, strict=True)):
            ds = np.diff(places_of_nodes(problem, self.x, k)[[0, *self._seen_nodes(finger, part)]])
            steps = (np.eye(len(ds)) - np.eye(len(ds), k=-1)) / np.sqrt(ds)[:, None]
            parts.append(np.kron(steps, np.eye(count)))
        weights = block_diag(*parts, np.eye(problem.geometry.dimensions + count))
        return np.asarray(weights @ self.compliance @ weights.T)

    @cached_property
    def eigenvalue(self) -> float:
        """Least stiffness of all motions that the contacts leave, in E I / L of the first finger; negative: a motion
        lowers the energy. Infinite where no motion is left.
        """
        # Friction that makes a finger's curvature jump follows the contact as that rolls: nearly symmetric alone.
        values = np.linalg.eigvals(self._weighed)
        free = values[np.abs(values) > HELD * max(1.0, np.abs(values).max())]
        return float((1.0 / free).real.min(initial=np.inf))

    @property
    def stable(self) -> bool:
        """Whether every small motion raises the energy."""
        return self.eigenvalue > 0.0

    # -- pushes --------------------------------------------------------------------------------------------------

    @cached_property
    def push(self) -> float:
        """Greatest push that the grasp bears in every direction [N]: no contact slips, parts or is pressed too hard.

        Zero of an unstable grasp.
        """
        return min(self.pushes.values()) if self.stable else 0.0

    @cached_property
    def pushes(self) -> dict[str, float]:
        """Greatest push in every direction that each contact bears [N]."""
        found, problem = dict[str, float](), self.problem
        _, high = problem.limits
        for name in self.motion.contacts:
            at, unit = problem.contacts[name], problem.numbers.force * problem.numbers.unit(name)
            slope = self.response.forces[name][:, : self.motion.directions]
            friction, most = problem.numbers.friction(name), high[at[0]] * unit
            found[name] = bears(unit * self.x[at], slope, np.eye(4)[0], friction, most)
        return found
