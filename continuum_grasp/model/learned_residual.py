"""Generalized forces that a model misses, learned from logs, as expressions of its state."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from continuum_grasp.errors import InputError
from continuum_grasp.model.memory import Instant
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene.learned_residual import LearnedResidual

FADED = 1.5
"""Distance from the logs at which a residual has faded to zero, per that up to which it is trusted [1]. Half the region
again: narrower, its derivative by the state would be that of a wall, and plans would bounce off it."""

_SAME = 1e-6
"""Difference of elements that is none, per length of the finger [1]: of lengths that were rounded in a file."""
_TURN = 0.3
"""Rate at which the direction of a motion is 71 % of its greatest value, per standard deviation of the rate in logs
[1]. Friction turns at once; a model that does is too stiff for the steps of a plan, and rates are not known so well."""
_LEAST_PULL = 0.2
"""Pull below which its magnitude is rounded off, per standard deviation in the logs [1]."""


def check_residual(
    residual: LearnedResidual, family: str, lengths: Sequence[float], coordinates: Sequence[str], known: Sequence[str]
) -> None:
    """Raise InputError where a residual was learned for another model: of a family and elements of these lengths [m].

    ``coordinates`` are the names of its coordinates, ``known`` those of states of drives and of inputs.
    """
    own, length = residual.elements, sum(lengths)
    same = len(own) == len(lengths) and all(abs(a - b) <= _SAME * length for a, b in zip(own, lengths, strict=True))
    if residual.family != family or not same:
        learned, here = (", ".join(f"{h:.6g}" for h in of) for of in (own, lengths))
        raise InputError(
            f"it was learned for elements {learned} m of family {residual.family}, this model has {here} m of family "
            f"{family}: learn it anew, or state that family and these elements",
            key="residual",
        )
    if list(residual.coordinates) != list(coordinates):
        raise InputError(
            f"it was learned for coordinates {', '.join(residual.coordinates)}; here are {', '.join(coordinates)}",
            key="residual.coordinates",
        )
    for k, name in enumerate(residual.drives):
        if name not in known:
            message = f"{name!r} is neither a state of a drive nor an input here: expected some of {', '.join(known)}"
            raise InputError(message, key=f"residual.drives[{k}]")


def features_at(residual: LearnedResidual, at: Instant) -> list[Scalar]:
    """Features that the forces depend on."""
    n = len(residual.coordinates)
    return [*at.full[:n], *at.rates[:n], *(at.named[name] for name in residual.drives)]


def scaled(residual: LearnedResidual, features: Sequence[Scalar]) -> list[Scalar]:
    """Features in standard deviations from their mean."""
    parts = zip(features, residual.center, residual.scale, strict=True)
    return [(1.0 / scale) * (value - center) for value, center, scale in parts]


def distance(residual: LearnedResidual, features: Sequence[Scalar]) -> Scalar:
    """Square of the distance from the logs per that up to which the residual is trusted [1]: above one, it fades."""
    z, total = scaled(residual, features), ca.SX(0.0)
    for i, row in enumerate(residual.metric):
        part = sum((row[j] / residual.radius * z[j] for j in range(i, len(z)) if row[j] != 0.0), ca.SX(0.0))
        total += part * part
    return total


def terms(residual: LearnedResidual, features: Sequence[Scalar]) -> list[Scalar]:
    """Terms that the weights multiply."""
    n, z = len(residual.coordinates), scaled(residual, features)
    rates = zip(features[n : 2 * n], residual.scale[n : 2 * n], strict=True)
    directions = [rate / ca.sqrt(rate * rate + (_TURN * scale) ** 2) for rate, scale in rates]
    pulls = [(1.0 / scale) * pull for pull, scale in zip(features[2 * n :], residual.scale[2 * n :], strict=True)]
    pulls = [ca.sqrt(pull * pull + _LEAST_PULL**2) for pull in pulls]
    found: list[Scalar] = [1.0, *z[: 2 * n], *directions, *(s * pull for s in directions for pull in pulls)]
    if not residual.kernels:
        return found
    y = [*z[:n], *directions, *z[2 * n :]]
    square = sum((one * one for one in y), ca.SX(0.0))
    for center in residual.kernels:
        # |y - c|^2 by its products: half the instructions, since the square of y is that of all kernels.
        product = sum((2.0 / residual.width**2 * c * one for c, one in zip(center, y, strict=True)), ca.SX(0.0))
        inside = 1.0 - sum(c * c for c in center) / residual.width**2 + product - square / residual.width**2
        base = ca.fmax(inside, 0.0)
        found.append(base * base * base)
    return found


def residual_force(residual: LearnedResidual, features: Sequence[Scalar]) -> list[Scalar]:
    """The forces (n), exactly zero from ``FADED`` on."""
    beyond = ca.fmax(FADED**2 - distance(residual, features), 0.0)
    share = ca.fmin((1.0 / (FADED**2 - 1.0)) * beyond, 1.0)
    fade, own = share * share * (3.0 - 2.0 * share), terms(residual, features)
    forces = [sum((w * term for w, term in zip(row, own, strict=True)), ca.SX(0.0)) for row in residual.weights]
    return [fade * force for force in forces]
