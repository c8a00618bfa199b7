"""ScenarioNet: scenario descriptions (pickled dictionaries of NumPy arrays) as MetaDrive replays them.

Source: Li et al., ScenarioNet, NeurIPS 2023; `ScenarioDescription.sanity_check` of metadrive-simulator 0.4.3. Metres,
radians; a state is the box centre. Frames are 0.1 s apart, because MetaDrive replays one frame per step of 0.1 s.
"""

import pickle
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.output_files import new_file
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, Kind
from mdrive_sumo.export.lane_assignment import compute_bounds, compute_outline, find_predecessors
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.export.signal_states import list_lane_signals
from mdrive_sumo.roads import Lane, RoadMap

VERSION = "MetaDrive v0.4.3"
"""Of the description's rules."""
DATASET, DATASET_VERSION = "mdrive-sumo", "v1"
FRAME_TICKS = TICKS_PER_SECOND // 10
"""Ticks from one frame to the next: 10 frames a second, as the sources of ScenarioNet have."""
TYPE_BY_KIND = {
    Kind.VEHICLE: "VEHICLE",
    Kind.PEDESTRIAN: "PEDESTRIAN",
    Kind.CYCLIST: "CYCLIST",
    Kind.STATIC: "TRAFFIC_OBJECT",
}
STATE_BY_LETTER = {"r": "LANE_STATE_STOP", "u": "LANE_STATE_STOP", "y": "LANE_STATE_CAUTION", "g": "LANE_STATE_GO"}
"""By SUMO's letter in lower case."""
MOVED_M = 1.0
"""[m] An object that covers more counts as moving in summaries, as in MetaDrive."""


