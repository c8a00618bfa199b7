"""How maps of several cars become one: four fusions with the same inputs.

Each takes maps (F, N, C, H, W) in the receiver's frame, car 0 is the receiver; how much of each cell arrived (F, N, 1,
H, W) in [0, 1], 0 for cars that are not there; and ages (F, N, 1, 1, 1) [0.3 s]. Each returns maps (F, C, H, W). They
have the idea of the published fusion of their name in the size of this project, and are not the originals.
"""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.fusion_spec import CODRIVING, FEATURE_CHANNELS

FAR = -1e4
"""Added to a score of what did not arrive: its weight is 0 in single and in half precision."""
ARRIVED = 0.5
"""Share of a cell from which on it takes part."""


def _start_small(layer: nn.Conv2d | nn.Linear) -> None:
    """Begin near 0, so that a fresh fusion leaves trained features almost as they are."""
    nn.init.normal_(layer.weight, std=1e-2)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)


def split_cars(maps: Tensor, like: Tensor) -> Tensor:
    """Return maps (F * N, C, H, W) as (F, N, C, H, W), with the F and N of `like`.

    An exported network takes any N: only the other sizes are constants in it, which `unflatten` makes of all.
    """
    return maps.reshape(like.shape[0], like.shape[1], *(int(size) for size in maps.shape[1:]))


def _apply(layers: nn.Module, maps: Tensor) -> Tensor:
    """Return what layers make of each map of (F, N, C, H, W)."""
    return split_cars(layers(maps.flatten(0, 1)), maps)


def _add_age(maps: Tensor, age: Tensor) -> Tensor:
    """Return maps (F, N, C + 1, H, W) with the age as a channel."""
    return torch.cat((maps, age.expand(-1, -1, 1, int(maps.shape[3]), int(maps.shape[4]))), dim=2)


def _weigh(scores: Tensor, arrived: Tensor) -> Tensor:
    """Return weights (F, N, 1, H, W) over the cars, of scores; 0 for what did not arrive."""
    return torch.softmax(_hide_missing(scores, arrived), dim=1)


def _hide_missing(scores: Tensor, arrived: Tensor) -> Tensor:
    return scores + FAR * (arrived < ARRIVED).to(scores.dtype)


class MaxFusion(nn.Module):
    """F-Cooper (Chen et al. 2019, section 4.3): of each feature the largest of all cars."""

    def forward(self, maps: Tensor, arrived: Tensor, age: Tensor) -> Tensor:  # noqa: ARG002 - as the others
        """See the module."""
        return (maps * arrived).amax(dim=1)


class AttentionFusion(nn.Module):
    """AttFuse (Xu et al. 2022, OPV2V, section IV-C): at each place the receiver attends to the features of all cars."""

    def __init__(self) -> None:
        super().__init__()
        channels = FEATURE_CHANNELS
        self.query = nn.Conv2d(channels, channels, 1)
        self.key = nn.Conv2d(channels + 1, channels, 1)
        self.value = nn.Conv2d(channels, channels, 1, bias=False)
        nn.init.dirac_(self.value.weight)

    def forward(self, maps: Tensor, arrived: Tensor, age: Tensor) -> Tensor:
        """See the module."""
        keys = _apply(self.key, _add_age(maps, age))
        scores = (self.query(maps[:, 0])[:, None] * keys).sum(dim=2, keepdim=True) / math.sqrt(FEATURE_CHANNELS)
        return (_weigh(scores, arrived) * _apply(self.value, maps)).sum(dim=1)


class GraphFusion(nn.Module):
    """DiscoNet (Li et al. 2021, section 3.2): an edge from each car to the receiver weighs every cell (a matrix)."""

    def __init__(self) -> None:
        super().__init__()
        hidden = 2 * FEATURE_CHANNELS
        self.of_own = nn.Conv2d(FEATURE_CHANNELS, hidden, 1)
        self.of_sender = nn.Conv2d(FEATURE_CHANNELS + 1, hidden, 1, bias=False)
        self.edge = nn.Conv2d(hidden, 1, 1)

    def forward(self, maps: Tensor, arrived: Tensor, age: Tensor) -> Tensor:
        """See the module."""
        hidden = self.of_own(maps[:, 0])[:, None] + _apply(self.of_sender, _add_age(maps, age))
        return (_weigh(_apply(self.edge, torch.relu(hidden)), arrived) * maps).sum(dim=1)


WINDOW = 4
"""Edge of a local window, and of the sparse grid, in cells: 6.4 m. Windows of 8 cost four times as much."""


class AxialFusion(nn.Module):
    """CoBEVT (Xu et al. 2022, section 3.2): fused axial attention, first in local windows, then over a sparse grid.

    Tokens of all cars are keys. Only the receiver's own tokens are queries: maps of senders are not needed afterwards.
    """

    def __init__(self) -> None:
        super().__init__()
        # Keys and values of both stages at once, and before windows are cut: four layers after it take 2 ms more.
        self.keys = nn.Conv2d(FEATURE_CHANNELS + 1, 4 * FEATURE_CHANNELS, 1)
        self.local = _AxialAttention()
        self.sparse = _AxialAttention()

    def forward(self, maps: Tensor, arrived: Tensor, age: Tensor) -> Tensor:
        """See the module."""
        keys = _apply(self.keys, _add_age(maps, age))
        local, sparse = keys[:, :, : 2 * FEATURE_CHANNELS], keys[:, :, 2 * FEATURE_CHANNELS :]
        own = maps[:, 0].permute(0, 2, 3, 1)
        own = own + self.local(own, _put_channels_last(local, arrived), is_sparse=False)
        own = own + self.sparse(own, _put_channels_last(sparse, arrived), is_sparse=True)
        return own.permute(0, 3, 1, 2)


