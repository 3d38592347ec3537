"""The Cramér-Rao bound of the held force against information matrices."""

import numpy as np
import pytest

from benchmarks.bench_force_bound import Linearized, force_std


def drawn(periods: int = 12, states: int = 4, readings: int = 3) -> tuple[Linearized, np.ndarray, np.ndarray]:
    """A random linear motion, variances at the start, and what is added in a period."""
    rng = np.random.default_rng(3)
    motion = np.eye(states) + 0.2 * rng.normal(size=(periods, states, states))
    rows, force = rng.normal(size=(periods, readings, states)), rng.normal(size=(periods, states))
    names = tuple("abcd"[:states])
    of = Linearized(names, motion, rows, rng.uniform(0.5, 2.0, readings), force)
    return of, rng.uniform(1.0, 4.0, states), rng.uniform(0.1, 0.3, states)


def test_the_bound_of_constants_is_that_of_their_information_matrix() -> None:
    of, initial, _ = drawn()
    information, reached = np.diag(1.0 / initial), np.eye(len(initial))
    expected = []
    for k, (motion, rows, force) in enumerate(zip(of.motion, of.readings, of.force, strict=True)):
        reached = motion @ reached if k > 0 else reached
        by_start = rows @ reached
        information += by_start.T @ (by_start / of.noise[:, None])
        along = force @ reached
        expected.append(np.sqrt(along @ np.linalg.solve(information, along)))
    assert force_std(of, initial, np.zeros_like(initial)) == pytest.approx(expected, rel=1e-9)


def test_the_bound_of_what_wanders_is_that_of_all_its_increments() -> None:
    # Every increment is an unknown of its own: one information matrix of them all.
    of, initial, wander = drawn()
    periods, states = of.force.shape
    information = np.diag(1.0 / np.concatenate([initial, np.tile(wander, periods - 1)]))
    reached = np.zeros((states, periods * states))
    reached[:, :states] = np.eye(states)
    for k in range(periods):
        if k > 0:
            reached[:, k * states : (k + 1) * states] = np.eye(states)
            reached = of.motion[k] @ reached
        by_all = of.readings[k] @ reached
        information += by_all.T @ (by_all / of.noise[:, None])
    along = of.force[-1] @ reached
    expected = np.sqrt(along @ np.linalg.solve(information, along))
    assert force_std(of, initial, wander)[-1] == pytest.approx(expected, rel=1e-9)


def test_the_bound_is_lower_where_more_is_read() -> None:
    of, initial, wander = drawn()
    more = of.knowing([1, 3], 1e-10 * initial[[1, 3]])
    assert (force_std(more, initial, wander) < force_std(of, initial, wander)).all()
    every = of.knowing([0, 1, 2, 3], 1e-10 * initial)
    assert force_std(every, initial, wander) == pytest.approx(0.0, abs=1e-3)
