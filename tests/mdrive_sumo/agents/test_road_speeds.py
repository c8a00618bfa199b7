"""Built-in agents where the limits of the road count: as fast as they allow, smoothly, and able to stop."""

import numpy as np
import pytest
from testing.agents_driving import Box, all_arrived
from testing.road_speeds import LIMIT, centre_line, drive_fast, fast_ego, find_speeds, motorway, slow_zone

from mdrive_sumo.core.state import DT, End

PLANNERS = ("idm", "single", "sharing+negotiation", "omniscient")
SLOW = [pytest.param(agent, marks=pytest.mark.slow) for agent in PLANNERS]
ROAD = centre_line()


@pytest.mark.parametrize("agent", ["constant-speed", *SLOW])
def test_agents_start_at_speed_and_drive_the_limit(agent: str) -> None:
    episode = drive_fast(agent, [fast_ego("0", ROAD[100:351], 27.0)])
    speed = find_speeds(episode)
    assert all_arrived(episode)
    assert speed[:20].min() > 26.4
    assert 0.96 * LIMIT < speed.max() < LIMIT + 1.0
    change = np.diff(speed) / DT
    assert change.min() > -1.5
    assert change.max() < 3.2


@pytest.mark.parametrize("agent", ["constant-speed", *SLOW])
def test_agents_brake_before_a_lower_limit_begins(agent: str) -> None:
    """From 20 to 3 m/s: with 2 m/s2 that takes 98 m, with the 4 m/s2 of `constant-speed` 49 m.

    Those that only follow a path are a step of their plan (0.2 s) late, as before bends.
    """
    begin_m, before, limit = 300, 20.0, 3.0
    car = fast_ego("0", ROAD[100:321], 19.0).model_copy(update={"lanes": ("m_0", "z_0")})
    episode = drive_fast(agent, [car], roads=slow_zone(begin_m, limit, before))
    assert all_arrived(episode)
    here = episode.valid[:, 0]
    x, speed = episode.x[here, 0], episode.speed[here, 0]
    assert speed[x > begin_m].max() < limit + (2.0 if agent in ("constant-speed", "idm") else 0.6)
    assert speed[x > begin_m + 3.0].max() < limit + 0.6
    assert speed[x < begin_m - 110.0].max() > before - 0.5, "it does not brake before it must"
    assert np.diff(speed).min() / DT > -5.5


@pytest.mark.slow
@pytest.mark.parametrize("agent", PLANNERS)
def test_agents_stop_behind_a_standing_car_on_a_road_without_room_to_pass(agent: str) -> None:
    """From 30 m/s in 180 m: 2.5 m/s2 at least."""
    walls = [Box(330.0, y, 0.0) for y in (-2.2, 0.0, 2.2, 4.4)]
    episode = drive_fast(agent, [fast_ego("0", ROAD[150:401], 30.0, limit_s=12.0)], walls)
    assert not episode.contacts
    assert episode.find_ending("0").end is End.TIMED_OUT
    assert find_speeds(episode)[-1] < 0.5
    assert 15.0 < 330.0 - episode.x[:, 0][episode.valid[:, 0]][-1] + 12.0 < 50.0
    assert np.diff(find_speeds(episode)).min() / DT > -7.0


@pytest.mark.slow
@pytest.mark.parametrize("agent", PLANNERS)
def test_agents_follow_a_slower_car_with_a_gap(agent: str) -> None:
    episode = drive_fast(agent, [fast_ego("0", ROAD[100:401], 30.0)], [Box(150.0, 0.0, 0.0, 22.0)])
    assert all_arrived(episode)
    assert not episode.contacts
    here = episode.valid[:, 0]
    gap = (episode.x[:, 1] - episode.x[:, 0])[here] - 4.7
    assert 4.0 < gap.min() < 45.0
    assert 21.0 < np.median(find_speeds(episode)) < 25.0


@pytest.mark.slow
@pytest.mark.parametrize("agent", ["constant-speed", "single", "omniscient"])
def test_agents_keep_their_lane_in_a_motorway_bend(agent: str) -> None:
    """At 33 m/s and 700 m: 1.6 m/s2 across. Traffic in the next lane, as fast as they are, does not slow them down."""
    radius = 700.0
    xy = centre_line(0, radius)[100:301]
    episode = drive_fast(agent, [fast_ego("0", xy, 32.0)], roads=motorway(radius))
    here = episode.valid[:, 0]
    centre = np.hypot(episode.x[here, 0], episode.y[here, 0] - radius)
    assert all_arrived(episode)
    assert np.abs(centre - radius).max() < 0.4
    assert find_speeds(episode).min() > 30.0


@pytest.mark.slow
def test_a_car_in_the_next_lane_does_not_slow_a_car_down() -> None:
    episode = drive_fast(
        "single", [fast_ego("0", ROAD[100:301], 32.0)], [Box(150.0, 3.75, 0.01, 24.0)], sensing="realistic"
    )
    assert all_arrived(episode)
    assert find_speeds(episode).min() > 29.0


def test_options_choose_another_speed() -> None:
    xy = ROAD[100:141]
    slow = drive_fast("constant-speed", [fast_ego("0", xy, 15.0)], config={"speed": 15.0})
    assert find_speeds(slow).max() < 15.5


@pytest.mark.slow
def test_a_share_of_the_limit_makes_a_creeping_car() -> None:
    crept = drive_fast("single", [fast_ego("0", ROAD[100:161], 8.0)], config={"speed_share": 0.25})
    assert all_arrived(crept)
    assert find_speeds(crept)[20:].max() < LIMIT / 4 + 0.7
    assert find_speeds(crept)[20:].min() > LIMIT / 4 - 1.5
