"""Dialogues on disk: a folder with `dialogues.json` and archives of arrays."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_json_file
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.learning.array_files import read_arrays, write_arrays
from mdrive_sumo.learning.dialogue.dialogue_samples import UNKNOWN, DialoguePairs, DialogueSamples
from mdrive_sumo.learning.sample_format import SPLITS
from mdrive_sumo.negotiation.dialogue.answers import MAX_MEMBERS
from mdrive_sumo.negotiation.dialogue.decoder_shape import NEGOTIATOR
from mdrive_sumo.v2x.messages import Intention

FORMAT = "mdrive-sumo dialogues 1"
INDEX_NAME, ARCHIVE_NAME = "dialogues.json", "dialogues-{:06d}.npz"
PAIRS_NAME = "pairs-{}-{:06d}.npz"
"""Of better and worse answers to equal prompts."""
_TYPES = {
    "entries": np.uint16,
    "answer_start": np.int16,
    "head_end": np.int16,
    "length": np.int16,
    "ranks": np.int8,
    "actions": np.int8,
}


def write_dialogues(
    folder: Path, split: str, shards: Sequence[DialogueSamples], pairs: DialoguePairs | None = None
) -> Path:
    """Write a whole data set and return the path of its index. Raises OSError."""
    make_folder(folder)
    for number, samples in enumerate(shards):
        write_shard(folder, number, samples)
    if pairs is not None:
        write_pairs(folder, 0, pairs)
    return write_index(folder, split, shards[0].vocabulary, range(len(shards)), [] if pairs is None else [0])


def write_shard(folder: Path, number: int, samples: DialogueSamples) -> None:
    """Write an archive of dialogues. Raises OSError."""
    _write_archive(folder / ARCHIVE_NAME.format(number), samples)


def write_pairs(folder: Path, number: int, pairs: DialoguePairs) -> None:
    """Write archives of pairs. Raises OSError."""
    for which in ("better", "worse"):
        _write_archive(folder / PAIRS_NAME.format(which, number), getattr(pairs, which))


def write_index(folder: Path, split: str, vocabulary: str, shards: Iterable[int], pairs: Iterable[int]) -> Path:
    """Write the index of the archives with these numbers and return its path. Raises OSError."""
    about = {"format": FORMAT, "vocabulary": vocabulary, "split": split, "shards": [*shards], "pairs": [*pairs]}
    write_text(folder / INDEX_NAME, json.dumps(about, indent=1) + "\n")
    return folder / INDEX_NAME


def remove_dialogues(folder: Path) -> None:
    """Remove what an earlier command wrote. Raises OSError."""
    for path in [folder / INDEX_NAME, *folder.glob("dialogues-*.npz"), *folder.glob("pairs-*.npz")]:
        path.unlink(missing_ok=True)


def _write_archive(path: Path, samples: DialogueSamples) -> None:
    write_arrays(path, {"places": np.array(samples.places, dtype=np.str_), **samples.get_arrays()})


def read_dialogues(folder: Path, vocabulary: str) -> DialogueSamples:
    """Return all dialogues of a data set. vocabulary: digest of the one that they must have.

    Raises InputError for what is missing, damaged or different.
    """
    numbers = _read_index(folder / INDEX_NAME, vocabulary)["shards"]
    return _concatenate([_read_archive(folder / ARCHIVE_NAME.format(number), vocabulary) for number in numbers])


def read_pairs(folder: Path, vocabulary: str) -> DialoguePairs:
    """Return the pairs of a data set. Raises InputError as `read_dialogues`, also if it has none."""
    numbers = _read_index(folder / INDEX_NAME, vocabulary)["pairs"]
    if not numbers:
        raise InputError(f"{folder}: expected pairs of better and worse answers, found none")
    better, worse = (
        _concatenate([_read_archive(folder / PAIRS_NAME.format(which, number), vocabulary) for number in numbers])
        for which in ("better", "worse")
    )
    start = better.answer_start
    same = len(better) == len(worse) and np.array_equal(start, worse.answer_start)
    is_prompt = np.arange(NEGOTIATOR.context) < start[:, None]
    if not same or ((better.entries != worse.entries) & is_prompt).any():
        raise InputError(f"{folder}: expected pairs of answers to equal prompts, found other prompts")
    return DialoguePairs(better, worse)


def _read_index(path: Path, vocabulary: str) -> dict[str, Any]:
    index = read_json_file(path, "the index of dialogues", FORMAT)
    if index.get("vocabulary") != vocabulary:
        raise InputError(
            f"{path}: expected dialogues in the vocabulary {vocabulary[:8]}..., found {index.get('vocabulary')!r:.12};"
            " write them again with this version of mdrive-sumo"
        )
    if index.get("split") not in SPLITS:
        raise InputError(f"{path}: split: expected one of {', '.join(SPLITS)}, found {index.get('split')!r:.40}")
    for name, least in (("shards", 1), ("pairs", 0)):
        found: Any = index.get(name)
        numbers: list[Any] = found if isinstance(found, list) else []
        is_right = isinstance(found, list) and len(numbers) >= least
        if not is_right or not all(type(number) is int and 0 <= number < 10**6 for number in numbers):
            raise InputError(f"{path}: {name}: expected the numbers of archives, found {found!r:.60}")
    return index


def _read_archive(path: Path, vocabulary: str) -> DialogueSamples:
    arrays = read_arrays(path, "dialogues")
    for name in ("places", *_TYPES):
        if name not in arrays:
            raise InputError(f"{path}: expected an array {name}, found none")
    places = arrays["places"]
    if places.ndim != 1 or places.dtype.kind != "U":
        raise InputError(f"{path}: places: expected names, found {places.dtype.name} {places.shape}")
    sizes = {"entries": (NEGOTIATOR.context,), "ranks": (MAX_MEMBERS,), "actions": (MAX_MEMBERS,)}
    for name, kind in _TYPES.items():
        shape = (len(places), *sizes.get(name, ()))
        if arrays[name].dtype != kind or arrays[name].shape != shape:
            raise InputError(
                f"{path}: {name}: expected {np.dtype(kind).name} {shape}, found {arrays[name].dtype.name}"
                f" {arrays[name].shape}"
            )
    samples = DialogueSamples(vocabulary, tuple(places.tolist()), **{name: arrays[name] for name in _TYPES})
    _check_numbers(path, samples)
    return samples


def _check_numbers(path: Path, samples: DialogueSamples) -> None:
    """Raise InputError for numbers that would make the training fail in the middle."""
    start, head, length = samples.answer_start, samples.head_end, samples.length
    are_right = {
        "entries": samples.entries < NEGOTIATOR.vocabulary,
        "answer_start, head_end, length": (
            (start > 0) & (start < head) & (head <= length) & (length <= NEGOTIATOR.context)
        ),
        "ranks": (samples.ranks >= UNKNOWN) & (samples.ranks < MAX_MEMBERS),
        "actions": (samples.actions >= UNKNOWN) & (samples.actions < len(Intention)),
    }
    for name, is_right in are_right.items():
        if not is_right.all():
            row = int(np.argwhere(~is_right)[0][0])
            raise InputError(f"{path}: {name}: expected numbers in their range, found others in row {row}")


def _concatenate(shards: Sequence[DialogueSamples]) -> DialogueSamples:
    arrays = {name: np.concatenate([shard.get_arrays()[name] for shard in shards]) for name in _TYPES}
    return DialogueSamples(shards[0].vocabulary, tuple(place for shard in shards for place in shard.places), **arrays)
