"""Pictures into files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from continuum_grasp.results.atomic import replacing

__all__ = ["save_picture"]

_DPI = 150.0
"""Pixels per inch: text of 9 points is read without zooming on a page and on a screen."""


def save_picture(drawn: Any | Sequence[Any], path: str | os.PathLike[str], *, dpi: float = _DPI) -> Path:
    """Save the figure of what a plot returned.

    Parameters
    ----------
    drawn : matplotlib.axes.Axes, sequence of them, or matplotlib.figure.Figure
        What a plot returned.
    path : path-like
        File; its suffix is the format (png, pdf, svg). It is replaced whole.
    dpi : float
        Pixels per inch.

    Returns
    -------
    pathlib.Path
        ``path``.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> from continuum_grasp.plotting import plot_resistance
    >>> from continuum_grasp.results import save_picture
    >>> ax = plot_resistance([[2.0, 0.0], [0.0, 1.0], [-2.0, 0.0], [0.0, -1.0]])
    >>> save_picture(ax, mkdtemp() + "/forces.svg").name
    'forces.svg'
    """
    first: Any = drawn[0] if isinstance(drawn, (list, tuple)) else drawn
    figure = first if hasattr(first, "savefig") else first.figure
    target = Path(path)
    with replacing(target) as temporary:
        figure.savefig(temporary, format=target.suffix[1:] or "png", dpi=dpi)
    return target
