"""The C compiler of this machine, and the translation units that it is given."""

from __future__ import annotations

import ctypes
import errno
import logging
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path

from continuum_grasp.base import ContinuumGraspError, InputError, install_line
from continuum_grasp.core.cache import Cache

# gnu11 for vector types, -w: generated C warns.
_COMMON = ("-std=gnu11", "-fPIC", "-w")
_NATIVE = "-march=native"
"""The widest lanes of this machine, which libraries do not leave."""
_USUAL = ("cc", "gcc", "clang")
_ZIG = ("-m", "ziglang", "cc", "-fno-sanitize=undefined")
"""Clang of the extra ``compiler``, as arguments of Python; Zig would have it check for undefined behavior, which takes
time and traps."""
LONG = 20_000
"""Greatest number of lines of a function for -O3; longer ones use -O1, with which gcc 12 needs 0.13 s per thousand
lines, 0.2 s with -O3 (measured on functions of 70,000 to 140,000 lines). In straight-line code, the gain over -O0 comes
from registers, which -O1 also uses."""
_LONG_LEVEL = ("-O1", "-fexpensive-optimizations")
"""Optimization level of longer functions: the second one has products and sums fused, 21,400 instead of 27,400
instructions of the slope of a mission's estimator, and takes no longer."""
_GCC = ("-fschedule-insns", "-fsched-pressure", "-flive-range-shrinkage")
"""Scheduling under register pressure: straight-line code gains about 7 %, compiling takes twice as long."""
_SHORT = 15_000
"""Greatest number of lines of a translation unit for which this pays."""
_SPILLS = ("--param", "lra-max-considered-reload-pseudos=50")
"""Registers that gcc looks at when it spills one [1], of usually 500: straight-line code of 24,000 lines takes 5.8
instead of 8.3 s, with as many instructions and the same time of a call (gcc 12)."""
_PER_LINE, _PER_LINE_QUICK = 0.25e-3, 0.03e-3
"""Expected seconds per line of a quick build and of other builds, for announcements (gcc 12, one core of an AMD EPYC:
the controller of ``configs/mpc/tip_steps.yaml``, 18,000 lines, takes 4.7 s, a plant of 75,000 lines 16 s)."""
_ANNOUNCED = 2.0
"""Least expected seconds of a compilation that is announced."""
_TIMEOUT = 1800.0
"""Most seconds that the compiler may take for a translation unit."""
_ASKING = 60.0
"""Greatest number of seconds for a compiler to report its version and its options."""


_LOG = logging.getLogger(__name__)


