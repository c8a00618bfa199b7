"""Recordings of a converted log that was shifted, in the frame of the log again."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scoring import ScenarioResult

QUANTA_PER_M = 1000
"""Positions of a recording are whole millimetres, and origins whole metres, so nothing is rounded."""


def restore_log_frames(recordings: Iterable[ScoredRecording]) -> Iterator[ScoredRecording]:
    """Yield the recordings with all coordinates in the frame of their log; the same where none was shifted."""
    return map(restore_log_frame, recordings)


def restore_log_frame(recording: ScoredRecording) -> ScoredRecording:
    """Return the recording with road users, lanes, routes and infractions in the frame of the log."""
    origin = np.array(recording.roads.log_origin)
    if not origin.any():
        return recording
    egos = tuple(_shift_ego(ego, origin) for ego in recording.scenario.egos)
    return replace(
        recording,
        record=_shift_record(recording.record, origin),
        scenario=recording.scenario.model_copy(update={"egos": egos}),
        roads=_shift_roads(recording.roads, origin),
        result=_shift_result(recording.result, origin),
    )


def _shift_record(record: EpisodeRecord, origin: Float) -> EpisodeRecord:
    quanta = record.quanta.astype(np.int64)
    quanta[record.valid] += np.append(np.rint(origin * QUANTA_PER_M), (0, 0)).astype(np.int64)
    return replace(record, quanta=quanta)


def _shift_ego(ego: Ego, origin: Float) -> Ego:
    x, y = origin.tolist()
    start = ego.start.model_copy(update={"x": ego.start.x + x, "y": ego.start.y + y})
    route = tuple((px + x, py + y, yaw) for px, py, yaw in ego.route)
    return ego.model_copy(update={"start": start, "route": route})


def _shift_roads(roads: RoadMap, origin: Float) -> RoadMap:
    return replace(
        roads,
        lanes={id_: replace(lane, centre=Polyline(lane.centre.xy + origin)) for id_, lane in roads.lanes.items()},
        junctions=tuple(outline + origin for outline in roads.junctions),
        pavements=tuple(outline + origin for outline in roads.pavements),
        crossings=tuple((line + origin, width) for line, width in roads.crossings),
        log_origin=(0.0, 0.0),
    )


def _shift_result(result: ScenarioResult, origin: Float) -> ScenarioResult:
    x, y = origin.tolist()
    egos = tuple(
        ego.model_copy(
            update={
                "infractions": tuple(
                    infraction.model_copy(update={"x": infraction.x + x, "y": infraction.y + y})
                    for infraction in ego.infractions
                )
            }
        )
        for ego in result.egos
    )
    return result.model_copy(update={"egos": egos})
