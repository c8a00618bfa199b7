"""A sample agent in the style of the CARLA leaderboard: one object drives all CAVs of a scenario.

It follows the routes by satellite navigation and compass, and stops for what the LiDAR detects straight ahead. The
server provides stubs of `carla` and `leaderboard` with the few names that work without CARLA.
"""

import json
import math
from pathlib import Path

import carla
from leaderboard.autoagents.autonomous_agent import AutonomousAgent, Track
from src.ground import metres


def get_entry_point():
    return "Follower"


class Follower(AutonomousAgent):
    def setup(self, path_to_conf_file, ego_vehicles_num):
        """Called once, first; the path is that of the file in config/."""
        self.track = Track.SENSORS
        self.config = json.loads(Path(path_to_conf_file).read_text())
        self.count = ego_vehicles_num
        self.next = [0] * self.count
        self.blocked = [False] * self.count

    def sensors(self):
        """Return the sensors of every CAV; its number is appended to the ids."""
        return [
            {"type": "sensor.lidar.ray_cast", "x": 0.0, "y": 0.0, "z": 2.5, "yaw": 0.0, "id": "lidar"},
            {"type": "sensor.other.gnss", "x": 0.0, "y": 0.0, "z": 0.0, "id": "gps"},
            {"type": "sensor.other.imu", "x": 0.0, "y": 0.0, "z": 0.0, "id": "imu"},
            {"type": "sensor.speedometer", "reading_frequency": 20, "id": "speed"},
        ]

    def run_step(self, input_data, _timestamp):
        """Return one control per CAV, None for those that have ended."""
        return [self.control(number, input_data) for number in range(self.count)]

    def control(self, number, data):
        if f"gps_{number}" not in data:
            return None
        speed = data[f"speed_{number}"][1]["speed"]
        wanted = 0.0 if self.look(number, data, speed) else self.config["speed"]
        control = carla.VehicleControl()
        control.steer = max(-1.0, min(1.0, 1.2 * self.bearing(number, data)))
        control.throttle = max(0.0, min(0.75, 0.5 * (wanted - speed)))
        control.brake = max(0.0, min(1.0, 0.5 * (speed - wanted))) if wanted < speed else 0.0
        return control

    def bearing(self, number, data):
        """Return the bearing to a route point some metres ahead [rad], positive to the right as in CARLA."""
        here = data[f"gps_{number}"][1]
        plan = self._global_plan[number]
        while True:
            point = plan[self.next[number]][0]
            east, north = metres(here[0], here[1], point["lat"], point["lon"])
            if math.hypot(east, north) > self.config["look_ahead_m"] or self.next[number] == len(plan) - 1:
                break
            self.next[number] += 1
        compass = data[f"imu_{number}"][1][6]
        return math.remainder(math.atan2(east, north) - compass, math.tau)

    def look(self, number, data, speed):
        """Return whether the way is blocked; between two scans the last result counts."""
        if f"lidar_{number}" in data:
            x, y, z = data[f"lidar_{number}"][1][:, :3].T
            near = (x > 2.7) & (x < 6.0 + 1.2 * speed) & (abs(y) < 1.1)
            self.blocked[number] = bool((near & (z > -2.0) & (z < -0.5)).any())
        return self.blocked[number]
