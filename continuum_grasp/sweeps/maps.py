"""Contents of the pictures of a sweep, computed from its table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arguments import check_arguments, choice, shown
from continuum_grasp.errors import InputError
from continuum_grasp.results.declared import maker_of
from continuum_grasp.results.tables import pareto
from continuum_grasp.scene.sweep import QUANTITIES
from continuum_grasp.sweeps.table import SweepTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_REDUCE: dict[str, Callable[[NDArray[np.float64]], Any]] = {
    "median": np.median,
    "mean": np.mean,
    "least": np.min,
    "greatest": np.max,
}


@dataclass(frozen=True)
class Map:
    """A quantity over two keys of a grid, or over two columns that lie anywhere: then all arrays are (rows,)."""

    x: NDArray[Any]
    """Values of the key (nx,) in the order of the picture, numbers or words."""
    y: NDArray[Any]
    """Values of the key upwards (ny,), numbers or words."""
    color: NDArray[np.float64]
    """The quantity (ny, nx); NaN where there is no grasp."""
    kind: NDArray[np.str_]
    """Why there is none (ny, nx); empty where there is one, or no row yet."""
    labels: tuple[str, str, str]
    """Labels of x, y and color, with units."""


@dataclass(frozen=True)
class Front:
    """Two quantities of all grasps (rows,), and those that no other beats in both."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    color: NDArray[np.float64] | None
    best: NDArray[np.int64]
    """Positions of the front in x and y (n,), with increasing x."""
    labels: tuple[str, str, str]
    """Labels of x, y and color, with units."""
    best_words: str
    """Directions that are better, in words."""


@check_arguments
def map_of(table: SweepTable, x: str, y: str, color: str, reduce: str = "median") -> Map:
    """Work out a map of a quantity: over the grid where both keys belong to it, else point by point.

    Parameters
    ----------
    table : SweepTable
        Of `continuum_grasp.sweep` or `continuum_grasp.sweep_table`.
    x, y, color : str
        Columns across, upwards and in color.
    reduce : {"median", "mean", "least", "greatest"}
        What a place of the grid shows that several grasps share.

    Returns
    -------
    Map
        What ``table.plot(picture="map", ...)`` draws.

    Raises
    ------
    InputError
        If there is no such column, or no such reduction.

    Examples
    --------
    >>> import tempfile
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.sweeps import map_of
    >>> masses, rough = {"values": [0.1, 0.2]}, {"values": [0.4, 0.5]}  # kg, 1
    >>> config = {"scene": "configs/grasp/mug_arcs.yaml", "vary": {"object.mass": masses, "contacts.friction": rough}}
    >>> table = cg.sweep(config, folder=tempfile.mkdtemp(), workers=1, keep="none")
    >>> map_of(table, "object.mass", "contacts.friction", "tension_sum").color.shape
    (2, 2)
    """
    choice("reduce", reduce, _REDUCE)
    solved = _solved(table)
    labels = _label(table, x), _label(table, y), _label(table, color)
    colors = np.where(solved, _numbers(table[color]), np.nan)
    kinds = np.where(solved, "", table.kinds)
    if not {x, y} <= set(table.grid_keys):
        return Map(table[x], table[y], colors, kinds, labels)
    xs, column = _places(table[x])
    ys, row = _places(table[y])
    color_at = np.full((len(ys), len(xs)), np.nan)
    kind_at = np.full(color_at.shape, "", dtype=object)
    # Rows of one place stand together after sorting: one pass, also for millions of rows.
    order = np.lexsort((column, row))
    cells = row[order] * len(xs) + column[order]
    starts = np.flatnonzero(np.diff(cells, prepend=-1))
    for rows in np.split(order, starts[1:]) if len(order) else ():
        place = row[rows[0]], column[rows[0]]
        there = colors[rows][np.isfinite(colors[rows])]
        if len(there):
            color_at[place] = _REDUCE[reduce](there)
        else:
            names, counts = np.unique(kinds[rows], return_counts=True)  # the most frequent reason
            kind_at[place] = names[np.argmax(counts)]
    return Map(xs, ys, color_at, kind_at.astype(str), labels)


@check_arguments
def front_of(
    table: SweepTable, x: str, y: str, x_best: str = "least", y_best: str = "least", color: str | None = None
) -> Front:
    """Work out the Pareto front of two quantities of all grasps.

    Parameters
    ----------
    table : SweepTable
        Of `continuum_grasp.sweep` or `continuum_grasp.sweep_table`.
    x, y : str
        Columns of numbers.
    x_best, y_best : {"least", "greatest"}
        Which way is better.
    color : str, optional
        A third column of numbers.

    Returns
    -------
    Front
        What ``table.plot(picture="pareto", ...)`` draws.

    Raises
    ------
    InputError
        If there is no such column, or the better way is another word.

    Examples
    --------
    >>> import tempfile
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.sweeps import front_of
    >>> masses = {"object.mass": {"values": [0.1, 0.2]}}  # kg
    >>> config = {"scene": "configs/grasp/mug_arcs.yaml", "vary": masses}
    >>> table = cg.sweep(config, folder=tempfile.mkdtemp(), workers=1, keep="none")
    >>> front = front_of(table, "tension_sum", "object.mass", y_best="greatest")
    >>> len(front.x), len(front.best)  # what holds more needs more tension: both are on the front
    (2, 2)
    """
    for key, word in (("x_best", x_best), ("y_best", y_best)):
        choice(key, word, ("least", "greatest"))
    solved = _solved(table)
    xs, ys = _numbers(table[x])[solved], _numbers(table[y])[solved]
    shades = None if color is None else _numbers(table[color])[solved]
    good = np.isfinite(xs) & np.isfinite(ys)
    xs, ys = xs[good], ys[good]
    best = pareto(xs, ys, x_best == "greatest", y_best == "greatest")
    labels = _label(table, x), _label(table, y), "" if color is None else _label(table, color)
    return Front(xs, ys, None if shades is None else shades[good], best, labels, f"{x_best} x and {y_best} y are best")


def _solved(table: SweepTable) -> NDArray[np.bool_]:
    """Rows that have a grasp; the first that is asked of a table."""
    if not hasattr(table, "grid_keys"):
        raise InputError(f"expected a SweepTable, got {shown(table)}", key="table")
    return table.solved


def draw_map(table: SweepTable, *, x: str, y: str, color: str, reduce: str = "median", ax: Axes | None = None) -> Axes:
    """Draw `map_of` some columns."""
    drawn: Axes = maker_of("plotting.sweep:plot_map")(map_of(table, x, y, color, reduce), ax=ax)
    return drawn


def draw_front(
    table: SweepTable,
    *,
    x: str,
    y: str,
    x_best: str = "least",
    y_best: str = "least",
    color: str | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw `front_of` some columns."""
    drawn: Axes = maker_of("plotting.sweep:plot_front")(front_of(table, x, y, x_best, y_best, color), ax=ax)
    return drawn


def _places(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Distinct values, numbers in their order and words as they come, and which each row has."""
    distinct, first, place = np.unique(values, return_index=True, return_inverse=True)
    if values.dtype.kind in "iuf":
        return distinct, place.astype(np.int64)
    order = np.argsort(first)
    return distinct[order], np.argsort(order)[place]


def _numbers(values: NDArray[Any]) -> NDArray[np.float64]:
    return values.astype(float) if values.dtype.kind in "iuf" else np.full(len(values), np.nan)


def _label(table: SweepTable, name: str) -> str:
    unit = table.units.get(name, "")
    words = QUANTITIES[name][1] if name in QUANTITIES else name
    return f"{words} [{unit}]" if unit else words
