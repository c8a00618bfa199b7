"""TrainingData: all samples in the memory of one device, and batches of them."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from mdrive_sumo.agents.learned.system_spec import SystemSpec
from mdrive_sumo.learning.networks.bev_memory import MEMORY_SHAPE

ROOM_BYTES = 14 << 30
"""Left free on a GPU for the network, its gradients and a batch."""
LABELS = ("expert_plan", "expert_control", "own", "boxes", "futures", "occupancy", "lane_graph", "route")


class TrainingData:
    """Samples on the device if they fit, else in main memory."""

    def __init__(self, spec: SystemSpec, arrays: Mapping[str, npt.NDArray[np.generic]], device: torch.device) -> None:
        self.spec = spec
        self.device = device
        self._names = [image.name for image in spec.images]
        inputs = [*self._names, "navigation", "limits", *_name_optional(spec)]
        size = sum(arrays[name].nbytes for name in {*inputs, *LABELS})
        here = {name: torch.from_numpy(arrays[name]) for name in dict.fromkeys((*inputs, *LABELS))}
        place, self._tensors = _place(here, size, device)
        self._previous = torch.from_numpy(arrays["previous"].astype(np.int64)).to(place)
        self._inputs = inputs
        self.place = place

    def take_inputs(self, rows: Tensor) -> dict[str, Tensor]:
        """Return the inputs of a network at rows (batch,), without memory."""
        return {name: self._take(name, rows) for name in self._inputs}

    def take_labels(self, rows: Tensor) -> dict[str, Tensor]:
        """Return what losses compare answers with."""
        return {name: self._take(name, rows) for name in LABELS}

    def take_previous(self, rows: Tensor) -> tuple[dict[str, Tensor], Tensor, Tensor]:
        """Return the images two decisions earlier, the motion (batch, 3) since, and whether there are any (batch,)."""
        before = self._previous[rows.to(self.place)]
        is_there = (before >= 0).to(self.device, non_blocking=True)
        before = before.clamp(min=0)
        images = {name: self._take(name, before) for name in self._names}
        motion = measure_motion(self._take("own", before), self._take("own", rows))
        return images, motion * is_there[:, None], is_there

    def _take(self, name: str, rows: Tensor) -> Tensor:
        return self._tensors[name][rows.to(self.place)].to(self.device, non_blocking=True)


def _name_optional(spec: SystemSpec) -> tuple[str, ...]:
    used = {"route": spec.uses_route, "lidar": spec.uses_lidar, "instruction": spec.uses_instruction}
    return tuple(name for name, is_used in used.items() if is_used)


def _place(here: dict[str, Tensor], size: int, device: torch.device) -> tuple[torch.device, dict[str, Tensor]]:
    """Return where tensors lie now: another process may take the same room of a GPU between a look and a copy."""
    if device.type != "cuda":
        return device, {name: each.to(device) for name, each in here.items()}
    if _fits(size, device):
        try:
            there = {name: each.to(device) for name, each in here.items()}
        except torch.cuda.OutOfMemoryError:
            there = {}
        if there and _fits(0, device):
            return device, there
        there.clear()
        torch.cuda.empty_cache()
    return torch.device("cpu"), here


def _fits(size: int, device: torch.device) -> bool:
    if device.type != "cuda":
        return True
    return torch.cuda.mem_get_info(device)[0] > size + ROOM_BYTES


def measure_motion(then: Tensor, now: Tensor) -> Tensor:
    """Return dx, dy [m, frame of `then`] and the change of yaw [rad] (batch, 3) between states (batch, 6)."""
    step = now[:, :2] - then[:, :2]
    cos, sin = torch.cos(then[:, 2]), torch.sin(then[:, 2])
    turn = now[:, 2] - then[:, 2]
    turn = torch.atan2(torch.sin(turn), torch.cos(turn))
    return torch.stack((cos * step[:, 0] + sin * step[:, 1], cos * step[:, 1] - sin * step[:, 0], turn), dim=-1)


def build_empty_memory(batch: int, device: torch.device) -> dict[str, Tensor]:
    """Return `memory` and `motion` of a first decision."""
    return {
        "memory": torch.zeros(batch, *MEMORY_SHAPE, device=device),
        "motion": torch.zeros(batch, 3, device=device),
    }
