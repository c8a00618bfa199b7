"""Trainers of the negotiator: on dialogues, and on preferences between two answers."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from mdrive_sumo.learning.dialogue.dialogue_samples import DialoguePairs, DialogueSamples
from mdrive_sumo.learning.dialogue.networks.decoder_network import DecoderNetwork
from mdrive_sumo.learning.dialogue.training.dialogue_losses import (
    compute_answer_likelihood,
    compute_dialogue_losses,
    compute_entry_losses,
    compute_preference_loss,
)
from mdrive_sumo.learning.dialogue.training.dialogue_store import DialogueStore
from mdrive_sumo.learning.training.checkpoint import Checkpoint, take_weights
from mdrive_sumo.learning.training.trainer import Trainer
from mdrive_sumo.learning.training.training_options import TrainingOptions
from mdrive_sumo.negotiation.dialogue.decoder_shape import NEGOTIATOR, DecoderShape
from mdrive_sumo.negotiation.dialogue.dialogue_manifest import SYSTEM

JUDGED_BATCH = 128
"""Dialogues that are judged at once."""
MOST_JUDGED = 4096
"""Dialogues that are judged at each look, spread over all."""
KEPT_WEIGHT = 0.1
"""Of the loss on better answers beside the preferences, so that these do not make all answers less likely. Chosen."""


class DialogueTrainer(Trainer):
    """The network, its average, optimiser and random numbers; `train` takes a `DialogueStore` as data."""

    chosen_by: ClassVar[str] = "validation/wrong_head"

    def __init__(
        self,
        options: TrainingOptions,
        device: torch.device,
        report: Callable[[str], object] = str,
        shape: DecoderShape = NEGOTIATOR,
    ) -> None:
        """Build a network with fresh weights."""
        super().__init__(SYSTEM, options, device, report, lambda _: DecoderNetwork(shape))

    def begin_with(self, checkpoint: Checkpoint) -> None:
        """Take the chosen weights of a checkpoint. Raises InputError for those of another network."""
        for network in (self.network, self.average.network):
            take_weights(network, checkpoint.chosen, self.system)

    def _compute_losses(self, data: Any, rows: Tensor) -> Mapping[str, Tensor]:
        assert isinstance(data, DialogueStore)
        self.network.train()
        with self._autocast():
            return compute_dialogue_losses(self.network, data.take(rows))

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.device.type == "cuda")


@dataclass(frozen=True, slots=True)
class PairStore:
    """Pairs of answers on a device, with their log-likelihoods (N,) before the training."""

    better: DialogueStore
    worse: DialogueStore
    better_before: Tensor
    worse_before: Tensor


class PreferenceTrainer(DialogueTrainer):
    """Makes better answers likelier than worse ones (Rafailov et al. 2023); `train` takes a `PairStore` as data."""

    def prepare_pairs(self, pairs: DialoguePairs) -> PairStore:
        """Return pairs on the device, judged by the network as it is now."""
        better, worse = (DialogueStore(samples, self.device) for samples in (pairs.better, pairs.worse))
        return PairStore(better, worse, self._measure_likelihoods(better), self._measure_likelihoods(worse))

    def _measure_likelihoods(self, data: DialogueStore) -> Tensor:
        rows = torch.arange(data.dialogues, device=self.device)
        with torch.no_grad(), self._autocast():
            return torch.cat(
                [compute_answer_likelihood(self.network, data.take(part)) for part in rows.split(JUDGED_BATCH)]
            )

    def _compute_losses(self, data: Any, rows: Tensor) -> Mapping[str, Tensor]:
        assert isinstance(data, PairStore)
        self.network.train()
        with self._autocast():
            better = data.better.take(rows)
            kept = compute_dialogue_losses(self.network, better)["total"]
            better_now = compute_answer_likelihood(self.network, better)
            worse_now = compute_answer_likelihood(self.network, data.worse.take(rows))
        better_before, worse_before = data.better_before[rows], data.worse_before[rows]
        preference = compute_preference_loss(better_now, worse_now, better_before, worse_before)
        preferred = (better_now - better_before > worse_now - worse_before).float().mean()
        total = preference + KEPT_WEIGHT * kept
        return {"preference": preference, "kept": kept, "preferred": preferred, "total": total}


@dataclass(frozen=True, slots=True)
class DialogueJudge:
    """Measures a network on dialogues of places that it is not trained on."""

    data: DialogueStore

    @classmethod
    def build(cls, samples: DialogueSamples, device: torch.device) -> "DialogueJudge":
        """Return what judges by these dialogues."""
        return cls(DialogueStore(samples, device))

    def look(self, network: Any) -> dict[str, float]:
        """Return the share of answers whose head has a wrong entry, and losses of head and words.

        Each entry is judged after the right ones before it. Decoding writes a head without a wrong entry as it is, as
        the grammar never takes the right entry away; what it forbids may be wrong here, so the share is an upper bound.
        """
        step = max(1, -(-self.data.dialogues // MOST_JUDGED))
        rows = torch.arange(0, self.data.dialogues, step, device=self.data.device)
        wrong, head, words = [], [], []
        with torch.no_grad():
            for part in rows.split(JUDGED_BATCH):
                batch = self.data.take(part)
                scores = network.score(network(batch.entries[:, :-1]))
                losses, is_head = compute_entry_losses(scores, batch), batch.find_head()
                is_wrong = (scores.argmax(dim=-1) != batch.entries[:, 1:]) & is_head
                wrong.append(is_wrong.any(dim=1).float())
                head.append(losses[is_head])
                words.append(losses[batch.find_answer() & ~is_head])
        return {
            "validation/wrong_head": float(torch.cat(wrong).mean()),
            "validation/head": float(torch.cat(head).mean()),
            "validation/words": float(torch.cat(words).mean()),
        }
