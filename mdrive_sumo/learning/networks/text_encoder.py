"""TextEncoder: an instruction in English to a vector, trained from scratch on generated instructions."""

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import INSTRUCTION_WORDS
from mdrive_sumo.learning.networks.blocks import WIDTH, AttentionLayer

EMBEDDED_WORDS = 256
"""Room for the vocabulary of `agents.learned.instructions`."""


class TextEncoder(nn.Module):
    """Words with their places, two layers of attention among them, the mean over the words that are there."""

    def __init__(self) -> None:
        super().__init__()
        self.words = nn.Embedding(EMBEDDED_WORDS, WIDTH)
        self.places = nn.Parameter(0.1 * torch.randn(INSTRUCTION_WORDS, WIDTH))
        self.layers = nn.ModuleList([AttentionLayer(), AttentionLayer()])

    def forward(self, words: Tensor) -> tuple[Tensor, Tensor]:
        """Return tokens (batch, INSTRUCTION_WORDS, WIDTH) and their mean (batch, WIDTH); words: numbers, 0: padding."""
        is_word = (words > 0)[..., None].to(self.places.dtype)
        tokens = (self.words(words) + self.places) * is_word
        for layer in self.layers:
            tokens = layer(tokens, tokens)
        return tokens, (tokens * is_word).sum(dim=1) / is_word.sum(dim=1).clamp(min=1.0)
