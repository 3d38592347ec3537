"""Problems that are sums of blocks: against the same problem differentiated as a whole, and splines of SciPy."""

from __future__ import annotations

import itertools

import casadi as ca
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from continuum_grasp.nlp import BlockKind, BlockProblem, Budget, Lookup, Settings, SolverStatus


def link_kind():
    z, d = ca.SX.sym("z", 4), ca.SX.sym("d")
    return BlockKind("link", z, d, ca.sumsqr(z[:2] - z[2:]) - d**2)


def chain(count, length):
    """A chain of links between two points at the same height, 1 m apart; the links' ends weigh the same."""
    problem = BlockProblem("chain")
    ends = {0: [0.0, 0.0], count: [1.0, 0.0]}
    free = [9.0, 9.0]
    nodes = [
        problem.unknown(f"node {k}", *(2 * [ends[k]] if k in ends else (np.negative(free), free)))
        for k in range(count + 1)
    ]
    for first, last in itertools.pairwise(nodes):
        problem.add(link_kind(), [*first, *last], problem.rows("length", "links", "m2", 1), [length / count])
    for node in nodes:
        problem.cost(node[1], 1.0)
    return problem, nodes


def test_a_hanging_chain_has_tensions_of_one_horizontal_part():
    """Slopes of its links differ by equal amounts: T_k sin - T_(k+1) sin = weight, and T cos is the same in all."""
    problem, nodes = chain(6, 1.5)
    guess = np.concatenate([[k / 6, -0.4 * np.sin(np.pi * k / 6)] for k in range(7)])
    found = Settings().solver().solve(problem.nlp, problem.start(guess), Budget())
    assert found.status is SolverStatus.SOLVED
    places = found.x[np.array(nodes)]
    slopes = np.diff(places[:, 1]) / np.diff(places[:, 0])
    steps = np.diff(slopes)
    assert steps == pytest.approx(np.full(5, steps.mean()), rel=1e-5)
    assert np.hypot(*np.diff(places, axis=0).T) == pytest.approx(np.full(6, 0.25), rel=1e-6)


def table_problem(axes, counts, random):
    """Blocks that read a table at affine places of their unknowns, two of which share a row."""
    coefficients = random.normal(size=counts)
    z, d, found = ca.SX.sym("z", axes), ca.SX.sym("d", 1 + axes), ca.SX.sym("found", axes + 4**axes)
    weights = []
    for axis in range(axes):
        t = z[axis] - found[axis]
        weights.append([(1 - t) ** 3, 4 - 6 * t**2 + 3 * t**3, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3])
    value = sum(_product(weights, at) / 6**axes * found[axes + flat] for flat, at in enumerate(np.ndindex((4,) * axes)))
    kind = BlockKind(f"read{axes}", z, d, value, Lookup(z, d[0], d[1:], z[:0], as_read(axes), found))
    problem = BlockProblem("table", np.concatenate([np.zeros(7), coefficients.ravel()]))
    unknowns = [problem.unknown(f"place {k}", np.zeros(axes), 99.0) for k in range(3)]
    rows = problem.rows("value", "table", "1", 2).ravel()
    for at, row in zip(unknowns, (0, 0, 1), strict=True):
        problem.add(kind, at, rows[row], [7.0, *counts])
    return problem, coefficients


def as_read(axes):
    """A series of a lookup that is the cell and its coefficients."""
    given, cell, coefficients = ca.SX.sym("given", 0), ca.SX.sym("cell", axes), ca.SX.sym("coefficients", 4**axes)
    return ca.Function("series", [given, cell, coefficients], [ca.vertcat(cell, coefficients)])


def _product(weights, at):
    value = 1.0
    for axis, i in enumerate(at):
        value = value * weights[axis][i]
    return value


@pytest.mark.parametrize(("axes", "counts"), [(2, (8, 11)), (3, (6, 7, 9))])
def test_a_lookup_is_the_cubic_spline_of_its_coefficients(axes, counts):
    random = np.random.default_rng(axes)
    problem, coefficients = table_problem(axes, counts, random)
    x = np.concatenate([random.uniform(1.0, np.array(counts) - 2.0) for _ in range(3)])
    g = np.array(problem.nlp.functions["jac_g"](x, problem.parameters)[0]).ravel()
    # The spline whose coefficients these are, by SciPy: prefilter=False takes coefficients.
    values = map_coordinates(coefficients, x.reshape(3, axes).T, order=3, prefilter=False)
    assert g == pytest.approx([values[0] + values[1], values[2]], rel=1e-12)
    assert problem.row_values(x, np.arange(2)) == pytest.approx(g, rel=1e-12)