class CompileError(ContinuumGraspError, RuntimeError):
    """The compiler refused the source."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler with the flags for this machine."""

    command: tuple[str, ...]
    version: str
    machine: str

    @staticmethod
    def find() -> Compiler | None:
        """The compiler named by ``CC``, else the first of cc, gcc, clang, the extra ``compiler``; None: none works."""
        return next((compiler for _, compiler in _tried() if isinstance(compiler, Compiler)), None)

    @staticmethod
    def why_none() -> str:
        """Compilers that were tried, and why none of them works."""
        named = os.environ.get("CC")
        if named is None:
            tried = "; ".join(f"{command}: {why}" for command, why in _tried())
            return f"no C compiler found ({tried})"
        if not named.strip():
            return "no C compiler: CC is set and empty (unset it to have cc, gcc and clang tried)"
        why = "; ".join(str(why) for _, why in _tried())
        return f"no C compiler: CC={named}: {why} (nothing else is tried while CC is set)"

    @staticmethod
    def said_by(
        line: Sequence[str], folder: Path | None = None, seconds: float = _TIMEOUT
    ) -> subprocess.CompletedProcess[str]:
        """Run a program to its end and read its output in any encoding of the system's messages."""
        return subprocess.run(
            line, cwd=folder, capture_output=True, encoding="utf-8", errors="replace", timeout=seconds, check=False
        )

    def is_known(self, source: str, *, quick: bool | None = None) -> bool:
        """Whether the library of a C source is in the cache."""
        return self.known(source, quick=quick) is not None

    def known(self, source: str, *, quick: bool | None = None) -> Path | None:
        """The shared library of a C source in the cache; None if it is not there."""
        quick = quick_compile() if quick is None else quick
        return Cache().known(self.identity(source, quick=quick))

    def library(self, source: str, what: str = "code", *, quick: bool | None = None) -> Path:
        """The shared library of a C source, compiled unless it is in the cache; the log calls it ``what``.

        ``quick``: without optimizing long functions; by default as the environment asks.
        CompileError if the compiler refuses the source, OSError if no folder can be written or the disk is full.
        """
        is_quick = quick_compile() if quick is None else quick

        def build(work: Path) -> Path:
            code, built = work / "code.c", work / "code.so"
            code.write_text(source, encoding="utf-8")
            self.build(code, built, what, quick=is_quick)
            built.chmod(0o700)
            return built

        return Cache().entry(self.identity(source, quick=is_quick), build, self.version)

    @staticmethod
    def load(source: str, what: str, *, quick: bool | None = None) -> ctypes.CDLL:
        """Compile a C source, or find it in the cache, and load it; messages call it ``what``.

        ``quick`` is as in `library`. InputError without a compiler, and if compiling fails.
        """
        compiler = Compiler.find()
        if compiler is None:
            advice = f"; to install one: {install_line('compiler')}" if os.environ.get("CC") is None else ""
            raise InputError(f"{what} needs a C compiler: {Compiler.why_none()}{advice}")
        try:
            return ctypes.CDLL(str(compiler.library(source, what, quick=quick)))
        except (CompileError, OSError) as error:
            raise InputError(f"{what} needs a C compiler, and compiling failed: {error}") from error

    @staticmethod
    def portable_level(lines: int) -> str:
        """Return the optimization level for a source file with a number of lines; other machines also run its
        library.
        """
        if quick_compile():
            return "-O0"
        return "-O1" if lines > LONG else "-O2"

    def flags(self, unit: str, *, quick: bool = False) -> tuple[str, ...]:
        """Compiler flags for a translation unit.

        ``quick``: long functions are not optimized, which takes a tenth of the time.
        """
        common = (*_COMMON, *((_NATIVE,) if _takes(self.command, _NATIVE) else ()))
        if quick:
            # 300: lines of a unit's longest function up to which a quick build optimizes it, by -O1: what runs often is
            # short
            return (*common, "-O1" if longest_function(unit) <= 300 else "-O0")
        level = ("-O3",) if longest_function(unit) <= LONG else _LONG_LEVEL
        is_gcc = "clang" not in self.version.lower()
        of_gcc = (*_SPILLS, *(_GCC if unit.count("\n") <= _SHORT else ()))
        return (*common, *level, *(of_gcc if is_gcc else ()))

    def identity(self, source: str, *, quick: bool = False) -> str:
        """Everything that a compiled source depends on; this file decides on flags and translation units."""
        rules = f"quick {quick}", Path(__file__).read_text(encoding="utf-8")
        return "\0".join((*self.command, self.version, self.machine, *rules, source))

    def build(self, source: Path, library: Path, what: str = "code", *, quick: bool = False) -> None:
        """Compile a source file to a shared library, with long functions apart, on all processors.

        ``continuum_grasp`` logs the start and the end of long compilations.
        """
        units = translation_units(source.read_text(encoding="utf-8"), LONG, quick=quick)
        with _logged(what, units, quick):
            if len(units) == 1:
                self.run([*self.flags(units[0], quick=quick), "-shared", str(source), "-o", str(library), "-lm"])
            else:
                objects = [str(source.with_suffix(f".{k}.o")) for k in range(len(units))]
                with ThreadPoolExecutor(os.cpu_count()) as pool:
                    list(pool.map(partial(self._compile, quick=quick), units, objects))
                self.run(["-shared", *objects, "-o", str(library), "-lm"])
        if not library.exists():
            raise CompileError(f"{shlex.join(self.command)}: no library was written")

    def _compile(self, unit: str, to: str, *, quick: bool) -> None:
        file = Path(to).with_suffix(".c")
        file.write_text(unit, encoding="utf-8")
        self.run([*self.flags(unit, quick=quick), "-c", str(file), "-o", to])

    def run(self, arguments: Sequence[str], folder: Path | None = None) -> None:
        """Run the compiler, in a folder; CompileError if it fails, OSError where the disk is full."""
        try:
            done = Compiler.said_by([*self.command, *arguments], folder)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise CompileError(f"{shlex.join(self.command)}: {error}") from error
        if done.returncode != 0:
            # A full disk is no fault of the source: callers fall back after a CompileError, and report an OSError.
            if os.strerror(errno.ENOSPC) in done.stderr:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "the compiler's files")
            said = " | ".join(done.stderr.strip().splitlines()[:3]) or f"exit status {done.returncode}"
            raise CompileError(f"{shlex.join(self.command)}: {said}")


