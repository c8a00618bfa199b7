"""compute_anchor_losses: what scores and offsets of the plan anchors cost."""

from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn import functional

from mdrive_sumo.agents.learned.plan_anchors import build_anchors
from mdrive_sumo.learning.training.losses import AXIS_WEIGHTS
from mdrive_sumo.learning.training.plan_teacher import judge_plans

NEAR_M, NEAR_SHARE = 0.3, 0.01
"""[m] Weighted distance from the expert's plan at which an anchor is e times less right, and per metre of that plan's
end: about the distance between neighbours."""


def compute_anchor_losses(answer: Mapping[str, Tensor], batch: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return the losses of the expert's choice, of the teacher's judgement of every anchor, and of offsets [m].

    Anchors near the expert's plan share its choice and learn the way to it. answer: `anchor_logits` (batch, ANCHORS,
    5) and `anchor_offsets` (batch, ANCHORS, n, 2). The teacher judges anchors as they are, without offsets.
    """
    logits, offsets = answer["anchor_logits"], answer["anchor_offsets"]
    expert = batch["expert_plan"].float()
    points = torch.from_numpy(build_anchors().points).to(expert)
    weights = expert.new_tensor(AXIS_WEIGHTS)
    distance = ((points - expert[:, None]).abs() * weights).mean(dim=(-1, -2))
    near_m = NEAR_M + NEAR_SHARE * torch.linalg.vector_norm(expert[:, -1], dim=-1, keepdim=True)
    target = torch.softmax(-distance / near_m, dim=1)
    with torch.no_grad():
        judged = judge_plans(points.expand(len(expert), -1, -1, -1), batch)
    error = ((points + offsets - expert[:, None]).abs() * weights).mean(dim=(-1, -2))
    return {
        "choice": functional.cross_entropy(logits[..., 0], target),
        "teacher": functional.binary_cross_entropy_with_logits(logits[..., 1:], judged),
        "offset": (target * error).sum(dim=1).mean(),
    }
