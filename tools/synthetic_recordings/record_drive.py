"""Record one drive: dense reactive traffic in SUMO, observed by CAVs and stations with noise.

The real V2XPnP logs cannot be shipped, and these are no copies of them: places, people and drives are invented; format,
noise (`writers.observation_noise`) and traffic density are alike.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.state import TICKS_PER_SECOND, End
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.v2x.comm_settings import PRESETS
from real2sim.writers.episode_recording import record_episode
from real2sim.writers.observation_noise import ObservationNoise
from real2sim.writers.v2xpnp import write_v2xpnp
from tools.synthetic_recordings.scripted_people import PopulationCounts, build_people
from tools.synthetic_recordings.traffic import build_cavs, build_traffic

BUCKET, CATEGORY = "V2XPnP", "synthetic"
DRIVER = "single"
"""Agent of the CAVs during the recording."""
WINDOW_S = 9.0
"""[s] Length of a recording."""
WARM_UP_S = 2.0
LATEST_START_S = 24.0
"""[s] The recording begins between `WARM_UP_S` and this time of the drive."""
MIN_DISTANCE_M = 12.0
"""[m] Each CAV drives at least this far in a recording."""
LONG_M, LONG_COST = 42.0, 3.0
"""[m], [deg/m] Cost of every metre beyond `LONG_M` in the choice of the window: the paper's routes are short, 45.68 m
on average.
"""


@dataclass(frozen=True)
class RecordingSite:
    """A map with its stations and traffic density."""

    network: str
    stations: tuple[tuple[float, float], ...]
    """x, y [m]"""
    vehicles: int
    people: PopulationCounts


RECORDING_SITES = {
    "crossing": RecordingSite("city_crossing", ((16.0, 17.0), (-16.0, -17.0)), 20, PopulationCounts(20, 5, 7, 5, 25)),
    "corridor": RecordingSite("city_corridor", ((-40.0, -1.0), (40.0, 2.0)), 20, PopulationCounts(23, 5, 7, 6, 28)),
}


@dataclass(frozen=True)
class RecordedDrive:
    """A recorded drive."""

    scenario: Scenario
    roads: RoadMap
    episode: EpisodeRecord


def record_drive(place: str, number: int, count: int, seed: int) -> RecordedDrive:
    """Record a drive of `count` CAVs in dense traffic at one of `RECORDING_SITES`."""
    where = RECORDING_SITES[place]
    roads = load_road_map(find_network_folder(where.network))
    name = f"{place}_{number:03d}"
    rng = np.random.default_rng(derive_seed(seed, "synthetic", name))
    egos = build_cavs(roads, count, rng)
    until_s = LATEST_START_S + WINDOW_S
    scenario = Scenario(
        id=name,
        bucket=BUCKET,
        category=CATEGORY,
        network=where.network,
        signals="program",
        egos=egos,
        background=Background(vehicles=build_traffic(roads, egos, where.vehicles, until_s, rng)),
        actors=build_people(roads, where.people, until_s, rng),
        rsus=tuple(RoadsideUnit(id=f"post{n}", x=x, y=y) for n, (x, y) in enumerate(where.stations)),
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
