"""The choices of fidelity that are open to a scene, what each costs, and how wrong it is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from continuum_grasp.base import Array, InputError, SolverError
from continuum_grasp.core import Core
from continuum_grasp.model import MOST_ELEMENTS, RANGES, SHORTEST, FingerModel, element_lengths
from continuum_grasp.scene import FAMILIES, Fidelity, Scene
from continuum_grasp.simulation.accuracy.elements import COUNTS, coordinates_near
from continuum_grasp.simulation.accuracy.truth import STATIONS, TrueCase, Truth
from continuum_grasp.simulation.signals import Signals
from continuum_grasp.simulation.spectrum import spectral_radius
from continuum_grasp.simulation.static_shape import Equilibrium
from continuum_grasp.simulation.statics import equilibrium_under
from continuum_grasp.simulation.vibration import modes_of, relative_errors

ACCURACIES = (1e-2, 2e-3, 1e-4, 1e-6, 1e-9, 1e-13)
"""Accuracies of evaluation [1] that are tried, coarse first; each stands for Horner terms and quadrature nodes."""


@dataclass(frozen=True)
class Choice:
    """A way to model the finger of a scene."""

    scene: Scene
    family: str
    lengths: tuple[float, ...]  # of the elements [m]
    aligned: bool  # whether elements also end at loads, masses and jumps of the rest curvature, not only at contacts
    accuracy: float | None  # of the evaluation, relative; None: the family's own
    bending_range: float  # [rad]

    @property
    def elements(self) -> int:
        return len(self.lengths)

    @property
    def fidelity(self) -> Fidelity:
        """The choice as the ``fidelity`` of a scene."""
        return Fidelity(
            family=self.family, elements=self.lengths, accuracy=self.accuracy, bending_range=self.bending_range
        )

    @cached_property
    def model(self) -> FingerModel:
        """The scene's model with this choice."""
        return FingerModel(self.scene.model_copy(update={"fidelity": self.fidelity}))

    @cached_property
    def instructions(self) -> int:
        """Instructions of the forward dynamics."""
        return self.model.instructions

    @cached_property
    def open(self) -> bool:
        """Whether its elements may have as many quadrature nodes as its accuracy takes, on a taper."""
        try:
            return self.instructions > 0
        except InputError as error:
            if error.key != "elements":
                raise
            return False

    def finest(self, accuracies: Iterable[float]) -> Choice | None:
        """Return a copy with the finest possible of some accuracies; None if none is possible."""
        return next((c for a in sorted(accuracies) if (c := self.with_accuracy(a)).open), None)

    def with_accuracy(self, accuracy: float) -> Choice:
        """A copy with another accuracy of evaluation."""
        return self if accuracy == self.accuracy else replace(self, accuracy=accuracy)

    def __str__(self) -> str:
        even = "" if max(self.lengths) - min(self.lengths) < 1e-9 * sum(self.lengths) else ", uneven"
        terms = "" if self.accuracy is None else f", accuracy {self.accuracy:g}"
        return f"{self.elements} {self.family}{even}{terms}, range {self.bending_range:g} rad"


def open_families(scene: Scene) -> tuple[str, ...]:
    """Return the possible families of a scene, the finest first, or the stated one."""
    if scene.fidelity.family is not None:
        return (scene.fidelity.family,)
    matched = FingerModel(scene.model_copy(update={"fidelity": Fidelity()})).structure.matched
    return tuple(name for name in reversed(FAMILIES) if matched or not FAMILIES[name].matches_tip)


def choices(
    scene: Scene, truth: Truth, family: str, accuracy: float | None, *, counts: Sequence[int] = COUNTS
) -> Iterator[Choice]:
    """All numbers and placements of elements of one family, few elements first.

    The truth says how far elements bend; ``counts`` hold where the scene fixes no number of elements.
    """
    for lengths, aligned in _placements(scene, counts):
        reach = _bending_range(scene, truth, lengths)
        if reach is not None:
            yield Choice(scene, family, lengths, aligned, accuracy, reach)


def _placements(scene: Scene, counts: Sequence[int]) -> Iterator[tuple[tuple[float, ...], bool]]:
    """Yield element lengths, and whether they are aligned; only the stated ones if the scene fixes them."""
    profile = scene.finger.profile
    contacts = scene.contacts
    fixed = scene.fidelity.elements
    if isinstance(fixed, tuple):
        yield element_lengths(profile, contacts, fixed), False
        return
    marks = _marks(scene)
    least = len(contacts) + 1
    if fixed is not None:
        counts = (fixed,)
    elif least > max(counts):
        counts = tuple(count for count in (least, 2 * least) if count <= MOST_ELEMENTS)
    for count in counts:
        # Even elements converge by their order, aligned ones earlier where the curvature has a kink: both are tried.
        if count > len(contacts):
            yield element_lengths(profile, contacts, count), False
        if count > len(marks) > len(contacts):
            yield element_lengths(profile, marks, count), True


