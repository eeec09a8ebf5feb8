"""Dense layers whose weights are noisy while they learn (Fortunato et al. 2018, factorised Gaussian noise)."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

NOISE_PARTS = ("weight_sigma", "bias_sigma", "noise_in", "noise_out")
"""Last parts of the names of the tensors that only noise has: without them a layer is the plain one of the mean weights."""


class NoisyLinear(nn.Linear):
    """A dense layer with the mean weights `weight` and `bias`, to which noise is added in training mode.

    In evaluation mode it is the plain layer of its mean weights. The noise stays the same until `sample_noise`.

    sigma   the standard deviation of every weight at first is sigma / sqrt(inputs)
    """

    noise_in: Tensor
    noise_out: Tensor

    def __init__(self, inputs: int, outputs: int, sigma: float) -> None:
        super().__init__(inputs, outputs)
        bound = inputs**-0.5
        nn.init.uniform_(self.weight, -bound, bound)
        nn.init.uniform_(self.bias, -bound, bound)
        self.weight_sigma = nn.Parameter(torch.full((outputs, inputs), sigma * bound))
        self.bias_sigma = nn.Parameter(torch.full((outputs,), sigma * bound))
        self.register_buffer("noise_in", torch.zeros(inputs))
        self.register_buffer("noise_out", torch.zeros(outputs))
        self.sample()

    def sample(self, generator: torch.Generator | None = None) -> None:
        """Draw the noise anew: f(e) = sign(e) sqrt|e| of Gaussian numbers, one for each input and each output."""
        for noise in (self.noise_in, self.noise_out):
            drawn = torch.randn(noise.shape, generator=generator).to(noise.device)
            noise.copy_(drawn.sign() * drawn.abs().sqrt())

    def forward(self, input: Tensor) -> Tensor:
        if not self.training:
            return super().forward(input)
        weight = self.weight + self.weight_sigma * torch.outer(self.noise_out, self.noise_in)
        return functional.linear(input, weight, self.bias + self.bias_sigma * self.noise_out)


def sample_noise(net: nn.Module, generator: torch.Generator | None = None) -> bool:
    """Draw the noise of every noisy layer anew; return whether there is one."""
    layers = [module for module in net.modules() if isinstance(module, NoisyLinear)]
    for layer in layers:
        layer.sample(generator)
    return bool(layers)


def mean_weights(net: nn.Module) -> dict[str, Tensor]:
    """Return a network's tensors without those of the noise: the state of the same network of plain layers."""
    return {
        name: tensor
        for name, tensor in net.state_dict().items()
        if name.rpartition(".")[2] not in NOISE_PARTS
    }
