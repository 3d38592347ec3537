"""Units of values in configurations, as a table, and their exact conversion to SI."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

_NUMBER = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
"""Pattern of numbers of YAML 1.2, without infinity and NaN."""
# A double has 17 digits; 50 digits make sure that products are rounded correctly.
_DEGREE = Fraction("3.14159265358979323846264338327950288419716939937510") / 180
_INCH = Fraction("0.0254")
_POUND = Fraction("0.45359237")
_GRAVITY = Fraction("9.80665")
"""Inch [m], pound [kg] and standard gravity [m/s2], exact by definition (NIST SP 811, appendix B)."""
_POUND_FORCE = _POUND * _GRAVITY


@dataclass(frozen=True)
class Quantity:
    """A quantity with its SI unit and its other units."""

    words: str
    example: str
    factors: Mapping[str, str | int | Fraction]
    """Units besides the SI unit, and what each is in the SI unit, exactly."""


QUANTITIES = {
    "m": Quantity(
        "a length",
        "12 mm",
        {"cm": "1e-2", "mm": "1e-3", "um": "1e-6", "in": _INCH, "ft": 12 * _INCH, "mil": _INCH / 1000},
    ),
    "m2": Quantity("an area", "80 mm2", {"cm2": "1e-4", "mm2": "1e-6"}),
    "1/m": Quantity("a curvature", "0.008 1/mm", {"1/cm": "1e2", "1/mm": "1e3"}),
    "rad": Quantity("an angle", "30 deg", {"mrad": "1e-3", "deg": _DEGREE, "rev": 360 * _DEGREE}),
    "rad/s": Quantity("an angular velocity", "90 deg/s", {"deg/s": _DEGREE, "rpm": 6 * _DEGREE}),
    "s": Quantity("a time", "5 ms", {"ms": "1e-3", "us": "1e-6", "ns": "1e-9", "min": 60, "h": 3600}),
    "Hz": Quantity("a frequency", "0.5 Hz", {"kHz": "1e3", "MHz": "1e6", "rad/s": 1 / (360 * _DEGREE)}),
    "1/s": Quantity("a rate", "0.2 1/ms", {"1/ms": "1e3"}),
    "m/s": Quantity("a speed", "10 mm/s", {"cm/s": "1e-2", "mm/s": "1e-3", "in/s": _INCH}),
    "s/m": Quantity("a time per length", "0.002 s/mm", {"s/mm": "1e3"}),
    "m/s2": Quantity("an acceleration", "981 cm/s2", {"cm/s2": "1e-2", "mm/s2": "1e-3"}),
    "kg": Quantity("a mass", "300 g", {"g": "1e-3", "mg": "1e-6", "lb": _POUND, "oz": _POUND / 16}),
    "kg/m": Quantity("a mass per length", "34 g/m", {"g/m": "1e-3", "g/cm": "1e-1", "g/mm": "1"}),
    "kg/m3": Quantity("a density", "6.45 g/cm3", {"g/cm3": "1e3"}),
    "kg m": Quantity("a rotary inertia per length", "0.26 g mm", {"g cm": "1e-5", "g mm": "1e-6"}),
    "kg m2": Quantity("a moment of inertia", "2400 g cm2", {"g cm2": "1e-7", "g mm2": "1e-9", "kg mm2": "1e-6"}),
    "N": Quantity(
        "a force",
        "25 N",
        {
            "mN": "1e-3",
            "uN": "1e-6",
            "kN": "1e3",
            "gf": _GRAVITY / 1000,
            "kgf": _GRAVITY,
            "lbf": _POUND_FORCE,
            "ozf": _POUND_FORCE / 16,
        },
    ),
    "N/s": Quantity("a rate of force", "0.6 N/ms", {"N/ms": "1e3", "mN/s": "1e-3"}),
    "N/m": Quantity(
        "a stiffness", "5 N/mm", {"N/cm": "1e2", "N/mm": "1e3", "kN/m": "1e3", "lbf/in": _POUND_FORCE / _INCH}
    ),
    "N m": Quantity(
        "a moment",
        "25 N mm",
        {
            "N cm": "1e-2",
            "N mm": "1e-3",
            "mN m": "1e-3",
            "uN m": "1e-6",
            "kgf cm": _GRAVITY / 100,
            "gf cm": _GRAVITY / 100_000,
            "lbf in": _POUND_FORCE * _INCH,
            "ozf in": _POUND_FORCE * _INCH / 16,
        },
    ),
    "N m s": Quantity("a damping per angle", "0.2 N mm s", {"N mm s": "1e-3"}),
    "N m2": Quantity("a bending stiffness", "6110 N mm2", {"N cm2": "1e-4", "N mm2": "1e-6"}),
    "N m3 s2": Quantity("a damping by squared rates", "0.1 N m3 s2", {"N cm3 s2": "1e-6", "N mm3 s2": "1e-9"}),
    "N m2 s": Quantity("a damping of bending", "30 N mm2 s", {"N cm2 s": "1e-4", "N mm2 s": "1e-6"}),
    "Pa": Quantity(
        "a modulus or pressure",
        "60 GPa",
        {
            "kPa": "1e3",
            "MPa": "1e6",
            "GPa": "1e9",
            "N/mm2": "1e6",
            "bar": "1e5",
            "mbar": "1e2",
            "psi": _POUND_FORCE / _INCH**2,
        },
    ),
    "1": Quantity("a share", "5 %", {"%": "1e-2"}),
}
"""By SI unit. A key whose unit is not here takes SI numbers alone."""


def units_of(si: str) -> dict[str, Fraction]:
    """Return the units for values with the SI unit ``si``, and the size of each in this unit; none if it is unknown."""
    quantity = QUANTITIES.get(si)
    if quantity is None:
        return {}
    units = {} if si == "1" else {si: Fraction(1)}
    return units | {unit: Fraction(factor) for unit, factor in quantity.factors.items()}


def to_si(text: str, si: str) -> float | None:
    """Return the value of a text such as ``12 mm`` in an SI unit, the double that is nearest to it.

    ``to_si("-90 deg", "rad")`` is -pi/2. None where the text is not a number and a unit of that quantity, or no double
    can hold it.
    """
    # 60: characters of a text that is read: Fraction would write 1e999999999 out
    unit = unit_in(text, si, _NUMBER) if len(text) <= 60 else None
    number = re.match(_NUMBER, text)
    # 400: beyond what a double can hold in any unit of the table, 1e308
    if unit is None or number is None or abs(int(re.split("[eE]", number[0] + "e0")[1])) > 400:
        return None
    exact = Fraction(number[0]) * units_of(si)[unit]
    try:
        value = float(exact)
    except OverflowError:
        return None
    return None if exact and not value else value


def advice_on(text: str, si: str) -> str:
    """Advice about a text that `to_si` does not read; empty where its unit is one of another quantity."""
    if re.match(r"[-+]?\d+,\d", text):
        return "write a decimal point, not a comma, and no separators of thousands"
    if not re.match(_NUMBER, text) or any(unit_in(text, other, _NUMBER) for other in QUANTITIES if other != si):
        return ""
    if unit_in(text, si, _NUMBER):
        return "too large, too small or too long to be read"
    return f"units: {', '.join(units_of(si))}"


def expected(si: str) -> str:
    """Expected form of a value with an SI unit: ``a length [m] such as 0.012 or 12 mm``."""
    quantity = QUANTITIES.get(si)
    if quantity is None:
        return f"a number [{si}]"
    return f"{quantity.words} [{si}] such as {to_si(quantity.example, si):.6g} or {quantity.example}"


def pattern(si: str | None) -> str:
    """Return a regular expression for texts with values of an SI unit; None: for values of all unknown units."""
    if si is None:
        return rf"^{_NUMBER} ?\S.*$"
    return f"^{_NUMBER}(?:{'|'.join(map(_spelled, units_of(si)))})$"


@dataclass(frozen=True)
class Unit:
    """The SI unit of a number, or of all numbers in a list, for ``Annotated``; texts with a unit become SI numbers.

    In a mapping, the unit applies to its ``value`` or ``values``, whose own unit is None. Values of a unit that is not
    in ``QUANTITIES``, such as ``N or N m``, cannot be texts. Unreadable text stays, and validation refuses it with its
    place.
    """

    si: str | None

    @property
    def factors(self) -> dict[str, Fraction]:
        """Units for the value, and the size of each in the SI unit; none if the SI unit is unknown."""
        return units_of(self.si or "")

    def read(self, value: Any) -> Any:
        """A value with its texts as SI numbers."""
        if isinstance(value, str) and self.si is not None:
            number = to_si(value, self.si)
            return value if number is None else number
        if isinstance(value, list | tuple):
            return [self.read(entry) for entry in value]
        if isinstance(value, dict):
            return {key: self.read(entry) if key in ("value", "values") else entry for key, entry in value.items()}
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        schema = handler(source)
        if self.si not in QUANTITIES:
            return schema
        return core_schema.no_info_before_validator_function(self.read, schema)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        node = handler(schema)
        if self.si is None or self.si in QUANTITIES:
            _allow_texts(node, pattern(self.si))
        return node if self.si is None else {**node, "unit": self.si}


def _allow_texts(node: Any, texts: str) -> None:
    """Let all numbers of a JSON Schema be texts too, whose bounds do not concern these."""
    if isinstance(node, list):
        for child in node:
            _allow_texts(child, texts)
    elif isinstance(node, dict):
        if node.get("type") == "number":
            node |= {"type": ["number", "string"], "pattern": texts}
        for key in ("anyOf", "oneOf", "items", "prefixItems"):
            _allow_texts(node.get(key), texts)


def any_unit() -> str:
    """Return a regular expression for all spellings of the units of values."""
    units = dict.fromkeys(unit for si in QUANTITIES for unit in units_of(si))
    return "|".join(_spelled(unit).removeprefix(" ").removeprefix("?") for unit in units)


def unit_in(text: str, si: str, before: str = "") -> str | None:
    """Return the unit at the end of a text; a regular expression describes the part before it."""
    return next((unit for unit in units_of(si) if re.fullmatch(before + _spelled(unit), text)), None)


_SPELLINGS = {
    "deg": "deg|°",
    "in": 'in|inch|"|″',
    "mil": "mil|thou",
    "rpm": "rpm|RPM",
    **{second: f"{second}|{second}ec" for second in ("s", "ms", "us", "ns")},
}
"""Other spellings of a symbol."""
_SYMBOL = re.compile("[A-Za-z]+")


@cache
def _spelled(unit: str) -> str:
    """Return a regular expression for all spellings of a unit after a number: N m, N*m or Nm, m/s2 or m/s^2, um or µm.

    In a moment, the unit of force may lack the letter f, as in data sheets of servos: kg cm, oz-in.
    """
    text = re.sub("(?<=[a-z])[23]", lambda power: rf"(?:\^?{power[0]}|{'²³'[int(power[0]) - 2]})", unit)
    text = _SYMBOL.sub(lambda symbol: _symbol(symbol[0], in_moment=" " in unit), text)
    # The blank may be left out, but not where the unit begins with a digit.
    return (" " if unit[0] == "1" else " ?") + text.replace(" ", "[ *·-]?")


def _symbol(symbol: str, *, in_moment: bool) -> str:
    """Return a regular expression for one symbol of a unit."""
    spelled = _SPELLINGS.get(symbol, symbol)
    if in_moment and symbol in ("gf", "kgf", "lbf", "ozf"):
        spelled = f"{symbol[:-1]}f?"
    spelled = re.sub(r"(^|\|)u", r"\1[uµμ]", spelled)
    return f"(?:{spelled})" if "|" in spelled else spelled
