"""Checkpoints: everything that a training run needs to go on, in one file that is replaced as a whole."""

import pickle
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import torch
from torch import nn

from mdrive_sumo.agents.learned.system_spec import PLAN_HEADS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import draft_file, make_folder

CHECKPOINT_VERSION = 2
"""Raised when checkpoints of earlier versions do not fit any more."""
CHECKPOINT_NAME = "checkpoint.pt"
WEIGHTS_NAME = "weights.pt"
"""The same file without what only `--resume` needs: a quarter of the size."""


@dataclass
class Checkpoint:
    """State of a run after a number of steps."""

    system: str
    step: int
    elapsed_s: float
    network: dict[str, Any]
    average: dict[str, Any]
    optimizer: dict[str, Any]
    generator: Any
    summary: dict[str, Any] = field(default_factory=dict)
    """Data, options, device and last losses: what a model card says about the training."""
    best: dict[str, Any] = field(default_factory=dict[str, Any])
    """The average with the least validation error so far; empty before the first look."""
    plan_head: str = PLAN_HEADS[0]
    version: int = CHECKPOINT_VERSION

    @property
    def chosen(self) -> dict[str, Any]:
        """Weights to drive with, or to begin another training with."""
        return self.best or self.average


def check_unused(folder: Path) -> None:
    """Raise InputError if a folder holds a training, which a new one would replace."""
    if (path := folder / CHECKPOINT_NAME).exists():
        raise InputError(f"{path}: expected no training there, found one; --resume goes on with it")


def save_weights(checkpoint: Checkpoint, folder: Path) -> Path:
    """Write DIR/weights.pt, enough to export, or to begin another training with."""
    weights = replace(checkpoint, network={}, average=checkpoint.chosen, best={}, optimizer={}, generator=None)
    return save_checkpoint(weights, folder, WEIGHTS_NAME)


def save_checkpoint(checkpoint: Checkpoint, folder: Path, name: str = CHECKPOINT_NAME) -> Path:
    """Write DIR/NAME so that an interruption leaves the old or the new one, and return its path."""
    make_folder(folder)
    path = folder / name
    with draft_file(path) as draft:
        torch.save({each.name: getattr(checkpoint, each.name) for each in fields(checkpoint)}, draft)
    return path


def load_checkpoint(path: Path, system: str | None = None) -> Checkpoint:
    """Read a checkpoint (plain tensors and numbers: no code is run). Raises InputError."""
    if path.is_dir():
        path = path / CHECKPOINT_NAME
    if not path.is_file():
        raise InputError(f"{path}: expected a checkpoint of `learn train`, found no file")
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        _check_version(path, content)
        checkpoint = Checkpoint(**content)
    except (RuntimeError, EOFError, OSError, TypeError, KeyError, pickle.UnpicklingError) as error:
        raise InputError(
            f"{path}: expected a checkpoint of `learn train`, found an unreadable file ({_shorten(error)})"
        ) from None
    if system is not None and checkpoint.system != system:
        raise InputError(f"{path}: expected a checkpoint of {system!r}, found one of {checkpoint.system!r}")
    return checkpoint


def _check_version(path: Path, content: Any) -> None:
    version = content.get("version") if isinstance(content, dict) else None
    if isinstance(version, int) and version != CHECKPOINT_VERSION:
        raise InputError(f"{path}: expected a checkpoint of version {CHECKPOINT_VERSION}, found {version}")


def load_whole_checkpoint(path: Path, system: str) -> Checkpoint:
    """As `load_checkpoint`; also raises InputError if a run cannot go on from it."""
    checkpoint = load_checkpoint(path, system)
    if not checkpoint.optimizer:
        raise InputError(f"{path}: expected a {CHECKPOINT_NAME} to go on from, found weights only; give --init instead")
    return checkpoint


def take_weights(network: nn.Module, weights: dict[str, Any], system: str) -> None:
    """Load the weights of a checkpoint into a network. Raises InputError if they are those of another network."""
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        raise InputError(
            f"checkpoint of {system!r}: expected weights of the network of this version of mdrive-sumo, found others"
            f" ({' '.join(str(error).split())[:160]}); train it again"
        ) from None


def _shorten(error: Exception) -> str:
    """Return the first sentence of what PyTorch says."""
    return (str(error).splitlines() or ["it is empty"])[0].partition(". ")[0]
