"""Messages between agents in the loop, and the cost of think time."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from testing.worlds import EmptyWorld, Says, pedals, straight_ego, straight_road, straight_scenario

from mdrive_sumo.contract import Message, Note, Observation, Reply
from mdrive_sumo.core.clock import Clock, parse_clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import EpisodeRecord, ThinkTimeEntry
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.loop.agent_scheduler import AgentScheduler
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.v2x.channel import DeliveryStatus
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, LinkSettings
from mdrive_sumo.v2x.messages import Cpm, decode

TWO = straight_scenario(straight_ego("0", x=50, length=30), straight_ego("1", x=10, length=30))
QUIET = pedals(throttle=0.5)


def drive(agents: dict[str, Says], scenario: Scenario = TWO, **options: Any) -> EpisodeRecord:
    made = EpisodeConfig(scenario, straight_road(), seed=0, options=EpisodeOptions(**options))
    return run_episode(made, EmptyWorld(), {ego: LocalDriver(agent) for ego, agent in agents.items()})


def saying(text: Callable[[int], str]) -> Callable[[Observation], Reply]:
    return lambda seen: replace(QUIET, messages=(Message("text", text(seen.tick).encode()),))


def pair(text: Callable[[int], str] = str) -> tuple[Says, Says]:
    return Says(saying(text)), Says(lambda seen: QUIET)


@pytest.mark.parametrize(("latency", "age"), [(0, 1), (1, 1), (6, 6)])
def test_a_message_is_heard_after_exactly_its_latency_and_never_in_its_own_tick(latency: int, age: int) -> None:
    speaker, listener = pair()
    comm = CommSettings(link=LinkSettings(latency_ticks=latency))
    episode = drive({"0": speaker, "1": listener}, comm=comm)
    heard = [
        (seen.tick, m.tick, episode.restore_name(m.sender), m.payload) for seen in listener.seen for m in seen.messages
    ]
    assert heard
    assert all(now - then == age and sender == "0" for now, then, sender, _ in heard)
    assert all(payload == str(then).encode() for _, then, _, payload in heard)
    assert [then for _, then, _, _ in heard] == list(range(len(heard)))
    assert all(not seen.messages for seen in speaker.seen)


def test_what_arrives_is_part_of_the_digest() -> None:
    one, other = (drive(dict(zip("01", pair(text), strict=True))) for text in (str, lambda tick: f"{tick}."))
    assert np.array_equal(one.quanta, other.quanta)
    assert (one.digests[0] == other.digests[0]).all()  # nothing has arrived yet
    assert (one.digests[1] != other.digests[1]).any()
    unheard = [drive(dict(zip("01", pair(text), strict=True)), comm=PRESETS["off"]) for text in (str, repr)]
    assert unheard[0].digest == unheard[1].digest


def test_the_recording_tells_what_was_said_and_what_became_of_it() -> None:
    episode = drive(dict(zip("01", pair(), strict=True)))
    assert {sent.message.sender for sent in episode.messages} == {"0"}
    assert episode.messages[0].deliveries == {"1": (DeliveryStatus.DELIVERED, 1)}
    assert [sent.message.tick for sent in episode.messages] == list(range(len(episode.messages)))


def test_a_cav_that_has_ended_receives_and_sends_nothing() -> None:
    speaker, listener = pair()
    scenario = straight_scenario(straight_ego("0", x=50, length=60), straight_ego("1", x=10, length=10))
    episode = drive({"0": speaker, "1": listener}, scenario)
    end = episode.find_ending("1").tick
    assert max(seen.tick for seen in listener.seen) == end - 1
    late = [sent for sent in episode.messages if sent.message.tick >= end]
    assert late
    assert all(DeliveryStatus.DELIVERED not in {fate for fate, _ in sent.deliveries.values()} for sent in late)


def test_a_road_side_unit_tells_what_it_sees() -> None:
    listener = Says(lambda seen: QUIET)
    scenario = TWO.model_copy(update={"rsus": (RoadsideUnit(id="rsu", x=60.0, y=10.0, range_m=30.0),)})
    episode = drive({"0": Says(lambda seen: QUIET), "1": listener}, scenario, sensing=SensingProfile.PERFECT)
    (message,) = next(seen.messages for seen in listener.seen if seen.messages)
    told = decode(message)
    assert isinstance(told, Cpm)
    assert (episode.restore_name(message.sender), told.roadside) == ("rsu", True)
    assert told.objects.x == pytest.approx([50.0], abs=0.02)
    assert len(told.objects.free_m)


def test_notes_are_recorded_and_not_delivered() -> None:
    noting = Says(lambda seen: replace(QUIET, notes=(Note("why", "because"),) if seen.tick == 3 else ()))
    episode = drive({"0": noting, "1": Says(lambda seen: QUIET)})
    assert [(n.tick, n.ego, n.note) for n in episode.notes] == [(3, "0", Note("why", "because"))]
    assert episode.digest == drive({ego: Says(lambda seen: QUIET) for ego in "01"}).digest


def test_while_an_agent_thinks_its_last_control_is_applied_again_and_it_is_not_asked() -> None:
    thinker = Says(lambda seen: pedals(throttle=0.1 * (1 + seen.tick // 4 % 2)))
    episode = drive({"0": thinker, "1": Says(lambda seen: QUIET)}, clock=parse_clock("fixed:200"))
    assert [seen.tick for seen in thinker.seen[:4]] == [0, 4, 8, 12]
    pedal = episode.control_values[:16, 0]
    assert pedal[:4, 1] == pytest.approx(1.0)  # before its first answer a CAV stands
    assert pedal[4:16, 0] == pytest.approx([0.1] * 4 + [0.2] * 4 + [0.1] * 4)


def test_a_thinking_agent_sends_with_its_reply_and_loses_no_message() -> None:
    speaker, listener = Says(saying(str)), Says(lambda seen: QUIET)
    drive({"0": speaker, "1": listener}, clock=parse_clock("fixed:100"))
    heard = [(seen.tick, m.tick, m.payload) for seen in listener.seen for m in seen.messages]
    assert [(m, payload) for _, m, payload in heard[:3]] == [(2, b"0"), (4, b"2"), (6, b"4")]
    assert all(now % 2 == 0 for now, _, _ in heard)


class Slow(LocalDriver):
    """An agent that takes so long for every answer that its clock shows 0.12 s."""

    @property
    def think_time_s(self) -> float:
        return 0.12

    @think_time_s.setter
    def think_time_s(self, value: float) -> None:
        pass


def test_measured_thinking_is_recorded_and_can_be_repeated() -> None:
    def run(driver: type[LocalDriver], think_times: tuple[ThinkTimeEntry, ...] = ()) -> EpisodeRecord:
        options = EpisodeOptions(clock=Clock("measured"))
        made = EpisodeConfig(TWO, straight_road(), seed=0, options=options, think_times=think_times)
        return run_episode(made, EmptyWorld(), {ego: driver(Says(lambda seen: QUIET)) for ego in "01"})

    measured = run(Slow)
    assert {one.ticks for one in measured.thinking} == {2}
    assert run(LocalDriver, think_times=measured.thinking).digest == measured.digest
    assert run(LocalDriver).digest != measured.digest


@pytest.mark.parametrize("text", ["", "fast", "fixed", "fixed:", "fixed:-50", "fixed:30", "fixed:1e3", "measured:5"])
def test_an_unknown_clock_gets_one_sentence(text: str) -> None:
    with pytest.raises(InputError, match="agent clock: expected ideal, measured, or fixed:MS"):
        parse_clock(text)


@pytest.mark.parametrize("text", ["ideal", "measured", "fixed:0", "fixed:300"])
def test_a_clock_is_written_as_it_is_read(text: str) -> None:
    assert parse_clock(text).text == text


def test_a_think_time_that_a_recording_does_not_have_was_less_than_a_tick() -> None:
    scheduler = AgentScheduler({}, parse_clock("measured"), [ThinkTimeEntry("0", 7, 4)], lambda *_: None)
    assert [scheduler._compute_delay("0", tick) for tick in (6, 7, 8)] == [0, 4, 0]
    assert scheduler.think_times == [ThinkTimeEntry("0", 7, 4)]
