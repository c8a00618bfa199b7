"""Seeds and random numbers derived from names, never from positions or earlier draws.

So neither the order of execution nor the number of workers changes a result. seeding.c draws the same numbers
(`core.compiled`); seeding.h has them for other C files.
"""

import math
import struct
from hashlib import blake2b

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin

UNIFORMS = 8
"""Count of numbers that `draw_uniforms` returns."""
_WORDS = struct.Struct(f"<{UNIFORMS}Q")


def derive_seed(run_seed: int, *purpose: str) -> int:
    """Return a seed in [0, 2**31) for one purpose, e.g. derive_seed(0, scenario.id, "sumo")."""
    text = "\x00".join((str(run_seed), *purpose))
    return int.from_bytes(blake2b(text.encode(), digest_size=4).digest(), "big") >> 1


@twin
def draw_uniforms(seed: int, /, *purpose: str | int) -> tuple[float, ...]:
    """Return `UNIFORMS` independent numbers in [0, 1) for a purpose, e.g. (seed, "loss", sender, receiver, tick)."""
    return tuple([(word >> 11) * 2.0**-53 for word in _WORDS.unpack(_hash(seed, purpose))])


@twin
def draw_first_uniform(seed: int, /, *purpose: str | int) -> float:
    """Return the first number of `draw_uniforms`, which is often enough to know that the others do not count."""
    return (_WORDS.unpack(_hash(seed, purpose))[0] >> 11) * 2.0**-53


def _hash(seed: int, purpose: tuple[str | int, ...]) -> bytes:
    return blake2b("\x00".join(map(str, (seed, *purpose))).encode(), digest_size=8 * UNIFORMS).digest()


@twin
def draw_normals(seed: int, /, *purpose: str | int) -> tuple[float, ...]:
    """Return `UNIFORMS` independent standard normal numbers for one purpose (Box-Muller transform)."""
    drawn = draw_uniforms(seed, *purpose)
    pairs = zip(drawn[0::2], drawn[1::2], strict=True)
    radii = ((math.sqrt(-2 * portable.log(1 - a)), portable.cos_sin(2 * math.pi * b)) for a, b in pairs)
    return tuple(value for r, (cos, sin) in radii for value in (r * cos, r * sin))
