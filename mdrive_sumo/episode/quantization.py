"""Recording resolution: 1 mm, 0.1 mrad, 1 mm/s. Live and stored scoring read the same quantized values."""

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Actors, EgoState, Frame

Quanta = npt.NDArray[np.int32]
RESOLUTION = np.array((1e-3, 1e-3, 1e-4, 1e-3))
"""Resolution of x [m], y [m], yaw [rad], speed [m/s]."""


def to_quanta(values: Float) -> Quanta:
    """Return (..., 4) x, y, yaw, speed as whole multiples of `RESOLUTION`."""
    return np.rint(values / RESOLUTION).astype(np.int32)


def from_quanta(quanta: Quanta) -> Float:
    """Return (..., 4) x, y, yaw, speed of whole multiples of `RESOLUTION`; the inverse of `to_quanta`."""
    return quanta.astype(np.float64) * RESOLUTION


def quantize_frame(frame: Frame) -> Frame:
    """Return the frame at recording resolution. Acceleration, yaw rate and steering angle stay unrounded."""
    actors = frame.actors
    rounded = actors
    if len(actors):
        table = np.array((actors.x, actors.y, actors.yaw, actors.speed))
        table /= _RESOLUTION_COLUMN
        x, y, yaw, speed = np.multiply(np.rint(table, out=table), _RESOLUTION_COLUMN, out=table)
        rounded = Actors(actors.ids, actors.kind, x, y, yaw, speed, actors.length, actors.width)
    egos = {ego_id: _quantize_ego(state) for ego_id, state in frame.egos.items()}
    return Frame(frame.tick, egos, rounded, frame.signals, frame.contacts)


def _quantize_ego(ego: EgoState) -> EgoState:
    x, y, yaw, speed = (
        round(v / step) * step for v, step in zip((ego.x, ego.y, ego.yaw, ego.speed), _RESOLUTIONS, strict=True)
    )
    return EgoState(x, y, yaw, speed, ego.acceleration, ego.yaw_rate, ego.steer_angle)


_RESOLUTIONS = tuple(float(step) for step in RESOLUTION)
_RESOLUTION_COLUMN = RESOLUTION[:, None]
