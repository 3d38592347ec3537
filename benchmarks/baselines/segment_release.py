"""Runs inside the interpreter that has SoRoMoX or JSRM: a rod of segments with constant or variable bend, released.

Bending-only segments, clamped, pointing along world +X, under gravity, elasticity, damping and moments. The Runge-Kutta
steps around their dynamics are one loop compiled by JAX, which is faster than the libraries' own roll-outs. Neither has
point masses on a rod.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial.legendre import Legendre, leggauss

_ABSCISSAE, _WEIGHTS = 0.5 + 0.5 * leggauss(20)[0], 0.5 * leggauss(20)[1]
"""Gauss points of a segment, which runs from 0 to 1, and their weights."""
GVS_POINTS = 5
"""Gauss points of a segment in SoRoMoX's GVS model: the fewest that it takes."""


class Segments:
    """One rod of segments; ``rod`` as `release_peers.describe_rod` gives it.

    Each segment has the mean stiffness (of the energy of an even bend) and mass of its part of the rod; segments end
    where the rod or its moments jump, and are equally long between. With ``order`` SoRoMoX's geometric variable-strain
    model takes them, whose curvature is a polynomial of that order along each segment, and whose radius is linear.
    """

    def __init__(self, rod: dict, library: str, segments: int, steps: int, order: int | None = None) -> None:
        if rod["tip_mass"] > 0.0:
            raise ValueError(f"{library} has no point masses")
        self.steps = steps
        given = {key: value for key, value in rod.items() if key != "chains"}
        self._model = _model(json.dumps(given), library, segments, order)
        self._advance(self._model.x0, 1)

    def _advance(self, x: Any, count: int) -> Any:
        return self._model.loop(x, count, 1.0 / self.steps).block_until_ready()

    def run(self, seconds: float) -> None:
        """Step through a span of time."""
        self._advance(self._model.x0, round(seconds * self.steps))

    def tips(self, frames: int) -> np.ndarray:
        """Tip (frames + 1, 2) at equally spaced instants in one second [m]."""
        states = [self._model.x0]
        for _ in range(frames):
            states.append(self._advance(states[-1], self.steps // frames))
        return self._model.tips(np.asarray(states))


class _Model:
    """Start, tip and compiled steps of one rod.

    Coordinates of a segment of length h are the Legendre coefficients of h times its curvature, lowest order first:
    constant curvature has one, the bend.
    """

    def __init__(self, rod: dict, library: str, segments: int, order: int | None) -> None:
        import jax
        import jax.numpy as jnp

        jax.config.update("jax_enable_x64", True)
        jax.config.update("jax_platforms", "cpu")
        self._places = _places(rod, segments)
        self._count = 1 if order is None else order + 1
        rate = _dynamics(rod, library, self._places, order)
        count = len(self._places) - 1
        self.x0 = jnp.concatenate([jnp.array(self._start(rod)), jnp.zeros(self._count * count)])

        def one(x: jax.Array, step: float) -> jax.Array:
            """A Runge-Kutta step as a loop over its stages, so that the dynamics are compiled once, not four times."""

            def stage(carry: tuple[jax.Array, jax.Array], at: tuple[float, float]) -> tuple[tuple, None]:
                total, k = carry
                k = rate(x + step * at[0] * k)
                return (total + step * at[1] * k, k), None

            stages = jnp.array([0.0, 0.5, 0.5, 1.0]), jnp.array([1.0, 2.0, 2.0, 1.0]) / 6.0
            return jax.lax.scan(stage, (x, jnp.zeros_like(x)), stages)[0][0]

        self.loop = jax.jit(lambda x, many, step: jax.lax.fori_loop(0, many, lambda _, y: one(y, step), x))

    def _start(self, rod: dict) -> np.ndarray:
        """Coordinates of the shape at time zero: each segment bends as much as its part of the rod."""
        bend, found = np.asarray(rod["bend"]), []
        along = np.linspace(0.0, rod["length"], len(bend))
        for a, b in itertools.pairwise(self._places):
            low, high = np.interp([a, b], along, bend)
            angle = np.interp(a + (b - a) * _ABSCISSAE, along, bend)
            # By parts: h kappa is the derivative of the angle over the segment's own place from 0 to 1.
            for j in range(self._count):
                leg = Legendre.basis(j, domain=[0.0, 1.0])
                moment = high * leg(1.0) - low * leg(0.0) - np.sum(_WEIGHTS * leg.deriv()(_ABSCISSAE) * angle)
                found.append((2 * j + 1) * moment)
        return np.array(found)

    def tips(self, states: np.ndarray) -> np.ndarray:
        """Tip (T, 2) of states (T, nx) [m]."""
        h = np.diff(self._places)
        q = states[:, : len(h) * self._count].reshape(len(states), len(h), self._count)
        start = np.cumsum(q[:, :, 0], axis=1) - q[:, :, 0]
        turns = np.array([Legendre.basis(j, domain=[0.0, 1.0]).integ(lbnd=0.0)(_ABSCISSAE) for j in range(self._count)])
        tip = (h * (np.exp(1j * (start[:, :, None] + q @ turns)) @ _WEIGHTS)).sum(axis=1)
        return np.stack([tip.real, tip.imag], axis=1)


@lru_cache
def _model(rod: str, library: str, segments: int, order: int | None) -> _Model:
    """Compiled once for all numbers of steps."""
    return _Model(json.loads(rod), library, segments, order)


def _dynamics(rod: dict, library: str, places: np.ndarray, order: int | None) -> Callable[[Any], Any]:
    """The rate xd(x) of the rod whose segments end at some places."""
    if order is not None:
        return gvs_dynamics(rod, places, order)
    h = np.diff(places)
    stiffness, mass = (_means(rod, key, places) for key in ("stiffness_along", "density_along"))
    diameters = np.sqrt(4.0 * mass / (np.pi * rod["density"]))
    given = {
        "gravity": rod["gravity"],
        "lengths": h.tolist(),
        "density": rod["density"],
        "diameter": diameters.tolist(),
        "youngs_modulus": (64.0 * stiffness / (np.pi * diameters**4)).tolist(),
        "arc_damping": (rod["damping"] * stiffness / rod["bending_stiffness"] / h).tolist(),
        "tip_moment": _moments(rod, places).tolist(),
    }
    return (soromox_dynamics if library == "soromox" else jsrm_dynamics)(given)


def _moments(rod: dict, places: np.ndarray) -> np.ndarray:
    """Moment in each segment [N m]."""
    return np.array([sum(m for end, m in rod["moments"] if end > at) for at in 0.5 * (places[:-1] + places[1:])])


def _places(rod: dict, segments: int) -> np.ndarray:
    """Ends of the segments [m]."""
    bounds = np.array([0.0, *rod["marks"], rod["length"]])
    counts = np.ones(len(bounds) - 1, dtype=int)
    for _ in range(segments - len(counts)):
        counts[np.argmax(np.diff(bounds) / counts)] += 1
    parts = zip(bounds[:-1], bounds[1:], counts, strict=True)
    return np.unique(np.concatenate([np.linspace(a, b, n + 1) for a, b, n in parts]))


def _means(rod: dict, key: str, places: np.ndarray) -> np.ndarray:
    """Means of a quantity given along the rod, per segment."""
    along = np.concatenate([[0.0], np.cumsum(rod[key])]) * rod["length"] / len(rod[key])
    return np.diff(np.interp(places, np.linspace(0.0, rod["length"], len(along)), along)) / np.diff(places)


def soromox_dynamics(rod):
    """xd(x) by SoRoMoX, x = [theta, theta rate]."""
    import jax.numpy as jnp
    from soromox.systems.components import LinkSpec
    from soromox.systems.pcs import PlanarPCS, PlanarPCSStructure

    each = [rod[key] for key in ("lengths", "diameter", "youngs_modulus", "arc_damping")]
    links = [
        LinkSpec.circular(
            length=length,
            density=rod["density"],
            radius=diameter / 2,
            reference_strain=[0.0, 1.0, 0.0],
            young_modulus=modulus,
            poisson_ratio=0.3,
            damping=jnp.diag(jnp.array([damping * length**2, 0.0, 0.0])),
        )
        for length, diameter, modulus, damping in np.array(each).T.tolist()
    ]
    robot = PlanarPCS.from_links(
        links,
        structure=PlanarPCSStructure(strain_selector=jnp.array([True, False, False] * len(links))),
        gravity=jnp.array(rod["gravity"]),
        base_pose=jnp.zeros(3),
        backend="jax",
    )
    lengths = jnp.array(rod["lengths"])
    # The coordinates are curvatures, theta = length * curvature.
    moment = jnp.array(rod["tip_moment"]) * lengths

    def rate(x):
        n = len(links)
        q, qd = x[:n] / lengths, x[n:] / lengths
        yd = robot.forward_dynamics(0.0, jnp.concatenate([q, qd]), (None, moment))
        return jnp.concatenate([x[n:], yd[n:] * lengths])

    return rate


def gvs_dynamics(rod: dict, places: np.ndarray, order: int) -> Callable[[Any], Any]:
    """xd(x) by SoRoMoX's GVS with Legendre polynomials, x as ``_Model`` has it."""
    import jax.numpy as jnp
    from soromox.systems.components import JointSpec, LinearProfile, LinkSpec
    from soromox.systems.gvs import GVS, GVSSegment, StrainBasisSpec

    middles = (np.arange(len(rod["stiffness_along"])) + 0.5) * rod["length"] / len(rod["stiffness_along"])
    basis = StrainBasisSpec(type="legendre", strain_selector=("kappa_z",), basis_order=order)
    polynomials = np.array([Legendre.basis(j, domain=[0.0, 1.0])(_ABSCISSAE) for j in range(order + 1)])
    segments = []
    for a, b in itertools.pairwise(places):
        h, edge = b - a, 1e-6 * (b - a)  # values beside a jump are those of this segment
        density = np.interp([a + edge, b - edge], *_inside(middles, rod["density_along"], a, b))
        stiffness = np.interp(a + h * _ABSCISSAE, *_inside(middles, rod["stiffness_along"], a, b))
        matrix = h * (polynomials * (_WEIGHTS * stiffness)) @ polynomials.T
        link = LinkSpec.circular(
            length=h,
            density=rod["density"],
            radius=LinearProfile(*np.sqrt(density / (np.pi * rod["density"])).tolist()),
            reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            stiffness=jnp.array(matrix),
            damping=jnp.array(rod["damping"] / rod["bending_stiffness"] * matrix),
        )
        segments.append(GVSSegment(link=link, joint=JointSpec.fixed(), basis=basis, num_gauss_points=GVS_POINTS))
    robot = GVS.from_segments(
        segments,
        gravity=jnp.array([*rod["gravity"], 0.0]),
        base_pose=jnp.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
        backend="jax",
    )
    lengths = jnp.array(np.repeat(np.diff(places), order + 1))
    force = np.zeros((len(segments), order + 1))  # a moment that is even over a segment works on its mean bend alone
    force[:, 0] = _moments(rod, places) * np.diff(places)
    moment, n = jnp.array(force.ravel()), len(segments) * (order + 1)

    def rate(x):
        yd = robot.forward_dynamics(0.0, jnp.concatenate([x[:n] / lengths, x[n:] / lengths]), (None, moment))
        return jnp.concatenate([x[n:], yd[n:] * lengths])

    return rate


def _inside(at: np.ndarray, values: list[float], low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Places and values between two places."""
    chosen = (at > low) & (at < high)
    return at[chosen], np.asarray(values)[chosen]


def jsrm_dynamics(rod):
    """xd(x) by JSRM, x = [theta, theta rate]; its rod points along +Y, so the world is turned."""
    import jax.numpy as jnp
    import jsrm
    from jsrm.systems import planar_pcs

    lengths = jnp.array(rod["lengths"])
    count = len(rod["lengths"])
    radius = jnp.array(rod["diameter"]) / 2
    modulus = jnp.array(rod["youngs_modulus"]) * jnp.ones(count)
    damping = jnp.array(rod["arc_damping"]) * lengths**2
    expressions = Path(jsrm.__file__).parent / "symbolic_expressions" / f"planar_pcs_ns-{count}.dill"
    _, _, matrices, _ = planar_pcs.factory(str(expressions), strain_selector=jnp.array([True, False, False] * count))
    params = {
        "th0": jnp.array(0.0),
        "l": lengths,
        "r": radius * jnp.ones(count),
        "rho": rod["density"] * jnp.ones(count),
        "g": jnp.array([-rod["gravity"][1], rod["gravity"][0]]),
        "E": modulus,
        "G": modulus / 2.6,
        "D": jnp.diag(jnp.array([v for d in damping for v in (d, 0.0, 0.0)])),
    }

    def rate(x):
        q, qd = x[:count] / lengths, x[count:] / lengths
        m, c, g, k, d, _ = matrices(params, q, qd)
        qdd = jnp.linalg.solve(m, jnp.array(rod["tip_moment"]) * lengths - c @ qd - g - k - d @ qd)
        return jnp.concatenate([x[count:], qdd * lengths])

    return rate
