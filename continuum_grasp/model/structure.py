"""Structure of a model: elements, family, inputs, forces and their names; resolved once from scene and options."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise
from operator import truediv

import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.model.actuation import InputLayout
from continuum_grasp.model.chain import Place
from continuum_grasp.model.choices import Choices, ModelOptions
from continuum_grasp.model.family import Family, family_class
from continuum_grasp.model.layout import element_lengths, element_ranges, place_at, with_breaks
from continuum_grasp.model.parameters import Parameters, at_tip
from continuum_grasp.scene.families import FAMILIES, ONE_TURN, default_family
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.loads import ForceLoad, Load, MomentLoad, Samples
from continuum_grasp.scene.simulate import Initial, Scene


FEWEST_SWEPT = 16
"""Elements from which on sweeps are taken [1]: with 8 they take 0.8 to 1.1 times the instructions of the dense solution
as one straight program, with 16 half of them; ``python -m benchmarks.bench_elements``."""


class Structure:
    """The resolved structure of a model; arguments and errors as in ``FingerModel``."""

    def __init__(self, finger: Scene | Finger, options: ModelOptions) -> None:
        self.asked = finger, options
        choices = Choices(finger, options)
        try:
            self._resolve(choices)
        except InputError as error:
            raise choices.located(error) from None

    def _resolve(self, choices: Choices) -> None:
        """Set all attributes; errors are keyed by option."""
        scene = choices.scene
        if scene is not None and scene.fidelity.tolerance is not None:
            raise InputError(
                "a tolerance has yet to become a model: take choose_fidelity(scene).scene", key="fidelity.tolerance"
            )
        self.finger = choices.finger
        self.length = self.finger.rod.length
        self.contacts = choices.numbers("contacts") or ()
        self.loads = choices.loads()
        tip_force = choices.switch("tip_force")
        self.tip_force = (scene is None or bool(scene.contacts)) if tip_force is None else tip_force
        gravity = choices.numbers("gravity", 2) or (0.0, -9.81)
        elements = choices.elements()
        self.lengths = element_lengths(self.length, self.contacts, elements)
        # A number that is left open may grow by the places where the curvature has kinks or jumps.
        if elements is None:
            held = () if scene is None else scene.initial.held_by
            continuous = family_class(choices.word("family", FAMILIES) or default_family(free_tip=True)).continuous
            breaks = with_breaks(self.contacts, self.finger, (*self.loads, *held), continuous=continuous)
            self.lengths = element_lengths(self.length, breaks, None)
        self.ranges = element_ranges(self.lengths, choices.number("bending_range"), self.finger.curvature_limit)
        self.parameters = Parameters(self.finger, (gravity[0], gravity[1]), self.lengths, choices.words("parameters"))
        self.accuracy = choices.number("accuracy")
        if self.accuracy is not None and not 1e-16 <= self.accuracy <= 1e-2:
            raise InputError(f"expected a number from 1e-16 to 0.01, got {self.accuracy}", key="accuracy")
        input_rates = choices.switch("input_rates")
        self.family_name = choices.word("family", FAMILIES) or self._default_family(scene, input_rates)
        self.inputs = self._input_layout(input_rates, self._input_varies(scene))
        self.family = self._make_family()
        self.n = self.family.size - (1 if self.matched else 0)
        self._name_entries()
        for k, load in enumerate(self.loads):
            if not 0.0 <= load.at <= self.length * (1 + 1e-9):
                message = f"position {load.at} m is not on the finger of {self.length} m"
                raise InputError(message, key=f"loads[{k}].at")
        if self.parameters.is_runtime("element_lengths") and len(self.finger.curvature_pieces) > 1:
            raise InputError(
                "a piecewise rest curvature needs element_lengths that are not run-time arguments",
                key=f"parameters[{self.parameters.names.index('element_lengths')}]",
            )
        if scene is not None and not choices.given("family", "elements", "contacts", "loads", "parameters"):
            self.check_initial(scene.initial)

    def check_initial(self, initial: Initial) -> None:
        """Raise InputError where coordinates or rates at time zero are not as many as the model has."""
        for name, given in (("q", initial.q), ("qd", initial.qd)):
            if given is not None and len(given) != self.n:
                raise InputError(
                    f"{name} has {len(given)} entries, the {self.family_name} model has {self.n}: "
                    f"{', '.join(self.q_names)}",
                    key=f"initial.{name}",
                )

    @property
    def matched(self) -> bool:
        """Whether the tip's curvature is set by the moment balance there."""
        return FAMILIES[self.family_name].matches_tip

    @property
    def lagged(self) -> bool:
        """Whether the tip moment is a state."""
        return self.finger.tendons is not None and self.finger.tendons.time_constant is not None

    @property
    def moment_is_constant(self) -> bool:
        """Whether the tip moves with its moment, whose rates the model leaves out: it must not vary."""
        return self.matched and not self.inputs.rates and not self.lagged

    @property
    def has_tendon_friction(self) -> bool:
        """Whether tendon friction is modeled."""
        tendons = self.finger.tendons
        return tendons is not None and (tendons.friction > 0.0 or self.parameters.is_runtime("tendon_friction"))

    @property
    def dense_because(self) -> str:
        """Why the equations of motion are solved densely; empty where sweeps along the chain solve them."""
        if len(self.lengths) < FEWEST_SWEPT:
            return f"fewer than {FEWEST_SWEPT} elements"
        if type(self.family).pattern is Family.pattern:
            return f"family {self.family_name} has no pattern for all its links"
        if self.parameters.is_runtime("element_lengths"):
            return "element_lengths at run time"
        for name, place in self.masses():
            if place.fraction != 1.0:
                return f"{name} inside an element"
            if place != self.tip and self.parameters.is_runtime(name):
                return f"{name} at run time"
        return ""

    @property
    def sweeps(self) -> bool:
        """Whether sweeps along the chain solve the equations of motion."""
        return not self.dense_because

    def coordinate_limits(self, lengths: Sequence[float] | None = None) -> list[float]:
        """Greatest absolute value of each coordinate (n) at which no element of these lengths [m] is over its range."""
        return self._limits(self.family.coordinate_size, self.lengths if lengths is None else lengths)[: self.n]

    @property
    def curvature_limits(self) -> list[float]:
        """Greatest absolute values [1/m] of what ``System.curvature`` gives, as far as the bending ranges go."""
        return self._limits(truediv, self.lengths)

    def _limits(self, size: Callable[[float, float], float], lengths: Sequence[float]) -> list[float]:
        per_element = [size(reach, h) for reach, h in zip(self.ranges, lengths, strict=True)]
        # Neighbors may share a coordinate: the tighter one limits it.
        bent = [(limit, self.family.local(k)) for k, limit in enumerate(per_element)]
        return [min(limit for limit, local in bent if a in local) for a in range(self.family.size)]

    @property
    def tip(self) -> Place:
        """The tip section."""
        return Place(len(self.lengths) - 1)

    def on_tip(self, at: float) -> bool:
        """Whether a position is the tip."""
        return at_tip(at, self.length)

    def masses(self) -> list[tuple[str, Place]]:
        """Names and places of the point masses that the model has."""
        runtime, value = self.parameters.is_runtime, self.parameters.__getitem__
        found = [("tip_mass", self.tip)] if runtime("tip_mass") or value("tip_mass") != 0.0 else []
        for k, mass in enumerate(self.finger.masses):
            name = f"mass_{k}"
            if not self.on_tip(mass.at) and (runtime(name) or mass.mass > 0.0):
                found.append((name, place_at(mass.at, self.lengths)))
        return found

    def _default_family(self, scene: Scene | None, input_rates: bool | None) -> str:
        # Matched clothoids are 24 to 3,000 times as accurate as arcs with as many unknowns. A bare finger leaves open
        # whether its tip moment varies, which a matched tip without rates would not follow.
        unknown = scene is None and input_rates is None and not self.lagged
        jumps = scene is not None and scene.time is not None and scene.initial.q is None and tip_moment_jumps(scene)
        free = self.has_tendon_friction or self._tip_couple_varies() or jumps or unknown
        return default_family(free_tip=free)

    def _tip_couple_varies(self) -> bool:
        return any(isinstance(load.moment, Samples) for load in _tip_couples(self.loads, self.length))

    def _input_varies(self, scene: Scene | None) -> bool:
        if self._tip_couple_varies():
            return True
        if scene is None or scene.actuation is None:
            return False
        inputs = scene.actuation.tensions or (scene.actuation.tip_moment,)
        return any(isinstance(value, Samples) for value in inputs)

    def _input_layout(self, input_rates: bool | None, varies: bool) -> InputLayout:
        if self.matched and self.has_tendon_friction:
            raise InputError(
                f"{self.family_name} cannot carry tendon friction (the moment at the tip then depends on the whole "
                f"shape): use family {default_family(free_tip=True)}",
                key="family",
            )
        if input_rates and not self.matched:
            matched = " or ".join(name for name, family in FAMILIES.items() if family.matches_tip)
            raise InputError(
                f"input_rates needs family {matched}; {self.family_name} has no use for them",
                key="input_rates",
            )
        if input_rates and self.lagged:
            raise InputError(
                "input_rates and tendons.time_constant exclude each other: the lag gives the rates", key="input_rates"
            )
        if input_rates is None:
            input_rates = self.matched and varies and not self.lagged
        couples = sum(isinstance(load, MomentLoad) and self.on_tip(load.at) for load in self.loads)
        return InputLayout(self.finger.tendons is not None, couples, input_rates)

    def _make_family(self) -> Family:
        # Quadrature nodes are tabulated up to one turn; the series of arcs reach further.
        for reach in self.ranges:
            if FAMILIES[self.family_name].one_turn and reach > ONE_TURN:
                raise InputError(
                    f"an element of {self.family_name} that bends by up to {reach:.3g} rad is beyond one turn: take "
                    "more elements",
                    key="bending_range",
                )
        return family_class(self.family_name)(len(self.lengths), self.accuracy, self._rest_jumps())

    def _rest_jumps(self) -> list[float]:
        """Jump of the rest curvature at each inner boundary [1/m]."""
        pieces, edges = self.finger.curvature_pieces, accumulate(self.lengths[:-1])
        steps = [(start, after - before) for (_, _, before), (start, _, after) in pairwise(pieces)]
        return [sum(step for at, step in steps if abs(at - edge) <= 1e-9 * self.length) for edge in edges]

    def _name_entries(self) -> None:
        self.q_names = self.family.labels[: self.n]
        self.x_names = self.q_names + [label.replace(" [", "_rate [").replace("]", "/s]") for label in self.q_names]
        if self.lagged:
            self.x_names += ["tip_moment [N m]", "tip_moment_rate [N m/s]"]
        self.u_names = self.inputs.labels
        self.w_names = [f"contact_{k + 1}_{axis} [N]" for k in range(len(self.contacts)) for axis in "xy"]
        if self.tip_force:
            self.w_names += ["tip_x [N]", "tip_y [N]"]
        self.load_entries: list[tuple[str, int]] = []
        next_couple = self.inputs.count - self.inputs.couples
        for k, load in enumerate(self.loads):
            if isinstance(load, MomentLoad) and self.on_tip(load.at):
                self.load_entries.append(("u", next_couple))
                next_couple += 1
                continue
            self.load_entries.append(("w", len(self.w_names)))
            if isinstance(load, ForceLoad):
                axes = ("across", "along") if load.follows else ("x", "y")
                self.w_names += [f"load_{k + 1}_{axis} [N]" for axis in axes]
            else:
                self.w_names.append(f"load_{k + 1}_moment [N m]")


