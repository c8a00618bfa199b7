"""FrameBuilder: the frames of a take for pages: rows of road users, the table of their names, lamps, and V2X."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mdrive_sumo.contract import Message
from mdrive_sumo.core.geometry import wrap_angles
from mdrive_sumo.core.state import TICKS_PER_SECOND, Frame, Kind, RoadUsers
from mdrive_sumo.loop import VEHICLE
from mdrive_sumo.report.scene_3d import describe_road_user
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.signal_lamps import SignalLamp, SignalLampObserver
from mdrive_sumo.v2x.messages import Cam, Cpm, Denm, Feature, Mcm, MessageError, decode
from server.drive.protocol import ROW, RowFlag

POINTS_EVERY = 2
"""Of a planned path every second point and the last one are shown, as in replays."""
Origin = tuple[float, float]


class NameTable:
    """Numbers of one group of road users in a table of names."""

    def __init__(self, rows: list[list[Any]]) -> None:
        """rows: the table, to which new names are added."""
        self._rows = rows
        self._indices: dict[str, int] = {}
        self._cached: tuple[tuple[str, ...], np.ndarray[Any, Any]] = (), np.zeros(0, dtype=np.uint16)

    def find(self, users: RoadUsers) -> np.ndarray[Any, Any]:
        """Return the number (N,) of each road user; new ones get the next number."""
        if users.ids is not self._cached[0]:  # the same object in most ticks
            numbers = [self._indices.get(name, -1) for name in users.ids]
            for row in [row for row, number in enumerate(numbers) if number < 0]:
                numbers[row] = self._add(users, row)
            self._cached = users.ids, np.array(numbers, dtype=np.uint16)
        return self._cached[1]

    def _add(self, users: RoadUsers, row: int) -> int:
        number, name, kind = len(self._rows), users.ids[row], Kind(int(users.kind[row]))
        length, width = float(users.length[row]), float(users.width[row])
        look = describe_road_user(name, kind, length, width)
        size = round(length, 2), round(width, 2), round(look.height, 2)
        self._rows.append([number, name, int(kind), *size, look.model, list(look.paint)])
        self._indices[name] = number
        return number


class FrameBuilder:
    """Builds the rows of every tick in order, and keeps them: they are the motion of the take."""

    def __init__(self, roads: RoadMap, origin: Origin) -> None:
        """origin: the point [m] to which positions are relative."""
        self._observer = SignalLampObserver(roads)
        self.origin = origin
        self.names: list[list[Any]] = []
        """The table of names: [index, id, kind, length, width, height, model, [r, g, b]]."""
        self._ego_names, self._actor_names = NameTable(self.names), NameTable(self.names)
        self._ego_ids: tuple[str, ...] = ()
        self.rows: list[bytes] = []
        """Rows of every tick so far, of type `protocol.ROW`."""
        self.signals: list[tuple[int, str, str]] = []
        """(tick, light, letters) of every change."""
        self._letters: dict[str, str] = {}

    def add(self, frame: Frame) -> None:
        """Add the rows of the next tick."""
        egos = self._list_egos(frame)
        users = egos.concat(frame.actors)
        lamps = self._observer.observe(frame.tick, users)
        rows = np.zeros(len(users), dtype=ROW)
        rows["name"] = np.concatenate((self._ego_names.find(egos), self._actor_names.find(frame.actors)))
        rows["lamps"] = [lamps.get(name, 0) for name in users.ids]
        rows["flags"] = np.where(rows["lamps"] & SignalLamp.BRAKE, RowFlag.BRAKING, 0)
        rows["x"], rows["y"] = users.x - self.origin[0], users.y - self.origin[1]
        rows["yaw"], rows["speed"] = users.yaw, users.speed
        self.rows.append(rows.tobytes())
        if frame.signals != self._letters:
            changed = {light: text for light, text in frame.signals.items() if self._letters.get(light) != text}
            self.signals += [(frame.tick, light, text) for light, text in changed.items()]
            self._letters = dict(frame.signals)

    def _list_egos(self, frame: Frame) -> RoadUsers:
        egos = RoadUsers.from_egos(frame.egos, dict.fromkeys(frame.egos, (VEHICLE.length, VEHICLE.width)))
        if egos.ids == self._ego_ids:
            return replace(egos, ids=self._ego_ids)
        self._ego_ids = egos.ids
        return egos


def describe_messages(
    received: Mapping[str, tuple[Message, ...]], names: Mapping[str, str], origin: Origin
) -> list[dict[str, Any]]:
    """Return the messages that arrived in a tick, as pages draw them: once for all receivers that got the same.

    received: by receiver. names: id in the scenario of each pseudonym, which texts are shown with. Positions relative
    to the origin [m].
    """
    receivers: dict[tuple[str, str, int, bytes], list[str]] = {}
    messages: dict[tuple[str, str, int, bytes], Message] = {}
    for receiver, arrived in received.items():
        for one in arrived:
            key = one.sender, one.type, one.tick, one.payload
            receivers.setdefault(key, []).append(receiver)
            messages[key] = one
    described = (_describe_message(one, receivers[key], names, origin) for key, one in messages.items())
    return [row for row in described if row is not None]


def _describe_message(
    message: Message, receivers: list[str], names: Mapping[str, str], origin: Origin
) -> dict[str, Any] | None:
    """Return a message; None for one that pages cannot draw: of an agent's own type, or malformed."""
    try:
        content = decode(message)
    except MessageError:
        return None
    row: dict[str, Any] = {"from": message.sender, "to": receivers, "kind": message.type}
    if isinstance(content, str):
        return {**row, "text": _restore_names(content, names)}
    return {**row, "at": _place((content.pose.x, content.pose.y), origin), **_describe_content(content, origin)}


def _describe_content(content: Cam | Cpm | Mcm | Denm | Feature, origin: Origin) -> dict[str, Any]:
    if isinstance(content, Cpm):
        seen = content.objects
        columns = (seen.x - origin[0], seen.y - origin[1], wrap_angles(seen.yaw), seen.length, seen.width, seen.speed)
        return {"objects": np.round(np.stack(columns, axis=1), 2).tolist()}
    if isinstance(content, Mcm):
        line = content.planned
        return {"path": [_place(point, origin) for point in (*line[:-1:POINTS_EVERY].tolist(), *line[-1:].tolist())]}
    if isinstance(content, Denm):
        return {
            "event": _place((content.x, content.y), origin),
            "cause": content.cause.name.lower().replace("_", " "),
            "valid_ticks": round(content.validity_s * TICKS_PER_SECOND),
            "ended": bool(content.termination),
        }
    if isinstance(content, Feature):
        return {"tiles": len(content.tiles)}
    return {"speed": round(content.speed, 2), "yaw": round(content.pose.yaw, 3)}


def _place(point: Sequence[float], origin: Origin) -> list[float]:
    return [round(point[0] - origin[0], 2), round(point[1] - origin[1], 2)]


def _restore_names(text: str, names: Mapping[str, str]) -> str:
    for told, station in names.items():
        text = text.replace(told, station)
    return text
