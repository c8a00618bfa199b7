"""Real logs, fitted: what the tests of fit and closeness run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.background import BackgroundMode
from mdrive_sumo.scenario.scenario import Scenario
from real2sim.clean import clean_recording
from real2sim.fit import FittedTraffic, choose_cavs, fit_traffic
from real2sim.match import match_track
from real2sim.network import build_network
from real2sim.recording import RecordedTrack, Recording
from real2sim.tracks.reconstruct import reconstruct_tracks
from testing.real_logs import READ, SHORT_LOGS, read_window

NAMES = (*SHORT_LOGS, "interaction-0", "interaction-60")
"""Logs by name; of the long INTERACTION recording windows of 20 s, by the second in which they begin."""


@dataclass(frozen=True)
class FittedLog:
    fitted: FittedTraffic
    scenario: Scenario
    roads: RoadMap
    tracks: tuple[RecordedTrack, ...]
    dt_s: float


def recording(name: str) -> Recording:
    if not name.startswith("interaction"):
        return READ[name]()
    return read_window(float(name.split("-")[1]))


def fitted_log(name: str, folder: Path, mode: BackgroundMode = "reactive") -> FittedLog:
    """A real log as a scenario on its network in `folder`."""
    source = recording(name)
    cleaned = clean_recording(source)
    poses = {one.id: np.column_stack((one.x, one.y, one.yaw)) for one in cleaned.tracks if vehicle(one)}
    build_network(source.map, list(poses.values()), folder / name, name, source.dt_s)
    roads, tracks = load_road_map(folder / name), reconstruct_tracks(cleaned.tracks, source.dt_s)
    matches = {one.id: match_track(np.column_stack((one.x, one.y, one.yaw)), roads) for one in tracks if vehicle(one)}
    cavs = choose_cavs(tuple(cleaned.cavs.values()), tracks, matches)
    fitted = fit_traffic(tracks, matches, roads, cavs, mode, source.dt_s)
    scenario = Scenario(
        id=name,
        bucket="Test",
        category="test",
        network=name,
        egos=fitted.egos,
        background=fitted.background,
        actors=fitted.actors,
    )
    return FittedLog(fitted, scenario, roads, tracks, source.dt_s)


def vehicle(track: RecordedTrack) -> bool:
    return track.category.kind is Kind.VEHICLE
