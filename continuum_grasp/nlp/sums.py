"""Problems that are sums of others: what parts have alike is differentiated once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from continuum_grasp.base import Indices
from continuum_grasp.nlp.problem import NLP


@dataclass(frozen=True, eq=False)
class Summand:
    """A part of a problem, by the places of its own in the whole.

    Attributes
    ----------
    nlp : NLP
    unknowns, parameters, constraints : ndarray of int
        Places of its x, p and g; places of several parts may be the same: constraints are sums then.
    """

    nlp: NLP
    unknowns: Indices
    parameters: Indices
    constraints: Indices


def summed(name: str, sizes: tuple[int, int, int], parts: Sequence[Summand]) -> NLP:
    """The problem that is the sum of parts: of their objectives, and of their constraints in each row.

    Parameters
    ----------
    name : str
    sizes : tuple of int
        Of unknowns, parameters and constraints.
    parts : sequence of Summand
        Parts whose ``nlp`` is the same share its derivatives.
    """
    n, m, count = sizes
    x, p, f_force, g_forces = (ca.MX.sym(key, size) for key, size in (("x", n), ("p", m), ("lf", 1), ("lg", count)))
    values, gradients, jacobians, hessians = ([] for _ in range(4))
    for part in parts:
        at = x[part.unknowns.tolist()], p[part.parameters.tolist()]
        functions = part.nlp.functions
        values.append(part.nlp.values(*at))
        gradients.append(ca.densify(functions["grad_f"](*at)[1]))
        jacobians.append(functions["jac_g"](*at)[1])
        hessians.append(functions["hess_lag"](*at, f_force, g_forces[part.constraints.tolist()]))
    f = sum((value for value, _ in values), ca.MX(0.0))
    g = scattered(count, [part.constraints for part in parts], [ca.densify(value) for _, value in values])
    gradient = scattered(n, [part.unknowns for part in parts], gradients)
    rows = [part.constraints[j.sparsity().row()] for part, j in zip(parts, jacobians, strict=True)]
    columns = [part.unknowns[j.sparsity().get_col()] for part, j in zip(parts, jacobians, strict=True)]
    jacobian = entries_at((count, n), rows, columns, [j.nz[:] for j in jacobians])
    first = [part.unknowns[h.sparsity().row()] for part, h in zip(parts, hessians, strict=True)]
    second = [part.unknowns[h.sparsity().get_col()] for part, h in zip(parts, hessians, strict=True)]
    upper = [(np.minimum(a, b), np.maximum(a, b)) for a, b in zip(first, second, strict=True)]
    hessian = entries_at((n, n), [a for a, _ in upper], [b for _, b in upper], [h.nz[:] for h in hessians])
    derivatives = {
        "grad_f": ca.Function("nlp_grad_f", [x, p], [f, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("nlp_jac_g", [x, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l", [x, p, f_force, g_forces], [hessian], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
        ),
    }
    return NLP(name, x, f, g, p, derivatives)


def scattered(size: int, places: Sequence[Indices], values: Sequence[ca.MX]) -> ca.MX:
    """A column (size,) of sums of values at places."""
    at = np.concatenate([*places, np.zeros(0, dtype=int)]).astype(int)
    ones = ca.DM.triplet(at.tolist(), list(range(at.size)), ca.DM.ones(at.size), size, at.size)
    return ca.mtimes(ones, ca.vertcat(*values)) if at.size else ca.MX.zeros(size)


def entries_at(
    shape: tuple[int, int], rows: Sequence[Indices], columns: Sequence[Indices], values: Sequence[ca.MX]
) -> ca.MX:
    """A sparse matrix of sums of values, columns of numbers, at rows and columns."""
    at = np.concatenate(columns) * shape[0] + np.concatenate(rows)
    entries, place = np.unique(at, return_inverse=True)
    pattern = ca.Sparsity.triplet(*shape, (entries % shape[0]).tolist(), (entries // shape[0]).tolist())
    ones = ca.DM.triplet(place.tolist(), list(range(at.size)), ca.DM.ones(at.size), entries.size, at.size)
    return ca.MX(pattern, ca.mtimes(ones, ca.vertcat(*values)))
