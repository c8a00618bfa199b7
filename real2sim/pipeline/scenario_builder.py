"""Builds a scenario from a log: cleaning, network of its map, reconstruction, reactive traffic, measurement."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.background import BackgroundMode
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario, describe_first_error
from real2sim.clean import CleanedRecording, clean_recording
from real2sim.conversion_findings import ConversionFindings
from real2sim.fit import FittedTraffic, fit_traffic
from real2sim.fit.cav_selection import describe_unused_cavs, select_cav_tracks
from real2sim.hd_map import HdMap
from real2sim.logged_drive import record_log, score_logged_drive
from real2sim.match import LaneMatch, match_track
from real2sim.network import NetworkReport, build_network
from real2sim.network.drivable_areas import add_observed_areas
from real2sim.pipeline.conversion_options import NETWORKS, ConversionOptions
from real2sim.pipeline.departures import begin_at, fit_departures
from real2sim.quality import ReconstructedLog, ReconstructionQuality, assess_reconstruction
from real2sim.quality.lane_segment_index import LaneSegmentIndex
from real2sim.readers.map_fit import check_on_map
from real2sim.recording import ObserverView, RecordedTrack, Recording, vehicle_trajectories
from real2sim.source_scene import SourceScene
from real2sim.tracks.reconstruct import reconstruct_tracks
from real2sim.traffic_fidelity import TrafficFidelity, measure_stalled_traffic, measure_traffic_fidelity

LOG = "log"
"""What drove the CAVs of a recorded log, in place of an agent."""


@dataclass(frozen=True)
class BuiltScenario:
    """A scenario with the findings of its conversion."""

    scenario: Scenario
    findings: ConversionFindings
    log: EpisodeRecord
    """The log itself as a recording, for open loop."""


def build_scenario(
    scene: SourceScene, suite: Path, wish: ConversionOptions, network: NetworkReport | None = None
) -> BuiltScenario:
    """Build the scenario on SUITE/networks/<scene id>, which is built first unless `network` is given; raises
    InputError.

    Runs SUMO in this process to measure how close the traffic stays to the log.
    """
    recording = scene.recording
    if recording is None:
        raise InputError(f"{scene.id}: expected a log, found an authored scene")
    cleaned = _clean(recording)
    network = network or _build_network(recording, cleaned, suite / NETWORKS / scene.id, scene.id)
    roads = load_road_map(network.folder)
    tracks = cleaned.tracks if recording.exact else reconstruct_tracks(cleaned.tracks, recording.dt_s)
    matches = {id_: match_track(motion, roads) for id_, motion in vehicle_trajectories(tracks).items()}
    cavs = select_cav_tracks(wish.cavs, cleaned, tracks, matches)
    fitter = _TrafficFitter(scene, recording, network.name, roads, tracks, matches, cavs, wish.mode)
    fitted, closeness, waited = fit_departures(fitter.fit, fitter.measure, recording.dt_s)
    notes = (*describe_unused_cavs(wish.cavs, cavs, cleaned, tracks, matches), *waited)
    scenario = fitter.assemble(fitted, notes)
    names, dt_s = fitted.names, recording.dt_s
    findings = ConversionFindings(
        id=scene.id,
        recording=recording,
        cleaned=cleaned,
        tracks=tracks,
        quality=assess_tracks(recording, cleaned, tracks, roads, find_speed_limits(recording.map, network, matches)),
        network=network,
        roads=roads,
        matches=matches,
        roles=fitted.roles,
        names=names,
        closeness=closeness,
        stalled=measure_stalled_traffic(make_reactive(scenario), roads, tracks, names, dt_s),
        logged_drive=score_logged_drive(scenario, roads, tracks, names, dt_s, wish.confirmed),
        notes=notes,
        mode=fitted.background.mode,
        window_s=wish.window_s,
    )
    about = {"agent": LOG, "source": recording.source, "log": recording.id}
    return BuiltScenario(
        scenario, findings, record_log(scenario, {names[track.id]: track for track in tracks}, dt_s, about)
    )


def _clean(recording: Recording) -> CleanedRecording:
    """Return the cleaned log. Raises InputError if it lies off its map, or nothing is left of it."""
    check_on_map(recording)
    cleaned = clean_recording(recording)
    if not cleaned.tracks:
        raise InputError(f"expected tracks of at least half a second, found none in {recording.frame_count} frames")
    return cleaned


def _build_network(recording: Recording, cleaned: CleanedRecording, folder: Path, name: str) -> NetworkReport:
    """Build the network of the map; the motion of the log tells directions and speeds that the map lacks."""
    hd_map = add_observed_areas(recording.map, cleaned.tracks)
    motions = list(vehicle_trajectories(cleaned.tracks).values())
    return build_network(hd_map, motions, folder, name, recording.dt_s, recording.origin)


@dataclass(frozen=True)
class _TrafficFitter:
    """Fits, assembles and measures the scenario of one log, as often as departures need it."""

    scene: SourceScene
    recording: Recording
    network: str
    roads: RoadMap
    tracks: tuple[RecordedTrack, ...]
    matches: Mapping[str, LaneMatch]
    cavs: tuple[str, ...]
    mode: BackgroundMode

    def fit(self, departures: Mapping[str, int]) -> FittedTraffic:
        """Fit the traffic. `departures`: frame from which a vehicle is driven, by track id."""
        driven = tuple(
            begin_at(track, departures[track.id]) if track.id in departures else track for track in self.tracks
        )
        motions = vehicle_trajectories(driven)
        matches = {**self.matches, **{id_: match_track(motions[id_], self.roads) for id_ in departures}}
        with _report_invalid():
            return fit_traffic(driven, matches, self.roads, self.cavs, self.mode, self.recording.dt_s)

    def assemble(self, fitted: FittedTraffic, notes: tuple[str, ...] = ()) -> Scenario:
        """Return the scenario, checked."""
        scene = self.scene
        with _report_invalid():
            scenario = Scenario(
                id=scene.id,
                bucket=scene.bucket,
                category=scene.category,
                network=self.network,
                description=scene.description,
                egos=fitted.egos,
                background=fitted.background,
                actors=(*fitted.actors, *scene.actors),
                weather=scene.weather,
                rsus=_build_roadside_units(self.recording.views),
                notes=(*scene.notes, *notes),
            )
        check_scenario(scenario, self.roads)
        return scenario

    def measure(self, fitted: FittedTraffic) -> TrafficFidelity:
        """Measure how close the traffic stays to the log."""
        reactive = make_reactive(self.assemble(fitted))
        return measure_traffic_fidelity(reactive, self.roads, self.tracks, fitted.names, self.recording.dt_s)


@contextmanager
def _report_invalid() -> Generator[None]:
    """Raise InputError for the first value that a model refuses."""
    try:
        yield
    except ValidationError as error:
        raise InputError(describe_first_error(error)) from None


def _build_roadside_units(views: Sequence[ObserverView]) -> tuple[RoadsideUnit, ...]:
    """Return the observers that are infrastructure, at the position of their sensor."""
    units: list[RoadsideUnit] = []
    for view in views:
        if view.is_infrastructure and np.isfinite(view.pose[:, :2]).all(1).any():
            x, y = np.nanmedian(view.pose[:, :2], axis=0).round(3).tolist()
            units.append(RoadsideUnit(id=f"rsu{view.observer.lstrip('-')}", x=x, y=y))
    return tuple(units)


def assess_tracks(
    recording: Recording,
    cleaned: CleanedRecording,
    tracks: tuple[RecordedTrack, ...],
    roads: RoadMap,
    limits: Mapping[str, float],
) -> ReconstructionQuality:
    """Return the quality of reconstructed tracks. `limits`: see `find_speed_limits`."""
    lanes = LaneSegmentIndex.from_centre_lines(
        [lane.centre.xy for lane in roads.driving], [True] * len(roads.driving), roads.lane_width.tolist()
    )
    raw = {track.id: track for track in cleaned.tracks}
    return assess_reconstruction(
        ReconstructedLog(recording.id, recording.dt_s, tracks, raw, lanes, cleaned.report.drop_reason_by_track, limits)
    )


def find_speed_limits(map_: HdMap, network: NetworkReport, matches: Mapping[str, LaneMatch]) -> dict[str, float]:
    """Return the highest speed limit [m/s] that the map gives on the lanes of a vehicle, by track id."""
    limits: dict[str, float] = {}
    for id_, match in matches.items():
        sources = {network.source_by_lane[lane] for lane in match.lanes if lane in network.source_by_lane}
        stated = [map_.lanes[source].speed_limit for source in sources if source in map_.lanes]
        if any(limit > 0 for limit in stated):
            limits[id_] = max(limit for limit in stated if limit > 0)
    return limits


def make_reactive(scenario: Scenario) -> Scenario:
    """Return the scenario with reactive traffic whatever the mode: replayed poses are always close to the log."""
    background = scenario.background.model_copy(update={"mode": "reactive"})
    return scenario.model_copy(update={"background": background})
