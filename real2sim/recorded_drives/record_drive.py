"""Record one drive: dense reactive traffic in SUMO, observed by CAVs and stations with noise.

The real V2XPnP logs cannot be shipped, and these are no copies of them: places, people and drives are invented; format,
noise (`writers.observation_noise`) and traffic density are alike.
"""

import math
import random
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
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit, Scenario
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.v2x.comm_settings import PRESETS
from mdrive_sumo.worlds.lane_routes import LaneRoute, find_lane_routes, locate_junction
from mdrive_sumo.worlds.placement.cavs import SpawnPoint, build_spawned_cav
from mdrive_sumo.worlds.placement.lane_chains import build_route_line
from mdrive_sumo.worlds.streams.near_traffic import TrafficRequest, build_near_traffic
from real2sim.recorded_drives.recording_site import RecordingSite
from real2sim.recorded_drives.scripted_people import build_people
from real2sim.writers.episode_recording import record_episode
from real2sim.writers.observation_noise import ObservationNoise
from real2sim.writers.v2xpnp import write_v2xpnp

BUCKET, CATEGORY = "V2XPnP", "synthetic"
DRIVER = "single"
"""Agent of the CAVs during the recording."""
WINDOW_S = 9.0
"""[s] Length of a recording."""
WARM_UP_S = 2.0
LATEST_START_S = 46.0
"""[s] The recording begins between `WARM_UP_S` and this time of the drive: signals have cycles of up to 90 s."""
MIN_DISTANCE_M = 12.0
"""[m] Each CAV drives at least this far in a recording."""
LONG_M, LONG_COST = 42.0, 3.0
"""[m], [deg/m] Cost of every metre beyond `LONG_M` in the choice of the window: the paper's routes are short, 45.68 m
on average.
"""

TURNING_SHARE = 0.75
"""Share of CAVs that turn."""
START_M, LEAST_START_M = (10.0, 35.0), 5.0
"""[m] Distance of CAV starts from the junction; least distance of starts and goals from the ends of a route."""
START_MPS = 5.0
MOST_TRIES = 300
APART_M = 14.0
"""[m] From a CAV to any other one at the start."""


@dataclass(frozen=True)
class RecordedDrive:
    """A recorded drive."""

    scenario: Scenario
    roads: RoadMap
    episode: EpisodeRecord


def build_cavs(roads: RoadMap, count: int, rng: random.Random) -> tuple[Ego, ...]:
    """Build CAVs well apart before junctions, on roads of one axis: lights then release them together.

    Raises InputError for a network without room for them.
    """
    ways = {turns: [way for way in find_lane_routes(roads) if _does_turn(way) == turns] for turns in (False, True)}
    found: list[Ego] = []
    for _ in range(MOST_TRIES if all(ways.values()) else 0):
        way = rng.choice(ways[rng.random() < TURNING_SHARE])
        start = max(locate_junction(roads, way)[0] - rng.uniform(*START_M), LEAST_START_M)
        spawn = SpawnPoint(start, build_route_line(roads, way.lanes).last_m - LEAST_START_M)
        ego = build_spawned_cav(roads, str(len(found)), way, spawn, 0.0)
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
    people = build_people(roads, site.people, LATEST_START_S + WINDOW_S, rng)
    request = TrafficRequest(queue=0, others=site.vehicles, is_jammed=True)
    vehicles = build_near_traffic(roads, egos, people, request, rng)
    scenario = Scenario(
        id=name,
        bucket=BUCKET,
        category=CATEGORY,
        network=roads.name,
        signals="program",
        egos=egos,
        background=Background(vehicles=vehicles),
        actors=people,
        rsus=tuple(RoadsideUnit(id=f"post{n}", x=x, y=y) for n, (x, y) in enumerate(site.stations)),
    )
    sizes = {ego.id: (VEHICLE.length, VEHICLE.width) for ego in egos}
    drivers = {ego.id: LocalDriver(AGENTS[DRIVER]({})) for ego in egos}
    with SumoWorld(scenario, roads, sizes, derive_seed(seed, name, "sumo")) as world:
        return RecordedDrive(scenario, roads, run_episode(_build_episode_config(scenario, roads, seed), world, drivers))


def _build_episode_config(scenario: Scenario, roads: RoadMap, seed: int) -> EpisodeConfig:
    """Configure an episode without messages, so that stations need no detections, that ends with the last window."""
    over = round((LATEST_START_S + WINDOW_S) * TICKS_PER_SECOND) + 1
    endings = tuple(Ending(ego.id, over, End.TIMED_OUT) for ego in scenario.egos)
    return EpisodeConfig(scenario, roads, seed, options=EpisodeOptions(comm=PRESETS["off"]), replayed_failures=endings)


def find_window(drive: RecordedDrive) -> tuple[float, float] | None:
    """Return the window [s] in which the CAVs turn most while all of them drive; None if there is none.

    Distance beyond `LONG_M` counts against a window. Differences below a tenth of a degree are ignored; the first
    window wins.
    """
    parts = [(start, start + WINDOW_S) for start in np.arange(WARM_UP_S, LATEST_START_S + 0.5, 1.0).tolist()]
    fit = [part for part in parts if _do_all_cavs_drive(drive.episode, part)]
    return max(fit, key=lambda part: round(_score_window(drive.episode, part), 1)) if fit else None


def _score_window(episode: EpisodeRecord, part: tuple[float, float]) -> float:
    too_long = np.maximum(_measure_distances(episode, part) - LONG_M, 0.0).sum()
    return _measure_heading_change(episode, part) - LONG_COST * float(too_long)


def _select_rows(part: tuple[float, float]) -> slice:
    """Return the ticks of a window at 10 Hz."""
    first, last = (round(s * TICKS_PER_SECOND) for s in part)
    return slice(first, last + 1, TICKS_PER_SECOND // 10)


def _do_all_cavs_drive(episode: EpisodeRecord, part: tuple[float, float]) -> bool:
    rows = _select_rows(part)
    if rows.stop > episode.ticks or not episode.valid[rows, : episode.egos].all():
        return False
    return bool((_measure_distances(episode, part) >= MIN_DISTANCE_M).all())


def _measure_distances(episode: EpisodeRecord, part: tuple[float, float]) -> Float:
    """Return the driven distance [m] of every CAV."""
    x, y = (values[_select_rows(part), : episode.egos] for values in (episode.x, episode.y))
    return np.hypot(np.diff(x, axis=0), np.diff(y, axis=0)).sum(axis=0)


def _measure_heading_change(episode: EpisodeRecord, part: tuple[float, float]) -> float:
    yaw = np.unwrap(episode.yaw[_select_rows(part), : episode.egos], axis=0)
    return float(np.degrees(np.abs(np.diff(yaw, axis=0)).sum()))


def write_log(drive: RecordedDrive, window_s: tuple[float, float], folder: Path, seed: int) -> None:
    """Write FOLDER/<agent>/<frame>.yaml."""
    truth = record_episode(drive.episode, drive.scenario, drive.roads, window_s)
    write_v2xpnp(truth, folder, ObservationNoise(), derive_seed(seed, "noise", drive.scenario.id))
