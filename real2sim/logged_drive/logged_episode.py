"""Record the logged drive of the CAVs of a converted log as an episode, with everything else as in the log."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from mdrive_sumo.core.state import DT, Actors, EgoState, End, Frame, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord, Recorder, quantize_frame
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import criteria
from mdrive_sumo.vehicle import contact, dynamics
from real2sim.fit.background_vehicle import median_size
from real2sim.recording import RecordedTrack
from real2sim.traffic_fidelity.log_simulation import (
    TimedActors,
    TimedPath,
    build_scripted_actors,
    build_still_actors,
    build_track_path,
    place_egos,
)

LOG_ENDED = "log ended"
"""The end of a CAV whose log ends before a criterion ends it."""


@dataclass(frozen=True)
class LoggedEpisode:
    """The logged drives of all CAVs of a scenario, in the form in which scoring reads an episode."""

    record: EpisodeRecord
    """A CAV whose log ends before a criterion ends it is recorded as arrived in its last frame."""
    progress: Mapping[str, criteria.RouteProgress]
    """How far each CAV came, by its id, at its end."""
    end_by_cav: Mapping[str, str]
    """The value of `End` of the criterion that ended the CAV, or `LOG_ENDED`."""


@dataclass(frozen=True)
class _LoggedWorld:
    """Timed poses of everything in the log."""

    cavs: Mapping[str, TimedPath]
    background: TimedActors
    scripted: TimedActors

    def place_egos(self, time: float) -> dict[str, EgoState]:
        """Return the CAVs that are present at `time` [s]."""
        return place_egos(self.cavs, time)

    def place_others(self, tick: int) -> Actors:
        """Return all other road users and obstacles in a tick."""
        return self.background.at(tick).merge(self.scripted.at(tick))


@dataclass
class _CavStates:
    """Progress and ending of every CAV while its drive is recorded."""

    references: Mapping[str, criteria.RouteReference]
    limit_ticks: Mapping[str, int]
    progress: dict[str, criteria.RouteProgress]
    endings: dict[str, Ending] = field(default_factory=dict[str, Ending])
    end_by_cav: dict[str, str] = field(default_factory=dict[str, str])


def record_logged_drive(
    scenario: Scenario, roads: RoadMap, tracks: Mapping[str, RecordedTrack], dt_s: float
) -> LoggedEpisode:
    """Record the drive of every CAV of the scenario along its logged poses; `tracks`: by id in the scenario.

    Contacts, criteria and the recorder are those of a live episode. CAVs have their size in the log.
    """
    world = _build_logged_world(scenario, tracks, dt_s)
    vehicles = {ego.id: _with_logged_size(tracks[ego.id]) for ego in scenario.egos}
    walls = contact.build_walls(building.outline for building in roads.buildings)
    recorder = Recorder(scenario.id, {}, {name: (vehicle.length, vehicle.width) for name, vehicle in vehicles.items()})
    states = _CavStates(
        {ego.id: criteria.build_route_reference(ego) for ego in scenario.egos},
        criteria.compute_time_limit_ticks(scenario),
        {ego.id: criteria.RouteProgress() for ego in scenario.egos},
    )
    before = Frame(0, world.place_egos(0.0), world.place_others(0), {})
    tick = 0
    while True:
        egos, others = world.place_egos(tick * DT), world.place_others(tick)
        egos = {name: state for name, state in egos.items() if name not in states.endings}
        _, contacts = contact.resolve_contacts(
            _to_vehicle_states({name: before.egos.get(name, state) for name, state in egos.items()}),
            _to_vehicle_states(egos),
            vehicles,
            contact.build_obstacle_motion(before.actors, others),
            walls,
        )
        frame = quantize_frame(Frame(tick, egos, others, {}, contacts))
        _judge(world, frame, states)
        recorder.add(frame, {}, {}, {})
        if len(states.endings) == len(scenario.egos):
            break
        before, tick = frame, tick + 1
    endings = [states.endings[ego.id] for ego in scenario.egos]
    return LoggedEpisode(recorder.finish(endings), states.progress, states.end_by_cav)


def record_log(
    scenario: Scenario, tracks: Mapping[str, RecordedTrack], dt_s: float, about: Mapping[str, Any]
) -> EpisodeRecord:
    """Record everything in the log until the tracks of all CAVs end, for open loop; nothing is judged.

    `tracks`: by id in the scenario. `about`: scalars that identify the log. CAVs have their size in the log.
    """
    world = _build_logged_world(scenario, tracks, dt_s)
    sizes = {ego.id: median_size(tracks[ego.id]) for ego in scenario.egos}
    recorder = Recorder(scenario.id, about, sizes)
    last_ticks: dict[str, int] = {}
    for tick in range(max(int(path.times[-1] / DT) for path in world.cavs.values()) + 2):
        egos = world.place_egos(tick * DT)
        if not egos:
            break
        recorder.add(quantize_frame(Frame(tick, egos, world.place_others(tick), {})), {}, {}, {})
        last_ticks |= dict.fromkeys(egos, tick)
    return recorder.finish([Ending(ego.id, last_ticks[ego.id], End.ARRIVED) for ego in scenario.egos])


def _build_logged_world(scenario: Scenario, tracks: Mapping[str, RecordedTrack], dt_s: float) -> _LoggedWorld:
    cavs = {ego.id: build_track_path(tracks[ego.id], dt_s) for ego in scenario.egos}
    ticks = max(int(path.times[-1] / DT) for path in cavs.values()) + 3  # one more than a CAV is there
    vehicles = sorted(scenario.background.vehicles, key=lambda vehicle: vehicle.id)
    background = build_still_actors(
        [vehicle.id for vehicle in vehicles],
        [Kind.VEHICLE] * len(vehicles),
        [(vehicle.length, vehicle.width) for vehicle in vehicles],
    )
    paths = [build_track_path(tracks[vehicle.id], dt_s) for vehicle in vehicles]
    return _LoggedWorld(cavs, TimedActors.from_paths(background, paths, ticks), build_scripted_actors(scenario, ticks))


def _with_logged_size(track: RecordedTrack) -> dynamics.VehicleParameters:
    length, width = median_size(track)
    return replace(dynamics.MKZ_2017, length=length, width=width)


def _to_vehicle_states(egos: Mapping[str, EgoState]) -> dict[str, dynamics.VehicleState]:
    return {name: dynamics.initial_state(ego.x, ego.y, ego.yaw, ego.speed) for name, ego in egos.items()}


def _judge(world: _LoggedWorld, frame: Frame, states: _CavStates) -> None:
    """Update the progress of every CAV, and end those that a criterion or the log ends in this frame."""
    for name, state in frame.egos.items():
        states.progress[name] = criteria.update_progress(
            states.progress[name], states.references[name], frame.tick, state.x, state.y, state.speed
        )
        end = criteria.find_end(states.progress[name], frame.tick, states.limit_ticks[name])
        if end is not None or world.cavs[name].at((frame.tick + 1) * DT) is None:
            states.endings[name] = Ending(name, frame.tick, end or End.ARRIVED)
            states.end_by_cav[name] = LOG_ENDED if end is None else str(end)
