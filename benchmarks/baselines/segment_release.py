"""Runs inside the interpreter that has SoRoMoX or JSRM: a rod of constant-curvature segments, released.

Bending-only segments, clamped, pointing along world +X, under gravity, elasticity, damping and moments. The Runge-Kutta
steps around their dynamics are one loop compiled by JAX, which is faster than the libraries' own roll-outs. Neither has
point masses on a rod.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np


class Segments:
    """One rod of segments; ``rod`` as `release_peers.describe_rod` gives it.

    Each segment has the mean stiffness (of the energy of an even bend) and mass of its part of the rod; segments end
    where the rod or its moments jump, and are equally long between.
    """

    def __init__(self, rod: dict, library: str, segments: int, steps: int) -> None:
        import jax
        import jax.numpy as jnp

        if rod["tip_mass"] > 0.0:
            raise ValueError(f"{library} has no point masses")
        jax.config.update("jax_enable_x64", True)
        jax.config.update("jax_platforms", "cpu")
        self.steps = steps
        places = _places(rod, segments)
        h = self._h = np.diff(places)
        stiffness, mass = (_means(rod, key, places) for key in ("stiffness_along", "density_along"))
        diameters = np.sqrt(4.0 * mass / (np.pi * rod["density"]))
        given = {
            "gravity": rod["gravity"],
            "lengths": h.tolist(),
            "density": rod["density"],
            "diameter": diameters.tolist(),
            "youngs_modulus": (64.0 * stiffness / (np.pi * diameters**4)).tolist(),
            "arc_damping": (rod["damping"] * stiffness / rod["bending_stiffness"] / h).tolist(),
            "tip_moment": [sum(m for end, m in rod["moments"] if end > at) for at in 0.5 * (places[:-1] + places[1:])],
        }
        rate = (soromox_dynamics if library == "soromox" else jsrm_dynamics)(given)
        bend = np.asarray(rod["bend"])
        edges = np.interp(places, np.linspace(0.0, rod["length"], len(bend)), bend)
        self._x0 = jnp.concatenate([jnp.diff(jnp.array(edges)), jnp.zeros(segments)])
        step = 1.0 / steps

        def one(_: int, x: jax.Array) -> jax.Array:
            k1 = rate(x)
            k2 = rate(x + step / 2 * k1)
            k3 = rate(x + step / 2 * k2)
            k4 = rate(x + step * k3)
            return x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

        self._loop = jax.jit(lambda x, count: jax.lax.fori_loop(0, count, one, x))
        self._segments = segments
        self._advance(self._x0, 1)

    def _advance(self, x: object, count: int) -> object:
        return self._loop(x, count).block_until_ready()

    def run(self, seconds: float) -> None:
        """Step through a span of time."""
        self._advance(self._x0, round(seconds * self.steps))

    def tips(self, frames: int) -> np.ndarray:
        """Tip (frames + 1, 2) at equally spaced instants in one second [m]."""
        states = [self._x0]
        for _ in range(frames):
            states.append(self._advance(states[-1], self.steps // frames))
        bends = np.asarray(states)[:, : self._segments]
        start = np.cumsum(bends, axis=1) - bends
        half = 0.5 * bends
        chords = self._h[None, :] * np.sinc(half / np.pi) * np.exp(1j * (start + half))
        tip = chords.sum(axis=1)
        return np.stack([tip.real, tip.imag], axis=1)


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
