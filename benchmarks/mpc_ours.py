"""The package's real-time iteration in the same closed loop, in C and from Python."""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np

from benchmarks.mpc_cases import Case
from benchmarks.mpc_loop import CLoop
from benchmarks.real_time_iteration import Settings
from continuum_grasp.control.rti.source import iteration_source

_HOOKS = """
static rti_plan plan;
static rti_work work;
static rti_settings settings;
static const unsigned char nominal[sizeof(rti_settings)] = {{{settings}}};
static double input[RTI_NU];
static const double *last_p, *last_refs;

void solver_start(const double *x0, const double *u0)
{{
  real x[RTI_NX], u[RTI_NU];
  for (int i = 0; i < RTI_NX; ++i) x[i] = (real)x0[i];
  for (int i = 0; i < RTI_NU; ++i) u[i] = (real)u0[i];
  memcpy(&settings, nominal, sizeof settings);
  rti_start(&plan, x, u);
}}
void solver_shift(void) {{ rti_shift(&plan, &settings, 1); }}
void solver_prepare(const double *p, const double *refs)
{{
  {convert}
  last_p = p;
  last_refs = refs;
  rti_prepare(&work, &plan, &settings, {p}, {refs});
}}
int solver_feedback(const double *x0)
{{
  rti_report report;
  real x[RTI_NX];
  for (int i = 0; i < RTI_NX; ++i) x[i] = (real)x0[i];
  int status = rti_feedback(&work, &plan, &settings, x, &report);
  for (int k = 1; k < {iterations} && status >= 0; ++k) {{
    solver_prepare(last_p, last_refs);
    status = rti_feedback(&work, &plan, &settings, x, &report);
  }}
  for (int i = 0; i < RTI_NU; ++i) input[i] = (double)plan.u[0][i];
  return status == RTI_ITERATION_LIMIT ? -100 : status;
}}
const double *solver_input(void) {{ return input; }}
void solver_plan(double *to)
{{
  for (int k = 0; k <= RTI_N; ++k)
    for (int i = 0; i < RTI_NX; ++i) *to++ = (double)plan.x[k][i];
  for (int k = 0; k < RTI_N; ++k)
    for (int i = 0; i < RTI_NU; ++i) *to++ = (double)plan.u[k][i];
}}
"""
_NARROW = """static real given_p[RTI_SIZE(RTI_NP)], given_refs[(RTI_N + 1) * RTI_SIZE(RTI_NR)];
  for (int i = 0; i < RTI_NP; ++i) given_p[i] = (real)p[i];
  for (int i = 0; i < (RTI_N + 1) * RTI_NR; ++i) given_refs[i] = (real)refs[i];"""


def rti_loop(case: Case, *, lanes: bool = True, real: str = "double", iterations: int = 1) -> CLoop:
    """The real-time iteration in a closed loop in C; a step that stops at its iteration limit counts as failed."""
    number: Any = np.float64 if real == "double" else np.float32
    settings = Settings(case.stages, number)
    data = ctypes.string_at(settings.address, settings.size)
    narrow = real != "double"
    hooks = _HOOKS.format(
        settings=", ".join(map(str, data)),
        iterations=iterations,
        convert=_NARROW if narrow else "",
        p="given_p" if narrow else "p",
        refs="given_refs" if narrow else "refs",
    )
    primal = math.inf if iterations > 1 else 1e-3 if narrow else 1e-6  # of one problem, linearized at the guess
    return CLoop(case, iteration_source(case.stages, real=real, lanes=lanes) + hooks, primal=primal)
