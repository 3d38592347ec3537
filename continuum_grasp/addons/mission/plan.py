"""Phases of a mission, its limits and setpoints: the C of ``control/c/mission.c``, called once per period."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.addons.mission.assignment import Assignment
from continuum_grasp.addons.mission.budget import certified_contact
from continuum_grasp.addons.mission.plant import Timetable, firmer, reserve
from continuum_grasp.addons.mission.scene import Slip
from continuum_grasp.base import Array
from continuum_grasp.control import Compiled, Stages

_FOLLOWED = {"posture": ("bending_",), "force": ("contact_force",), "gap": ("gap_",), "angle": ("gap_", "object_angle")}
"""Quantities that the controller may follow in a phase, and how the names of their setpoints begin."""
NOTICED = ("", "sinks", "parts", "reported")
"""Reasons of a firm grip: the object sinks, a contact parts, another finger or the caller says so."""


class CommandLimits(IntEnum):
    """Limits of the command in a phase, as in ``c/mission.h``."""

    NOMINAL = 0
    SQUEEZES = 1
    HOLDS = 2


class LiftDecision(IntEnum):
    """Decisions before the lift, as in ``c/mission.h``."""

    WAITS = 0
    LIFTS = 1
    LETS_GO = 2


class Bearing(IntEnum):
    """Forces at the contacts of a finger, by the estimate; of one that was blind before the lift, whatever they are."""

    UNKNOWN = 0
    BEARS = 1
    LACKS = 2
    DOUBTS = 3
    BLIND = 4


class Grip(IntEnum):
    """State of the grip, as in ``c/mission.h``."""

    USUAL = 0
    FIRM = 1
    SETS_DOWN = 2


class PhaseCall(IntEnum):
    """Calls of ``c/mission_python.c``; others are phases by number."""

    DUE = -1
    BY_FORCES = -2
    RELEASE = -3
    ABORT = -4
    SQUEEZE = -5


_BEGINS = {
    **dict.fromkeys(("approach", "release", "leave last"), ("posture", CommandLimits.NOMINAL)),
    "settle": ("force", CommandLimits.NOMINAL),
    "confirm": ("force", CommandLimits.SQUEEZES),
    "lift": ("force", CommandLimits.HOLDS),
    **dict.fromkeys(("touch", "leave"), ("gap", CommandLimits.NOMINAL)),
    "turn": ("angle", CommandLimits.NOMINAL),
}
"""Quantity that is followed from a phase on, and limits of the command; other phases leave both as they are."""


def certified_forces(assignments: Sequence[Assignment], of: Assignment) -> Array:
    """Normal force (C,) [N] of each contact of a finger's controller in the certificate; NaN where it has none."""
    contacts = [certified_contact(assignments, of.own_name(name)) for name in of.control.contact_names]
    return np.array([np.nan if contact is None else contact.normal_force for contact in contacts])


def mission_settings(
    table: Timetable, stages: Stages, certified: Array, *, leads: bool = True, holds_on: bool = False
) -> tuple[dict[str, int], dict[str, ArrayLike]]:
    """Dimensions of the C of a finger's phases, and the members of ``mission_settings``."""
    of = table.of
    moves = table.moves(stages.r_names)
    phases = table.phases()
    names = [span.name for span in phases]
    period = of.control.controller.step
    patience = of.mission.phases.squeeze
    last = f"leave {table.strokes[-1]}" if table.strokes else ""
    kinds = ["leave last" if name == last else name.partition(" ")[0] for name in names]
    begins = [_BEGINS.get(kind) for kind in kinds]
    follows = list(_FOLLOWED)
    # One drive follows one of them. Rates stay weighted, since they damp all.
    every = tuple(prefix for prefixes in _FOLLOWED.values() for prefix in prefixes)
    weights = []
    for prefixes in _FOLLOWED.values():
        off = tuple(prefix for prefix in every if prefix not in prefixes)
        followed = [not name.startswith(off) or "rate" in name for name in stages.r_names]
        weights.append(np.where(followed, stages.weights, 0.0))
    low, high = (np.clip(limit, -Stages.ABSENT, Stages.ABSENT) for limit in of.holding)
    # A controller, to which contacts are smooth and the object stays, may expect less force of more tension up to some
    # way short of the grasp, and settles there, or lets the other tendon pull against the one that closes: fingers that
    # squeeze on close as in the grasp or tighter.
    tighter = np.where(low > -Stages.ABSENT, of.held, low)
    members: dict[str, ArrayLike] = {
        "period": period,
        "begin": [span.start for span in phases],
        # Asked once more at the latest instant.
        "length": [patience + period if s.name == "confirm" else s.end - s.start for s in phases],
        "follows": [-1 if b is None else follows.index(b[0]) for b in begins],
        "limits": [CommandLimits.NOMINAL if b is None else b[1] for b in begins],
        **{name: names.index(name) for name in ("confirm", "lower", "release")},
        "holds_on": int(holds_on),
        "leads": int(leads),
        "patience": patience,
        "needed": _share(of.mission.phases.lift_share, certified),
        "weights": weights,
        "u_min": stages.u_min,
        "u_max": stages.u_max,
        "low": [stages.u_min, tighter, low],
        "high": [stages.u_max, high, high],
        "follows_command": int(bool(of.control.finger.winches)),
        "held": of.held,
        **dict(zip(("first", "moves_at", "moves_for", "moves_by"), moves, strict=True)),
    }
    members |= _slip_settings(of, stages.r_names, certified)
    sizes = {"PHASES": len(phases), "MOVES": len(moves[1]), "NR": len(stages.r_names)}
    return sizes | {"NU": len(stages.u_min), "NC": certified.size}, members


