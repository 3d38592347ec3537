"""Setpoints of missions, and what their phases change of a controller."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from continuum_grasp.mission.plan import Plan


def planned(table, names, t):
    """Setpoints by names at instants of the plan."""
    count, limits = len(names), np.ones(len(table.of.held))
    stages = SimpleNamespace(r_names=tuple(names), weights=np.ones(count), u_min=-limits, u_max=limits)
    return Plan(table, stages, np.zeros(0)).rows(np.asarray(t), of_plan=True)


def begun(table, stages, plant):
    """Weights and limits, by the phases that set them."""
    found, plan = {}, Plan(table, stages, np.zeros(0))
    for k, phase in enumerate(plan.phases):
        said = SimpleNamespace(change=lambda name=phase.name, **new: found.update({name: new}))
        plan.enter(0.0, said, plant, k)
    return found
