"""Record one drive: dense reactive traffic in SUMO, observed by CAVs and stations with noise.

The real V2XPnP logs cannot be shipped, and these are no copies of them: places, people and drives are invented; format,
noise (`writers.observation_noise`) and traffic density are alike.
"""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.state import TICKS_PER_SECOND, End
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.study.occlusion_certificate import REFERENCE_OPTIONS
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.worlds.lane_routes import LaneRoute, find_lane_routes, locate_junction
from mdrive_sumo.worlds.placement.cavs import SpawnPoint, build_spawned_cav
from mdrive_sumo.worlds.placement.lane_chains import build_route_line
from mdrive_sumo.worlds.placement.occupancy import select_free_actors
from mdrive_sumo.worlds.traffic import draw_traffic
from real2sim.recorded_drives.hidden_users import RouteCrossing, draw_crossings, place_second_unit, time_crossing
from real2sim.recorded_drives.recording_site import RecordingSite, build_demand
from real2sim.writers.episode_recording import record_episode
from real2sim.writers.observation_noise import ObservationNoise
from real2sim.writers.v2xpnp import write_v2xpnp

BUCKET, CATEGORY = "V2XPnP", "synthetic"
DRIVER = "omniscient"
"""Agent of the CAVs during the recording: it handles what comes out in front of it, so the log is clean."""
BEGIN_S = 1.0
"""[s] The recording begins: the CAVs, which start at `START_MPS`, are nearly at speed, and queues have set off."""
LAST_S = 0.2
"""[s] Before the recording begins, from which a CAV's speed then is taken."""
SHORTEST_S, LONGEST_S = 7.0, 18.0
"""[s] Of a recording."""
MEAN_DISTANCE_M = 48.0
"""[m] It ends when the CAVs have driven so far on average, and have passed what crosses their way. With 45 m routes are
37.8 m long on average, because some recordings end before; the paper has 45.68 m."""
MIN_DISTANCE_M = 20.0
"""[m] Each CAV drives at least this far: shorter routes are extended along the lane (`fit.cavs.MIN_ROUTE_M`)."""
PASSED_M = 6.0
"""[m] Beyond the way of who crosses: the CAV's length and a metre."""
TURNING_SHARE = 0.9
"""Share of CAVs that turn where there is a junction: with 0.75 they turn by 42 deg on average, paper 60.92."""
START_M, LEAST_START_M = (6.0, 36.0), 5.0
"""[m] Distance of CAV starts from the junction; least distance of starts and goals from the ends of a route."""
START_MPS = 5.0
"""Of CAVs: below the blind driver's 8 m/s, so that all speed up."""
MOST_TRIES = 300
"""Draws of CAVs that are apart before a place is given up; chosen."""
APART_M = 14.0
"""[m] From a CAV to any other one at the start."""


@dataclass(frozen=True)
class RecordedDrive:
    """A recorded drive."""

    scenario: Scenario
    roads: RoadMap
    episode: EpisodeRecord
    crossed_m: tuple[float, ...]
    """Distance [m] from the start of each CAV to who crosses its route; 0 if there is none."""


def build_cavs(roads: RoadMap, count: int, rng: random.Random) -> tuple[Ego, ...]:
    """Build CAVs well apart before junctions, on roads of one axis: lights then release them together, and each sees
    what the other one cannot.

    Raises InputError for a network without room for them.
    """
    ways = find_lane_routes(roads)
    turning, straight = ([way for way in ways if _does_turn(way) == turns] for turns in (True, False))
    found: list[Ego] = []
    for _ in range(MOST_TRIES):
        kind = turning if rng.random() < TURNING_SHARE else straight
        way = rng.choice(kind or turning or straight)
        line_m = build_route_line(roads, way.lanes).last_m
        start = max(locate_junction(roads, way)[0] - rng.uniform(*START_M), LEAST_START_M)
        if line_m - LEAST_START_M < start + MEAN_DISTANCE_M:
            continue
        ego = build_spawned_cav(roads, str(len(found)), way, SpawnPoint(start, line_m - LEAST_START_M), 0.0)
        if all(_is_apart(ego, other) and _share_axis(ego, other) for other in found):
            found.append(ego.model_copy(update={"start_speed": START_MPS}))
        if len(found) == count:
            return tuple(found)
    raise InputError(f"network {roads.name}: expected room for {count} CAVs before a junction, found none")


def _does_turn(way: LaneRoute) -> bool:
    return way.turn in ("left", "right")


def _is_apart(one: Ego, other: Ego) -> bool:
    return portable.hypot(one.start.x - other.start.x, one.start.y - other.start.y) > APART_M


def _share_axis(one: Ego, other: Ego) -> bool:
    return abs(portable.cos(one.start.yaw - other.start.yaw)) > portable.cos(math.pi / 4)


