"""The tables of a data set of demonstrations: what a person was shown in a tick, and what the person did.

Everything that a tick shows is what an agent would be given in it (`contract.Observation`): estimates of the own state,
detections with their errors, messages. The true pose stands beside it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mdrive_sumo.contract import Briefing, Message, Objects, Observation
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.export.table_files import TableColumn
from mdrive_sumo.runs.takes import ObservedTake
from mdrive_sumo.v2x.messages import TEXT, Cam, Cpm, MessageError, decode

SENSOR, CAM_SOURCE, CPM_SOURCE = "sensor", "cam", "cpm"
"""Where a row of `objects` comes from."""
DECIMALS = 4
"""Of metres, radians and metres a second: finer than what recordings resolve."""
KIND_NAMES = tuple(kind.name.lower() for kind in Kind)


@dataclass(frozen=True, slots=True)
class DemonstrationTable:
    """A table of the data set, with all its columns."""

    name: str
    description: str
    columns: tuple[TableColumn, ...]


_EPISODE = (
    TableColumn("scenario", "string", "", "id of the scenario"),
    TableColumn("seed", "integer", "", "seed of the take"),
    TableColumn("episode", "string", "", "digest of the episode"),
    TableColumn("cav", "string", "", "id of the CAV"),
)
_TICK = (
    *_EPISODE,
    TableColumn("tick", "integer", "tick", "20 per second, the first is 0"),
)
TAKES = DemonstrationTable(
    "takes",
    "one row per take and CAV that a person drove in ticks of this data set",
    (
        *_EPISODE,
        TableColumn("folder", "string", "", "name of the run folder of the take"),
        TableColumn("device", "string", "", "input device of the take"),
        TableColumn("latency_ms", "number", "ms", "median time from an input to its tick, as measured"),
        TableColumn("ticks", "integer", "tick", "ticks of this CAV in `steps`"),
        TableColumn("repeated", "integer", "tick", "ticks left out: another take has them (a branch of it)"),
        TableColumn("outcome", "string", "", "arrived, blocked, deviated, timed-out or agent-failed"),
        TableColumn("reason", "string", "", "of agent-failed: why, e.g. that the person left"),
        TableColumn("ds", "number", "%", "driving score of the CAV"),
        TableColumn("rc", "number", "%", "route completion of the CAV"),
        TableColumn("ip", "number", "", "infraction penalty of the CAV, a factor in [0, 1]"),
    ),
)
STEPS = DemonstrationTable(
    "steps",
    "one row per tick in which a person drove: own state, route, and the controls of the tick",
    (
        *_TICK,
        TableColumn("time_s", "number", "s", "time since the start of the episode"),
        TableColumn("device", "string", "", "input device"),
        TableColumn("x", "number", "m", "own position as estimated on board, box centre"),
        TableColumn("y", "number", "m", "own position as estimated on board, box centre"),
        TableColumn("yaw", "number", "rad", "own heading as estimated, counter-clockwise from +x"),
        TableColumn("speed", "number", "m/s", "own speed as estimated, along yaw"),
        TableColumn("acceleration", "number", "m/s2", "own acceleration as estimated, along yaw"),
        TableColumn("yaw_rate", "number", "rad/s", "own yaw rate as estimated, positive to the left"),
        TableColumn("steer_angle", "number", "rad", "angle of the front wheels, positive to the left"),
        TableColumn("true_x", "number", "m", "true position, box centre"),
        TableColumn("true_y", "number", "m", "true position, box centre"),
        TableColumn("true_yaw", "number", "rad", "true heading"),
        TableColumn("true_speed", "number", "m/s", "true speed along the true heading"),
        TableColumn("route_s", "number", "m", "arc length of the nearest point of the route, from the estimate"),
        TableColumn("route_offset", "number", "m", "distance to that point, positive to the left of the route"),
        TableColumn("route_left", "number", "m", "rest of the route"),
        TableColumn("speed_limit", "number", "m/s", "speed limit at that point"),
        TableColumn("light", "string", "", "letter of the next traffic light on the route, as SUMO; empty: none"),
        TableColumn("light_distance", "number", "m", "distance along the route to its stop line"),
        TableColumn("stop_distance", "number", "m", "distance along the route to the line of the next stop sign"),
        TableColumn("throttle", "number", "", "control of this tick, in [0, 1]"),
        TableColumn("brake", "number", "", "control of this tick, in [0, 1]"),
        TableColumn("steer", "number", "", "control of this tick, in [-1, 1], left positive"),
    ),
)
OBJECTS = DemonstrationTable(
    "objects",
    "one row per tick and road user that the car knew of: by its own sensor, or by a message that arrived",
    (
        *_TICK,
        TableColumn("source", "string", "", "sensor, cam (the sender itself) or cpm (what the sender sees)"),
        TableColumn("sender", "string", "", "id of the station that sent the message; empty: own sensor"),
        TableColumn("id", "string", "", "name of the track, of the car or of the sender"),
        TableColumn("kind", "string", "", "vehicle, pedestrian, cyclist or static"),
        TableColumn("x", "number", "m", "box centre, as measured"),
        TableColumn("y", "number", "m", "box centre, as measured"),
        TableColumn("yaw", "number", "rad", "as measured"),
        TableColumn("speed", "number", "m/s", "along yaw, as measured"),
        TableColumn("length", "number", "m", "as measured"),
        TableColumn("width", "number", "m", "as measured"),
    ),
)
TEXTS = DemonstrationTable(
    "texts",
    "one row per text that the person wrote or received in ticks of `steps`",
    (
        *_TICK,
        TableColumn("sender", "string", "", "id of the station that wrote it"),
        TableColumn("text", "string", "", "the text"),
    ),
)
ROUTES = DemonstrationTable(
    "routes",
    "one row per point of the route of a CAV, every metre",
    (
        *_EPISODE,
        TableColumn("s", "number", "m", "arc length along the route"),
        TableColumn("x", "number", "m", "the point"),
        TableColumn("y", "number", "m", "the point"),
        TableColumn("yaw", "number", "rad", "direction of the lane"),
        TableColumn("lane_width", "number", "m", "width of the lane"),
        TableColumn("speed_limit", "number", "m/s", "speed limit"),
    ),
)
TABLES = (TAKES, STEPS, OBJECTS, TEXTS, ROUTES)
"""All tables, in the order of the documentation."""


@dataclass(frozen=True, slots=True)
class DemonstratedTick:
    """What a person was shown in a tick; what the person did is in the recording."""

    tick: int
    seen: Observation
    objects: Objects
    """Detections of the own sensor, read while their tick was computed."""


Rows = list[tuple[Any, ...]]


def build_step(take: ObservedTake, ego: str, route: Polyline, one: DemonstratedTick) -> tuple[Any, ...]:
    """Return the row of `steps` after its key."""
    record, own, tick = take.record, one.seen.own, one.tick
    column = record.ego_ids.index(ego)
    s, offset = route.project(own.x, own.y)
    throttle, brake, steer = record.control_values[tick, column].tolist()
    truth = (float(values[tick, column]) for values in (record.x, record.y, record.yaw, record.speed))
    return (
        round(tick * DT, 2),
        str(take.actions[ego].find_driver(tick).device),
        *_round(own.x, own.y, own.yaw, own.speed, own.acceleration, own.yaw_rate, own.steer_angle),
        *_round(*truth),
        *_round(s, offset, route.length - s),
        *_describe_road(take.briefings[ego], s, one.seen.signals),
        *_round(throttle, brake, steer),
    )


def _describe_road(briefing: Briefing, s: float, signals: Mapping[str, str]) -> tuple[Any, ...]:
    """Return speed limit, letter and distance of the next light, and distance of the next stop sign."""
    point = min(int(briefing.route_s.searchsorted(s)), len(briefing.route_s) - 1)
    light = next((one for one in briefing.traffic_lights if one.s >= s), None)
    sign = next((one for one in briefing.stop_signs if one.s >= s), None)
    return (
        round(float(briefing.route_speed_limit[point]), DECIMALS),
        "" if light is None else signals.get(light.id, ""),
        None if light is None else round(light.s - s, DECIMALS),
        None if sign is None else round(sign.s - s, DECIMALS),
    )


def build_objects(take: ObservedTake, one: DemonstratedTick) -> Rows:
    """Return the rows of `objects` of a tick, after their key and tick."""
    rows: Rows = [(SENSOR, "", *row) for row in _list_boxes(one.objects)]
    for message, content in _decode(one.seen.messages):
        sender = take.record.restore_name(message.sender)
        if isinstance(content, Cam):
            pose = content.pose
            box = _round(pose.x, pose.y, pose.yaw, content.speed, content.length, content.width)
            rows.append((CAM_SOURCE, sender, sender, KIND_NAMES[Kind.VEHICLE], *box))
        elif isinstance(content, Cpm):
            rows += [(CPM_SOURCE, sender, *row) for row in _list_boxes(content.objects)]
    return rows


def _list_boxes(objects: Objects) -> Iterator[tuple[Any, ...]]:
    names = ("x", "y", "yaw", "speed", "length", "width")
    columns = [getattr(objects, name).round(DECIMALS).tolist() for name in names]
    for name, kind, *box in zip(objects.ids, objects.kind.tolist(), *columns, strict=True):
        yield (name, KIND_NAMES[kind], *box)


def _decode(messages: Sequence[Message]) -> Iterator[tuple[Message, object]]:
    for message in messages:
        try:
            yield message, decode(message)
        except MessageError:  # of a type of an agent's own
            continue


def build_texts(take: ObservedTake, ego: str, one: DemonstratedTick) -> Rows:
    """Return the rows of `texts` of a tick, after their key and tick: what arrived, and what the person wrote."""
    record = take.record
    arrived = [
        (record.restore_name(m.sender), str(content)) for m, content in _decode(one.seen.messages) if m.type == TEXT
    ]
    return [*arrived, *((ego, text) for text in take.actions[ego].read(one.tick).texts)]


def build_route(briefing: Briefing) -> Rows:
    """Return the rows of `routes` of a CAV, after their key."""
    columns = (
        briefing.route_s,
        *briefing.route_xy.T,
        briefing.route_yaw,
        briefing.route_lane_width,
        briefing.route_speed_limit,
    )
    return list(zip(*(column.round(DECIMALS).tolist() for column in columns), strict=True))


def _round(*values: float) -> tuple[float, ...]:
    return tuple(round(value, DECIMALS) for value in values)
