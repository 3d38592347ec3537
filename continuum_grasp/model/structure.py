"""Structure of a model: elements, family, inputs, forces and their names; resolved once from scene and options."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from itertools import count
from numbers import Integral
from typing import TypedDict

import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.model.actuation import InputLayout, Lag, MomentSource
from continuum_grasp.model.chain import ChainPlace
from continuum_grasp.model.family import Family, Mesh
from continuum_grasp.model.laws import laws_of
from continuum_grasp.model.laws.ports import PlacedLaw
from continuum_grasp.model.laws.section import STATEFUL, Kind, own_factor
from continuum_grasp.model.layout import (
    element_lengths,
    element_ranges,
    element_spans,
    open_lengths,
    place_at,
    rest_bends,
    with_breaks,
)
from continuum_grasp.model.memory import RETURN_SHARE, Memory
from continuum_grasp.model.parameters import Choices, ModelOptions, Parameters
from continuum_grasp.model.stations import Touches, touching_nothing
from continuum_grasp.model.stumpff_functions import ROUNDING
from continuum_grasp.model.tendon_friction import CellSet, tendon_sets
from continuum_grasp.model.winches import Motor, Winch
from continuum_grasp.scene import (
    FAMILIES,
    Channel,
    Consumer,
    Curve,
    Finger,
    FingerScene,
    ForceLoad,
    Initial,
    Load,
    MomentLoad,
    Samples,
)

_CHOSEN = Consumer("models", {"fidelity.tolerance": "has yet to become a model: take choose_fidelity(scene).scene"})
_RATES = (
    Consumer.beside("input_rates", lambda s: not s.matched, "needs family matched_clothoid"),
    Consumer.beside(
        "input_rates",
        lambda s: s.lagged and not s.couples and not any(s.at_once),
        "and tendons.time_constant exclude each other: the lag gives the rates",
    ),
)


class FrictionHistory(TypedDict, total=False):
    """History by which a finger with friction came to its shape, as ``equilibrium_under`` takes it."""

    reached_by: str
    friction_states: Sequence[float] | None
    path: Sequence[Sequence[float]]


class Structure:
    """The resolved structure of a model; arguments and errors as in ``FingerModel``."""

    def __init__(self, finger: FingerScene | Finger, options: ModelOptions) -> None:
        self.asked = finger, options
        self.touches: Touches = touching_nothing
        self.object_parameters: tuple[str, ...] = ()
        choices = Choices(finger, options)
        try:
            self._resolve(choices)
        except InputError as error:
            raise choices.located(error) from None

    def _resolve(self, choices: Choices) -> None:
        """Set all attributes; errors are keyed by option."""
        scene = choices.scene
        if scene is not None:
            _CHOSEN.check(scene)
        self.finger = choices.finger
        self.length = self.finger.rod.length
        self.contacts = choices.numbers("contacts") or ()
        self.loads: tuple[Load, ...] = tuple(choices["loads"] or ())
        tip_force = choices["tip_force"]
        self.tip_force = (scene is None or bool(scene.contacts)) if tip_force is None else bool(tip_force)
        gravity = choices.numbers("gravity") or (0.0, -9.81)
        if len(gravity) != 2:
            raise InputError(f"expected a list of 2 numbers, got {len(gravity)}", key="gravity")
        elements = choices["elements"]
        if elements is not None:
            elements = int(elements) if isinstance(elements, Integral) else choices.numbers("elements")
        profile, input_rates = self.finger.profile, choices["input_rates"]
        free_tip = bool(self.finger.free_tip_reasons) or (self.finger.moves_with_free_tip and not input_rates)
        self.lengths = element_lengths(profile, self.contacts, elements)
        # A number that is left open may grow by the places where the curvature has kinks or jumps.
        if elements is None:
            held = () if scene is None else scene.initial.held_by
            family = choices.family or FAMILIES.default(free_tip=free_tip)
            # A couple that is an input bends by a known shape there: it needs no element of its own.
            known = [load for load in self.loads if FAMILIES[family].matches_tip and self._is_input(load)]
            loads = [load for load in (*self.loads, *held) if load not in known]
            continuous = Family.named(family).continuous
            breaks = with_breaks(self.contacts, self.finger, loads, continuous=continuous)
            self.lengths = open_lengths(self.finger, breaks)
        self.spans = element_spans(self.lengths, choices["bending_range"], self.finger)
        self.rest_bends = rest_bends(self.lengths, self.finger)
        stated = choices["bending_range"] is not None
        self.ranges = element_ranges(self.spans, self.rest_bends, choices["reached"], stated=stated)
        if self.finger.winches:
            # A range that a shape has asked for is limited, because the scene does not state it.
            self._stay_within_arms(stated=stated and choices["reached"] is None)
        self.parameters = Parameters(
            self.finger, (gravity[0], gravity[1]), self.lengths, tuple(choices["parameters"] or ())
        )
        self.accuracy = choices["accuracy"]
        if self.accuracy is not None and not 1e-16 <= self.accuracy <= 1e-2:
            raise InputError(f"expected a number from 1e-16 to 0.01, got {self.accuracy}", key="accuracy")
        jumps = scene is not None and scene.moves and scene.initial.q is None and scene.tip_moment_jumps
        # A bare finger leaves open whether its tip moment varies, which a matched tip without rates would not follow.
        unknown = scene is None and input_rates is None and not self.lagged
        self.family_name = choices.family or self._default_family(free_tip, unknown, jumps)
        commands = () if scene is None or scene.actuation is None else scene.actuation.values
        # Of what follows its command by a lag, that gives the rates.
        vary = zip(self.at_once, (isinstance(value, Samples) for value in commands), strict=False)
        varies = self.tip_couple_varies or any(map(all, vary))
        self.inputs = self._input_layout(input_rates, varies)
        self.sources = self._sources()
        self.mesh = self._mesh()
        self.family = Family.named(self.family_name)(self.mesh, self.accuracy)
        slack = choices["slack_stiffness"] or 0.0
        self.winches = Winch.of_finger(self.finger, self.parameters, slack)
        self.own_tendons = {source.tendon: source for source in self.sources if source.tendon is not None}
        self.tendon_sets = self._tendon_sets()
        self.laws = tuple(PlacedLaw.on(self.family, law) for law in laws_of(self.finger, self.parameters))
        self.n = self.family.size - len(self.family.known)
        self._name_entries()
        self.finger.rod.check_inside("loads[{}].at", (load.at for load in self.loads))
        if self.parameters.is_runtime("element_lengths"):
            self._check_uniform()
        if scene is not None and not choices.given("family", "elements", "contacts", "loads", "parameters"):
            self.check_initial(scene.initial)

    @property
    def return_time(self) -> float:
        """Time in which friction states come back to their range [s]."""
        return RETURN_SHARE * self.finger.rod.natural_time

    def _check_uniform(self) -> None:
        """Refuse lengths as run-time arguments of a finger that is not the same all along."""
        profile = self.finger.profile
        shapes = [(source.shape, "tendons or couples that end inside") for source in self.sources]
        curves = [(profile.rest_curvature, "a piecewise rest curvature"), *shapes]
        why = next((word for curve, word in curves if curve.constant is None), None)
        if why is not None or profile.graded:
            raise InputError(
                f"{why or 'a graded rod'} needs element_lengths that are not run-time arguments",
                key=f"parameters[{self.parameters.names.index('element_lengths')}]",
            )

    def beside(self, touches: Touches, more: Mapping[str, tuple[str, float]]) -> Structure:
        """A copy of the structure that touches something, of whose run-time arguments unit and value are given."""
        made = copy(self)
        made.touches, made.object_parameters, made.parameters = touches, tuple(more), self.parameters.extended(more)
        return made

    @property
    def touches_object(self) -> bool:
        """Whether there is something that the finger may touch."""
        return self.touches is not touching_nothing

    def _stay_within_arms(self, *, stated: bool) -> None:
        """Limit ranges to bends at which the path of a winch's tendon keeps a positive length; refuse stated ranges
        beyond.
        """
        arm = max(tendon.greatest_offset for tendon in self.finger.tendon_list)
        within = []
        for k, (reach, h) in enumerate(zip(self.ranges, self.lengths, strict=True)):
            bent = float(np.abs(self.rest_bends[:, k]).max())
            if arm * (reach if stated else bent) >= h:
                what, key = ("may bend", "bending_range") if stated else ("is bent at rest", "finger.rest_curvature")
                bent = reach if stated else bent
                raise InputError(
                    f"element {k + 1} {what} by {bent:.3g} rad, to a radius of {h / bent:.3g} m, within the "
                    f"tendons' offset of {arm:.3g} m: expected less",
                    key=key,
                )
            # 0.9: share of the bend at which the path has zero length
            within.append(reach if arm * reach < h else bent + 0.9 * (h / arm - bent))
        self.ranges = tuple(within)

    def check_initial(self, initial: Initial) -> None:
        """Raise InputError where coordinates or rates at time zero are not as many as the model has."""
        for name, entries in (("q", initial.q), ("qd", initial.qd)):
            if entries is not None and len(entries) != self.n:
                raise InputError(
                    f"{name} has {len(entries)} entries, the {self.family_name} model has {self.n}: "
                    f"{', '.join(self.q_names)}",
                    key=f"initial.{name}",
                )

    @property
    def matched(self) -> bool:
        """Whether the tip's curvature is set by the moment balance there."""
        return FAMILIES[self.family_name].matches_tip

    @property
    def lagged(self) -> bool:
        """Whether moments of the tendons are states."""
        return any(channel.time_constant is not None for channel in self.finger.channels)

    @property
    def at_once(self) -> list[bool]:
        """Per input of the finger's own whether it bends without a lag."""
        own = [channel for channel in self.finger.channels if channel.time_constant is not None]
        return [not any(channel.arms[k] for channel in own) for k in range(len(self.finger.inputs))]

    @property
    def moment_is_constant(self) -> bool:
        """Whether the finger moves with known moments, whose rates the model leaves out: they must not vary."""
        return self.matched and not self.inputs.rates and not self.lagged

    @property
    def has_tendon_friction(self) -> bool:
        """Whether tendon friction is modeled."""
        return self.finger.has_tendon_friction or self.parameters.is_runtime("tendon_friction")

    @property
    def _runtime_at_tip(self) -> str:
        """Run-time arguments that a matched tip cannot carry, in words."""
        runtime = self.parameters.is_runtime
        turns = any(runtime(f"tip_body_{key}") for key in ("inertia", "across", "along"))
        return "tendon friction" if runtime("tendon_friction") else "a body at the tip that turns" if turns else ""

    def coordinate_limits(self) -> list[float]:
        """Return the greatest absolute value of each coordinate (n), at the ends of the elements' spans."""
        return self._tightest(self.spans, self.lengths)[: self.n]

    def coordinate_bounds(self, lengths: Sequence[float]) -> tuple[list[float], list[float]]:
        """Return the least and greatest value of each coordinate (n) that keeps all elements, of these lengths [m], in
        range.
        """
        least, greatest = self.rest_bends * (np.array(lengths) / self.lengths)
        lows = self._tightest((self.ranges + least).tolist(), lengths)
        highs = self._tightest((self.ranges - greatest).tolist(), lengths)
        return [-low for low in lows[: self.n]], highs[: self.n]

    def _tightest(self, bends: Sequence[float], lengths: Sequence[float]) -> list[float]:
        """Return the size of each full coordinate that bends an element above rest by its part of ``bends`` [rad]."""
        limits = [math.inf] * self.family.size
        for k, (bend, h) in enumerate(zip(bends, lengths, strict=True)):
            # Neighbors may share a coordinate: the tighter one limits it.
            for a in self.family.local(k):
                limits[a] = min(limits[a], self.family.coordinate_size(bend, h) / self.family.peak(k, a))
        return limits

    def straight(self) -> Array:
        """Coordinates (n) of the straight finger, or near it where the shape at rest is not one of the family's."""
        flat = np.zeros((len(self.lengths), self.family.degree + 1))
        return self.family.coordinates(flat[:, 0], flat)[: self.n]

    @property
    def lagging(self) -> list[tuple[MomentSource, int]]:
        """Sources with a lag, and where in x what lags is."""
        lagging, place = [], 2 * self.n
        for source in self.sources:
            if source.lags:
                lagging.append((source, place))
                place += source.lags
        return lagging

    @property
    def drive_states(self) -> int:
        """Number of states of lags, winches and motors, and of what relaxes."""
        return sum(len(self.states[group]) for group in ("lag", "winches", "relaxation"))

    @property
    def tip(self) -> ChainPlace:
        return ChainPlace(len(self.lengths) - 1)

    def on_tip(self, at: float) -> bool:
        """Whether a position is the tip."""
        return self.finger.rod.is_tip(at)

    def masses(self) -> list[tuple[str, ChainPlace]]:
        """Names and places of the point masses that the model has."""
        runtime, value = self.parameters.is_runtime, self.parameters.__getitem__
        masses = [("tip_mass", self.tip)] if runtime("tip_mass") or value("tip_mass") != 0.0 else []
        for k, mass in enumerate(self.finger.masses):
            name = f"mass_{k}"
            if not self.on_tip(mass.at) and (runtime(name) or mass.mass > 0.0):
                masses.append((name, place_at(mass.at, self.lengths)))
        return masses

    def _default_family(self, free_tip: bool, unknown: bool, jumps: bool) -> str:
        # Matched clothoids are 24 to 3,000 times as accurate as arcs with as many unknowns.
        reasons = free_tip or self._runtime_at_tip or self.tip_couple_varies or jumps or unknown
        return FAMILIES.default(free_tip=bool(reasons))

    @property
    def couples(self) -> list[MomentLoad]:
        """Moments that are inputs."""
        return [load for load in self.loads if isinstance(load, MomentLoad) and self._is_input(load)]

    @property
    def tip_couple_varies(self) -> bool:
        """Whether a moment that is an input varies in time."""
        return any(isinstance(load.moment, Samples) for load in self.couples)

    def _input_layout(self, input_rates: bool | None, varies: bool) -> InputLayout:
        self.finger.check_family("family", self.family_name, self._runtime_at_tip)
        for feature in _RATES:
            feature.check(self, of={"input_rates": bool(input_rates)})
        if input_rates is None:
            input_rates = self.matched and varies
        names, tip = [], count(1)
        for k, load in enumerate(self.loads):
            if self._is_input(load):
                names.append(f"tip_couple_{next(tip)}" if self.on_tip(load.at) else f"load_{k + 1}_moment")
        return InputLayout(self.finger, tuple(names), input_rates and not self.finger.winches)

    def _is_input(self, load: Load) -> bool:
        """Whether the moment of a load is an input: on the tip, and wherever it is asked for."""
        return isinstance(load, MomentLoad) and (load.input or self.on_tip(load.at))

    def _sources(self) -> tuple[MomentSource, ...]:
        """Sources of bending moments, one per shape."""
        length, whole, drives = self.length, Curve.along(self.length, 1.0), len(self.finger.inputs)
        wound, sources = bool(self.finger.winches), list[MomentSource]()
        for k, channel in enumerate(self.channels):
            arms = (*channel.arms, *[0.0] * (drives - len(channel.arms)))
            own = k if self.has_tendon_friction or wound else None
            sources.append(MomentSource(**vars(channel) | {"arms": arms}, tendon=own, wound=wound))
        for _, _, channel, _ in self.finger.pulls[len(self.finger.tendon_list) :]:
            # Of the input, whose last entries are chambers: drives may be fewer than tendons.
            arms = ((0.0,) * drives + channel.arms)[-drives:]
            sources.append(MomentSource(**vars(channel) | {"arms": arms}, chamber=True))
        if not sources:
            sources = [MomentSource(whole, length, (1.0,))]
        for k, load in enumerate(self.couples):
            shape = whole if self.on_tip(load.at) else Curve((0.0, load.at, self.length), ((1.0,), (0.0,)))
            for at, source in enumerate(sources):
                if source.shape == shape:
                    sources[at] = replace(source, couples=(*source.couples, k))
                    break
            else:
                sources.append(MomentSource(shape, length, (0.0,) * drives, couples=(k,)))
        return tuple(sources)

    @property
    def memory(self) -> Memory:
        """Knowledge of friction states in a motion."""
        return Memory(self.return_time)

    @property
    def motors(self) -> tuple[Motor, ...]:
        return tuple(winch for winch in self.winches if isinstance(winch, Motor))

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Shapes of the moments of the tendons; one per tendon where friction or winches make their tensions differ."""
        return self.finger.tendon_channels(apart=self.has_tendon_friction or bool(self.finger.winches))

    def _tendon_sets(self) -> tuple[CellSet, ...]:
        if not self.own_tendons:
            return ()
        frictional, unit_rest = map(self.parameters.is_runtime, ("tendon_friction", "rest_curvature"))
        tendons = self.finger.tendon_list
        return tendon_sets(self.family, self.channels, tendons, frictional=frictional, unit_rest=unit_rest)

    @property
    def cell_sets(self) -> list[CellSet]:
        """Sets of tendons with friction."""
        return [cells for cells in self.tendon_sets if cells.states]

    def has_law(self, *kinds: Kind) -> bool:
        """Whether the sections have a law of one of these kinds."""
        return any(placed.law.kind in kinds for placed in self.laws)

    @property
    def has_stateful_laws(self) -> bool:
        """Whether the sections have dry friction, or a material that relaxes."""
        return self.has_law(*STATEFUL)

    @property
    def is_evaluated_to_rounding(self) -> bool:
        """Whether no accuracy is asked for, and the family then computes in full double precision."""
        return self.accuracy is None and self.family.default_accuracy <= ROUNDING

    @property
    def tendon_friction_states(self) -> int:
        """Number of states of tendon friction, which come first."""
        return len(self.states["tendons"])

    @property
    def friction_states(self) -> int:
        """Number of states of friction: of the tendons, and dry friction in bending."""
        return len(self.friction_names)

    @property
    def stiffest_friction(self) -> tuple[float, ...]:
        """Values of all friction states at which a finger is stiffest: stuck, and sliding; zero alone without any."""
        # 1.5: beyond the range of a friction state [1], as of what slides: it returns to its range
        return (0.0, 1.5) if self.friction_states else (0.0,)

    def stiff_method(self, *, sweeps: bool = False) -> str:
        """Name of the method for stiff motions; ``sweeps``: of many elements, whose Jacobian costs more with each of
        them.

        A step of rodas from rest knows nothing of quadratic damping, whose slope vanishes there, and its later stages
        square what the first one overshoots by; the overshoot of extrapolated_euler is bounded.
        """
        return "extrapolated_euler" if sweeps or self.has_law("damping") else "rodas"

    @property
    def partial_step(self) -> float:
        """Longest step of methods that are implicit in elasticity and damping alone, where it is not adapted [s]."""
        # 760: such steps per natural time of the rod; with 0.1 ms of a hand's finger they resolve contacts, drives, and
        # the quadratic damping of a finger that 40 N accelerate from rest, to 1e-4 of its length
        return (1.0 / 760.0) * self.finger.rod.natural_time

    def _section_states(self, kind: Kind) -> list[str]:
        laws = [placed for placed in self.laws if placed.law.kind == kind]
        return [name for placed in laws for k in range(1, len(placed.ports) + 1) for name in placed.law.names(k)]

    def check_reached_by(self, initial: Initial) -> None:
        """Raise InputError where a pose of a finger with friction, of tendons or in bending, lacks its history."""
        if not self.friction_states:
            return
        if initial.reached_by is None:
            holds = "dry friction holds" if self.finger.damping.dry_friction else "tendons with friction hold"
            raise InputError(
                f"{holds} a finger anywhere between two shapes: state how it got there (pulling, releasing, path with "
                "path, or state with friction_states)",
                key="initial.reached_by",
            )
        states = initial.friction_states
        if states is not None and len(states) != self.friction_states:
            raise InputError(
                f"expected {self.friction_states} entries, one per friction cell "
                f"({', '.join(self.friction_names)}), got {len(states)}",
                key="initial.friction_states",
            )

    def friction_of(self, initial: Initial, *, needed: bool = True) -> FrictionHistory:
        """Friction history that a pose has, if any; InputError where it is ``needed`` and not there."""
        if needed or initial.reached_by is not None:
            self.check_reached_by(initial)
        if initial.reached_by is None or not self.friction_states:
            return {}
        path = [inputs.constants for inputs in initial.path]
        return {"reached_by": initial.reached_by, "friction_states": initial.friction_states, "path": path}

    def _mesh(self) -> Mesh:
        """Elements, with the finger along them."""
        profile, one = self.finger.profile, Curve.along(self.length, 1.0)
        graded = profile.graded
        return Mesh(
            self.lengths,
            self.ranges,
            profile.bending_stiffness if graded else one,
            profile.linear_density if graded else one,
            profile.rotary_inertia if graded else one,
            profile.rest_curvature,
            own_factor(profile),
            tuple(source.shape for source in self.sources),
            self.matched,
        )

    def _name_entries(self) -> None:
        rest = self.finger.profile.rest_curvature
        above = rest.constant != 0.0 or self.parameters.is_runtime("rest_curvature")
        labels = [label.replace(" [", " above rest [") if above else label for label in self.family.labels]
        self.q_names = labels[: self.n]
        rates = [label.replace(" [", "_rate [").replace("]", "/s]") for label in self.family.labels[: self.n]]
        # Name and unit of each state beside coordinates and rates, by whose it is, in their order.
        self.states = {
            "lag": self._lag_names(),
            "winches": [name for k, winch in enumerate(self.winches, start=1) for name in winch.names(k)],
            "relaxation": self._section_states("relaxation"),
            "tendons": [name for k, cells in enumerate(self.cell_sets, start=1) for name in cells.names(k)],
            "friction": self._section_states("friction"),
        }
        self.friction_names = self.states["tendons"] + self.states["friction"]
        self.x_names = self.q_names + rates + [name for names in self.states.values() for name in names]
        self.u_names = self.inputs.labels
        self.w_names = [f"contact_{k + 1}_{axis} [N]" for k in range(len(self.contacts)) for axis in "xy"]
        if self.tip_force:
            self.w_names += ["tip_x [N]", "tip_y [N]"]
        self.load_entries: list[tuple[str, int]] = []
        next_couple = self.inputs.count - len(self.inputs.couples)
        for k, load in enumerate(self.loads):
            if self._is_input(load):
                self.load_entries.append(("u", next_couple))
                next_couple += 1
                continue
            self.load_entries.append(("w", len(self.w_names)))
            if isinstance(load, ForceLoad):
                axes = ("across", "along") if load.follows else ("x", "y")
                self.w_names += [f"load_{k + 1}_{axis} [N]" for axis in axes]
            else:
                self.w_names.append(f"load_{k + 1}_moment [N m]")

    def _lag_names(self) -> list[str]:
        names = list[str]()
        for k, source in enumerate(self.sources):
            name, unit = "tip_moment" if len(self.lagging) == 1 else f"moment_{k + 1}", "N m"
            if source.lags and (source.tendon is not None or source.chamber):
                # A tension or a pressure of its own: that of an input.
                _, name, unit, *_ = self.finger.inputs[np.flatnonzero(source.arms)[0]]
            names += Lag(source.lags).names(f"{name} [{unit}]")
        return names
