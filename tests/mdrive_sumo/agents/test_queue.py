"""`single` in a queue that stops and goes at walking pace, with realistic sensing."""

from collections.abc import Collection, Mapping

import numpy as np
import pytest
from testing.agents_driving import BoxWorld, all_arrived, ego, field

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.geometry import build_polyline
from mdrive_sumo.core.state import DT, Actors, EgoState, Kind, WorldState
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.scenario.scenario import Scenario

pytestmark = [pytest.mark.slow, pytest.mark.full]  # in `make test`: test_space_time_planner, the property of the gap

LANE_Y, GAP_M, LENGTH = -1.75, 4.0, 4.9
LEAVES_S = 31.0


class QueueWorld(BoxWorld):
    """A vehicle that stops and goes at walking pace, drawn from a seed, and drives away after `LEAVES_S`."""

    def __init__(self, x: float, seed: int) -> None:
        super().__init__()
        self._x, random, t = x, np.random.default_rng(seed), 0.0
        self._moves: list[tuple[float, float, float]] = []
        while t < LEAVES_S - 6.0:
            begin = t + random.uniform(2.0, 8.0)
            top_speed, t = random.uniform(0.5, 2.5), begin + random.uniform(1.0, 3.0)
            self._moves.append((begin, t, top_speed))

    def _get_speed(self, t: float) -> float:
        for begin, end, top_speed in self._moves:
            if begin <= t < end:
                return min(top_speed, 1.5 * (t - begin), 2.5 * (end - t))
        return min(8.0, 2.0 * max(t - LEAVES_S, 0.0))

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> WorldState:
        self._tick += 1
        speed = self._get_speed(self._tick * DT)
        self._x += speed * DT
        x, y, yaw, speeds = (np.array([value]) for value in (self._x, LANE_Y, 0.0, speed))
        kind, size = np.full(1, Kind.VEHICLE, dtype=np.uint8), (np.array([LENGTH]), np.array([1.8]))
        return WorldState(Actors(("ahead",), kind, x, y, yaw, speeds, *size), {})


def drive_in_queue(seed: int) -> EpisodeRecord:
    """Two CAVs behind the vehicle, bumper to bumper but for `GAP_M`."""
    spacing_m, x = LENGTH + GAP_M, -75.0
    routes = {str(k): np.array([(x - k * spacing_m, LANE_Y), (-25.0, LANE_Y)]) for k in range(2)}
    egos = tuple(ego(name, build_polyline(xy).resample(1.0).xy) for name, xy in routes.items())
    scenario = Scenario(id="field", bucket="Test", category="test", network="field", egos=egos)
    options = EpisodeOptions.parse(sensing="realistic", ids="scenario")
    drivers = {name: LocalDriver(AGENTS["single"]({})) for name in routes}
    return run_episode(
        EpisodeConfig(scenario, field(), seed=seed, options=options), QueueWorld(x + spacing_m, seed), drivers
    )


def find_least_gap(episode: EpisodeRecord, ahead: str, behind: str) -> float:
    """The least distance [m] between two vehicles in the lane."""
    first, second = episode.ids.index(ahead), episode.ids.index(behind)
    both = episode.valid[:, first] & episode.valid[:, second]
    lengths = (episode.length[first] + episode.length[second]) / 2
    return float((episode.x[both, first] - episode.x[both, second] - lengths).min())


@pytest.mark.parametrize("seed", range(3))
def test_nothing_touches_in_a_queue_at_walking_pace(seed: int) -> None:
    """The least gaps were 0.02 (a contact), 0.28 and 0.32 m before decision 040, and are 0.91, 0.30 and 0.94 m now."""
    episode = drive_in_queue(seed)
    assert not episode.contacts
    assert min(find_least_gap(episode, "ahead", "0"), find_least_gap(episode, "0", "1")) > 0.2
    assert all_arrived(episode)
