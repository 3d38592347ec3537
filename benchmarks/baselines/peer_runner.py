"""Runs inside the interpreter that has a peer library: one planar constant-curvature rod, timed; prints JSON.

Bending-only segments of a uniform round rod, clamped, pointing along world +X, under gravity, elasticity,
damping and a moment at the tip; with ``--forces`` also world forces at the segments' ends. Neither library
has point masses on a rod, so the tip mass is left out: the peers do less work than the model they are
compared with. The loop is compiled by JAX as a whole; each evaluation depends on the one before.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from pathlib import Path


def soromox_dynamics(rod, forces):
    """xd(x) by SoRoMoX, x = [theta, theta rate]."""
    import jax.numpy as jnp
    import numpy as np
    from soromox.systems.components import LinkSpec
    from soromox.systems.pcs import PlanarPCS, PlanarPCSStructure

    # One number for all segments, or one for each.
    each = np.broadcast_arrays(rod["lengths"], rod["diameter"], rod["youngs_modulus"], rod["arc_damping"])
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
        external = moment
        if forces:
            for jacobian, force in zip(robot.jacobian_tips(q), rod["forces"], strict=True):
                # Rows: angle, x, y.
                external = external + jacobian[1:].T @ jnp.array(force)
        y = jnp.concatenate([q, qd])
        yd = robot.forward_dynamics(0.0, y, (None, external))
        return jnp.concatenate([x[n:], yd[n:] * lengths])

    return rate


def jsrm_dynamics(rod, forces):
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
    _, _, matrices, functions = planar_pcs.factory(
        str(expressions), strain_selector=jnp.array([True, False, False] * count)
    )
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
    ends = [sum(rod["lengths"][: k + 1]) for k in range(count)]

    def rate(x):
        q, qd = x[:count] / lengths, x[count:] / lengths
        m, c, g, k, d, _ = matrices(params, q, qd)
        applied = jnp.array(rod["tip_moment"]) * lengths
        if forces:
            for s, (fx, fy) in zip(ends, rod["forces"], strict=True):
                jacobian = functions["jacobian_fn"](params, q, jnp.array(s))
                applied = applied + jacobian[:2].T @ jnp.array([-fy, fx])
        qdd = jnp.linalg.solve(m, applied - c @ qd - g - k - d @ qd)
        return jnp.concatenate([x[count:], qdd * lengths])

    return rate


def measure(rate, state, steps, repeats):
    """Nanoseconds per evaluation of a compiled loop, and the seconds to compile it."""
    import jax

    @jax.jit
    def loop(x):
        return jax.lax.fori_loop(0, steps, lambda _, y: y + 1e-12 * rate(y), x)

    start = time.perf_counter()
    compiled = loop.lower(state).compile()
    compile_seconds = time.perf_counter() - start
    compiled(state).block_until_ready()
    times = []
    for _ in range(repeats):
        start = time.perf_counter_ns()
        compiled(state).block_until_ready()
        times.append((time.perf_counter_ns() - start) / steps)
    return times, compile_seconds


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("library", choices=("soromox", "jsrm"))
    parser.add_argument("--rod", required=True, help="JSON object describing the rod, forces and state")
    parser.add_argument("--forces", action="store_true")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--repeats", type=int, default=7)
    arguments = parser.parse_args()

    from importlib.metadata import version

    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_platforms", "cpu")
    rod = json.loads(arguments.rod)
    build = soromox_dynamics if arguments.library == "soromox" else jsrm_dynamics
    rate = build(rod, arguments.forces)
    state = jnp.array(rod["state"])
    xd = jax.jit(rate)(state)
    times, compile_seconds = measure(rate, state, arguments.steps, arguments.repeats)
    print(
        json.dumps(
            {
                "library": arguments.library,
                "version": version(arguments.library),
                "jax": jax.__version__,
                "forces": arguments.forces,
                "xd": [float(v) for v in xd],
                "ns": statistics.median(times),
                "ns_all": times,
                "compile_seconds": compile_seconds,
                "steps": arguments.steps,
            }
        )
    )


if __name__ == "__main__":
    main()
