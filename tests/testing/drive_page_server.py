"""A drive for tests of its page: the bytes of the protocol, one car on a made-up crossing, no simulator and no network.

The browser's requests are answered by Playwright. Time is the test's: each `tick` is one of the simulation.
"""

import json
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, astuple
from functools import cache
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from mdrive_sumo.contract import Control
from mdrive_sumo.core.state import Kind
from mdrive_sumo.report.scene_3d import describe_road_user, find_scene_area, pack_scene
from mdrive_sumo.vehicle.dynamics import MKZ_2017, VehicleState, initial_state, step
from server.drive.protocol import NO_STATE, ROW, FrameState, WireFrame, decode_input, encode_frame
from testing.drive_page_files import PAGE, read_page_files
from testing.viewer_crossing import crossing

ADDRESS = "http://drive.test/drive/ego_0?token=secret"
POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self' ws://drive.test"
"""The page works under it: no inline scripts, no inline styles, nothing from elsewhere."""
ORIGIN = (10.0, -20.0)
"""World position of the scene's origin [m]: not 0, so that a mix-up of both frames is seen."""
TURN_M = 13.75
"""[m] Radius of the left turn of the route."""
KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}
WORDS = {"vehicle": Kind.VEHICLE, "pedestrian": Kind.PEDESTRIAN, "cyclist": Kind.CYCLIST}
USERS: tuple[tuple[str, str, float, float], ...] = (
    ("ego_0", "vehicle", 4.9, 2.0),
    ("ego_1", "vehicle", 4.9, 2.0),
    ("car.1", "vehicle", 4.5, 1.8),
    ("bus.1", "vehicle", 12.0, 2.5),
    ("walker", "pedestrian", 0.5, 0.5),
    ("rider", "cyclist", 1.8, 0.6),
)
"""Id, kind, length and width [m]."""


def make_route() -> list[tuple[float, float]]:
    """From the west over the crossing to the north, a point each metre, in the world frame."""
    ahead = [(float(x), -1.75) for x in range(-150, -12)]
    steps = [i / 21 * math.pi / 2 for i in range(22)]
    turn = [(-12 + TURN_M * math.sin(angle), 12 - TURN_M * math.cos(angle)) for angle in steps]
    return [*ahead, *turn, *((1.75, float(y)) for y in range(13, 151))]


@cache
def make_scene() -> bytes:
    """The packed scene of the crossing."""
    return pack_scene(crossing(), find_scene_area(np.array(make_route()), 120.0), origin=ORIGIN)


