"""A solution carried over to a problem with more stages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.problem import GraspRods, NearPair, StagePlace


def carried(before: GraspRods, x: Array, problem: GraspRods) -> Array:
    """Unknowns of a problem with as many stages as another, or a multiple, by those of the other."""
    y = np.zeros(problem.size)
    for name, at in problem.at.items():
        # Another problem may have unknowns of a limit that is widened.
        if name in before.at and not name.startswith("node "):
            y[at] = x[before.at[name]]
    for index in range(len(problem.parts)):
        _set_nodes(before, x, problem, index, y)
    return y


def _set_nodes(before: GraspRods, x: Array, problem: GraspRods, index: int, y: Array) -> None:
    """States of a finger: at its former nodes, and from there on between them."""
    finger, part, former = problem.numbers.fingers[index], problem.parts[index], before.parts[index]
    geometry = problem.geometry
    stage = kinds.stage_kind(geometry, finger.section.form)
    for span, coarse in zip(part.spans, former.spans, strict=True):
        times = span.stages // coarse.stages
        for k in range(coarse.stages):
            node, first = coarse.first + k, span.first + times * k
            state = x[former.nodes[node]].copy()
            y[part.nodes[first]] = state
            if k == 0 and node in former.touching:
                state[geometry.moments] = x[former.turns[former.touching.index(node)]]
            for j in range(1, times):
                unknowns = [*state, *np.zeros(len(state)), *x[coarse.force], *x[former.pulls], *x[coarse.ends]]
                data = [*finger.acting(span.piece), *span.shares(first + j)]
                # The row is where the stage leads less where it ends.
                state = stage.value(np.array(unknowns), np.array(data), np.zeros(0))
                y[part.nodes[first + j]] = state
    y[part.nodes[-1]] = x[former.nodes[-1]]


def finer_places(places: Sequence[StagePlace], times: int) -> list[StagePlace]:
    """The same places where every stage is so many."""
    found = list[StagePlace]()
    for place in places:
        along = place.share * times
        k = min(int(np.ceil(along)), times)
        found.append(StagePlace(place.finger, times * (place.node - 1) + k, along - (k - 1)))
    return found


def finer_pairs(pairs: Sequence[NearPair], times: int) -> list[NearPair]:
    """The same nodes, and the chords next to the same places, where every stage is so many."""
    return [
        NearPair(pair.finger, times * pair.node, pair.other, times * pair.chord + k)
        for pair in pairs
        for k in range(times)
    ]
