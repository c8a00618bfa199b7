"""Trainer: one training loop for all systems, with averaged weights, interrupted between two steps only."""

import copy
import math
import signal
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.networks.build_network import build_network, count_parameters
from mdrive_sumo.learning.training.anchor_losses import compute_anchor_losses
from mdrive_sumo.learning.training.augment import MEMORY_DROPOUT, augment_inputs
from mdrive_sumo.learning.training.checkpoint import Checkpoint, save_checkpoint, save_weights, take_weights
from mdrive_sumo.learning.training.losses import add_up, compute_losses
from mdrive_sumo.learning.training.predict_samples import recall_previous
from mdrive_sumo.learning.training.training_curves import TrainingCurves
from mdrive_sumo.learning.training.training_data import TrainingData
from mdrive_sumo.learning.training.training_options import TrainingOptions

MOST_GRADIENT = 5.0
"""Longer gradients are shortened to it."""
TELL_EVERY_S = 30.0
"""A step of a large network takes this long on a processor; progress is told no more rarely."""
GLANCES = 10
"""Looks at the validation data in a run, for the curves."""


@dataclass
class _Session:
    """One call of `Trainer.train`; times of the monotonic clock [s]."""

    folder: Path
    curves: TrainingCurves
    began: float
    saved: float
    told: float
    timed_step: int
    """Step from which, and at `timed` the time from which, the rate that is told is measured."""
    timed: float
    losses: dict[str, float] = field(default_factory=dict[str, float])
    parts: Mapping[str, Tensor] = field(default_factory=dict[str, Tensor])
    """Losses of the last step, on the device."""