class DrivePageServer:
    """Plays the server of one page. `received` keeps every input, `asked` every request."""

    def __init__(self, page: Any, *, delay_ticks: int = 0, **welcome: Any) -> None:
        self.page, self.delay_ticks, self.changes = page, delay_ticks, welcome
        self.own = initial_state(-140.0, -1.75, 0.0)
        self.tick_number, self.take, self.ack = 0, 1, 0
        self.state = FrameState.PAUSED
        self.queue: deque[tuple[int, Any]] = deque()
        self.mail: deque[tuple[int, bytes]] = deque()
        self.clock = 0
        self.control = Control(0.0, 0.0, 0.0)
        self.received: list[Any] = []
        self.asked: list[dict[str, Any]] = []
        self.states: list[VehicleState] = [self.own]
        self.takes = [self.describe_take(1)]
        self.socket: Any = None
        self.told: set[int] = set()
        self.extra: dict[str, Any] = {}
        self.files: dict[str, bytes] = {}
        page.route("**/*", self._answer)
        page.route_web_socket(lambda address: True, self._open)

    # ---- requests

    def _answer(self, route: Any) -> None:
        path = urlsplit(route.request.url).path
        name = PAGE if path.startswith("/drive/") else path.removeprefix("/static/")
        if path.startswith("/takes/"):
            self.files[path] = self.pack_motion()
        content = self.files.get(path) or (make_scene() if path == "/scene" else read_page_files().get(name))
        if content is None:
            route.fulfill(status=404, body="not found")
            return
        kind = KINDS.get("." + name.rpartition(".")[2], "application/octet-stream")
        route.fulfill(body=content, content_type=kind, headers={"Content-Security-Policy": POLICY})

    def _open(self, socket: Any) -> None:
        self.socket = socket
        self.told.clear()
        if self.state == FrameState.RUNNING:  # a driver who comes back finds the drive paused
            self.state = FrameState.PAUSED
        self.ack = 0
        self.queue.clear()
        socket.on_message(self._read)
        self.send(self.welcome())
        self.send_frame()

    def _read(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            given = decode_input(message)
            self.received.append(given)
            self.queue.append((self.clock + self.delay_ticks, given))
            return
        request = json.loads(message)
        if request["do"] == "ping":
            self.send({"is": "pong", "time": request["time"]})
            return
        self.asked.append(request)
        if request["do"] in ("pause", "resume"):
            self.state = FrameState.RUNNING if request["do"] == "resume" else FrameState.PAUSED
            self.send_frame()
        if request["do"] == "rewind":
            self.rewind(request["take"], request["tick"])
        if request["do"] == "what-if":
            self.send(
                {"is": "ghosts", "take": request["take"], "tick": request["tick"], "ghosts": self.imagine(request)}
            )

    def rewind(self, take: int, tick: int) -> None:
        """Begin a take at a tick of the only line of states that is kept."""
        self.takes[self.take - 1] |= {"end_tick": self.tick_number, "status": "left"}
        self.take = len(self.takes) + 1
        self.takes.append(self.describe_take(self.take, take, tick, end_tick=tick))
        self.tick_number, self.own, self.state = tick, self.states[tick], FrameState.PAUSED
        self.queue.clear()
        self.send_tree()
        self.send_frame()

    def send_tree(self) -> None:
        """Tell the takes."""
        self.send({"is": "tree", "takes": self.takes, "current": self.take})

    def imagine(self, request: Mapping[str, Any]) -> list[dict[str, Any]]:
        """What agents would do: each drives on at a speed of its own."""
        ghosts = []
        for number, agent in enumerate(request["agents"]):
            body, poses = self.states[request["tick"]], []
            for _ in range(int(request["seconds"] * 20)):
                body = step(body, Control(0.5 - 0.3 * number, 0.0, 0.01 * number), MKZ_2017)
                poses.append((body.x - ORIGIN[0], body.y - ORIGIN[1], body.yaw))
            ghosts.append({"agent": agent, "cav": "ego_0", "poses": poses, "ending": None})
        return ghosts

    def pack_motion(self) -> bytes:
        """Return the motion up to this tick, as `server.drive.worker.motion` describes it."""
        now, own = self.tick_number, self.own
        rows = []
        for tick, state in enumerate(self.states):
            self.tick_number, self.own = tick, state
            rows.append(self.rows().tobytes())
        self.tick_number, self.own = now, own
        header = {
            "take": self.take, "ticks": len(rows), "origin": ORIGIN, "cavs": ["ego_0", "ego_1"],
            "names": self._list_names(), "signals": [[0, "c", "rrrrGGGG"]],
        }  # fmt: skip
        text = json.dumps(header).encode()
        text += b" " * (-len(text) % 4)
        begins = np.arange(len(rows) + 1, dtype="<u4") * len(USERS)
        return b"".join((len(text).to_bytes(4, "little"), text, begins.tobytes(), *rows))

    def send(self, message: Mapping[str, Any]) -> None:
        """Send a text message."""
        self.socket.send(json.dumps(message))

    def welcome(self) -> dict[str, Any]:
        """The first message."""
        route = [(x - ORIGIN[0], y - ORIGIN[1]) for x, y in make_route()]
        across = [(x - ORIGIN[0], -1.75 - ORIGIN[1]) for x in range(-140, 150)]
        message = {
            "is": "welcome", "role": "driver", "cav": "ego_0", "scenario": "crossing_left",
            "description": "Turn left where a bus hides those who come from the other side.",
            "origin": ORIGIN, "route": route, "routes": {"ego_0": route, "ego_1": across},
            "speed_limits": [13.9] * len(route),
            "vehicle": asdict(MKZ_2017), "tick_s": 0.05, "most_ticks": 1200,
            "time_limit_ticks": {"ego_0": 900, "ego_1": 1200}, "agents": ["sharing", "idm"],
            "cavs": [
                {"id": "ego_0", "driver": "human", "is_connected": True},
                {"id": "ego_1", "driver": "sharing", "is_connected": False},
            ],
            "weather": "default", "v2x_view": True, "chat": True, "may_rewind": True,
            "may_hand_over": True, "return_path": "",
            "takes": self.takes, "pseudonyms": {"ego_0": "aaaa0000", "ego_1": "bbbb1111"},
        }  # fmt: skip
        return message | self.changes

    def describe_take(self, number: int, parent: int | None = None, tick: int = 0, **changes: Any) -> dict[str, Any]:
        """A take of the tree."""
        return {
            "number": number, "parent": parent, "tick": tick, "drivers": {"ego_0": "human", "ego_1": "sharing"},
            "status": "running", "end_tick": max(self.tick_number, tick), "score": None, "ds": {},
            "folder": f"takes/{number}",
        } | changes  # fmt: skip

    # ---- time

    def tick(self) -> None:
        """Simulate one tick, if the drive runs, and deliver what is due."""
        self.clock += 1
        if self.state in (FrameState.RUNNING, FrameState.SLOW):
            if self.queue and self.queue[0][0] <= self.clock:
                given = self.queue.popleft()[1]
                self.control, self.ack = given.control, given.number
            self.own = step(self.own, self.control, MKZ_2017)
            self.tick_number += 1
            self.states = [*self.states[: self.tick_number], self.own]
            self.send_frame()
        while self.mail and self.mail[0][0] <= self.clock:
            self.socket.send(self.mail.popleft()[1])

    def drive(self, ticks: int, ms: int = 50) -> None:
        """Let that many ticks go by, each with so much time for the browser."""
        for _ in range(ticks):
            self.tick()
            self.page.wait_for_timeout(ms)

    def drive_until(self, is_reached: Callable[[], bool], ticks: int = 200, ms: int = 25) -> None:
        """Let ticks go by until something is true: how much the browser does in a tick depends on the machine."""
        for _ in range(ticks):
            if is_reached():
                return
            self.drive(1, ms)
        assert is_reached()

    def send_frame(self) -> None:
        """Send the frame of this moment, after the delay."""
        extra = {**self.extra, **self._tell_names()}
        self.extra = {}
        own = NO_STATE if self.changes.get("role") == "spectator" else astuple(self.own)
        frame = WireFrame(self.state, self.tick_number, self.take, self.ack, own, self.rows(), extra)
        self.mail.append((self.clock + self.delay_ticks, encode_frame(frame)))
        while self.mail and self.mail[0][0] <= self.clock:
            self.socket.send(self.mail.popleft()[1])

    def _tell_names(self) -> dict[str, Any]:
        if self.told:
            return {}
        self.told = set(range(len(USERS)))
        return {"names": self._list_names(), "signals": {"c": "rrrrGGGG"}}

    def _list_names(self) -> list[list[Any]]:
        names = []
        for index, (name, kind, length, width) in enumerate(USERS):
            look = describe_road_user(name, WORDS[kind], length, width)
            names.append([index, name, int(WORDS[kind]), length, width, look.height, look.model, list(look.paint)])
        return names

    def poses(self) -> Sequence[tuple[float, float, float, float]]:
        """x, y, yaw, speed of the road users in this tick, in the world frame."""
        time = self.tick_number / 20
        return (
            (self.own.x, self.own.y, self.own.yaw, self.own.vx),
            (90 - 8 * time, 1.75, math.pi, 8.0),
            (-90 + 9 * time, -5.25, 0.0, 9.0),
            (26.0, 5.25, math.pi, 0.0),
            (16.0, -12 + 1.4 * time, math.pi / 2, 1.4),
            (-40 + 4 * time, -6.4, 0.0, 4.0),
        )

    def rows(self) -> Any:
        """The road users as the frame carries them."""
        rows = np.zeros(len(USERS), ROW)
        for index, (x, y, yaw, speed) in enumerate(self.poses()):
            rows[index] = (index, 0, 0, x - ORIGIN[0], y - ORIGIN[1], yaw, speed)
        rows["lamps"][2] = 2
        return rows

    # ---- what tests ask for

    def finish(self) -> None:
        """End the take with a score."""
        self.state = FrameState.FINISHED
        self.takes[self.take - 1] |= {
            "end_tick": self.tick_number, "status": "finished", "score": 87.5, "ds": {"ego_0": 75.0, "ego_1": 100.0},
            "losses": {"ego_0": "hit a building at 15.2 m/s"},
        }  # fmt: skip
        self.extra = {"endings": {"ego_0": "arrived", "ego_1": "blocked"}}
        self.send_frame()
        self.send_tree()
