"""The linearly implicit method RODAS: order 4, L-stable, stiffly accurate.

E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.7, in the form without matrix products.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

_GAMMA = 0.25  # makes the method L-stable
_ALPHA = (0.0, 0.386, 0.21, 0.63, 1.0, 1.0)  # instants of the stages
_GAMMAS = (0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0)  # row sums, for explicit dependence on time
_A = (
    (),
    (1.544,),
    (0.9466785280815826, 0.2557011698983284),
    (3.314825187068521, 2.896124015972201, 0.9986419139977817),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1.0),
)
_C = (
    (),
    (-5.6688,),
    (-2.430093356833875, -0.2063599157091915),
    (-0.1073529058151375, -9.594562251023355, -20.47028614809616),
    (7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616),
    (8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054),
)


def step(model: Any, x: ca.MX, u: list[ca.MX], w: list[ca.MX], p: ca.MX, h: ca.MX) -> ca.MX:
    """Next state; inputs are taken as quadratic over the step. See ``step_function``."""
    f: ca.Function = model.forward_dynamics
    jacobian = model.linearization(x, u[0], w[0], p)[0]
    matrix = ca.MX.eye(x.numel()) / (_GAMMA * h) - jacobian
    # Rows are scaled to one size: accelerations can be 1e8 times the rates, and would take their digits.
    balance = 1.0 / ca.sqrt(ca.sum2(matrix * matrix))
    matrix = ca.repmat(balance, 1, x.numel()) * matrix
    solver = ca.Linsol("solver", "qr", matrix.sparsity())
    # Change of the right-hand side over the step through the inputs alone, per step.
    drift = -3 * f(x, u[0], w[0], p) + 4 * f(x, u[1], w[1], p) - f(x, u[2], w[2], p)
    varying = ca.vertcat(*u, *w).numel() > 0
    stages: list[ca.MX] = []
    for alpha, gamma, a, c in zip(_ALPHA, _GAMMAS, _A, _C, strict=True):
        at = x
        right = ca.MX.zeros(x.numel())
        for k, stage in enumerate(stages):
            at = at + a[k] * stage
            right = right + (c[k] / h) * stage
        right = right + f(at, _quadratic(u, alpha), _quadratic(w, alpha), p)
        if varying and gamma != 0.0:
            right = right + gamma * drift
        stages.append(solver.solve(matrix, balance * right))
    following = x + stages[-1]
    for weight, stage in zip(_A[-1], stages, strict=False):
        following = following + weight * stage
    return following


def _quadratic(samples: list[ca.MX], at: float) -> ca.MX:
    weights = ((1 - at) * (1 - 2 * at), 4 * at * (1 - at), at * (2 * at - 1))
    return sum((w * s for w, s in zip(weights, samples, strict=True) if w != 0.0), ca.MX.zeros(samples[0].shape))
