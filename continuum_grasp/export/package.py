"""Writing a package."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from continuum_grasp import __version__
from continuum_grasp.base import CheckedArgument, check_arguments, interruptible
from continuum_grasp.control import RtiSolver
from continuum_grasp.core import CReal
from continuum_grasp.export.accuracy import OutputError, Report, check_errors, error_bounds
from continuum_grasp.export.bindings import python_binding, wasm_files
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.control.replay import stateful_vectors
from continuum_grasp.export.control.source import SIZES, UNKNOWN
from continuum_grasp.export.layer import Contents, abi_of, add_sizes, library_files
from continuum_grasp.export.manifest import Package, manifest, write_package
from continuum_grasp.export.part import Vectors
from continuum_grasp.export.parts import OF_LOOPS, PARTS
from continuum_grasp.export.readme import readme
from continuum_grasp.export.source import Given, ModelSource, known_parts, parts_of, prefix_of, source_of
from continuum_grasp.export.subject import MOST_SUBSTEPS, Subject
from continuum_grasp.export.targets import (
    check_measuring_tools,
    example_files,
    measure,
    measured_core,
    target_of,
)
from continuum_grasp.export.vectors import check_source, vectors_of, vectors_source
from continuum_grasp.results import check_folder
from continuum_grasp.scene import Consumer

_ARGUMENT = "an argument of the functions"
_PACKAGE = Consumer(
    "export to c, operators",
    unneeded={
        **Consumer.LIMITS_OF_BENDING,
        **dict.fromkeys(
            ("actuation", "initial", "loads.force", "loads.moment", "object_load", "support_motion", "table_height"),
            _ARGUMENT,
        ),
        **{f"time.{key}": "steps are the caller's" for key in ("duration", "method", "tolerance", "space_error")},
        **Consumer.LEAST_COMMANDS,
    },
)
_LOOP = Consumer(
    "export to c of closed loops",
    unneeded={
        **dict.fromkeys(("plant", "loads"), "the package has the controller, and no plant"),
        "log": "of logs of a bench",
        "mounting": "the caller takes readings and commands through it: the package counts as the model does",
        "controller.deadline": "the caller has the clock, and says whether the last command was late",
    },
)


@interruptible()
@check_arguments
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
    substeps: int | None = None,
    sections: int = 25,
    error: float | None = None,
    measured: bool = False,
    finger: str | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Package:
    """Write the functions of a finger, or a solver, as a self-contained C99 package.

    Parameters
    ----------
    given : FingerModel, Scene, ControlScene, AssignedMission, MissionRun, Controller, Estimator, RtiSolver or path
        The object to export, or the path of its configuration; a mission comes from `assign_mission`, or as a
        run; of a solver (``rti``), which takes any finite number, the part mpc alone. Parameters that it
        names stay fields of a struct.
    folder : path-like
        Target folder. An earlier package there is replaced; other files, and changed ones, are not.
    real : {"float", "double"}, optional
        Number type; by default the target's.
    what : sequence of str
        Parts: dynamics, step, implicit_step, kinematics, statics, linearization, shape, velocities, contact, of a
        closed loop estimator and mpc, of a mission also mission; by default estimator and mpc of a closed loop, mpc and
        mission of a mission, else dynamics, step, kinematics and statics. They may be mixed: the model is the one in
        the controller's prediction.
    prefix : str
        Prefix of all names, a C identifier.
    target : {"host", "cortex-m4f", "cortex-m7", "wasm"}
        Target machine.
    ranges : mapping, optional
        Least and greatest values of run-time parameters, by name; of an object's contacts also ``contact_force`` [N].
    step : float, optional
        Longest step of any call [s]; by default the scene's, where it has one.
    substeps : int, optional
        Runge-Kutta steps within one; as many as the longest step needs by default.
    sections : int
        Number of sections that shape and velocities return in one call, evenly spaced from base to tip.
    error : float, optional
        Greatest relative error of the functions within the bending range; 1e-2 in float by default.
    measured : bool
        Run the package on the emulated target and put sizes, stack and instruction counts into README and manifest.
    finger : str, optional
        Name of the finger to export, for a mission with several.
    progress : callable, optional
        Called with the share of the work done, 0 to 1, and with the current work in words.

    Returns
    -------
    Package

    Raises
    ------
    InputError
        If an argument is wrong, the folder holds other files of the same names, the target does not compute in the
        type, the scene is too stiff for the step, or the type cannot meet ``error``.
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
    check_folder(folder, "export")
    options = PackageOptions(
        real=real,
        what=what,
        prefix=prefix,
        target=target,
        ranges=ranges,
        step=step,
        substeps=substeps,
        sections=sections,
        error=error,
        measured=measured,
        finger=finger,
    )
    files, values = _package(given, options, progress or (lambda share, text: None))
    return write_package(Path(folder), files, values)


