"""The equations of a grasp problem: from its expressions, or from a library that was compiled on request.

Expressions and derivatives take 0.1 to 0.3 s, a compiled library of them some milliseconds. It is compiled where
optimized code is asked for, at ``-O0`` and without fused operations, so that a grasp is the same to the last bit.
Compiling takes 2 s of four elements; with ``-O1`` it would take 8 s, for a Jacobian of 60 in place of 80 us.
"""

from __future__ import annotations

import ctypes
import json
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path

import casadi as ca

from continuum_grasp import __version__
from continuum_grasp.core import Cache, CodeKind, CompileError, Compiler, CSource
from continuum_grasp.grasp.problem.blocks import rotation
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.problem.unit_finger import BACKBONE_POINTS, UnitFinger
from continuum_grasp.grasp.problem.unknowns import Layout, Touch
from continuum_grasp.nlp import NLP

KIND = "grasps"
"""Folder of the cache."""
_LIBRARIES = Cache(KIND)
_CODE = ("grasp/problem", "model", "nlp", "scene")
"""Packages whose code decides on the equations."""
_FLAGS = ("-std=gnu11", "-O0", "-ffp-contract=off", "-fPIC", "-w")
_VALUES = ("nlp_f", "nlp_g", "values", "places")
_DERIVATIVES = {"grad_f": "nlp_grad_f", "jac_g": "nlp_jac_g", "hess_lag": "nlp_hess_l", "slope": "nlp_slope"}
"""Names of a library's functions."""


@dataclass(frozen=True, eq=False)
class GraspEquations:
    """Equations of a problem for a solver run."""

    layout: Layout
    nlp: NLP
    read: ca.Function  # what a result stores
    places: ca.Function  # what a look at the surroundings needs


def equations(spec: ProblemSpec) -> GraspEquations:
    """The equations of a structure, from its library where that is in the cache, or where all code is optimized."""
    compiler = Compiler.find()
    if compiler is not None:
        if CodeKind.forced() is CodeKind.OPTIMIZED:
            compile_equations([spec])
        library = _LIBRARIES.known(_identity(spec, compiler))
        if library is not None:
            with suppress(OSError, RuntimeError):  # of another C library, say
                return _loaded(spec, library)
    return _built(spec)


@lru_cache(maxsize=24)
def expressions(spec: ProblemSpec) -> GraspProblem:
    """The expressions of a structure; built once in a process."""
    return GraspProblem(spec)


def _built(spec: ProblemSpec) -> GraspEquations:
    problem = expressions(spec)
    x, numbers = problem.x.symbol, problem.numbers.symbol
    nlp = NLP("grasp", x, problem.objective, problem.rows.g, numbers)
    return GraspEquations(Layout.of(spec, described(problem)), nlp, point_reader(problem), places_reader(problem))


def _loaded(spec: ProblemSpec, library: Path) -> GraspEquations:
    text = ctypes.CDLL(str(library)).layout
    text.restype = ctypes.c_char_p
    layout = Layout.of(spec, text().decode())
    x, p = ca.MX.sym("x", layout.x.size), ca.MX.sym("p", layout.numbers.size)
    f, g, read, places = (ca.external(name, str(library)) for name in _VALUES)
    derivatives = {key: ca.external(name, str(library)) for key, name in _DERIVATIVES.items()}
    return GraspEquations(layout, NLP("grasp", x, f(x, p), g(x, p), p, derivatives), read, places)


def _identity(spec: ProblemSpec, compiler: Compiler) -> str:
    versions = __version__, ca.CasadiMeta.version(), Cache.hash_of_code(*_CODE)
    return "\0".join((repr(spec), *versions, compiler.identity(" ".join(_FLAGS))))


# -- compiled libraries ------------------------------------------------------------------------------------------------


def compile_equations(specs: Iterable[ProblemSpec]) -> None:
    """Compile structures into the cache, unless another process does so or there is no compiler."""
    compiler = Compiler.find()
    if compiler is None or not _LIBRARIES.lasts or _LIBRARIES.is_building:
        return
    with suppress(CompileError, OSError):
        for spec in specs:
            build = partial(_compiled, spec, compiler)
            _LIBRARIES.entry(_identity(spec, compiler), build, compiler.version)
    # 100: libraries that are stored, those used last: 2 MB each with four elements
    _LIBRARIES.forget_oldest(100)


