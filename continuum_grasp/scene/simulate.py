"""A finger in its surroundings: what simulation, statics and modes need."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from continuum_grasp.scene.consumer import Consumer
from continuum_grasp.scene.finger_scene import Fidelity as Fidelity
from continuum_grasp.scene.finger_scene import LoadedFinger
from continuum_grasp.scene.loads import ObjectLoad, Samples, SupportMotion
from continuum_grasp.scene.methods import INTEGRATORS
from continuum_grasp.scene.surroundings import Surroundings
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Duration, Real, Value

if TYPE_CHECKING:
    Method = str
else:
    Method = Literal["auto", *[name for name, each in INTEGRATORS.items() if each.simulates], "reference"]

MOST_STATES = 10_000_000
"""Output states that a simulation may keep: 1 GB of a dozen doubles each."""


class Timing(Value):
    """Time span, output step and integration method; at most 10 million steps."""

    duration: Annotated[Duration, Field(examples=[2.0, "2 s"])]
    """Duration of the motion [s]."""
    step: Annotated[Duration, Field(examples=[0.001, "1 ms"])]
    """Output step [s]; the integrator takes sub-steps of its own where the scene needs them."""
    method: Method = "auto"
    """auto: rk4, or rodas for a stiff scene (extrapolated_euler with 16 elements or more), with sub-steps that meet
    ``tolerance``. A method by name: with stable sub-steps, and a warning if they do not meet it. reference: variable
    step with error control at 1e-11."""
    tolerance: Annotated[float, Field(ge=1e-10, le=0.1, examples=[1e-4, "0.01 %"]), Unit("1")] = 1e-4
    """Greatest error of position that the steps in time may leave, per length of the finger [1]."""
    space_error: bool = False
    """Whether the error that the elements leave is measured, by a second motion with every element halved, which takes
    longer than the motion; with ``fidelity.tolerance`` it always is."""

    def _check(self) -> None:
        count = self.duration / self.step
        if count > MOST_STATES:
            raise ValueError(
                f"step = {self.step:g} s over {self.duration:g} s asks for {count:.3g} output states; at most "
                f"{MOST_STATES} can be stored: take a longer step (the integrator takes sub-steps of its own) or a "
                "shorter duration"
            )
        self._check_whole("duration", self.duration, self.step, "steps")


_BEYOND_THE_ROD = {
    # Quadratic damping and relaxation have no effect at rest.
    **Consumer.unknown_laws("the exact rod", "finger.stops", "finger.damping.quadratic", "finger.damping.relaxation"),
    "initial.reached_by=state": "the exact rod has no friction cells: expected pulling or releasing",
    "initial.reached_by=path": "the exact rod follows no path: expected pulling or releasing",
}
_EXACT_ROD = Consumer(
    "accuracy by the exact rod",
    refused={"object": "the exact rod touches nothing: leave the object out", **_BEYOND_THE_ROD},
    unneeded={
        **Consumer.LIMITS_OF_BENDING,
        **{f"fidelity.{key}": "accuracy compares them" for key in ("family", "elements", "accuracy")},
        "finger.damping.friction_cells": "there is no dry friction",
        **Consumer.LIMITS_OF_COMMANDS,
        "time": "motions are compared over a second at most, in steps of their own",
    },
)
_TRIED = "is in coordinates of one model, and several are tried: give a pose, or fidelity.family and elements"
_SEVERAL_MODELS = Consumer("accuracy, fidelity.tolerance", {**_BEYOND_THE_ROD, "initial.q": _TRIED})


class Scene(LoadedFinger, Surroundings):
    """One finger with gravity, contacts, loads and, for a simulation, surroundings, initial state and time."""

    REFUSALS = Consumer.refusals(
        """
        {object_load,table_height,support_motion} without object_moves: needs an object that moves: set object_moves
        table_height without table: needs table
        table_height with table.stays: has no effect: an object rests for good on a table that stays
        """
    )

    object_load: ObjectLoad | None = None
    """Pull at a moving object in addition to its weight; None: no pull."""
    table_height: Annotated[Real | Samples, Unit("m")] = 0.0
    """Height of the table over time, along its normal [m]: it sinks away below zero. The object starts as on a table at
    height zero."""
    support_motion: dict[str, SupportMotion] = Field(
        default_factory=dict,
        examples=[{"peg": {"shift": {"times": ["0 s", "1 s"], "values": [["0 mm", "0 mm"], ["10 mm", "0 mm"]]}}}],
    )
    """Motion over time of ``supports`` of ``type: point``, by their names; others stay."""
    time: Timing | None = None
    """Duration and steps of a simulation; None: for statics and modes alone."""

    @property
    def moves(self) -> bool:
        return self.time is not None

    @property
    def moving_supports(self) -> tuple[str, ...]:
        return tuple(self.support_motion)

    def _check(self) -> None:
        round_ones = [peg.name for peg in self.pegs]
        for name in self.support_motion:
            if name not in round_ones:
                raise ValueError(f"support_motion.{name}: expected a support of type: point, got {name!r:.60}")
        if self.fidelity.tolerance is not None:
            self.check_for_several_models()

    def check_for_exact_rod(self) -> None:
        """Refuse keys that the exact rod does not support."""
        _EXACT_ROD.check(self)

    def check_for_several_models(self) -> None:
        """Refuse keys that are of one model, where several are compared with the exact rod."""
        _SEVERAL_MODELS.check(self)