NOTICES = 3
"""Calls in a row in which a contact bears hardly anything until it counts as parted, or all bear enough to lift [1]:
one update of an estimate that jumps is none. As many heights tell what sinks fast from a glitch."""
_SMOOTHED = 0.15
"""Time constant in which the height from which losses count is smoothed [s]: half of a shipped mission's lift, so that
it has what contacts give way under the weight, and 0.18 standard deviations of a height."""
_AGAIN = 3.0
"""Height that a firm grip, or one that takes over the weight, may lose, as a multiple of ``slip.sunk`` [1]: the mugs
that it held lost 0.15 mm further at most while they were pulled, those that fell 0.2 mm in the pull before."""


def _share(share: float, certified: Array) -> Array:
    """Least normal forces (C,) [N] as a share of those in the certificate; none without a share, or a contact there.

    Estimates of forces that are not there may be below zero.
    """
    return np.where(np.isnan(certified) | (share == 0.0), -Stages.ABSENT, share * np.nan_to_num(certified))


def _slip_settings(of: Assignment, names: Sequence[str], certified: Array) -> dict[str, ArrayLike]:
    """Members of ``mission_settings`` about an object that slips."""
    watches = int(of.mission.slip is not None)
    asked = of.mission.slip or Slip()
    # Page's test sums log-likelihood ratios of twice the limit against none; limits far within noise would take long.
    std = max(asked.height or 0.0, 0.1 * asked.sunk)
    step = of.control.controller.step
    sunk = max(asked.sunk, 0.5 * std)
    limits = of.gives + np.array([sunk, _AGAIN * sunk, asked.down])
    more = 0.0 if of.standing else reserve(of)
    firm = firmer(of, more)
    return {
        "watches": watches,
        "answers": int(more > 0.0),
        "sunk": limits,
        # 1e-9: probability per call that noise passes for slip: as the bound on the test of Page has it for an object
        # that loses no height at all
        "weight": 2.0 * limits / (std**2 * -math.log(1e-9)),
        # 0.5: most doubt of one height: a single one that is far off is no slip
        "glitch": 0.5,
        "fresh": min(1.0, step / _SMOOTHED),
        # 3.0: time in which a firm grip settles, in these time constants: 5 % of the height lost meanwhile count
        # afterwards
        "settles": math.ceil(3.0 * _SMOOTHED / step),
        "parts": NOTICES,
        # 0.1: time for which a contact that parted may do so under a firm grip until the object is set down [s]: twice
        # as long as drives of 400 N/s take to squeeze
        "stays": NOTICES + math.ceil(0.1 / step),
        "lost": _share(asked.parted, certified),
        "firm": [firm.get(name, 0.0) for name in names],
    }


