"""Augmentation on the device where the batch lies: light of the images, what navigation says, memory."""

from collections.abc import Mapping

import torch
from torch import Tensor

from mdrive_sumo.agents.learned.system_spec import COMMANDS, SystemSpec

GAIN, SHIFT = 0.25, 20.0
"""Images are multiplied by 1 +- GAIN and shifted by +- SHIFT of 255, channels apart by a third of it."""
SPEED_UNKNOWN = -1.0
"""Input of a sample whose speed is left out: CAVs do not drive backwards, so it is no speed."""
SPEED_DROPOUT = 0.15
"""Share of samples that do not know their speed: else standing is learned from standing (the copycat problem)."""
SPEED_NOISE = 0.02
"""Standard deviation of what others are told [10 m/s]."""
TARGET_DROPOUT = 0.3
"""Share of samples without target points where words say the way: else words are never needed."""
TARGETS = slice(1 + len(COMMANDS), 1 + len(COMMANDS) + 4)
"""Where the target points lie in the vector of navigation, behind speed and commands."""
MEMORY_DROPOUT = 0.1
"""Share of samples that remember nothing, as at the start of a drive."""


def augment_inputs(spec: SystemSpec, inputs: Mapping[str, Tensor], generator: torch.Generator) -> dict[str, Tensor]:
    """Return the inputs of a batch with other light, noise and gaps; shapes stay, images become floats."""
    changed = dict(inputs)
    for image in spec.images:
        changed[image.name] = jitter_images(inputs[image.name], generator)
    navigation = inputs["navigation"].clone()
    draw = torch.rand(len(navigation), 2, generator=generator, device=navigation.device)
    noise = torch.randn(len(navigation), generator=generator, device=navigation.device)
    speed = torch.relu(navigation[:, 0] + SPEED_NOISE * noise)
    navigation[:, 0] = torch.where(draw[:, 0] < SPEED_DROPOUT, SPEED_UNKNOWN, speed)
    if spec.uses_instruction:
        navigation[:, TARGETS] *= (draw[:, 1:] >= TARGET_DROPOUT).to(navigation.dtype)
    changed["navigation"] = navigation
    return changed


def jitter_images(images: Tensor, generator: torch.Generator) -> Tensor:
    """Return images (batch, cameras, height, width, 3), each with its own brightness and tint, as floats 0 to 255."""
    shape = *images.shape[:2], 1, 1
    draw = torch.rand(*shape, 8, generator=generator, device=images.device) * 2.0 - 1.0
    gain = 1.0 + GAIN * (draw[..., 0:1] + draw[..., 1:4] / 3.0)
    shift = SHIFT * (draw[..., 4:5] + draw[..., 5:8] / 3.0)
    return (images.to(gain.dtype) * gain + shift).clamp_(0.0, 255.0)