def tip_moment_jumps(scene: Scene) -> bool:
    """Whether the moments on the tip at time zero ask for another curvature there than the initial pose has.

    A matched tip then starts with the curvature of those moments, not with that of the pose.
    """
    length, initial, actuation = scene.finger.rod.length, scene.initial, scene.actuation
    if initial.pose == "equilibrium":
        return bool(_tip_couples(initial.held_by, length))
    moment = sum(_at_zero(load.moment) for load in _tip_couples(scene.loads, length))
    if actuation is not None and actuation.tensions is not None:
        offset = scene.finger.tendons.offset if scene.finger.tendons else 0.0
        moment += (_at_zero(actuation.tensions[0]) - _at_zero(actuation.tensions[1])) * offset
    elif actuation is not None:
        moment += _at_zero(actuation.tip_moment or 0.0)
    curvature = scene.finger.curvature_pieces[-1][2] if initial.pose != "rest" else 0.0
    return moment != 0.0 or curvature != 0.0


def _tip_couples(loads: Sequence[Load], length: float) -> list[MomentLoad]:
    return [load for load in loads if isinstance(load, MomentLoad) and at_tip(load.at, length)]


def _at_zero(value: float | Samples) -> float:
    """The value at time zero, linear between samples: whether it vanishes is all that is asked of it."""
    if not isinstance(value, Samples):
        return value
    return float(np.interp(0.0, value.times, value.values))
