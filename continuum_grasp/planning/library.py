"""Terms as compiled code."""

from __future__ import annotations

import casadi as ca

from continuum_grasp.core.cache import library_for
from continuum_grasp.core.compiler import CompileError, find_compiler
from continuum_grasp.planning.term import Term

__all__ = ["compiled"]


def compiled(term: Term) -> Term:
    """The same term as compiled code, or the term itself where nothing can be compiled."""
    compiler = find_compiler()
    if compiler is None:
        return term
    generator = ca.CodeGenerator("term.c", {"with_mem": False, "static_aux": True})
    functions = (term.value, term.jacobian, term.hessian)
    for function in functions:
        generator.add(function)
    try:
        library = str(library_for(generator.dump(), compiler))
    except (CompileError, OSError):
        return term
    return Term(*(ca.external(function.name(), library) for function in functions))
