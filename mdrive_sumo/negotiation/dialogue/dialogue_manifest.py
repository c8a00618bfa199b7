"""DialogueManifest: what a file of weights of the negotiator is."""

from pydantic import Field

from mdrive_sumo.core.onnx_manifest import OnnxManifest
from mdrive_sumo.negotiation.dialogue.decoder_shape import DecoderShape

SYSTEM = "negotiator"
"""Name of the network in manifests and checkpoints."""


class DialogueManifest(OnnxManifest):
    """Facts about the negotiator's weights."""

    vocabulary: str = Field(pattern=r"^[0-9a-f]{32}$")
    """Digest of the vocabulary that it was trained with."""
    shape: DecoderShape

    def __hash__(self) -> int:
        """As of any manifest; pydantic drops an inherited one."""
        return super().__hash__()
