"""C for many states at once: the instructions of an SX function on vectors of lanes.

CasADi's own generator writes scalar code that compilers do not vectorize across calls. This one walks the same
instructions and writes them for the vector types that gcc and clang share.
"""

from __future__ import annotations

import casadi as ca

from continuum_grasp.core.precision import literal
from continuum_grasp.errors import InputError

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
            values[target] = f"({literal(float(function.instruction_constant(k)), real)})"
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
