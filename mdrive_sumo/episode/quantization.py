"""Recording resolution: 1 mm, 0.1 mrad, 1 mm/s. Live and stored scoring read the same quantized values."""

from array import array
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import CONTROL_STEP, Control
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Actors, EgoState, Frame

Quanta = npt.NDArray[np.int32]
RESOLUTION = np.array((1e-3, 1e-3, 1e-4, 1e-3))
"""Resolution of x [m], y [m], yaw [rad], speed [m/s]."""


def to_quanta(values: Float) -> Quanta:
    """Return (..., 4) x, y, yaw, speed as whole multiples of `RESOLUTION`. Raises ValueError beyond 32 bits."""
    whole = np.rint(values / RESOLUTION)
    if not ((whole >= -(2.0**31)) & (whole < 2.0**31)).all():  # NaN fails too
        raise ValueError("expected a state that a recording can hold")
    return whole.astype(np.int32)


def from_quanta(quanta: Quanta) -> Float:
    """Return (..., 4) x, y, yaw, speed of whole multiples of `RESOLUTION`; the inverse of `to_quanta`."""
    return quanta.astype(np.float64) * RESOLUTION


@twin
def quantize_frame(frame: Frame, /) -> Frame:
    """Return the frame at recording resolution. Acceleration, yaw rate and steering angle stay unrounded."""
    actors = frame.actors
    if len(actors):
        columns = zip((actors.x, actors.y, actors.yaw, actors.speed), _RESOLUTIONS, strict=True)
        x, y, yaw, speed = (np.rint(column / step) * step for column, step in columns)
        actors = Actors(actors.ids, actors.kind, x, y, yaw, speed, actors.length, actors.width)
    egos = {ego_id: _quantize_ego(state) for ego_id, state in frame.egos.items()}
    return Frame(frame.tick, egos, actors, frame.signals, frame.contacts)


def _quantize_ego(ego: EgoState) -> EgoState:
    x, y, yaw, speed = (
        round(v / step) * step for v, step in zip((ego.x, ego.y, ego.yaw, ego.speed), _RESOLUTIONS, strict=True)
    )
    return EgoState(x, y, yaw, speed, ego.acceleration, ego.yaw_rate, ego.steer_angle)


@twin
def pack_states(frame: Frame, /) -> bytes:
    """Return the quanta of CAVs, then of actors: four little-endian 32-bit integers each."""
    actors = frame.actors
    egos = np.array([(ego.x, ego.y, ego.yaw, ego.speed) for ego in frame.egos.values()]).reshape(-1, 4)
    others = np.column_stack((actors.x, actors.y, actors.yaw, actors.speed))
    return to_quanta(np.concatenate((egos, others))).astype("<i4", copy=False).tobytes()


@twin
def pack_controls(egos: tuple[str, ...], controls: Mapping[str, Control], /) -> bytes:
    """Return throttle, brake and steer of all CAVs in steps of `CONTROL_STEP`: little-endian 16-bit integers.

    Those of a CAV without a control are 0.
    """
    packed = array("h")
    for control in map(controls.get, egos):
        values = (control.throttle, control.brake, control.steer) if control else (0.0, 0.0, 0.0)
        packed.extend(round(value / CONTROL_STEP) for value in values)
    return packed.tobytes()


@twin
def round_points(points: Float, /) -> Float:
    """Return points of a plan [m], any shape, rounded to centimetres."""
    return np.round(points, 2)


_RESOLUTIONS = tuple(float(step) for step in RESOLUTION)
