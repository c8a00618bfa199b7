"""Episodes with agents: order of observation and control, endings, and failures that end one CAV only."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from testing.worlds import EmptyWorld, Says, pedals, straight_ego, straight_road, straight_scenario

from mdrive_sumo.contract import Control, Observation, Plan, Reply, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring.metrics.ego_track import build_ego_track
from mdrive_sumo.scoring.metrics.endings import compute_route_completion
from mdrive_sumo.sensing.sensing_profile import SensingProfile

EXACT = EpisodeOptions(sensing=SensingProfile.PERFECT)
go = pedals(throttle=0.5)
stand = pedals(brake=1.0)


def drive(
    scenario: Scenario, agents: dict[str, Says], replayed: tuple[Ending, ...] = ()
) -> tuple[EpisodeRecord, EmptyWorld]:
    world = EmptyWorld()
    setting = EpisodeConfig(scenario, straight_road(), seed=0, replayed_failures=replayed, options=EXACT)
    return run_episode(setting, world, {ego: LocalDriver(agent) for ego, agent in agents.items()}), world


def test_an_ego_drives_to_its_goal_and_leaves_one_tick_after_completion() -> None:
    agent = Says(lambda seen: go)
    episode, world = drive(straight_scenario(straight_ego("0", length=50)), {"0": agent})
    ending = episode.find_ending("0")
    assert ending.end is End.ARRIVED
    s = episode.x[:, 0] - 10.0
    first = int(np.argmax(s > 0.99 * 50 + 0.5))  # the point at 50 m is passed; 49 of 50 m are 98 %
    assert ending.tick in (first, first + 1, first + 2)
    assert episode.ticks == ending.tick + 1
    assert len(agent.seen) == ending.tick  # not asked in the tick in which it ended
    assert world.placed[-1] == ("0",)


def test_frames_are_seen_before_the_control_of_the_same_tick_acts() -> None:
    agent = Says(lambda seen: go)
    episode, _ = drive(straight_scenario(straight_ego("0", length=30)), {"0": agent})
    assert agent.seen[0].own.speed == 0.0
    assert [seen.tick for seen in agent.seen] == list(range(len(agent.seen)))
    for seen in agent.seen:
        assert seen.own.x == episode.x[seen.tick, 0]
        assert seen.own.speed == episode.speed[seen.tick, 0]


def test_all_agents_reply_to_the_same_frame() -> None:
    agents = {name: Says(lambda seen: go, SensorSpec("objects", range_m=500.0)) for name in ("0", "1")}
    drive(straight_scenario(straight_ego("0", x=50), straight_ego("1", x=10)), agents)
    for mine, other in zip(agents["0"].seen, agents["1"].seen, strict=False):
        assert mine.tick == other.tick
        assert mine.objects is not None
        assert len(mine.objects.ids) == 1
        assert mine.objects.x[0] == other.own.x


@pytest.mark.slow
def test_only_declared_sensors_are_filled_and_range_is_honoured() -> None:
    near = Says(lambda seen: stand, SensorSpec("objects", range_m=37.0))
    far = Says(lambda seen: stand, SensorSpec("objects", range_m=41.0))
    blind = Says(lambda seen: stand)
    egos = [straight_ego("0", x=50), straight_ego("1", x=10), straight_ego("2", x=90)]
    drive(straight_scenario(*egos), {"0": far, "1": near, "2": blind})
    assert far.seen[0].objects is not None
    assert far.seen[0].objects.x.tolist() == [10.0, 90.0]
    assert near.seen[0].objects is not None
    assert len(near.seen[0].objects.ids) == 0
    assert blind.seen[0].objects is None
    assert all(agent.seen[0].privileged is None for agent in (near, far, blind))


@pytest.mark.slow
def test_the_privileged_sensor_tells_states_routes_and_last_ticks_plans() -> None:
    def plan(seen: Observation) -> Reply:
        return Reply(plan=Plan(np.array([(seen.own.x + 1, 0.0), (seen.own.x + 2, 0.0)]), 0.2))

    knows = Says(lambda seen: stand, SensorSpec("privileged"))
    scenario = straight_scenario(straight_ego("0", x=60), straight_ego("1", x=10))
    episode, _ = drive(scenario, {"0": knows, "1": Says(plan)})
    first, second = (seen.privileged for seen in knows.seen[:2])
    assert first is not None
    assert second is not None
    assert first.plans == (None, None)
    row = {episode.restore_name(told): row for row, told in enumerate(second.ego_ids)}
    assert set(row) == {"0", "1"}
    assert second.plans[row["0"]] is None
    theirs = second.plans[row["1"]]
    assert theirs is not None
    assert theirs.points[0, 0] == 11.0
    assert first.routes[row["1"]][-1].tolist() == [60.0, 0.0]


def test_an_unknown_sensor_is_an_input_error_that_names_what_exists() -> None:
    with pytest.raises(InputError, match=r"sensor 'sonar': expected one of objects, .*privileged"):
        drive(straight_scenario(straight_ego("0")), {"0": Says(lambda seen: go, SensorSpec("sonar"))})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("answer", "failure", "text"),
    [
        (lambda seen: 1 / 0, FailureReason.CRASHED, "ZeroDivisionError: division by zero"),
        (lambda seen: None, FailureReason.INVALID, "expected a Reply, found NoneType"),
        (
            lambda seen: pedals(throttle=float("nan")),
            FailureReason.INVALID,
            "throttle: expected a number in [0, 1], found nan",
        ),
        (lambda seen: pedals(steer=1.5), FailureReason.INVALID, "steer: expected a number in [-1, 1], found 1.5"),
        (
            lambda seen: Reply(plan=Plan(np.zeros((2, 3)), 0.2)),
            FailureReason.INVALID,
            "plan: expected points of shape",
        ),
    ],
)
def test_a_failing_agent_stops_its_own_ego_only(
    answer: Callable[[Observation], object], failure: FailureReason, text: str
) -> None:
    bad = Says(lambda seen: answer(seen) if seen.tick == 7 else go)
    episode, world = drive(
        straight_scenario(straight_ego("0", x=80), straight_ego("1", x=10)),
        {"0": bad, "1": Says(lambda seen: go)},
    )
    ending = episode.find_ending("0")
    assert (ending.end, ending.failure, ending.failed_tick) == (End.AGENT_FAILED, failure, 7)
    assert ending.text.startswith(text)
    assert world.placed[8] == ("0", "1")
    assert episode.find_ending("1").end is End.ARRIVED


def test_an_agent_that_fails_before_the_first_tick_never_drives() -> None:
    class Broken(Says):
        def start(self, briefing: object) -> None:
            raise RuntimeError("no weights")

    episode, _ = drive(straight_scenario(straight_ego("0")), {"0": Broken(lambda seen: go)})
    ending = Ending("0", 1, End.AGENT_FAILED, FailureReason.CRASHED, "RuntimeError: no weights", failed_tick=0)
    assert episode.find_ending("0") == ending
    assert episode.ticks == 2


def test_a_recorded_timeout_happens_again_without_waiting() -> None:
    timeout = Ending("0", 12, End.AGENT_FAILED, FailureReason.TIMEOUT, "act: no answer within the time limit", 12)
    episode, _ = drive(straight_scenario(straight_ego("0")), {"0": Says(lambda seen: go)}, replayed=(timeout,))
    (ending,) = episode.endings
    assert replace(ending, tick=12) == timeout
    assert ending.tick == episode.ticks - 1 > 12


def test_standing_for_more_than_thirty_seconds_blocks() -> None:
    episode, _ = drive(straight_scenario(straight_ego("0", length=100)), {"0": Says(lambda seen: stand)})
    assert (episode.find_ending("0").end, episode.find_ending("0").tick) == (End.BLOCKED, 601)


def test_the_time_limit_of_ego_0_holds_for_all_cavs() -> None:
    def crawl(seen: Observation) -> Reply:
        return pedals(throttle=0.3) if seen.own.speed < 0.7 else pedals(brake=0.3)

    egos = (straight_ego("0", x=100, length=10), straight_ego("1", x=10, length=60))
    episode, _ = drive(straight_scenario(*egos), {"0": Says(crawl), "1": Says(crawl)})
    assert (episode.find_ending("1").end, episode.find_ending("1").tick) == (End.TIMED_OUT, 16 * 20)


def test_a_cav_with_a_time_limit_of_its_own_ends_at_it_and_is_told() -> None:
    """Both drive on; the score finds the same endings in the recording (`compute_route_completion`)."""
    timed = straight_ego("1", x=100).model_copy(update={"time_limit_s": 1.5})
    scenario = straight_scenario(straight_ego("0"), timed).model_copy(update={"speeds": "road"})
    agents = {name: Says(lambda seen: go) for name in ("0", "1")}
    episode, _ = drive(scenario, agents)
    assert (episode.find_ending("1").end, episode.find_ending("1").tick) == (End.TIMED_OUT, 30)
    assert episode.find_ending("0").end is End.ARRIVED
    told = [agent.briefing for agent in agents.values() if agent.briefing]
    assert [(one.time_limit_s, one.desired_speed) for one in told] == [(48.0, None), (1.5, None)]
    for column, limit_percent in ((0, 100.0), (1, 5.0)):
        track = build_ego_track(episode, scenario, straight_road(), column)
        assert compute_route_completion(track) <= limit_percent


@pytest.mark.slow
def test_cavs_collide_and_do_not_pass_through_each_other() -> None:
    egos = (straight_ego("0", x=40, length=100), straight_ego("1", x=10, length=100))
    episode, _ = drive(
        straight_scenario(*egos),
        {"0": Says(lambda seen: stand), "1": Says(lambda seen: pedals(throttle=1.0))},
    )
    both = episode.valid[:, :2].all(axis=1)
    assert {(c.ego, c.other) for _, c in episode.contacts} == {("0", "1"), ("1", "0")}
    assert (episode.x[both, 0] - episode.x[both, 1]).min() > 4.85


def test_pass_through_records_contacts_and_lets_boxes_overlap() -> None:
    scenario = straight_scenario(straight_ego("0", x=40, length=100), straight_ego("1", x=10, length=100))
    agents = {"0": Says(lambda seen: stand), "1": Says(lambda seen: pedals(throttle=1.0))}
    setting = EpisodeConfig(scenario, straight_road(), seed=0, pass_through=True)
    episode = run_episode(setting, EmptyWorld(), {ego: LocalDriver(agent) for ego, agent in agents.items()})
    both = episode.valid[:, :2].all(axis=1)
    assert (episode.x[both, 0] - episode.x[both, 1]).min() < 0.0
    assert {(c.ego, c.other) for _, c in episode.contacts} == {("0", "1"), ("1", "0")}


def test_controls_are_recorded_as_they_were_applied() -> None:
    episode, _ = drive(
        straight_scenario(straight_ego("0")),
        {"0": Says(lambda seen: pedals(throttle=0.33333, steer=-0.00005))},
    )
    assert episode.control_values[3, 0].tolist() == pytest.approx([0.3333, 0.0, 0.0], abs=1e-9)
    control = Control(0.3333, 0.0, 0.0)
    again, _ = drive(straight_scenario(straight_ego("0")), {"0": Says(lambda seen: Reply(control=control))})
    assert again.digest == episode.digest


def test_agents_have_seeds_of_their_own() -> None:
    agents = {name: Says(lambda seen: go) for name in ("0", "1")}
    drive(straight_scenario(straight_ego("0", x=80), straight_ego("1")), agents)
    seeds = {agent.briefing.seed for agent in agents.values() if agent.briefing}
    assert len(seeds) == 2
