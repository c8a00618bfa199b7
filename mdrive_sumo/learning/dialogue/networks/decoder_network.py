"""DecoderNetwork: a causal transformer over the vocabulary of negotiations, small enough for one core."""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from mdrive_sumo.negotiation.dialogue.answers import MAX_MEMBERS
from mdrive_sumo.negotiation.dialogue.decoder_shape import DecoderShape
from mdrive_sumo.v2x.messages import Intention

ROTARY_BASE = 10_000.0
"""Su et al. 2021, "RoFormer", section 3.2.2."""
NORM_FLOOR = 1e-6
"""Keeps the norm of zeros finite; as in Llama."""

HIDDEN_SCORE = -1e9
"""Score of attention to an entry that lies later: its weight is 0."""


class DecoderNetwork(nn.Module):
    """Scores of the next entry of the vocabulary at every position.

    Llama's blocks (Touvron et al. 2023): root mean square normalisation before attention and MLP, rotary positions,
    gated MLP; several query heads share a head of keys and values (Ainslie et al. 2023), which keeps the cache small;
    entries in and out have the same embedding.
    """

    def __init__(self, shape: DecoderShape) -> None:
        super().__init__()
        self.shape = shape
        self.embedding = nn.Embedding(shape.vocabulary, shape.width)
        self.blocks = nn.ModuleList(_Block(shape) for _ in range(shape.layers))
        self.norm = _RootMeanSquareNorm(shape.width)
        self.ranks = nn.Linear(shape.width, MAX_MEMBERS * MAX_MEMBERS)
        self.actions = nn.Linear(shape.width, MAX_MEMBERS * len(Intention))
        angles = torch.outer(
            torch.arange(shape.context),
            torch.pow(ROTARY_BASE, -torch.arange(0, shape.head_width, 2) / shape.head_width),
        )
        self.register_buffer("cosines", angles.cos(), persistent=False)
        self.register_buffer("sines", angles.sin(), persistent=False)
        self.apply(_initialise)

    def forward(self, entries: Tensor) -> Tensor:
        """Return the features (batch, T, width) of entries (batch, T); `score` turns them into scores."""
        size = entries.shape[1]
        cosines, sines = self.cosines[:size], self.sines[:size]
        features = self.embedding(entries)
        for block in self.blocks:
            features = block(features, cosines, sines)
        return self.norm(features)

    def score(self, features: Tensor) -> Tensor:
        """Return the scores (..., vocabulary) of the next entry."""
        return functional.linear(features, self.embedding.weight)

    def judge_fields(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return the scores (batch, member, rank) and (batch, member, action) at the ends of prompts (batch, width).

        Only the training uses them: they make the network weigh the agreement before it writes it down.
        """
        ranks = self.ranks(features).reshape(-1, MAX_MEMBERS, MAX_MEMBERS)
        return ranks, self.actions(features).reshape(-1, MAX_MEMBERS, len(Intention))


class CachedDecoder(nn.Module):
    """The same network with the keys and values of earlier entries as an input, for one dialogue at a time."""

    def __init__(self, network: DecoderNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, entries: Tensor, past: Tensor) -> tuple[Tensor, Tensor]:
        """Return the scores (vocabulary,) after the last of entries (T,), and their keys and values.

        past, and the second result: (positions, layers, 2, key-value heads, head width).
        """
        network = self.network
        before, size = past.shape[0], entries.shape[0]
        positions = torch.arange(before, before + size, device=entries.device)
        cosines, sines = network.cosines[positions], network.sines[positions]
        is_later = torch.arange(before + size, device=entries.device) > positions[:, None]
        bias = is_later.to(past.dtype) * HIDDEN_SCORE
        features = network.embedding(entries)
        present: list[Tensor] = []
        for layer, block in enumerate(network.blocks):
            features, keys_values = block.extend(features, past[:, layer], cosines, sines, bias)
            present.append(keys_values)
        return network.score(network.norm(features[-1])), torch.stack(present, dim=1)


class _Block(nn.Module):
    def __init__(self, shape: DecoderShape) -> None:
        super().__init__()
        self.shape = shape
        together = (shape.heads + 2 * shape.shared_heads) * shape.head_width
        self.attention_norm = _RootMeanSquareNorm(shape.width)
        self.attention_in = nn.Linear(shape.width, together, bias=False)
        self.attention_out = nn.Linear(shape.heads * shape.head_width, shape.width, bias=False)
        self.mlp_norm = _RootMeanSquareNorm(shape.width)
        self.mlp_in = nn.Linear(shape.width, 2 * shape.mlp_width, bias=False)
        self.mlp_out = nn.Linear(shape.mlp_width, shape.width, bias=False)

    def forward(self, features: Tensor, cosines: Tensor, sines: Tensor) -> Tensor:
        batch, size, _ = features.shape
        queries, keys, values = self._project(features, cosines, sines)  # (batch, T, heads, head width)
        group = self.shape.heads // self.shape.shared_heads
        found = functional.scaled_dot_product_attention(
            queries.transpose(1, 2),
            keys.transpose(1, 2).repeat_interleave(group, dim=1),
            values.transpose(1, 2).repeat_interleave(group, dim=1),
            is_causal=True,
        )
        features = features + self.attention_out(found.transpose(1, 2).reshape(batch, size, -1))
        return features + self._think(features)

    def extend(
        self, features: Tensor, past: Tensor, cosines: Tensor, sines: Tensor, bias: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the features (T, width) of new entries, and their keys and values (T, 2, shared heads, head width).

        past: those of earlier entries. bias: (T, earlier + T), `HIDDEN_SCORE` for entries that lie later, else 0.
        """
        size = features.shape[0]
        queries, keys, values = self._project(features, cosines, sines)
        present = torch.stack((keys, values), dim=1)
        everything = torch.cat((past, present))
        keys, values = everything[:, 0].permute(1, 2, 0), everything[:, 1].transpose(0, 1)
        group = self.shape.heads // self.shape.shared_heads
        queries = queries.reshape(size, self.shape.shared_heads, group, -1).permute(1, 2, 0, 3)
        scores = torch.matmul(queries / math.sqrt(self.shape.head_width), keys[:, None]) + bias
        found = torch.matmul(torch.softmax(scores, dim=-1), values[:, None])  # (shared heads, group, T, head width)
        features = features + self.attention_out(found.permute(2, 0, 1, 3).reshape(size, -1))
        return features + self._think(features), present

    def _project(self, features: Tensor, cosines: Tensor, sines: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return queries, keys and values (..., T, heads, head width), the first two rotated by their positions."""
        heads, shared = self.shape.heads, self.shape.shared_heads
        together = self.attention_in(self.attention_norm(features))
        together = together.reshape(*features.shape[:-1], heads + 2 * shared, self.shape.head_width)
        rotated = _rotate(together[..., : heads + shared, :], cosines, sines)
        return rotated[..., :heads, :], rotated[..., heads:, :], together[..., heads + shared :, :]

    def _think(self, features: Tensor) -> Tensor:
        gate, value = self.mlp_in(self.mlp_norm(features)).chunk(2, dim=-1)
        return self.mlp_out(functional.silu(gate) * value)


class _RootMeanSquareNorm(nn.Module):
    """`torch.nn.RMSNorm` by operators that the exporter knows, in single precision."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(width))

    def forward(self, features: Tensor) -> Tensor:
        exact = features.float()
        return exact * torch.rsqrt((exact * exact).mean(dim=-1, keepdim=True) + NORM_FLOOR) * self.weight


def _rotate(values: Tensor, cosines: Tensor, sines: Tensor) -> Tensor:
    """Return values (..., T, heads, head width) rotated by angles (T, head width / 2), the halves being the axes."""
    first, second = values.chunk(2, dim=-1)
    cosines, sines = cosines[:, None].to(values.dtype), sines[:, None].to(values.dtype)
    return torch.cat((first * cosines - second * sines, first * sines + second * cosines), dim=-1)


def _initialise(module: nn.Module) -> None:
    if isinstance(module, nn.Linear | nn.Embedding):
        nn.init.normal_(module.weight, std=0.02)
        if isinstance(module, nn.Linear) and module.bias is not None:
            nn.init.zeros_(module.bias)