@contextmanager
def _logged(what: str, units: Sequence[str], quick: bool) -> Iterator[None]:
    """Log the compilation and about how long it takes, and afterwards how long it took."""
    lines = [unit.count("\n") for unit in units]
    per_line = _PER_LINE_QUICK if quick else _PER_LINE
    seconds = per_line * max(max(lines), sum(lines) / (os.cpu_count() or 1))
    level, start = logging.INFO if seconds > _ANNOUNCED else logging.DEBUG, time.monotonic()
    about = f"{float(f'{seconds:.1g}'):g}"
    _LOG.log(level, "compiling %s, about %s s the first time; cached afterwards", what, about)
    yield
    _LOG.log(level, "compiled %s in %.1f s", what, time.monotonic() - start)


def quick_compile() -> bool:
    """Whether compiling quickly matters more than fast code: ``CONTINUUM_GRASP_QUICK_COMPILE=1`` in the environment."""
    return os.environ.get("CONTINUUM_GRASP_QUICK_COMPILE", "0") not in ("", "0")


def _tried() -> Iterator[tuple[str, Compiler | str]]:
    """Yield each possible compiler command, with the compiler or the reason why it is none."""
    named = os.environ.get("CC")
    for line in _USUAL if named is None else (named,):
        try:
            command = tuple(split(line))
        except ValueError as error:
            yield line, f"cannot be read as a command ({error})"
            continue
        if command:
            path = shutil.which(command[0])
            yield line, _describe(command, path) if path else "no such program"
    if named is None and find_spec(_ZIG[1]) is not None:
        yield "ziglang", _describe((sys.executable, *_ZIG), sys.executable)


@cache
def _describe(command: tuple[str, ...], path: str) -> Compiler | str:
    line = [*command, "--version"]
    asked = shlex.join(line)
    try:
        done = Compiler.said_by(line, seconds=_ASKING)
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        return " ".join(f"{asked}: {error}".split())
    if done.returncode != 0 or not done.stdout:
        said = " ".join(done.stderr.split())[:200]
        return f"{asked} exits with {done.returncode}" + (f", says {said!r}" if said else " and says nothing")
    return Compiler((path, *command[1:]), done.stdout.splitlines()[0], _machine())


@cache
def _takes(command: tuple[str, ...], flag: str) -> bool:
    """Whether the compiler takes a flag: clang before 15 refuses ``-march=native`` on Apple's processors."""
    with suppress(OSError, subprocess.TimeoutExpired):
        line = [*command, flag, "-fsyntax-only", "-x", "c", os.devnull]
        return Compiler.said_by(line, seconds=_ASKING).returncode == 0
    return False


