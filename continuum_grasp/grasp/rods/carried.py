"""A solution carried over to a problem with more stages."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.rods.problem import GraspRods, NearPair, StagePlace
from continuum_grasp.grasp.rods.rod import integral, stage


def carried(before: GraspRods, x: Array, problem: GraspRods) -> Array:
    """Unknowns of a problem with as many stages as another, or a multiple, by those of the other."""
    y = np.zeros(problem.size)
    for name, at in problem.at.items():
        if not name.startswith("node "):
            y[at] = x[before.at[name]]
    for index in range(len(problem.parts)):
        _set_nodes(before, x, problem, index, y)
    return y


def _set_nodes(before: GraspRods, x: Array, problem: GraspRods, index: int, y: Array) -> None:
    """States of a finger: at its former nodes, and from there on between them."""
    finger, part, coarse = problem.numbers.fingers[index], problem.parts[index], before.parts[index]
    geometry, times = problem.geometry, part.stages // coarse.stages
    pull = float(y[part.pulls] @ [1.0, -1.0])
    for node, (first, _) in enumerate(itertools.pairwise(coarse.nodes)):
        segment = coarse.segment_of(node + 1)
        begin, end = x[coarse.segments[segment]]
        state = x[first].copy()
        y[part.nodes[times * node]] = state
        if segment and node == coarse.first[segment]:
            state[geometry.moments] = x[coarse.turns[segment - 1]]
        each = (end - begin) / part.stages
        for k in range(1, times):
            s = begin + each * (times * (node - coarse.first[segment]) + k - 1)
            force = x[coarse.forces[segment]] - finger.gravity * integral(finger.course.weight, begin, s)
            state = np.array(stage(geometry, finger.course, finger.sides, finger.gravity, state, force, pull, s, each))
            y[part.nodes[times * node + k]] = state
    y[part.nodes[-1]] = x[coarse.nodes[-1]]


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
