"""A solution carried over to a problem with more stages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.places import NearPair, StagePlace
from continuum_grasp.grasp.rods.problem import GraspRods


def carried(before: GraspRods, x: Array, problem: GraspRods) -> Array:
    """Unknowns of a problem with as many stages as another, or a multiple, by the unknowns of the other."""
    y = problem.named(before, x)
    for index in range(len(problem.parts)):
        _set_nodes(before, x, problem, index, y)
    return y


def _set_nodes(before: GraspRods, x: Array, problem: GraspRods, index: int, y: Array) -> None:
    """States of a finger: at its former nodes, and from there on between them."""
    finger, part, coarse = problem.numbers.fingers[index], problem.parts[index], before.parts[index]
    geometry = problem.geometry
    stage = kinds.stage_kind(geometry, finger.section.form)
    for span, rough in zip(part.spans, coarse.spans, strict=True):
        times = span.stages // rough.stages
        for k in range(rough.stages):
            node = rough.first + k
            state = x[coarse.nodes[node]].copy()
            first = span.first + times * k
            y[part.nodes[first]] = state
            if k == 0 and node in coarse.touching:
                state[geometry.moments] = x[coarse.turns[coarse.touching.index(node)]]
            if times > 1:
                acting = [*y[span.force], *y[part.pulls], *y[span.ends]]
                nodes = range(first + 1, first + times)
                data = [[*finger.acting(span.piece, part.along(n)), *span.shares(n)] for n in nodes]
                y[np.array(part.nodes[first + 1 : first + times])] = kinds.led(stage, state, np.array(acting), data)
    y[part.nodes[-1]] = x[coarse.nodes[-1]]


def finer_places(places: Sequence[StagePlace], times: int) -> list[StagePlace]:
    """Give the places in a problem that has several stages for each one."""
    found = list[StagePlace]()
    for place in places:
        along = place.share * times
        k = min(int(np.ceil(along)), times)
        found.append(StagePlace(place.finger, times * (place.node - 1) + k, along - (k - 1)))
    return found


def finer_pairs(pairs: Sequence[NearPair], times: int) -> list[NearPair]:
    """Give the nodes and the chords next to the same places in a problem that has several stages for each one."""
    return [
        NearPair(pair.finger, times * pair.node, pair.other, times * pair.chord + k)
        for pair in pairs
        for k in range(times)
    ]
