"""modelDescription.xml and buildDescription.xml of both versions of the standard."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree

from continuum_grasp import __version__
from continuum_grasp.export.fmu.units import base_unit
from continuum_grasp.export.fmu.variable import Unit, Variable

_CATEGORIES = {
    "logAll": "everything",
    "logStatusWarning": "a code of the library that is a warning, where it is new",
    "logStatusDiscard": "what was refused, and left all as it was",
    "logStatusError": "a call that is not allowed, or wrong",
}


def model_description(unit: Unit, fmi: str, token: str) -> str:
    """XML of a version, ``"2"`` or ``"3"``."""
    return _xml(_version_2(unit, token) if fmi == "2" else _version_3(unit, token))


def build_description(unit: Unit, sources: Iterable[str]) -> str:
    """XML of FMI 3.0 that tells how the sources are compiled."""
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=unit.identifier)
    files = ElementTree.SubElement(build, "SourceFileSet", language="C99", compilerOptions=" ".join(unit.flags))
    for name in sources:
        ElementTree.SubElement(files, "SourceFile", name=name)
    ElementTree.SubElement(build, "Library", name="m", external="true")
    return _xml(root)


def _xml(root: ElementTree.Element) -> str:
    ElementTree.indent(root, "  ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _number(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else "NaN"


def _root(unit: Unit, fmi: str, **more: str) -> ElementTree.Element:
    return ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": fmi,
            "modelName": unit.title,
            **more,
            "description": f"{unit.title}: {unit.what}",
            "version": str(unit.manifest["configuration_hash"]),
            "generationTool": f"continuum_grasp {__version__}",
            "license": "MIT",
            "variableNamingConvention": "structured",
        },
    )


def _units_and_log(root: ElementTree.Element, unit: Unit) -> None:
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for name in sorted({v.unit for v in unit.variables} | {"s"}):
        of = ElementTree.SubElement(definitions, "Unit", name=name)
        base = base_unit(name)
        if base is not None:
            ElementTree.SubElement(of, "BaseUnit", {key: str(power) for key, power in base.items()})
    categories = ElementTree.SubElement(root, "LogCategories")
    for name, text in _CATEGORIES.items():
        ElementTree.SubElement(categories, "Category", name=name, description=text)
    ElementTree.SubElement(
        root, "DefaultExperiment", startTime="0.0", stopTime=_number(unit.stop), stepSize=_number(unit.step)
    )


def _real(unit: Unit, variable: Variable) -> dict[str, str]:
    """Attributes that both versions have of a real variable."""
    found = {"unit": variable.unit}
    if variable.kind in ("input", "tunable", "fixed"):  # what is computed may leave the range in which it is taken
        if math.isfinite(variable.low):
            found["min"] = _number(variable.low)
        if math.isfinite(variable.high):
            found["max"] = _number(variable.high)
    if variable.nominal is not None:
        found["nominal"] = _number(variable.nominal)
    if variable.kind not in ("output", "rate"):
        found["start"] = _number(variable.start)
    return found


def _roles(unit: Unit, variable: Variable) -> dict[str, str]:
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


def _text(text: str) -> dict[str, str]:
    return {"description": text} if text else {}


def _depends(unit: Unit, variable: Variable) -> list[int]:
    """Value references of states and inputs on which a result depends, as far as the structure tells."""
    inputs = [k for k, v in enumerate(unit.variables) if v.kind == "input"]
    states = [k for k, v in enumerate(unit.variables) if v.kind == "state"] if unit.linear else []
    if variable.kind == "state":
        return [k for k in states if unit.variables[k] is variable]
    if variable.kind == "rate" or not unit.continuous:
        return sorted(states + inputs)
    return sorted(states + (inputs if unit.feedthrough else []))


def _flags(unit: Unit, state: str, derivatives: str) -> dict[str, str]:
    return {
        "modelIdentifier": unit.identifier,
        "canHandleVariableCommunicationStepSize": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        f"canGetAndSetFMU{state}": "true",
        f"canSerializeFMU{state}": "true",
        derivatives: "true" if unit.linear else "false",
    }


def _version_2(unit: Unit, token: str) -> ElementTree.Element:
    root = _root(unit, "2.0", guid=token)
    flags = {**_flags(unit, "state", "providesDirectionalDerivative"), "canNotUseMemoryManagementFunctions": "true"}
    simulates = ElementTree.SubElement(root, "CoSimulation", flags)
    files = ElementTree.SubElement(simulates, "SourceFiles")
    for name in sorted([*(n for n in unit.sources if n.endswith(".c")), "fmi2.c"]):
        ElementTree.SubElement(files, "File", name=name)
    _units_and_log(root, unit)
    listed = ElementTree.SubElement(root, "ModelVariables")
    reals = unit.variables
    first = next((k for k, v in enumerate(reals) if v.kind == "state"), 0)
    rates = [k for k, v in enumerate(reals) if v.kind == "rate"]
    for k, variable in enumerate(reals):
        given = {"name": variable.name, "valueReference": str(k), **_text(variable.text), **_roles(unit, variable)}
        of = ElementTree.SubElement(listed, "ScalarVariable", given)
        derivative = {"derivative": str(first + k - rates[0] + 1)} if k in rates else {}
        ElementTree.SubElement(of, "Real", {**_real(unit, variable), **derivative})
    for k, count in enumerate(unit.counts):
        given = {"name": count.name, "valueReference": str(len(reals) + k), **_text(count.text), **_COUNT}
        ElementTree.SubElement(ElementTree.SubElement(listed, "ScalarVariable", given), "Integer")
    structure = ElementTree.SubElement(root, "ModelStructure")
    results = [k for k, v in enumerate(reals) if v.kind in ("state", "output")]
    counts = range(len(reals), len(reals) + len(unit.counts))

    def entry(of: ElementTree.Element, k: int) -> None:
        # In FMI 2.0 variables are numbered from one, in their order.
        on = {} if k >= len(reals) else {"dependencies": " ".join(str(j + 1) for j in _depends(unit, reals[k]))}
        ElementTree.SubElement(of, "Unknown", {"index": str(k + 1), **on})

    outputs = ElementTree.SubElement(structure, "Outputs")
    for k in (*results, *counts):
        entry(outputs, k)
    if rates and unit.linear:
        derivatives = ElementTree.SubElement(structure, "Derivatives")
        for k in rates:
            entry(derivatives, k)
    unknowns = ElementTree.SubElement(structure, "InitialUnknowns")
    for k in (*(k for k, v in enumerate(reals) if _is_unknown(unit, v)), *counts):
        ElementTree.SubElement(unknowns, "Unknown", {"index": str(k + 1)})
    return root


def _is_unknown(unit: Unit, variable: Variable) -> bool:
    """Whether it is computed by the initialization."""
    return variable.kind == "output" or (variable.kind == "rate" and unit.linear)


def _version_3(unit: Unit, token: str) -> ElementTree.Element:
    root = _root(unit, "3.0", instantiationToken=token)
    flags: dict[str, Any] = _flags(unit, "State", "providesDirectionalDerivatives")
    ElementTree.SubElement(root, "CoSimulation", {**flags, "fixedInternalStepSize": _number(unit.step)})
    _units_and_log(root, unit)
    listed = ElementTree.SubElement(root, "ModelVariables")
    reals = unit.variables
    first = next((k for k, v in enumerate(reals) if v.kind == "state"), 0)
    rates = [k for k, v in enumerate(reals) if v.kind == "rate"]
    for k, variable in enumerate(reals):
        derivative = {"derivative": str(first + k - rates[0])} if k in rates else {}
        ElementTree.SubElement(
            listed,
            "Float64",
            {
                "name": variable.name,
                "valueReference": str(k),
                **_text(variable.text),
                **_roles(unit, variable),
                **_real(unit, variable),
                **derivative,
            },
        )
    for k, count in enumerate(unit.counts):
        given = {"name": count.name, "valueReference": str(len(reals) + k), **_text(count.text), **_COUNT}
        ElementTree.SubElement(listed, "Int32", given)
    time = {"name": "time", "valueReference": str(len(reals) + len(unit.counts)), "description": "time"}
    ElementTree.SubElement(
        listed, "Float64", {**time, "causality": "independent", "variability": "continuous", "unit": "s"}
    )
    structure = ElementTree.SubElement(root, "ModelStructure")
    counts = range(len(reals), len(reals) + len(unit.counts))

    def entry(kind: str, k: int) -> None:
        on = {} if k >= len(reals) else {"dependencies": " ".join(map(str, _depends(unit, reals[k])))}
        ElementTree.SubElement(structure, kind, {"valueReference": str(k), **on})

    for k in (*(k for k, v in enumerate(reals) if v.kind in ("state", "output")), *counts):
        entry("Output", k)
    if unit.linear:
        for k in rates:
            entry("ContinuousStateDerivative", k)
    for k in (*(k for k, v in enumerate(reals) if _is_unknown(unit, v)), *counts):
        ElementTree.SubElement(structure, "InitialUnknown", {"valueReference": str(k)})
    return root
