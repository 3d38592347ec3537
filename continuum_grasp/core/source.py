"""C source of the functions that the core calls: one function, a batch of states, or whole rollouts, in doubles.

Lanes and plain functions, which controllers use, compute in the type ``real``.
"""

from __future__ import annotations

import errno
import os
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca

from continuum_grasp.base import InputError
from continuum_grasp.core.background import Background
from continuum_grasp.core.calls import calls_source, straight_functions
from continuum_grasp.core.compiler import CompileError, Compiler
from continuum_grasp.core.lanes import lane_function, with_loops
from continuum_grasp.core.precision import CReal, single
from continuum_grasp.core.template import Template


def _fill(file: str, /, **words: object) -> str:
    return Template.of("core", file).filled(words)


@dataclass(frozen=True)
class CSource:
    """C of some functions, for one caller or another.

    Parameters
    ----------
    functions : sequence of casadi.Function
        Straight-line functions, or calls of such functions.
    real : {"double", "float"}
        Type of the numbers in ``plain`` and ``lanes``.
    """

    functions: Sequence[ca.Function]
    real: str = "double"

    @property
    def straight(self) -> list[ca.Function]:
        """Straight-line functions among the functions and their calls, each once.

        Raises
        ------
        InputError
            If one computes more than calls and sums.
        """
        return straight_functions(self.functions)

    def of_core(self, name: str) -> str:
        """CasADi's C, by the symbols of the core; ``name`` stands before the names of its own help functions."""
        # Lanes have the type of the source, which ``single`` may change.
        prelude = f"#ifndef CG_LANES\n{lane_prelude('casadi_real')}\n#endif\n"
        code = _with_static_help(str(_generator_of(name, self.functions, with_export=False).dump()))
        for function in self.functions:
            exported = rf"^((?:const )?\w+\*? ){function.name()}(?=\(|_\w+\()"
            code = re.sub(exported, rf"\g<1>{symbol_of(function)}", code, flags=re.MULTILINE)
        return with_loops(code, _fill, prelude)

    def externals(self) -> str:
        """CasADi's C, as ``casadi.external`` takes it from a library."""
        return _with_static_help(str(_generator_of("functions", self.functions).dump()))

    def loaded(self, what: str) -> list[ca.Function] | None:
        """Return the functions as compiled code, which the log calls ``what``; None if nothing can be compiled."""
        compiler = Compiler.find()
        if compiler is None:
            return None
        try:
            library = str(compiler.library(self.externals(), what))
        except (CompileError, OSError):
            return None
        return self._of(library)

    def loaded_or_begun(self, what: str) -> list[ca.Function] | None:
        """Return the functions as compiled code if the cache has it; else None, and a thread compiles it for later
        processes.
        """
        compiler = Compiler.find()
        if compiler is None:
            return None
        source = self.externals()
        library = compiler.known(source)
        if library is None:
            Background.compiles(compiler, source, what)
            return None
        return self._of(str(library))

    def _of(self, library: str) -> list[ca.Function]:
        return [ca.external(function.name(), library) for function in self.functions]

    def with_header(self, name: str) -> tuple[str, str]:
        """CasADi's C, and its header; OSError where the disk is full."""
        generator = _generator_of(name, self.functions, with_header=True, with_export=False)
        with tempfile.TemporaryDirectory() as folder:
            generator.generate(f"{folder}/")
            source, header = ((Path(folder) / f"{name}.{suffix}").read_text(encoding="utf-8") for suffix in ("c", "h"))
        # CasADi writes to files alone, and reports nothing where the disk is full.
        if not (source.endswith("#endif\n") and header.endswith("#endif\n")):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), folder)
        return _with_static_help(source), header

    def plain(self, name: str) -> str:
        """C of the functions and of nothing else that CasADi writes around them.

        Each is ``static int NAME(const casadi_real *const arg[], casadi_real *const res[])``. From the first result of
        a straight-line function that is null on, nothing is computed. ``name`` stands before the names of help
        functions.
        """
        code = CSource(self.straight).of_core(name)
        begin = _HELP_ENDS.split(code, 1)[0]
        arguments = "(const casadi_real *const arg[], casadi_real *const res[])"
        bodies = [f"static int {f}{arguments}\n{{{_until_null(body)}}}\n" for f, body in _STRAIGHT.findall(code)]
        code = "\n".join([begin, *bodies, *self.calls("casadi_real")])
        return single(code) if self.real == "float" else code

    def calls(self, kind: str) -> list[str]:
        """C on arrays of a type ``kind``, of those functions that are calls."""
        return [calls_source(f, kind, repr) for f in self._calling]

    def lanes(self, written: Mapping[str, str] | None = None) -> str:
        """C in vector lanes, ``NAME_lanes``; empty if a function has an operation that lanes do not have.

        ``written`` has the C of some, by their names.
        """
        try:
            texts = self.lane_bodies(written)
        except InputError:
            return ""
        return "\n".join(["#ifndef CG_LANES", lane_prelude(self.real), "#endif", *texts, ""])

    def lane_bodies(self, written: Mapping[str, str] | None = None) -> list[str]:
        """C in vector lanes, of each function alone; see ``lanes``.

        Raises
        ------
        InputError
            If an operation has no vector code, or ``real`` cannot hold a constant.
        """
        known = written or {}
        straight = [known.get(f.name()) or lane_function(f, self.real) for f in self.straight]
        return straight + [calls_source(f, "cg_lanes", self._lane, "_lanes") for f in self._calling]

    @property
    def _calling(self) -> list[ca.Function]:
        return [f for f in self.functions if not f.is_a("SXFunction")]

    def _lane(self, value: float) -> str:
        return f"(cg_lanes){{0}} + {CReal.KINDS[self.real].written(value)}"


