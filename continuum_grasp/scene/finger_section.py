"""Cross-section of a finger's backbone, for its stiffness out of the plane of bending."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Extent, Value


class FingerSection(Value):
    """Cross-section of a finger's backbone, which gives its stiffness out of its plane.

    The stiffness in the plane comes from the rod: of a section of width w and thickness t, E I to the side is
    (w / t)^2 times that, and G J follows from Poisson's ratio.
    """

    shape: Literal["round", "ellipse", "rectangle"]
    """Shape of the section."""
    thickness: Extent | None = None
    """Extent in the plane of bending [m]; of round ones not needed."""
    width: Extent | None = None
    """Extent across the plane of bending [m]; of round ones not needed."""
    poissons_ratio: Annotated[float, Field(ge=0.0, le=0.5), Unit("1")] = 0.35
    """Poisson's ratio, which relates torsion to bending [1]: rubber 0.5, polymers 0.4, metals 0.3."""

    @property
    def ratio(self) -> float:
        """Width per thickness [1]."""
        return 1.0 if self.thickness is None or self.width is None else self.width / self.thickness

    @property
    def lateral(self) -> float:
        """Bending stiffness to the side, per that in the plane [1]."""
        return self.ratio**2

    @property
    def torsion(self) -> float:
        """Torsional stiffness G J, per bending stiffness E I in the plane [1] (S. Timoshenko, J. N. Goodier, "Theory of
        Elasticity", chapter 10).
        """
        r = self.ratio
        shear = 2.0 * (1.0 + self.poissons_ratio)
        if self.shape != "rectangle":
            return 4.0 * r * r / (1.0 + r * r) / shear
        # J of a b^3 for the shorter side b, per I = w t^3 / 12.
        slender = min(r, 1.0 / r)
        series = sum(math.tanh(n * math.pi / (2.0 * slender)) / n**5 for n in range(1, 12, 2))
        j = (1.0 - 192.0 * slender / math.pi**5 * series) / 3.0
        return 12.0 * j * (1.0 if r >= 1.0 else r * r) / shear

    def _check(self) -> None:
        if self.shape == "round" and (self.thickness is not None or self.width is not None):
            raise ValueError("a round section has no thickness and width: leave them out")
        if self.shape != "round" and (self.thickness is None or self.width is None):
            raise ValueError(f"thickness and width are needed for shape: {self.shape}")
