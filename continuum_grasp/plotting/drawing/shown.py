"""Figures and axes that a notebook shows where they are the value of a cell; imported when the first one is drawn.

Figures of matplotlib are shown through pyplot, which stores every figure until it is closed and shows it once more.
"""

from __future__ import annotations

import io
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from continuum_grasp.plotting.drawing.style import Color, Inch, plain, quiet


class ShownFigure(Figure):
    """A figure on an Agg canvas, unknown to pyplot, which would keep it alive."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        FigureCanvasAgg(self)

    def head(self, text: str) -> None:
        """Write what all axes show above them."""
        self.suptitle(plain(text), fontsize=10, color=Color.INK, x=0.01, ha="left")

    def add_subplot(self, *arguments: Any, **named: Any) -> Any:
        """Axes that are shown, too."""
        return super().add_subplot(*arguments, **{"axes_class": ShownAxes, **named})

    def add_axes(self, *arguments: Any, **named: Any) -> Any:
        return super().add_axes(*arguments, **{"axes_class": ShownAxes, **named})

    def savefig(self, *arguments: Any, dpi: float | str | None = None, **named: Any) -> None:
        """Save, laid out before: matplotlib would draw the whole figure once more for its layout.

        Axes of equal scales take two passes: one measures them before they shrink, and would cut their title.
        """
        engine = self.get_layout_engine()
        own_dpi = self.dpi
        if engine is None:
            super().savefig(*arguments, dpi=dpi, **named)
            return
        try:
            self.set_dpi(dpi if isinstance(dpi, float | int) else own_dpi)
            for _ in range(1 + any(ax.get_aspect() != "auto" for ax in self.axes)):
                engine.execute(self)
            self.set_layout_engine("none")
            super().savefig(*arguments, dpi=self.dpi, **named)
        finally:
            self.set_dpi(own_dpi)
            self.set_layout_engine(engine)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=self.dpi)
        wide, high = (round(Inch.PIXELS * float(size)) for size in self.get_size_inches())
        return buffer.getvalue(), {"width": wide, "height": high}


class ShownAxes(Axes):
    """Quiet axes that show their figure."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        quiet(self)

    def _repr_png_(self) -> Any:
        shown = getattr(self.get_figure(root=True), "_repr_png_", None)
        return None if shown is None else shown()
