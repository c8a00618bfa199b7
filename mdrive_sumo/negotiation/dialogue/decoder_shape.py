"""DecoderShape: the sizes of the negotiator's network, which training, export and driving share."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DecoderShape:
    """Sizes of a decoder. The defaults have 9.3 M parameters: chosen so that int8 weights stay below 12 MB."""

    vocabulary: int = 2048
    context: int = 512
    """Entries of the longest prompt with its answer."""
    width: int = 320
    layers: int = 7
    heads: int = 10
    shared_heads: int = 2
    """Heads of keys and values, each for `heads / shared_heads` query heads."""
    mlp_width: int = 1024

    @property
    def head_width(self) -> int:
        """Width of one head of attention."""
        return self.width // self.heads

    @property
    def cache_shape(self) -> tuple[int, int, int, int]:
        """Shape of the keys and values of one entry."""
        return self.layers, 2, self.shared_heads, self.head_width


NEGOTIATOR = DecoderShape()
"""The network that `colmdriver` drives with."""
