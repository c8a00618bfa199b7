"""Small building blocks of all networks."""

import torch
from torch import Tensor, nn
from torch.nn import functional

WIDTH = 64
"""Length of tokens and queries."""


class ConvBlock(nn.Sequential):
    """A convolution without bias, batch normalisation (an ONNX runtime folds it into the convolution) and ReLU."""

    def __init__(self, inputs: int, outputs: int, size: int = 3, stride: int = 1) -> None:
        super().__init__(
            nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False),
            nn.BatchNorm2d(outputs, momentum=0.02),
            nn.ReLU(inplace=True),
        )


class ResidualBlock(nn.Module):
    """Two 3 x 3 convolutions and a shortcut (He et al., 2016)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = ConvBlock(channels, channels)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, padding=1, bias=False), nn.BatchNorm2d(channels, momentum=0.02)
        )

    def forward(self, maps: Tensor) -> Tensor:
        """Return maps of the same shape (batch, channels, height, width)."""
        return functional.relu(maps + self.second(self.first(maps)))


class Mlp(nn.Sequential):
    """Two linear layers with ReLU between them."""

    def __init__(self, inputs: int, hidden: int, outputs: int) -> None:
        super().__init__(nn.Linear(inputs, hidden), nn.ReLU(inplace=True), nn.Linear(hidden, outputs))


class GatedCell(nn.Module):
    """One step of a gated recurrent unit (Cho et al., 2014), written out so that every exporter knows it."""

    def __init__(self, inputs: int, hidden: int) -> None:
        super().__init__()
        self.of_input = nn.Linear(inputs, 3 * hidden)
        self.of_state = nn.Linear(hidden, 3 * hidden)

    def forward(self, inputs: Tensor, state: Tensor) -> Tensor:
        """Return the next state (batch, hidden) for inputs (batch, inputs)."""
        reset_in, update_in, new_in = self.of_input(inputs).chunk(3, dim=-1)
        reset_state, update_state, new_state = self.of_state(state).chunk(3, dim=-1)
        reset = torch.sigmoid(reset_in + reset_state)
        update = torch.sigmoid(update_in + update_state)
        new = torch.tanh(new_in + reset * new_state)
        return update * state + (1.0 - update) * new


class AttentionLayer(nn.Module):
    """Queries look at tokens (multi-head attention, Vaswani et al., 2017), then a feed-forward part; both residual."""

    def __init__(self, width: int = WIDTH, heads: int = 4) -> None:
        super().__init__()
        self.heads = heads
        self.query_norm = nn.LayerNorm(width)
        self.token_norm = nn.LayerNorm(width)
        self.query = nn.Linear(width, width)
        self.key = nn.Linear(width, width)
        self.value = nn.Linear(width, width)
        self.merge = nn.Linear(width, width)
        self.forward_norm = nn.LayerNorm(width)
        self.feed_forward = Mlp(width, 2 * width, width)

    def _split(self, tokens: Tensor) -> Tensor:
        return tokens.unflatten(-1, (self.heads, -1)).transpose(1, 2)

    def forward(self, queries: Tensor, tokens: Tensor) -> Tensor:
        """Return queries (batch, Q, width) after a look at tokens (batch, T, width)."""
        normed = self.token_norm(tokens)
        attended = functional.scaled_dot_product_attention(
            self._split(self.query(self.query_norm(queries))),
            self._split(self.key(normed)),
            self._split(self.value(normed)),
        )
        queries = queries + self.merge(attended.transpose(1, 2).flatten(2))
        return queries + self.feed_forward(self.forward_norm(queries))


def flatten_map(maps: Tensor) -> Tensor:
    """Return the cells of maps (batch, channels, height, width) as tokens (batch, height * width, channels)."""
    return maps.flatten(2).transpose(1, 2)
