"""Ends of elements, and places along them where loads act."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import InputError
from continuum_grasp.model.chain import ChainPlace
from continuum_grasp.scene import (
    ONE_TURN,
    SAME,
    Fidelity,
    Finger,
    ForceLoad,
    Load,
    MomentLoad,
    Panels,
    Profile,
)

WHOLE_RANGE = 8 * math.pi / 3
"""Bending range by default of all elements together [rad]: twice 240 degrees, from five elements on below one
element's. With 32 elements it saves two of eight quadrature nodes."""
_LOOKED = 9
"""Number of places per element that sample thickness and limits of the curvature [1]."""
SHORTEST = 0.02
"""Shortest element that is made for a load, a mass or a jump of the rest curvature, per length of the finger [1]:
shorter ones would raise the highest frequency, which sets the step of explicit integrators (see ``with_breaks``)."""
_LEAST = 1e-6
"""Least length of an element, per length of the finger [1]: its inertia goes with the third power of its length, 1e-18
of the finger's, which is below rounding."""
MOST_ELEMENTS = 128
"""Most elements [1]: four times as many as a tolerance ever chooses, and the expressions grow with the square."""
_FINE = 400
"""Parts of each smooth part of a rod over which its waves are counted [1]: boundaries are then off by 1e-5 of it."""


def element_lengths(
    profile: Profile, contacts: Sequence[float], elements: int | Sequence[float] | None
) -> tuple[float, ...]:
    """Return the lengths of the elements from base to tip [m], with a boundary at each contact [m].

    ``elements`` is their number, or their lengths; None: two, or one per segment between contacts if these are more.
    Between contacts they have equal shares of the integral of (rho A / E I)^(1/4), in inverse proportion to the local
    length of bending waves; a uniform rod has elements of equal length.
    """
    length = profile.length
    edges = [0.0, *contacts, length]
    if any(not b > a for a, b in itertools.pairwise(edges)):
        message = f"contacts must increase between 0 and the length {length} m, got {list(contacts)}"
        raise InputError(message, key="contacts")
    segments = [b - a for a, b in itertools.pairwise(edges)]
    if min(segments) < _LEAST * length:
        message = f"contacts must be {_LEAST:g} of the length {length} m from each other and from both ends"
        raise InputError(f"{message}, got {list(contacts)}", key="contacts")
    if isinstance(elements, Sequence):
        return _given(length, contacts, list(elements))
    count = max(2, len(segments)) if elements is None else elements
    if not 1 <= count <= MOST_ELEMENTS:
        raise InputError(f"expected a number of elements from 1 to {MOST_ELEMENTS}, got {count}", key="elements")
    if count < len(segments):
        message = f"{len(contacts)} contacts need at least {len(segments)} elements, got {count}"
        raise InputError(message, key="elements")
    waves = _Waves(profile)
    counts = [waves.upto(b) - waves.upto(a) for a, b in itertools.pairwise(edges)]
    # Even out: each further element goes to the segment whose elements are longest.
    shares = [1] * len(segments)
    for _ in range(count - len(segments)):
        longest = max(range(len(segments)), key=lambda k: counts[k] / shares[k])
        shares[longest] += 1
    return tuple(h for a, b, n in zip(edges, edges[1:], shares, strict=False) for h in waves.parted(a, b, n))


def open_lengths(finger: Finger, contacts: Sequence[float]) -> tuple[float, ...]:
    """Lengths of elements whose number is open [m]: see `element_lengths`; of a finger with stops up to 16 of them, so
    that none bends by more than one turn where links touch.
    """
    lengths = element_lengths(finger.profile, contacts, None)
    # 16: elements that are chosen for stops at the most: a finger whose links touch so late that these do not suffice
    # is hardly bent so far
    while len(lengths) < 16 and _beyond_stops(finger, lengths).max() > ONE_TURN:
        lengths = element_lengths(finger.profile, contacts, len(lengths) + 1)
    return lengths


