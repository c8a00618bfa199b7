"""Start boxes of converted InterDrive scenarios."""

from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.scenario.scenario import Scenario


def start_boxes(scenario: Scenario) -> list[Float]:
    return [box_corners(ego.start.x, ego.start.y, ego.start.yaw, 4.9, 2.0) for ego in scenario.egos]
