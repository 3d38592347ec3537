"""The functions of a model as differentiable functions of JAX arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from continuum_grasp.addons.learning.operators.derivatives import Operator
from continuum_grasp.addons.learning.operators.operators import Operators, not_an_array, toolkit
from continuum_grasp.base import Array, InputError


class JaxOperators(Operators):
    """The functions of a model on JAX arrays, differentiable in both directions and to any order.

    Every function of the model is a method of the same name, with the model's inputs (missing ones are zero, ``p`` is
    nominal), as on ``Core``; leading dimensions are a batch and broadcast. ``rollout`` and ``step`` integrate. Values
    and derivatives are computed by compiled C on the host; ``jit``, ``vmap``, ``grad``, ``jvp``, ``jacrev``,
    ``jacfwd`` and ``hessian`` work, in any order. Within ``jit`` the C is called back, so that arrays on another device
    are copied to the host and back, and an error is raised as JAX's own with the text of ours.

    Arrays are of float64 or float32 (JAX has no other unless ``jax_enable_x64`` is set); all is computed in double
    precision, and the result is of the type that JAX promotes the arrays given to, to which nominal parameters and the
    step are rounded too. A row whose input is NaN gives NaN in functions, as on ``Core``.

    Parameters
    ----------
    model, nonfinite, compiled
        As in `TorchOperators`, like the attributes.

    Raises
    ------
    InputError
        If JAX is not installed, or an array has the wrong shape or type.

    Examples
    --------
    >>> import jax
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.addons.learning import JaxOperators
    >>> finger = cg.Finger(rod=cg.Rod(length=0.18, linear_density=0.02, bending_stiffness=0.01))
    >>> model = cg.FingerModel(finger, family="arc", elements=2, parameters=["bending_stiffness"])
    >>> operators = JaxOperators(model)
    >>> jacobian = jax.jit(jax.jacrev(operators.tip))(jax.numpy.zeros(2))
    >>> jacobian.round(4).tolist()[0]  # bends move the straight finger's tip towards -x
    [-0.13..., -0.04...]
    """

    TOOLKIT = ("jax", "JAX")

    def _arrays(self, given: Mapping[str, Any]) -> tuple[dict[str, Any], Callable[[Array], Any]]:
        jnp = self._toolkit.numpy
        arrays = {}
        for name, value in given.items():
            try:
                arrays[name] = jnp.asarray(value)
            except (TypeError, ValueError) as error:
                raise not_an_array(name, value, "an array of numbers") from error
            if arrays[name].dtype not in (jnp.float32, jnp.float64):
                kind = arrays[name].dtype
                raise InputError(f"expected an array of float64 or float32, got {kind}", key=name)
        kind = jnp.result_type(*arrays.values()) if arrays else jnp.result_type(float)
        return {name: value.astype(kind) for name, value in arrays.items()}, lambda array: jnp.asarray(
            array, dtype=kind
        )

    def _expand(self, array: Any, shape: tuple[int, ...]) -> Any:
        return self._toolkit.numpy.broadcast_to(array, shape)

    def _apply(self, operator: Operator, arrays: list[Any]) -> list[Any]:
        return list(_primitive().bind(*arrays, operator=operator))


def _on_host(operator: Operator, kind: Any, *arrays: Any) -> list[Any]:
    """Outputs on the host, computed in double precision, of the type of the arrays."""
    outputs = operator([np.asarray(array, dtype=float) for array in arrays])
    return [value.astype(kind, copy=False) for value in outputs]


def _shapes(operator: Operator, arrays: Any) -> list[tuple[int, ...]]:
    return operator.shapes([array.shape for array in arrays])


@cache
def _primitive() -> Any:
    """The primitive of all operators, by which JAX knows derivatives in both directions; made when JAX is there.

    ``custom_vjp`` would know one direction only, and with ``custom_jvp`` JAX cannot transpose a callback.
    """
    jax = toolkit(*JaxOperators.TOOLKIT)
    jnp = jax.numpy
    ad, batching, mlir = (import_module(f"jax.interpreters.{name}") for name in ("ad", "batching", "mlir"))
    call: Any = import_module("jax.extend.core").Primitive("continuum_grasp_operator")
    call.multiple_results = True

    def evaluate(*arrays: Any, operator: Operator) -> Any:
        return [jnp.asarray(value) for value in _on_host(operator, arrays[0].dtype, *arrays)]

    def call_back(*arrays: Any, operator: Operator) -> Any:
        kind = arrays[0].dtype
        shapes = [jax.ShapeDtypeStruct(shape, kind) for shape in _shapes(operator, arrays)]
        return jax.pure_callback(lambda *inputs: _on_host(operator, kind, *inputs), shapes, *arrays)

    def abstract(*arrays: Any, operator: Operator) -> Any:
        return [jax.core.ShapedArray(shape, arrays[0].dtype) for shape in _shapes(operator, arrays)]

    def push(arrays: Any, tangents: Any, *, operator: Operator) -> Any:
        outputs = call.bind(*arrays, operator=operator)
        residuals = operator.residuals(list(arrays), list(outputs))
        pushed, inputs = operator.push(residuals, [ad.instantiate_zeros(tangent) for tangent in tangents])
        return outputs, call.bind(*inputs, operator=pushed)

    def pull(cotangents: Any, *arrays: Any, operator: Operator) -> Any:
        seeds = [ad.instantiate_zeros(cotangent) for cotangent in cotangents]
        origin = operator.origin
        if origin is None:
            raise NotImplementedError(f"{operator.name} is not linear")
        residuals, tangents = origin.split(list(arrays))
        if any(ad.is_undefined_primal(value) for value in residuals):
            raise NotImplementedError(f"{operator.name} is not linear in the argument to be transposed")
        pulled, needed, pick = origin.pull(residuals, seeds)
        picked = pick(list(call.bind(*needed, operator=pulled)))
        linear = [v if ad.is_undefined_primal(t) else None for v, t in zip(picked, tangents, strict=True)]
        # In the order of the arrays: what is no tangent has no cotangent.
        of = {id(tangent): value for tangent, value in zip(tangents, linear, strict=True)}
        return [of.get(id(array)) if ad.is_undefined_primal(array) else None for array in arrays]

    def batch(arrays: Any, dims: Any, *, operator: Operator) -> Any:
        size = next(a.shape[d] for a, d in zip(arrays, dims, strict=True) if d is not None)
        rows = []
        for array, dim in zip(arrays, dims, strict=True):
            mapped = dim is not None
            wide = jnp.moveaxis(array, dim, 0) if mapped else jnp.broadcast_to(array, (size, *array.shape))
            rows.append(wide.reshape(math.prod(wide.shape[:2]), *wide.shape[2:]))
        results = call.bind(*rows, operator=operator)
        return [value.reshape(size, wide.shape[1], *value.shape[1:]) for value in results], [0] * len(results)

    call.def_impl(evaluate)
    call.def_abstract_eval(abstract)
    mlir.register_lowering(call, mlir.lower_fun(call_back, multiple_results=True))
    ad.primitive_jvps[call] = push
    ad.primitive_transposes[call] = pull
    batching.primitive_batchers[call] = batch
    return call