def write_scenarionet(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write one description per recording, and the two index files of a data set."""
    summaries: dict[str, Any] = {}
    for recording in recordings:
        description = build_description(recording)
        name = f"sd_{DATASET}_{DATASET_VERSION}_{recording.name}.pkl"
        summaries[name] = description["metadata"]
        _save_pickle(folder / name, description)
    _save_pickle(folder / "dataset_summary.pkl", summaries)
    _save_pickle(folder / "dataset_mapping.pkl", dict.fromkeys(summaries, ""))


def build_description(recording: ScoredRecording) -> dict[str, Any]:
    """Return the scenario description of a recording; the first CAV is the self-driving car."""
    record = recording.record
    ticks = np.arange(0, record.ticks, FRAME_TICKS)
    columns = np.flatnonzero(record.valid[ticks].any(axis=0)).tolist()
    tracks = {record.ids[n]: _build_track(recording, n, ticks) for n in columns}
    lights = _build_lights(recording, ticks)
    features = _build_features(recording.roads)
    return {
        "id": recording.name,
        "version": VERSION,
        "length": len(ticks),
        "metadata": {
            "id": recording.name,
            "scenario_id": recording.scenario.id,
            "dataset": DATASET,
            "metadrive_processed": False,
            "coordinate": "metadrive",
            "ts": ticks * DT,
            "sample_rate": FRAME_TICKS * DT,
            "sdc_id": record.ids[0],
            "tracks_to_predict": {},
            "map": recording.roads.name,
            "seed": recording.result.seed,
            "digest": record.digest,
            "cav_ids": list(record.ego_ids),
            "object_summary": {id_: _summarize_track(id_, track) for id_, track in tracks.items()},
            "number_summary": _count_objects(tracks, lights, features),
        },
        "tracks": tracks,
        "dynamic_map_states": lights,
        "map_features": features,
    }


def _build_track(recording: ScoredRecording, column: int, ticks: Int) -> dict[str, Any]:
    """Return the states of a column; all values are 0 where it is not in the world."""
    record = recording.record
    valid = record.valid[ticks, column]
    x, y, yaw, speed = (
        np.where(valid, values[ticks, column], 0.0) for values in (record.x, record.y, record.yaw, record.speed)
    )
    cos, sin = portable.cos_sin(yaw)
    sizes = (record.length[column], record.width[column], recording.heights[column])
    length, width, height = (np.where(valid, size, 0.0) for size in sizes)
    type_ = TYPE_BY_KIND[Kind(int(record.kind[column]))]
    return {
        "type": type_,
        "state": {
            "position": np.column_stack((x, y, height / 2)),
            "heading": yaw,
            "velocity": np.column_stack((speed * cos, speed * sin)) * valid[:, None],
            "valid": valid,
            "length": length,
            "width": width,
            "height": height,
        },
        "metadata": {
            "type": type_,
            "object_id": record.ids[column],
            "track_length": len(ticks),
            "dataset": DATASET,
            "is_cav": column < record.egos,
            "category": recording.categories[column],
        },
    }


def _build_features(roads: RoadMap) -> dict[str, Any]:
    """Return lanes with their bounds as lines of the road's edge, crossings and stop signs."""
    entries = find_predecessors(roads)
    features: dict[str, Any] = {}
    for lane in roads.driving:
        features[lane.id] = _build_lane(lane, entries[lane.id])
        left, right = compute_bounds(lane)
        for side, line, neighbour in (("left", left, lane.left), ("right", right, lane.right)):
            if not lane.junction and not neighbour:  # inside junctions the bounds of lanes cross the ways of others
                features[f"{lane.id}_{side}"] = {"type": "ROAD_EDGE_BOUNDARY", "polyline": _lift(line)}
    for n, (line, width) in enumerate(roads.crossings):
        strip = shapely.buffer(shapely.LineString(line), width / 2, cap_style="flat")
        corners = shapely.get_coordinates(shapely.get_exterior_ring(strip))[:-1]
        features[f"crossing_{n}"] = {"type": "CROSSWALK", "polygon": _lift(corners)}
    for sign in roads.stop_signs or ():
        position = np.array((*roads.lanes[sign.lane].centre.at(sign.line_pos_m), 0.0))
        features[f"stop_{sign.id}"] = {"type": "STOP_SIGN", "lane": [sign.lane], "position": position}
    return features


def _build_lane(lane: Lane, entries: tuple[str, ...]) -> dict[str, Any]:
    half = np.full((len(lane.centre.xy), 2), lane.width / 2)
    return {
        "type": "LANE_SURFACE_UNSTRUCTURE" if lane.junction else "LANE_SURFACE_STREET",
        "polyline": _lift(lane.centre.xy),
        "polygon": _lift(compute_outline(lane)),
        "width": half,
        "speed_limit_kmh": lane.speed_limit * 3.6,
        "entry_lanes": list(entries),
        "exit_lanes": list(lane.successors),
        "left_neighbor": [lane.left] if lane.left else [],
        "right_neighbor": [lane.right] if lane.right else [],
    }


def _build_lights(recording: ScoredRecording, ticks: Int) -> dict[str, Any]:
    """Return the lights by the id of their lane; of several ways out of a lane the first counts."""
    lights: dict[str, Any] = {}
    for signal in list_lane_signals(recording.record, recording.roads):
        if signal.lane in lights:
            continue
        states = [STATE_BY_LETTER.get(signal.states[tick].lower(), "LANE_STATE_UNKNOWN") for tick in ticks.tolist()]
        lights[signal.lane] = {
            "type": "TRAFFIC_LIGHT",
            "state": {"object_state": states},
            "lane": signal.lane,
            "stop_point": np.array((*recording.roads.lanes[signal.lane].centre.xy[-1], 0.0)),
            "metadata": {"type": "TRAFFIC_LIGHT", "object_id": signal.lane, "track_length": len(ticks)},
        }
    return lights


def _summarize_track(id_: str, track: Mapping[str, Any]) -> dict[str, Any]:
    valid = track["state"]["valid"]
    first = int(np.argmax(valid))
    gap = np.flatnonzero(~valid[first:])
    return {
        "type": track["type"],
        "object_id": id_,
        "track_length": len(valid),
        "moving_distance": _measure_distance(track),
        "valid_length": int(valid.sum()),
        "continuous_valid_length": int(gap[0]) if len(gap) else len(valid) - first,
    }


def _measure_distance(track: Mapping[str, Any]) -> float:
    steps = np.diff(track["state"]["position"][track["state"]["valid"], :2], axis=0)
    return float(portable.hypot(steps[:, 0], steps[:, 1]).sum()) if len(steps) else 0.0


def _count_objects(
    tracks: Mapping[str, Mapping[str, Any]], lights: Mapping[str, Any], features: Mapping[str, Any]
) -> dict[str, Any]:
    types = Counter(track["type"] for track in tracks.values())
    shown = Counter(state for light in lights.values() for state in light["state"]["object_state"])
    moving = Counter(track["type"] for track in tracks.values() if _measure_distance(track) > MOVED_M)
    return {
        "num_objects": len(tracks),
        "object_types": set(types),
        "num_objects_each_type": dict(types),
        "num_moving_objects": moving.total(),
        "num_moving_objects_each_type": dict(moving),
        "num_traffic_lights": len(lights),
        "num_traffic_light_types": set(shown),
        "num_traffic_light_each_step": dict(shown),
        "num_map_features": len(features),
        "map_height_diff": 0.0,
    }


def _lift(points: Float) -> Float:
    """Return points (N, 2) at height 0, (N, 3)."""
    return np.column_stack((points, np.zeros(len(points))))


def _save_pickle(path: Path, contents: Any) -> None:
    with new_file(path) as file:
        pickle.dump(contents, file, protocol=4)
