"""The problem of a plan: motion, limits, goal, objective."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from continuum_grasp.addons.planning.assembly import OBJECTIVE, Assembly
from continuum_grasp.addons.planning.goal import goal_parts
from continuum_grasp.addons.planning.grid import PlanGrid, StateBounds, add_collocation, add_shooting
from continuum_grasp.addons.planning.guess import Path
from continuum_grasp.addons.planning.motion import PlannedMotion, without_rows
from continuum_grasp.addons.planning.result import Constraint
from continuum_grasp.addons.planning.shooting import amplification, derived
from continuum_grasp.base import Array, Indices
from continuum_grasp.nlp import Attempt, Violation

_BACKWARDS = 1e3
"""Unit of sliding, per the usual sliding [1]. Constraints hold to 1e-5; sliding back at a hundredth of the usual speed
moves a tendon by a tenth of the presliding in an interval, which friction hardly notices. Were it held to 1e-5 of the
usual speed, these curved rows would shorten the steps: 54 iterations in place of 12."""
_EFFORT_WHEN_RELAXED = 1e-4
"""Weight of the objective where only the distance from the goal is sought: it makes inputs unique, no more."""


@dataclass(frozen=True)
class OneWay:
    """Tendons slide one way all along, per friction state: +1, -1, or 0 for either.

    They come to rest still sliding forward, so that friction acts at rest as it did before, and nothing rings: a tendon
    that sticks makes the finger four times as stiff, with a quarter of its damping. ``speed`` is the usual sliding
    [1/s]. ``given``: friction acts as in tendons that slid this way before the motion begins, without their states.
    Where friction has to turn around first, tendons slide this way from the nodes ``since`` on, an entry per state.
    ``least`` (N + 1, states) is the least sliding at the nodes [1/s]; None: zero.
    """

    ways: Array
    speed: float
    given: bool = False
    since: Indices | None = None
    least: Array | None = None


class PlanProblem:
    """Unknowns, constraints and objective of a plan from a state x0 (nx).

    Where it is ``relaxed``, the distance from the goal is minimized in place of the objective, and hard bounds have a
    penalty. One that ``presses`` ends without rates, and comes into balance afterwards. Where ``one_way`` is None,
    tendons with friction may slide to and fro. ``before`` (1, nu) are columns of the input before the motion begins,
    ``inputs`` (N + 1, nu) columns of the inputs at the nodes; the last one is held after the end. Collocation has a
    polynomial on each of so many equal elements of every interval as ``counts`` (N) states; None: one.
    """

    def __init__(
        self,
        motion: PlannedMotion,
        x0: Array,
        *,
        relaxed: bool = False,
        one_way: OneWay | None = None,
        counts: Indices | None = None,
        presses: bool = False,
    ) -> None:
        self.motion = motion
        self.relaxed = relaxed
        self.one_way = one_way
        self.presses = presses
        self._counts = np.ones(motion.scene.intervals, dtype=np.int64) if counts is None else counts
        settles = one_way is None and bool(motion.friction_states)
        self.goal = goal_parts(motion, settles, presses)
        self._first = np.array(x0)
        if one_way is not None and one_way.given:
            stuck = self._first[motion.friction_states]
            self._first[motion.friction_states] = np.where(one_way.ways, one_way.ways, stuck)
        self._assemble()

    def _assemble(self) -> None:
        """Unknowns, rows and terms, with the steps of the motion."""
        motion, one_way = self.motion, self.one_way
        self.assembly = Assembly(semidefinite=not motion.exact)
        self._add_unknowns(self._first)
        weight = _EFFORT_WHEN_RELAXED if self.relaxed else 1.0
        self.motion_unknowns = self.assembly.size  # slacks follow
        if motion.scene.transcription == "collocation":
            add_collocation(self.assembly, motion, self.grid, weight)
        else:
            flow = motion.flow
            if one_way is not None and one_way.given:  # friction stays as it is, whatever slides
                flow = replace(flow, value=without_rows("flow_value", flow.value, motion.friction_states))
            self.steps = motion.steps
            self.interval = add_shooting(self.assembly, motion, flow, self.grid, weight, self.steps)
        self.bounds = StateBounds(self.assembly, motion, self.grid, self.relaxed)
        self._add_rate_limit()
        self._add_sliding()
        self._add_goal()
        self._add_objective()

    def rates(self, w: Array) -> Array:
        """Eigenvalues [1/s] of the motion at the nodes of a plan by single shooting."""
        _, data = self.interval
        size = self.motion.ns
        grid = self.grid
        places = zip(grid.reads(grid.s[:-1]), data, strict=True)
        slopes = [np.array(self.motion.flow.jacobian(w[columns], d[:, 0]))[:size, :size] for columns, d in places]
        return np.asarray(np.linalg.eigvals(np.array(slopes)).ravel()) / self.path(w).duration

    def outpaced(self, w: Array) -> bool:
        """Whether a motion is faster somewhere than the steps of single shooting are stable for."""
        steps, stages = self.steps
        rates = self.rates(w)
        step = self.path(w).duration / (len(self.grid.v) * steps)
        return bool((np.abs(amplification(stages, rates[rates.real < 0.0] * step)) > 1.0).any())

    def refine(self, w: Array) -> None:
        """Take steps that hold along a motion; unknowns and rows keep their places."""
        self.motion.hold(self.rates(w))
        self._assemble()

    # -- unknowns -----------------------------------------------------------------------------------------------------

    def _add_unknowns(self, x0: Array) -> None:
        motion, assembly = self.motion, self.assembly
        scene = motion.scene
        intervals = motion.scene.intervals
        first = np.array(scene.initial_input)
        time = assembly.variables(1, 1, *(t / motion.scales.time for t in scene.duration_range))
        low = np.full(motion.ns, -np.inf)
        high = np.full(motion.ns, np.inf)
        limits = [np.array(bound) / motion.scales.u for bound in scene.input_limits]
        if motion.linear:
            low[motion.nx :], high[motion.nx :] = limits
            rate_max = np.inf if scene.input.rate_max is None else scene.input.rate_max
            limits = [-rate_max / motion.scales.rate, rate_max / motion.scales.rate]
        s = assembly.variables(intervals + 1, motion.ns, low, high)
        v = assembly.variables(intervals, motion.nu, *limits)
        degree = scene.solver.degree if scene.transcription == "collocation" else 0
        elements = int(self._counts.sum())
        points = assembly.variables(elements * degree, motion.ns).reshape(elements, degree, motion.ns)
        assembly.fix(s[0], motion.scaled_state(x0, first))
        self.grid = PlanGrid(time, s, v, points, self._counts)
        if motion.linear:
            self.before = s[:1, motion.nx :]
            self.inputs = s[:, motion.nx :]
            return
        self.before = assembly.variables(1, motion.nu)
        assembly.fix(self.before, first / motion.scales.u)
        # The input may jump at the last node where the goal depends on what is held after the end.
        jumps = scene.goal.end == "held" or scene.goal.input is not None
        self.inputs = np.vstack([v, assembly.variables(1, motion.nu, *limits) if jumps else v[-1:]])

    @property
    def _changes(self) -> tuple[Indices, Indices]:
        """Columns of inputs and of those before them."""
        inputs = self.inputs
        if self.motion.linear:
            return inputs[1:], inputs[:-1]
        count = len(np.unique(inputs[:, 0]))  # the last one is that before it where it does not jump
        return inputs[:count], np.vstack([self.before, inputs[: count - 1]])

    def like(self, other: PlanProblem, w: Array) -> Array:
        """Unknowns that stand for the motion of another problem of this grid, between the nodes too."""
        unknowns = self.start(other.path(w))
        count = self.motion_unknowns
        unknowns[:count] = w[:count]
        return unknowns

    def start(self, path: Path) -> Array:
        """Unknowns that stand for a path, which may have states at equal parts of every interval too."""
        motion = self.motion
        grid = self.grid
        intervals = len(self.grid.v)
        w = np.zeros(self.assembly.size)
        parts = (len(path.x) - 1) // intervals
        w[grid.time] = path.duration / motion.scales.time
        nodes = np.arange(intervals + 1)
        at = np.linspace(0.0, intervals, len(path.x))
        u = path.u if parts == 1 else np.stack([np.interp(at, nodes, column) for column in path.u.T], axis=1)
        s = motion.scaled_state(path.x, u)
        w[grid.s] = s[::parts]
        if motion.linear:
            w[grid.v] = np.diff(path.u, axis=0) / path.duration * intervals / motion.scales.rate
        else:
            w[grid.v] = path.u[:-1] / motion.scales.u
            w[self.inputs[-1]] = path.u[-1] / motion.scales.u
            w[self.before] = np.array(motion.scene.initial_input) / motion.scales.u
        if grid.points.size:
            tau = parts * grid.shares
            part = np.ceil(tau).astype(int) - 1
            before = parts * grid.interval[:, None] + part
            tau = (tau - part)[..., None]
            w[grid.points] = s[before] * (1.0 - tau) + s[before + 1] * tau
        return w

    def path(self, w: Array) -> Path:
        """The path that unknowns stand for."""
        motion, grid = self.motion, self.grid
        x = w[grid.s][:, : motion.nx] * motion.scales.x
        return Path(x, w[self.inputs] * motion.scales.u, float(w[grid.time[0, 0]]) * motion.scales.time)

    def states(self, w: Array, parts: int) -> Array:
        """States (N parts + 1, nx) at equal parts of every interval."""
        columns, weights = self.grid.at(np.arange(1, len(self.grid.v) * parts + 1) / parts)
        s = np.vstack([w[self.grid.s[:1]], np.einsum("ij,ijk->ik", weights, w[columns])])
        return np.asarray(s[:, : self.motion.nx] * self.motion.scales.x)

    # -- limits, goal and objective -----------------------------------------------------------------------------------

    def _add_rate_limit(self) -> None:
        """Changes between intervals within the rate times their length."""
        motion = self.motion
        rate_max = self.motion.scene.input.rate_max
        if motion.linear or rate_max is None:
            return
        now, before = self._changes
        share = rate_max * motion.scales.time / len(self.grid.v) / motion.scales.u
        for name, sign in (("input rate, up", 1.0), ("input rate, down", -1.0)):
            rows = self.assembly.rows(name, "input.rate_max", motion.input_unit, len(now), motion.scales.u, -np.inf)
            self.assembly.add_linear(rows, now, sign)
            self.assembly.add_linear(rows, before, -sign)
            self.assembly.add_linear(rows, np.broadcast_to(self.grid.time, rows.shape), -share)

    def _add_sliding(self) -> None:
        """Forbid tendons that slide one way to slide back at any node; at the last one they may be at rest."""
        motion, one_way = self.motion, self.one_way
        if one_way is None:
            return
        chosen = np.flatnonzero(one_way.ways)
        s, _, _, d = motion.symbols
        unit = _BACKWARDS * one_way.speed
        value = ca.DM(one_way.ways[chosen] / unit) * motion.sliding[chosen.tolist()]
        nodes = self.grid.s[1:-1]
        since = one_way.since
        least = one_way.least
        lower = np.zeros((len(nodes), chosen.size)) if least is None else least[1:-1, chosen] / unit
        if since is not None:
            lower[np.arange(1, len(nodes) + 1)[:, None] < since[chosen]] = -np.inf
        rows = self.assembly.rows("sliding", "goal.end", "1/s", len(nodes), np.full(chosen.size, unit), lower, np.inf)
        self.assembly.add(derived("sliding", s, d, value, exact=False), nodes, rows, motion.numbers([0.0]))

    @property
    def _end(self) -> Indices:
        """Columns of the last node and of the input there."""
        return np.hstack([self.grid.s[-1:], self.inputs[-1:]])

    def _add_goal(self) -> None:
        data = self.motion.numbers([1.0])
        for part in self.goal:
            exact = part.weight is None
            if exact and not self.relaxed:
                rows = self.assembly.rows(part.name, part.key, part.unit, 1, part.scale)
                self.assembly.add(part.rows(self.motion), self._end, rows, data)
            elif exact or not self.relaxed:
                self.assembly.add(part.cost(self.motion, self.relaxed), self._end, [OBJECTIVE], data, aside=True)

    def _add_objective(self) -> None:
        motion = self.motion
        scene = self.motion.scene
        if self.relaxed:
            self._add_changes(lambda change, time: _EFFORT_WHEN_RELAXED / len(self.grid.v) * ca.dot(change, change))
            return
        if scene.objective == "least_time":
            self.assembly.add_linear(OBJECTIVE, self.grid.time, 1.0)
            self._add_changes(lambda change, time: scene.smoothing * ca.dot(change, change), aside=True)
        # Half of 2: least_input_rate is the integral of the squared rate, a cost's weight is that of half of it.
        rate_weight = scene.cost.input_rate if scene.cost is not None else 2.0
        if scene.objective in ("least_input_rate", "tracking") and rate_weight and not motion.linear:
            scale = ca.DM(motion.scales.u)
            factor = 0.5 * rate_weight * len(self.grid.v) / motion.scales.objective
            # Held inputs have no rate: a change counts as one that takes an interval.
            self._add_changes(lambda change, time: factor * ca.dot(change * scale, change * scale) / time)
        if motion.tracked is not None:
            # Half the weighted squared errors at the end, of what the state has, under the input that is held there.
            x, u, _, p, r = motion.physical
            count = motion.tracked.of_state
            z, d = motion.node
            errors = (motion.outputs(x, u, p) - r)[:count]
            weighted = ca.DM(np.sqrt(motion.tracked.weights[:count, 1])) * errors
            half = 0.5 * ca.dot(weighted, weighted)
            term = derived("terminal", z, d, half, exact=motion.exact, squared=weighted)
            self.assembly.add(term, self._end, [OBJECTIVE], motion.numbers([1.0]))

    def constraints(self, attempt: Attempt) -> dict[str, Constraint]:
        """All constraints by name, in physical units."""
        motion = self.motion
        lam = attempt.multipliers
        unit = self.motion.input_unit
        grid = self.grid
        found = {}

        def add(name: str, key: str, unit: str, scale: Array, *arrays: Array) -> None:
            values, low, high, force = arrays
            # A multiplier is objective per bound: its unit is the quotient of both units of the problem.
            bounds = values * scale, low * scale, high * scale
            # A zone may have the name of something else.
            found[name if name not in found else key] = Constraint(
                name, key, unit, *bounds, force * motion.scales.objective / scale
            )

        for block in self.assembly.blocks:
            values = self.bounds.values(attempt.x, attempt.g, block.key, block.rows)
            force = lam.constraints[block.rows]
            add(block.name, block.key, block.unit, block.scale, values, block.lower, block.upper, force)
        of_columns = [
            ("input", motion.scene.limit_keys, unit, self.inputs, motion.scales.u),
            ("duration", "duration", "s", grid.time, np.array([motion.scales.time])),
        ]
        if motion.linear and motion.scene.input.rate_max is not None:
            of_columns.append(("input rate", "input.rate_max", f"{unit}/s", grid.v, motion.scales.rate))
        low = np.array(self.assembly.low)
        high = np.array(self.assembly.high)
        for name, key, unit, columns, scale in of_columns:
            # A bound counts once: the last input may be that before it.
            once = np.zeros(columns.shape)
            once.flat[np.unique(columns, return_index=True)[1]] = 1.0
            add(name, key, unit, scale, *(v[columns] for v in (attempt.x, low, high)), once * lam.bounds[columns])
        return found

    def violations(self, attempt: Attempt) -> list[Violation]:
        """By how much an attempt violates each block of constraints."""
        values = self.bounds.values
        return [block.violation(values(attempt.x, attempt.g, block.key, block.rows)) for block in self.assembly.blocks]

    def objective(self, w: Array) -> float:
        """Objective of the scene at unknowns, without goals, penalties and smoothing, in its unit; also of a motion
        that is sought for its distance from the goal alone.
        """
        if self.relaxed:
            usual = PlanProblem(self.motion, self._first)
            return usual.objective(usual.like(self, w))
        whole = float(self.assembly.values(w)[0])
        return (whole - self.assembly.aside(w)) * self.motion.scales.objective

    def _add_changes(self, cost: Callable[[ca.SX, ca.SX], ca.SX], *, aside: bool = False) -> None:
        """A cost of the input's changes, in units of its range, and of the duration [s]."""
        motion = self.motion
        now = ca.SX.sym("now", motion.nu)
        before = ca.SX.sym("before", motion.nu)
        time = ca.SX.sym("T")
        z = ca.vertcat(now, before, time)
        term = derived("change", z, ca.SX(0, 1), cost(now - before, motion.scales.time * time))
        columns = np.hstack([*self._changes, np.repeat(self.grid.time, len(self._changes[0]), axis=0)])
        self.assembly.add(term, columns, [OBJECTIVE], [], aside=aside)