@dataclass(frozen=True, kw_only=True)
class PackageOptions:
    """Options of a package, see ``export_c``; InputError for those that no package has, whatever is exported."""

    real: str | None = None
    what: Sequence[str] | None = None
    prefix: str = "finger"
    target: str = "host"
    ranges: Mapping[str, Sequence[float]] | None = None
    step: float | None = None
    substeps: int | None = None
    sections: int = 25
    error: float | None = None
    measured: bool = False
    finger: str | None = None

    def __post_init__(self) -> None:
        target, _ = target_of(self.target, self.real)
        if self.measured:
            measured_core(target)
        if self.what is not None:
            known_parts(self.what)
        if self.error is not None:
            CheckedArgument("error", self.error).number()
        if self.step is not None:
            CheckedArgument("step", self.step).number()
        # 200: most sections of shape and velocities, each of which is code of its own
        CheckedArgument("sections", self.sections).whole(2, 200)
        if self.substeps is not None:
            CheckedArgument("substeps", self.substeps).whole(1, MOST_SUBSTEPS)
        prefix_of(self.prefix)


def _package(
    given: Given, options: PackageOptions, report: Callable[[float, str], None]
) -> tuple[dict[str, str], dict[str, Any]]:
    """Files of a package by path, and its manifest."""
    # 1e-2: greatest relative error of single precision by default
    limit = 1e-2 if options.error is None else options.error
    target, computed_in = target_of(options.target, options.real)
    kind = CReal.KINDS[computed_in]
    source = source_of(given, kind, options.finger)
    names = parts_of(options.what, source)
    solver = {"what": "a predictive controller"} if source.model is None else {}
    # Shares of the time that a mission takes; one with the part dynamics alone has few vectors and is done sooner.
    report(0.0, "writing the code")
    contents = contents_of(subject_of(source, names, kind, options), names, source.title, **solver)
    if options.measured:
        check_measuring_tools()
    vectors, files, errors = _checked(contents, limit, lambda share, text: report(0.3 + 0.6 * share, text))
    report(0.9, "writing the files")
    files |= _further_files(contents, target, vectors)
    measured = measure(files, target) if options.measured else None
    checked = Report({v.name: v.count for v in vectors}, errors, measured)
    files["README.md"] = readme(
        contents,
        checked,
        header=files[f"include/{options.prefix}.h"],
        source=source.name,
        wasm=target == "wasm",
    )
    return files, manifest(contents, checked, target=target, files=files, configuration=source.configuration)


def _checked(
    contents: Contents, limit: float, report: Callable[[float, str], None]
) -> tuple[list[Vectors], dict[str, str], dict[str, tuple[OutputError, ...]]]:
    """Test vectors, files of the library, and rounding errors in single precision, which the ``limit`` may refuse."""
    subject = contents.subject
    double = None
    errors = dict[str, tuple[OutputError, ...]]()
    if subject.real.name == "float":
        # The same in double: the truth for the errors of single precision.
        names = [part.name for part in contents.parts]
        double = contents_of(replace(subject, real=CReal.KINDS["double"]), names, contents.words["title"])
        for seed, (narrow, true) in enumerate(zip(contents.calls, double.calls, strict=True)):
            errors[narrow.name] = error_bounds(subject, narrow, true, seed)
        check_errors(subject, errors, limit)
    if contents.stateful:
        add_sizes(contents)
    files = library_files(contents)
    vectors, more = stateful_vectors(contents, double, files, report)
    check_errors(subject, more, limit)
    return [*vectors_of(subject, contents.calls), *vectors], files, errors | more