def _compiled(spec: ProblemSpec, compiler: Compiler, work: Path) -> Path:
    """Write and compile the equations of a structure and its layout, in a folder."""
    made = _built(spec)
    text = described(expressions(spec))
    parts = [made.nlp.values.factory(f"nlp_{name}", ["x", "p"], [name]) for name in ("f", "g")]
    source = CSource([*parts, made.read, made.places, *made.nlp.functions.values(), made.nlp.slope]).externals()
    code, library = work / "code.c", work / "code.so"
    code.write_text(f"{source}\nconst char *layout(void) {{ return {json.dumps(text)}; }}\n", encoding="utf-8")
    compiler.run([*_FLAGS, "-shared", str(code), "-o", str(library), "-lm"])
    library.chmod(0o700)
    return library


# -- functions beside the NLP, and the layout --------------------------------------------------------------------------


def described(problem: GraspProblem) -> str:
    """The layout of a problem as JSON."""
    rows = [
        (block.name, block.key, block.unit, len(block.rows), float(block.lower[0, 0]), float(block.upper[0, 0]))
        for block in problem.rows.blocks
    ]
    guarded = []
    for finger in problem.fingers:
        _, elements, touches, _ = finger.guarded
        guarded.append((elements[: _unprobed(finger)], touches))
    return json.dumps([problem.x.sizes, problem.numbers.sizes, rows, guarded])


def _unprobed(finger: UnitFinger) -> int:
    """Number of guarded places that follow from the unknowns: probes are where a look puts them."""
    points, *_ = finger.guarded
    return int(points.shape[1]) - finger.spec.probes * finger.spec.elements


def places_reader(problem: GraspProblem) -> ca.Function:
    """Function of what a look at the surroundings needs, in units of the problem, from unknowns and run-time
    numbers.
    """
    out: list[ca.SX] = [problem.pose]
    for k, finger in enumerate(problem.fingers):
        points, _, _, half = finger.guarded
        count = _unprobed(finger)
        contacts = [contact for contact in problem.contacts if contact.spec.finger == k]
        contacts.sort(key=lambda contact: finger.end_of(contact.spec))
        touched = ca.horzcat(ca.SX(2, 0), *(contact.local.point for contact in contacts))
        out += [touched, points[:, :count], half[:count], finger.curvatures()[1], *finger.stored()]
    return ca.Function("places", [problem.x.symbol, problem.numbers.symbol], out)


def point_reader(problem: GraspProblem) -> ca.Function:
    """Function of what a result stores, in units of the problem, from unknowns and run-time numbers."""
    x = problem.x.symbol
    numbers = problem.numbers.symbol
    touched = problem.contacts

    def station(contact: Touch) -> ca.SX:
        spec = contact.spec
        if spec.finger < 0 or spec.joint < 0:
            return ca.SX(0 if spec.finger < 0 else 1)
        return problem.fingers[spec.finger].joints[spec.joint]

    touch: list[ca.SX] = [
        problem.pose,
        ca.horzcat(ca.SX(2, 0), *(c.point for c in touched)),
        ca.horzcat(ca.SX(2, 0), *(c.normal for c in touched)),
        ca.horzcat(ca.SX(3, 0), *(c.force for c in touched)),
        ca.vertcat(*(station(c) for c in touched)),
    ]
    outputs = [*touch]
    for finger in problem.fingers:
        outputs += [*finger.stored(), finger.q, finger.u, finger.p, finger.number("length")]
    read = ca.Function("read", [x, numbers], outputs)
    mx, mp = ca.MX.sym("x", x.numel()), ca.MX.sym("p", numbers.numel())
    values = iter(read(mx, mp))
    stored = list(islice(values, len(touch)))
    for finger in problem.fingers:
        *given, base, q, u, p, length = islice(values, 9)
        line = finger.shared.line(q, u, p)
        points = length * rotation(base[2]) @ line[1:3, :] + ca.repmat(base[:2], 1, BACKBONE_POINTS)
        stored += [*given, base, ca.vertcat(line[0, :], points, line[3, :] + base[2])]
    return ca.Function("values", [mx, mp], stored)
