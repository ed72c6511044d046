"""The one network shape of the paper's small predictors: two linear layers with a ReLU between them."""

from __future__ import annotations

from torch import Tensor, nn

from aa4d.kernels.two_layer import Layers, two_layer


class TwoLayer(nn.Module):
    """output(relu(hidden(x))), Xavier-uniform weights and torch's own biases, as in 4D-GS.

    Biases matter: with none, the ReLUs that see time would all have their kink at t = 0, and start linear in it. With
    `zero_output` the network starts as the zero function, and its first step changes the output layer alone.
    """

    def __init__(self, inputs: int, hidden: int, outputs: int, *, zero_output: bool = False) -> None:
        super().__init__()
        self.hidden = nn.Linear(inputs, hidden)
        self.output = nn.Linear(hidden, outputs)
        for layer in (self.hidden, self.output):
            nn.init.xavier_uniform_(layer.weight)
        if zero_output:
            nn.init.zeros_(self.output.weight)
            nn.init.zeros_(self.output.bias)

        self.arithmetic = "float32"  # of its products

    def layers(self) -> Layers:
        return self.hidden.weight, self.hidden.bias, self.output.weight, self.output.bias

    def forward(self, x: Tensor, t: float | None = None) -> Tensor:
        """[N, inputs], or [N, inputs - 1] and a time that is the last input of all -> [N, outputs]."""
        return two_layer(x, [self.layers()], t, self.arithmetic)[0]


def evaluate_together(networks: tuple[TwoLayer, ...], x: Tensor) -> tuple[Tensor, ...]:
    """Several networks of the same input: cheaper than one after another."""
    return two_layer(x, [network.layers() for network in networks], arithmetic=networks[0].arithmetic)


def use_arithmetic(model: nn.Module, name: str) -> None:
    """Let every `TwoLayer` of a model multiply so from now on; `name` of aa4d.kernels.two_layer.ARITHMETIC."""
    for module in model.modules():
        if isinstance(module, TwoLayer):
            module.arithmetic = name
