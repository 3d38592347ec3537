"""The functions of a model as differentiable functions of PyTorch tensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

from continuum_grasp.addons.learning.operators.derivatives import Operator
from continuum_grasp.addons.learning.operators.operators import Operators, not_an_array, toolkit
from continuum_grasp.base import Array, InputError


class TorchOperators(Operators):
    """The functions of a model on PyTorch tensors, differentiable in both directions and to any order.

    Every function of the model is a method of the same name, with the model's inputs (missing ones are zero, ``p`` is
    nominal), as on ``Core``; leading dimensions are a batch and broadcast. ``rollout`` and ``step`` integrate. Values
    and derivatives are computed by compiled C without PyTorch's graph of every operation; ``torch.func`` (``vmap``,
    ``grad``, ``jvp``, ``jacrev``, ``hessian``) and double backward work.

    Tensors are on the CPU, in float64 or float32; all is computed in double precision, and the result is of the type
    that PyTorch promotes the tensors given to, to which nominal parameters and the step are rounded too. A row whose
    input is NaN gives NaN in functions, as on ``Core``.

    Parameters
    ----------
    model : FingerModel or System
        The model.
    nonfinite : {"raise", "nan"}
        Response of rollouts to states or inputs that are not finite: NumericalError or InputError, or NaN from there on
        in these rows.
    compiled : bool
        False: run on CasADi's virtual machine.

    Attributes
    ----------
    model : FingerModel or System
    nonfinite : {"raise", "nan"}

    Raises
    ------
    InputError
        If PyTorch is not installed, or a tensor has the wrong shape, type or device.

    Examples
    --------
    >>> import torch
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.addons.learning import TorchOperators
    >>> finger = cg.Finger(rod=cg.Rod(length=0.18, linear_density=0.02, bending_stiffness=0.01))
    >>> model = cg.FingerModel(finger, family="arc", elements=2, parameters=["bending_stiffness"])
    >>> operators = TorchOperators(model)
    >>> q = torch.zeros(5, 2, dtype=torch.float64, requires_grad=True)
    >>> operators.tip(q)[:, 0].sum().backward()  # bends move the straight finger's tip towards -x
    >>> q.grad[0]
    tensor([-0.1350, -0.0450], dtype=torch.float64)
    """

    TOOLKIT = ("torch", "PyTorch")

    def _arrays(self, given: Mapping[str, Any]) -> tuple[dict[str, Any], Callable[[Array], Any]]:
        torch = self._toolkit
        arrays = {}
        types = []
        for name, value in given.items():
            if not isinstance(value, torch.Tensor):
                raise not_an_array(name, value, "a tensor")
            if value.dtype not in (torch.float32, torch.float64):
                raise InputError(f"expected a tensor of float64 or float32, got {value.dtype}", key=name)
            if value.device.type != "cpu":
                raise InputError(
                    f"expected a tensor on the CPU, where these functions are compiled, got one on {value.device}: "
                    f"give {name}.cpu()",
                    key=name,
                )
            arrays[name] = value
            types.append(value.dtype)
        kind = torch.float64 if torch.float64 in types or not types else torch.float32
        return {name: value.to(kind) for name, value in arrays.items()}, lambda array: torch.as_tensor(
            array, dtype=kind
        )

    def _expand(self, array: Any, shape: tuple[int, ...]) -> Any:
        return array.expand(shape)

    def _apply(self, operator: Operator, arrays: list[Any]) -> list[Any]:
        return list(_function().apply(operator, *arrays))


@cache
def _function() -> Any:
    """The autograd function of all operators; made when PyTorch is there."""
    torch = toolkit(*TorchOperators.TOOLKIT)
    base: Any = torch.autograd.Function

    class Apply(base):  # type: ignore[misc]
        """A call of an operator."""

        @staticmethod
        def forward(operator: Operator, *arrays: Any) -> Any:
            inputs = [array.detach().numpy().astype(np.float64, copy=False) for array in arrays]
            outputs = operator(inputs)
            return tuple(torch.from_numpy(value).to(arrays[0].dtype) for value in outputs)

        @staticmethod
        def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
            ctx.operator, *arrays = inputs
            ctx.count = len(arrays)
            ctx.save_for_backward(*arrays, *output)
            ctx.save_for_forward(*arrays, *output)

        @staticmethod
        def backward(ctx: Any, *cotangents: Any) -> Any:
            saved = list(ctx.saved_tensors)
            residuals = ctx.operator.residuals(saved[: ctx.count], saved[ctx.count :])
            operator, arrays, pick = ctx.operator.pull(residuals, list(cotangents))
            return None, *pick(list(Apply.apply(operator, *arrays)))

        @staticmethod
        def jvp(ctx: Any, _: Any, *tangents: Any) -> Any:
            saved = list(ctx.saved_tensors)
            inputs = saved[: ctx.count]
            residuals = ctx.operator.residuals(inputs, saved[ctx.count :])
            seeds = [torch.zeros_like(x) if t is None else t for x, t in zip(inputs, tangents, strict=True)]
            operator, arrays = ctx.operator.push(residuals, seeds)
            return Apply.apply(operator, *arrays)

        @staticmethod
        def vmap(info: Any, dims: Any, operator: Operator, *arrays: Any) -> Any:
            size = info.batch_size
            rows = []
            for array, dim in zip(arrays, dims[1:], strict=True):
                wide = array.unsqueeze(0).expand(size, *array.shape) if dim is None else array.movedim(dim, 0)
                rows.append(wide.flatten(0, 1))  # reshaped to -1, what has no entries is ambiguous
            results = Apply.apply(operator, *rows)
            return tuple(value.reshape(size, wide.shape[1], *value.shape[1:]) for value in results), (0,) * len(results)

    return Apply
