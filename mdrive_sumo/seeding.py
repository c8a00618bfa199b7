"""Seeds: derived from names, never from positions, so that neither order nor worker count changes a result."""

from hashlib import blake2b


def derived_seed(run_seed: int, *purpose: str) -> int:
    """A seed in [0, 2**31) for one purpose, e.g. derived_seed(0, scenario.id, "sumo")."""
    text = "\x00".join((str(run_seed), *purpose))
    return int.from_bytes(blake2b(text.encode(), digest_size=4).digest(), "big") >> 1
