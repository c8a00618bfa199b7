"""Bits of ASN.1 values in unaligned packed encoding rules (UPER, ITU-T X.691)."""


class UperWriter:
    """Collects the bits of a value, field by field, in the order of its ASN.1 type."""

    def __init__(self) -> None:
        self._value = 0
        self._count = 0

    def add_bits(self, value: int, count: int) -> None:
        """Add the lowest bits of a value that fits into them, the highest first. Raises ValueError if it does not."""
        if not 0 <= value < 1 << count:
            raise ValueError(f"expected a value of {count} bits, found {value}")
        self._value = self._value << count | value
        self._count += count

    def add_flags(self, *flags: bool) -> None:
        """Add one bit for each: extension bits, and which optional fields are there."""
        for flag in flags:
            self.add_bits(int(flag), 1)

    def add_integer(self, value: int, lowest: int, highest: int) -> None:
        """Add a constrained whole number (X.691, 10.5). Raises ValueError if it is out of its range."""
        if not lowest <= value <= highest:
            raise ValueError(f"expected a number from {lowest} to {highest}, found {value}")
        self.add_bits(value - lowest, (highest - lowest).bit_length())

    def add_choice(self, index: int, alternatives: int) -> None:
        """Add which alternative of a choice or enumeration without extension follows (X.691, 13 and 22)."""
        self.add_integer(index, 0, alternatives - 1)

    def to_bytes(self) -> bytes:
        """Return the bits, filled up to whole bytes with zeros (X.691, 10.1)."""
        size = -(-self._count // 8)
        return (self._value << 8 * size - self._count).to_bytes(size, "big")
