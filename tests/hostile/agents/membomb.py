"""Takes memory and uses it, up to 4 GB."""

from tell import tell

held = [bytearray(b"x") * (1 << 20) for _ in range(4096)]
tell(survived=len(held))
