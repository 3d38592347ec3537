"""Readings of a bench while its drives follow commands, as a function of how it is mounted and of its finger.

The controller's finger moves as a plant (`PlantModel`), by the commands as they are held, without
friction in the tendons; the change by a little friction is added in the end (`BenchBlock.by_friction`). Derivatives are
differences.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from continuum_grasp.addons.identification.blocks import MeasuredBlock
from continuum_grasp.addons.identification.numbers import MeasuredColumn, MeasuredSet
from continuum_grasp.addons.identification.unknowns import DELAY, LAG, Unknown, read_unknowns
from continuum_grasp.base import Array, NumericalError, split_unit
from continuum_grasp.closed_loop import PlantModel, Wiring
from continuum_grasp.core import Rollouts, step_function
from continuum_grasp.scene import ControlScene, Mounting

CAMERA = ("camera_x", "camera_y", "camera_angle", "camera_scale")
"""Unknowns of the camera, as `Camera` has them."""
ZERO, BIAS = "drive_zero", "tension_zero"
"""Unknowns of the lines of drives and load cells, with their number behind them."""
_LONGEST = 4e-3
"""Longest step of the motion, and time between stored states [s]: between those, readings are interpolated by lines, to
0.02 mm of a tip that swings by 50 mm at 2 Hz."""
FRICTION = "tendon_friction"
"""Unknown that is found in the end: friction of the tendons."""
_FRICTION = 0.01
"""Friction of the tendons whose motion is compared with that without any [1]."""


class Log(NamedTuple):
    """Commands (K, nu), each held from its instant t (K,), and readings (T, ny) at instants (T,) by name and unit.

    ``notes`` are warnings of the reader; ``unread`` names the unused columns.
    """

    t: Array
    u: Array
    at: Array
    readings: Array
    names: tuple[str, ...]
    notes: tuple[str, ...] = ()
    unread: str = ""


class Bench:
    """A finger with its drives as a controller knows it, whose numbers may be others.

    Attributes
    ----------
    unknowns : list of Unknown
        Stiffness, payload, damping and lag as far as the scene has them, the delay, and zeros of drives: what changes
        the motion.
    zeros : list of ndarray
        Per zero, by how much of it the tension of each drive is off: of drives that oppose each other the difference
        alone bends the finger, and is half of each.
    """

    def __init__(self, scene: ControlScene, friction: bool = False, compiled: bool = True) -> None:
        self.scene = scene
        finger = scene.finger
        initial = scene.initial.without_history
        finger = finger.with_tendons(friction=0.0) if finger.has_tendon_friction else finger
        # A tip moment that depends on the shape, as friction makes it, is not for all families.
        plant: dict[str, Any] = {"fidelity": scene.fidelity}
        if friction:
            plant = {"fidelity": scene.fidelity.replaced(family=None), "tendon_friction": _FRICTION}
        plain = scene.replaced(mounting=None, loads=(), plant=plant, finger=finger, initial=initial)
        around = PlantModel(plain).scene
        damped = around.finger.damping.material > 0.0
        lag = scene.lag
        names = ["bending_stiffness", "tip_mass"] + ["material_damping"] * damped
        self.unknowns = read_unknowns(around, names)
        if lag is not None:
            self.unknowns.append(Unknown(LAG, "s", LAG, start=lag, lower=0.02 * lag, upper=50.0 * lag, typical=lag))
        self.model = PlantModel(plain, parameters=[unknown.target for unknown in self.unknowns] + [FRICTION] * friction)
        self.nominal = self.model.p.copy()
        period = scene.controller.step
        delay = 0.0 if scene.estimator is None else scene.estimator.delay
        size = max(delay, period)
        self.unknowns.append(Unknown(DELAY, "s", DELAY, start=delay, lower=0.0, upper=1.0, typical=size))
        sides = np.sign([tendon.arm(finger.rod.length) for tendon in finger.tendon_list] or [1.0])
        opposed = len(sides) == 2 and sides.sum() == 0.0
        self.zeros = [0.5 * sides] if opposed else list(np.eye(len(sides)))
        unit = split_unit(self.model.u_names[0]).unit
        greatest = float(max(scene.input_limits[1]))
        self.unknowns += [
            Unknown(f"{ZERO}_{k + 1}", unit, ZERO, lower=-greatest, upper=greatest, typical=0.05 * greatest)
            for k in range(len(self.zeros))
        ]
        method = self.model.method_for(period)
        stable = {"rk4": method.explicit_steps(period), "rodas": 1}.get(method.name, method.substeps)
        self.step = period / max(stable, math.ceil(period / _LONGEST))
        self._stored = max(1, math.floor(_LONGEST / self.step + 1e-9))
        step = step_function(self.model, method.name)
        inputs: Any = step.sx_in() if step.is_a("SXFunction") else step.mx_in()
        x, _, u, _, *others = inputs
        # a command that jumps between two steps acts in the second one alone
        held = ca.Function("held_" + step.name(), inputs, step.call([x, u, u, u, *others]), step.name_in(), ["xn"])
        self._run = Rollouts(held, compiled=compiled, what="the bench")
        x, u, w, p = self.model.symbols
        rate = self.model.forward_dynamics(x, u, w, p)
        self._rate = ca.Function("rate", [x, u, w, p], [rate, ca.jacobian(rate, x)])
        lagged = self.model.drive[: self.model.nu]
        shown = ca.vertcat(self.model.tip, lagged)
        self._shown = ca.Function("shown", [x, u, w, p], [ca.densify(shown)])
        self.names = (*Wiring.TIP, *self.model.u_names)
        self._maps = dict[int, ca.Function]()
        self._shown_last = b"", (np.zeros(0), np.zeros((0, 0)))

    def parameters(self, values: Array, friction: float = 0.0) -> Array:
        """Run-time parameters of the model (np,) from the values of ``unknowns``, and friction where it has that."""
        numbers = {unknown.target: unknown.factor * value for unknown, value in zip(self.unknowns, values, strict=True)}
        names = [*self.model.parameters, LAG][: self.nominal.size]
        return np.array([numbers.get(name, friction) for name in names])

    def commanded(self, u: Array, mounting: Mounting) -> Array:
        """Commands (K, nu) of the tendons from the commands of the bench."""
        commands = Wiring.of(mounting, self.names, self.model.u_names, "mounting").commands.back(u)
        return np.maximum(commands, 0.0) if self.scene.finger.tendons else commands

    def moved(self, t: Array, u: Array, p: Array, end: float) -> tuple[Array, Array, Array]:
        """Instants (N,), states (N, nx) and commands (N, nu) under commands held from instants t (K,) on until an end.

        It begins at rest under the first command. NumericalError if the motion does not stay finite.
        """
        step, stored = self.step, self._stored
        count = max(1, math.ceil((end - t[0]) / (stored * step)))
        ends = t[0] + step * np.arange(stored * count + 1)
        # each step has the mean of the commands that are held in it
        knots = np.append(t, max(t[-1], ends[-1]) + step)
        sums = np.cumsum(np.vstack([0.0 * u[:1], np.diff(knots)[:, None] * u]), axis=0)
        at_ends = [np.interp(ends, knots, column) for column in sums.T]
        means = np.diff(at_ends).T / step
        rows = np.vstack([np.repeat(means, 2, axis=0), means[-1:]])  # at half steps
        w = self.model.forces(0.0)
        begin = self._at_rest(rows[0], w[0], p)
        states, valid = self._run(begin[None], count, stored, step, rows, w, p)
        if valid[0] < count:
            time = float(ends[::stored][valid[0]])
            raise NumericalError(f"the motion is not finite after t = {time:g} s", time=time)
        return ends[::stored], states[0], rows[:: 2 * stored]

    def _at_rest(self, u: Array, w: Array, p: Array) -> Array:
        """State at rest (nx) under a command (nu), which drives have reached; friction stays near its start."""
        x = self.model.start.copy()
        names = self.model.x_names
        n = self.model.system.finger_model.n
        x[n : 2 * n] = 0.0
        exerted = []
        for name, value in zip(self.model.u_names, u, strict=True):
            if name in names:
                exerted.append(names.index(name))
                x[exerted[-1]] = value
        # Coordinates, with what materials and friction remember, by which accelerations and the rates of these vanish.
        others = [k for k in range(2 * n, self.model.system.nx) if k not in exerted]
        sought = [*range(n), *others]
        rows = [*range(n, 2 * n), *others]
        first = x.copy()

        def rate(moved: Array) -> tuple[Array, Array]:
            x[sought] = first[sought] + moved
            rates, slope = (np.array(part) for part in self._rate(x, u, w, p))
            return rates.ravel()[rows], slope[np.ix_(rows, sought)]

        # Friction that rests anywhere makes the Jacobian singular.
        none = np.zeros(len(sought))
        ends = {"ftol": 1e-15, "xtol": 1e-15, "gtol": None}
        solution = least_squares(lambda moved: rate(moved)[0], none, lambda moved: rate(moved)[1], **ends)
        # 1e-6: rate that counts as none, beside the greatest one before
        before = np.abs(rate(none)[0]).max()
        if not np.abs(solution.fun).max() <= 1e-6 * (1.0 + before):
            raise NumericalError("the finger has no state at rest under the first command", time=0.0)
        x[sought] = first[sought] + solution.x
        return x

    def shown(self, log: Log, mounting: Mounting, values: Array, friction: float = 0.0) -> tuple[Array, Array]:
        """Instants (N,), and tip and exerted inputs (N, 2 + nu) without delay, by the values of ``unknowns``."""
        p = self.parameters(values, friction)
        u = self.commanded(log.u, mounting)
        # what the camera and load cells count, and a delay, does not change the motion
        end = max(float(log.at[-1]), float(log.t[-1]))
        key = b"".join(array.tobytes() for array in (log.t, u, p, np.array(end)))
        if self._shown_last[0] != key:
            t, x, u = self.moved(log.t, u, p, end)
            w = np.repeat(self.model.forces(0.0), len(x), axis=0)
            if len(x) not in self._maps:
                self._maps[len(x)] = self._shown.map(len(x))
            same = np.repeat(p[:, None], len(x), axis=1)
            seen = self._maps[len(x)](x.T, u.T, w.T, same)
            self._shown_last = key, (t, np.array(seen).T)
        return self._shown_last[1]


class BenchBlock(MeasuredBlock):
    """The log of a bench that is connected as a mounting says, predicted for the unknowns of bench, camera and cells.

    The search for the camera starts at the camera of the mounting, and zeros of its lines at 0.
    """

    kinked = True  # where a tendon comes to be slack
    _by: Any = slice(None)

    def __init__(self, bench: Bench, log: Log, way: Mounting) -> None:
        count = bench.model.nu
        lines = Mounting.lines(range(1, count + 1), [1] * count)
        self.way = way.replaced(drives=way.drives or lines, tensions=way.tensions or lines)
        self.bench = bench
        self._log = log
        self.scene = bench.model.scene
        self._delay = [unknown.name for unknown in bench.unknowns].index(DELAY)
        greatest = float(max(bench.scene.input_limits[1]))
        length = bench.scene.finger.rod.length
        starts = (*way.camera.position, way.camera.angle, way.camera.scale)
        sizes = (0.05 * length,) * 2 + (0.1,) * 2
        rows = zip(CAMERA, ("m", "m", "rad", "1"), starts, sizes, strict=True)
        camera = [Unknown(name, unit, name, start=start, typical=size) for name, unit, start, size in rows]
        camera[-1] = camera[-1]._replace(lower=1e-6)
        # of the load cells those that are in the log
        cells = [name for name in log.names if name not in Wiring.TIP]
        self._cells = [bench.model.u_names.index(name) for name in cells]
        biases = [Unknown(bias_of(name), split_unit(name).unit, BIAS, typical=0.05 * greatest) for name in cells]
        self.unknowns = [*bench.unknowns, *camera, *biases]
        columns = []
        for label in log.names:
            name, unit = split_unit(label)
            quantity = name.removeprefix("tip_")
            if label in Wiring.TIP:
                columns.append(MeasuredColumn(name, "tip", unit, None, quantity, length))
            else:
                columns.append(MeasuredColumn(name, "tension", unit, None, quantity, None))
        fitted = np.ones(log.at.size, dtype=bool)
        self.measured = MeasuredSet("bench", tuple(columns), log.at, log.readings, fitted, moves=True, ordered=True)

    def mounting(self, values: Array) -> Mounting:
        """The mounting by the values of the unknowns."""
        count = len(self.bench.unknowns)
        of_bench = self.bench.zeros
        x, y, angle, scale, *biases = values[count:].tolist()
        shifts = values[count - len(of_bench) : count] @ np.array(of_bench)
        zeros = dict(zip(self._cells, biases, strict=True))
        cells = []
        for k, line in enumerate(self.way.tensions):
            cells.append(line.model_copy(update={"zero": zeros.get(k, 0.0)}))
        drives = []
        for line in self.way.drives:
            shift = float(shifts[line.of - 1])
            drives.append(line.model_copy(update={"zero": -line.sign * shift}))
        camera = self.way.camera.model_copy(update={"position": (x, y), "angle": angle, "scale": scale})
        return self.way.model_copy(update={"camera": camera, "drives": tuple(drives), "tensions": tuple(cells)})

    def again(self, unknowns: Sequence[Unknown], *, scene: Any = None, by: Any = None, **_: Any) -> Self:
        """The log with the finger of another scene, and its model; not compiled, as it is predicted once."""
        same = {key: getattr(scene, key) for key in ("finger", "fidelity", "initial")}
        changed = self.bench.scene.model_copy(update=same)
        again = type(self)(Bench(changed, compiled=False), self._log, self.way)
        again._by = self._by if by is None else list(by)
        return again

    def predict(self, values: Array, until: float = math.inf) -> tuple[Array, Array]:
        seen = self._seen(values)
        # 1e-4: change of an unknown, per typical size, of which the readings are compared
        steps = np.diag([1e-4 * unknown.typical for unknown in self.unknowns])[self._by]
        slopes = [(self._seen(values + step) - seen) / step.max() for step in steps]
        return seen, np.reshape(slopes, (len(steps), seen.size)).T

    def by_friction(self, values: Array) -> Array:
        """Derivative (m,) of the readings by friction of the tendons, at zero friction."""
        bench = Bench(self.bench.scene, friction=True)
        seen, without = (self._seen(values, bench, friction) for friction in (_FRICTION, 0.0))
        return (seen - without) / _FRICTION

    def _seen(self, values: Array, bench: Bench | None = None, friction: float = 0.0) -> Array:
        """Readings (m,) on a bench, its own where not given."""
        bench = bench or self.bench
        log = self._log
        mounting = self.mounting(values)
        t, base = bench.shown(log, mounting, values[: len(bench.unknowns)], friction)
        then = log.at - values[self._delay]
        moved = np.column_stack([np.interp(then, t, column) for column in base.T])
        readings = Wiring.of(mounting, bench.names, bench.model.u_names, "mounting").readings(moved)
        logged = [bench.names.index(name) for name in log.names]
        return np.asarray(readings[:, logged]).ravel()


def bias_of(name: str) -> str:
    """Unknown that is the zero of a load cell, by the name of its reading."""
    number = split_unit(name).name.rpartition("_")[2]
    return f"{BIAS}_{number}" if number.isdigit() else BIAS


def camera_through(points: Array, seen: Array, way: Mounting) -> tuple[Mounting, float]:
    """A mounting with the camera, mirrored or not as its own, that sees points (T, 2) [m] nearest to where they are
    seen, and the distance left.

    The similarity of least squares (S. Umeyama, 1991, doi:10.1109/34.88573), in complex numbers; the distance left is
    the root mean square distance [m].
    """
    world, image = (np.asarray(v[:, 0] + 1j * v[:, 1]) for v in (points, seen))
    image = image.conj() if way.camera.mirrored else image
    a, b = world - world.mean(), image - image.mean()
    factor = np.vdot(a, b) / np.vdot(a, a).real  # image = factor * (world - origin)
    origin = world.mean() - image.mean() / factor
    left = float(np.sqrt(np.mean(np.abs(b - factor * a) ** 2)))
    numbers = {"position": (origin.real, origin.imag), "angle": -float(np.angle(factor)), "scale": float(abs(factor))}
    return way.replaced(camera=way.camera.model_copy(update=numbers)), left
