"""Transform CARLA's frame (left-handed, y to the right, degrees) to that of a map (right-handed, radians)."""

import math
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float, wrap_angle


@dataclass(frozen=True, slots=True)
class CarlaFrame:
    """Pose of CARLA's origin in the map's frame after y is flipped: x, y [m] and yaw [rad] counter-clockwise.

    A CARLA town is its own map and needs only the flip. Logs of V2XPnP need `UCLA_FRAME`.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def to_map_xy(self, xy_carla: Float) -> Float:
        """Return points (N, 2) [m] in the map's frame."""
        flipped = xy_carla * np.array((1.0, -1.0))
        if self.yaw:
            c, s = math.cos(self.yaw), math.sin(self.yaw)
            flipped = flipped @ np.array(((c, s), (-s, c)))
        return flipped + np.array((self.x, self.y))

    def to_map_yaw(self, yaw_carla_deg: float) -> float:
        """Return an angle [rad] in the map's frame."""
        return wrap_angle(self.yaw - math.radians(yaw_carla_deg))


UCLA_FRAME = CarlaFrame(502.5, -201.0)
"""CARLA's `ucla_v2` in the frame of V2XPnP's logs and vector maps, as published by MDriveBench (data_formats 1.4)."""
