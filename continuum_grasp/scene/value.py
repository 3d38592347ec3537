"""Base class and number types of everything that a user describes."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["NonNegative", "Positive", "Real", "Value", "Vector2"]


class Value(BaseModel):
    """A frozen value in SI units; unknown keys, NaN and infinity are refused."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True, strict=True
    )


Real = Annotated[float, Field()]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Vector2 = Annotated[tuple[float, float], Field(strict=False)]
