"""Natural frequencies of an exact elastic rod about its equilibrium: truth for small motions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array, CheckedArgument, check_arguments
from continuum_grasp.rod.dimensionless import bodies
from continuum_grasp.rod.elastica import Elastica
from continuum_grasp.rod.equations import RodEquations
from continuum_grasp.scene import Finger


@check_arguments
def natural_frequencies(finger: Finger, about: Elastica, count: int = 2) -> Array:
    """Undamped natural frequencies of a finger's rod about an equilibrium.

    The linearized balance of moments at the nodes of the equilibrium's mesh, tested with changes of curvature, against
    the kinetic energy of the same changes: the rod stays inextensible and unshearable and is otherwise exact. Both
    converge with the mesh faster than any power.

    Parameters
    ----------
    finger : Finger
        Rod, point masses and the body at the tip.
    about : Elastica
        Equilibrium of that finger.
    count : int
        Number of frequencies.

    Returns
    -------
    (count,) ndarray
        Increasing [Hz]; zero where the equilibrium is unstable. Under following loads or tendon friction, where two
        modes flutter, their common frequency comes twice.

    Raises
    ------
    InputError
        ``count`` is not between 1 and 1000.

    Examples
    --------
    A straight cantilever has 3.516 sqrt(EI / (rho A L^4)) / (2 pi) = 1.5852 Hz:

    >>> import continuum_grasp as cg
    >>> from continuum_grasp.rod import natural_frequencies, solve_elastica
    >>> scene = cg.Scene(
    ...     finger={"rod": {"length": 0.6, "linear_density": 0.02, "bending_stiffness": 0.0208}},
    ...     gravity=(0.0, 0.0),
    ... )
    >>> natural_frequencies(scene.finger, solve_elastica(scene), 1).round(3)
    array([1.585])
    """
    # 1000: for more, the matrices of 4,000 nodes take gigabytes.
    CheckedArgument("count", count).whole(1, 1000)
    equations, curvature = about.equations, about.nodal_curvature
    # 4: nodes per frequency: each shape has half a wave more than the previous one
    while equations.mesh.size < 4 * count:
        mesh = equations.mesh
        finer = mesh.refined(np.ones(mesh.panels, dtype=bool), mesh.count)
        equations, curvature = RodEquations(equations.problem, finer), mesh.evaluate(curvature, finer.nodes).real
    problem, mesh = equations.problem, equations.mesh
    stiffness = mesh.weights[:, None] * equations.balance(curvature).slope * (problem.stiffness / problem.length)
    if problem.conservative:
        stiffness = 0.5 * (stiffness + stiffness.T)
    # 1 / omega^2 are well conditioned: the largest belong to the lowest modes.
    compliance = np.asarray(np.linalg.solve(stiffness, mass_matrix(finger, equations, curvature)), dtype=float)
    values: NDArray[np.inexact] = np.linalg.eigvals(compliance)
    # Negative ones (instability) first: they are lower than any frequency. 1e-12: part of the greatest up to which the
    # sign is rounding, as of the highest modes of hundreds of nodes.
    unstable = values.real < -1e-12 * np.abs(values).max()
    order = np.argsort(np.where(unstable, -np.inf, -np.abs(values)))
    squares = 1.0 / values[order[:count]]
    return np.sort(np.sqrt(squares.astype(complex)).real) / (2.0 * np.pi)


def mass_matrix(finger: Finger, equations: RodEquations, curvature: Array) -> Array:
    """Twice the kinetic energy of rates of curvature (per L) at the nodes."""
    mesh = equations.mesh
    profile = finger.profile
    length = equations.problem.length
    place = length * mesh.nodes
    # A change of curvature turns what lies beyond: tangents move by i t times the angle, points by its integral.
    turning = 1j * equations.tangents(curvature)[:, None] * mesh.forward
    moving = mesh.forward @ turning
    weights = mesh.weights[:, None]
    linear = profile.linear_density(place)[:, None] * length**3
    rotary = profile.rotary_inertia(place)[:, None] * length
    mass = (moving.conj().T @ (linear * weights * moving)).real
    mass += mesh.forward.T @ (rotary * weights * mesh.forward)
    for body in bodies(finger):
        at = np.array([body.at / length])
        turn = np.array([mesh.integrate(unit, at)[0].real for unit in np.eye(mesh.size)])
        angle = equations.problem.angle + turn @ curvature
        row = turn @ turning + 1j * np.exp(1j * angle) * (body.lever / length) * turn
        mass += body.mass * length**2 * np.outer(row.conj(), row).real + body.rotary_inertia * np.outer(turn, turn)
    return np.asarray(mass)
