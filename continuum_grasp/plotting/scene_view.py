"""Contents of a picture of a scene of any kind, before anything is solved: shapes, points and texts in the world."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from continuum_grasp.base import Array, amount_text
from continuum_grasp.plotting.drawing import bodies
from continuum_grasp.plotting.drawing.styled_axes import Box, bend_box
from continuum_grasp.plotting.grasp.view import turned, unloaded
from continuum_grasp.scene import CircleReference, Finger, FingerSetup, GraspScene, RowSamples

if TYPE_CHECKING:
    from continuum_grasp.scene import Peg, Support, Wall


class AppliedLoad(NamedTuple):
    """A force or a moment on a finger."""

    at: Array
    """World point (2,) [m]."""
    force: Array
    """Greatest force over time, world (2,) [N]; zero for a moment."""
    text: str
    """Kind of the load, with its greatest magnitude."""


@dataclass(frozen=True)
class SceneView:
    """Bodies to draw of a scene of any kind, in the world [m]."""

    scene: Any
    """A scene of one finger, a grasp, a mission, or a finger alone."""

    @cached_property
    def inner(self) -> Any:
        """Part of the scene with fingers, object and supports: of a mission its grasp."""
        grasp = getattr(self.scene, "grasp", None)
        return self.scene if hasattr(self.scene, "finger") or grasp is None else grasp

    @cached_property
    def fingers(self) -> dict[str, Finger]:
        """The fingers by name."""
        if isinstance(self.inner, Finger):
            return {"finger": self.inner}
        return dict(self.inner.named_fingers) if isinstance(self.inner, GraspScene) else {"finger": self.inner.finger}

    @cached_property
    def backbones(self) -> dict[str, Array]:
        """Unloaded backbones (points, 4): position along the finger, x, y [m], angle of the section's X axis [rad]."""
        return {name: unloaded(finger) for name, finger in self.fingers.items()}

    @cached_property
    def object(self) -> Any:
        """The object; None without one."""
        return getattr(self.inner, "object", None)

    @cached_property
    def outlines(self) -> list[Array]:
        """Outlines of the object's parts where it starts."""
        return [] if self.object is None else bodies.object_outlines(self.object, np.array(self.object.pose))

    @cached_property
    def before(self) -> list[Array]:
        """Outlines of the object where a mission finds it, before it is turned into its grasp."""
        turn = getattr(self.scene, "turn", None)
        if turn is None:
            return []
        return bodies.object_outlines(self.object, np.array([*turn.position, self.object.angle - turn.angle]))

    @cached_property
    def supports(self) -> dict[str, Support]:
        """The supports by name, with a table that is in the plane."""
        table = getattr(self.inner, "table", None)
        support = None if table is None else table.support
        palm = {} if support is None else {"table": support}
        return {**getattr(self.inner, "supports", {}), **palm}

    @property
    def walls(self) -> list[Wall]:
        """Straight surfaces of the supports."""
        return [wall for name, support in self.supports.items() for wall in support.walls(name)]

    @property
    def pegs(self) -> list[Peg]:
        """Round surfaces of the supports."""
        return [peg for name, support in self.supports.items() for peg in support.pegs(name)]

    @cached_property
    def gravity(self) -> tuple[Array, float]:
        """Gravity in the plane (2,), and into it [m/s2]."""
        if isinstance(self.inner, GraspScene):
            return np.array(self.inner.gravity[:2]), -self.inner.gravity[2]
        in_plane = np.array(getattr(self.inner, "gravity", (0.0, 0.0)))
        return in_plane, float(getattr(self.inner, "out_of_plane_gravity", 0.0))

    @cached_property
    def targets(self) -> dict[str, Array]:
        """Points (n, 2) that finger and object are led to, by the body that is led there."""
        goal = getattr(self.scene, "goal", None)
        reference = getattr(self.scene, "reference", None)
        targets = {}
        if goal is not None:
            targets = {"goal of the tip": goal.tip and goal.tip.value, "goal": goal.shape and goal.shape.value}
        elif reference is not None:
            targets = {
                "setpoint of the tip": _points(reference.tip),
                "setpoint": _points(reference.shape),
                "setpoint of the object": _points(reference.object_position),
            }
        return {name: np.reshape(points, (-1, 2)) for name, points in targets.items() if points is not None}

    @cached_property
    def contacts(self) -> dict[str, list[float]]:
        """Positions along each finger at which it is asked, or left free, to touch the object [m]."""
        if self.object is None:
            return {}
        if not isinstance(self.inner, GraspScene):
            return {"finger": [*self.inner.contacts, self.inner.finger.rod.length]}
        contacts = {}
        for setup in self.inner.setups:
            switched = zip(_spots(setup), setup.switches.values(), strict=True)
            contacts[setup.name] = [at for at, switch in switched if switch != "off"]
        return contacts

    @cached_property
    def loads(self) -> list[AppliedLoad]:
        """Forces and moments on the finger of a simulation, those that hold it at first too."""
        initial = getattr(self.scene, "initial", None)
        loads = (*getattr(self.scene, "loads", ()), *getattr(initial, "held_by", ()))
        return [acting for acting in map(self._acting, loads) if acting is not None]

    def _acting(self, load: Any) -> AppliedLoad | None:
        """Effect of a load where it is greatest; None where it is zero, as one that data replace."""
        at = self.on("finger", [load.at])[0]
        turn = 0.0
        if load.kind == "moment":
            values = np.atleast_1d(getattr(load.moment, "values", load.moment))
            moment = float(values[np.abs(values).argmax()])
            return AppliedLoad(at, np.zeros(2), f"moment {amount_text(moment, 'N m')}") if moment else None
        values = np.reshape(getattr(load.force, "values", load.force), (-1, 2))
        force = values[np.hypot(*values.T).argmax()]
        if not force.any():
            return None
        if load.follows:
            line = self.backbones["finger"]
            turn = float(np.interp(load.at, line[:, 0], line[:, 3]))
        return AppliedLoad(at, turned(force, turn), f"force {amount_text(float(np.hypot(*force)), 'N')}")

    def on(self, finger: str, places: Any) -> Array:
        """World points (n, 2) at positions along an unloaded finger [m]."""
        line = self.backbones[finger]
        return np.column_stack([np.interp(places, line[:, 0], line[:, k]) for k in (1, 2)])

    @cached_property
    def thickness(self) -> dict[str, Array]:
        """Outlines of the unloaded fingers (points, 2)."""
        return {name: bodies.finger_outline(line, self.fingers[name]) for name, line in self.backbones.items()}

    @cached_property
    def ranges(self) -> dict[str, tuple[Array, Array]]:
        """Least and greatest position [m] of what may be moved, by its name."""
        free: dict[str, Any] = {"object": self.object, **self.fingers}
        ranges: dict[str, tuple[Array, Array]] = {}
        for name, each in free.items():
            bounds = getattr(each, "base_free" if name in self.fingers else "free", None)
            if bounds is not None and (bounds.x or bounds.y):
                x, y = each.base.position if name in self.fingers else each.position
                low, high = np.transpose([bounds.x or (x, x), bounds.y or (y, y)])
                ranges[name] = low, high
        return ranges

    @cached_property
    def box(self) -> Box:
        """Limits of the picture: all that is somewhere, and of endless walls and zones the point nearest to it."""
        points = [*self.outlines, *self.before, *self.thickness.values(), *self.targets.values()]
        points += [np.array(ends) for ends in self.ranges.values()]
        points += bodies.zone_points(self.scene)
        points += [np.array([peg.position]) + peg.radius * bodies.CIRCLE for peg in self.pegs]
        middle = np.concatenate(points).mean(axis=0)
        for wall in self.walls:
            foot = middle - wall.height((float(middle[0]), float(middle[1]))) * np.array(wall.normal)
            points.append(np.array(wall.ends if np.isfinite(wall.half_length) else [foot]))
        side = float(np.ptp(np.concatenate(points), axis=0).max())
        # 0.16: labels stand around everything, up to two lines of 8 points in a drawing of 5 inches
        return bend_box(points, 0.16 * side)


def _spots(setup: FingerSetup) -> list[float]:
    """Positions of middle contacts and tip along a finger of a grasp [m]."""
    return [*setup.middle_places, setup.finger.rod.length]


def _points(setpoint: Any) -> Array | None:
    """World points (n, 2) of a setpoint: where it is, or is led along; None without one."""
    if setpoint is None:
        return None
    if isinstance(setpoint, CircleReference):
        return np.array(setpoint.center) + setpoint.radius * bodies.CIRCLE
    return np.reshape(setpoint.values if isinstance(setpoint, RowSamples) else setpoint, (-1, 2))
