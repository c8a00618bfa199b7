"""FusionTrainer: the training loop of all systems, with frames that are shared instead of drives."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.fusion_spec import CODRIVING, FEATURE_CELLS, MAX_CAVS, SHARING
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionAnswer, FusionNetwork
from mdrive_sumo.learning.fusion.training.augment_sharing import DrawnFrames, draw_arrived, draw_sharing, quantise
from mdrive_sumo.learning.fusion.training.forecast_losses import (
    OccupancyTruth,
    build_occupancy_truth,
    compute_occupancy_loss,
    draw_track_maps,
    draw_tracks,
    mirror_motion,
)
from mdrive_sumo.learning.fusion.training.frame_store import FrameStore, Sharing, TrueBoxes, mirror
from mdrive_sumo.learning.fusion.training.fusion_losses import (
    compute_confidence_loss,
    compute_detection_losses,
    compute_teacher_loss,
    sum_losses,
)
from mdrive_sumo.learning.training.checkpoint import Checkpoint, take_weights
from mdrive_sumo.learning.training.trainer import Trainer
from mdrive_sumo.learning.training.training_options import TrainingOptions

SETTLED_BATCHES = 5
"""Batches over which statistics of normalisation are measured anew: each has a million cells or more."""

LONE_SHARE = 0.2
"""Of the frames of `codriving` nothing arrives: it also drives where no other car sends."""


class _Answered(NamedTuple):
    """What a network answers of a batch, and what it should: boxes are mirrored as the frames are."""

    answer: FusionAnswer
    confidence: Tensor
    """Logits of the own confidence, or of the merged scans."""
    truth: TrueBoxes
    """As the scans that the detector gets show them."""
    own: TrueBoxes
    """As the scans that the confidence is made of show them."""
    forecast: tuple[Tensor, OccupancyTruth] | None
    """Logits of occupancy and what they should be, of `codriving`."""


class FusionTrainer(Trainer):
    """A detector, its average, optimiser and random numbers; `train` takes a FrameStore as data."""

    def __init__(
        self,
        detector: str,
        options: TrainingOptions,
        device: torch.device,
        report: Callable[[str], object] = str,
        *,
        is_gated: bool = False,
        is_alone: bool = False,
        teacher: FusionNetwork | None = None,
    ) -> None:
        """Build a detector with fresh weights. teacher: a trained `early`, which `disconet` needs and no other gets.

        is_alone: never show it what others send. Raises InputError for a detector without weights.
        """
        super().__init__(detector, options, device, report, lambda name: FusionNetwork(name, is_gated))
        self.teacher = None if teacher is None else teacher.to(device).eval().requires_grad_(False)
        self.is_alone = is_alone or detector == "none"
        self.summary |= {"is_gated": is_gated and detector in SHARING, "is_alone": self.is_alone}
        # Frames have any number of senders: each batch of a fusion has a shape of its own, and cuDNN would search the
        # fastest programs for each.
        torch.backends.cudnn.benchmark = detector not in SHARING

    def begin_with(self, checkpoint: Checkpoint) -> None:
        """Take encoder and head of the averaged weights of any detector's checkpoint. Raises InputError."""
        begin = FusionNetwork(checkpoint.system, bool(checkpoint.summary.get("is_gated")))
        take_weights(begin, checkpoint.average, checkpoint.system)
        for network in (self.network, self.average.network):
            network.encoder.load_state_dict(begin.encoder.state_dict())
            network.head.load_state_dict(begin.head.state_dict())
            if checkpoint.system == self.system:
                take_weights(network, checkpoint.average, self.system)

    def settle(self, network: nn.Module, data: FrameStore) -> None:
        """Measure a network's statistics of normalisation on frames of a training, drawn by seed and step.

        Training normalises by each batch. Its running statistics are for evaluation, and neither fit averaged weights
        nor, in the first hundreds of steps, any: most cells are empty and have variances of thousandths, while
        statistics begin at 1 (Wu and Johnson 2021, "Rethinking 'Batch' in BatchNorm", section 3).
        """
        layers = [layer for layer in network.modules() if isinstance(layer, nn.BatchNorm2d)]
        momenta = [layer.momentum for layer in layers]
        for layer in layers:
            layer.reset_running_stats()
            layer.momentum = None  # the mean of all batches
            layer.train()
        generator = torch.Generator(self.device).manual_seed(self.options.seed + self.step)
        with torch.no_grad():
            for _ in range(SETTLED_BATCHES):
                size = (self.options.batch,)
                rows = torch.randint(data.frames, size, generator=generator, device=self.device)
                self._answer(network, data, draw_sharing(data, rows, generator), rows, generator)
        for layer, momentum in zip(layers, momenta, strict=True):
            layer.momentum = momentum
            layer.eval()

    def _compute_losses(self, data: Any, rows: Tensor) -> Mapping[str, Tensor]:
        assert isinstance(data, FrameStore)
        self.network.train()
        drawn = draw_sharing(data, rows, self.generator)
        answered = self._answer(self.network, data, drawn, rows, self.generator)
        parts = compute_detection_losses(answered.answer, answered.truth)
        parts["confidence"] = compute_confidence_loss(answered.confidence, answered.own)
        if answered.forecast is not None:
            parts["occupancy"] = compute_occupancy_loss(*answered.forecast)
        if self.teacher is not None:
            parts["teacher"] = compute_teacher_loss(answered.answer.fused, self._teach(data, rows, drawn))
        return sum_losses(parts)

    def _answer(
        self, network: Any, data: FrameStore, drawn: DrawnFrames, rows: Tensor, generator: torch.Generator
    ) -> _Answered:
        sharing = drawn.sharing
        if self.is_alone or self.system == CODRIVING:
            share = 1.0 if self.is_alone else LONE_SHARE
            sharing = _keep_own(sharing, torch.rand(len(rows), generator=generator, device=self.device) < share)
        truth = data.take_boxes(rows, sharing.scan >= 0)
        own = data.take_boxes(rows, (sharing.scan >= 0) & (torch.arange(MAX_CAVS, device=self.device) == 0))
        with self._autocast():
            if self.system in SHARING:
                answer, confidence, boxes = self._answer_shared(network, data, sharing, drawn, truth, generator)
            else:
                answer, confidence, boxes = self._answer_one_grid(network, data, sharing, drawn, truth)
            forecast = None
            if self.system == CODRIVING:
                motion = mirror_motion(data.take_motion(rows), drawn.is_mirrored)
                tracks = draw_track_maps(draw_tracks(motion, truth.is_seen, generator))
                forecast = network.forecast(answer.fused, tracks), build_occupancy_truth(motion, truth)
        seen = own if self.system in SHARING else truth
        return _Answered(answer, confidence, _replace_boxes(truth, boxes), _replace_boxes(seen, boxes), forecast)

    def _answer_shared(
        self,
        network: Any,
        data: FrameStore,
        sharing: Sharing,
        drawn: DrawnFrames,
        truth: TrueBoxes,
        generator: torch.Generator,
    ) -> tuple[FusionAnswer, Tensor, Tensor]:
        """Return answer, logits of the own confidence and mirrored boxes of a fusion."""
        frame, car = torch.nonzero(sharing.scan >= 0, as_tuple=True)
        grids = data.build_grids(sharing.scan[frame, car])
        grids, pose, boxes = mirror(grids, sharing.pose, truth.boxes, drawn.is_mirrored, frame)
        features, confidence = network.encoder(grids.contiguous(memory_format=torch.channels_last))
        is_sender = (car > 0)[:, None, None, None]
        features = torch.where(is_sender, quantise(features), features)
        shape = len(sharing.scan), MAX_CAVS
        maps = features.new_zeros((*shape, *features.shape[1:]))
        maps[frame, car] = features
        sure = confidence.detach().new_zeros((*shape, FEATURE_CELLS, FEATURE_CELLS))
        sure[frame, car] = torch.sigmoid(confidence.detach())
        arrived = draw_arrived(sure, sharing.scan >= 0, drawn.is_perfect, generator)
        answer = network(maps * arrived[:, :, None], arrived, pose, sharing.age_s)
        return answer, confidence[car == 0], boxes

    def _answer_one_grid(
        self, network: Any, data: FrameStore, sharing: Sharing, drawn: DrawnFrames, truth: TrueBoxes
    ) -> tuple[FusionAnswer, Tensor, Tensor]:
        """The same of `none` and `early`."""
        features, confidence, boxes = self._encode_merged(network, data, sharing, drawn, truth.boxes)
        ones = features.new_ones((len(features), 1, FEATURE_CELLS, FEATURE_CELLS))
        answer = network(features[:, None], ones, sharing.pose[:, :1], sharing.age_s[:, :1])
        return answer, confidence, boxes

    def _teach(self, data: FrameStore, rows: Tensor, drawn: DrawnFrames) -> Tensor:
        """Return the teacher's features of the same cars, with true poses and newest scans."""
        assert self.teacher is not None
        perfect = data.share(rows, torch.zeros_like(drawn.sharing.scan), torch.zeros_like(drawn.is_perfect))
        perfect = Sharing(torch.where(drawn.sharing.scan >= 0, perfect.scan, -1), perfect.pose, perfect.age_s)
        boxes = perfect.pose.new_zeros((len(rows), 1, 5))
        with torch.no_grad(), self._autocast():
            return self._encode_merged(self.teacher, data, perfect, drawn, boxes)[0]

    def _encode_merged(
        self, network: Any, data: FrameStore, sharing: Sharing, drawn: DrawnFrames, boxes: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return features, logits of confidence and mirrored boxes of the merged scans of each frame."""
        grids = data.build_merged_grids(sharing)
        frame = torch.arange(len(grids), device=self.device)
        grids, _, boxes = mirror(grids, sharing.pose, boxes, drawn.is_mirrored, frame)
        features, confidence = network.encoder(grids.contiguous(memory_format=torch.channels_last))
        return features, confidence, boxes


def _keep_own(sharing: Sharing, is_lone: Tensor) -> Sharing:
    """Return what is shared, in the frames `is_lone` (F,) without any sender."""
    is_sender = torch.arange(MAX_CAVS, device=is_lone.device) > 0
    return Sharing(torch.where(is_lone[:, None] & is_sender, -1, sharing.scan), sharing.pose, sharing.age_s)


def _replace_boxes(truth: TrueBoxes, boxes: Tensor) -> TrueBoxes:
    return TrueBoxes(boxes, truth.classes, truth.is_seen, truth.is_hidden)
