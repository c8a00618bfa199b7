"""After its agent has failed a CAV brakes, stays in the world, can be hit, and never scores better than a collision."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.sampling import examples, sampled
from testing.worlds import EmptyWorld, Says, pedals, straight_ego, straight_road, straight_scenario

from mdrive_sumo.contract import STANDSTILL, Message, Observation, Reply
from mdrive_sumo.core.state import Contact, End, FailureReason, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import EgoResult, ScenarioResult, ScoreMode, score_episode

GO = pedals(throttle=0.6)
LONE = straight_scenario(straight_ego("0", length=20))
QUEUE = straight_scenario(straight_ego("0", x=30, length=30), straight_ego("1", x=10, length=55))
"""Car 1 follows car 0 and passes its goal; it drives blindly."""
Answer = Callable[[Observation], object]


def drive(scenario: Scenario, *answers: Answer, replayed: tuple[Ending, ...] = ()) -> tuple[EpisodeRecord, list[Says]]:
    agents = [Says(answer) for answer in answers]
    drivers = {ego.id: LocalDriver(agent) for ego, agent in zip(scenario.egos, agents, strict=True)}
    config = EpisodeConfig(scenario, straight_road(), 0, replayed_failures=replayed)
    return run_episode(config, EmptyWorld(), drivers), agents


def go(seen: Observation) -> Reply:
    return replace(GO, messages=(Message("text", b"hello"),))


def fail_in(tick: int) -> Answer:
    return lambda seen: 1 / 0 if seen.tick == tick else go(seen)


def brake_from(tick: int) -> Answer:
    return lambda seen: Reply(control=STANDSTILL) if seen.tick >= tick else go(seen)


def score(episode: EpisodeRecord, scenario: Scenario) -> ScenarioResult:
    return score_episode(episode, scenario, straight_road(), ScoreMode.MDRIVE, 0)


@cache
def arrived() -> EpisodeRecord:
    return drive(LONE, go)[0]


@settings(max_examples=examples(8, 25), deadline=None)
@given(st.data())
def test_failing_is_never_better_than_colliding_in_the_same_tick(data: st.DataObject) -> None:
    tick = data.draw(st.integers(0, arrived().ticks - 2))
    failed, _ = drive(LONE, fail_in(tick))
    hit = replace(arrived(), contacts=((tick, Contact("0", "npc", Kind.VEHICLE)),))
    (mine,), (theirs,) = score(failed, LONE).egos, score(hit, LONE).egos
    assert theirs.outcome is End.ARRIVED and theirs.ip == pytest.approx(0.6)
    assert mine.outcome is End.AGENT_FAILED
    assert mine.ds <= theirs.ds


@pytest.mark.slow
@pytest.mark.parametrize("tick", sampled((0, 20, 87), (20, 87)))
def test_a_failed_agent_is_for_all_others_a_car_that_brakes(tick: int) -> None:
    failed, braking = drive(QUEUE, fail_in(tick), go)[0], drive(QUEUE, brake_from(tick), go)[0]
    ticks = min(failed.ticks, braking.ticks)
    assert np.array_equal(failed.quanta[:ticks], braking.quanta[:ticks])
    assert failed.find_ending("1") == braking.find_ending("1")
    here, there = score(failed, QUEUE), score(braking, QUEUE)
    assert here.egos[1] == there.egos[1]
    if failed.find_ending("0").end is End.AGENT_FAILED:
        assert here.egos[0].ds <= 0.6 * there.egos[0].ds + 1e-9


@pytest.mark.slow
def test_a_vanished_car_would_have_been_worth_a_collision() -> None:
    """The case of the attack: car 0 gives up on the way, and car 1 would pass where it was."""
    nothing, failing = (score(drive(QUEUE, answer, go)[0], QUEUE).egos for answer in (go, fail_in(20)))
    assert [ego.ds for ego in nothing] == [100.0, 100.0]
    assert "agent-failed" in kind(failing[0])
    assert all("collision-vehicle" in kind(ego) for ego in failing)
    assert failing[0].ip <= 0.36 + 1e-9 and failing[1].ip <= 0.6 + 1e-9


def kind(ego: EgoResult) -> list[str]:
    return [infraction.kind for infraction in ego.infractions]


def test_the_car_brakes_from_the_tick_of_the_failure_and_is_asked_no_more() -> None:
    episode, (agent,) = drive(LONE, fail_in(30))
    ending = episode.find_ending("0")
    assert (ending.end, ending.failure, ending.failed_tick) == (End.AGENT_FAILED, FailureReason.CRASHED, 30)
    assert ending.text == "ZeroDivisionError: division by zero"
    assert [seen.tick for seen in agent.seen] == list(range(31))
    assert episode.control_values[30:-1, 0, 1].min() == 1.0 and episode.control_values[29, 0, 1] == 0.0
    assert ending.tick == episode.ticks - 1 > 35
    assert episode.speed[-1, 0] == 0.0 and episode.speed[-2, 0] > 0.0  # it ends as soon as it stands
    (infraction,) = score(episode, LONE).egos[0].infractions
    assert (infraction.kind, infraction.tick, infraction.factor) == ("agent-failed", 30, 0.6)
    assert (infraction.x, infraction.y) == (episode.x[30, 0], 0.0)


@pytest.mark.slow
def test_it_waits_for_the_others_and_is_blocked_after_thirty_seconds() -> None:
    short, long = straight_ego("1", x=60, length=10), straight_ego("1", x=60, length=100)
    crawl: Answer = lambda seen: pedals(throttle=0.35) if seen.own.speed < 2.5 else pedals(brake=0.1)  # noqa: E731
    quick, _ = drive(straight_scenario(straight_ego("0", length=40), short), fail_in(0), crawl)
    assert quick.find_ending("0").tick == quick.find_ending("1").tick
    slow, _ = drive(straight_scenario(straight_ego("0", length=60), long), fail_in(0), crawl)
    assert slow.find_ending("0").tick == 601 < slow.find_ending("1").tick
    assert slow.find_ending("0").end is End.AGENT_FAILED


def test_all_may_fail_at_once() -> None:
    episode, _ = drive(QUEUE, fail_in(5), fail_in(5))
    assert {(ending.end, ending.failed_tick) for ending in episode.endings} == {(End.AGENT_FAILED, 5)}
    assert (episode.speed[-1] == 0.0).all() and episode.ticks < 30


class Broken(Says):
    def start(self, briefing: object) -> None:
        raise RuntimeError("no weights")


@pytest.mark.slow
def test_an_agent_that_fails_before_the_first_tick_leaves_its_car_at_its_start() -> None:
    drivers = {"0": LocalDriver(Broken(go)), "1": LocalDriver(Says(go))}
    episode = run_episode(EpisodeConfig(QUEUE, straight_road(), 0), EmptyWorld(), drivers)
    ending = episode.find_ending("0")
    assert (ending.failed_tick, ending.text) == (0, "RuntimeError: no weights")
    assert episode.x[0, 0] == 30.0
    assert Contact("1", "0", Kind.VEHICLE) in {contact for _, contact in episode.contacts}
    again = drive(QUEUE, go, go, replayed=(ending,))[0]
    assert (again.digest, again.endings) == (episode.digest, episode.endings)


def test_rolling_over_the_goal_does_not_undo_the_failure() -> None:
    tick = arrived().find_ending("0").tick - 1
    episode, _ = drive(LONE, fail_in(tick))
    (ego,) = score(episode, LONE).egos
    assert (ego.outcome, ego.rc, ego.ip) == (End.AGENT_FAILED, 100.0, 0.6)
    assert score(episode, LONE).sr == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("tick", sampled((0, 1, 25, 60), (25,)))  # 0: the test of `Broken`
def test_a_replayed_failure_repeats_every_tick(tick: int) -> None:
    episode, _ = drive(QUEUE, fail_in(tick), go)
    replayed = tuple(ending for ending in episode.endings if ending.end is End.AGENT_FAILED)
    again, (agent, _) = drive(QUEUE, go, go, replayed=replayed)
    assert (again.digest, again.endings) == (episode.digest, episode.endings)
    assert len(agent.seen) == tick
    assert again.messages == episode.messages