def _marks(scene: Scene) -> tuple[float, ...]:
    """Return contacts, and places inside the finger where the curvature or the bending moment has a kink or jumps."""
    length = scene.finger.rod.length
    finger = scene.finger
    places = [load.at for load in (*scene.loads, *scene.initial.held_by)]
    places += [mass.at for mass in finger.masses if mass.mass > 0.0]
    # Kinks of stiffness and rest curvature, as samples have at each of them, cost nothing.
    places += (*finger.profile.bending_stiffness.jumps, *finger.profile.rest_curvature.jumps)
    places += (at for channel in finger.channels for at in channel.shape.breaks)
    marks = list(scene.contacts)
    for at in sorted(places):
        if all(abs(at - other) >= SHORTEST * length for other in (0.0, *marks, length)):
            marks.append(at)
    return tuple(sorted(marks))


def _bending_range(scene: Scene, truth: Truth, lengths: tuple[float, ...]) -> float | None:
    """Return a range that covers the bends of the elements with a margin; None if no range does."""
    bending_range = scene.fidelity.bending_range
    if bending_range is not None:
        return bending_range
    moving = scene.time is not None
    start = 0.0
    wanted = 0.0
    for h in lengths:
        # 1.1: range per reach of the exact rod: a coarse model may bend a little further
        reach = 1.1 * truth.curvature_reach(start, start + h, moving)
        # 9: places along an element; the limit of a taper is greatest at an end
        limit = float(scene.finger.curvature_limit_at(np.linspace(start, start + h, 9)).max())
        wanted = max(wanted, h * min(reach, limit))
        start += h
    # Beyond one turn, more elements are cheaper if their number is open.
    further = wanted if scene.fidelity.elements is not None and wanted <= Fidelity.WIDEST else None
    return next((r for r in RANGES if r >= wanted), further)


@dataclass(frozen=True)
class Errors:
    """Greatest errors of a model against the exact rod over the load cases; infinite where one is not found."""

    tip: float  # of the tip's position, per length
    shape: float  # the same of any place along the finger
    frequencies: Array  # (2,) relative, of the first and the second natural frequency; NaN if it does not exist
    radius: float  # spectral radius about the equilibria [1/s], which limits explicit steps


@dataclass(frozen=True)
class Assessment(Errors):
    """Errors of a choice, and its cost."""

    choice: Choice
    instructions: int  # of the forward dynamics

    @property
    def cost(self) -> float:
        """Instructions: per evaluation, and per second of explicit simulation where the scene moves."""
        # Counted, not timed: the choice is the same on every machine. An explicit step goes with 1 / radius.
        return self.instructions * (self.radius if self.choice.scene.time is not None else 1.0)

    def __str__(self) -> str:
        moves = self.choice.scene.time is not None and not math.isnan(self.frequencies[0])
        frequency = f", first frequency {self.frequencies[0]:.2g}" if moves else ""
        return f"{self.choice}: shape {self.shape:.2g} of the length (tip {self.tip:.2g}){frequency}"

    def within(self, tolerance: float, frequencies: int) -> bool:
        """Whether shape, and of a scene that moves the first frequencies, meet a tolerance."""
        asked = self.frequencies[: frequencies if self.choice.scene.time is not None else 0]
        return self.shape <= tolerance and bool(np.all(asked <= tolerance))


def assess(choice: Choice, truth: Truth, *, stop_at: float = math.inf) -> Assessment:
    """Measure errors and cost of a choice; from an error of shape ``stop_at`` on, the rest is unmeasured (NaN)."""
    scene = choice.scene.model_copy(update={"fidelity": choice.fidelity, "loads": truth.loads})
    errors = errors_of(FingerModel(scene, input_rates=False), truth, moves=scene.time is not None, stop_at=stop_at)
    return Assessment(**vars(errors), choice=choice, instructions=choice.instructions)


def errors_of(model: FingerModel, truth: Truth, *, moves: bool, stop_at: float = math.inf) -> Errors:
    """Return the errors of a model with ``truth.loads``; if it ``moves``, also of its frequencies. See ``assess``."""
    core = Core(model, compiled=False)
    length = model.finger.rod.length
    tip = shape = radius = 0.0
    frequencies = np.zeros(2)
    for true in truth.cases:
        try:
            at_rest = _at_rest(true, model)
        except (SolverError, InputError):
            return Errors(math.inf, math.inf, np.full(2, np.nan), math.inf)
        off = np.linalg.norm(at_rest.backbone(STATIONS) - true.backbone, axis=1) / length
        tip = max(tip, float(off[-1]))
        shape = max(shape, float(off.max()))
        if shape > stop_at:
            return Errors(tip, shape, np.full(2, np.nan), math.nan)
        if true.frequencies_hz is not None and moves:
            # If the first mode is truly unstable, its error is relative to the second one.
            modeled = np.append(modes_of(true.scene, about=at_rest).frequencies_hz, [np.nan, np.nan])[:2]
            frequencies = np.fmax(frequencies, relative_errors(modeled, true.frequencies_hz))
            radius = max(radius, spectral_radius(core, at_rest.q[None], at_rest.u, at_rest.w, at_rest.p))
    if model.n < 2:
        frequencies[1] = np.nan
    return Errors(tip, shape, frequencies, radius)


def _at_rest(true: TrueCase, model: FingerModel) -> Equilibrium:
    """The model's equilibrium, sought from the exact shape."""
    signals = Signals(true.scene, model, true.scene.loads)
    u = signals.u(0.0)[0]
    w = signals.w(0.0)[0]
    guess = coordinates_near(model, true.rod.angle, true.rod.curvature)
    return equilibrium_under(model, u, w, guess=guess, reached_by=true.scene.initial.reached_by or "pulling")
