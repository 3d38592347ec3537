"""Base class and number types of everything that a user describes."""

from __future__ import annotations

import inspect
import warnings
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError


class Value(BaseModel):
    """A frozen value in SI units; unknown keys, NaN, infinity and absurd magnitudes are refused.

    Raises
    ------
    InputError
        Where it is made with something wrong, with the path of each key.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True, strict=True
    )

    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            from continuum_grasp.scene.problems import input_error

            raise input_error(error, type(self), data) from None

    def replaced(self, **fields: Any) -> Self:
        """A copy with other values of some fields, validated as if it were made anew.

        Raises
        ------
        InputError
            The fields do not go together.
        """
        return type(self)(**{**dict(self), **fields})

    # pydantic calls an initializer of one's own for nested values too, and loses the keys of what is wrong in them.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        fields = (getattr(self, name) for name in type(self).model_fields)
        return hash((type(self), *(frozenset(v.items()) if isinstance(v, dict) else v for v in fields)))


Real = Annotated[float, Field(ge=-1e12, le=1e12)]
Positive = Annotated[float, Field(ge=1e-12, le=1e12)]
NonNegative = Annotated[float, Field(ge=0.0, le=1e12)]
Length = Annotated[float, Field(ge=1e-6, le=1e4)]
"""Of a finger or a part of it [m]."""
Extent = Annotated[float, Field(ge=1e-9, le=1e8)]
"""Of a section or of something else than the finger [m]."""
Vector2 = Annotated[tuple[Real, Real], Field(strict=False)]


def doubt(what: str) -> None:
    """Warn of a value that can be meant, but is more likely in another unit; names the line of the user."""
    frame, level = inspect.currentframe(), 1
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] in (
        "continuum_grasp",
        "pydantic",
    ):
        frame, level = frame.f_back, level + 1
    warnings.warn(what, UserWarning, stacklevel=level)
