"""MovingAverage: weights averaged over the last steps, which drive better than the last ones."""

import copy

import torch
from torch import Tensor, nn


class MovingAverage:
    """An exponential average of the floating numbers of a network, statistics of normalisation included."""

    def __init__(self, source: nn.Module, decay: float) -> None:
        self.network = copy.deepcopy(source).eval().requires_grad_(False)
        self.decay = decay
        self._averages, self._sources = _list_floats(self.network), _list_floats(source)

    def update(self, step: int) -> None:
        """Move the average towards the source as it is now. It follows faster in the first steps."""
        share = 1.0 - min(self.decay, (1.0 + step) / (10.0 + step))
        with torch.no_grad():
            torch._foreach_lerp_(self._averages, self._sources, share)


def _list_floats(network: nn.Module) -> list[Tensor]:
    """Return parameters and statistics; later changes of a network, loading included, happen in these tensors."""
    return [each.detach() for each in network.state_dict().values() if each.is_floating_point()]