_SOLVERS = Consumer(
    "export to c of a solver", {"ranges": "a solver of a problem takes any finite number: expected no ranges"}
)


def subject_of(source: ModelSource, names: Sequence[str], kind: CReal, options: PackageOptions) -> Subject:
    """The model and the loop that it is part of, or a solver's loop alone."""
    longest = source.step if options.step is None else float(options.step)
    if "step" not in names:  # a scene that is too stiff to step may still be asked for the rest
        longest = None
    prefix = options.prefix
    count = None if options.substeps is None else int(options.substeps)
    if isinstance(source.loop, RtiSolver):
        _SOLVERS.check(source, of={"ranges": bool(options.ranges)})
        return Subject(prefix, kind, loop=Loop.of_solver(source.loop, kind))
    # Estimator and controller have the object in a model of their own.
    alone = set(OF_LOOPS).issuperset(names)
    ranges = options.ranges or {}
    around = None if alone else source.surroundings
    subject = Subject.of(source.finger, prefix, kind, ranges, around, longest=longest, count=count)
    loop_parts = [name for name in names if name in OF_LOOPS]
    loop = None if source.loop is None else Loop.of(source.loop, kind, loop_parts, source.phases)
    return replace(subject, loop=loop, sections=int(options.sections))


def _further_files(contents: Contents, target: str, vectors: Sequence[Vectors]) -> dict[str, str]:
    """Tests, examples, and what builds and finds the library."""
    prefix = contents.subject.prefix
    files = {
        "tests/vectors.h": vectors_source(contents, vectors),
        "tests/check.c": check_source(contents, vectors),
        f"examples/python/{prefix}.py": python_binding(contents),
        f"{prefix}.pc.in": contents.fill("pkgconfig.pc.in"),
        **{name: contents.fill(name) for name in _AS_THEY_ARE},
        **example_files(contents, target),
    }
    return files | (wasm_files(contents) if target == "wasm" else {})


_AS_THEY_ARE = (
    *(f"tests/{name}" for name in ("main.c", "fuzz.c", "threads.c")),
    *(f"cmake/{name}" for name in ("config.cmake.in", "cortex-m4f.cmake", "cortex-m7.cmake")),
    *("CMakeLists.txt", "LICENSE"),
)


def contents_of(
    subject: Subject, names: Sequence[str], title: str, what: str = "a planar continuum finger"
) -> Contents:
    """Parts by their names, with what their templates have in common."""
    # What is too large is refused before the spectral radius is looked for, which step needs.
    made = {name: PARTS[name](subject) for name in sorted(names, key=lambda name: name == "step")}
    match = re.match(r"\d+(\.\d+)*", __version__)
    prefix = subject.prefix
    number = match[0] if match else "0"
    single = subject.real.name == "float"
    contents = Contents(subject, [made[name] for name in names], {})
    paths = [path for path in contents.sources if path.startswith("src/") and path.endswith(".c")]
    sources = [prefix, f"{prefix}_kernels", *(path.removeprefix("src/").removesuffix(".c") for path in paths)]
    contents.words.update(
        {
            "p": prefix,
            "version": __version__,
            "number": number,
            "real": subject.real.name,
            "title": title,
            "what": what,
            "sources": " ".join(sources),
            "count": str(len(contents.calls) + len(contents.stateful)),
            **dict.fromkeys(SIZES, UNKNOWN),
            # Of fast builds: -ffast-math reorders sums, and rounding adds up along the calls of an episode.
            "adds_up": "10" if single else "1000",
            "tolerance": "2e-3" if single else "1e-11",
        }
    )
    contents.words["abi"] = abi_of(contents)
    return contents
