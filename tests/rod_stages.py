"""Fingers as exact rods by shooting with stages, and by SciPy with everything written again."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import casadi as ca
import numpy as np
from scipy.optimize import root

import continuum_grasp as cg
from continuum_grasp.model import PlaneRod, RodLoads, Section, stage_end

LENGTH, STIFFNESS, OFFSET = 0.2, 0.05, 0.005
ROD = {"length": LENGTH, "bending_stiffness": STIFFNESS, "linear_density": 0.1}
PAIR = {"offset": OFFSET, "max_tension": 60.0}


def finger(**keys):
    """A finger by the keys of a configuration."""
    return cg.Finger.model_validate({"rod": ROD, "tendons": PAIR, **keys})


PLANE = PlaneRod()


@cache
def stage_of(form, rod, substeps=4):
    """A stage of a rod as a function of state, force, pulls, begin, end, gravity, sides, history and numbers."""
    space = 2 if rod.state == PLANE.state else 3
    sizes = [rod.state + len(form.sliding_names), space, len(form.pulls), 1, 1, space, 2 * (space - 2)]
    given = [ca.SX.sym(f"given_{k}", size) for k, size in enumerate([*sizes, len(form.history_names), form.size])]
    state, force, pulls, begin, end, gravity, sides, history, numbers = given
    loads = RodLoads(force, pulls, gravity, history, numbers, sides)
    return ca.Function("stage", given, [ca.vertcat(*stage_end(form, rod, state, begin, end, loads, substeps))])


class Stages:
    """A finger as stages that end where its pieces end, about so many in all."""

    def __init__(self, of, count=24, *, rounding=0.0, gravity=(0.0, 0.0), substeps=4):
        self.section = Section.of(of, rounding=rounding)
        self.form = self.section.form
        self.stage, self.gravity = stage_of(self.form, PLANE, substeps), gravity
        self.names = ("x", "y", "angle", "moment", *self.form.sliding_names)
        self.slides = [k for k, name in enumerate(self.names) if name.startswith("slide")]
        self.losses = [k for k, name in enumerate(self.names) if name.startswith("loss")]
        self.ends = []
        for piece, (start, end) in enumerate(pairwise(self.section.places)):
            places = np.linspace(start, end, max(1, round(count * (end - start))) + 1)
            self.ends += [(a, b, piece) for a, b in pairwise(places.tolist())]
        entering = ca.SX.sym("sliding", len(self.names) - 4)
        history = ca.SX.sym("history", len(self.form.history_names))
        losses = self.form.first_losses(entering, self.section.numbers(0), history)
        self._entering = ca.Function("entering", [entering, history], [ca.vertcat(*losses)])

    def along(self, start, force, pulls, history=None):
        """States (stages + 1, n) from those at the base; one history, or one per stage."""
        history = self.section.pulled if history is None else history
        every = np.broadcast_to(history, (len(self.ends), len(self.form.history_names)))
        states = [np.array(start, dtype=float)]
        for (begin, end, piece), own in zip(self.ends, every, strict=True):
            given = (states[-1], force, pulls, begin, end, self.gravity, [], own, self.section.numbers(piece))
            states.append(np.array(self.stage(*given)).ravel())
        return np.array(states)

    def at_rest(self, tensions=(), force=(0.0, 0.0), *, moment=0.0, history=None, guess=None):
        """States along a finger at rest under tensions [N] or pressures [Pa], a force [N] and a moment [N m] at the
        tip.
        """
        section = self.section
        history = section.pulled if history is None else history
        total = np.array(force) / section.force + np.array(self.gravity) * section.mass
        pulls = [value / pull.unit - pull.least for value, pull in zip(tensions, section.pulls, strict=True)]

        def base(unknown):
            start = np.zeros(len(self.names))
            start[3], start[self.slides] = unknown[0], unknown[1:]
            if self.losses:
                start[self.losses] = np.array(self._entering(start[4:], np.atleast_2d(history)[0])).ravel()
            return start

        def missing(unknown):
            end = self.along(base(unknown), total, pulls, history)[-1]
            return np.append(end[3] - moment / section.moment, end[self.slides])

        # By steps of the loads, so that no other equilibrium is found.
        unknown = np.zeros(1 + len(self.slides)) if guess is None else np.array(guess)
        solved = root(missing, unknown, tol=1e-12)
        assert np.abs(missing(solved.x)).max() < 1e-9
        return self.along(base(solved.x), total, pulls, history)
