"""Follow the log where its vehicle drove on another connector than the one that its route takes."""

import numpy as np

from mdrive_sumo.roads import RoadMap, Route, join_route_pieces
from real2sim.match import LaneMatch

TAPER_M = 10.0
"""[m] Length over which the route returns to the centre line: half of a lane change (`cavs.LANE_CHANGE_M`)."""
MAX_ASIDE_M = 3.5
"""[m] Largest lateral offset; `checks.OFF_LANE_M` allows 4 m."""
BEYOND_M = 1.0
"""[m] A point this far before or behind a lane is beside another one."""


def follow_log_aside(route: Route, match: LaneMatch, roads: RoadMap) -> Route:
    """Return the route with the log's own lateral offset in the stretch before or after a change between connectors.

    The driver was on the other connector there (`LaneMatch.aside_frames`), often around an obstacle on this one.
    """
    xy = route.xy.copy()
    lanes = dict.fromkeys(match.lanes[frame] for frame in match.aside_frames if match.lanes[frame])
    for lane in (roads.lanes[id_] for id_ in lanes):
        frames = [frame for frame in match.aside_frames if match.lanes[frame] == lane.id]
        stations, first = np.unique(match.s[frames], return_index=True)
        offsets = np.clip(match.offset[frames][first], -MAX_ASIDE_M, MAX_ASIDE_M)
        for i, (x, y) in enumerate(route.xy.tolist()):
            s, d = lane.centre.project(x, y)
            if abs(d) > BEYOND_M or np.hypot(*(np.array(lane.centre.at(s)) - (x, y))) > BEYOND_M:
                continue
            away = max(stations[0] - s, s - stations[-1], 0.0)
            share = np.clip(1 - away / TAPER_M, 0.0, 1.0)
            shift = float(np.interp(s, stations, offsets)) * share**2 * (3 - 2 * share)
            yaw = lane.centre.yaw_at(s)
            xy[i] += shift * np.array((-np.sin(yaw), np.cos(yaw)))
    return join_route_pieces(route.lanes, [(xy, route.yaw)])
