"""compute_losses: what a system's answers cost, by part; one table of weights for all systems."""

from collections.abc import Mapping
from types import MappingProxyType

from torch import Tensor

from mdrive_sumo.learning.training.plan_losses import (
    compute_collision_loss,
    compute_control_loss,
    compute_lane_loss,
    compute_plan_loss,
)
from mdrive_sumo.learning.training.scene_losses import (
    compute_agents_loss,
    compute_map_loss,
    compute_occupancy_loss,
    compute_speed_loss,
)

LOSS_WEIGHTS: Mapping[str, float] = MappingProxyType(
    {
        "plan": 1.0,
        "control": 1.0,
        "collision": 0.3,
        "lane": 0.3,
        "occupancy": 2.0,
        "agents": 0.5,
        "map": 0.3,
        "speed": 0.1,
    }
)
"""The plan's unit is a metre; the others are scaled to about a tenth up to a half of it after the first steps."""


def compute_losses(answer: Mapping[str, Tensor], batch: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return the parts of the loss that the answer of a network allows, and their weighted sum as `total`."""
    expert = batch["expert_plan"]
    parts = {"plan": compute_plan_loss(answer["plan"], expert)}
    parts["collision"] = compute_collision_loss(answer["plan"], expert, batch["boxes"], batch["futures"])
    parts["lane"] = compute_lane_loss(answer["plan"], expert, batch["route"])
    if "control" in answer:
        parts["control"] = compute_control_loss(answer["control"], batch["expert_control"])
    if "occupancy" in answer:
        parts["occupancy"] = compute_occupancy_loss(answer["occupancy"], batch["occupancy"])
    if "centres" in answer:
        parts["agents"] = compute_agents_loss(answer["centres"], answer["boxes"], batch["boxes"], batch["futures"])
    if "lines" in answer:
        parts["map"] = compute_map_loss(answer["lines"], answer["is_lane"], batch["lane_graph"])
    if "speed" in answer:
        parts["speed"] = compute_speed_loss(answer["speed"], batch["own"])
    total = sum((LOSS_WEIGHTS[name] * part for name, part in parts.items()), start=expert.new_zeros(()))
    return parts | {"total": total}
