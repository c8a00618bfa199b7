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
from mdrive_sumo.core.state import DT
from mdrive_sumo.export.openscenario_entities import build_entity, compute_rear_to_centre
from mdrive_sumo.export.scored_recording import ScoredRecording, list_presences
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.netconvert import run_netconvert, strip_xml_comments

MINOR_VERSION = 2
NEWER_ATTRIBUTES = {
    b"header": (b"date",),  # of today, when the same recording shall give the same file
    b"outline": (b"id", b"fillType", b"outer", b"closed", b"laneType"),
    b"cornerLocal": (b"id",),
    b"cornerRoad": (b"id",),
}
"""Attributes that are left out, by element."""
NO_DATE = datetime(1970, 1, 1, tzinfo=UTC)
"""The file header needs a date; a recording has none, and the same recording gives the same file."""


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
    paths = _compute_paths(recording)
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


def _compute_paths(recording: ScoredRecording) -> Float:
    """Return x, y and yaw (T, N, 3) of the reference points."""
    x, y = recording.shift_ahead(-compute_rear_to_centre(recording))
    return np.stack((x, y, recording.record.yaw), axis=-1)


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
