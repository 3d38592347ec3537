"""Plausible magnitudes of fingers, materials and benches, in one table with sources.

A value outside its range causes a doubt, not an error: it is possible, but more likely in another unit. A number type
of `continuum_grasp.scene.value` carries its magnitude next to its unit, so that every key of this type is checked.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args

from pydantic import BaseModel


@dataclass(frozen=True)
class Magnitude:
    """Plausible range, and the words about a value beyond it, which begin with the unit."""

    least: float
    most: float
    words: str

    def doubt(self, value: Any) -> str:
        """Describe a number out of the range, or the first one in a sequence; empty if all are within."""
        if isinstance(value, list | tuple):
            return next(filter(None, map(self.doubt, value)), "")
        plausible = isinstance(value, bool) or not isinstance(value, int | float) or self.least <= value <= self.most
        return "" if plausible else f"{value:g} {self.words.format(value)}"


TURN = 6.2831853072
"""A full turn, rounded up [rad]: directions are within one turn."""
ANGLE = Magnitude(-TURN, TURN, "rad is beyond a full turn; is it in degrees? (expected: rad, or {0:g} deg)")
FINGER_LENGTH = Magnitude(1e-3, 10.0, "m is no length of a finger; is it in millimeters? (expected: m)")
"""From the tips of catheters (1 mm) to inflated robots that grow (10 m: Hawkes et al. 2017,
doi:10.1126/scirobotics.aan3028)."""
THICKNESS = Magnitude(0.0, 0.3, "m is large for a finger; is it in millimeters? (expected: m)")
"""The Bionic Handling Assistant, a trunk of 0.75 m, is 0.2 m thick at its base."""
PLACE = Magnitude(-100.0, 100.0, "m is far from any bench; is it in pixels or millimeters? (expected: m)")
MODULUS = Magnitude(1e3, 2e12, "Pa fits no material; 60 GPa is 60e9 (expected: Pa)")
"""From soft gels (1 kPa) to graphene (1 TPa: Lee et al. 2008, doi:10.1126/science.1157996)."""
DENSITY = Magnitude(10.0, 23e3, "kg/m3 fits no solid; 6.45 g/cm3 is 6450 (expected: kg/m3)")
"""From foams (10 kg/m3) to osmium (22,600 kg/m3: CRC Handbook of Chemistry and Physics)."""
FRICTION = Magnitude(0.0, 2.0, "is more than dry surfaces have: rubber on glass reaches about 2; is it in percent?")
"""A. Schallamach, The load dependence of rubber friction, Proc. Phys. Soc. B 65 (1952) 657: above 1 at light loads."""
CONTACT_STIFFNESS = Magnitude(10.0, 1e7, "N/m fits no fingertip (expected: N/m)")
"""From pulp of a human fingertip and soft silicone (10 to 1,000 N/m) to steel on steel (1e7 N/m, Hertz)."""
ONSET = Magnitude(0.0, 1e-3, "m is more than a millimeter (expected: m)")
ACCELERATION = Magnitude(-1e3, 1e3, "m/s2 is a hundred times the earth's gravity; is it in mm/s2?")
FORCE = Magnitude(-2e4, 2e4, "N breaks a steel rope of 5 mm; is it in millinewtons? (expected: N)")
"""A steel rope of 5 mm breaks at about 15 kN (EN 12385-4)."""
DURATION = Magnitude(0.0, 1e6, "s is more than eleven days; is it in milliseconds or microseconds? (expected: s)")
"""Creep takes days, motions take seconds."""


@cache
def magnitudes(model: type[BaseModel]) -> dict[str, Magnitude]:
    """Return the magnitudes of a class's fields, by their types."""
    found = {name: _first(field.annotation, field.metadata) for name, field in model.model_fields.items()}
    return {name: magnitude for name, magnitude in found.items() if magnitude is not None}


def _first(annotation: Any, metadata: Any) -> Magnitude | None:
    return next(_all(annotation, metadata), None)


def _all(annotation: Any, metadata: Any) -> Iterator[Magnitude]:
    yield from (each for each in metadata if isinstance(each, Magnitude))
    for inner in get_args(annotation):
        if not isinstance(inner, type):
            yield from _all(inner, getattr(inner, "__metadata__", ()))


def too_heavy(mass: float) -> str:
    """Return the words about an object that is heavier than the densest solid of its size [kg]."""
    return f"the densest solid of its size has {mass:.2g} kg; is it in grams? (expected: kg)"
