"""Builds a scenario from a log: cleaning, network of its map, reconstruction, reactive traffic, measurement."""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.background import BackgroundMode
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Scenario, describe_first_error
from real2sim.clean import CleanedRecording, clean_recording
from real2sim.conversion_findings import ConversionFindings
from real2sim.fit import FittedTraffic, fit_traffic
from real2sim.hd_map import HdMap
from real2sim.logged_drive import ConfirmedInfraction, record_log, score_logged_drive
from real2sim.match import LaneMatch, match_track
from real2sim.network import NetworkReport, build_network
from real2sim.network.drivable_areas import add_observed_areas
from real2sim.pipeline.cav_selection import (
    build_roadside_units,
    check_on_map,
    describe_unused_cavs,
    select_cav_tracks,
    vehicle_trajectories,
)
from real2sim.pipeline.conversion_results import ConversionResults, build_findings, build_quality_file
from real2sim.pipeline.departures import begin_at, fit_departures
from real2sim.pipeline.quality_file import QualityFile
from real2sim.quality import ReconstructedLog, ReconstructionQuality, assess_reconstruction
from real2sim.quality.lane_segment_index import LaneSegmentIndex
from real2sim.recording import RecordedTrack, Recording
from real2sim.source_scene import SourceScene
from real2sim.tracks.reconstruct import reconstruct_tracks
from real2sim.traffic_fidelity import TrafficFidelity, measure_stalled_traffic, measure_traffic_fidelity

NETWORKS = "networks"
LOG = "log"
"""What drove the CAVs of a recorded log, in place of an agent."""


@dataclass(frozen=True)
class ConversionOptions:
    """Options for the traffic of a scenario."""

    mode: BackgroundMode = "reactive"
    cavs: tuple[str, ...] = ()
    """Names of observers or tracks; (): the CAVs of the source, else one is chosen."""
    window_s: tuple[float, float] | None = None
    """The part of the log that the scene covers, for the report."""
    confirmed: tuple[ConfirmedInfraction, ...] = ()
    """Infractions of logged drives that a person has confirmed."""


@dataclass(frozen=True)
class BuiltScenario:
    """A scenario with its figures and its findings for the report."""

    scenario: Scenario
    quality: QualityFile
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
    recording, cleaned = _clean(scene)
    dt_s = recording.dt_s
    if network is None:
        hd_map = add_observed_areas(recording.map, cleaned.tracks)
        seen = list(vehicle_trajectories(cleaned.tracks).values())
        network = build_network(hd_map, seen, suite / NETWORKS / scene.id, scene.id, dt_s, recording.origin)
    roads = load_road_map(network.folder)
    tracks = cleaned.tracks if recording.exact else reconstruct_tracks(cleaned.tracks, dt_s)
    matches = {id_: match_track(motion, roads) for id_, motion in vehicle_trajectories(tracks).items()}
    cavs = select_cav_tracks(wish.cavs, cleaned, tracks, matches)
    unused = describe_unused_cavs(wish.cavs, cavs, cleaned, tracks, matches)
    fitter = _TrafficFitter(scene, recording, network.name, roads, tracks, matches, cavs, wish.mode)
    fitted, closeness, waited = fit_departures(fitter.fit, fitter.measure, dt_s)
    notes = (*unused, *waited)
    scenario = fitter.assemble(fitted, notes)
    reactive = _with_reactive_traffic(scenario)
    steps = ConversionResults(
        id=scene.id,
        recording=recording,
        window_s=wish.window_s,
        cleaned=cleaned,
        tracks=tracks,
        network=network,
        roads=roads,
        matches=matches,
        quality=_assess(recording, cleaned, tracks, roads, find_speed_limits(recording.map, network, matches)),
        fitted=fitted,
        notes=notes,
        closeness=closeness,
        stalled=measure_stalled_traffic(reactive, roads, tracks, fitted.names, dt_s),
        logged_drive=score_logged_drive(scenario, roads, tracks, fitted.names, dt_s, wish.confirmed),
    )
    about = {"agent": LOG, "source": recording.source, "log": recording.id}
    log = record_log(scenario, {fitted.names[track.id]: track for track in tracks}, dt_s, about)
    return BuiltScenario(scenario, build_quality_file(steps), build_findings(steps), log)


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
        driven = tuple(begin_at(one, departures[one.id]) if one.id in departures else one for one in self.tracks)
        motions = vehicle_trajectories(driven)
        matches = {**self.matches, **{id_: match_track(motions[id_], self.roads) for id_ in departures}}
        with _report_invalid():
            return fit_traffic(driven, matches, self.roads, self.cavs, self.mode, self.recording.dt_s)

    def assemble(self, fitted: FittedTraffic, notes: tuple[str, ...] = ()) -> Scenario:
        """Return the scenario, checked."""
        scene = replace(self.scene, notes=(*self.scene.notes, *notes))
        scenario = _assemble_scenario(scene, self.recording, fitted, self.network)
        check_scenario(scenario, self.roads)
        return scenario

    def measure(self, fitted: FittedTraffic) -> TrafficFidelity:
        """Measure how close the traffic stays to the log."""
        reactive = _with_reactive_traffic(self.assemble(fitted))
        return measure_traffic_fidelity(reactive, self.roads, self.tracks, fitted.names, self.recording.dt_s)


def _clean(scene: SourceScene) -> tuple[Recording, CleanedRecording]:
    """Return the log of a scene as read and cleaned. Raises InputError if nothing is left of it."""
    recording = scene.recording
    if recording is None:
        raise InputError(f"{scene.id}: expected a log, found an authored scene")
    check_on_map(recording)
    cleaned = clean_recording(recording)
    if not cleaned.tracks:
        raise InputError(f"expected tracks of at least half a second, found none in {recording.frame_count} frames")
    return recording, cleaned


@contextmanager
def _report_invalid() -> Generator[None]:
    """Raise InputError for the first value that a model refuses."""
    try:
        yield
    except ValidationError as error:
        raise InputError(describe_first_error(error)) from None


def _assess(
    recording: Recording,
    cleaned: CleanedRecording,
    tracks: tuple[RecordedTrack, ...],
    roads: RoadMap,
    limits: Mapping[str, float],
) -> ReconstructionQuality:
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
        known = [
            map_.lanes[one].speed_limit for one in sources if one in map_.lanes and map_.lanes[one].speed_limit > 0
        ]
        if known:
            limits[id_] = max(known)
    return limits


def _with_reactive_traffic(scenario: Scenario) -> Scenario:
    """Return the scenario with reactive traffic whatever the mode: replayed poses are always close to the log."""
    background = scenario.background.model_copy(update={"mode": "reactive"})
    return scenario.model_copy(update={"background": background})


def _assemble_scenario(scene: SourceScene, recording: Recording, fitted: FittedTraffic, network: str) -> Scenario:
    with _report_invalid():
        return Scenario(
            id=scene.id,
            bucket=scene.bucket,
            category=scene.category,
            network=network,
            description=scene.description,
            egos=fitted.egos,
            background=fitted.background,
            actors=(*fitted.actors, *scene.actors),
            weather=scene.weather,
            rsus=build_roadside_units(recording.views),
            notes=scene.notes,
        )
