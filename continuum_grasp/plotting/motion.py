"""Motions, tendons and natural modes: the finger at instants and frame by frame, curves over time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import InputError, split_unit
from continuum_grasp.plotting.drawing import bodies
from continuum_grasp.plotting.drawing.film import Film
from continuum_grasp.plotting.drawing.forces import ForceArrows, explain
from continuum_grasp.plotting.drawing.style import Color, Z
from continuum_grasp.plotting.drawing.styled_axes import Box, StyledAxes, bend_box, over_time, symbol
from continuum_grasp.scene import SAME

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from continuum_grasp.scene import Finger
    from continuum_grasp.simulation import Equilibrium, Modes, Trajectory

Moved: TypeAlias = Any
"""A result of a finger in motion: a `Trajectory`, a `ControlRun`, or what an add-on has with the same attributes."""
_QUANTITY = {"rad": "bending angle", "1/m": "curvature"}
_INSTANTS = 12
"""Instants at which a finger, or the tensions along it, are drawn [1]."""
_LOOKED, _PLACES, _STILL = 1000, 9, 1e-3
"""Instants and places of a finger whose way is measured [1], and the way per length below which poses look the same."""
_STYLES: tuple[Literal["-", "--", ":", "-."], ...] = ("-", "--", ":", "-.")


def plot_snapshots(motion: Moved, *, times: Sequence[float] | int = _INSTANTS, ax: Axes | None = None) -> Axes:
    """Draw the finger at several instants, colored by time, with clamp, point masses and the last forces to scale.

    ``times`` are instants [s], whose nearest computed ones are drawn, or how many: between two of these, finger
    or object go as far as between any others. An object is drawn at the same instants, filled at the last of them, with
    its supports. The backbones are the first collection of the axes, arrows of each kind of force at the last instant a
    quiver.
    """
    return draw_snapshots(motion, times, ax)


def draw_snapshots(
    motion: Moved,
    times: Sequence[float] | int = _INSTANTS,
    ax: Axes | None = None,
    beside: Callable[[Axes], None] = lambda ax: None,
    seen: Sequence[NDArray[Any]] = (),
) -> Axes:
    """Draw `plot_snapshots` and pictures ``beside`` them; ``seen`` are further points to show."""
    t = np.asarray(motion.t)
    scene = motion.scene
    indices = _along_the_way(motion, times) if isinstance(times, int) else _nearest(t, times)
    shapes = np.asarray(motion.backbone(indices, points=bodies.backbone_points(scene.finger)))
    outlines = bodies.outlines_at(motion, indices)
    every = _arrows_at(motion, indices)
    arrows = replace(every, frames=every.frames[-1:])
    points = [shapes, *_thickness(scene.finger, shapes), *bodies.zone_points(scene), *chain(*outlines), *seen]
    styled = StyledAxes.plane(ax, _box(points, arrows))
    ax = styled.ax
    bodies.draw_surroundings(ax, motion, shapes[0], outlines, index=int(indices[-1]))
    lines = styled.draw_timed(shapes, t[indices], t)
    bodies.draw_earlier(ax, shapes[:-1], lines.to_rgba(t[indices[:-1]]), scene.finger)
    if outlines or bodies.shows_thickness(scene.finger):
        bodies.draw_thickness(ax, shapes[-1], scene.finger)
    masses = bodies.masses_of(scene.finger)
    if masses:
        spots = np.concatenate([bodies.mass_positions(shape, scene.finger) for shape in shapes])
        shade = lines.to_rgba(np.repeat(t[indices], len(masses)))
        ax.scatter(spots[:, 0], spots[:, 1], s=34, c=shade, edgecolors="white", linewidths=0.7, zorder=Z.MASS)
    arrows.draw(ax)
    beside(ax)
    names = {kind: f"{kind} at {t[indices[-1]]:.3g} s" for _, _, kind in arrows.forces}
    explain(ax, masses, arrows, motion.name, names)
    return ax


def _along_the_way(motion: Moved, count: int) -> np.ndarray:
    """Indices of the first and the last instant, and of others between which finger or object go equally far.

    The way from instant to instant is measured at the point that goes farthest.
    """
    if count < 1:
        raise InputError(f"expected at least one instant, got {count}", key="times")
    looked = np.unique(np.linspace(0, len(motion.t) - 1, _LOOKED).round().astype(int))
    bodies_at = [np.asarray(motion.backbone(looked, points=_PLACES))]
    outlines = bodies.outlines_at(motion, looked)
    if outlines:
        bodies_at.append(np.array([np.concatenate(parts) for parts in outlines]))
    steps = [np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1) for points in bodies_at]
    way = np.concatenate([[0.0], np.cumsum(np.nan_to_num(np.max(steps, axis=0)))])
    if way[-1] < _STILL * motion.length:
        count = min(count, 2)
    chosen = looked[np.abs(way - np.linspace(0.0, way[-1], count)[:, None]).argmin(axis=1)]
    chosen[-1] = looked[-1]
    return np.unique(chosen)


def _nearest(t: np.ndarray, times: Sequence[float]) -> np.ndarray:
    """Indices of the instants nearest to ``times``, each once."""
    wanted = np.asarray(times, dtype=float)
    slack = 1e-9 * max(1.0, abs(float(t[-1])))  # rounding of an instant that a user computes, k * step
    if not wanted.size or np.any((wanted < t[0] - slack) | (wanted > t[-1] + slack) | np.isnan(wanted)):
        raise InputError(f"expected instants from {t[0]:g} s to {t[-1]:g} s, got {wanted.tolist()}", key="times")
    return np.unique(np.abs(t[None, :] - wanted[:, None]).argmin(axis=1))


def motion_frames(
    motion: Moved,
    indices: NDArray[Any],
    width: int,
    ahead: Callable[[Film, NDArray[Any]], Callable[[int], list[Artist]]] | None = None,
    seen: Sequence[NDArray[Any]] = (),
) -> Iterator[NDArray[Any]]:
    """Draw a motion at instants (F,), frame by frame: (height, width, 3), both even, as video coders want them.

    ``ahead`` draws further lines into a film of some instants, and gives what moves them to the k-th of these; ``seen``
    are points that these lines need.
    """
    scene = motion.scene
    unique, back = np.unique(indices, return_inverse=True)
    shapes = np.asarray(motion.backbone(unique, points=bodies.backbone_points(scene.finger)))
    outlines = bodies.outlines_at(motion, unique)
    points = [shapes, *_thickness(scene.finger, shapes), np.asarray(motion.tip), *bodies.zone_points(scene), *seen]
    arrows = _arrows_at(motion, unique)
    film = Film(_box([*points, *chain(*outlines)], arrows), width)
    ax = film.ax
    bodies.draw_surroundings(ax, motion, shapes[0], moving=True)
    further = None if ahead is None else ahead(film, unique)
    finger = film.finger(motion, unique, shapes)
    explain(ax, bodies.masses_of(scene.finger), arrows, motion.name)

    def moving(k: int) -> tuple[list[Any], list[Any]]:
        passing: list[Any] = [*arrows.draw(ax, k)]
        passing += bodies.draw_pegs(ax, bodies.moved_supports(motion, int(unique[k])), animated=True)
        if outlines:
            passing += bodies.draw_object(ax, outlines[k], animated=True)
        if outlines or bodies.shows_thickness(scene.finger):
            passing += bodies.draw_thickness(ax, shapes[k], scene.finger, animated=True)
        return [*finger(k), *(further(k) if further else [])], passing

    return film.frames(back, moving)


def _thickness(finger: Finger, shapes: NDArray[Any]) -> list[NDArray[Any]]:
    """Outlines of a finger whose thickness is drawn without an object too."""
    return [bodies.finger_outline(shape, finger) for shape in shapes] if bodies.shows_thickness(finger) else []


def _arrows_at(motion: Moved, indices: NDArray[Any]) -> ForceArrows:
    """Arrows of the forces at some instants, without those that are zero but for rounding."""
    every = [motion.loads_at(int(k)) for k in indices]
    # Of a load that has faded rounding is left.
    least = SAME * max((float(np.hypot(*force)) for forces in every for _, force, _ in forces), default=0.0)
    return ForceArrows.above(every, motion.length, least)


def _box(points: Sequence[NDArray[Any]], arrows: ForceArrows) -> Box:
    """Limits that hold all points and arrows."""
    return bend_box([*points, *arrows.ends], 0.09 * arrows.length)


def plot_shape(equilibrium: Equilibrium, *, ax: Axes | None = None) -> Axes:
    """Draw a finger at rest, with clamp, point masses and forces to scale."""
    finger = equilibrium.model.finger
    forces = equilibrium.forces
    shape = np.asarray(equilibrium.backbone(bodies.backbone_points(finger)))
    masses = bodies.masses_of(finger)
    outlines = _thickness(finger, shape[None])
    arrows = ForceArrows([forces], finger.rod.length)
    styled = StyledAxes.plane(ax, _box([shape, *outlines], arrows), colorbar=False)
    ax = styled.ax
    if outlines:
        bodies.draw_thickness(ax, shape, finger)
    ax.plot(*shape.T, color=Color.BLUE, linewidth=2.6, solid_capstyle="round", zorder=Z.SHAPE)
    bodies.draw_clamp(ax, shape, finger)
    if masses:
        ax.plot(*bodies.mass_positions(shape, finger).T, "o", color=Color.INK, markersize=6, zorder=Z.MASS)
    arrows.draw(ax)
    explain(ax, masses, arrows, equilibrium.name)
    return ax


def plot_tip_path(trajectory: Trajectory, *, ax: Axes | None = None) -> Axes:
    """Draw where the tip goes in the plane, colored by time; the path is the first collection of the axes."""
    t = np.asarray(trajectory.t)
    tip = np.asarray(trajectory.tip)
    span = np.nanmax(tip, axis=0) - np.nanmin(tip, axis=0)
    size = max(float(span.max()), 0.02 * trajectory.length)  # a tip that rests shows where it rests
    styled = StyledAxes.plane(ax, bend_box([tip], 0.06 * size))
    ax = styled.ax
    styled.draw_timed(np.stack([tip[:-1], tip[1:]], axis=1), (t[:-1] + t[1:]) / 2, t, 1.6)
    ax.plot(*tip[0], "o", color="white", markeredgecolor=Color.INK, markersize=6, label="start", zorder=4)
    ax.plot(*tip[-1], "s", color=Color.INK, markersize=5, label="end", zorder=4)
    styled.head(trajectory.name)
    return ax


@over_time(columns=8)
def plot_coordinates(ax: Axes, trajectory: Moved) -> str:
    """Draw every bending coordinate over time, in order."""
    names = [split_unit(name) for name in trajectory.x_names[: trajectory.n]]
    symbols = [symbol(name) for name, _ in names]
    units = ", ".join(dict.fromkeys(unit for _, unit in names))
    alone = len(names) == 1  # which the axis names; the others have a legend
    StyledAxes(ax).curves(trajectory.t, np.asarray(trajectory.x)[:, : trajectory.n].T, [None] if alone else symbols)
    return f"{_QUANTITY.get(units, 'bending coordinate')}{f' {symbols[0]}' if alone else ''} [{units}]"


@over_time()
def plot_energy(ax: Axes, trajectory: Trajectory) -> str:
    """Draw kinetic, potential and total energy over time."""
    kinetic = np.asarray(trajectory.kinetic)
    potential = np.asarray(trajectory.potential)
    ax.plot(trajectory.t, kinetic, color=Color.ORANGE, linewidth=1.3, label="kinetic")
    ax.plot(trajectory.t, potential, color=Color.BLUE, linewidth=1.3, label="potential")
    ax.plot(trajectory.t, kinetic + potential, color=Color.INK, linewidth=1.8, label="total")
    return "energy [J]"


@over_time()
def plot_contact_forces(ax: Axes, trajectory: Moved) -> str:
    """Draw the normal force of every contact that ever touches over time, and dashed the size of its friction force."""
    contacts: Any = trajectory.contacts
    touching = np.flatnonzero(np.any(contacts.normal_force > 0.0, axis=0))
    StyledAxes(ax).curves(trajectory.t, contacts.normal_force[:, touching].T, [contacts.names[k] for k in touching])
    StyledAxes(ax).curves(
        trajectory.t, contacts.shear[:, touching].T, [None] * len(touching), linewidth=1.0, linestyle="--"
    )
    return "normal force, dashed: friction [N]"


def plot_modes(
    modes: Modes,
    *,
    count: int | None = None,
    amplitude: float = 0.15,
    ax: Sequence[Axes] | Axes | None = None,
) -> list[Axes]:
    """Draw each mode shape at plus and minus an amplitude about the equilibrium, in axes of its own.

    ``count`` modes from the lowest, by default as many as there are axes, at most six in a new figure; the
    greatest displacement is ``amplitude`` lengths of the finger.
    """
    present = len(modes.frequencies_hz)
    panels = None if ax is None else list(np.ravel(np.asarray(ax, dtype=object)))
    wanted = min(present, 6 if panels is None else len(panels)) if count is None else count
    if not 0 < wanted <= present:
        raise InputError(f"expected 1 to {present} modes, got {wanted}", key="count")
    if panels is not None and len(panels) < wanted:
        raise InputError(f"expected axes for {wanted} modes, got {len(panels)}", key="ax")

    rest = np.asarray(modes.backbone)
    length = float(np.hypot(*np.diff(rest, axis=0).T).sum())
    swing = amplitude * length * np.asarray(modes.shapes)[:wanted]
    box = bend_box([rest, rest + swing, rest - swing], 0.07 * length, slimmest=0.4)
    drawn = _new_axes(wanted, box, modes.stable) if panels is None else panels[:wanted]
    for k, panel in enumerate(drawn):
        StyledAxes.plane(panel, box)
        plus = rest + swing[k]
        minus = rest - swing[k]
        panel.plot(*rest.T, color=Color.GRAY, linewidth=1.4, linestyle="--", zorder=2)
        panel.plot(*plus.T, color=Color.BLUE, linewidth=2.0, zorder=3)
        panel.plot(*minus.T, color=Color.ORANGE, linewidth=2.0, zorder=3)
        panel.fill(*np.concatenate([plus, minus[::-1]]).T, color=Color.BLUE, alpha=0.06, linewidth=0, zorder=1)
        bodies.draw_clamp(panel, rest, modes.scene.finger)
        damping = modes.damping_ratios[k]  # NaN of an unstable mode
        ratio = "" if math.isnan(damping) else rf", $\zeta$ = {damping:.3g}"
        panel.set_title(f"mode {k + 1}: {modes.frequencies_hz[k]:.4g} Hz{ratio}", fontsize=10, color=Color.INK)
    return drawn


def _new_axes(count: int, box: Box, stable: bool) -> list[Axes]:
    """Axes for so many modes, in a figure that fits the box they share."""
    wide = (box[1] - box[0]) / (box[3] - box[2])
    if wide > 1.5 and count <= 3:  # a lying finger: one below the other
        columns = 1
    elif count == 4 and wide > 0.8:
        columns = 2
    else:
        columns = min(count, 3 if count > 4 else 4)
    rows = -(-count // columns)
    # at most 9.6 inch for all columns together, which a page in landscape holds
    each = max(2.6, min(5.2 if columns == 1 else 9.6 / columns, 3.8 * wide))
    figure = StyledAxes.figure(columns * (each + 0.7), rows * (each / wide + 0.85))
    if not stable:
        figure.suptitle("the equilibrium is unstable", color=Color.ORANGE, fontsize=10)
    return [figure.add_subplot(rows, columns, k + 1) for k in range(count)]


@over_time()
def plot_tensions(ax: Axes, trajectory: Trajectory) -> str:
    """Draw the tension of every tendon at its drive over time."""
    along: Any = trajectory.tensions_along
    tensions = [tension[:, 0] for _, tension in along]
    StyledAxes(ax).curves(trajectory.t, tensions, [f"tendon {k + 1}" for k in range(len(tensions))])
    return "tension at the drive [N]"


def plot_tensions_along(trajectory: Trajectory, *, ax: Axes | None = None) -> Axes:
    """Draw the tension of every tendon along the finger at some instants, colored by time."""
    along: Any = trajectory.tensions_along
    t = np.asarray(trajectory.t)
    chosen = np.unique(np.linspace(0, len(t) - 1, _INSTANTS).round().astype(int))
    styled = StyledAxes.on(ax)
    ax = styled.ax
    lines = [np.column_stack([at, tensions[k]]) for at, tensions in along for k in chosen]
    drawn = styled.draw_timed(lines, np.tile(t[chosen], len(along)), t, 1.6)
    drawn.set_linestyle([_STYLES[k % len(_STYLES)] for k in range(len(along)) for _ in chosen])
    greatest = max(float(tensions[chosen].max()) for _, tensions in along)
    for k in range(len(along)):
        ax.plot([], [], color=Color.INK, linestyle=_STYLES[k % len(_STYLES)], label=f"tendon {k + 1}")
    ax.set_xlim(0.0, trajectory.length)
    ax.set_ylim(0.0, 1.05 * greatest or 1.0)
    styled.label(styled.shown_label("position along the finger [m]", "x"), styled.shown_label("tension [N]", "y"))
    styled.head(trajectory.name)
    return ax


def plot_tension_loop(trajectory: Trajectory, *, ax: Axes | None = None) -> Axes:
    """Draw the angle of the tip over the tension at the drive, per tendon: friction opens loops."""
    along: Any = trajectory.tensions_along
    styled = StyledAxes.on(ax)
    ax = styled.ax
    for k, ((_, tensions), color) in enumerate(zip(along, Color.distinct(len(along)), strict=True)):
        ax.plot(tensions[:, 0], trajectory.tip_angle, color=color, linewidth=1.5, label=f"tendon {k + 1}")
    styled.label(styled.shown_label("tension at the drive [N]", "x"), "angle of the tip [rad]")
    styled.head(trajectory.name)
    return ax