class PhasePlan:
    """Phases of one finger's mission for a closed loop.

    ``reported`` gives what a finger needs to know of others before the lift: the first one, whether they bear enough,
    the others, its decision; ``waits`` is called with instant and command at each period in which that is asked, and
    when the finger lets go before.
    ``grips`` is called each period while slip is watched, and gives the firmest grip of all fingers.
    """

    def __init__(
        self,
        table: Timetable,
        stages: Stages,
        certified: Array,
        *,
        leads: bool = True,
        reported: Callable[[], int] = lambda: Bearing.BEARS,
        waits: Callable[[float, Any], None] = lambda t, command: None,
        grips: Callable[[float], int] = lambda t: Grip.USUAL,
    ) -> None:
        sizes, settings = mission_settings(table, stages, certified, leads=leads)
        self._watches = bool(settings["watches"])
        self.names = [span.name for span in table.phases()]
        self.current = 0
        self.events: list[tuple[float, str]] = []
        self.duration = float(np.sum(settings["length"]))
        self._confirm = self.names.index("confirm")
        self._reported = reported
        self._waits = waits
        self._grips = grips
        self._nr = sizes["NR"]
        inputs = {"t": 1, "u": sizes["NU"], "forces": sizes["NC"], "reported": 1, "sight": 1, "height": 1}
        parts = dict.fromkeys(("phase", "changed", "decision", "bears", "grip", "noticed", "asks", "lost"), 1)
        parts |= {"weights": sizes["NR"]}
        parts |= {"u_min": sizes["NU"], "u_max": sizes["NU"]}
        self._c = Compiled.of_mission(sizes, settings, inputs, parts)
        self.decision: int = LiftDecision.WAITS
        self.bears: int = Bearing.UNKNOWN
        self.grip: int = Grip.USUAL
        self.noticed = 0
        self.lost = 0.0
        self._asks = False

    @property
    def phase(self) -> str:
        """Name of the present phase."""
        return self.names[self.current]

    def enter(self, t: float, controller: Any, plant: Any, phase: int = 0) -> None:
        """Begin a phase, at first the first one."""
        self._step(t, controller, plant.command, phase, height=self._height(plant))

    def advance(self, t: float, controller: Any, plant: Any, command: Any) -> bool:
        """Begin the phases that are due at an instant [s], by the last command; False after the last phase."""
        decided = self.decision
        seen = (self._reported(), int(command.sight))
        goes_on = self._step(t, controller, plant.command, PhaseCall.DUE, 0.0, *seen, self._height(plant))
        waits = self.current == self._confirm
        if self._asks:  # for forces, which take longest
            goes_on = self._step(t, controller, plant.command, PhaseCall.BY_FORCES, command.contact_forces.force, *seen)
            if not waits and (firmest := self._grips(t)) > self.grip:
                what = PhaseCall.RELEASE if firmest == Grip.SETS_DOWN else PhaseCall.SQUEEZE
                self._step(t, controller, plant.command, what)
        if waits or self.decision != decided:
            self._waits(t, command)
        return goes_on

    def _height(self, plant: Any) -> float:
        return float(plant.height) if self._watches else math.nan

    def release(self, t: float, controller: Any, plant: Any, *, at_once: bool = False) -> None:
        """Let the object go: lowered first where it may hang, or ``at_once``."""
        call = PhaseCall.ABORT if at_once else PhaseCall.RELEASE
        self._step(t, controller, plant.command, call)

    def _step(
        self,
        t: float,
        controller: Any,
        before: Array,
        what: int,
        forces: ArrayLike = 0.0,
        reported: int = 0,
        worth: int = 0,
        height: float = math.nan,
    ) -> bool:
        now, u, felt, word, seen, at = self._c.given
        now[0], u[:], felt[:], word[0], seen[0], at[0] = t, before, forces, reported, worth, height
        c = self._c
        goes_on = bool(c.library.cg_step(c.address, c.input_address, what, c.output_address))
        output = c.output.copy()
        phase, changed, decision, bears, grip, noticed, asks = (int(number) for number in output[:7])
        passed = range(self.current + 1, phase + 1) if what < 0 else [phase]
        if what <= PhaseCall.RELEASE or decision == LiftDecision.LETS_GO != self.decision:
            passed = passed[-1:]
        self.events += [(t, self.names[k]) for k in passed]
        self.current = phase
        self.decision = decision
        self.bears = bears
        self.grip = grip
        self.noticed = noticed
        self._asks = bool(asks)
        self.lost = float(output[7])
        if changed:
            weights, low, high = (output[c.parts[name]] for name in ("weights", "u_min", "u_max"))
            controller.change(weights=weights, u_min=low, u_max=high)
        return goes_on

    def rows(self, t: Array, *, of_plan: bool = False) -> Array:
        """Setpoints (T, nr) as they are foreseen now at instants (T,) [s]; at those ``of_plan`` nothing is waited
        for.
        """
        at = np.ascontiguousarray(t, dtype=float)
        rows = np.zeros((at.size, self._nr))
        instants, setpoints = (ctypes.c_void_p(array.ctypes.data) for array in (at, rows))
        self._c.library.cg_rows(self._c.address, instants, at.size, int(of_plan), setpoints)
        return rows
