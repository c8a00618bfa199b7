"""WeightsManifest: what a file of weights of a learned system is."""

from pydantic import Field

from mdrive_sumo.agents.learned.system_spec import PLAN_HEADS
from mdrive_sumo.core.onnx_manifest import OnnxManifest


class WeightsManifest(OnnxManifest):
    """Facts about the weights of a system in `system_spec.SYSTEMS`, or of a part of a detector."""

    memory_shape: tuple[int, ...] = ()
    """Shape of `memory` and of the output `bev`, without the batch dimension; () without memory."""
    has_limits: bool = False
    """Whether the network gets `limits`; without, it was trained at 8 m/s."""
    plan_head: str = Field(default=PLAN_HEADS[0], pattern=f"^({'|'.join(PLAN_HEADS)})$")
    """How it answers a plan (`system_spec.PLAN_HEADS`)."""
    anchors: str = ""
    """Digest of the anchors that it scores; "" without."""

    def __hash__(self) -> int:
        """As of any manifest; pydantic drops an inherited one."""
        return super().__hash__()
