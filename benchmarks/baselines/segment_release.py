"""Runs inside the interpreter that has SoRoMoX or JSRM: a rod of constant-curvature segments, released.

The dynamics are those of ``peer_runner``; the Runge-Kutta steps around them are one loop compiled by JAX, which is
faster than the libraries' own roll-outs. Neither has point masses on a rod.
"""

from __future__ import annotations

import numpy as np


class Segments:
    """One rod of equal segments; ``rod`` as for ``mujoco_chain.Chain``, with density, diameter and youngs_modulus."""

    def __init__(self, rod: dict, library: str, segments: int, steps: int) -> None:
        import jax
        import jax.numpy as jnp
        from peer_runner import jsrm_dynamics, soromox_dynamics

        if rod["tip_mass"] > 0.0:
            raise ValueError(f"{library} has no point masses")
        jax.config.update("jax_enable_x64", True)
        jax.config.update("jax_platforms", "cpu")
        self.steps = steps
        h = self._h = rod["length"] / segments
        given = {
            **{key: rod[key] for key in ("density", "diameter", "youngs_modulus", "gravity")},
            "lengths": [h] * segments,
            "arc_damping": rod["damping"] / h,
            "tip_moment": 0.0,
        }
        rate = (soromox_dynamics if library == "soromox" else jsrm_dynamics)(given, False)
        bend = np.asarray(rod["bend"])
        edges = np.interp(np.linspace(0.0, 1.0, segments + 1), np.linspace(0.0, 1.0, len(bend)), bend)
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
        chords = self._h * np.sinc(half / np.pi) * np.exp(1j * (start + half))
        tip = chords.sum(axis=1)
        return np.stack([tip.real, tip.imag], axis=1)
