"""MANIFEST.json: what a package is made of and from, the same wherever it is made; files that it may replace."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca

from continuum_grasp import __version__
from continuum_grasp.base import InputError, split_unit
from continuum_grasp.core import CReal
from continuum_grasp.export.accuracy import OutputError, Report
from continuum_grasp.export.build import FLAGS
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.fields import Field, Struct, identifiers
from continuum_grasp.export.layer import DIMENSIONS, Contents
from continuum_grasp.export.part import Code
from continuum_grasp.model import FingerModel
from continuum_grasp.results import check_folder, write_text


def manifest(
    contents: Contents,
    report: Report,
    *,
    target: str,
    files: Mapping[str, str],
    configuration: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Content of the manifest of a package, as plain values."""
    subject = contents.subject
    model = contents.subject.finger
    words = contents.words
    return {
        "name": subject.prefix,
        "versions": {"continuum_grasp": __version__, "casadi": str(ca.CasadiMeta.version())},
        "abi": words["abi"],
        "configuration_hash": words["hash"],
        "real": subject.real.name,
        "target": target,
        "parts": [part.name for part in contents.parts],
        "model": None if model is None else model_description(model),
        "flags": FLAGS,
        "dimensions": {} if model is None else {name: getattr(subject.moving, name) for name in DIMENSIONS},
        "structs": {s.name: [entry(field) for field in s.fields] for s in contents.structs},
        "nominal_parameters": {}
        if model is None
        else {
            split_unit(label).name: float(value)
            for label, value in zip(subject.moving.p_names, subject.moving.p_nominal, strict=True)
        },
        "functions": _functions(contents, report),
        "codes": {code.name: {"value": int(code), "text": code.text} for code in contents.codes},
        "operations": {kernel.name: dict(sorted(kernel.operations.items())) for kernel in contents.kernels},
        "stability": None
        if model is None
        else {
            # Rounded: the last digits of eigenvalues differ from one LAPACK to the next.
            "greatest_rate_1_per_s": float(f"{subject.radius:.6g}"),
            "substeps": subject.substeps,
            "longest_step_s": subject.longest_step,
            "accurate_step_s": subject.accurate_step,
        },
        "steps": _steps(contents),
        "loop": None if subject.loop is None else _loop_description(subject.loop, subject.real),
        "measured": report.measured,
        "configuration": configuration,
        "sha256": {name: hashlib.sha256(text.encode()).hexdigest() for name, text in sorted(files.items())},
    }


def _functions(contents: Contents, report: Report) -> dict[str, Any]:
    """Inputs, output, test cases and rounding errors by function, and of those that keep something their memory."""
    functions = dict[str, Any]()
    for call in contents.calls:
        functions[call.name] = {
            "inputs": [a.name if a.is_struct else entry(a.fields[0]) for a in call.inputs],
            "output": call.output.name,
            "test_cases": report.cases.get(call.name, 0),
            **_errors(report.errors.get(call.name, ())),
        }
    for function in contents.stateful:
        functions[function.name] = {
            "inputs": list(function.inputs),
            "output": function.output,
            "test_cases": report.cases.get(function.name, 0),
            **_errors(report.errors.get(function.name, ())),
            "memory_bytes": {name: int(contents.words[f"{name}_bytes"]) for name in function.types},
        }
    return functions


def _steps(contents: Contents) -> dict[str, Any]:
    """Range of the steps of each function that takes any, and sub-steps within one."""
    subject = contents.subject
    return {
        call.name: {
            "shortest_s": a.fields[0].low,
            "longest_s": a.fields[0].high,
            **({"accurate_s": subject.accurate_step} if call.name == "step" else {}),
            "substeps": subject.substeps if call.name == "step" else subject.count or 1,
        }
        for call in contents.calls
        for a in call.inputs
        if a.code is Code.ERR_STEP
    }


def model_description(model: FingerModel) -> dict[str, Any]:
    """Family and elements of a model, as plain values."""
    return {
        "family": model.family,
        "element_lengths_m": [float(h) for h in model.lengths],
        "bending_ranges_rad": [float(r) for r in model.ranges],
        "contacts_m": [float(c) for c in model.contacts],
    }


