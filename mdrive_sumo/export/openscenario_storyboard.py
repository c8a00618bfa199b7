"""OpenSCENARIO XML 1.2: recordings as trajectories of entities, with the network as OpenDRIVE beside them.

The reference point of a vehicle is its rear axle, that of anything else its box centre; world positions are those of
the network, metres and radians. Source: ASAM OpenSCENARIO XML 1.2.0; written with scenariogeneration.
"""

# pyright: reportArgumentType=false
# scenariogeneration annotates members of its enumerations with another class than it demands.
import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from scenariogeneration import xosc

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.output_files import write_bytes

# pyright: reportArgumentType=false
# scenariogeneration annotates members of its enumerations with another class than it demands.
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.export.scored_recording import ScoredRecording, list_presences
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.netconvert import run_netconvert, strip_xml_comments
from mdrive_sumo.vehicle.dynamics import VehicleParameters

REAR_SHARE = 0.28
"""Distance from the box centre to the rear axle, as a share of the length: 1.37 m of a car of 4.9 m. Recordings have no
axles; that of a CAV is known (`VehicleParameters.rear_to_centre`)."""
WHEEL_M = 0.65
"""Diameter of wheels, which the format demands; assumed."""
MASS_KG = {"pedestrian": 75.0, "static": 50.0}
"""Assumed, as the format demands one."""
CATEGORY = {
    "car": xosc.VehicleCategory.car,
    "van": xosc.VehicleCategory.van,
    "truck": xosc.VehicleCategory.truck,
    "bus": xosc.VehicleCategory.bus,
    "motorcycle": xosc.VehicleCategory.motorbike,
    "bicycle": xosc.VehicleCategory.bicycle,
}
MINOR_VERSION = 2
"""Of OpenSCENARIO XML 1: version 1.2."""
NEWER_ATTRIBUTES = {
    b"header": (b"date",),  # of today, when the same recording shall give the same file
    b"outline": (b"id", b"fillType", b"outer", b"closed", b"laneType"),
    b"cornerLocal": (b"id",),
    b"cornerRoad": (b"id",),
}
"""Attributes that are left out, by element."""
NO_DATE = datetime(1970, 1, 1, tzinfo=UTC)
"""The file header needs a date; a recording has none, and the same recording gives the same file."""


def compute_rear_to_centre(recording: ScoredRecording) -> Float:
    """Return how far (N,) [m] the reference point lies behind the box centre: the rear axle of vehicles, else 0."""
    record = recording.record
    is_vehicle = np.isin(record.kind, (Kind.VEHICLE, Kind.CYCLIST))
    assumed = np.where(is_vehicle, REAR_SHARE * record.length, 0.0)
    return np.where(np.arange(len(record.ids)) < record.egos, VehicleParameters().rear_to_centre, assumed)


def build_entity(
    recording: ScoredRecording, column: int, name: str
) -> xosc.Vehicle | xosc.Pedestrian | xosc.MiscObject:
    """Return the entity of a column with its box, which lies around the reference point."""
    record, category = recording.record, recording.categories[column]
    rear = float(compute_rear_to_centre(recording)[column])
    length, width = float(record.length[column]), float(record.width[column])
    height = float(recording.heights[column])
    box = xosc.BoundingBox(width, length, height, round(rear, 4), 0.0, height / 2)
    if category == "pedestrian":
        return xosc.Pedestrian(name, MASS_KG[category], xosc.PedestrianCategory.pedestrian, box)
    if category == "static":
        return xosc.MiscObject(name, MASS_KG[category], xosc.MiscObjectCategory.obstacle, box)
    car = VehicleParameters()
    front = xosc.Axle(car.max_steer_angle, WHEEL_M, width, round(2 * rear, 4), WHEEL_M / 2)
    back = xosc.Axle(0.0, WHEEL_M, width, 0.0, WHEEL_M / 2)
    limits = (car.max_speed, car.max_acceleration, car.max_deceleration)
    vehicle = xosc.Vehicle(name, CATEGORY[category], box, front, back, *limits)
    vehicle.add_property("mdrive_role", "cav" if column < record.egos else "traffic")
    return vehicle


@dataclass(frozen=True, slots=True)
class EntityDrive:
    """One presence of a road user as an entity."""

    name: str
    column: int
    presence: range


