"""All that the drives, the tendons and the laws of the sections exert on a finger at an instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import islice

from continuum_grasp.model.actuation import Drive
from continuum_grasp.model.laws.ports import SectionForces
from continuum_grasp.model.laws.section import STATEFUL
from continuum_grasp.model.memory import Instant
from continuum_grasp.model.planar import Scalar
from continuum_grasp.model.structure import Structure
from continuum_grasp.model.tendon_forces import Held, TendonForces


class Acting:
    """Generalized forces of drives, tendons and sections, and the rates of their states.

    A finger that moves and one at rest differ in how states are known, and in nothing else. ``drives`` are amplitudes
    of the moments of each source, ``states`` the states by the groups of ``Structure.states``, none of winches at rest.
    ``commands`` go to the winches, None where tendons have a tension ``pulled`` [N].
    """

    def __init__(
        self,
        structure: Structure,
        at: Instant,
        drives: Sequence[Drive],
        states: Mapping[str, Sequence[Scalar]],
        commands: Sequence[Scalar | None],
        pulled: Scalar = 0.0,
    ) -> None:
        self._made, self._drives, self._at, self._lengths = structure, drives, at, at.lengths
        par, winch_states = structure.parameters, iter(states["winches"])
        winches = zip(structure.winches, commands, strict=False)
        held = [Held(winch, command, list(islice(winch_states, winch.states)), pulled) for winch, command in winches]
        sources = zip(structure.sources, drives, strict=True)
        tensions = [drive.moment for source, drive in sources if source.tendon is not None]
        self.tendons = TendonForces(structure, at, held or tensions, states["tendons"])
        rest = par["rest_curvature"] if par.is_runtime("rest_curvature") else None
        self.sections = SectionForces(structure.laws, structure.family, at, states, rest)

    @cached_property
    def actuation(self) -> list[Scalar]:
        """Generalized forces of tendons and of couples that are inputs, equation (42): their work with the shapes."""
        family = self._made.family
        total: list[Scalar] = [0.0] * family.size
        if self._made.own_tendons:
            total = self.tendons.actuation
        for source, drive in zip(self._made.sources, self._drives, strict=True):
            driven = drive.couple if source.tendon is not None else drive.total
            if source.tendon is not None and not source.couples:
                continue
            shapes = [family.work(k, self._lengths, source.shape) for k in range(len(self._lengths))]
            whole = [sum(column) for column in zip(*shapes, strict=True)]
            total = [t + g * driven for t, g in zip(total, whole, strict=True)]
        return total

    @property
    def on_elements(self) -> list[list[Scalar]]:
        """Forces on the local coordinates of each element of what acts by states: none where nothing does."""
        acting = [self.tendons.on_elements] if self._made.own_tendons else []
        if self._made.has_law(*STATEFUL):
            acting.append([[-1.0 * f for f in forces] for forces in self.sections.on_elements(*STATEFUL)])
        return [[sum(forces) for forces in zip(*parts, strict=True)] for parts in zip(*acting, strict=True)]

    @property
    def travel(self) -> list[Scalar]:
        """Travel of each friction state since the unloaded shape: sliding of tendons, bending [1]."""
        return [*self.tendons.slid, *self.sections.travel]
