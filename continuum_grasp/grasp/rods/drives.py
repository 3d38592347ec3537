"""Winches and motors that wind up tendons: states of a grasp, and what they hold while friction or the object change.

A drive winds up a length ``wound`` of cable of the one tendon, and pays out as much of the other one on a pulley. With
the tensions T of its tendons at their drives and the sign of each,

    load = sum of sign T,    command = wound + servo load,    elongation = T (series + axial times mean share of T)
    elongation = soft(start + sign wound - path)

A position servo holds its command, and a motor under a torque its load. On drives of their own, tendons that do not
pull are let out until they are slack: there, while a grasp is reached, the last row is

    elongation - onset / (1 + (elongation / onset)^4) = start + wound - path

``path`` is how far the bent finger draws the tendon in, from straight on. Lengths are per length of the finger,
tensions are moments at its base, as its pulls are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from continuum_grasp.model import Section
from continuum_grasp.scene import FingerSetup


@dataclass(frozen=True)
class WoundTendon:
    """A tendon of a drive."""

    pull: int  # its index among the pulls
    sign: float  # of the length that the drive winds up of it
    series: float  # elongation before the finger per pull
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
        if pull.tendons is None:
            raise ValueError("drives wind up tendons")
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
