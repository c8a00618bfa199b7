"""DialogueStore: all dialogues of a data set in the memory of one device, and batches of them."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from mdrive_sumo.learning.dialogue.dialogue_samples import DialogueSamples

ROUNDED_TO = 32
"""Batches are cut to a multiple of so many entries: shapes repeat, which a GPU's memory manager needs."""


class DialogueBatch(NamedTuple):
    """B dialogues, cut after the longest."""

    entries: Tensor
    """(B, T)"""
    answer_start: Tensor
    """(B,)"""
    head_end: Tensor
    """(B,)"""
    length: Tensor
    """(B,)"""
    ranks: Tensor
    """(B, MAX_MEMBERS), as in `DialogueSamples`."""
    actions: Tensor
    """(B, MAX_MEMBERS), as in `DialogueSamples`."""

    def find_answer(self) -> Tensor:
        """Return a mask (B, T - 1): True where the next entry belongs to the answer."""
        position = torch.arange(1, self.entries.shape[1], device=self.entries.device)
        return (position >= self.answer_start[:, None]) & (position < self.length[:, None])

    def find_head(self) -> Tensor:
        """Return a mask (B, T - 1): True where the next entry belongs to the head of the answer."""
        position = torch.arange(1, self.entries.shape[1], device=self.entries.device)
        return (position >= self.answer_start[:, None]) & (position < self.head_end[:, None])

    def find_prompt(self) -> Tensor:
        """Return a mask (B, T - 1): True where the next entry belongs to the prompt."""
        position = torch.arange(1, self.entries.shape[1], device=self.entries.device)
        return position < self.answer_start[:, None]


class DialogueStore:
    """Dialogues on a device: 1 kB each."""

    def __init__(self, samples: DialogueSamples, device: torch.device) -> None:
        self.dialogues = len(samples)
        self.device = device
        arrays = samples.get_arrays() | {"entries": samples.entries.view(np.int16)}  # GPUs do not index uint16
        self._tensors = {name: torch.from_numpy(each).to(device) for name, each in arrays.items()}

    def take(self, rows: Tensor) -> DialogueBatch:
        """Return the dialogues at rows (B,)."""
        taken = {name: each[rows].long() for name, each in self._tensors.items() if name != "entries"}
        longest = int(taken["length"].max())
        size = min(-(-longest // ROUNDED_TO) * ROUNDED_TO, self._tensors["entries"].shape[1])
        return DialogueBatch(self._tensors["entries"][rows, :size].long(), **taken)
