"""Natural modes about an equilibrium."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.plotting.drawing.axes import Box, bend_box, new_figure, plane_axes, quiet
from continuum_grasp.plotting.drawing.bodies import draw_clamp
from continuum_grasp.plotting.drawing.style import BLUE, GRAY, INK, ORANGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from continuum_grasp.simulation.modes import Modes


def plot_modes(
    modes: Modes,
    *,
    count: int | None = None,
    amplitude: float = 0.15,
    ax: Sequence[Axes] | Axes | None = None,
) -> list[Axes]:
    """Draw each mode shape at plus and minus an amplitude about the equilibrium.

    Parameters
    ----------
    modes : Modes
        Frequencies [Hz], damping ratios, equilibrium backbone (points, 2) [m] and shapes (m, points, 2).
    count : int, optional
        How many modes to draw, from the lowest; None: as many as there are axes, at most six in a new figure.
    amplitude : float
        Greatest displacement drawn, in lengths of the finger.
    ax : sequence of matplotlib.axes.Axes, or Axes, optional
        One for each mode; None: axes in a new figure.

    Returns
    -------
    list of matplotlib.axes.Axes
        One per mode. Lines of each: equilibrium, plus, minus.

    Raises
    ------
    InputError
        There are fewer axes than modes asked for, or fewer modes.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp import plotting
    >>> found = cg.modes("configs/simulate/standing.yaml")
    >>> [ax.get_xlabel() for ax in plotting.plot_modes(found, count=1)]
    ['x [m]']
    """
    present = len(modes.frequencies_hz)
    given = None if ax is None else list(np.ravel(np.asarray(ax, dtype=object)))
    wanted = min(present, 6 if given is None else len(given)) if count is None else count
    if not 0 < wanted <= present:
        raise InputError(f"expected 1 to {present} modes, got {wanted}", key="count")
    if given is not None and len(given) < wanted:
        raise InputError(f"expected axes for {wanted} modes, got {len(given)}", key="ax")

    rest = np.asarray(modes.backbone)
    length = float(np.hypot(*np.diff(rest, axis=0).T).sum())
    swing = amplitude * length * np.asarray(modes.shapes)[:wanted]
    box = bend_box([rest, rest + swing, rest - swing], 0.07 * length, slimmest=0.4)
    axes = _new_axes(wanted, box, modes.stable) if given is None else given[:wanted]
    for k, one in enumerate(axes):
        plane_axes(one, box)
        plus, minus = rest + swing[k], rest - swing[k]
        one.plot(*rest.T, color=GRAY, linewidth=1.4, linestyle="--", zorder=2)
        one.plot(*plus.T, color=BLUE, linewidth=2.0, zorder=3)
        one.plot(*minus.T, color=ORANGE, linewidth=2.0, zorder=3)
        one.fill(*np.concatenate([plus, minus[::-1]]).T, color=BLUE, alpha=0.06, linewidth=0, zorder=1)
        draw_clamp(one, rest, length)
        damping = modes.damping_ratios[k]  # NaN of an unstable mode
        ratio = "" if math.isnan(damping) else rf", $\zeta$ = {damping:.3g}"
        one.set_title(f"mode {k + 1}: {modes.frequencies_hz[k]:.4g} Hz{ratio}", fontsize=10, color=INK)
    return axes


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
    figure = new_figure(columns * (each + 0.7), rows * (each / wide + 0.85))
    if not stable:
        figure.suptitle("the equilibrium is unstable", color=ORANGE, fontsize=10)
    return [quiet(figure.add_subplot(rows, columns, k + 1)) for k in range(count)]