def _beyond_stops(finger: Finger, lengths: Sequence[float]) -> NDArray[np.float64]:
    """Return the greatest bends (elements,) that stops require [rad]; zero without stops."""
    stop, ends = finger.stop_curvature, np.cumsum([0.0, *lengths])
    if stop is None:
        return np.zeros(len(lengths))
    at = np.array([np.linspace(a, b, _LOOKED) for a, b in itertools.pairwise(ends)])
    # 1.5: bend per that at which links touch for which a finger with stops is evaluated: 4 to 16 elements of a SpiRob
    # that 8 N curl up within 0.2 s reach 1.4 at the tip of the last one
    return np.asarray(1.5 * stop(at).max(axis=1) * lengths)


class _Waves:
    """The integral of (rho A / E I)^(1/4) along a rod; the position itself where the rod is uniform."""

    def __init__(self, profile: Profile) -> None:
        self._even = profile.uniform
        if self._even:
            return
        s = np.unique(np.concatenate([np.linspace(a, b, _FINE + 1) for a, b in profile.panels()]))
        self._s, self._sum = s, profile.waves(s)

    def upto(self, at: float) -> float:
        """The integral from the base to a position [m]."""
        return at if self._even else float(np.interp(at, self._s, self._sum))

    def parted(self, start: float, end: float, count: int) -> list[float]:
        """Lengths of parts of equal integral [m]."""
        if self._even or count == 1:
            return [(end - start) / count] * count
        targets = np.linspace(self.upto(start), self.upto(end), count + 1)[1:-1]
        edges = [start, *np.interp(targets, self._sum, self._s).tolist(), end]
        return [b - a for a, b in itertools.pairwise(edges)]


def with_breaks(
    contacts: Sequence[float], finger: Finger, loads: Sequence[Load], *, continuous: bool
) -> tuple[float, ...]:
    """Contacts, and where the curvature or its slope jumps: loads, masses, and jumps of the rest curvature.

    Increasing [m], without places too near to another or to an end for an element. A ``continuous`` curvature cannot
    jump at a couple, and rises within a short element around it: a couple of 0.3 EI/L on 2 elements costs 1e-3 of the
    length, with such an element 3e-5 (with a boundary at the couple 2e-3), and the stiffest mode hardly changes.
    """
    length, marks = finger.rod.length, list(contacts)

    def add(*places: float) -> None:
        near = any(
            abs(at - other) < (1.0 - SAME) * SHORTEST * length for at in places for other in (0.0, *marks, length)
        )
        if not near and min(places) > 0.0 and max(places) < length and len(marks) + len(places) < MOST_ELEMENTS:
            marks.extend(places)

    # Of two that are too near for an element, the first one stays: jumps of the curvature before jumps of its slope.
    profile = finger.profile
    mechanics = (profile.rest_curvature, profile.bending_stiffness, profile.linear_density)
    for at in sorted({at for curve in mechanics for at in curve.jumps}):
        add(at)
    for load in loads:
        if isinstance(load, MomentLoad) and continuous:
            taken = any(abs(load.at - other) <= SAME * length for other in marks)
            half = (1.0 if taken else 0.5) * SHORTEST * length
            add(load.at - half, load.at + half)
        elif isinstance(load, MomentLoad):
            add(load.at)
    for at in (load.at for load in loads if isinstance(load, ForceLoad)):
        add(at)
    for mass in finger.masses:
        if mass.mass > 0.0:
            add(mass.at)
    return tuple(sorted(marks))


def _given(length: float, contacts: Sequence[float], lengths: list[float]) -> tuple[float, ...]:
    if min(lengths, default=0.0) < _LEAST * length or abs(sum(lengths) - length) > SAME * length:
        message = f"element lengths must be positive and add up to {length} m, got {lengths}"
        raise InputError(message, key="elements")
    if len(lengths) > MOST_ELEMENTS:
        raise InputError(f"expected the lengths of up to {MOST_ELEMENTS} elements, got {len(lengths)}", key="elements")
    edges = [sum(lengths[: k + 1]) for k in range(len(lengths))]
    for k, at in enumerate(contacts):
        if min(abs(at - e) for e in edges) > SAME * length:
            message = f"the contact at {at} m is not on an element boundary, {[round(e, 9) for e in edges]}"
            raise InputError(message, key=f"contacts[{k}]")
    return tuple(lengths)


