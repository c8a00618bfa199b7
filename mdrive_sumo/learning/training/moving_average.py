"""MovingAverage: weights averaged over the last steps, which drive better than the last ones."""

import copy

import torch
from torch import Tensor, nn


class MovingAverage:
    """An exponential average of the floating numbers of a network, statistics of normalisation included."""

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.network = copy.deepcopy(network).eval().requires_grad_(False)
        self.decay = decay

    def update(self, network: nn.Module, step: int) -> None:
        """Move the average towards a network. It follows faster in the first steps."""
        share = 1.0 - min(self.decay, (1.0 + step) / (10.0 + step))
        with torch.no_grad():
            torch._foreach_lerp_(_list_floats(self.network), _list_floats(network), share)


def _list_floats(network: nn.Module) -> list[Tensor]:
    return [each.detach() for each in network.state_dict().values() if each.is_floating_point()]
