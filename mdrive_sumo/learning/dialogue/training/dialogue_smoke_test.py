"""run_dialogue_smoke_test: a small network learns made-up dialogues by heart, on any machine."""

from dataclasses import dataclass
from pathlib import Path

import torch

from mdrive_sumo.learning.dialogue.synthetic_dialogues import build_synthetic_dialogues
from mdrive_sumo.learning.dialogue.training.dialogue_trainer import DialogueJudge
from mdrive_sumo.learning.dialogue.training.export_decoder import build_checkpoint_network
from mdrive_sumo.learning.dialogue.training.run_dialogue_training import DialogueRun, run_dialogue_training
from mdrive_sumo.learning.training.checkpoint import load_checkpoint
from mdrive_sumo.learning.training.training_options import TrainingOptions
from mdrive_sumo.negotiation.dialogue.decoder_shape import DecoderShape
from mdrive_sumo.negotiation.dialogue.dialogue_manifest import SYSTEM
from mdrive_sumo.negotiation.dialogue.vocabulary import load_vocabulary

SMALL = DecoderShape(width=64, layers=2, heads=4, shared_heads=2, mlp_width=128)
DIALOGUES, STEPS, BATCH = 8, 100, 8
"""Size of a run that takes seconds on one core."""
LEAST_KNOWN = 0.9
"""Share of the heads that it must know in the end."""


@dataclass(frozen=True, slots=True)
class DialogueSmokeResult:
    """What the network knows of the dialogues that it was trained on."""

    known: float
    """Share of the answers whose head has no wrong entry."""
    words: float
    """Loss of an entry of words."""

    @property
    def has_learned(self) -> bool:
        """Whether training did what it is for."""
        return self.known >= LEAST_KNOWN


def run_dialogue_smoke_test(folder: Path) -> DialogueSmokeResult:
    """Train `SMALL` for STEPS steps on the CPU and judge it on its own dialogues."""
    vocabulary = load_vocabulary()
    data = build_synthetic_dialogues(vocabulary, DIALOGUES, seed=0, most_members=2)
    judged = build_synthetic_dialogues(vocabulary, 2, seed=0, split="val", most_members=2)
    options = TrainingOptions(steps=STEPS, batch=BATCH, learning_rate=1e-2, log_every=STEPS, average_decay=0.8)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # on a busy machine, two threads that wait for each other take eight times as long
    try:
        path = run_dialogue_training(DialogueRun(options, "cpu", folder, data, judged, shape=SMALL), str)
        checkpoint = load_checkpoint(path, SYSTEM)
        checkpoint.best = {}  # the last weights: nothing made up can be learned from so few
        found = DialogueJudge.build(data, torch.device("cpu")).look(build_checkpoint_network(checkpoint))
    finally:
        torch.set_num_threads(threads)
    return DialogueSmokeResult(1 - found["validation/wrong_head"], found["validation/words"])
