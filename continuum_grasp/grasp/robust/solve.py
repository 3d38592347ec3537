"""From a grasp of a scene to one that holds for all errors that the scene names, tried with draws."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from continuum_grasp.base import Array, amount_text
from continuum_grasp.grasp.certificate.certificate import certify
from continuum_grasp.grasp.effort import HELD
from continuum_grasp.grasp.problem.solver_run import GraspSolverRun
from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.grasp.robust.errors import BOUNDS, OBJECT, alone, drawn, extremes, with_drawn_states, with_states
from continuum_grasp.grasp.robust.response import Responder, Response
from continuum_grasp.grasp.robust.result import GraspTrials, Robustness
from continuum_grasp.grasp.robust.search import Exchange, find_robust, with_postures
from continuum_grasp.grasp.search import GraspSearch
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.grasp.tried import Tried
from continuum_grasp.grasp.values import (
    DRIVEN_AWAY,
    NEAR,
    OPENED,
    STEADIER,
    STEADIER_IN_SPACE,
    GraspStatus,
    Reason,
    tension_of,
)
from continuum_grasp.nlp import Budget
from continuum_grasp.scene import FingerSetup, GraspFinger, GraspScene, Robust

DRAWS = 100
"""Friction states that are drawn, where the scene names no errors. The nominal grasp is tried with twice as many draws
at most: its share is then known to 7 percentage points at 95 %."""
HALVINGS = 4
"""Number of times that the interval of the bounds that a grasp holds is halved: to a sixteenth."""
_FRICTIONS = {"tendons.friction": "of the tendons", "damping.dry_friction.moment": "in bending"}
"""Keys of a finger by which its friction states matter less, and where these are."""


def with_robust(result: GraspResult, search: GraspSearch, budget: Budget) -> GraspResult:
    """The grasp that holds for all errors and friction states, in place of a nominal one; why there is none, where none
    was found.

    It is sought next to that grasp, and next to others of its ``search`` that may lead to a better one.
    """
    scene = result.scene
    bounds = scene.robust or Robust.model_construct(draws=DRAWS)
    first = exchange = find_robust(scene, bounds, result.arrays, budget)
    branches = 1
    for arrays in _others(search, result.arrays):
        # No robust grasp takes less than the nominal one that it is next to.
        may = not exchange.holds or (
            scene.objective == "least_tension"
            and tension_of(scene, arrays) < (1.0 - NEAR) * tension_of(scene, exchange.arrays)
        )
        if branches >= HELD or not may or budget.over:
            break
        branches += 1
        other = find_robust(scene, bounds, arrays, budget)
        if other.holds and (not exchange.holds or tension_of(scene, other.arrays) < tension_of(scene, exchange.arrays)):
            exchange = other
    # Trials are no part of the search: only the clock stops them.
    trials = Budget(until=budget.until)
    arrays, certificate = exchange.arrays, exchange.certificate
    if exchange.holds and scene.state_columns:
        arrays = with_postures(scene, exchange.arrays, exchange.responses, trials)
        certificate = certify(scene, arrays)
    errors = with_drawn_states(scene, drawn(bounds, scene.solver.random_seed))
    nominal = _trials(scene, bounds, result.arrays, errors[: 2 * DRAWS], trials, first.first)
    robust = nominal if exchange.holds else None
    if exchange.holds and (exchange.arrays is not result.arrays or len(errors) > 2 * DRAWS):
        robust = _trials(scene, bounds, exchange.arrays, errors, trials, exchange.responses)
    robustness = Robustness(errors, nominal, robust, exchange.errors, result.arrays, exchange.touching)
    if robust is None:
        return _none(result, robustness, exchange, bounds, budget)
    held = f"held with {amount_text(robust.tension, 'N', '.4g')} of total tension whatever {_whatever(scene)}"
    effort = {
        "corners": len(exchange.responses),
        "corners_in_problem": len(exchange.errors),
        "iterations": exchange.iterations,
        "branches": branches,
    }
    # Why the search may have missed a better one.
    notes = [
        *result.message.removesuffix(OPENED).split("; ")[1:],
        *([] if exchange.optimal else ["the solver stopped early"]),
    ]
    without = f"{amount_text(nominal.tension, 'N', '.4g')} {'without errors' if scene.robust else 'as they are pulled'}"
    changed = replace(
        result,
        status=GraspStatus.OPTIMAL
        if exchange.optimal and result.status is GraspStatus.OPTIMAL
        else GraspStatus.FEASIBLE,
        message="; ".join([held, without, *notes]),
        arrays=arrays,
        certificate=certificate,
        sensitivity=(),  # the nominal grasp has it
        statistics={**result.statistics, "robust": effort},
        robustness=robustness,
    )
    if not certificate.passed:
        rejected = ", ".join(check.name for check in certificate.failed)
        message = f"found for {_whatever(scene)}, but the independent check rejects: {rejected}"
        return replace(changed, status=GraspStatus.NOT_SOLVED, message=message)
    if not certificate.acceptable:
        balanced = held.replace("held", "in balance", 1)
        why = certificate.stability.why
        message = "; ".join([f"{balanced}, {DRIVEN_AWAY}{why}", without, *notes])
        advice = STEADIER_IN_SPACE if why else STEADIER
        return replace(changed, status=GraspStatus.UNSTABLE, message=message, advice=advice)
    if robust.holds:
        return changed
    count = robust.margins.size
    unknown = int(np.isnan(robust.margins).sum())
    failed = count - robust.held - unknown
    shown = [f"{failed} of {count} draws do not hold"] if failed or not unknown else []
    shown += [f"{unknown} of {count} draws are undecided, as the solver gave up"] if unknown else []
    corners = "corners of robust" if scene.robust else "friction states sought"
    message = f"held at all {corners}, but NOT robust: {'; '.join(shown)}"
    return replace(changed, status=GraspStatus.FEASIBLE, message=message)


def _whatever(scene: GraspScene) -> str:
    """Errors that must not matter, in words."""
    states = f"the friction states {_where(scene)}"
    both = ("the errors within robust", scene.robust), (states, scene.state_columns)
    return " and ".join(words for words, there in both if there)


def _where(scene: GraspScene) -> str:
    """Parts that have friction states, in words."""
    return " and ".join(_FRICTIONS[key] for key in _frictions(scene))


def _others(search: GraspSearch, best: Mapping[str, Array]) -> Iterator[Mapping[str, Array]]:
    """Verified grasps of a search other than the best one, in the order of their tensions, as far as these are known:
    those it found, then those from exact rods that it left because they take more. Grasps with the fewest stations come
    first: others may touch as states ask, while each that the grasp itself has bounds what holds.
    """
    scene = search.scene
    seen = [best]

    def new(arrays: Mapping[str, Array]) -> bool:
        same = any(
            set(arrays["contact_names"]) == set(earlier["contact_names"])
            and math.isclose(tension_of(scene, arrays), tension_of(scene, earlier), rel_tol=NEAR)
            for earlier in seen
        )
        seen.append(arrays)
        return not same

    stations = any(setup.stations for setup in scene.setups)

    def order(tried: Tried) -> tuple[int, float]:
        return len(tried.arrays["contact_names"]) * stations, tension_of(scene, tried.arrays)

    for tried in sorted(search.good, key=order):
        if tried.acceptable and new(tried.arrays):
            yield tried.arrays
    for candidate in search.settled:
        other = None if candidate.tried else search.attempt(candidate.start)
        if other is not None and other.acceptable and new(other.arrays):
            yield other.arrays


def _none(
    result: GraspResult, robustness: Robustness, exchange: Exchange, bounds: Robust, budget: Budget
) -> GraspResult:
    """No robust grasp: with which part of the bounds, or of the friction of the fingers, there is one."""
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if budget.over:
            break
        if _holds(result, bounds, middle, budget):
            low = middle
        else:
            high = middle
    failing = [response for response in exchange.responses if not response.holds]
    worst = min(failing, key=lambda response: response.reserve, default=None)
    text = (
        f"the object can be held as it is ({amount_text(robustness.nominal.tension, 'N', '.4g')}), but no grasp was "
        f"found that holds whatever {_whatever(result.scene)}"
    )
    violated: tuple[str, ...] = ()
    if worst is not None:
        broken = ", ".join(str(violation) for violation in worst.attempt.violations[:2])
        what = worst.weakest or f"no posture balances{f' ({broken})' if broken else ''}"
        violated = (f"{_written(result.scene, worst.error)}: {what}",)
    base = replace(result, robustness=robustness, violated=violated, sensitivity=())
    if low <= 0.0 or budget.cut:
        advice = "Lower the bounds in robust, raise contacts.friction or tendons.max_tension, or add a contact."
        if not result.scene.robust:
            advice = (
                f"Lower {' and '.join(_frictions(result.scene))}, raise contacts.friction or "
                "contacts.normal_force_max, which fingers that were let out press with more, or add a contact. "
                "friction_states: pulled, where nothing moves the fingers after they are pulled."
            )
        return replace(base, status=GraspStatus.NOT_SOLVED, message=text, advice=advice)
    name = "errors"
    key = "robust"
    unit = "1"
    now = 1.0
    limits = "all bounds"
    repair = f"multiply all bounds in robust by {low:.4g}"
    if not result.scene.robust:
        frictions = _frictions(result.scene)
        (key, now), *further = frictions.items()
        name = "friction states"
        unit = "N m" if key.endswith("moment") else "1"
        limits = " and ".join(frictions)
        repair = f"multiply all {key} by {low:.4g}, to {low * now:.4g} at most"
        repair += "".join(f", and all {other} likewise, to {low * limit:.4g}" for other, limit in further)
    text += f"; with {low:.0%} of {limits} there is one"
    reason = Reason(name, key, unit, now, low * now, text, repair)
    advice = f"Any one of these repairs it: {repair}."
    return replace(base, status=GraspStatus.INFEASIBLE, message=text, reasons=(reason,), advice=advice)


def _holds(result: GraspResult, bounds: Robust, share: float, budget: Budget) -> bool:
    """Whether a grasp is found next to a result's for a share of the bounds, or of the friction of the fingers
    where there are none.
    """
    scene = result.scene
    if scene.robust:
        less_error = bounds.replaced(**{name: share * getattr(bounds, name) for name in BOUNDS})
        return find_robust(scene, less_error, result.arrays, budget).holds
    fingers = {setup.name: _less_friction(setup, share) for setup in scene.setups}
    less = scene.with_fingers(fingers)
    start = GraspStart.of(scene, dict(result.arrays))
    solver = GraspSolverRun.of(less, start.contacts)
    attempt = solver.run(less, start, budget, options_at=2)
    return attempt.converged and find_robust(less, bounds, solver.arrays(less, attempt), budget).holds


def _less_friction(setup: FingerSetup, share: float) -> GraspFinger:
    """A finger with a share of the friction of its tendons and of the moments of its dry friction in bending."""
    damping = setup.finger.damping
    branches = tuple(branch.replaced(moment=share * branch.moment) for branch in damping.dry_friction)
    less = setup.finger.with_tendons(friction=share * setup.tendons.friction)
    return less.replaced(damping=damping.replaced(dry_friction=branches)) if branches else less


def _frictions(scene: GraspScene) -> dict[str, float]:
    """Keys of the frictions that have states, and the greatest value of each."""
    branches = [branch.moment for setup in scene.setups for branch in setup.finger.damping.dry_friction]
    greatest = max(setup.tendons.friction for setup in scene.setups), max(branches, default=0.0)
    return {key: value for key, value in zip(_FRICTIONS, greatest, strict=True) if value > 0.0}


def _written(scene: GraspScene, error: Array) -> str:
    """Errors of the object and friction states (6 + S,) in words."""
    x, y, angle, size, friction, mass, *states = error.tolist()
    place = f"({1e3 * x:+.3g}, {1e3 * y:+.3g}) mm, {np.degrees(angle):+.3g} deg"
    words = [f"corner {place}, size {size:+.1%}, friction {friction:+.1%}, mass {mass:+.1%}"]
    if not error[:OBJECT].any():
        words = []
    for setup in scene.setups if states else ():
        finger_states = states[scene.state_columns[setup.name]] if setup.name in scene.state_columns else []
        count = setup.tendon_friction_states
        parts = zip(_FRICTIONS.values(), (finger_states[:count], finger_states[count:]), strict=True)
        of = f" of {setup.name}" * (len(scene.setups) > 1)
        words += [f"friction states {part}{of} {_signs(each)}" for part, each in parts if each]
    return ", ".join(words)


def _signs(states: Sequence[float]) -> str:
    """Friction states from base to tip, by sign alone where all are at their limits."""
    if all(abs(z) == 1.0 for z in states):
        return "".join("+" if z > 0.0 else "-" for z in states)
    return " ".join(f"{z:+.3g}" for z in states)


def _trials(
    scene: GraspScene,
    bounds: Robust,
    arrays: Mapping[str, Array],
    errors: Array,
    budget: Budget,
    corners: Sequence[Response],
) -> GraspTrials:
    """Try a grasp with draws, at corners, whose responses are known, and with each bound alone."""
    responder = Responder(scene, arrays, budget)
    responses = [responder.to(error) for error in errors]
    # With all of their friction: a reserve that is not left is no failure.
    failed = (response for response in responses if not response.margin >= 0.0)
    weakest = Counter(response.weakest or "balance" for response in failed)
    states = extremes(scene, arrays)
    ends = {name: with_states(errors, states[:1]) for name, errors in alone(bounds).items()}
    if states.size:
        ends[f"friction {_where(scene)}"] = with_states(np.zeros((1, OBJECT)), states)
    single = {name: min(responder.to(error).margin for error in each) for name, each in ends.items()}
    worst = min(corners, key=lambda response: response.reserve).error
    return GraspTrials(
        tension_of(scene, arrays),
        np.array([response.margin for response in responses]),
        np.array([response.margin for response in corners]),
        single,
        weakest,
        _written(scene, worst),
    )
