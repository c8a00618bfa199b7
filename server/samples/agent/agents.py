"""A sample agent: one object for each CAV. It follows its route and keeps clear of what its sensors see.

The server imports this file in a sandbox and makes `Agent(config)` for every CAV; `config["config"]` is the path of
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
        """Asked once. docs/sensors.md of mdrive-sumo lists what there is."""
        return (SensorSpec("objects", range_m=60.0),)

    def start(self, briefing):
        """Told once: the route, the car, the limits. All randomness has to come from briefing.seed."""
        self.route, self.s = briefing.route_xy, briefing.route_s
        self.limit = briefing.route_speed_limit

    def act(self, seen):
        """Asked 20 times a second: a plan (or a control), and messages to the others if you like."""
        here = float(self.s[np.argmin(np.hypot(*(self.route - (seen.own.x, seen.own.y)).T))])
        free = free_way(self.route, self.s, here, seen.objects, self.options["width_m"])
        wanted = min(self.options["speed"], float(np.interp(here, self.s, self.limit)))
        stopping = np.sqrt(2 * self.options["braking"] * max(free - self.options["gap_m"], 0.0))
        s = here + min(wanted, stopping) * STEP_S * np.arange(1, STEPS + 1)
        points = np.column_stack([np.interp(s, self.s, axis) for axis in self.route.T])
        return Reply(plan=Plan(points, interval_s=STEP_S))