@pytest.mark.parametrize("axes", [2, 3])
def test_derivatives_are_differences_of_values(axes):
    """Jacobian by differences of the rows, Hessian by differences of the Jacobian; a cell's ends are crossed, too."""
    random = np.random.default_rng(7)
    problem, _ = table_problem(axes, (8,) * axes, random)
    functions, p, forces = problem.nlp.functions, problem.parameters, np.array([0.7, -1.3])
    h = 1e-6
    for x in (random.uniform(1.2, 5.8, 3 * axes), np.full(3 * axes, 3.0)):
        jacobian = np.array(ca.DM(functions["jac_g"](x, p)[1]))
        upper = np.array(ca.DM(functions["hess_lag"](x, p, 1.0, forces)))
        hessian = np.triu(upper) + np.triu(upper, 1).T
        for k in range(x.size):
            step = h * np.eye(x.size)[k]
            ends = [functions["jac_g"](x + sign * step, p) for sign in (1.0, -1.0)]
            rows, slopes = ([np.array(ca.DM(end[i])) for end in ends] for i in range(2))
            assert ((rows[0] - rows[1]) / (2 * h)).ravel() == pytest.approx(jacobian[:, k], abs=1e-6)
            assert forces @ (slopes[0] - slopes[1]) / (2 * h) == pytest.approx(hessian[:, k], abs=1e-5)


def test_an_unknown_that_a_block_has_twice_counts_twice():
    """x^2 y with y = x is x^3."""
    z, none = ca.SX.sym("z", 2), ca.SX(0, 1)
    problem = BlockProblem("twice")
    x = problem.unknown("x", -9.0, 9.0)
    problem.add(BlockKind("cubic", z, none, z[0] ** 2 * z[1]), [*x, *x], problem.rows("row", "x", "1", 1), [])
    functions, p = problem.nlp.functions, problem.parameters
    assert float(functions["jac_g"](2.0, p)[1]) == pytest.approx(12.0)
    assert float(functions["hess_lag"](2.0, p, 1.0, 1.0)) == pytest.approx(12.0)


def test_problems_of_the_same_structure_share_their_functions():
    one, two = (chain(4, length)[0] for length in (1.2, 1.4))
    assert one.nlp is two.nlp
    assert chain(5, 1.2)[0].nlp is not one.nlp


def test_a_block_that_does_not_fit_its_kind_is_refused():
    problem, nodes = chain(3, 1.2)
    with pytest.raises(ValueError, match=r"link: \[4, 1, 2\] unknowns, rows and data for \(4, 1, 1\)"):
        problem.add(link_kind(), [*nodes[0], *nodes[1]], [0], [1.0, 2.0])


def test_problems_that_another_includes_keep_their_solutions():
    """A chain, and another one beside it."""
    one, nodes = chain(6, 1.5)
    other, own = chain(4, 1.2)
    both = BlockProblem("both")
    first, second = both.include("one", one), both.include("other", other)
    guess = np.concatenate([[k / 6, -0.4 * np.sin(np.pi * k / 6)] for k in range(7)])
    short = np.concatenate([[k / 4, -0.3 * np.sin(np.pi * k / 4)] for k in range(5)])
    x = np.zeros(both.size)
    x[first.unknowns], x[second.unknowns] = guess, short
    solver = Settings().solver()
    found = solver.solve(both.nlp, both.start(x), Budget())
    for part, problem, begin in ((first, one, guess), (second, other, short)):
        alone = solver.solve(problem.nlp, problem.start(begin), Budget())
        assert found.x[part.unknowns] == pytest.approx(alone.x, abs=1e-6)
    assert len(nodes) + len(own) == both.size // 2


def test_a_problem_that_another_includes_reads_its_own_table():
    random = np.random.default_rng(3)
    parts = [table_problem(2, (8, 11), random)[0] for _ in range(2)]
    both = BlockProblem("both", parts[0].table)
    included = [both.include(f"part {k}", part) for k, part in enumerate([*parts, parts[0]])]
    assert both.table.size == sum(part.table.size for part in parts)
    x = random.uniform(1.0, 6.0, both.size)
    g = np.array(both.nlp.functions["jac_g"](x, both.parameters)[0]).ravel()
    for part in included:
        assert g[part.rows] == pytest.approx(part.problem.row_values(x[part.unknowns], np.arange(2)), rel=1e-12)
