"""Losses of the negotiator: entries of answers, fields of agreements, and preferences between two answers."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from mdrive_sumo.learning.dialogue.dialogue_samples import UNKNOWN
from mdrive_sumo.learning.dialogue.training.dialogue_store import DialogueBatch

HEAD_WEIGHT = 4.0
"""Of an entry of the head, against 1 of a word: the head decides, and has a third of the entries. Chosen."""
PROMPT_WEIGHT = 0.1
"""Of the mean loss of prompts, which teaches what situations are like. Chosen."""
FIELD_WEIGHT = 0.5
"""Of the loss of the fields. Chosen."""
PREFERENCE_SHARPNESS = 0.1
"""Beta of direct preference optimisation (Rafailov et al. 2023), their value for summaries and dialogues."""


def compute_dialogue_losses(network: Any, batch: DialogueBatch) -> Mapping[str, Tensor]:
    """Return the parts of the loss of a batch and their `total`."""
    features = network(batch.entries[:, :-1])
    losses = compute_entry_losses(network.score(features), batch)
    is_head, is_answer = batch.find_head(), batch.find_answer()
    parts = {
        "head": _average(losses, is_head),
        "words": _average(losses, is_answer & ~is_head),
        "prompt": _average(losses, batch.find_prompt()),
        "fields": compute_field_loss(network, features, batch),
    }
    weights = torch.where(is_head, HEAD_WEIGHT, 1.0) * is_answer
    answer = (losses * weights).sum() / weights.sum().clamp(min=1.0)
    total = answer + PROMPT_WEIGHT * parts["prompt"] + FIELD_WEIGHT * parts["fields"]
    return parts | {"total": total}


def compute_entry_losses(scores: Tensor, batch: DialogueBatch) -> Tensor:
    """Return the loss (B, T - 1) of each entry but the first, by scores (B, T - 1, vocabulary)."""
    entries = batch.entries[:, 1:]
    losses = functional.cross_entropy(scores.flatten(0, 1).float(), entries.flatten(), reduction="none")
    return losses.reshape(entries.shape)


def compute_field_loss(network: Any, features: Tensor, batch: DialogueBatch) -> Tensor:
    """Return the loss of rank and action of the members, judged where the prompt ends."""
    rows = torch.arange(len(features), device=features.device)
    fields = network.judge_fields(features[rows, batch.answer_start - 1])
    losses = [
        functional.cross_entropy(scores.float().flatten(0, 1), labels.flatten(), ignore_index=UNKNOWN, reduction="sum")
        / (labels != UNKNOWN).sum().clamp(min=1)
        for scores, labels in zip(fields, (batch.ranks, batch.actions), strict=True)
    ]
    return losses[0] + losses[1]


def compute_answer_likelihood(network: Any, batch: DialogueBatch) -> Tensor:
    """Return the log-likelihood (B,) of each answer."""
    losses = compute_entry_losses(network.score(network(batch.entries[:, :-1])), batch)
    return -(losses * batch.find_answer()).sum(dim=1)


def compute_preference_loss(better: Tensor, worse: Tensor, better_before: Tensor, worse_before: Tensor) -> Tensor:
    """Return the loss of direct preference optimisation from log-likelihoods (B,), now and before the training."""
    margin = (better - better_before) - (worse - worse_before)
    return -functional.logsigmoid(PREFERENCE_SHARPNESS * margin).mean()


def _average(losses: Tensor, mask: Tensor) -> Tensor:
    return (losses * mask).sum() / mask.sum().clamp(min=1)