def _sizes(function: ca.Function) -> tuple[list[int], list[int]]:
    """Sizes of inputs and outputs."""
    inputs = [function.nnz_in(k) for k in range(function.n_in())]
    return inputs, [function.nnz_out(k) for k in range(function.n_out())]


def symbol_of(function: ca.Function) -> str:
    """Symbol of a function in a library of the core.

    Its own name may be one of the C library, ``step`` or ``index``, which calls within the library would then reach, or
    of a header, ``exp``.
    """
    return f"cg_function_{function.name()}"


def _names(function: ca.Function) -> dict[str, object]:
    """Words about a function that the templates share: number, size, and size of the array of each argument, too."""
    inputs, outputs = ([(k, size, max(size, 1)) for k, size in enumerate(sizes)] for sizes in _sizes(function))
    return {
        "inputs": inputs,
        "outputs": outputs,
        "name": symbol_of(function),
        "lanes": f"{function.name()}_lanes",
        "vi": ", ".join(f"i{k}" for k in range(function.n_in())),
        "vo": ", ".join(f"o{k}" for k in range(function.n_out())),
        "sz_arg": function.sz_arg(),
        "sz_res": function.sz_res(),
    }


def _generator_of(name: str, functions: Iterable[ca.Function], **options: bool) -> ca.CodeGenerator:
    """CasADi's writer of C for functions."""
    generator = ca.CodeGenerator(f"{name}.c", {"with_mem": False, **options})
    for function in functions:
        generator.add(function)
    return generator


def _with_static_help(code: str) -> str:
    """CasADi's C whose help functions are static, so that several sources link; its own option is not in CasADi 3.7."""
    return _HELP.sub(r"static \g<0>", code)


_HELP = re.compile(r"^(?:void|casadi_int|casadi_real) casadi_\w+\(", re.MULTILINE)
"""Head of a help function."""


_STRAIGHT = re.compile(r"^/\* (\w+):[^\n]*\*/\nstatic int \w+\([^)]*\) \{(.*?)^\}\n", re.MULTILINE | re.DOTALL)
"""Name and body of a straight-line function in what CasADi writes."""


_HELP_ENDS = re.compile(r"^(?:/\* Configuration this file|static const casadi_int|/\* \w+:)", re.MULTILINE)
"""Head of what CasADi writes behind its help functions: the first from 3.8 on, sparsities, the first function."""