def write_openscenario(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write SCENARIO.xosc per recording, and NETWORK.xodr once per network."""
    for recording in recordings:
        road_file = f"{recording.scenario.network}.xodr"
        if not (folder / road_file).exists():
            write_bytes(folder / road_file, build_opendrive(recording.roads))
        build_storyboard_file(recording, road_file).write_xml(str(folder / f"{recording.name}.xosc"))


def build_opendrive(roads: RoadMap) -> bytes:
    """Return the network as an OpenDRIVE map in the same frame. Raises InputError without netconvert."""
    options = ("--sumo-net-file", str(roads.net_file.resolve()), "--precision", "4")
    xodr = run_netconvert(options, roads.folder, f"{roads.net_file}: expected a network", "--opendrive-output")
    return conform_to_version(strip_xml_comments(xodr))


def conform_to_version(xodr: bytes) -> bytes:
    """Return a map of netconvert's without its date, and without the attributes that version 1.4 does not have.

    netconvert writes `revMinor="4"`, and outlines of crossings as in version 1.5.
    """
    for element, attributes in NEWER_ATTRIBUTES.items():
        for name in attributes:
            xodr = re.sub(rb'(<%b\b[^>]*?) %b="[^"]*"' % (element, name), rb"\1", xodr)
    return xodr


def build_storyboard_file(recording: ScoredRecording, road_file: str) -> xosc.Scenario:
    """Return the scenario. An entity that comes later is added then; one that leaves is deleted then."""
    drives = list(_list_drives(recording))
    entities, init = xosc.Entities(), xosc.Init()
    for drive in drives:
        entities.add_scenario_object(drive.name, build_entity(recording, drive.column, drive.name))
    x, y = recording.shift_ahead(-compute_rear_to_centre(recording))
    paths = np.stack((x, y, recording.record.yaw), axis=-1)  # (T, N, 3) of the reference points
    last_s = (recording.record.ticks - 1) * DT
    storyboard = xosc.StoryBoard(init, _build_trigger("end", last_s))
    act = xosc.Act("recording", _build_trigger("start", 0.0))
    for drive in drives:
        path = paths[drive.presence.start : drive.presence.stop, drive.column]
        if drive.presence.start == 0:
            init.add_init_action(drive.name, xosc.TeleportAction(_build_position(path[0])))
        act.add_maneuver_group(_build_maneuvers(drive, path, recording.record.ticks))
    storyboard.add_act(act)
    return xosc.Scenario(
        recording.name,
        "mdrive-sumo",
        xosc.ParameterDeclarations(),
        entities,
        storyboard,
        xosc.RoadNetwork(roadfile=road_file),
        xosc.Catalog(),
        osc_minor_version=MINOR_VERSION,
        creation_date=NO_DATE,
    )


def _list_drives(recording: ScoredRecording) -> Iterable[EntityDrive]:
    record = recording.record
    for column, id_ in enumerate(record.ids):
        for n, presence in enumerate(list_presences(record.valid[:, column])):
            yield EntityDrive(f"{id_}#{n + 1}" if n else id_, column, presence)


def _build_maneuvers(drive: EntityDrive, path: Float, ticks: int) -> xosc.ManeuverGroup:
    """Return the events of an entity: it appears, follows its trajectory, and leaves."""
    maneuver = xosc.Maneuver(f"{drive.name} drives")
    first, last = drive.presence[0], drive.presence[-1]
    if first > 0:
        appear = xosc.AddEntityAction(drive.name, _build_position(path[0]))
        maneuver.add_event(_build_event(f"{drive.name} appears", first * DT, appear))
    if len(path) > 1:
        times = [round(tick * DT, 2) for tick in drive.presence]
        trajectory = xosc.Trajectory(f"{drive.name} path", closed=False)
        trajectory.add_shape(xosc.Polyline(times, [_build_position(row) for row in path]))
        follow = xosc.FollowTrajectoryAction(
            trajectory, xosc.FollowingMode.position, xosc.ReferenceContext.absolute, scale=1.0, offset=0.0
        )
        maneuver.add_event(_build_event(f"{drive.name} follows", first * DT, follow))
    if last < ticks - 1:
        leave = xosc.DeleteEntityAction(drive.name)
        maneuver.add_event(_build_event(f"{drive.name} leaves", (last + 1) * DT, leave))
    group = xosc.ManeuverGroup(f"{drive.name} maneuvers")
    group.add_actor(drive.name)
    group.add_maneuver(maneuver)
    return group


def _build_event(name: str, at_s: float, action: Any) -> xosc.Event:
    event = xosc.Event(name, xosc.Priority.parallel)
    event.add_trigger(_build_trigger(name, at_s))
    event.add_action(f"{name} action", action)
    return event


def _build_trigger(name: str, at_s: float) -> xosc.ValueTrigger:
    """Return a trigger that fires when the simulation time reaches `at_s`."""
    condition = xosc.SimulationTimeCondition(round(at_s, 2), xosc.Rule.greaterOrEqual)
    point = "stop" if name == "end" else "start"
    return xosc.ValueTrigger(f"{name} time", 0.0, xosc.ConditionEdge.none, condition, triggeringpoint=point)


def _build_position(row: Float) -> xosc.WorldPosition:
    x, y, yaw = (round(float(value), 5) for value in row)
    return xosc.WorldPosition(x=x, y=y, z=0.0, h=yaw, p=0.0, r=0.0)
