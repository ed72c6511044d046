import numpy as np
import pytest
import torch
from scipy.special import sph_harm_y

from aa4d.methods.gaussians.harmonics import C0, basis, colors_of, constant_of, count_of


def directions(n: int) -> torch.Tensor:
    torch.manual_seed(0)
    return torch.nn.functional.normalize(torch.randn(n, 3, dtype=torch.float64), dim=1)


def test_the_basis_is_that_of_the_textbook() -> None:
    """Real harmonics of scipy's complex ones, with the Condon-Shortley phase, which 3DGS keeps."""
    d = directions(50)
    theta, phi = np.arccos(d[:, 2].numpy()), np.arctan2(d[:, 1].numpy(), d[:, 0].numpy())
    expected = []
    for degree in range(4):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), theta, phi)
            if order == 0:
                expected.append(value.real)
            else:
                part = value.imag if order < 0 else value.real
                expected.append(np.sqrt(2) * part)
    np.testing.assert_allclose(basis(d, 3).numpy(), np.stack(expected, 1), atol=1e-12)


@pytest.mark.parametrize("degree", range(4))
def test_a_color_uses_the_degrees_that_are_on(degree: int) -> None:
    d = directions(8)
    coefficients = torch.randn(8, 16, 3, dtype=torch.float64)
    values = basis(d, degree)
    by_hand = [
        [max(sum(values[n, b] * coefficients[n, b, c] for b in range(count_of(degree))) + 0.5, 0) for c in range(3)]
        for n in range(8)
    ]
    np.testing.assert_allclose(colors_of(coefficients, d, degree).numpy(), np.array(by_hand, dtype=float), atol=1e-12)


def test_a_constant_color_comes_back() -> None:
    color = torch.tensor([[0.0, 0.25, 1.0]])
    coefficients = torch.zeros(1, 16, 3)
    coefficients[:, 0] = constant_of(color)
    assert torch.allclose(colors_of(coefficients, directions(1).float(), 3), color)
    assert pytest.approx(0.28209479177387814) == C0


def test_gradients_are_those_of_finite_differences() -> None:
    coefficients = torch.rand(3, 16, 3, dtype=torch.float64, requires_grad=True)
    d = directions(3).requires_grad_()
    assert torch.autograd.gradcheck(lambda c, v: colors_of(c, v, 3), (coefficients, d))
