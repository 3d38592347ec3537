"""Winches and motors that wind up tendons: states of a grasp, and what they hold while friction or the object change.

A drive winds up a length ``wound`` of cable of the one tendon, and pays out as much of the other one on a pulley. With
the tensions T of its tendons at their drives and the sign of each,

    load = sum of sign T,    command = wound + servo load,    stretch = T (series + axial times mean share of T)
    stretch = soft(start + sign wound - path)

A position servo holds its command, and a motor under a torque its load. On drives of their own, tendons that do not
pull are let out until they are slack: there, while a grasp is reached, the last row is

    stretch - onset / (1 + (stretch / onset)^4) = start + wound - path

``path`` is how far the bent finger draws the tendon in, from straight on. Lengths are per length of the finger,
tensions are moments at its base, as its pulls are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, Indices
from continuum_grasp.model import Section, soft
from continuum_grasp.nlp import BlockKind, BlockProblem
from continuum_grasp.scene import FingerSetup

if TYPE_CHECKING:
    from continuum_grasp.grasp.rods.numbers import FingerNumbers
    from continuum_grasp.grasp.rods.problem import FingerPlaces

ROUNDED = 1e-9
"""Share of the length by which places along a finger may be rounded [1]."""


@dataclass(frozen=True)
class WoundTendon:
    """A tendon of a drive."""

    pull: int  # its index among the pulls
    sign: float  # of the length that the drive winds up of it
    series: float  # stretch before the finger per pull
    axial: float  # along the finger per pull that is the same all along
    to: float  # where it ends along the finger
    side: float
    arm: float
    rest: float  # slide that the shape at rest draws in, per arm
    slide: int  # place of its slide among the states of tendons
    loss: int | None  # place of its loss; None: it has no friction
    least: float  # pull that is always there


@dataclass(frozen=True)
class DriveNumbers:
    """A drive in units of a finger."""

    tendons: tuple[WoundTendon, ...]
    start: float  # cable wound up at zero
    servo: float  # cable that a servo yields, per load
    onset: float  # half the length between a slack tendon and one in tension
    greatest: float  # load
    locks: bool  # whether it holds its command

    @property
    def holds_pulls(self) -> bool:
        """Whether the drive holds tensions: a motor under a torque that pulls one tendon."""
        return not self.locks and len(self.tendons) == 1


def drives_of(setup: FingerSetup, section: Section) -> tuple[DriveNumbers, ...]:
    """The drives of a finger; none where tensions are commanded."""
    law, names = setup.drive, section.form.sliding_names
    if law is None:
        return ()
    tendons = []
    for k, (pull, tendon) in enumerate(zip(section.pulls, setup.finger.tendon_list, strict=False)):
        assert pull.tendons is not None
        own = f"loss_{pull.tendons + 1}"
        tendons.append(
            WoundTendon(
                pull=k,
                sign=-1.0 if law.pulley and k else 1.0,
                series=law.series * pull.unit / section.length,
                axial=law.axial * pull.unit / section.length,
                to=tendon.end(section.length) / section.length,
                side=pull.side,
                arm=section.moment / pull.unit / section.length,
                rest=section.rest_slides[pull.tendons],
                slide=names.index(f"slide_{pull.tendons + 1}"),
                loss=names.index(own) if own in names else None,
                least=pull.least,
            )
        )
    unit = section.pulls[0].unit
    return tuple(
        DriveNumbers(
            of_drive,
            law.start / section.length,
            law.servo * unit / section.length if law.locks else 0.0,
            law.onset / section.length,
            law.greatest / unit if law.pulley else np.inf,  # tendons of drives of their own have bounds
            law.locks,
        )
        for of_drive in ([tuple(tendons)] if law.pulley else [(tendon,) for tendon in tendons])
    )


@cache
def _stretch_kind(*, slides: bool) -> BlockKind:
    """Row: minus the stretch of a tendon before the finger, or within a stage where it slides."""
    if not slides:
        pull, data = ca.SX.sym("pull"), ca.SX.sym("data", 2)
        least, compliance = ca.vertsplit(data)
        return BlockKind("stretch", pull, data, -compliance * (pull + least))
    unknowns, data = ca.SX.sym("unknowns", 5), ca.SX.sym("data", 4)
    pull, first, last, begin, end = ca.vertsplit(unknowns)
    least, axial, side, share = ca.vertsplit(data)
    half = 0.5 * (last - first)
    # The mean of the exponential of a line is sinh(x) / x times the value in the middle.
    mean = ca.exp(-0.5 * side * (first + last)) * (1.0 + half * half / 6.0)
    return BlockKind("stretch_sliding", unknowns, data, -axial * (pull + least) * mean * share * (end - begin))


@cache
def _wound_kind(*, let_out: bool) -> BlockKind:
    """Row: stretch of a tendon by the length that its drive has wound up."""
    unknowns, data = ca.SX.sym("unknowns", 3), ca.SX.sym("data", 5)
    stretch, wound, slide = ca.vertsplit(unknowns)
    start, sign, arm, rest, onset = ca.vertsplit(data)
    beyond = start + sign * wound - arm * (slide + rest)
    row = stretch - onset / (1.0 + (stretch / onset) ** 4) - beyond if let_out else stretch - soft(beyond, onset)
    return BlockKind("let_out" if let_out else "wound", unknowns, data, row)


@cache
def _sum_kind(count: int) -> BlockKind:
    """Row: sum of unknowns times numbers."""
    unknowns, factors = ca.SX.sym("unknowns", count), ca.SX.sym("factors", count)
    return BlockKind(f"sum_{count}", unknowns, factors, ca.dot(factors, unknowns))


class WoundDrive:
    """A drive in a problem of rods: its unknowns, and the rows that its tendons obey.

    Parameters
    ----------
    problem : BlockProblem
    finger, part
        The finger, and the places of its unknowns.
    index : int
        Of the drive among those of the finger.
    reached : bool
        Whether tendons that do not pull are let out until they are slack; else they pull as the drive holds them.
    """

    def __init__(
        self, problem: BlockProblem, finger: FingerNumbers, part: FingerPlaces, index: int, *, reached: bool
    ) -> None:
        self._problem, self._finger, self._part = problem, finger, part
        self.numbers = drive = finger.drives[index]
        self._label, self._key = f"drive {index}, {finger.name}", f"{finger.setup.where}.tendons.drive"
        self._let_out = reached and len(drive.tendons) == 1
        self.load = problem.unknown(f"load, {self._label}", -drive.greatest, drive.greatest)
        self.wound = problem.unknown(f"wound, {self._label}", -np.inf, np.inf)
        self.command = problem.unknown(f"command, {self._label}", -np.inf, np.inf) if drive.locks else self.wound[:0]
        pulls = self.pulls
        signs = [tendon.sign for tendon in drive.tendons]
        least = sum(tendon.sign * tendon.least for tendon in drive.tendons)
        problem.add(_sum_kind(len(signs) + 1), [*pulls, *self.load], self._row("load", -least), [*signs, -1.0])
        if drive.locks:
            unknowns = [*self.wound, *self.load, *self.command]
            problem.add(_sum_kind(3), unknowns, self._row("command"), [1.0, drive.servo, -1.0])
        if not self._let_out:
            # Stretches are never negative.
            problem.bound(pulls, low=-np.inf)
        self._stretches = [self._stretch(tendon) for tendon in drive.tendons]

    def _row(self, name: str, value: float = 0.0) -> Indices:
        """A row that has a value."""
        return self._problem.rows(f"{name}, {self._label}", self._key, "L", 1, 1.0, value, value).ravel()

    @property
    def pulls(self) -> Indices:
        """Places of the pulls of its tendons."""
        return self._part.pulls[[tendon.pull for tendon in self.numbers.tendons]]

    @property
    def held(self) -> Indices:
        """Places of what stays while friction or the object change."""
        if self.numbers.locks:
            return self.command
        return self.pulls if len(self.numbers.tendons) == 1 else self.load

    def _stretch(self, tendon: WoundTendon) -> tuple[Indices, Indices]:
        """Unknown of the stretch of a tendon, and the row that it makes zero."""
        problem, drive = self._problem, self.numbers
        stretch = problem.unknown(f"stretch {tendon.pull}, {self._label}", -np.inf, np.inf)
        row = self._row(f"stretch {tendon.pull}")
        problem.add(_sum_kind(1), stretch, row, 1.0)
        self._add_stretch(tendon, row)
        data = [drive.start, tendon.sign, tendon.side * tendon.arm, tendon.rest, drive.onset]
        unknowns = [*stretch, *self.wound, self._part.sliding(0)[tendon.slide]]
        problem.add(_wound_kind(let_out=self._let_out), unknowns, self._row(f"wound {tendon.pull}"), data)
        return stretch, row

    def _add_stretch(self, tendon: WoundTendon, row: Indices) -> None:
        """Take the stretch of a tendon off a row: stage by stage where it slides with friction."""
        problem, part, pull = self._problem, self._part, self._part.pulls[tendon.pull]
        alike = tendon.series + (tendon.axial if tendon.loss is None else 0.0)
        problem.add(_stretch_kind(slides=False), pull, row, [tendon.least, alike])
        if tendon.loss is None:
            return
        for span in part.spans:
            if self._finger.section.places[span.piece + 1] > tendon.to + ROUNDED:
                continue
            data = [tendon.least, tendon.axial / tendon.to, tendon.side, 1.0 / span.stages]
            for node in range(span.first + 1, span.first + span.stages + 1):
                losses = [part.sliding(k)[tendon.loss] for k in (node - 1, node)]
                problem.add(_stretch_kind(slides=True), [pull, *losses, *span.ends], row, data)

    def wind(self, x: Array) -> None:
        """Set the unknowns of the drive to what pulls and shape ask for."""
        drive, wound = self.numbers, list[float]()
        for tendon, (stretch, row) in zip(drive.tendons, self._stretches, strict=True):
            x[stretch] = 0.0
            x[stretch] = -self._problem.row_values(x, row)
            length = float(x[stretch][0])
            path = tendon.side * tendon.arm * (x[self._part.sliding(0)[tendon.slide]] + tendon.rest)
            slack = drive.onset / (1.0 + (length / drive.onset) ** 4)
            wound.append(tendon.sign * (length - slack + path - drive.start))
        pulls = [tendon.sign * (x[at] + tendon.least) for at, tendon in zip(self.pulls, drive.tendons, strict=True)]
        x[self.load] = sum(pulls)
        # A pulley winds up the tendon that pulls.
        x[self.wound] = wound[int(np.argmax(x[self.pulls]))]
        x[self.command] = x[self.wound] + drive.servo * x[self.load]
