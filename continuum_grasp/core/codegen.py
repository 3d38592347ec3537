"""C source of a model for use elsewhere, with an example that calls it."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.core.checks import model_of, whole
from continuum_grasp.core.core import Core
from continuum_grasp.core.integrators import step_function
from continuum_grasp.core.rollouts import row
from continuum_grasp.errors import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.model.finger_model import FUNCTIONS

__all__ = ["codegen"]

_TAKEN = {"main", "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum"}
_TAKEN |= {"extern", "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short"}
_TAKEN |= {"signed", "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile"}
_TAKEN |= {"while"}
"""Words that cannot be the prefix: C's own, and the name of the example."""
_CONSTANT_MOMENT = """\
 *
 * The tip moment must not change during a motion: this model (matched_clothoid without input rates) takes it to be
 * constant. For inputs that vary take family clothoid, tendons.time_constant, or a model with input rates.
"""


def codegen(
    model: FingerModel,
    folder: str | Path,
    *,
    x0: ArrayLike | None = None,
    u: ArrayLike | None = None,
    w: ArrayLike | None = None,
    steps: int = 1000,
    prefix: str = "finger",
) -> list[Path]:
    """Write a model as C: source, header, and an example.

    The example integrates one second and prints the tip; it is compiled by
    ``cc -O3 main.c finger.c -lm -o finger`` and says what it should print.

    Parameters
    ----------
    model : FingerModel
        The model.
    folder : path-like
        Folder for the files; made where missing, files of the same names are replaced.
    x0, u, w : array_like, optional
        Initial state, input and forces of the example; zero where not given.
    steps : int
        Steps of the example; a stiff finger needs more to stay finite.
    prefix : str
        Name of the files and prefix of the functions, a C identifier.

    Returns
    -------
    list of pathlib.Path
        ``PREFIX.c``, ``PREFIX.h`` and ``main.c``.

    Raises
    ------
    InputError
        If the prefix is no identifier, a vector has the wrong size, or the folder holds something else.
    OSError
        If the files cannot be written.
    NumericalError
        If the example does not stay finite.
    """
    from continuum_grasp.results import begin_run, kind_of_run, replacing

    model_of(model)
    if kind_of_run(folder) not in (None, "codegen"):
        raise InputError(f"the folder holds a run of {kind_of_run(folder)}; take another one", file=str(folder))
    if not isinstance(prefix, str) or not prefix.isidentifier() or not prefix.isascii() or prefix in _TAKEN:
        raise InputError(f"prefix: expected a C identifier that is free, got {prefix!r}")
    steps = whole("steps", steps)
    start, inputs, forces = (
        _row(name, value, size) for name, value, size in (("x0", x0, model.nx), ("u", u, model.nu), ("w", w, model.nw))
    )
    step = step_function(model, "rk4")
    text = _example(model, prefix, step, steps, start, inputs, forces)
    options = {"with_header": True, "with_export": False, "static_aux": True, "with_mem": False}
    generator = ca.CodeGenerator(f"{prefix}.c", options)
    for name in FUNCTIONS:
        generator.add(_renamed(getattr(model, name), f"{prefix}_{name}"))
    generator.add(_renamed(step, f"{prefix}_rk4_step"))
    source, header = _generated(generator, prefix)
    target, files = begin_run(folder, "codegen", kept=None), []  # there may be another prefix
    for name, content in ((f"{prefix}.c", source), (f"{prefix}.h", header), ("main.c", text)):
        with replacing(target / name) as temporary:
            temporary.write_text(content)
        files.append(target / name)
    return files


def _generated(generator: ca.CodeGenerator, prefix: str) -> tuple[str, str]:
    """Source and header; CasADi writes them to files only, and says nothing where the disk is full.

    Raises
    ------
    OSError
        The files are not whole.
    """
    with tempfile.TemporaryDirectory() as folder:
        generator.generate(f"{folder}/")
        texts = [(Path(folder) / f"{prefix}.{suffix}").read_text() for suffix in ("c", "h")]
    if not all(text.endswith("#endif\n") for text in texts):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), folder)
    return texts[0], texts[1]


def _renamed(function: ca.Function, name: str) -> ca.Function:
    symbols: Any = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
    return ca.Function(name, symbols, function.call(symbols), function.name_in(), function.name_out())


def _row(name: str, value: ArrayLike | None, size: int) -> list[float]:
    return [float(v) for v in row(name, np.zeros(size) if value is None else value, size)]


def _example(
    model: FingerModel, prefix: str, step: ca.Function, steps: int, x0: list[float], u: list[float], w: list[float]
) -> str:
    core = Core(model)
    last = core.rollout(x0, steps, 1.0 / steps, u=u, w=w)[-1]
    tip = core.tip(last[: model.n], u)
    functions = "\n".join(
        f" *   {prefix}_{name}({', '.join(f.name_in())}) -> {', '.join(f.name_out())}"
        for name, f in ((name, getattr(model, name)) for name in FUNCTIONS)
    )
    call = "const double **arg, double **res, casadi_int *iw, double *w, int mem"
    return f"""\
/* One second of motion of the finger under constant input and forces, by the Runge-Kutta method of order 4.
 *
 *   cc -O3 main.c {prefix}.c -lm -o {prefix} && ./{prefix}
 *
 * Functions of {prefix}.c, each called as name({call});
 * arg[i] points to input i, res[i] to output i (matrices by columns), a null input reads as zeros. Only the step may
 * need work space in iw and w (as below); mem is not used.
{functions}
 *   {prefix}_rk4_step({", ".join(step.name_in())}) -> {", ".join(step.name_out())}
 *
 * x: {_list(model.x_names)}
 * u: {_list(model.u_names)}
 * w: {_list(model.w_names)}
 * p: {_list(model.p_names)}
 * s: position along the finger [m], h: step [s]; model: {model.family}, elements of {_list(map(str, model.lengths))} m
{_CONSTANT_MOMENT if model.structure.moment_is_constant else ""} */
#include <stdio.h>
#include "{prefix}.h"

int main(void)
{{
  double x[{model.nx}] = {_braces(x0)};
  const double u[] = {_braces(u)}, w[] = {_braces(w)}, p[] = {_braces(model.p_nominal)};
  const double h = 1.0 / {steps};
  double next[{model.nx}], tip[2];
  casadi_int iw[{max(step.sz_iw(), 1)}];
  double work[{max(step.sz_w(), 1)}];
  for (int k = 0; k < {steps}; ++k) {{
    const double *arg[{max(step.sz_arg(), 9)}] = {{x, u, u, u, w, w, w, p, &h}};
    double *res[{max(step.sz_res(), 1)}] = {{next}};
    if ({prefix}_rk4_step(arg, res, iw, work, 0)) return 1;
    for (int i = 0; i < {model.nx}; ++i) x[i] = next[i];
  }}
  const double *arg[{max(model.tip.sz_arg(), 3)}] = {{x, u, p}};
  double *res[{max(model.tip.sz_res(), 1)}] = {{tip}};
  {prefix}_tip(arg, res, 0, 0, 0);
  printf("tip after %g s: %.12g %.12g m\\n", {steps} * h, tip[0], tip[1]);
  printf("expected:       {tip[0]:.12g} {tip[1]:.12g} m\\n");
  return 0;
}}
"""


def _list(names: Sequence[str] | map[str]) -> str:
    return ", ".join(names) or "none"


def _braces(values: Sequence[float]) -> str:
    return "{" + ", ".join(repr(float(v)) for v in values or [0.0]) + "}"