def _put_channels_last(maps: Tensor, arrived: Tensor) -> Tensor:
    """Return cells (F, N, H, W, C + 1): windows are then cut in whole tokens, three times as fast on a processor."""
    return torch.cat((maps, arrived), dim=2).permute(0, 1, 3, 4, 2)


class _AxialAttention(nn.Module):
    """Attention of the receiver's tokens to those of all cars, in one kind of windows, with one head."""

    def __init__(self) -> None:
        super().__init__()
        width = FEATURE_CHANNELS
        self.query = nn.Linear(width, width)
        self.answer = nn.Linear(width, width)
        self.place = nn.Parameter(0.1 * torch.randn(WINDOW * WINDOW, WINDOW * WINDOW))
        """Score of each pair of places of a window."""
        _start_small(self.answer)

    def forward(self, own: Tensor, cells: Tensor, is_sparse: bool) -> Tensor:
        """Return what is added to own tokens (F, H, W, C); cells: (F, N, H, W, 2 C + 1) keys, values, what arrived."""
        tokens = _cut_windows(cells, is_sparse)
        key, value = tokens[..., :FEATURE_CHANNELS], tokens[..., FEATURE_CHANNELS:-1]
        query = self.query(_cut_windows(own[:, None], is_sparse))
        scores = torch.matmul(query, key.transpose(-1, -2)) / math.sqrt(FEATURE_CHANNELS)
        scores = scores + self.place.repeat(1, cells.shape[1])
        weights = torch.softmax(_hide_missing(scores, tokens[:, :, None, :, -1]), dim=-1)
        return _join_windows(self.answer(torch.matmul(weights, value)), int(own.shape[1]), is_sparse)


def _cut_windows(cells: Tensor, is_sparse: bool) -> Tensor:
    """Return cells (F, N, H, W, C) as tokens (F, windows, N * WINDOW * WINDOW, C), car by car.

    Local windows hold neighbours; a sparse one holds cells that are H / WINDOW apart.
    """
    frames, cars = cells.shape[:2]
    side, channels = int(cells.shape[2]), int(cells.shape[4])
    count = side // WINDOW
    shape = (WINDOW, count, WINDOW, count) if is_sparse else (count, WINDOW, count, WINDOW)
    cut = cells.reshape(frames, cars, *shape, channels)  # (F, N, row a, row b, column a, column b, C)
    order = (0, 3, 5, 1, 2, 4, 6) if is_sparse else (0, 2, 4, 1, 3, 5, 6)
    return cut.permute(order).reshape(frames, count * count, cars * WINDOW * WINDOW, channels)


def _join_windows(tokens: Tensor, side: int, is_sparse: bool) -> Tensor:
    """Return tokens (F, windows, WINDOW * WINDOW, C) of one car as cells (F, side, side, C)."""
    count, channels = side // WINDOW, int(tokens.shape[3])
    cells = tokens.reshape(tokens.shape[0], count, count, WINDOW, WINDOW, channels)  # (F, wy, wx, y, x, C)
    order = (0, 3, 1, 4, 2, 5) if is_sparse else (0, 1, 3, 2, 4, 5)
    return cells.permute(order).reshape(tokens.shape[0], side, side, channels)


class FusionGate(nn.Module):
    """How much of what fusion changed is taken, for each cell: of the own and fused features and the mean age.

    It can learn to fall back to the own map where received features contradict it, so that bad poses cost nothing.
    """

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(2 * FEATURE_CHANNELS + 2, FEATURE_CHANNELS, 1),
            nn.ReLU(inplace=True),
            nn.Conv2d(FEATURE_CHANNELS, 1, 3, padding=1),
        )
        last = self.layers[-1]
        assert isinstance(last, nn.Conv2d) and last.bias is not None
        _start_small(last)
        nn.init.constant_(last.bias, 2.0)  # open at first

    def forward(self, own: Tensor, fused: Tensor, arrived: Tensor, age: Tensor) -> Tensor:
        """Return maps (F, C, H, W) between own and fused ones; arrived, age as in the module."""
        others = arrived[:, 1:].sum(dim=1)
        mean_age = (arrived[:, 1:] * age[:, 1:]).sum(dim=1) / (others + 1e-3)
        gate = torch.sigmoid(self.layers(torch.cat((own, fused, others, mean_age), dim=1)))
        return own + gate * (fused - own)


FUSION_MODULES: Mapping[str, Callable[[], nn.Module]] = MappingProxyType(
    {
        "attfuse": AttentionFusion,
        "disconet": GraphFusion,
        "fcooper": MaxFusion,
        "cobevt": AxialFusion,
        CODRIVING: AttentionFusion,
    }
)
