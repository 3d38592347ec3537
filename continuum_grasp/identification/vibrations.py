"""Frequencies and decay rates of small vibrations about a finger at rest."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.arrays import Array
from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.identification.data import Reading
from continuum_grasp.identification.rows import Resting, symbols
from continuum_grasp.model import FingerModel
from continuum_grasp.simulation.spectrum import poles


class Vibrations:
    """Readings of natural modes, by a number of unknowns.

    InputError, which names the data, if those of this finger are not predicted.
    """

    def __init__(self, model: FingerModel, readings: Sequence[Reading], unknowns: int, name: str) -> None:
        beyond = {
            "on motors": (model.structure.motors, "their inertia swings along"),
            "whose material relaxes": (model.finger.damping.relaxation, "a part of its stiffness follows with a lag"),
        }
        for which, (there, why) in beyond.items():
            if there:
                message = f"frequencies of a finger {which} are not predicted, since {why}: give a trajectory"
                raise InputError(message, key=name)
        self._pencil = _pencil(model)
        self._slopes = self._pencil.forward(unknowns)
        self._readings = [(one.of or 1, one.quantity == "frequency") for one in readings]

    def at(self, resting: Resting) -> tuple[Array, Array]:
        """Predictions (readings,) about a row at rest, and their derivatives (readings, unknowns)."""
        given = resting.q, resting.z
        three = mass, damping, stiffness = [np.array(matrix) for matrix in self._pencil(*given)]
        moved = [np.array(slope) for slope in self._slopes(*given, *three, resting.by_q, resting.by_z)]
        found = {}
        for mode in dict.fromkeys(mode for mode, _ in self._readings):
            pole, left, right = _mode(mass, damping, stiffness, mode)
            # l* (s^2 M + s D + K) r = 0 differentiated: ds = l* (s^2 dM + s dD + dK) r / -(l* (2 s M + D) r); dl and
            # dr drop out, since l and r are null vectors (P. Lancaster, 1964, doi:10.1007/BF01386087)
            turned = (pole**2 * moved[0] + pole * moved[1] + moved[2]).reshape(right.size, -1, right.size)
            change = left.conj() @ (turned @ right) / -(left.conj() @ (2.0 * pole * mass + damping) @ right)
            found[mode, True] = pole.imag / (2.0 * np.pi), change.imag / (2.0 * np.pi)
            found[mode, False] = -pole.real, -change.real
        chosen = [found[one] for one in self._readings]
        return np.array([value for value, _ in chosen]), np.array([slope for _, slope in chosen])


def _pencil(model: FingerModel) -> ca.Function:
    """Mass, damping and stiffness of small motions as a function of q and z = [u, w, p]."""
    q, u, w, p = symbols(model)
    qd, qdd = (ca.SX.sym(name, model.n) for name in ("qd", "qdd"))
    # As it was pulled there.
    pulled = (np.append(np.zeros(len(model.friction_names)), 1.0),) if model.friction_names else ()
    missing = model.inverse_dynamics(q, qd, qdd, u, w, p, *pulled)
    at_rest = [qd, qdd], [ca.SX.zeros(model.n), ca.SX.zeros(model.n)]
    three = [ca.densify(ca.substitute([ca.jacobian(missing, by)], *at_rest)[0]) for by in (qdd, qd, q)]
    return ca.Function("pencil", [q, ca.vertcat(u, w, p)], ca.cse(three), ["q", "z"], ["M", "D", "K"])


def _mode(
    mass: Array, damping: Array, stiffness: Array, number: int
) -> tuple[complex, NDArray[np.complex128], NDArray[np.complex128]]:
    """Pole (rate and pulsation [1/s]), left and right shape of the mode of that number, from 1."""
    found = poles(mass, stiffness, damping)
    # of each pair of conjugates one; those without imaginary part do not vibrate
    ringing = sorted(found[found.imag > 1e-9 * np.abs(found).max()], key=lambda pole: pole.imag)
    if len(ringing) < number:
        raise SolverError(
            f"mode {number} does not ring: only {len(ringing)} of {len(mass)} modes do",
            status="overdamped",
            advice="give another mode, take more elements, or bound damping and stiffness",
        )
    pole = complex(ringing[number - 1])
    # null vectors: the singular vectors of the least singular value
    left, _, right = np.linalg.svd(pole**2 * mass + pole * damping + stiffness)
    return pole, left[:, -1], right[-1].conj()