def _until_null(body: str) -> str:
    """A body that returns at a null result; CasADi writes the results one after the other."""
    lines = body.split("\n")
    last = {match[1]: k for k, line in enumerate(lines) if (match := _WRITTEN.search(line))}
    for result, k in last.items():
        if (following := str(int(result) + 1)) in last:
            lines[k] += f"\n  if (!res[{following}]) return 0;"
    return "\n".join(lines)


_WRITTEN = re.compile(r"if \(res\[(\d+)\]!=0\)")


def lane_prelude(real: str) -> str:
    """C that must stand before lane functions, whose lanes are ``real``: double or float."""
    # <tgmath.h>: sin and the like of the lanes' own type, so that float lanes do not go through double.
    return f"#include <tgmath.h>\ntypedef {real} cg_real;\n\n{Template.of('core', 'lanes.h').text}"


def _in_lanes(function: ca.Function) -> str:
    """A function on vectors of lanes, with what loads and stores them."""
    return f"{lane_prelude('double')}\n{Template.of('core', 'gather.c').text}\n{lane_function(function, 'double')}"


def _in_one_lane(function: ca.Function) -> str:
    """A function with loops, branches or calls of its own, which lanes cannot take together, as one of lanes of one."""
    inputs, outputs = _sizes(function)
    sizes: dict[str, object] = {"from": len(inputs), "to": len(outputs), "sizes": ", ".join(map(str, outputs))}
    sizes |= {"sz_w": max(function.sz_w(), 1), "sz_iw": max(function.sz_iw(), 1)}
    lane = _fill("one_lane.c", **_names(function), **sizes, gather=Template.of("core", "gather.c").text)
    return f"{CSource([function]).of_core(function.name())}\n{lane}"


def batch_source(function: ca.Function) -> str:
    """C of ``SYMBOL_batch(count, in, stride, out)`` over rows; a stride of zero repeats one row."""
    code = _in_lanes(function) if function.is_a("SXFunction") else _in_one_lane(function)
    return f"{code}\n{_fill('batch.c', **_names(function))}"


def scan_source(function: ca.Function) -> str:
    """Write C of ``SYMBOL_scan``: a recursion of many rows over steps, in lanes if it is a straight-line function.

    ``function`` is (carry, *signals) -> (next carry, *results); see ``Scan`` of ``core.batches``.
    """
    lanes = CSource([function]).lanes()
    code = f"{lanes}{Template.of('core', 'gather.c').text}" if lanes else _in_one_lane(function)
    return f"{code}\n{_fill('scan.c', **_names(function), carry=function.nnz_in(0))}"


def _step_words(step: ca.Function) -> dict[str, object]:
    """Words of a step's templates: sizes of x, u, w and p, and of their arrays, which in C have an entry at least."""
    nx, nu, nw, n_p = (step.nnz_in(k) for k in (0, 1, 4, 7))
    least = {"nu1": max(nu, 1), "nw1": max(nw, 1), "np1": max(n_p, 1)}
    return {**_names(step), "nx": nx, "nu": nu, "nw": nw, "np": n_p, **least}


def rollout_source(step: ca.Function) -> str:
    """C of ``SYMBOL_rollout``: many steps in one call.

    ``step`` has inputs x, u and w at the start, the middle and the end of the step, p and h, and the next x as output.
    Inputs are rows at half steps (a stride of zero repeats one row). Every ``sub``-th state is stored. The result is
    the number of stored states after the first; fewer than requested: the next one is not finite.
    ``SYMBOL_levels`` does the same with steps of several lengths: ``ratio`` times h, the longer ones stored at every
    ``every``-th instant only.
    """
    return f"{CSource([step]).of_core(step.name())}\n" + _fill("rollout.c", **_step_words(step))


def rollouts_source(step: ca.Function) -> str:
    """Write C of ``SYMBOL_rollouts``: many rollouts in one call, in vector lanes if the step is a straight-line
    function.

    As ``rollout_source``, with a stride per rollout (``ur``, ``wr``) in addition to the one per half step; ``valid``
    receives the result of each.
    """
    if not step.is_a("SXFunction"):  # has calls and branches of its own, which lanes cannot take together
        return f"{rollout_source(step)}\n" + _fill("rollouts.c", **_step_words(step))
    return f"{_in_lanes(step)}\n" + _fill("lane_rollouts.c", **_step_words(step))
