"""Rows of winches and motors that wind up tendons; `drives.py` has their equations."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, Indices
from continuum_grasp.grasp.rods.drives import WoundTendon
from continuum_grasp.grasp.rods.numbers import FingerNumbers
from continuum_grasp.grasp.rods.places import FingerPlaces
from continuum_grasp.model import soft
from continuum_grasp.nlp import BlockKind, BlockProblem

ROUNDED = 1e-9
"""Share of the length by which places along a finger may be rounded [1]."""


@cache
def _elongation_kind(*, slides: bool) -> BlockKind:
    """Row: minus the elongation of a tendon before the finger, or within a stage where it slides."""
    if not slides:
        pull, data = ca.SX.sym("pull"), ca.SX.sym("data", 2)
        least, compliance = ca.vertsplit(data)
        return BlockKind("elongation", pull, data, -compliance * (pull + least))
    unknowns, data = ca.SX.sym("unknowns", 5), ca.SX.sym("data", 4)
    pull, first, last, begin, end = ca.vertsplit(unknowns)
    least, axial, side, share = ca.vertsplit(data)
    half = 0.5 * (last - first)
    # The mean of the exponential of a line is sinh(x) / x times the value in the middle.
    mean = ca.exp(-0.5 * side * (first + last)) * (1.0 + half * half / 6.0)
    return BlockKind("elongation_sliding", unknowns, data, -axial * (pull + least) * mean * share * (end - begin))


@cache
def _wound_kind(*, let_out: bool) -> BlockKind:
    """Row: elongation of a tendon by the length that its drive has wound up."""
    unknowns, data = ca.SX.sym("unknowns", 3), ca.SX.sym("data", 5)
    elongation, wound, slide = ca.vertsplit(unknowns)
    start, sign, arm, rest, onset = ca.vertsplit(data)
    beyond = start + sign * wound - arm * (slide + rest)
    row = (
        elongation - onset / (1.0 + (elongation / onset) ** 4) - beyond if let_out else elongation - soft(beyond, onset)
    )
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
        Place of the drive among the finger's drives.
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
            # Elongations are never negative.
            problem.bound(pulls, low=-np.inf)
        self._elongations = [self._elongation(tendon) for tendon in drive.tendons]

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

    def _elongation(self, tendon: WoundTendon) -> tuple[Indices, Indices]:
        """Unknown of the elongation of a tendon, and the row that it makes zero."""
        problem, drive = self._problem, self.numbers
        elongation = problem.unknown(f"elongation {tendon.pull}, {self._label}", -np.inf, np.inf)
        row = self._row(f"elongation {tendon.pull}")
        problem.add(_sum_kind(1), elongation, row, 1.0)
        self._add_elongation(tendon, row)
        data = [drive.start, tendon.sign, tendon.side * tendon.arm, tendon.rest, drive.onset]
        unknowns = [*elongation, *self.wound, self._part.sliding(0)[tendon.slide]]
        problem.add(_wound_kind(let_out=self._let_out), unknowns, self._row(f"wound {tendon.pull}"), data)
        return elongation, row

    def _add_elongation(self, tendon: WoundTendon, row: Indices) -> None:
        """Take the elongation of a tendon off a row: stage by stage where it slides with friction."""
        problem, part, pull = self._problem, self._part, self._part.pulls[tendon.pull]
        alike = tendon.series + (tendon.axial if tendon.loss is None else 0.0)
        problem.add(_elongation_kind(slides=False), pull, row, [tendon.least, alike])
        if tendon.loss is None:
            return
        for span in part.spans:
            if self._finger.section.places[span.piece + 1] > tendon.to + ROUNDED:
                continue
            data = [tendon.least, tendon.axial / tendon.to, tendon.side, 1.0 / span.stages]
            for node in range(span.first + 1, span.first + span.stages + 1):
                losses = [part.sliding(k)[tendon.loss] for k in (node - 1, node)]
                problem.add(_elongation_kind(slides=True), [pull, *losses, *span.ends], row, data)

    def wind(self, x: Array) -> None:
        """Set the unknowns of the drive to what pulls and shape ask for."""
        drive, wound = self.numbers, list[float]()
        for tendon, (elongation, row) in zip(drive.tendons, self._elongations, strict=True):
            x[elongation] = 0.0
            x[elongation] = -self._problem.row_values(x, row)
            length = float(x[elongation][0])
            path = tendon.side * tendon.arm * (x[self._part.sliding(0)[tendon.slide]] + tendon.rest)
            slack = drive.onset / (1.0 + (length / drive.onset) ** 4)
            wound.append(tendon.sign * (length - slack + path - drive.start))
        pulls = [tendon.sign * (x[at] + tendon.least) for at, tendon in zip(self.pulls, drive.tendons, strict=True)]
        x[self.load] = sum(pulls)
        # A pulley winds up the tendon that pulls.
        x[self.wound] = wound[int(np.argmax(x[self.pulls]))]
        x[self.command] = x[self.wound] + drive.servo * x[self.load]
