"""Agents as participants write them for the CARLA leaderboard. No tests in here."""

from pathlib import Path

FOLLOWER = '''
import math

import carla
import numpy as np
from agents.navigation.local_planner import RoadOption
from leaderboard.autoagents.autonomous_agent import AutonomousAgent, Track


def get_entry_point():
    return "Follower"


class Follower(AutonomousAgent):
    """Pure pursuit of the GPS route with receiver, compass and speedometer, for all vehicles; no CARLA behind it."""

    RADIUS = 6378137.0

    def setup(self, path_to_conf_file, ego_vehicles_num):
        self.track = Track.SENSORS
        self.ego_vehicles_num = ego_vehicles_num
        self.config = {"target_point_distance": 3.0, "file": path_to_conf_file}
        self.next = [0] * ego_vehicles_num

    def sensors(self):
        return [
            {"type": "sensor.other.gnss", "x": -1.4, "y": 0.3, "z": 2.0, "id": "gps"},
            {"type": "sensor.other.imu", "x": 0.0, "y": 0.0, "z": 0.0, "yaw": 0.0, "id": "imu"},
            {"type": "sensor.speedometer", "reading_frequency": 20, "id": "speed"},
        ]

    def world(self, lat, lon):
        return self.RADIUS * math.radians(lon), -self.RADIUS * math.asinh(math.tan(math.radians(lat)))

    def steer(self, number, data):
        lat, lon = data["gps_%d" % number][1][:2]
        x, y = self.world(lat, lon)
        yaw = data["imu_%d" % number][1][6] - math.pi / 2
        x += 1.4 * math.cos(yaw) + 0.3 * math.sin(yaw)  # from the receiver to the middle
        y += 1.4 * math.sin(yaw) - 0.3 * math.cos(yaw)
        plan = self._global_plan[number]
        while self.next[number] < len(plan) - 1:
            point, option = plan[self.next[number]]
            tx, ty = self.world(point["lat"], point["lon"])
            if math.hypot(tx - x, ty - y) > 4.0:
                break
            self.next[number] += 1
        point, option = plan[self.next[number]]
        assert isinstance(option, RoadOption)
        tx, ty = self.world(point["lat"], point["lon"])
        place = self._global_plan_world_coord[number][self.next[number]][0].location
        assert place.distance(carla.Location(tx, ty, 0.0)) < 0.01
        ahead = math.cos(yaw) * (tx - x) + math.sin(yaw) * (ty - y)
        right = -math.sin(yaw) * (tx - x) + math.cos(yaw) * (ty - y)
        return math.atan2(2 * 2.9 * right, ahead**2 + right**2) / math.radians(70)

    def run_step(self, input_data, timestamp):
        controls = []
        for number in range(self.ego_vehicles_num):
            if "gps_%d" % number not in input_data:
                controls.append(None)
                continue
            control = carla.VehicleControl()
            control.steer = float(np.clip(self.steer(number, input_data), -1.0, 1.0))
            control.throttle = 0.5 if input_data["speed_%d" % number][1]["speed"] < 4.0 else 0.0
            control.brake = 0.0
            control.hand_brake = False
            controls.append(control)
        return controls
'''

SINGLE = '''
import math

import carla
from leaderboard.autoagents.autonomous_agent import AutonomousAgent, Track


def get_entry_point():
    return "Lone"


class Lone(AutonomousAgent):
    """As `Follower`, as the leaderboards of CARLA have it: for one vehicle, with one control."""

    RADIUS = 6378137.0

    def setup(self, path_to_conf_file):
        self.track = Track.SENSORS
        self.config = {"target_point_distance": 3.0, "file": path_to_conf_file}
        self.next = 0

    def sensors(self):
        return [
            {"type": "sensor.other.gnss", "x": 0.0, "y": 0.0, "z": 2.0, "id": "gps"},
            {"type": "sensor.other.imu", "x": 0.0, "y": 0.0, "z": 0.0, "yaw": 0.0, "id": "imu"},
            {"type": "sensor.speedometer", "reading_frequency": 20, "id": "speed"},
        ]

    def world(self, lat, lon):
        return self.RADIUS * math.radians(lon), -self.RADIUS * math.asinh(math.tan(math.radians(lat)))

    def run_step(self, input_data, timestamp):
        x, y = self.world(*input_data["gps"][1][:2])
        yaw = input_data["imu"][1][6] - math.pi / 2
        plan = self._global_plan
        while self.next < len(plan) - 1:
            tx, ty = self.world(plan[self.next][0]["lat"], plan[self.next][0]["lon"])
            if math.hypot(tx - x, ty - y) > 4.0:
                break
            self.next += 1
        tx, ty = self.world(plan[self.next][0]["lat"], plan[self.next][0]["lon"])
        assert self._global_plan_world_coord[self.next][0].location.distance(carla.Location(tx, ty, 0.0)) < 0.01
        ahead = math.cos(yaw) * (tx - x) + math.sin(yaw) * (ty - y)
        right = -math.sin(yaw) * (tx - x) + math.cos(yaw) * (ty - y)
        steer = math.atan2(2 * 2.9 * right, ahead**2 + right**2) / math.radians(70)
        slow = input_data["speed"][1]["speed"] < 4.0
        return carla.VehicleControl(throttle=0.5 if slow else 0.0, steer=min(max(steer, -1.0), 1.0))
'''

CAMERA = """
from leaderboard.autoagents.autonomous_agent import AutonomousAgent

def get_entry_point():
    return "Looks"

class Looks(AutonomousAgent):
    def sensors(self):
        return [{"type": "sensor.camera.dvs", "x": 1.3, "y": 0.0, "z": 2.3, "roll": 0.0, "pitch": 0.0, "yaw": 0.0,
                 "width": 800, "height": 600, "fov": 100, "id": "front"}]
    def run_step(self, input_data, timestamp):
        return []
"""

PLAIN = """
import carla

def get_entry_point():
    return "Plain"

class Plain:
    '''No base class; `MODE` says what it does wrong.'''
    MODE = "good"
    def setup(self, config, ego_num):
        self.ego_num, self.config = ego_num, config
        if self.MODE == "setup": raise OSError("no weights in " + config)
    def sensors(self):
        return [{"type": "sensor.speedometer", "id": "speed"}]
    def set_global_plan(self, gps, world):
        if self.MODE == "plan": raise RuntimeError("too far")
        self.gps, self.world = gps, world
    def run_step(self, data, timestamp):
        step = round(timestamp * 20)
        controls = [carla.VehicleControl(throttle=0.5) for _ in range(self.ego_num)]
        if step < 3: return controls
        if self.MODE == "short": return controls[:-1]
        if self.MODE == "one": return controls[0]
        if self.MODE == "none": return [controls[0], None]
        if self.MODE == "nan": return [controls[0], carla.VehicleControl(steer=float("nan"))]
        if self.MODE == "raise": raise RuntimeError("lost")
        return controls
"""


def write(folder: Path, source: str) -> Path:
    """The agent as a file."""
    path = folder / "agents.py"
    path.write_text(source)
    return path


def plain(folder: Path, mode: str) -> Path:
    """`PLAIN` that does something wrong."""
    return write(folder, PLAIN.replace('MODE = "good"', f"MODE = {mode!r}"))
