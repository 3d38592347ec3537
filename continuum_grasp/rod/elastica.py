"""The exact equilibrium of a planar elastic rod: truth for statics, independent of the finger model.

1. A first mesh: panels between breaks, short enough for the loads and for what changes along the rod.
2. From the rest shape follow the equilibrium as all loads grow together, round folds (pseudo-arclength); a guess, where
   there is one, takes the place of the path.
3. Where that ends unstable, or is lost, descend the energy.
4. Refine: halve the panels that do not resolve the shape, solve by Newton's method, until two meshes agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError, SolverError, check_arguments
from continuum_grasp.rod.dimensionless import RodProblem, read_problem
from continuum_grasp.rod.equations import BEND_ROUNDING, RodEquations
from continuum_grasp.rod.equilibrium_path import descend, follow, newton, weakest
from continuum_grasp.scene import Load, Scene

Guess = Callable[[Array], ArrayLike] | ArrayLike

_COARSE, _FINE = 10, 16
"""Nodes per panel while the shape is sought, and while it is refined: a panel that bends by 1 rad is then exact to 1e-9
and to rounding."""
_MAX_NODES = 1600
"""Unknowns of the dense equations: a Newton step then takes some tenths of a second."""
_SHARES = 0.75, 0.5, 0.25
"""Shares of the pull at which sections that slide back are sought [1]."""
_ONE_WAY = "friction of the exact rod counts as if tendons slid one way"
_ROUNDING = 16.0 * np.finfo(float).eps
"""Rounding of angles and positions, which are sums over the nodes [1]."""


@dataclass(frozen=True)
class Elastica:
    """A rod at rest. Lengths are measured from the base; planar vectors and angles are the world's.

    Attributes
    ----------
    energy : float
        Elastic energy above the rest shape, less the work of weight, dead forces and couples (forces: from the world's
        origin; couples and actuation: from the straight rod) [J]; work of following forces or tendon friction has no
        potential and is not included.
    elastic_energy : float
        Elastic energy above the rest shape [J].
    stable : bool or None
        Whether the second variation of the energy is positive; None where loads have no potential.
    margin : float
        Least eigenvalue of the second variation in the metric of the integral of EI (change of curvature)^2 [1]; 1
        without loads, 0 at a critical load; of its symmetric part where loads have no potential.
    error : float
        Estimated error of the position of the tip, and of the ends of all panels [m].
    nodes : int
        Collocation nodes of the finer of the two meshes that agree.
    iterations : int
        Steps of Newton's method, of the path and of the descent.
    equations : RodEquations
        The balance on the finer mesh, in dimensionless numbers.
    nodal_curvature : (nodes,) ndarray
        Curvature times length at its nodes [rad].
    warnings : tuple of str
        Sections along which tendons with friction slide back while they are pulled.
    """

    energy: float
    elastic_energy: float
    stable: bool | None
    margin: float
    error: float
    nodes: int
    iterations: int
    equations: RodEquations
    nodal_curvature: Array
    warnings: tuple[str, ...] = ()

    @classmethod
    def deformed(cls, problem: RodProblem, curvature: Callable[[Array], Array], *, tolerance: float = 1e-6) -> Elastica:
        """The equilibrium, stable or not, into which a shape deforms when the couples that hold it are taken away.

        The curvature [1/m] of the shape is a function of lengths (n,) [m]; the tolerance is for positions, per
        length. Raises SolverError where the way there ends at a fold or is lost.
        """
        equations = _first_equations(problem)
        start = problem.length * curvature(problem.length * equations.mesh.nodes)
        state, steps = follow(equations, start, loads=False, folds=False)
        return _refine(equations, state, steps, tolerance, 0)

    def curvature(self, s: ArrayLike) -> Array:
        """Curvature [1/m] at lengths (...,) [m]; where it jumps, the value on the far side."""
        at, shape = self._local(s)
        value = self.equations.mesh.evaluate(self.nodal_curvature, at).real / self._problem.length
        return value.reshape(shape)

    def angle(self, s: ArrayLike) -> Array:
        """Angles [rad] from the world's axes to the sections' at lengths (...,) [m]; (-sin, cos) is the tangent."""
        at, shape = self._local(s)
        value = self._problem.angle + self.equations.mesh.integrate(self.nodal_curvature, at).real
        return np.asarray(value.reshape(shape))

    def position(self, s: ArrayLike) -> Array:
        """Positions (..., 2) in the world [m] at lengths (...,) [m]."""
        at, shape = self._local(s)
        tangents = self.equations.tangents(self.nodal_curvature)
        place = self._problem.base + self._problem.length * self.equations.mesh.integrate(tangents, at)
        return np.stack([place.real, place.imag], axis=-1).reshape(*shape, 2)

    @property
    def tip(self) -> Array:
        """Position (2,) of the tip in the world [m]."""
        return self.position(self._problem.length)

    @property
    def _problem(self) -> RodProblem:
        return self.equations.problem

    def _local(self, s: ArrayLike) -> tuple[Array, tuple[int, ...]]:
        """Lengths per L in one row, and the shape in which they came."""
        at = CheckedArgument("s", s).array().reshape(np.shape(s)) / self._problem.length
        if not np.all((at >= -1e-12) & (at <= 1.0 + 1e-12)):
            raise InputError(f"s: expected lengths between 0 and {self._problem.length} m")
        return at.ravel(), at.shape


@check_arguments
def solve_elastica(
    scene: Scene,
    *,
    tolerance: float = 1e-10,
    guess: Guess | None = None,
    stable: bool = True,
    side: int = 1,
    extra_loads: Sequence[Load] = (),
) -> Elastica:
    """The equilibrium of an inextensible, unshearable elastic rod under a scene's loads at time zero.

    Own weight, point masses, dead and following forces, couples, the moment of tip or tendons (with friction: the
    capstan law along the bent backbone, rounded off where it is straight, by what slid since the loads alone bent the
    rod; ``warnings`` name sections that slide back meanwhile) and the rest curvature are taken without further
    approximation; the balance of moments is solved by collocation
    of high order on panels that are refined until two meshes agree. Stiffness, density, rest curvature and tendon
    offsets may change along the rod and jump.

    Without a guess the equilibrium is followed from the unloaded shape while all loads grow together. Given a guess,
    the equilibrium near it is sought: the minimum of the energy below it, or with ``stable=False``, or where loads have
    no potential, any equilibrium.

    Parameters
    ----------
    scene : Scene
        The scene; ``fidelity``, ``contacts``, ``parameters`` and ``time`` have no effect; in ``initial`` only
        ``reached_by`` has one, on tendons with friction.
    tolerance : float
        Greatest estimated error of position, per length.
    guess : callable or (K,) array_like, optional
        World angles of the sections [rad]: as a function of lengths (n,) [m], such as ``Elastica.angle``, or at K > 1
        equally spaced places from base to tip. Chooses the branch.
    stable : bool
        Whether to leave an unstable equilibrium for a nearby stable one, if the loads have a potential.
    side : {1, -1}
        Side to which an unstable equilibrium is left: the sense in which its weakest direction turns the tip.
    extra_loads : sequence of loads
        Loads that act besides the scene's.

    Returns
    -------
    Elastica

    Raises
    ------
    InputError
        If tolerance, guess, side or a load do not fit.
    SolverError
        If no equilibrium is reached, or not to the tolerance.

    Notes
    -----
    Axial strain, shear and contact of the rod with itself are not modeled. See ``RodEquations`` for the balance,
    ``PanelMesh`` for the collocation, and S. S. Antman, Nonlinear Problems of Elasticity, 2005,
    doi:10.1007/0-387-27649-1.

    Examples
    --------
    A moment of 2 pi EI / L at the tip closes the rod to a circle:

    >>> import math
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.rod import solve_elastica
    >>> scene = cg.Scene(
    ...     finger={"rod": {"length": 0.2, "linear_density": 0.03, "bending_stiffness": 0.006}},
    ...     actuation={"tip_moment": 2 * math.pi * 0.006 / 0.2},
    ...     gravity=(0.0, 0.0),
    ... )
    >>> rod = solve_elastica(scene)
    >>> bool(abs(rod.tip).max() < 1e-10)
    True
    """
    tolerance = CheckedArgument("tolerance", tolerance).number(1e-13, 1e-2)
    CheckedArgument("side", side).choice((1, -1))
    problem = read_problem(scene, extra_loads)
    if problem.has_friction and problem.loaded:
        # Sliding starts in the shape under the loads before the pull or, if the loads permit no equilibrium, at rest.
        with suppress(SolverError):
            loaded = _solved(problem.unpulled, None, tolerance, stable, side)
            problem = replace(problem, slid_from=loaded.curvature)
    found = _solved(problem, guess, tolerance, stable, side)
    pulls = problem.has_friction and scene.initial.reached_by != "releasing"
    return replace(found, warnings=_slid_back(found)) if pulls else found


def _slid_back(found: Elastica) -> tuple[str, ...]:
    """Return a warning if sections slide back before the pull of a rod is complete.

    Friction has no memory here: it follows from the sliding between the first shape and the last one.
    """
    problem, mesh, curvature = found.equations.problem, found.equations.mesh, found.nodal_curvature
    last, furthest = found.equations.slid(curvature), 0.0
    for share in _SHARES:
        try:
            curvature, _, _ = newton(RodEquations(problem.pulled(share), mesh), curvature)
        except SolverError:
            return (f"{_ONE_WAY}: {share:.0%} of the pull have no shape near that of the full pull",)
        slid = found.equations.slid(curvature)
        furthest = max(furthest, float(np.minimum(np.abs(slid), np.sign(slid) * (slid - last)).max()))
    # Below the range in which friction turns, it returns to where it was.
    if furthest < BEND_ROUNDING:
        return ()
    return (f"{_ONE_WAY}: sections slide back by up to {furthest:.2g} rad of bend during the pull",)


def _solved(problem: RodProblem, guess: Guess | None, tolerance: float, stable: bool, side: int) -> Elastica:
    """Find the equilibrium of a problem; arguments as in ``solve_elastica``."""
    equations = _first_equations(problem)
    descends = stable and problem.conservative
    curvature, iterations = _find(equations, guess, descends, side)
    return _refine(equations, curvature, iterations, tolerance, side if descends else 0)


def _first_equations(problem: RodProblem) -> RodEquations:
    """On panels between breaks, no longer than what forces and moments bend by an angle of about one."""
    forces = [problem.weight, *(value for _, value in (*problem.dead, *problem.following))]
    # Panels that bend by about a radian: forces turn the elastica over a length sqrt(EI / F), moments over EI / M.
    longest = min(0.5, 1.5 / math.sqrt(max(sum(abs(f) for f in forces), 1e-9)))
    if longest < _FINE / _MAX_NODES:
        raise _too_many("the loads bend the rod on too small a scale; check their units")
    equations = RodEquations.on_panels(problem, longest, _COARSE)
    while True:
        # Shorter where the rod itself changes steeply.
        # 2.5: turn [rad] of a panel of the first mesh, at most, as far as moments say: some load always undoes part of
        # it
        # 1e-6: turn of a panel [rad] that the first mesh may miss where the rod changes along its length, see
        # ``unresolved``: far below what the shape needs that is then refined
        long = (equations.panel_turns() > 2.5) | (equations.unresolved(equations.rest) > 1e-6)
        if equations.mesh.size + _COARSE * long.sum() > _MAX_NODES:
            raise _too_many("the loads bend the rod on too small a scale; check their units")
        if not long.any():
            return equations
        equations = RodEquations(problem, equations.mesh.refined(long, _COARSE))


def _find(equations: RodEquations, guess: Guess | None, descends: bool, side: int) -> tuple[Array, int]:
    """Curvature near the equilibrium that is wanted, on the first mesh."""
    if guess is not None:
        start = _guessed(equations, guess)
        if descends:
            return descend(equations, start, side)
        try:
            start, _, iterations = newton(equations, start)
        except SolverError:
            return _follow(equations, start, loads=False)
        return start, iterations
    # Along the loads from the rest shape; where that path is lost or ends unstable, down the energy.
    start = equations.rest
    iterations = 0
    try:
        start, iterations = _follow(equations, start, loads=True)
    except SolverError:
        if not descends:
            raise
    else:
        if not descends or weakest(equations, start) > 0.0:
            return start, iterations
    start, more = descend(equations, start, side)
    return start, iterations + more


def _follow(equations: RodEquations, start: Array, *, loads: bool) -> tuple[Array, int]:
    """To the end of a path, and onto it."""
    curvature, steps = follow(equations, start, loads=loads)
    curvature, _, more = newton(equations, curvature)
    return curvature, steps + more


def _guessed(equations: RodEquations, guess: Guess) -> Array:
    """Curvature of a guessed shape at the nodes."""
    problem = equations.problem
    if callable(guess):
        places = np.linspace(0.0, 1.0, 257)
        angles = CheckedArgument("guess", guess(places * problem.length)).array()
    else:
        angles = CheckedArgument("guess", guess).array()
        places = np.linspace(0.0, 1.0, max(angles.size, 2))
    if angles.shape != places.shape or not np.all(np.isfinite(angles)):
        raise InputError(f"guess: expected finite angles at two or more places, got an array of shape {angles.shape}")
    # A guessed angle is rough: its mean slopes between the places, linear between their middles.
    middles = 0.5 * (places[:-1] + places[1:])
    return np.interp(equations.mesh.nodes, middles, np.diff(angles) / np.diff(places))


def _refine(equations: RodEquations, start: Array, iterations: int, tolerance: float, side: int) -> Elastica:
    """Finer meshes until two agree."""
    curvature, noise, steps = newton(equations, start)
    iterations += steps
    # 16: halvings of a panel, down to 1e-5 of the length: the capstan law is rounded off over some 1e-4 of it
    for _ in range(16):
        mesh, problem = equations.mesh, equations.problem
        floor = _ROUNDING * (1.0 + np.abs(curvature).max())
        # Halve what is not resolved; where all is, more nodes show that the error of the last mesh was small.
        marked = equations.unresolved(curvature) > max(tolerance, floor)
        finer = mesh.refined(marked, _FINE if mesh.count == _COARSE or marked.any() else mesh.count + 4)
        if finer.size > _MAX_NODES:
            raise _too_many("raise the tolerance, or check the units of the loads")
        before = mesh.to_edges(equations.tangents(curvature))[np.isin(mesh.edges, finer.edges)]
        equations = RodEquations(problem, finer)
        curvature, noise, steps = newton(equations, mesh.evaluate(curvature, finer.nodes).real)
        margin = weakest(equations, curvature)
        if side and margin <= 0.0:
            curvature, more = descend(equations, curvature, side)
            curvature, noise, steps = newton(equations, curvature)
            margin = weakest(equations, curvature)
            iterations += more
        iterations += steps
        after = finer.to_edges(equations.tangents(curvature))[np.isin(finer.edges, mesh.edges)]
        # Rounding of the moments moves the shape by its weakest stiffness: more, the nearer a critical load.
        weak = max(abs(margin), 1e-12) if problem.conservative else 1.0
        rounding = 2.0 * noise + _ROUNDING * (1.0 + float(np.abs(curvature).max()) / weak)
        error = float(np.abs(after - before).max()) + rounding
        if error <= tolerance:
            joule = problem.stiffness / problem.length
            return Elastica(
                energy=joule * (equations.energy(curvature) + equations.base_energy),
                elastic_energy=joule * equations.elastic_energy(curvature),
                stable=margin > 0.0 if problem.conservative else None,
                margin=margin,
                error=problem.length * error,
                nodes=equations.mesh.size,
                iterations=iterations,
                equations=equations,
                nodal_curvature=curvature,
            )
        if rounding > tolerance:
            break
    raise SolverError(
        "the equilibrium of the rod is not as accurate as asked",
        status="rounding" if rounding > tolerance else "refinement limit",
        violated=[f"estimated error of position: {error:.3g} L (tolerance {tolerance:.3g} L)"],
        advice="raise the tolerance, or move the loads away from a critical value",
    )


def _too_many(advice: str) -> SolverError:
    return SolverError(
        "the rod needs more nodes than are allowed",
        status="resolution limit",
        violated=[f"nodes: more than {_MAX_NODES}"],
        advice=advice,
    )
