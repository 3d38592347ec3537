"""Writing functional mock-up units."""

from __future__ import annotations

import hashlib
import html
import json
import os
import platform
import re
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from continuum_grasp import __version__
from continuum_grasp.addons.fmu.controller import controller_unit
from continuum_grasp.addons.fmu.description import model_description
from continuum_grasp.addons.fmu.plant import finger_unit, loop_plant_unit
from continuum_grasp.addons.fmu.variable import UnitContents
from continuum_grasp.addons.mission import AssignedMission, MissionRun, MissionScene
from continuum_grasp.base import CheckedArgument, InputError, check_arguments, interruptible
from continuum_grasp.core import CompileError, Compiler, Template
from continuum_grasp.export import (
    Library,
    check_file,
    fill,
    prefix_of,
    title_of,
)
from continuum_grasp.results import replacing
from continuum_grasp.scene import Consumer, ControlScene, Scene, scene_of

WHAT = ("plant", "controller")
"""Parts of a closed loop that may be exported; of a simulated scene the first, of a mission the second."""
VERSIONS = ("2", "3")
_NO_LOOP = "a simulated scene has only a plant; a controller needs a closed loop or a mission"
_NO_PLANT = "a mission has only a controller; the verb mpc moves its plant"
_OWN = "is for a simulated scene: a closed loop has its own"
_MISSIONS = (MissionScene, AssignedMission, MissionRun)
_UNITS = (
    Consumer.beside("preview", lambda of: "controller" not in of[1], "is for a controller"),
    Consumer.beside("what=controller", lambda of: isinstance(of[0], Scene), _NO_LOOP),
    Consumer.beside("step ranges substeps", lambda of: not isinstance(of[0], Scene), _OWN),
    Consumer.beside("what=plant", lambda of: isinstance(of[0], _MISSIONS), _NO_PLANT),
    Consumer.beside("preview", lambda of: isinstance(of[0], _MISSIONS), "follows its phases"),
    Consumer.beside("finger", lambda of: not isinstance(of[0], _MISSIONS), "is for a mission"),
)
_DECLARED = re.compile(r"^(\w+)\(([^)]*)\)$", re.MULTILINE)
_ARGUMENT = re.compile(r"(?!instance\b)\b(\w+)(?:\[\])?(?:,|$)")
_FUNCTION = re.compile(r"^(FMI[23]\([^)]*\)\([^{;]*?\))\s*\{", re.MULTILINE)
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time of every file in an archive, so that equal scenes give equal archives."""


@dataclass(frozen=True)
class FunctionalMockupUnit:
    """A functional mock-up unit that was written.

    Attributes
    ----------
    file : pathlib.Path
    fmi : {"2", "3"}
        Version of the standard.
    what : {"plant", "controller"}
    step : float
        Internal step [s]: communication steps are whole multiples of it, or of a finger any length, in steps as long
        at most.
    inputs, outputs, parameters : tuple of str
        Names of its variables.
    binary : str or None
        Platform of the binary in it.
    """

    file: Path
    fmi: str
    what: str
    step: float
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    binary: str | None


@interruptible()
@check_arguments
def export_fmu(
    given: Scene | ControlScene | MissionScene | AssignedMission | MissionRun | str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    what: Sequence[str] | None = None,
    fmi: Sequence[str] = VERSIONS,
    name: str | None = None,
    step: float | None = None,
    substeps: int | None = None,
    ranges: Mapping[str, Sequence[float]] | None = None,
    preview: bool = False,
    finger: str | None = None,
    binary: bool = True,
) -> tuple[FunctionalMockupUnit, ...]:
    """Write a plant, or a controller with its estimator, as functional mock-up units for co-simulation.

    Parameters
    ----------
    given : Scene, ControlScene, AssignedMission, MissionRun or path of a configuration
        From a simulated scene it exports the finger, moved by the steps of its C package; from a closed loop the
        controller, and the plant that ``run_closed_loop`` moves; of a mission the controller with its phases.
    folder : path-like
        Target folder; units ``NAME_plant_fmi2.fmu`` and the like there are replaced, files that no export wrote are
        not.
    what : sequence of {"plant", "controller"}, optional
        Units to write of a closed loop; by default all.
    fmi : sequence of {"2", "3"}
        Versions of the standard: 2.0, 3.0.
    name : str, optional
        Name of files and symbols, a C identifier; by default the name of the file, or of the scene.
    step : float, optional
        Internal step of a simulated scene [s]; by default the scene's step.
    substeps : int, optional
        Runge-Kutta steps within one, of a simulated scene; as many as stable steps need by default.
    ranges : mapping, optional
        Least and greatest values of run-time parameters of a simulated scene, by name.
    preview : bool
        Whether the controller takes setpoints for every stage of its horizon, instead of one that holds over it.
    finger : str, optional
        Finger of a mission with several fingers; each has a unit of its own.
    binary : bool
        Whether to add the binary of this machine to the sources.

    Returns
    -------
    tuple of FunctionalMockupUnit

    Raises
    ------
    InputError
        If an argument is wrong, the scene cannot be exported, or no compiler is found.
    SolverError
        If no model keeps the scene's tolerance.

    Examples
    --------
    >>> import tempfile
    >>> import continuum_grasp as cg
    >>> unit, = cg.export_fmu("configs/simulate/tendon_step.yaml", tempfile.mkdtemp(), fmi=["3"], binary=False)
    >>> unit.file.name, unit.outputs[-4:]
    ('tendon_step_plant_fmi3.fmu', ('tip.x', 'tip.y', 'tip.angle', 'code'))
    """
    scene = scene_of(given, (Scene, ControlScene, *_MISSIONS))
    identifier = prefix_of(name) if name is not None else identifier_of(given, scene)
    options: dict[str, Any] = {"step": step, "substeps": substeps, "ranges": ranges}
    files = units_of(scene, folder, name=identifier, what=what, fmi=fmi, preview=preview, finger=finger, **options)
    makers: dict[str, Callable[..., UnitContents]] = {
        "plant": partial(finger_unit, **options) if isinstance(scene, Scene) else loop_plant_unit,
        "controller": partial(controller_unit, preview=preview, finger=finger),
    }
    units = {kind: makers[kind](scene, f"{identifier}_{kind}") for kind, _ in files}
    with tempfile.TemporaryDirectory() as work:
        return tuple(
            _written(units[kind], kind, version, file, binary, Path(work)) for (kind, version), file in files.items()
        )


def units_of(
    scene: Scene | ControlScene | MissionScene | AssignedMission | MissionRun,
    folder: str | os.PathLike[str],
    *,
    name: str,
    what: Sequence[str] | None = None,
    fmi: Sequence[str] = VERSIONS,
    preview: bool = False,
    finger: str | None = None,
    **options: Any,
) -> dict[tuple[str, str], Path]:
    """Files of the units of a scene by part and version; see ``export_fmu``.

    InputError where options do not fit the scene, and where a file is in the way that no export wrote.
    """
    identifier = prefix_of(name)
    versions = CheckedArgument("fmi", [fmi] if isinstance(fmi, str) else fmi).some_of(VERSIONS, "version")
    asked: Sequence[str]
    if what is not None:
        asked = [what] if isinstance(what, str) else what
    elif isinstance(scene, Scene):
        asked = WHAT[:1]
    elif isinstance(scene, _MISSIONS):
        asked = WHAT[1:]
    else:
        asked = WHAT
    kinds = CheckedArgument("what", asked).some_of(WHAT, "part")
    given_options: dict[str, Any] = {f"what={kind}": "what" for kind in kinds}
    given_options |= {key: bool(options.get(key)) for key in ("step", "ranges", "substeps")}
    given_options |= {"preview": preview, "finger": finger is not None}
    for feature in _UNITS:
        feature.check((scene, kinds), of=given_options)
    files = {(k, fmi): Path(folder) / f"{identifier}_{k}_fmi{fmi}.fmu" for k in WHAT if k in kinds for fmi in versions}
    for file in files.values():
        check_file(file, _is_unit)
    return files


def identifier_of(given: Any, scene: Any) -> str:
    """A C identifier of the name of a file, or of a scene."""
    title = Path(given).stem if isinstance(given, (str, os.PathLike)) else title_of(scene)
    text = re.sub(r"[^a-z0-9]+", "_", title.lower()).strip("_")
    return text if re.match(r"[a-z]", text) else f"finger_{text}".strip("_")


def _is_unit(file: Path) -> bool:
    """Whether a file is a functional mock-up unit of an export, or has no content."""
    if not zipfile.is_zipfile(file):
        return file.stat().st_size == 0
    with zipfile.ZipFile(file) as archive:
        return any(
            b"continuum_grasp" in archive.read(name) for name in archive.namelist() if name == "modelDescription.xml"
        )


def _written(unit: UnitContents, kind: str, fmi: str, file: Path, binary: bool, work: Path) -> FunctionalMockupUnit:
    files = _files(unit, fmi)
    platform_name = None
    content: dict[str, bytes] = {name: text.encode() for name, text in files.items()}
    if binary:
        platform_name, suffix = _platform(fmi)
        content[f"binaries/{platform_name}/{unit.identifier}{suffix}"] = _compiled(unit, files, suffix, work)
    with replacing(file) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(content, key=lambda name: (name != "modelDescription.xml", name)):
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, content[name])

    def named(*kinds: str) -> tuple[str, ...]:
        return tuple(v.name for v in (*unit.variables, *unit.counts) if v.kind in kinds)

    return FunctionalMockupUnit(
        file=file,
        fmi=fmi,
        what=kind,
        step=unit.step,
        inputs=named("input"),
        outputs=named("state", "output"),
        parameters=named("tunable", "fixed"),
        binary=platform_name,
    )


def _files(unit: UnitContents, fmi: str) -> dict[str, str]:
    """Everything but the binary, by its path in the archive."""
    source = _source(unit, fmi)
    digest = hashlib.sha256("".join([source, *unit.sources.values()]).encode()).hexdigest()
    token = f"{{{uuid.UUID(digest[:32])}}}"
    sources = {**unit.sources, f"fmi{fmi}.c": source.replace(_NO_TOKEN, token)}
    files = {f"sources/{name}": text for name, text in sources.items()}
    files["modelDescription.xml"] = model_description(unit, fmi, token)
    files["documentation/index.html"] = _page(unit)
    files["documentation/licenses/license.txt"] = fill("LICENSE", {"version": __version__})
    files["resources/MANIFEST.json"] = json.dumps(unit.manifest, indent=2, allow_nan=False) + "\n"
    if fmi == "3":
        names = sorted(name for name in sources if name.endswith(".c"))
        files["sources/buildDescription.xml"] = fill("fmu/build.xml", {"unit": unit, "sources": names})
    return files


_SPELLED: dict[str, dict[str, Any]] = {
    "2": {
        "handle": "fmi2Component",
        "state": "FMUstate",
        "from_bytes": "DeSerializeFMUstate",
        "counted": False,
        "accessors": (
            ("GetReal", "fmi2Real", "fmu_get"),
            ("SetReal", "const fmi2Real", "fmu_set"),
            ("GetInteger", "fmi2Integer", "fmu_get_counts"),
        ),
    },
    "3": {
        "handle": "fmi3Instance",
        "state": "FMUState",
        "from_bytes": "DeserializeFMUState",
        "counted": True,
        "accessors": (
            ("GetFloat64", "fmi3Float64", "fmu_get"),
            ("SetFloat64", "const fmi3Float64", "fmu_set"),
            ("GetInt32", "fmi3Int32", "fmu_get_counts"),
        ),
    },
}
"""Names of the standard by its version, and whether it counts values beside variables."""
_NO_TOKEN = "{00000000-0000-0000-0000-000000000000}"


def _source(unit: UnitContents, fmi: str) -> str:
    """C between the library and the standard, one file."""
    words: dict[str, object] = {
        "p": unit.identifier,
        "unit": unit,
        "fmi": f"{fmi}.0",
        "version": __version__,
        "step": repr(float(unit.step)),
        "token": _NO_TOKEN,
        "places": unit.places.items(),
        "reals": len(unit.variables),
        "counts": [count.name.rpartition(".")[2].upper() for count in unit.counts],
        **unit.words,
    }
    types, *glue = (fill(f"fmu/{name}", words) for name in unit.glue)
    texts = {"v": fmi, "linear": unit.linear, **_SPELLED[fmi]}
    parts = {name: fill(f"fmu/{name}.c", texts) for name in ("names", "shared")}
    words |= {**parts, "prototypes": "<<prototypes>>", "others": _rest(fmi)}
    standard = fill(f"fmu/fmi{fmi}.c", words)
    declared = "\n".join(f"{head};" for head in _FUNCTION.findall(standard))
    standard = Template(standard).filled({"prototypes": declared})
    return fill("fmu/common.c", {**words, "types": types, "glue": "".join(glue)}) + "\n" + standard


def _rest(fmi: str) -> str:
    """C of the functions that an FMU without events and clocks lacks: to read or write no variable is done,
    anything else is refused.
    """
    of = f"{_SPELLED[fmi]['handle']} instance, const fmi{fmi}ValueReference vr[], size_t n"
    declared = _DECLARED.findall(fill(f"fmu/rest{fmi}.txt", {}).replace("OF", of))
    heads = [(name, " ".join(text.split())) for name, text in declared]
    rows = [(name, head, _ARGUMENT.findall(head), head.startswith(of)) for name, head in heads]
    return fill("fmu/rest.c", {"v": fmi, "functions": rows})


def _platform(fmi: str) -> tuple[str, str]:
    """Name that a version of the standard gives this machine, and the suffix of its libraries."""
    system = {"linux": "linux", "darwin": "darwin", "win32": "windows"}.get(sys.platform, sys.platform)
    suffix = {"darwin": ".dylib", "windows": ".dll"}.get(system, ".so")
    machine = {"AMD64": "x86_64", "amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    if fmi == "3":
        return f"{machine}-{system}", suffix
    bits = 64 if sys.maxsize > 2**32 else 32
    # FMI 2.0 knows no other processors by name; its later editions take the names of 3.0.
    known = machine in ("x86_64", "i686", "i386") or system == "darwin"
    return f"{'win' if system == 'windows' else system}{bits}" if known else f"{machine}-{system}", suffix


def _compiled(unit: UnitContents, files: Mapping[str, str], suffix: str, work: Path) -> bytes:
    """The shared library of this machine; what versions of the standard have in common is compiled once in ``work``."""
    compiler = Compiler.find()
    if compiler is None:
        raise InputError(f"no C compiler for the binary: {Compiler.why_none()}; or leave the binary out", key="binary")
    flags = [flag for flag in Library.flags(compiler.version) if flag in unit.flags]
    sources = {Path(name).name: text for name, text in files.items() if name.startswith("sources/")}
    level = compiler.portable_level(max(text.count("\n") for text in sources.values()))
    flags += [level, "-w", "-fPIC", "-fvisibility=hidden"]
    folder = work / unit.identifier
    folder.mkdir(exist_ok=True)
    for name, text in sources.items():
        (folder / name).write_text(text, encoding="utf-8")
    stems = [name[:-2] for name in sorted(sources) if name.endswith(".c")]
    missing = [stem for stem in stems if not (folder / f"{stem}.o").exists()]
    try:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(lambda stem: compiler.run([*flags, "-c", f"{stem}.c"], folder), missing))
        compiler.run([*flags, "-shared", *(f"{stem}.o" for stem in stems), "-o", f"unit{suffix}", "-lm"], folder)
    except CompileError as error:
        raise InputError(f"the sources do not compile: {error}; or leave the binary out", key="binary") from error
    return (folder / f"unit{suffix}").read_bytes()


def _page(unit: UnitContents) -> str:
    rows = []
    for v in (*unit.variables, *unit.counts):
        span = [f"{end:g}" for end in (v.low, v.high) if abs(end) < 1e300]
        taken = " to ".join(span) if v.kind in ("input", "tunable", "fixed", "state") else ""
        rows.append(map(html.escape, (v.name, v.kind, v.unit, taken, v.text)))
    words = {"title": html.escape(unit.title), "what": html.escape(unit.what), "step": f"{unit.step:g}"}
    words["steps"] = "of any length" if unit.any_step else "are whole multiples of it"
    return fill("fmu/page.html", {**words, "version": __version__, "rows": rows})
