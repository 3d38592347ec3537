"""Operators on PyTorch tensors: PyTorch's own checks of gradients, transformations, types and errors."""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.learning import TorchOperators
from tests.marks import optional
from tests.operators.operator_cases import FINGER, MODEL, SCALE, start

torch = optional("torch")

COSTLY_FIXTURES = ("operators",)


@pytest.fixture(scope="module")
def operators():
    return TorchOperators(MODEL)


def given():
    return [torch.tensor(value, requires_grad=True) for value in start()]


@pytest.mark.deep
def test_gradients(operators):
    x, u, p = given()
    q = x[:, :2].detach().requires_grad_()
    assert torch.autograd.gradcheck(operators.tip, (q, u[0], p), check_forward_ad=True)
    assert torch.autograd.gradgradcheck(operators.tip, (q, u[0], p))
    dynamics = lambda x, p: 1e-4 * operators.forward_dynamics(x, p=p)  # noqa: E731
    assert torch.autograd.gradcheck(dynamics, (x, p), check_forward_ad=True, eps=1e-7, atol=1e-4)
    motion = lambda x, u, p: torch.tensor(SCALE) * operators.rollout(x, 8, 1e-5, u=u, p=p, substeps=2)  # noqa: E731
    assert torch.autograd.gradcheck(motion, (x, u, p), check_forward_ad=True, eps=1e-7, atol=1e-5)


@pytest.mark.deep
def test_transformations_agree(operators):
    x, u, p = (value.detach() for value in given())

    def loss(x, u):
        return ((torch.tensor(SCALE) * operators.rollout(x, 4, 1e-4, u=u, p=p)) ** 2).sum()

    each = torch.stack([torch.func.grad(loss)(row, u) for row in x])
    assert torch.equal(torch.func.vmap(torch.func.grad(loss), in_dims=(0, None))(x, u), each)
    at = torch.tensor([0.1], dtype=torch.float64)
    ways = (torch.func.jacfwd, torch.func.jacrev)
    both = [way(lambda q: operators.position(q, s=at))(x[0, :2]) for way in ways]
    assert torch.allclose(*both, rtol=1e-13)
    assert np.allclose(both[0], np.array(MODEL.jacobian(x[0, :2].numpy(), 0.0, 0.1, p.numpy())), rtol=1e-12)
    hessian = torch.func.hessian(lambda q: operators.tip(q)[0])(x[0, :2])
    assert torch.allclose(hessian, hessian.T, rtol=1e-13)


@pytest.mark.deep  # PyTorch takes 10 s for its first vmap
def test_a_model_without_parameters_is_mapped():
    """Arrays of no entries pass through vmap, hessian and forward mode; so does a batch of no rows."""
    model = cg.FingerModel(FINGER, family="arc", elements=2)
    tip = TorchOperators(model).tip
    q = torch.tensor([[0.1, 0.2], [0.3, -0.1]], dtype=torch.float64)
    found = torch.func.vmap(torch.func.hessian(tip))(q)
    for row, curvature in zip(q.numpy(), found, strict=True):
        for a in np.eye(2):  # second differences along the diagonal of the Hessian
            away = [np.ravel(model.tip(row + s * 1e-4 * a, 0.0, [])) for s in (-1.0, 0.0, 1.0)]
            assert np.allclose(curvature @ a @ a, np.array([1.0, -2.0, 1.0]) @ away / 1e-8, atol=1e-6)
    assert torch.func.vmap(tip)(q[:0]).shape == (0, 2)


def test_types_and_devices(operators):
    x, u, p = (value.detach() for value in given())
    found = operators.forward_dynamics(x.float(), p=p.float())
    assert found.dtype == torch.float32
    assert torch.equal(found, operators.forward_dynamics(x.float().double(), p=p.float()).float())
    assert operators.forward_dynamics(x.float(), u[0]).dtype == torch.float64
    for wrong, said in [
        (x.long(), "x: expected a tensor of float64 or float32, got torch.int64"),
        (x.half(), "x: expected a tensor of float64 or float32, got torch.float16"),
        (x.numpy(), "x: expected a tensor, got array"),
        (x.to("meta"), "x: expected a tensor on the CPU, where these functions are compiled, got one on meta"),
        (x[:, :3], "forward_dynamics: x has 4 entries, got an array of shape (3, 3)"),
    ]:
        with pytest.raises(cg.InputError) as caught:
            operators.forward_dynamics(wrong)
        assert said in str(caught.value)


def test_what_is_not_finite(operators):
    x = given()[0].detach()
    with pytest.raises(cg.NumericalError, match="in 3 of 3 rollouts"):
        operators.rollout(1e3 * x, 20, 1e-1)
    assert TorchOperators(MODEL, nonfinite="nan").rollout(1e3 * x, 20, 1e-1).isnan().any()
