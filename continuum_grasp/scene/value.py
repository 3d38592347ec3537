"""Base class and number types of everything that a user describes."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterable, Iterator, Sized
from functools import cache, reduce
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NoReturn, Self, TypeAlias, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import CoreSchema

from continuum_grasp.base import InputError, Summarized
from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.doubts import collected_doubts, doubt
from continuum_grasp.scene.magnitudes import ACCELERATION, ANGLE, DURATION, FRICTION, PLACE, magnitudes
from continuum_grasp.scene.units import Unit

if TYPE_CHECKING:
    from continuum_grasp.scene.assembly import Overrides
    from continuum_grasp.scene.document import KeyPath

GREATEST = 1e12
"""Greatest number that a scene states, in its SI unit: one beyond is in another unit, or mistyped."""
PARALLEL = 1e-6
"""Sine of an angle below which two directions, or directions of two surfaces, count as parallel [1]."""
SAME = 1e-9
"""Greatest distance between equal positions, per length, and greatest difference between equal ratios [1]: above the
rounding of sums of lengths."""
WRITTEN = 1e-6
"""Share of a size that is rounding of written numbers, as with six digits [1]: of numbers in scenes, of coordinates in
drawings."""
_SHORT = 200
"""Greatest number of characters of a value that is shown unchanged [1]: two lines of a terminal."""


class Value(BaseModel):
    """A frozen value in SI units; unknown keys, NaN, infinity and absurd magnitudes are refused.

    The type of a field of numbers has a `Unit`, to read texts such as ``12 mm``, and may have a `Magnitude`, to doubt
    implausible numbers. A class whose fields must fit together has a method ``_check``, which
    raises `ValueError` with a message that begins with the key, or warns by ``_doubt``; keys that exclude or need
    others are declared in ``REFUSALS``.
    """

    REFUSALS: ClassVar[tuple[Consumer, ...]] = ()
    """Keys that exclude each other, or that a scene cannot have."""
    FILES: ClassVar[str] = ""
    """Function (document, key path of a scene, main file) that puts in place what keys name in files, as
    ``module:name``."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True, defer_build=True)

    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ValidationError as error:
            from continuum_grasp.scene.document import Document, Place
            from continuum_grasp.scene.problems import input_error

            raise input_error(error, type(self), Document.at(Place(type(self).__name__), data)) from None

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Describe each field by the docstring below it."""
        json_schema = handler(schema)
        properties = handler.resolve_ref_schema(json_schema).get("properties", {})
        for name, text in field_docs(cls).items():
            if name in properties:
                properties[name].setdefault("description", text)
        return json_schema

    @model_validator(mode="after")
    def _checked(self) -> Self:
        # Base classes first: a class may rely on their checks.
        for kind in reversed(type(self).__mro__):
            for refusal in vars(kind).get("REFUSALS", ()):
                refusal.check(self)
            if "_check" in vars(kind):
                vars(kind)["_check"](self)
        for name, magnitude in magnitudes(type(self)).items():
            if text := magnitude.doubt(getattr(self, name)):
                self._doubt(name, f"= {text}")
        return self

    def _check_one_given(self, *keys: str) -> None:
        """Refuse none, or several, of some fields."""
        if sum(getattr(self, key) is not None for key in keys) != 1:
            *others, last = keys
            raise ValueError(f"give exactly one of {', '.join(others)} and {last}")

    def _check_below(self, least: str, greatest: str) -> None:
        """Refuse a field that is not below another, where both are given."""
        low, high = getattr(self, least), getattr(self, greatest)
        if low is not None and high is not None and low >= high:
            units = [each.si for each in type(self).model_fields[least].metadata if isinstance(each, Unit) and each.si]
            unit = f" {units[0]}" if units else ""
            raise ValueError(f"{least} = {low:g}{unit} is not below {greatest} = {high:g}{unit}")

    def _check_count(self, key: str, values: Sized | None, count: int, of: str) -> None:
        """Refuse a list whose number of entries is not that of something else; a missing list passes."""
        if values is not None and len(values) != count:
            raise ValueError(f"{key} must have one entry per {of} ({count}), got {len(values)}")

    def _check_whole(self, key: str, span: float, step: float, what: str) -> None:
        """Refuse a time that is not a whole number of steps [s]."""
        # Decimal steps such as 0.001 are no binary fractions, so the quotient is whole only up to rounding.
        count = span / step
        if abs(count - round(count)) > 1e-6 * count:
            raise ValueError(f"{key} must be a whole number of {what}, got {span} s in {what} of {step} s")

    def _doubt(self, key: str, text: str) -> None:
        """Warn of an implausible value at a key of this value."""
        doubt(key, text, self)

    def changed(self, changes: Overrides) -> Self:
        """Return a copy with other values of some entries, checked as a whole.

        Parameters
        ----------
        changes : mapping or iterable of str
            From key paths to values, such as ``{"object.mass": 0.4, "finger.masses[0].mass": 0.02}`` [SI units], or
            ``"key.path=value"`` texts, as in `load` and as ``--set`` takes them; applied in order. A mapping or list
            replaces the present one as a whole. Paths of files are relative to the working directory.

        Returns
        -------
        same class
            Validated like a new value; defaults stay defaults.

        Raises
        ------
        InputError
            With the key of every fault: unknown keys, wrong values, values that do not fit together.

        Examples
        --------
        >>> import continuum_grasp as cg
        >>> scene = cg.load("configs/grasp/mug.yaml")
        >>> heavier = scene.changed({"object.mass": 0.4, "fidelity.elements": 3})
        >>> heavier.object.mass, scene.object.mass  # kg
        (0.4, 0.3)
        >>> scene.changed({"object.mas": 0.4})
        Traceback (most recent call last):
        continuum_grasp.base.errors.InputError: GraspScene: object.mas: unknown key; did you mean 'mass'?
        """
        from continuum_grasp.scene.assembly import AssembledData, read_overrides

        name = type(self).__name__
        overrides, data = read_overrides(changes, name), AssembledData.of(self, name)
        for path, _ in overrides:
            data.write_out(path, self)
        return data.changed(overrides).validated(type(self))

    def entry(self, path: KeyPath | str) -> Any:
        """Return the entry at a key path, or at its text such as ``masses[0].at``; None if it does not exist."""
        from continuum_grasp.scene.document import child, undotted

        return reduce(child, undotted(path) if isinstance(path, str) else path, self)

    def stated(self, *without: str) -> dict[str, Any]:
        """Return the fields that differ from their defaults, as a user would write them, ``without`` some."""
        fields = ((name, field) for name, field in type(self).model_fields.items() if name not in without)
        defaults = {name: field.get_default(call_default_factory=True, validated_data={}) for name, field in fields}
        return {name: getattr(self, name) for name, default in defaults.items() if getattr(self, name) != default}

    def __repr_args__(self) -> Iterable[tuple[str | None, Any]]:
        return self.stated().items()

    def __repr__(self) -> str:
        """Return a short text as Python writes it; a long one has a line per field."""
        text = _written(self)
        if len(text) <= _SHORT:
            return text
        return Summarized.listed(type(self).__name__, {name: _written(value) for name, value in self.stated().items()})

    __str__ = __repr__

    def __copy__(self) -> Self:
        # What was computed of the fields belongs to these: a copy may be given others.
        copied = super().__copy__()
        for name in [name for name in copied.__dict__ if name not in type(self).model_fields]:
            del copied.__dict__[name]
        return copied

    def __iter__(self) -> Iterator[tuple[str, Any]]:  # type: ignore[override]
        """Names and values of the fields, without what was computed of them."""
        return ((name, getattr(self, name)) for name in type(self).model_fields)

    def replaced(self, **fields: Any) -> Self:
        """Return a copy with other values of some fields, validated like a new value; raises `InputError` like it.

        A copy raises no doubts: the user has been warned of the original, and does not know the values of a search.
        """
        with collected_doubts():
            return type(self)(**{**dict(self), **fields})

    # pydantic calls our initializer for nested values too, and then loses the keys of faults in them.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_"):
            self._refuse(name)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        self._refuse(name)

    def _refuse(self, name: str) -> NoReturn:
        message = f"values are frozen: changed({{{name!r}: ...}}) returns a copy with another value"
        raise InputError(message, file=type(self).__name__, key=name)

    # That of pydantic cannot hash a dict, which supports, fingers and zones are.
    def __hash__(self) -> int:
        fields = (getattr(self, name) for name in type(self).model_fields)
        return hash((type(self), *(frozenset(v.items()) if isinstance(v, dict) else v for v in fields)))


class Configuration(Value):
    """A description with a file of its own."""

    schema_version: Literal[1] = 1
    """Format of a file, which must state it; not needed in Python."""
    name: str | None = None
    """Title of reports and pictures."""


def _written(value: Any) -> str:
    if not isinstance(value, Value):
        return repr(value)
    return f"{type(value).__name__}({', '.join(f'{name}={_written(entry)}' for name, entry in value.stated().items())})"


@cache
def field_docs(model: type) -> dict[str, str]:
    """Docstrings below the fields of a class and of its base classes, by field.

    Pydantic's ``use_attribute_docstrings`` reads the same when a class is made: a quarter of the time that a command
    takes to know its scene.
    """
    docs: dict[str, str] = {}
    for kind in reversed(model.__mro__):
        body = _classes(kind.__module__).get(kind.__qualname__)
        for field, below in pairwise((*body.body, ast.Pass()) if body is not None else ()):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                docs.pop(field.target.id, None)  # declared again
                if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
                    docs[field.target.id] = inspect.cleandoc(str(below.value.value))
                elif isinstance(field.annotation, ast.Subscript) and isinstance(field.annotation.slice, ast.Constant):
                    docs[field.target.id] = str(kind.__doc__).partition("\n")[0]  # the word that selects the class
    return docs


@cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    """The classes of a module by qualified name; none where its source cannot be read, as in a terminal."""
    if not module.startswith("continuum_grasp."):
        return {}
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}


_Entry = TypeVar("_Entry")
ListOf: TypeAlias = Annotated[tuple[_Entry, ...], Field(strict=False)]
"""A list in a file, which is a tuple in Python."""
Real = Annotated[float, Field(ge=-GREATEST, le=GREATEST)]
Positive = Annotated[float, Field(ge=1e-12, le=GREATEST)]
NonNegative = Annotated[float, Field(ge=0.0, le=GREATEST)]
Length = Annotated[float, Field(ge=1e-6, le=1e4), Unit("m")]
"""Length of a finger or of a part of it [m]."""
Extent = Annotated[float, Field(ge=1e-9, le=1e8), Unit("m")]
"""Length of a section or of something else than the finger [m]."""
Distance = Annotated[NonNegative, Unit("m")]
"""Length that may be zero [m]."""
Angle = Annotated[Real, Unit("rad"), ANGLE]
"""Angle, counter-clockwise [rad]."""
Duration = Annotated[Positive, Unit("s"), DURATION]
"""Time span above zero [s]."""
TimeConstant = Annotated[float, Field(ge=1e-6, le=1e6), Unit("s")]
"""Time constant of a drive [s]."""
Mass = Annotated[NonNegative, Unit("kg")]
"""Mass that may be zero [kg]."""
Ratio = Annotated[NonNegative, Unit("1")]
"""A factor, or the weight of a quantity without a unit [1]."""
Friction = Annotated[NonNegative, Unit("1"), FRICTION, Field(examples=[0.5])]
"""A coefficient of friction [1]."""
Vector2 = Annotated[tuple[Real, Real], Field(strict=False)]
Position = Annotated[Vector2, Unit("m"), PLACE]
"""Position in the plane [m]."""
Vector3 = Annotated[tuple[Real, Real, Real], Field(strict=False)]
SpatialPosition = Annotated[Vector3, Unit("m"), PLACE]
"""Position in space [m]."""
Acceleration = Annotated[Vector2, Unit("m/s2"), ACCELERATION]
"""Acceleration in the plane [m/s2]."""


def _increasing(values: tuple[float, ...], field: ValidationInfo) -> tuple[float, ...]:
    if any(b <= a for a, b in pairwise(values)):
        raise ValueError(f"{field.field_name or 'values'} must increase, got {list(values)}")
    return values


Increasing = AfterValidator(_increasing)
"""For strictly increasing numbers."""
Interval = Annotated[tuple[Real, Real], Field(strict=False), Increasing]
"""Least and greatest value."""


def check_shorter(key: str, value: float, length: float) -> None:
    """Refuse a measure across a finger, at a key, that is not smaller than its length [m]."""
    if abs(value) >= length:
        raise ValueError(f"{key} = {value} m is not smaller than the finger's length of {length} m")