def split(line: str) -> list[str]:
    """The words of a command; on Windows a backslash is part of a path."""
    if os.name != "nt":
        return shlex.split(line)
    return [word.strip("\"'") for word in shlex.split(line, posix=False)]


@cache
def _machine() -> str:
    """Processor and system; code for one machine must not be run on another that shares the cache."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    wanted = ("model name", "flags", "Features", "CPU part")
    seen = sorted({line for line in lines if line.split(":")[0].strip() in wanted})
    return "\n".join([platform.system(), platform.machine(), platform.processor(), *seen])


# Generated C: a function ends with a brace in the first column, or is one short line.
_END = re.compile(r"(?<=\n\}\n)")
_HEAD = re.compile(r"^(static )?(?:inline )?(\w[\w ]*?[ *]\w+\([^;{}#]*\))\s*\{\n", re.MULTILINE)
_SHORT_EXPORTED = re.compile(r"^(?!static )(\w[\w ]*?[ *]\w+\([^;{}#\n]*\)) *\{.*\}$", re.MULTILINE)
# A static function of a unit of its own is called from the others, and still not from outside of the library.
_HIDDEN = '__attribute__((visibility("hidden"))) '
# Lines of CasADi's straight-line code: a variable of its work vector, its assignment, declarations, a result.
_VARIABLE = re.compile(r"\ba\d+\b")
_ASSIGNMENT = re.compile(r"  (a\d+)=(.*;)")
_DECLARATION = re.compile(r"  casadi_real a\d+(, a\d+)*;")
_RESULT = re.compile(r"  if \(res\[\d+\]!=0\) res\[\d+\]\[\d+\]=.*;|  if \(!res\[\d+\]\) return 0;|  return 0;")


def longest_function(source: str) -> int:
    return max(function.count("\n") for function in _END.split(source))


def translation_units(source: str, limit: int, *, quick: bool = False) -> list[str]:
    """Split a source into units that are compiled separately and linked; functions above ``limit`` lines are apart.

    The source is one unit in the form of this package's generators: a function ends with a brace in the first column,
    and variables outside of functions are constants. The first resulting unit has declarations instead of the long
    functions; each other unit has one long function with the text before it. The units export the names of the source.
    """
    units, whole, before = [], "", ""
    for piece in _END.split(source):
        heads = list(_HEAD.finditer(piece))
        if not heads:
            whole += piece
            continue
        head = heads[-1]
        lead, is_static, signature = piece[: head.start()], head[1], head[2]
        before += _SHORT_EXPORTED.sub(r"\1;", lead)
        if piece.count("\n") <= limit:
            whole += piece
            # Each unit defines short static functions again, so that the compiler can inline them.
            before += piece[head.start() :] if is_static else f"{signature};\n"
            continue
        declared = f"{_HIDDEN if is_static else ''}{signature}"
        body = piece[head.end() :]
        units.append(f"{before}{declared}\n{{\n{body if quick else _single_assignment(body)}")
        whole += f"{lead}{declared};\n"
        before += f"{declared};\n"
    return [whole, *units]


def _single_assignment(body: str) -> str:
    """Give CasADi's straight-line code a variable per assignment; other code stays.

    CasADi reuses variables, so clang's SROA needs time with the square of the length: more than a minute for 70,000
    lines, instead of 4 s.
    """
    lines, names, count = [], dict[str, str](), 0
    for line in body.split("\n")[:-2]:
        used = _VARIABLE.sub(lambda match: names.get(match[0], match[0]), line)
        if assigned := _ASSIGNMENT.fullmatch(line):
            count += 1
            names[assigned[1]] = f"v{count}"
            used = f"  const casadi_real v{count}={used.partition('=')[2]}"
        elif _DECLARATION.fullmatch(line):
            continue
        elif not _RESULT.fullmatch(line):
            return body
        lines.append(used)
    return "\n".join([*lines, "}", ""])
