"""A sample agent: one object per CAV. It follows its route and keeps a distance to the objects that its sensors detect.

The server imports this file in a sandbox and creates `Agent(config)` for every CAV; `config["config"]` is the path of
the file in config/. Import your own code from src/, and read weights with paths relative to this file.
"""

import json
from pathlib import Path

import numpy as np
from src.clearance import free_way

from mdrive_sumo.contract import Plan, Reply, SensorSpec

STEP_S, STEPS = 0.2, 15


class Agent:
    label = "single"

    def __init__(self, config):
        self.options = json.loads(Path(config["config"]).read_text())

    def sensors(self):
        """Return the sensors; called once. docs/sensors.md of mdrive-sumo lists them."""
        return (SensorSpec("objects", range_m=60.0),)

    def start(self, briefing):
        """Receive route, vehicle and limits; called once. Derive all randomness from briefing.seed."""
        self.route, self.s = briefing.route_xy, briefing.route_s
        self.limit = briefing.route_speed_limit

    def act(self, seen):
        """Return a plan (or a control), optionally with messages to others; called 20 times a second."""
        here = float(self.s[np.argmin(np.hypot(*(self.route - (seen.own.x, seen.own.y)).T))])
        free = free_way(self.route, self.s, here, seen.objects, self.options["width_m"])
        wanted = min(self.options["speed"], float(np.interp(here, self.s, self.limit)))
        stopping = np.sqrt(2 * self.options["braking"] * max(free - self.options["gap_m"], 0.0))
        s = here + min(wanted, stopping) * STEP_S * np.arange(1, STEPS + 1)
        points = np.column_stack([np.interp(s, self.s, axis) for axis in self.route.T])
        return Reply(plan=Plan(points, interval_s=STEP_S))
