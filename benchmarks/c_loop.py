"""A C loop around a function that CasADi generated, as a contestant."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Timing, race
from benchmarks.machine import CFLAGS, compiler, one_core

STATES = 1024
"""Different arguments that a loop goes through; a power of two."""

_SOURCE = """
#include <string.h>
int {name}(const double** arg, double** res, long long int* iw, double* w, int mem);
static const double* arg[{arg}];
static double* res[{res}];
static long long int iw[{iw}];
static double w[{w}];
static double out[{out}];
/* too little to change a state, but the next evaluation has to wait for it */
static const double tiny = 1e-200;

double loop(const double* const* in, double* x, long long int count) {{
  double sum = 0.0;
  for (long long int k = 0; k < count; ++k) {{
    const long long int j = k & {mask};
    {set_arguments}
    {set_results}
    {name}(arg, res, iw, w, 0);
    {use}
  }}
  return sum;
}}
"""


class CLoop:
    """A compiled loop around one function; call it with the number of evaluations.

    The function is compiled on its own and linked to the loop without optimization across them, so the
    compiler cannot hoist, merge or leave out evaluations. Every evaluation reads other arguments (``STATES``
    of them, in turn) and all its results are summed.

    Parameters
    ----------
    function : casadi.Function
        Dense inputs and outputs. Calls in it are generated with it.
    inputs : sequence of numpy.ndarray
        Per input, (STATES, entries), or anything for an empty input.
    dependent : bool
        Let every evaluation wait for the one before, as in a simulation. Without it the processor works on
        several at once, and a short function looks faster than it will be in use.
    feedback : bool
        Feed the first output back as first input: a simulation. It starts from ``inputs[0][0]`` at every
        call, and again after every ``restart`` evaluations.
    restart : int, optional
        Evaluations from one start to the next.
    flags : sequence of str
        Compiler flags.
    """

    def __init__(
        self,
        function: Any,
        inputs: Sequence[Any],
        *,
        dependent: bool = True,
        feedback: bool = False,
        restart: int = 0,
        flags: Sequence[str] = CFLAGS,
    ) -> None:
        sizes = [function.nnz_in(i) for i in range(function.n_in())]
        self._inputs = [
            np.ascontiguousarray(np.broadcast_to(np.asarray(value, dtype=float), (STATES, size)))
            for value, size in zip(inputs, sizes, strict=True)
            if size
        ]
        if feedback and function.nnz_out(0) != sizes[0]:
            raise ValueError("feedback needs a first output as long as the first input")
        self._state = np.zeros(max(1, *sizes))
        self._folder = tempfile.TemporaryDirectory(prefix="continuum-grasp-benchmark-")
        source = _loop_source(function, sizes, dependent, feedback, restart)
        self._library = _build(function, source, Path(self._folder.name), flags)
        pointers = ctypes.POINTER(ctypes.c_double)
        self._loop = self._library.loop
        self._loop.restype = ctypes.c_double
        self._loop.argtypes = [ctypes.POINTER(pointers), pointers, ctypes.c_longlong]
        self._in = (pointers * max(1, len(self._inputs)))(*[a.ctypes.data_as(pointers) for a in self._inputs])
        self._x = self._state.ctypes.data_as(pointers)

    def __call__(self, count: int) -> float:
        """Evaluate so many times; the sum of all results."""
        return float(self._loop(self._in, self._x, count))


def time_c_loop(
    functions: Mapping[str, Any],
    inputs: Mapping[str, Sequence[Any]] | Sequence[Any],
    *,
    repeats: int = 31,
    sample_seconds: float = 0.01,
    seed: int = 0,
    dependent: bool = True,
    flags: Sequence[str] = CFLAGS,
) -> dict[str, Timing]:
    """Time one evaluation of generated functions in C, double, on one core, side by side.

    Parameters
    ----------
    functions : mapping of str to casadi.Function
        By name.
    inputs : sequence of arrays, or mapping of str to such
        Arguments as for `CLoop`; the same for all, or by name.
    repeats, sample_seconds, seed
        As for `race`.
    dependent, flags
        As for `CLoop`.

    Returns
    -------
    dict of str to Timing
        1e9 * ``median`` are nanoseconds per evaluation.
    """
    loops = {
        name: CLoop(f, inputs[name] if isinstance(inputs, Mapping) else inputs, dependent=dependent, flags=flags)
        for name, f in functions.items()
    }
    with one_core():
        return race(loops, repeats=repeats, sample_seconds=sample_seconds, seed=seed)


def _build(function: Any, source: str, folder: Path, flags: Sequence[str]) -> ctypes.CDLL:
    import casadi as ca

    generator = ca.CodeGenerator("function.c", {"casadi_int": "long long int", "with_header": False})
    generator.add(function)
    generator.generate(f"{folder}/")
    (folder / "loop.c").write_text(source, encoding="ascii")
    for name in ("function", "loop"):
        _run([compiler(), *flags, "-c", f"{folder}/{name}.c", "-o", f"{folder}/{name}.o"])
    library = folder / "loop.so"
    objects = [f"{folder}/function.o", f"{folder}/loop.o"]
    _run([compiler(), "-shared", "-Wl,-Bsymbolic", *objects, "-o", str(library), "-lm"])
    return ctypes.CDLL(str(library))


def _loop_source(function: Any, sizes: Sequence[int], dependent: bool, feedback: bool, restart: int) -> str:
    given = [i for i, size in enumerate(sizes) if size]
    arguments = [f"arg[{i}] = in[{k}] + j * {sizes[i]};" for k, i in enumerate(given)]
    counts = [function.nnz_out(i) for i in range(function.n_out())]
    starts = np.concatenate([[0], np.cumsum(counts)]).tolist()
    results = [f"res[{i}] = out + {starts[i]};" for i in range(len(counts))]
    use = [f"sum += {' + '.join(f'out[{i}]' for i in range(starts[-1]))};"]
    if feedback:
        begin = f"k % {restart} == 0" if restart else "k == 0"
        arguments[0] = f"if ({begin}) memcpy(x, in[0], sizeof(double) * {sizes[0]}); arg[0] = x;"
        use.append(f"memcpy(x, out, sizeof(double) * {sizes[0]});")
    elif dependent:
        first, last = given[0], starts[-1] - 1
        arguments.append(f"for (int i = 0; i < {sizes[first]}; ++i) x[i] = arg[{first}][i] + tiny * out[{last}];")
        arguments.append(f"arg[{first}] = x;")
    return _SOURCE.format(
        name=function.name(),
        arg=max(1, function.sz_arg()),
        res=max(1, function.sz_res()),
        iw=max(1, function.sz_iw()),
        w=max(1, function.sz_w()),
        out=max(1, starts[-1]),
        mask=STATES - 1,
        set_arguments="\n    ".join(arguments),
        set_results="\n    ".join(results),
        use="\n    ".join(use),
    )


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stderr[-3000:]}")
