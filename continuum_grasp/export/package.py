"""Writing a package."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from continuum_grasp import __version__, interrupt
from continuum_grasp.export.accuracy import OutputError, check_errors, error_bounds, worst_of
from continuum_grasp.export.bindings import python_binding, wasm_files
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.control.replay import SIZES, UNKNOWN, stateful_usage, stateful_vectors
from continuum_grasp.export.fields import REALS, real_of
from continuum_grasp.export.layer import abi_of, calls_of, library_files, stateful_of
from continuum_grasp.export.manifest import MANIFEST, manifest, manifest_text, write_package
from continuum_grasp.export.part import Part, Vectors
from continuum_grasp.export.parts import OF_LOOPS, PARTS
from continuum_grasp.export.readme import readme
from continuum_grasp.export.source import Given, Source, count_of, parts_of, positive, prefix_of, source_of
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.targets import Target, example_files, measure, target_of
from continuum_grasp.export.template import fill
from continuum_grasp.export.vectors import check_source, vectors_of, vectors_source

_ASKED_ERROR = 1e-2
"""Greatest relative error of single precision by default."""


@dataclass(frozen=True)
class Package:
    """A package that was written.

    Attributes
    ----------
    folder : pathlib.Path
    files : tuple of str
        Paths in it.
    manifest : dict
        What ``MANIFEST.json`` holds.
    """

    folder: Path
    files: tuple[str, ...]
    manifest: dict[str, Any]


@interrupt.listening()
def export_c(
    given: Given,
    folder: str | os.PathLike[str],
    *,
    real: str | None = None,
    what: Sequence[str] | None = None,
    prefix: str = "finger",
    target: str = "host",
    ranges: Mapping[str, Sequence[float]] | None = None,
    step: float | None = None,
    substeps: int = 1,
    error: float | None = None,
    measured: bool = False,
) -> Package:
    """Write the functions of a finger as a self-contained C99 package.

    Parameters
    ----------
    given : FingerModel, Scene, ControlScene, Controller, Estimator or path of a configuration
        What to export. Parameters that it names stay fields of a struct.
    folder : path-like
        Where to. An earlier package there is replaced; files that are none of its own, or were changed, are not.
    real : {"float", "double"}, optional
        What to compute in; that of the target by default.
    what : sequence of str
        Parts: dynamics, step, kinematics, statics, and of a closed loop estimator and mpc; by default those
        two of a closed loop, else the others. They may be mixed: the model is that of the controller's prediction.
    prefix : str
        Of all names, a C identifier.
    target : {"host", "cortex-m4f", "cortex-m7", "wasm"}
        Machine that it is for.
    ranges : mapping, optional
        Least and greatest values of run-time parameters, by name.
    step : float, optional
        Longest step that will be asked for [s]; that of the scene where it has one.
    substeps : int
        Runge-Kutta steps within one.
    error : float, optional
        Greatest relative error of the functions within the bending range; 1e-2 in float by default.
    measured : bool
        Run the package on the emulated target and put sizes, stack and instruction counts into README and manifest.

    Returns
    -------
    Package

    Raises
    ------
    InputError
        If an argument is wrong, the folder holds other files of the same names, the target does not compute in the
        type, the scene is too stiff for the step, or the type cannot hold the asked error.
    NumericalError
        If the model is not finite within the ranges.
    SolverError
        If no model keeps the scene's tolerance, or the package failed on the emulated target.

    Examples
    --------
    >>> import tempfile
    >>> import continuum_grasp as cg
    >>> finger = cg.Finger(rod=cg.Rod(length=0.18, linear_density=0.02, bending_stiffness=0.01))
    >>> model = cg.FingerModel(finger, family="arc", elements=2)
    >>> package = cg.export_c(model, tempfile.mkdtemp(), what=["kinematics"], real="float")
    >>> [name for name in package.files if name.startswith("src/")]
    ['src/finger.c', 'src/finger_internal.h', 'src/finger_kernels.c']
    """
    asked = positive(error, "error")
    aim = target_of(target)
    kind = real_of(aim.real(real))
    source = source_of(given, kind)
    names = parts_of(what, source)
    longest = positive(step, "step") if step is not None else source.step
    subject = Subject.of(
        source.model,
        prefix_of(prefix),
        kind,
        ranges or {},
        longest if "step" in names else None,
        count_of(substeps),
    )
    if source.loop is not None:
        loop = Loop.of(source.loop, kind, [name for name in names if name in OF_LOOPS])
        subject = replace(subject, loop=loop)
    parts = [PARTS[name](subject) for name in names]
    wide = [PARTS[part.name](replace(subject, real=REALS["double"])) for part in parts]
    errors: dict[str, tuple[OutputError, ...]] = {}
    if kind.name == "float":
        errors = {
            narrow.name: error_bounds(subject, narrow, true, seed)
            for seed, (narrow, true) in enumerate(zip(calls_of(parts), calls_of(wide), strict=True))
        }
    limit = _ASKED_ERROR if asked is None else asked
    check_errors(kind, worst_of(errors), limit)
    vectors = vectors_of(subject, calls_of(parts)) if calls_of(parts) else []
    words = _common_words(subject, parts, source)
    files = library_files(subject, parts, words)
    if stateful_of(parts):
        added, more = stateful_vectors(subject, parts, wide, files, words)
        check_errors(kind, worst_of(more), limit)
        vectors += added
        errors |= more
        files = library_files(subject, parts, words)
    files |= _further_files(subject, parts, aim, vectors, words)
    target_folder = Path(folder)
    counts = {v.name: v.count for v in vectors}
    found = measure(files, prefix, aim) if measured else None
    files["README.md"] = readme(
        subject,
        parts,
        words=words,
        errors=errors,
        vectors=counts,
        measured=found,
        source=source.name,
        wasm=aim.name == "wasm",
        touching=source.touching,
    )
    values = manifest(
        subject,
        parts,
        words=words,
        target=aim.name,
        files=files,
        errors=errors,
        vectors=counts,
        measured=found,
        configuration=source.configuration,
    )
    files[MANIFEST] = manifest_text(values)
    write_package(target_folder, files)
    return Package(target_folder, tuple(sorted(files)), values)


def _further_files(
    subject: Subject, parts: Sequence[Part], target: Target, vectors: Sequence[Vectors], words: dict[str, str]
) -> dict[str, str]:
    """Tests, examples, and what builds and finds the library."""
    prefix = subject.prefix
    files = {
        "tests/vectors.h": vectors_source(subject, vectors, words),
        "tests/check.c": check_source(subject, vectors, words),
        f"examples/python/{prefix}.py": python_binding(subject, parts, words),
        f"{prefix}.pc.in": fill("pkgconfig.pc.in", words),
        **{f"tests/{name}": fill(f"tests/{name}", words) for name in ("main.c", "fuzz.c", "threads.c")},
        **{f"cmake/{name}": fill(f"cmake/{name}", words) for name in _CMAKE},
        **{name: fill(name, words) for name in ("CMakeLists.txt", "LICENSE", "package.xml")},
        **example_files(subject, parts, target, words),
    }
    if target.name == "wasm":
        files |= wasm_files(subject, parts, words)
    return files


_CMAKE = ("config.cmake.in", "cortex-m4f.cmake", "cortex-m7.cmake")


def _common_words(subject: Subject, parts: Sequence[Part], source: Source) -> dict[str, str]:
    """What the templates have in common."""
    number = re.match(r"\d+(\.\d+)*", __version__)
    words = {
        "p": subject.prefix,
        "P": subject.prefix.upper(),
        "version": __version__,
        "number": number[0] if number else "0",
        "version3": ".".join([*(number[0] if number else "0").split("."), "0", "0"][:3]),
        "real": subject.real.name,
        "title": source.title,
        "sources": " ".join(_library_sources(subject.prefix, parts)),
        "count": str(len(calls_of(parts)) + len(stateful_of(parts))),
        "check_memory": "".join(
            f"\n  {subject.prefix}_{name} {name};" for function in stateful_of(parts) for name in function.types
        )
        or "\n  int nothing;",
        **dict.fromkeys(SIZES, UNKNOWN),
        "adds_up": "10" if subject.real.name == "float" else "1000",
        "tolerance": "2e-3" if subject.real.name == "float" else "1e-11",
        "usage": _usage(subject, parts),
    }
    return words | {"abi": abi_of(subject, parts, words)}


def _library_sources(prefix: str, parts: Sequence[Part]) -> list[str]:
    """C files of the library below ``src``, without their suffix."""
    paths = dict.fromkeys(path for part in parts for path in part.sources)
    own = [path for path in paths if path.startswith("src/") and path.endswith(".c")]
    return [prefix, f"{prefix}_kernels", *(path.removeprefix("src/").removesuffix(".c") for path in own)]


def _usage(subject: Subject, parts: Sequence[Part]) -> str:
    """C of a first call."""
    if not calls_of(parts):
        return stateful_usage(subject.prefix, stateful_of(parts)[-1])
    prefix, call = subject.prefix, next((c for c in calls_of(parts) if c.name == "step"), calls_of(parts)[0])
    lines = [f"{prefix}_model model;"]
    lines += [f"{prefix}_{a.kind.name} {a.name} = {{0}};" for a in call.inputs if a.is_struct]
    if call.output.kind.name != "state":
        lines.append(f"{prefix}_{call.output.kind.name} {call.output.name};")
    numbers = [f"&{a.name}" if a.is_struct else f"{subject.accurate_step:g}" for a in call.inputs]
    last = "&state" if call.output.kind.name == "state" else f"&{call.output.name}"
    lines += [
        f"int code = {prefix}_init(&model);",
        f"code = {prefix}_{call.name}({', '.join(['&model', *numbers, last])});",
        f"if (code < 0) report({prefix}_strerror(code));",
    ]
    return "\n".join(lines)
