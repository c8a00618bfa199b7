"""recall_previous: the memory that a network would have had, from the images of two decisions ago."""

import torch
from torch import Tensor, nn

from mdrive_sumo.learning.networks.bev_grid import compute_cell_centres
from mdrive_sumo.learning.networks.bev_memory import halve_motion, warp_memory


def recall_previous(
    network: nn.Module, inputs: dict[str, Tensor], motion: Tensor, is_there: Tensor
) -> dict[str, Tensor]:
    """Return `memory` (batch, *MEMORY_SHAPE) and `motion` (batch, 3) for the present decision.

    inputs: images two decisions ago. motion: since then; it is halved, and the memory moved by the first half, as the
    decision between would have done. The newest slot is left empty: a network hands it on and does not look at it.
    is_there: (batch,) false where nothing is remembered.
    """
    with torch.no_grad():
        seen = network.encode(inputs)
        half = halve_motion(motion)
        centres = torch.from_numpy(compute_cell_centres()).to(motion.device, torch.float32)
        older = warp_memory(seen[:, None], half, centres)
        memory = torch.cat((torch.zeros_like(older), older), dim=1) * is_there[:, None, None, None, None]
    return {"memory": memory, "motion": half}