def element_spans(lengths: Sequence[float], bending_range: float | None, finger: Finger) -> tuple[float, ...]:
    """Return the greatest bend of each element from its shape at rest [rad], as declared or by default.

    By default, a finger of many elements bends by 240 degrees in total, and each element by up to twice its share. The
    share of an element is in proportion to its length per thickness; with stops, to its bend at which links touch. A
    strain limit may reduce it.
    """
    if bending_range is not None:
        if not 0.0 < bending_range <= Fidelity.WIDEST:
            message = f"expected a positive number of radians, up to {Fidelity.WIDEST:g}, got {bending_range}"
            raise InputError(message, key="bending_range")
        return tuple(bending_range for _ in lengths)
    ends = np.cumsum([0.0, *lengths])
    at = np.array([np.linspace(a, b, _LOOKED) for a, b in itertools.pairwise(ends)])
    # Where an element is thinnest: that it is strained too much elsewhere is not for its evaluation to say.
    limits = finger.curvature_limit_at(at).max(axis=1)
    stop, thickness = finger.stop_curvature, finger.profile.half_thickness
    if stop is not None and stop.constant is None:
        sharpness = stop(at).mean(axis=1)
    elif thickness.constant is None and np.all(thickness(at) > 0.0):
        sharpness = (1.0 / thickness(at)).mean(axis=1)
    else:
        sharpness = np.ones(len(lengths))
    parts = sharpness * lengths
    # A long element among short ones has more than its share of the number.
    shares = np.maximum(1.0 / len(lengths), parts / parts.sum())
    allowed = np.minimum(WHOLE_RANGE * shares, Fidelity.DEFAULT_RANGE)
    allowed = np.maximum(allowed, np.minimum(_beyond_stops(finger, lengths), Fidelity.WIDEST))
    return tuple(np.minimum(allowed, limits * lengths).tolist())


def rest_bends(lengths: Sequence[float], finger: Finger) -> NDArray[np.float64]:
    """Return the least and greatest rest curvature on each element, times its length (2, elements) [rad]."""
    rest, whole = finger.profile.rest_curvature, finger.rod.length
    extremes = []
    for a, b in itertools.pairwise([0.0, *itertools.accumulate(lengths)]):
        parts = [np.linspace(*part, _LOOKED) for part in Panels.of(whole, (rest,), a, b)]
        # At a jump take both sides, each from inside.
        values = np.concatenate([side for s in parts for side in (rest(s[:-1], tip_side=True), rest(s[1:]))])
        extremes.append((values.min(), values.max()))
    return np.asarray(np.array(extremes).T * np.asarray(lengths))


def element_ranges(
    spans: Sequence[float], rest: NDArray[np.float64], reached: Sequence[float] | None, *, stated: bool
) -> tuple[float, ...]:
    """Return the greatest bend [rad] that each element covers, including its bend at rest.

    It equals the span if the shape at ``rest``, from `rest_bends`, takes less than half of it (or less than all of a
    ``stated`` span); otherwise half of the span remains on both sides of that shape. A shape that has ``reached``
    further extends it.
    """
    bent = np.abs(rest).max(axis=0)
    # 0.5: slightly preshaped fingers have as many terms and nodes as straight ones, and all can bend further.
    taken = bent if stated else 2.0 * bent
    ranges = np.where(taken < spans, spans, bent + 0.5 * np.array(spans))
    return tuple((ranges if reached is None else np.maximum(ranges, reached)).tolist())


def place_at(at: float, lengths: Sequence[float]) -> ChainPlace:
    """The section at a position along the finger [m]; at a boundary, the end of the element before it."""
    total = sum(lengths)
    if not -SAME * total <= at <= total * (1 + SAME):
        raise InputError(f"position {at} m is not on the finger of {total} m")
    start = 0.0
    for k, h in enumerate(lengths):
        if abs(at - start - h) <= SAME * total:
            return ChainPlace(k, 1.0)
        if at < start + h:
            return ChainPlace(k, max(0.0, (at - start) / h))
        start += h
    return ChainPlace(len(lengths) - 1, 1.0)
