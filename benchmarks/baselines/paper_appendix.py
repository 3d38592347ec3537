"""The paper's appendix, corrected or as printed, on the benchmarks' finger."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca

from benchmarks.baselines.two_arcs import TwoArcs, arcs
from benchmarks.baselines.two_arcs import forward_dynamics as assemble
from benchmarks.paper import Terms, appendix


def terms(finger: TwoArcs, theta: ca.SX, rate: ca.SX, *, printed: bool = False) -> Terms:
    """Mass matrix, bias, gravity and Jacobians; point masses enter through the Jacobians (A.2)."""
    return appendix.terms(arcs(finger), theta, rate, "printed" if printed else "corrected")


def forward_dynamics(finger: TwoArcs, parameters: Iterable[str] = (), *, printed: bool = False) -> ca.Function:
    """(x, u, w, p) -> xd of ``two_arcs.forward_dynamics`` by the appendix.

    Parameters
    ----------
    printed : bool
        True: the coefficients as printed in the paper; False: corrected.
    """

    def right(described: TwoArcs, theta: ca.SX, rate: ca.SX, at_contact: ca.SX, at_tip: ca.SX) -> tuple[ca.SX, ca.SX]:
        reading = "printed" if printed else "corrected"
        return appendix.right_hand_side(arcs(described), theta, rate, at_contact, at_tip, reading)

    return assemble("appendix_printed" if printed else "appendix", finger, right, parameters)
