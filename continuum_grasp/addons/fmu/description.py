"""modelDescription.xml of both versions of the standard."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from xml.etree import ElementTree
from xml.sax.saxutils import escape, quoteattr

from continuum_grasp import __version__
from continuum_grasp.addons.fmu.variable import UnitContents, Variable
from continuum_grasp.export import fill


def model_description(unit: UnitContents, fmi: str, token: str) -> str:
    """XML of a version, ``"2"`` or ``"3"``."""
    old = fmi == "2"
    units = {name: base_unit(name) for name in sorted({variable.unit for variable in unit.variables} | {"s"})}
    texts = {"title": unit.title, "what": unit.what, "hash": unit.manifest["configuration_hash"], "token": token}
    words = {name: escape(str(text), {'"': "&quot;"}) for name, text in texts.items()} | {
        "fmi": fmi,
        "old": old,
        "id": "guid" if old else "instantiationToken",
        "version": __version__,
        "unit": unit,
        "linear": str(unit.linear).lower(),
        "any_step": str(unit.any_step).lower(),
        "step": _number(unit.step),
        "stop": _number(unit.stop),
        "sources": sorted([*(name for name in unit.sources if name.endswith(".c")), "fmi2.c"]),
        "units": [(n, base is not None, (base or {}).items()) for n, base in units.items()],
        "variables": _variables(unit, old),
        "groups": _structure(unit, old),
    }
    root = ElementTree.fromstring(fill("fmu/description.xml", words))
    ElementTree.indent(root, "  ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _variables(unit: UnitContents, old: bool) -> list[tuple[str, str, str]]:
    """Type of each variable, what both versions say of it, and what FMI 2.0 has in an element within."""
    reals = unit.variables
    first = next((k for k, v in enumerate(reals) if v.kind == "state"), 0)
    rates = [k for k, v in enumerate(reals) if v.kind == "rate"]
    rows = []
    for k, v in enumerate(reals):
        # In FMI 2.0 variables are numbered from one, in their order; in FMI 3.0 they are named by their references.
        derivative = {"derivative": first + k - rates[0] + old} if k in rates else {}
        rows.append(("Real" if old else "Float64", v, _roles(unit, v), {**_real(v), **derivative}))
    rows += [("Integer" if old else "Int32", count, _COUNT, {}) for count in unit.counts]
    if not old:
        time = Variable("time", "s", "time", kind="output")
        rows.append(("Float64", time, {"causality": "independent", "variability": "continuous"}, {"unit": "s"}))
    return [
        (kind, _attributes({"name": v.name, "valueReference": k, "description": v.text, **roles}), _attributes(values))
        for k, (kind, v, roles, values) in enumerate(rows)
    ]


def _structure(unit: UnitContents, old: bool) -> list[tuple[str, str, list[str]]]:
    """Outputs, rates and what the initialization computes: group of FMI 2.0, element of FMI 3.0, and the entries."""
    reals = unit.variables
    rates = [k for k, v in enumerate(reals) if v.kind == "rate"] if unit.linear else []
    counts = range(len(reals), len(reals) + len(unit.counts))
    seen = [k for k, v in enumerate(reals) if v.kind in ("state", "output")]
    unknown = [k for k, v in enumerate(reals) if v.kind == "output" or k in rates]

    def entry(k: int, depends: bool) -> str:
        on = {"dependencies": " ".join(str(j + old) for j in _depends(unit, reals[k]))} if depends else {}
        return _attributes({"index" if old else "valueReference": k + old, **on})

    groups = [
        ("Outputs", "Output", [entry(k, k not in counts) for k in (*seen, *counts)]),
        ("Derivatives", "ContinuousStateDerivative", [entry(k, True) for k in rates]),
        ("InitialUnknowns", "InitialUnknown", [entry(k, False) for k in (*unknown, *counts)]),
    ]
    return [group for group in groups if group[2]]


def _attributes(values: Mapping[str, object]) -> str:
    """Attributes of an element; none of an empty text."""
    texts = ((name, str(value)) for name, value in values.items())
    return " ".join(f"{name}={quoteattr(text)}" for name, text in texts if text or name != "description")


def _number(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else "NaN"


def _real(variable: Variable) -> dict[str, str]:
    """Attributes that both versions have of a real variable."""
    attributes = {"unit": variable.unit}
    if variable.kind in ("input", "tunable", "fixed"):  # what is computed may leave the range in which it is taken
        if math.isfinite(variable.low):
            attributes["min"] = _number(variable.low)
        if math.isfinite(variable.high):
            attributes["max"] = _number(variable.high)
    if variable.nominal is not None:
        attributes["nominal"] = _number(variable.nominal)
    if variable.kind not in ("output", "rate"):
        attributes["start"] = _number(variable.start)
    return attributes


def _roles(unit: UnitContents, variable: Variable) -> dict[str, str]:
    changes = "continuous" if unit.continuous else "discrete"
    return {
        "input": {"causality": "input", "variability": changes},
        "tunable": {"causality": "parameter", "variability": "tunable", "initial": "exact"},
        "fixed": {"causality": "parameter", "variability": "fixed", "initial": "exact"},
        "state": {"causality": "output", "variability": changes, "initial": "exact"},
        "output": {"causality": "output", "variability": changes, "initial": "calculated"},
        "rate": {"causality": "local", "variability": changes, "initial": "calculated"},
    }[variable.kind]


_COUNT = {"causality": "output", "variability": "discrete", "initial": "calculated"}


def _depends(unit: UnitContents, variable: Variable) -> list[int]:
    """Value references of states and inputs on which a result depends, as far as the structure tells."""
    inputs = [k for k, v in enumerate(unit.variables) if v.kind == "input"]
    states = [k for k, v in enumerate(unit.variables) if v.kind == "state"] if unit.linear else []
    if variable.kind == "state":
        return [k for k in states if unit.variables[k] is variable]
    if variable.kind == "rate" or not unit.continuous:
        return sorted(states + inputs)
    return sorted(states + (inputs if unit.feedthrough else []))


_BASE = {
    "m": {"m": 1},
    "kg": {"kg": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Hz": {"s": -1},
    "1": {},
}
_FACTOR = re.compile(r"\s*(/*)\s*(?:\(([^()]*)\)|([A-Za-z]+|1))(\d*)")


def base_unit(unit: str) -> dict[str, int] | None:
    """Exponents by base unit of a unit as labels write it, like ``N m2`` or ``1/(rad/s)2``; None where it is none.

    Factors stand side by side; a stroke divides by the one factor, or parenthesis, behind it: ``N m2`` is
    ``{"kg": 1, "m": 3, "s": -2}``.
    """
    exponents = dict[str, int]()
    at = 0
    while not at or at < len(unit):
        match = _FACTOR.match(unit, at)
        if match is None:
            inner = None
        elif match[2] is None:
            inner = _BASE.get(match[3])
        else:
            inner = base_unit(match[2])
        if match is None or inner is None:
            return None
        power = (-1 if match[1] else 1) * int(match[4] or 1)
        at = match.end()
        for name, exponent in inner.items():
            exponents[name] = exponents.get(name, 0) + power * exponent
    return {name: power for name, power in exponents.items() if power}
