"""Write dialogues about collected situations, in worker processes.

What is in an archive depends on the situations and the settings only. Nothing is simulated, so an interrupted command
begins anew.
"""

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.learning.dialogue.compose_dialogues import (
    DialoguePair,
    compose_conversation,
    compose_pairs,
    is_usable,
    leave_out_objects,
)
from mdrive_sumo.learning.dialogue.dialogue_files import remove_dialogues, write_index, write_pairs, write_shard
from mdrive_sumo.learning.dialogue.dialogue_samples import Dialogue, DialoguePairs, encode_dialogues
from mdrive_sumo.learning.dialogue.situation_collection import list_situation_files
from mdrive_sumo.learning.dialogue.situations import Situation, read_situations
from mdrive_sumo.negotiation.dialogue.vocabulary import SAY, load_vocabulary
from mdrive_sumo.runs.executor import run_jobs
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.worker_process import WorkerFailure, describe_write_error

FILES_A_SHARD = 50
"""Files of situations whose dialogues are in one archive: some thousand."""
SHARD_LIMIT_S = 1800.0
"""Wall clock of one archive: it ends what hangs."""
TWINS = ("words", "perception")
"""What can be left out, for a twin of the model: words of all messages; objects that sensors and messages show."""


@dataclass(frozen=True, slots=True)
class DialogueSettings:
    """What decides the dialogues about given situations."""

    seed: int = 0
    repeats: int = 12
    """Conversations about each situation."""
    without: str = ""
    """One of `TWINS`, or nothing."""


@dataclass(frozen=True, slots=True)
class DialogueJob:
    """One archive to write."""

    settings: DialogueSettings
    split: str
    number: int
    files: tuple[Path, ...]
    folder: Path


@dataclass(frozen=True, slots=True)
class DialogueShard:
    """An archive that was written, or what all have together."""

    situations: int = 0
    dialogues: int = 0
    pairs: int = 0

    def add(self, other: "DialogueShard") -> "DialogueShard":
        """Return the sums."""
        return DialogueShard(
            self.situations + other.situations, self.dialogues + other.dialogues, self.pairs + other.pairs
        )


def collect_dialogues(
    settings: DialogueSettings, sources: Sequence[Path], folder: Path, workers: int, note: Callable[[str], None]
) -> DialogueShard:
    """Write the dialogues about all situations of some folders; return what was written. Raises InputError."""
    split, files = _list_files(sources)
    chunks = [tuple(files[i : i + FILES_A_SHARD]) for i in range(0, len(files), FILES_A_SHARD)]
    jobs = [DialogueJob(settings, split, i, chunk, folder.resolve()) for i, chunk in enumerate(chunks)]
    written: dict[int, DialogueShard] = {}
    try:
        make_folder(folder)
        remove_dialogues(folder)
        with make_executor(write_dialogue_shard, min(workers, len(jobs)), SHARD_LIMIT_S) as executor:
            for job, outcome in run_jobs(executor, jobs):
                if isinstance(outcome, WorkerFailure):
                    raise InputError(f"dialogues of {job.files[0].name}: {outcome.reason}")
                written[job.number] = outcome
                note(f"{len(written)}/{len(jobs)}  {outcome.dialogues} dialogues, {outcome.pairs} pairs")
        shards = [number for number, shard in sorted(written.items()) if shard.dialogues]
        if not shards:
            raise InputError(f"{sources[0]}: expected situations of groups that this split may have, found none")
        pairs = [number for number in shards if written[number].pairs]
        write_index(folder, split, load_vocabulary().digest, shards, pairs)
    except OSError as error:
        raise InputError(describe_write_error(error, error.filename or folder)) from None
    total = DialogueShard()
    for shard in written.values():
        total = total.add(shard)
    return total


def _list_files(sources: Sequence[Path]) -> tuple[str, list[Path]]:
    """Return the split of the folders, which is the same, and all files. Raises InputError."""
    found = [list_situation_files(source) for source in sources]
    splits = [split for split, _ in found]
    for source, split in zip(sources, splits, strict=True):
        if split != splits[0]:
            raise InputError(f"{source}: expected situations of the split {splits[0]}, as before, found {split}")
    return splits[0], [path for _, paths in found for path in paths]


def write_dialogue_shard(job: DialogueJob) -> DialogueShard:
    """Write the dialogues and pairs about the situations of some files. Raises InputError and OSError."""
    vocabulary = load_vocabulary()
    situations, dialogues, pairs = 0, list[Dialogue](), list[DialoguePair]()
    for path in job.files:
        for number, situation in enumerate(read_situations(path)):
            if not is_usable(situation, job.split):
                continue
            situations += 1
            key = f"{situation.scenario} {situation.tick} {number}"
            for new, better in _compose(job, situation, key):
                dialogues += new
                pairs += better
    if dialogues:
        write_shard(job.folder, job.number, encode_dialogues(vocabulary, dialogues))
    if pairs:
        better = encode_dialogues(vocabulary, [pair.better for pair in pairs])
        worse = encode_dialogues(vocabulary, [pair.worse for pair in pairs])
        write_pairs(job.folder, job.number, DialoguePairs(better, worse))
    return DialogueShard(situations, len(dialogues), len(pairs))


def _compose(job: DialogueJob, situation: Situation, key: str) -> Iterator[tuple[list[Dialogue], list[DialoguePair]]]:
    """Yield the dialogues and pairs of each conversation about a situation."""
    settings, vocabulary = job.settings, load_vocabulary()
    is_held_out = job.split != "train"
    if settings.without == "perception":
        situation = leave_out_objects(situation)
    for repeat in range(settings.repeats):
        draw = random.Random(derive_seed(settings.seed, "dialogue", key, str(repeat)))
        dialogues = compose_conversation(situation, draw, vocabulary, is_held_out)
        pairs = compose_pairs(situation, draw, vocabulary, is_held_out)
        if settings.without == "words":
            dialogues = [drop_words(dialogue) for dialogue in dialogues]
            pairs = [DialoguePair(drop_words(pair.better), drop_words(pair.worse)) for pair in pairs]
        yield dialogues, pairs


def drop_words(dialogue: Dialogue) -> Dialogue:
    """Return a dialogue in which all messages are heads."""
    lines = tuple(line.split(":", 1)[0] if line.startswith("said ") else line for line in dialogue.lines)
    answer = dialogue.answer.split(":", 1)[0] if dialogue.task == SAY else dialogue.answer
    return replace(dialogue, lines=lines, answer=answer)
