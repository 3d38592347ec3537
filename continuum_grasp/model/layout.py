"""Where elements begin and end, and where along them things act."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from numbers import Integral

from continuum_grasp.errors import InputError
from continuum_grasp.model.chain import Place

__all__ = ["DEFAULT_RANGE", "element_lengths", "element_ranges", "place_at"]

DEFAULT_RANGE = 2 * math.pi / 3
"""Bending range of one element where nothing else is said [rad]; equation (44) of the paper."""

_SNAP = 1e-9


def element_lengths(
    length: float, contacts: Sequence[float], elements: int | Sequence[float] | None
) -> tuple[float, ...]:
    """Lengths of the elements, with a boundary at each contact.

    Parameters
    ----------
    length : float
        Length of the finger [m].
    contacts : sequence of float
        Positions of the contacts, increasing [m].
    elements : int, sequence of float or None
        Number of elements, or their lengths; None: two, or one per stretch between contacts where that is more.

    Returns
    -------
    tuple of float
        Lengths from base to tip [m].

    Raises
    ------
    InputError
        If contacts are outside the finger, out of order, or not on a boundary of given lengths, or if there are
        fewer elements than stretches.
    """
    edges = [0.0, *contacts, length]
    if any(not b > a for a, b in itertools.pairwise(edges)):
        raise InputError(f"contacts must increase between 0 and the length {length} m, got {list(contacts)}")
    if elements is not None and not isinstance(elements, int | Integral):
        return _given(length, contacts, [float(h) for h in elements])
    if elements is not None and (isinstance(elements, bool) or elements < 1):
        raise InputError(f"elements: expected a number of elements or their lengths, got {elements!r}")
    stretches = [b - a for a, b in itertools.pairwise(edges)]
    count = max(2, len(stretches)) if elements is None else int(elements)
    if count < len(stretches):
        raise InputError(f"{len(contacts)} contacts need at least {len(stretches)} elements, got {count}")
    shares = [1] * len(stretches)
    for _ in range(count - len(stretches)):
        longest = max(range(len(stretches)), key=lambda k: stretches[k] / shares[k])
        shares[longest] += 1
    return tuple(h / n for h, n in zip(stretches, shares, strict=True) for _ in range(n))


def _given(length: float, contacts: Sequence[float], lengths: list[float]) -> tuple[float, ...]:
    if min(lengths, default=0.0) <= 0.0 or abs(sum(lengths) - length) > _SNAP * length:
        raise InputError(f"element lengths must be positive and add up to {length} m, got {lengths}")
    edges = [sum(lengths[: k + 1]) for k in range(len(lengths))]
    for at in contacts:
        if min(abs(at - e) for e in edges) > _SNAP * length:
            raise InputError(f"the contact at {at} m is not on an element boundary, {[round(e, 9) for e in edges]}")
    return tuple(lengths)


def element_ranges(lengths: Sequence[float], bending_range: float | None, curvature_limit: float) -> tuple[float, ...]:
    """Bending range of each element [rad]: as declared, or the default, or less where the strain limit allows less.

    Raises
    ------
    InputError
        If the declared range is not positive and finite.
    """
    if bending_range is not None:
        if not 0.0 < bending_range < math.inf:
            raise InputError(f"bending_range: expected a positive number of radians, got {bending_range}")
        return tuple(bending_range for _ in lengths)
    return tuple(min(DEFAULT_RANGE, curvature_limit * h) for h in lengths)


def place_at(at: float, lengths: Sequence[float]) -> Place:
    """The section at a position along the finger; at a boundary, the end of the element before it.

    Raises
    ------
    InputError
        If the position is not on the finger.
    """
    total = sum(lengths)
    if not -_SNAP * total <= at <= total * (1 + _SNAP):
        raise InputError(f"position {at} m is not on the finger of {total} m")
    start = 0.0
    for k, h in enumerate(lengths):
        if abs(at - start - h) <= _SNAP * total:
            return Place(k, 1.0)
        if at < start + h:
            return Place(k, max(0.0, (at - start) / h))
        start += h
    return Place(len(lengths) - 1, 1.0)