class Trainer:
    """Network, its average, optimiser and random numbers of one run."""

    chosen_by: ClassVar[str] = "validation/ade_3s_m"
    """Name of the measured value that is least in the weights that are given away."""

    def __init__(
        self,
        system: str,
        options: TrainingOptions,
        device: torch.device,
        report: Callable[[str], object] = str,
        build: Callable[[str], nn.Module] | None = None,
    ) -> None:
        """Build a network with fresh weights. report: receives a line of progress now and then. build: makes the
        network of other trainers."""
        torch.manual_seed(options.seed)
        self.system = system
        self.options = options
        self.device = device
        self.uses_bfloat16 = device.type == "cuda"
        self._report = report
        network = build_network(system, options.plan_head) if build is None else build(system)
        self.network = network.to(device, memory_format=torch.channels_last)
        self.average = MovingAverage(self.network, options.average_decay)
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(),
            lr=options.learning_rate,
            weight_decay=options.weight_decay,
            fused=device.type == "cuda",
        )
        self.generator = torch.Generator(device).manual_seed(options.seed)
        self.step = 0
        self.elapsed_s = 0.0
        self.best: dict[str, Tensor] = {}
        """The averaged weights with the least ADE of all looks at the validation data."""
        self.summary: dict[str, Any] = {"parameters": count_parameters(self.network)}

    def resume(self, checkpoint: Checkpoint) -> None:
        """Go on from a checkpoint, on the same kind of device to the same bits. Raises InputError."""
        take_weights(self.network, checkpoint.network, self.system)
        take_weights(self.average.network, checkpoint.average, self.system)
        self.optimizer.load_state_dict(checkpoint.optimizer)
        self.step, self.elapsed_s = checkpoint.step, checkpoint.elapsed_s
        self.summary = checkpoint.summary
        self.best = {name: each.to(self.device) for name, each in checkpoint.best.items()}
        if checkpoint.generator.shape == self.generator.get_state().shape:
            self.generator.set_state(checkpoint.generator)
        else:  # of another kind of device, whose random numbers are others
            self.generator.manual_seed(self.options.seed + self.step)

    def begin_with(self, checkpoint: Checkpoint) -> None:
        """Take the chosen weights of a checkpoint, and nothing else. Raises InputError."""
        if checkpoint.plan_head != self.options.plan_head:
            raise InputError(
                f"--init: expected weights with the plan head {self.options.plan_head}, found {checkpoint.plan_head}"
            )
        take_weights(self.network, checkpoint.chosen, self.system)
        take_weights(self.average.network, checkpoint.chosen, self.system)

    def copy_best(self) -> nn.Module:
        """Return the network with the weights that the checkpoint gives away."""
        network = copy.deepcopy(self.average.network)
        take_weights(network, self.best or self.average.network.state_dict(), self.system)
        return network

    def save(self, folder: Path) -> Path:
        """Write a checkpoint, and its weights apart, and return its path."""
        self.summary |= {"steps": self.step, "minutes": self.elapsed_s / 60.0}
        checkpoint = Checkpoint(
            self.system, self.step, self.elapsed_s, self.network.state_dict(), self.average.network.state_dict(),
            self.optimizer.state_dict(), self.generator.get_state(), self.summary, self.best, self.options.plan_head,
        )  # fmt: skip
        save_weights(checkpoint, folder)
        return save_checkpoint(checkpoint, folder)

    def train(
        self,
        data: Any,
        shares: npt.NDArray[np.float64],
        folder: Path,
        glance: Callable[[nn.Module], Mapping[str, float]] | None = None,
    ) -> dict[str, float]:
        """Train until the steps or the minutes are used up; returns the last losses.

        data: what `_compute_losses` takes samples from, here `TrainingData`. shares: (M,) how often each sample is
        drawn, 0: never. glance: measures the averaged network, GLANCES times; the weights with the least `chosen_by`
        are given away, without such a value the last ones.
        Raises InputError when the loss is no number; the last checkpoint stays. Raises KeyboardInterrupt after Ctrl-C,
        with a new checkpoint. The first step does not count as time.
        """
        now = time.monotonic()
        session = _Session(
            folder, TrainingCurves(folder, self.step), now - self.elapsed_s, saved=now, told=now, timed_step=self.step,
            timed=now,
        )  # fmt: skip
        drawn = torch.from_numpy(shares).to(self.device)
        glances = int(self.options.find_progress(self.step, self.elapsed_s) * GLANCES)
        with DeferredInterrupt() as interrupt:
            while (progress := self.options.find_progress(self.step, self.elapsed_s)) < 1.0 and not interrupt.is_due:
                session.parts = self._take_step(data, drawn, progress)
                self.step += 1
                self._keep_time(session)
                self._tell_progress(session, progress)
                if glance is not None and int(progress * GLANCES) > glances:
                    glances = int(progress * GLANCES)
                    self._look(session, glance)
                    session.timed_step, session.timed = self.step, time.monotonic()
                if time.monotonic() - session.saved > self.options.save_every_s:
                    self._check(session.parts, folder)
                    self.save(folder)
                    session.saved = time.monotonic()
        if glance is not None and session.parts and not interrupt.is_due:
            self._look(session, glance)
        session.curves.close()
        losses = self._finish(self._check(session.parts, folder) or session.losses, folder)
        if interrupt.is_due and progress < 1.0:
            raise KeyboardInterrupt
        return losses

    def _look(self, session: _Session, glance: Callable[[nn.Module], Mapping[str, float]]) -> None:
        """Measure the averaged network, and remember it if it is the best so far."""
        found = glance(self.average.network)
        session.curves.add(self.step, found)
        error = found.get(self.chosen_by)
        if error is not None and (not self.best or error < self.summary["best"][self.chosen_by]):
            self.summary["best"] = {"step": self.step, self.chosen_by: error}
            self.best = {name: each.clone() for name, each in self.average.network.state_dict().items()}

    def _keep_time(self, session: _Session) -> None:
        if not session.losses:  # the first step loads and chooses the GPU's programs: 10 s on a busy machine
            session.losses = self._check(session.parts, session.folder)
            session.began = time.monotonic() - self.elapsed_s
            session.timed_step, session.timed = self.step, time.monotonic()
        self.elapsed_s = time.monotonic() - session.began

    def _tell_progress(self, session: _Session, progress: float) -> None:
        is_logged = self.step % self.options.log_every == 0 or self.step == 1
        if not is_logged and time.monotonic() - session.told < TELL_EVERY_S:
            return
        session.losses, session.told = self._check(session.parts, session.folder), time.monotonic()
        parts = "  ".join(f"{name} {value:.3f}" for name, value in session.losses.items())
        rate = (self.step - session.timed_step) * self.options.batch / max(time.monotonic() - session.timed, 1e-3)
        told_rate = f", {rate:.1f} samples/s" if self.step > session.timed_step else ""
        self._report(f"step {self.step} ({progress:.0%}, {self.elapsed_s:.0f} s{told_rate}): {parts}")
        if is_logged:
            session.curves.add(self.step, {f"loss/{name}": value for name, value in session.losses.items()})

    def _finish(self, losses: dict[str, float], folder: Path) -> dict[str, float]:
        """Summarise the run, write its last checkpoint, and return the losses."""
        if losses:  # none if the run was over when it was resumed
            self.summary["losses"] = losses
        self.save(folder)
        return losses

    def _take_step(self, data: Any, drawn: Tensor, progress: float) -> Mapping[str, Tensor]:
        for group in self.optimizer.param_groups:
            group["lr"] = self.options.find_learning_rate(self.step, progress)
        rows = torch.multinomial(drawn, self.options.batch, replacement=True, generator=self.generator)
        parts = self._compute_losses(data, rows)
        self.optimizer.zero_grad(set_to_none=True)
        parts["total"].backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), MOST_GRADIENT)
        self.optimizer.step()
        self.average.update(self.step)
        return parts

    def _compute_losses(self, data: Any, rows: Tensor) -> Mapping[str, Tensor]:
        """Return the parts of the loss of the samples `rows` and their `total`; other trainers replace it."""
        assert isinstance(data, TrainingData)
        self.network.train()
        with self._autocast():
            inputs = augment_inputs(data.spec, data.take_inputs(rows), self.generator)
            if data.spec.uses_memory:
                images, motion, is_there = data.take_previous(rows)
                kept = torch.rand(len(rows), generator=self.generator, device=self.device) >= MEMORY_DROPOUT
                inputs |= recall_previous(self.network, images, motion, is_there & kept)
        # Apart: some versions of PyTorch keep weights that were cast without gradients up to the end of a block.
        with self._autocast():
            answer = self.network(inputs, with_auxiliary=True)
        labels = data.take_labels(rows)
        parts = compute_losses(answer, labels)
        if "anchor_logits" in answer:
            parts |= compute_anchor_losses(answer, labels)
        return add_up(parts)

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.uses_bfloat16)

    def _check(self, parts: Mapping[str, Tensor], folder: Path) -> dict[str, float]:
        """Return the losses as numbers. Raises InputError if one is none."""
        losses = {name: float(part.detach()) for name, part in parts.items()}
        wrong = [name for name, value in losses.items() if not math.isfinite(value)]
        if wrong:
            raise InputError(
                f"training {self.system}: loss {wrong[0]!r} at step {self.step}: expected a finite number, found "
                f"{losses[wrong[0]]}; give --resume with a smaller --learning-rate (last checkpoint: {folder})"
            )
        return losses


class MovingAverage:
    """An exponential average of the floating numbers of a network, statistics of normalisation included."""

    def __init__(self, source: nn.Module, decay: float) -> None:
        self.network = copy.deepcopy(source).eval().requires_grad_(False)
        self.decay = decay
        self._averages, self._sources = _list_floats(self.network), _list_floats(source)

    def update(self, step: int) -> None:
        """Move the average towards the source as it is now. It follows faster in the first steps."""
        share = 1.0 - min(self.decay, (1.0 + step) / (10.0 + step))
        with torch.no_grad():
            torch._foreach_lerp_(self._averages, self._sources, share)


def _list_floats(network: nn.Module) -> list[Tensor]:
    """Return parameters and statistics; later changes of a network, loading included, happen in these tensors."""
    return [each.detach() for each in network.state_dict().values() if each.is_floating_point()]


class DeferredInterrupt:
    """Within the block the first Ctrl-C is a request, and the next one interrupts as usual."""

    def __init__(self) -> None:
        self.is_due = False
        self._before: Any = None

    def __enter__(self) -> Self:
        """Take over Ctrl-C; only the main thread gets it."""
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give Ctrl-C back."""
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, *_: object) -> None:
        self.is_due = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