def _loop_description(loop: Loop, real: CReal) -> dict[str, Any]:
    """Times of a closed loop, and the values of its structs to begin with."""

    def named(struct: Struct, values: Iterable[float]) -> dict[str, float]:
        # JSON has no infinity: a bound that is none is the greatest number, as in the C.
        return {name: min(max(v, -real.greatest), real.greatest) for name, v in struct.named(values).items()}

    mission = loop.phases and {
        "phases": identifiers(loop.phases.names),
        "planned_end_s": loop.phases.ends,
        "reports": [name for name, _ in loop.phases.reported],
        "watches": loop.phases.watches,
    }
    return {
        "period_s": loop.period,
        "stage_s": loop.stages.stage,
        "nodes": loop.nodes,
        "delay_periods": loop.periods,
        "measurement_at_start": named(loop.measurement, loop.measured_at_start),
        "command_before": named(loop.command, loop.before),
        "first_setpoints": named(loop.reference, loop.wanted),
        "nominal_settings": named(loop.settings, loop.nominal_settings),
        "nominal_known": {} if loop.known is None else named(loop.known, loop.stages.p_nominal),
        "mission": mission,
    }


def manifest_text(values: Mapping[str, Any]) -> str:
    """Plain values as the text of a JSON file."""
    return json.dumps(values, indent=2, allow_nan=False) + "\n"


def _errors(outputs: Sequence[OutputError]) -> dict[str, Any]:
    """Rounding errors of single precision by field; nothing in double precision."""
    if not outputs:
        return {}
    errors = {}
    for output in outputs:
        values: dict[str, float | None] = {"bound": output.bound}
        if output.any_call is not None:
            values = {"usual_call": output.bound, "any_call": output.any_call, "over_the_run": output.over_run}
        # JSON has no infinity, which is where one build alone gives an output.
        seen = {name: value and min(value, sys.float_info.max) for name, value in values.items()}
        errors[output.name] = {**seen, "unit": output.unit, "greatest_value": output.greatest}
    return {"relative_error": float(f"{max(output.relative for output in outputs):.1g}"), "errors": errors}


def entry(field: Field) -> dict[str, Any]:
    """Name, unit, and what else is known of a number."""
    description: dict[str, Any] = {"name": field.name, "unit": field.unit}
    if field.text:
        description["text"] = field.text
    if field.shape:
        description["shape"] = list(field.shape)
    if field.low > -math.inf:
        description["low"] = float(field.low)
    if field.high < math.inf:
        description["high"] = float(field.high)
    if field.usual is not None:
        description["nominal"] = field.usual
    return description


MANIFEST = "MANIFEST.json"


@dataclass(frozen=True)
class Package:
    """A package that was written, of C or of functions that CasADi loads.

    Attributes
    ----------
    folder : pathlib.Path
    files : tuple of str
        Paths in it.
    manifest : dict
        Content of ``MANIFEST.json``.
    """

    folder: Path
    files: tuple[str, ...]
    manifest: dict[str, Any]


def write_package(folder: Path, others: Mapping[str, str], values: dict[str, Any]) -> Package:
    """Write every file whole, the manifest last; remove files of an earlier package that are of no more use.

    InputError, before anything is written, if a file of that name is there that no export wrote or that was changed. A
    file that an export was interrupted at, or that ends before the end of its text, is replaced.
    """
    check_folder(folder, "export")
    files = {**others, MANIFEST: manifest_text(values)}
    earlier = _earlier(folder)
    for name, text in files.items():
        path = folder / name
        begun = path.is_file() and text.encode().startswith(path.read_bytes())
        if path.exists() and not begun and _digest(path) not in earlier.get(name, ()):
            raise InputError(f"{path} has changed since its export: move it, or choose another folder", key="folder")
    for name in earlier.keys() - files.keys():
        path = folder / name
        # A manifest may have been edited: what it lists outside of the folder, or was changed since, is not ours.
        if path.resolve().is_relative_to(folder.resolve()) and path.is_file() and _digest(path) in earlier[name]:
            path.unlink()
    # Until the end the manifest knows the files of both packages, so that the next export may replace either.
    both = {name: [*earlier.get(name, ()), hashlib.sha256(text.encode()).hexdigest()] for name, text in others.items()}
    write_text(manifest_text({"configuration_hash": "unfinished", "sha256": both}), folder / MANIFEST)
    for name, text in files.items():
        write_text(text, folder / name)
    return Package(folder, tuple(sorted(files)), values)


def _earlier(folder: Path) -> dict[str, list[str]]:
    """SHA-256 of the files of the package that is there, its manifest included; empty where there is none."""
    path = folder / MANIFEST
    try:
        listed = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        digests = {
            str(name): [checksum] if isinstance(checksum, str) else list(checksum)
            for name, checksum in listed["sha256"].items()
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}
    return digests | {MANIFEST: [_digest(path)]} if "configuration_hash" in listed else {}


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
