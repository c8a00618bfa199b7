"""CARLA's frame: y to the right, degrees clockwise. The command line needs it, so numpy is not imported here."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mdrive_sumo.core.geometry import Float


@dataclass(frozen=True, slots=True)
class CarlaFrame:
    """Pose of CARLA's origin in the map's frame after y is flipped: x, y [m] and yaw [rad] counter-clockwise.

    A CARLA town is its own map and needs only the flip. Logs of V2XPnP need `UCLA_FRAME`.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def to_map_xy(self, xy_carla: "Float") -> "Float":
        """Return points (N, 2) [m] in the map's frame."""
        flipped, origin = xy_carla * (1.0, -1.0), (self.x, self.y)
        if self.yaw:
            c, s = math.cos(self.yaw), math.sin(self.yaw)
            flipped = flipped @ ((c, s), (-s, c))
        return flipped + origin

    def to_map_yaw(self, yaw_carla_deg: float) -> float:
        """Return an angle [rad] in the map's frame."""
        from mdrive_sumo.core.geometry import wrap_angle

        return wrap_angle(self.yaw - math.radians(yaw_carla_deg))


UCLA_FRAME = CarlaFrame(502.5, -201.0)
"""CARLA's `ucla_v2` in the frame of V2XPnP's logs and vector maps, as published by MDriveBench (data_formats 1.4)."""