def record_drive(site: RecordingSite, name: str, count: int, seed: int) -> RecordedDrive:
    """Record a drive of `count` CAVs in dense traffic at a site. Raises InputError if there is no room for them."""
    roads = load_road_map(site.network)
    rng = random.Random(derive_seed(seed, "synthetic", name))
    egos = build_cavs(roads, count, rng)
    crossings = tuple(draw_crossings(roads, egos, START_MPS, rng))
    if not crossings:
        raise InputError(f"network {roads.name}: expected room for a road user that crosses before a CAV, found none")
    users = select_free_actors(roads, egos, [actor for _, crossing in crossings for actor in crossing.actors])
    traffic = draw_traffic(roads, egos, users, build_demand(site.demand), rng)
    posts = {ego.id: crossing.unit for ego, crossing in crossings}
    units = list(posts.values())
    if len(units) == 1:
        units.append(place_second_unit(roads, *crossings[0]))
    scenario = Scenario(
        id=name,
        bucket=BUCKET,
        category=CATEGORY,
        network=roads.name,
        signals="program",
        egos=egos,
        background=Background(vehicles=traffic.vehicles),
        actors=traffic.actors,
        rsus=tuple(units),
    )
    scenario = _time_crossings(scenario, roads, seed, crossings)
    stations: dict[str, float] = {}
    for ego, crossing in crossings:
        stations[ego.id] = max(stations.get(ego.id, 0.0), crossing.station)
    crossed_m = tuple(stations.get(ego.id, 0.0) for ego in egos)
    return RecordedDrive(scenario, roads, _drive(scenario, roads, seed, BEGIN_S + LONGEST_S), crossed_m)


def _time_crossings(
    scenario: Scenario, roads: RoadMap, seed: int, crossings: Sequence[tuple[Ego, RouteCrossing]]
) -> Scenario:
    """Return the scenario in which those who cross meet blind driving that begins with the recording.

    Until then no road user crosses, so a drive that ends there says where the CAVs are.
    """
    begun = _drive(scenario, roads, seed, BEGIN_S)
    driven, last = (_measure_distances(begun, part) for part in ((0.0, BEGIN_S), (BEGIN_S - LAST_S, BEGIN_S)))
    starts = {ego.id: (BEGIN_S, float(driven[i]), float(last[i]) / LAST_S) for i, ego in enumerate(scenario.egos)}
    timed = {user.id: user for user in (time_crossing(ego, one, starts[ego.id]) for ego, one in crossings)}
    return scenario.model_copy(update={"actors": tuple(timed.get(actor.id, actor) for actor in scenario.actors)})


def _drive(scenario: Scenario, roads: RoadMap, seed: int, until_s: float) -> EpisodeRecord:
    """Return the episode until a time [s]; stations are not needed, the driver knows all."""
    alone = scenario.model_copy(update={"rsus": ()})
    over = round(until_s * TICKS_PER_SECOND) + 1
    endings = tuple(Ending(ego.id, over, End.TIMED_OUT) for ego in scenario.egos)
    sizes = {ego.id: (VEHICLE.length, VEHICLE.width) for ego in scenario.egos}
    drivers = {ego.id: LocalDriver(AGENTS[DRIVER]({})) for ego in scenario.egos}
    config = EpisodeConfig(alone, roads, seed, options=REFERENCE_OPTIONS, replayed_failures=endings)
    with SumoWorld(alone, roads, sizes, derive_seed(seed, scenario.id, "sumo")) as world:
        return run_episode(config, world, drivers)


def find_window(drive: RecordedDrive) -> tuple[float, float] | None:
    """Return the window [s] of the drive that is recorded; None if a CAV hardly drives or leaves.

    It ends as soon as the CAVs have driven `MEAN_DISTANCE_M` on average and passed those who cross, at the latest after
    `LONGEST_S`.
    """
    begun = _measure_distances(drive.episode, (0.0, BEGIN_S))
    for length in np.arange(SHORTEST_S, LONGEST_S + 0.05, 0.5).tolist():
        part = (BEGIN_S, BEGIN_S + length)
        rows = _select_rows(part)
        if rows.stop > drive.episode.ticks + 1 or not drive.episode.valid[rows, : drive.episode.egos].all():
            return None
        driven = _measure_distances(drive.episode, part)
        has_passed = bool((begun + driven >= np.array(drive.crossed_m) + PASSED_M).all())
        has_driven = driven.mean() >= MEAN_DISTANCE_M or length == LONGEST_S
        if driven.min() >= MIN_DISTANCE_M and has_driven and (has_passed or length == LONGEST_S):
            return part
    return None


def _select_rows(part: tuple[float, float]) -> slice:
    """Return the ticks of a window at 10 Hz."""
    first, last = (round(s * TICKS_PER_SECOND) for s in part)
    return slice(first, last + 1, TICKS_PER_SECOND // 10)


def _measure_distances(episode: EpisodeRecord, part: tuple[float, float]) -> Float:
    """Return the driven distance [m] of every CAV."""
    x, y = (values[_select_rows(part), : episode.egos] for values in (episode.x, episode.y))
    return np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)).sum(axis=0)


def write_log(drive: RecordedDrive, window_s: tuple[float, float], folder: Path, seed: int) -> None:
    """Write FOLDER/<agent>/<frame>.yaml."""
    truth = record_episode(drive.episode, drive.scenario, drive.roads, window_s)
    write_v2xpnp(truth, folder, ObservationNoise(), derive_seed(seed, "noise", drive.scenario.id))
