"""C of functions that call straight-line functions one after the other.

Straight-line code is fast, and long where a function is evaluated several times: one step of an integrator with its
derivatives evaluates the dynamics four times. As an MX function of calls, it is written and compiled once.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping

import casadi as ca

from continuum_grasp.base import InputError


def straight_function(name: str, given: Mapping[str, ca.SX], found: Mapping[str, ca.SX]) -> ca.Function:
    """Return an SX function of named inputs and outputs that computes common parts once."""
    return ca.Function(name, [*given.values()], ca.cse([*found.values()]), [*given], [*found])


def call(function: ca.Function, *given: ca.MX) -> list[ca.MX]:
    """Results of a call that stays a call."""
    results: list[ca.MX] = function.call([*given], False, True)
    return results


_CALLS_ONLY = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_CALL}
_SUMS = {ca.OP_ADD}
"""Operations other than calls in derivatives, which add up contributions of several calls."""


def straight_functions(functions: Iterable[ca.Function]) -> list[ca.Function]:
    """Return all SX functions among functions and their calls, each once; InputError if one computes more than sums."""
    straight: dict[str, ca.Function] = {}
    for function in functions:
        if function.is_a("SXFunction"):
            straight.setdefault(function.name(), function)
            continue
        operations = range(function.n_instructions())
        if not function.is_a("MXFunction") or {function.instruction_id(k) for k in operations} - _CALLS_ONLY - _SUMS:
            raise InputError(f"{function.name()}: expected a straight-line SX function, or calls of such functions")
        for k in operations:
            if function.instruction_id(k) == ca.OP_CALL:
                called = function.instruction_MX(k).which_function()
                straight |= {f.name(): f for f in straight_functions([called])}
    return list(straight.values())


def calls_source(function: ca.Function, kind: str, real: Callable[[float], str], suffix: str = "") -> str:
    """Write C of ``static int NAME(const KIND *const arg[], KIND *const res[])`` from an MX function of calls and sums.

    ``suffix`` follows the names of the function and of its called functions, which have the same arguments; they
    compute no results after the first one that is null. ``real`` writes a constant of type ``kind``. No pointer in
    ``arg`` and ``res`` is null, and no two arrays overlap.
    """
    # Places of CasADi's work vector, which are used again: each holds what was written to it last.
    values: dict[int, str] = {}
    sizes: dict[str, int] = {}
    lines: list[str] = []
    results = _results(function)
    for k in range(function.n_instructions()):
        operation, places = function.instruction_id(k), function.instruction_output(k)
        if operation == ca.OP_INPUT:
            values[places[0]] = f"arg[{function.instruction_input(k)[0]}]"
        elif operation == ca.OP_CONST:
            numbers = ", ".join(map(real, function.instruction_MX(k).to_DM().nonzeros()))
            if numbers:  # C has no empty arrays
                lines.append(f"  const {kind} c{k}[] = {{{numbers}}};")
            values[places[0]] = f"c{k}" if numbers else "0"
        elif operation in _SUMS:
            expression = function.instruction_MX(k)
            if any(expression.dep(j).sparsity() != expression.sparsity() for j in range(2)):
                raise InputError(f"{function.name()}: expected sums of equal sparsity")
            first, second = (values[place] for place in function.instruction_input(k))
            name = results.get((k, 0), f"w{places[0]}")
            if (k, 0) not in results:
                sizes[name] = max(sizes.get(name, 1), expression.nnz())
            lines.append(f"  for (int j = 0; j < {expression.nnz()}; ++j) ({name})[j] = ({first})[j] + ({second})[j];")
            values[places[0]] = name
        elif operation == ca.OP_CALL:
            called = function.instruction_MX(k).which_function()
            inputs = ", ".join(values[place] for place in function.instruction_input(k))
            outputs = []
            last = max(j for j, place in enumerate(places) if place >= 0)
            for j, place in enumerate(places):
                name = results.get((k, j), f"w{place}" if place >= 0 else f"unused{k}_{j}")
                if j > last:
                    name = "0"
                elif (k, j) not in results:
                    sizes[name] = max(sizes.get(name, 1), called.nnz_out(j))
                values[place] = name
                outputs.append(name)
            lines.append(f"  {{ const {kind} *const in[] = {{{inputs}}};")
            lines.append(f"    {kind} *const out[] = {{{', '.join(outputs)}}};")
            lines.append(f"    {called.name()}{suffix}(in, out); }}")
        elif operation == ca.OP_OUTPUT:
            # Arguments, constants, and results that occur twice.
            (place,), (k_out, *_) = function.instruction_input(k), function.instruction_output(k)
            if values[place] != f"res[{k_out}]" and (size := function.nnz_out(k_out)):
                copy = f"for (int j = 0; j < {size}; ++j) res[{k_out}][j] = ({values[place]})[j];"
                lines.append(f"  if (res[{k_out}]) {copy}")
    # All intermediate values are in one array.
    spots, at = {}, 0
    for name, size in sizes.items():
        spots[name] = f"w + {at}" if at else "w"
        at += size
    lines = [re.sub(r"\b(w|unused)\d+(_\d+)?\b", lambda match: spots[match.group()], line) for line in lines]
    # Analyzers do not see that it is written to through the arrays of pointers.
    work = [f"  {kind} w[{at}];", f"  w[0] = {real(0.0)};"] if at else []
    head = f"static int {function.name()}{suffix}(const {kind} *const arg[], {kind} *const res[])"
    return "\n".join([head, "{", *work, *lines, "  return 0;", "}", ""])


def _results(function: ca.Function) -> dict[tuple[int, int], str]:
    """Destination of each output of an instruction that is a result, by the numbers of both."""
    written: dict[int, tuple[int, int]] = {}
    destinations = dict[tuple[int, int], str]()
    for k in range(function.n_instructions()):
        if function.instruction_id(k) == ca.OP_OUTPUT:
            destinations.setdefault(
                written[function.instruction_input(k)[0]], f"res[{function.instruction_output(k)[0]}]"
            )
        else:
            written |= {place: (k, j) for j, place in enumerate(function.instruction_output(k))}
    return destinations
