"""RadioScene: where the stations of one tick are, and what lies between them."""

from dataclasses import dataclass

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.v2x.radio.path_loss import Classes


@dataclass(frozen=True, slots=True)
class RadioScene:
    """n stations that exchange messages, and m connected background vehicles behind them, both sorted by name."""

    stations: tuple[str, ...]
    """Names of the n stations: CAVs and road-side units."""
    xy: Float
    """(n + m, 2) [m]"""
    height: Float
    """(n + m,) of the antennas above the ground [m]."""
    speed: Float
    """(m,) of the background vehicles [m/s]."""
    classes: Classes
    """(n, n + m): `LinkClass` of each pair, symmetric in the first n columns."""
    blocker: Float
    """(n, n + m): height [m] of the highest vehicle between the two, 0 if there is none."""
    corner_db: Float | None = None
    """(n, n): median loss [dB] round a corner, NaN where the corner model does not hold; None: another model."""
