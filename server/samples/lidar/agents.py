"""A sample agent of the sensor track: one object per CAV, which sees by LiDAR only and has no lists of objects.

It follows its route and stops for what the LiDAR detects on it, or moving towards it. The server imports this file in a
sandbox and creates `Agent(config)` for every CAV; `config["config"]` is the path of the file in config/.
"""

import json
from pathlib import Path

import numpy as np
from src.obstacles import ObstacleFinder

from mdrive_sumo.contract import Plan, Reply, SensorSpec

STEP_S, STEPS = 0.2, 15
LOOK_TICKS = 4
"""It evaluates every fourth scan: 5 Hz."""


class Agent:
    label = "single"

    def __init__(self, config):
        self.options = json.loads(Path(config["config"]).read_text())

    def sensors(self):
        """Return the sensors; called once. With "objects" or "bev" it would be in the object track."""
        return (SensorSpec("lidar", "top"),)

    def start(self, briefing):
        """Receive route, vehicle and limits; called once."""
        self.route, self.s = briefing.route_xy, briefing.route_s
        self.limit, self.lights = briefing.route_speed_limit, briefing.traffic_lights
        self.finder = ObstacleFinder(briefing.tick_s)
        self.stop = np.inf
        self.looked = -LOOK_TICKS

    def act(self, seen):
        """Return a plan: along the route, as fast as the free way ahead allows; called 20 times a second."""
        own = seen.own
        here = float(self.s[np.argmin(np.hypot(*(self.route - (own.x, own.y)).T))])
        if "top" in seen.lidar and seen.tick - self.looked >= LOOK_TICKS:
            self.finder.update(seen.tick, own, seen.lidar["top"].points)
            self.stop = here + self.finder.find_free_way(self.route, self.s, here, self.options["width_m"])
            self.looked = seen.tick
        red = [light.s for light in self.lights if light.s > here and seen.signals.get(light.id, "G") in "ry"]
        free = min([self.stop - self.options["gap_m"], *(line - 3.0 for line in red)]) - here
        wanted = min(self.options["speed"], float(np.interp(here, self.s, self.limit)))
        stopping = np.sqrt(2 * self.options["braking"] * max(free, 0.0))
        s = here + min(wanted, stopping) * STEP_S * np.arange(1, STEPS + 1)
        points = np.column_stack([np.interp(s, self.s, axis) for axis in self.route.T])
        return Reply(plan=Plan(points, interval_s=STEP_S))
