"""C of expressions as loops: an SX function on vectors of lanes, for many states at once, and sweeps along the chain.

CasADi's own generator writes scalar code that compilers do not vectorize across calls. Lanes walk the same instructions
and write them for the vector types that gcc and clang share. A sweep is one loop over the links; it replaces CasADi's
loop, which copies the values between links.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np

from continuum_grasp.base import InputError
from continuum_grasp.core.precision import CReal
from continuum_grasp.model import Kernels

OPERATORS = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
}
"""C by operation, of scalars and vectors alike."""
_FORMS = OPERATORS | {ca.OP_INV: "(cg_real)1 / {0}"}
_NAMES = "sqrt exp fabs sin cos tanh fmin fmax pow log lt le eq ne and or not sign"
_CALLS = {getattr(ca, f"OP_{name.upper()}"): f"cg_{name}" for name in _NAMES.split()}
_CALLS |= {ca.OP_CONSTPOW: "cg_pow", ca.OP_IF_ELSE_ZERO: "cg_if"}
"""Functions of ``templates/lanes.h`` by operation."""


def lane_function(function: ca.Function, real: str = "double") -> str:
    """C of ``static void NAME_lanes(const cg_lanes *const in[], cg_lanes *const out[])`` from an SX function.

    From the first of ``out`` that is null on, nothing is computed. ``lane_prelude`` must stand before it. InputError
    where an operation has no vector code, or the type ``real`` (double or float) cannot hold a constant.
    """
    constant = CReal.KINDS[real]
    lines = [f"static void {function.name()}_lanes(const cg_lanes *const in[], cg_lanes *const out[])", "{"]
    left = [function.nnz_out(i) for i in range(function.n_out())]
    # CasADi's instructions name places of a work vector, each of which holds what was written to it last. Those in
    # ``constants`` hold scalars, which C's vector arithmetic spreads over the lanes, but function calls do not.
    values: dict[int, str] = {}
    constants: set[int] = set()
    shared, inverted = _shared_divisors(function), set[str]()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        arguments, results = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            value = values[arguments[0]]
            vector = f"(cg_lanes){{0}} + {value}" if arguments[0] in constants else value
            lines.append(f"  out[{results[0]}][{results[1]}] = {vector};")
            left[results[0]] -= 1
            if not any(left[: results[0] + 1]) and results[0] + 1 < len(left):
                lines.append(f"  if (!out[{results[0] + 1}]) return;")
            continue
        target = results[0]
        name = f"v{k}"
        if operation == ca.OP_CONST:
            values[target] = f"({constant.written(float(function.instruction_constant(k)))})"
            constants.add(target)
            continue
        if operation == ca.OP_INPUT:
            text = f"in[{arguments[0]}][{arguments[1]}]"
            constants.discard(target)
        else:
            operands = [values[a] for a in arguments]
            fixed = all(a in constants for a in arguments)
            if k in shared and arguments[1] not in constants:
                inverse = f"inverse_{operands[1]}"
                if inverse not in inverted:
                    lines.append(f"  const cg_lanes {inverse} = (cg_real)1 / {operands[1]};")
                    inverted.add(inverse)
                text = f"{operands[0]} * {inverse}"
            else:
                text = _expression(operation, operands, [a in constants for a in arguments])
            (constants.add if fixed else constants.discard)(target)
        lines.append(f"  const {'cg_real' if target in constants else 'cg_lanes'} {name} = {text};")
        values[target] = name
    return "\n".join([*lines, "}", ""])


def _shared_divisors(function: ca.Function) -> set[int]:
    """Divisions by what others divide by too, as numbers of instructions.

    One division of vectors takes as long as some ten products, and CasADi writes x (1 / y) as x / y.
    """
    holders: dict[int, int] = {}
    divisions: dict[int, list[int]] = {}
    for k in range(function.n_instructions()):
        operation, arguments = function.instruction_id(k), function.instruction_input(k)
        if operation == ca.OP_DIV:
            divisions.setdefault(holders[arguments[1]], []).append(k)
        if operation != ca.OP_OUTPUT:
            holders[function.instruction_output(k)[0]] = k
    return {k for same in divisions.values() if len(same) > 1 for k in same}


def _expression(operation: int, operands: list[str], fixed: list[bool]) -> str:
    if operation in _FORMS:
        return _FORMS[operation].format(*operands)
    if operation not in _CALLS:
        raise InputError(f"no vector code for CasADi operation {operation}")
    pairs = zip(operands, fixed, strict=True)
    return (
        f"{_CALLS[operation]}({', '.join(f'(cg_lanes){{0}} + {arg}' if is_fixed else arg for arg, is_fixed in pairs)})"
    )


_FUNCTION = re.compile(r"^/\* (\w+):\(.*\*/\nstatic int (\w+)\((.*)\) \{\n", re.MULTILINE)
_STATIC = re.compile(r"^/\* \w+:\([^\n]*\*/\nstatic int (casadi_f\d+)\(.*?^}\n", re.MULTILINE | re.DOTALL)
_NAME = re.compile(r"\bcasadi_f\d+\b")
_MACRO = re.compile(r"^#define .*\n", re.MULTILINE)
_PRELUDE = "/* lanes */\n"


def with_loops(source: str, fill: Callable[..., str], prelude: str) -> str:
    """Return CasADi's C with a loop instead of each sweep.

    ``fill`` comes from the templates; ``prelude`` has the code that lanes need.
    """
    kernels = dict[str, re.Match[str]]()
    for match in _FUNCTION.finditer(source):
        kernels.setdefault(match[1], match)  # equal kernels of several sweeps: the first stands before all of them
    # Backwards, so that earlier places do not move.
    for name, match in reversed(kernels.items()):
        made = Kernels.of_sweep(name)
        if made is None:
            continue
        symbols = {f.name(): kernels[f.name()][2] if f.name() in kernels else f.name() for f in made.functions}
        folded = "\n".join(_constant(f) for f in made.functions if f.name() not in kernels)
        end = source.index("\n}\n", match.end()) + 3
        head = source[match.start() : match.end()].rstrip("{\n").replace("* w,", "* work,")
        body = f"{_PRELUDE}{folded}{lane_function(made.outward)}\n{head}\n{fill('sweep.c', **_words(made, symbols))}\n"
        source = f"{source[: match.start()]}{body}{source[end:]}"
    return _used(source).replace(_PRELUDE, prelude, 1).replace(_PRELUDE, "") if _PRELUDE in source else source


def _constant(function: ca.Function) -> str:
    """C of a function that CasADi has left out of a source, since it does not depend on its inputs."""
    values = function.call([ca.DM.zeros(function.size_in(k)) for k in range(function.n_in())])
    entries = [(k, j, v) for k, value in enumerate(values) for j, v in enumerate(value.nonzeros())]
    lines = "".join(f"  res[{k}][{j}] = {v!r};\n" for k, j, v in entries)
    arguments = "const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem"
    return f"static int {function.name()}({arguments})\n{{\n{lines}  return 0;\n}}\n"


def _used(source: str) -> str:
    """The source without the functions of CasADi that nothing calls any more."""
    parts, rest, last = dict[str, str](), "", 0
    for match in _STATIC.finditer(source):
        parts[match[1]] = match[0]
        rest += source[last : match.start()]
        last = match.end()
    rest += source[last:]
    # A macro gives each of them a prefix.
    calls = {name: set(_NAME.findall(text)) & parts.keys() - {name} for name, text in parts.items()}
    used, reached = set[str](), set(_NAME.findall(_MACRO.sub("", rest))) & parts.keys()
    while reached:
        used |= reached
        reached = {called for name in reached for called in calls[name]} - used
    return _STATIC.sub(lambda match: match[0] if match[1] in used else "", source)


def _words(made: Kernels, symbols: Mapping[str, str]) -> dict[str, object]:
    head, carry, last, outward, _, _, inward, root, _ = made.functions
    sizes = {
        "drive": head.size1_out("drive"),
        "section_end": last.size1_out("end"),
        "lagging": head.size1_out("lagging"),
        "start": root.size1_out("start"),
        "spin": carry.size1_in("spin"),
        "p": outward.size1_in("p"),
        "shape": outward.size1_out("shape"),
        "body": outward.size1_out("body"),
        "gain": inward.size1_out("gain"),
        "force": inward.size1_in("force"),
        "row": made.rows.shape[1],
    }
    implicit, tip = outward.size1_in("part") > 0, head.size1_out("tip") > 0
    return {
        # Arrays have an entry at least.
        **{name: max(size, 1) for name, size in sizes.items()},
        **{f"{f.name().partition('_')[0]}_of": symbols[f.name()] for f in made.functions},
        "outward": outward.name(),
        "widest": max(outward.size1_in(k) for k in range(5)) or 1,
        "drives": sizes["drive"],
        "ps": sizes["p"],
        "rows": ",\n".join(f"{{{', '.join(map(repr, row))}}}" for row in np.asarray(made.rows).tolist() if row),
        "loaded": ", ".join(map(str, made.loaded)),
        "loads": len(made.loaded),
        "links": made.links,
        "local": made.local,
        "shared": made.shared,
        "stride": made.stride,
        "section": made.section,
        "n": made.unknowns,
        "lag": 2 * made.unknowns,
        "full": made.unknowns + tip,
        "tip": tip,
        "lagged": sizes["lagging"],
        "implicit": implicit,
        "row_of": "rows[k]" if made.rows.size else "0",
        "force_of": "force[k]" if made.loaded else "0",
    }
