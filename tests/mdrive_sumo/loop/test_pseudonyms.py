"""No agent learns a scenario's id of a CAV: not by briefings, messages, sensors, or the order of anything."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.sampling import sampled
from testing.worlds import EmptyWorld, Says, pedals, straight_ego, straight_road, straight_scenario

from mdrive_sumo.contract import Message, Observation, Reply, SensorSpec
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions, StationIds
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.loop.pseudonyms import derive_pseudonyms, rename_senders
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario
from mdrive_sumo.sensing.sensing_frame import derive_track_name

NAMES = ("1", "2", "3")
RSU = RoadsideUnit(id="rsu", x=60.0, y=10.0, range_m=300.0)
THREE = straight_scenario(
    *(straight_ego(name, x=20 * i + 10, y=(0, 6, -6)[i], length=6) for i, name in enumerate(NAMES))
).model_copy(update={"rsus": (RSU,)})
HELLO = Reply(control=pedals(throttle=0.5).control, messages=(Message("text", b"hello"), Message("own", b"hello")))
SENSORS = (SensorSpec("objects", range_m=300.0), SensorSpec("privileged"))
LIDAR = (SensorSpec("objects"), SensorSpec("lidar", options={"hit_ids": True}))


def drive(
    ids: str = "random",
    seed: int = 0,
    scenario: Scenario = THREE,
    answer: Callable[[Observation], Reply] = lambda seen: HELLO,
    sensors: tuple[SensorSpec, ...] = SENSORS,
) -> tuple[EpisodeRecord, dict[str, Says]]:
    agents = {name: Says(answer, *sensors) for name in NAMES}
    config = EpisodeConfig(scenario, straight_road(), seed, options=EpisodeOptions.parse(ids=ids))
    return run_episode(config, EmptyWorld(), {ego: LocalDriver(agent) for ego, agent in agents.items()}), agents


driven = cache(drive)
"""For tests that look at the same drive."""


def told_id(agent: Says) -> str:
    assert agent.briefing is not None
    return agent.briefing.ego_id


def list_told_ids(agent: Says) -> set[str]:
    """Every id of a station that one agent ever got."""
    privileged = [seen.privileged for seen in agent.seen if seen.privileged is not None]
    senders = {message.sender for seen in agent.seen for message in seen.messages}
    return {told_id(agent), *senders, *(name for known in privileged for name in known.ego_ids)}


@pytest.mark.slow
def test_agents_get_pseudonyms_and_the_recording_has_the_scenarios_ids() -> None:
    episode, agents = driven()
    pseudonym = {ego: told_id(agent) for ego, agent in agents.items()}
    assert all(len(told) == 8 and int(told, 16) >= 0 for told in pseudonym.values())
    everybody = {*pseudonym.values(), next(told for told, name in episode.pseudonyms.items() if name == "rsu")}
    assert all(list_told_ids(agent) == everybody for agent in agents.values())
    assert episode.pseudonyms == {told: ego for ego, told in pseudonym.items()} | {
        (everybody - {*pseudonym.values()}).pop(): "rsu"
    }
    assert episode.ego_ids == NAMES
    assert {sent.message.sender for sent in episode.messages} == {*NAMES, "rsu"}
    assert {receiver for sent in episode.messages for receiver in sent.deliveries} == set(NAMES)


@pytest.mark.slow
def test_ids_scenario_restores_the_scenarios_ids() -> None:
    episode, agents = driven("scenario")
    assert {told_id(agent) for agent in agents.values()} == set(NAMES)
    assert all(list_told_ids(agent) == {*NAMES, "rsu"} for agent in agents.values())
    assert episode.pseudonyms == {}


def test_ids_change_neither_the_noise_nor_the_seed_of_an_agent() -> None:
    (random, one), (scenario, other) = driven(), driven("scenario")
    assert np.array_equal(random.quanta, scenario.quanta)
    for name in NAMES:
        mine, theirs = one[name].briefing, other[name].briefing
        assert mine is not None and theirs is not None and mine.seed == theirs.seed
        pair = one[name].seen[3].objects, other[name].seen[3].objects
        assert pair[0] is not None and pair[1] is not None and pair[0].ids == pair[1].ids


@given(seed=st.integers(0, 2**31 - 1), scenario=st.text(max_size=8), stations=st.sets(st.text(max_size=4), max_size=12))
def test_pseudonyms_are_unique_and_depend_on_names_only(seed: int, scenario: str, stations: set[str]) -> None:
    found = derive_pseudonyms(sorted(stations), StationIds.RANDOM, seed, scenario)
    assert len({*found.values()}) == len(stations)
    assert found == derive_pseudonyms(sorted(stations, reverse=True), StationIds.RANDOM, seed, scenario)


def test_equal_draws_are_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def drawn(seed: int, *purpose: str) -> int:
        return 7 if purpose[-1] == "0" else derive_seed(seed, *purpose)

    monkeypatch.setattr("mdrive_sumo.loop.pseudonyms.derive_seed", drawn)
    found = derive_pseudonyms(NAMES, StationIds.RANDOM, 0, "s")
    assert found["1"] == "00000007" and len({*found.values()}) == 3


def test_the_order_of_pseudonyms_is_not_that_of_the_scenario() -> None:
    """Over many episodes every order of three CAVs occurs about equally often."""
    counts = dict.fromkeys(permutations(NAMES), 0)
    for seed in range(600):
        found = derive_pseudonyms(NAMES, StationIds.RANDOM, seed, "s")
        counts[tuple(sorted(NAMES, key=found.__getitem__))] += 1
    assert min(counts.values()) > 60  # 100 expected; 60 is 4.4 standard deviations away


@pytest.mark.slow
@pytest.mark.parametrize("seed", sampled(range(4), (0, 1)))
def test_nothing_is_listed_in_the_order_of_the_scenario(seed: int) -> None:
    _, agents = driven(seed=seed)
    for agent in agents.values():
        for seen in agent.seen:
            order = [(message.tick, message.sender) for message in seen.messages]
            assert order == sorted(order)
            assert seen.privileged is not None
            assert list(seen.privileged.ego_ids) == sorted(seen.privileged.ego_ids)


def test_the_privileged_rows_belong_to_their_pseudonyms() -> None:
    episode, agents = driven()
    for seen in agents["1"].seen:
        known = seen.privileged
        assert known is not None
        for told, state, route in zip(known.ego_ids, known.states, known.routes, strict=True):
            column = episode.ids.index(episode.restore_name(told))
            assert state.x == episode.x[seen.tick, column]
            assert route[0, 0] == THREE.egos[column].start.x


@pytest.mark.slow
def test_lidar_names_are_sorted_and_points_keep_their_names() -> None:
    _, agents = drive(sensors=LIDAR)
    seen = agents["1"].seen[0]
    cloud, objects = seen.lidar[""], seen.objects
    assert objects is not None and set(objects.ids) == set(cloud.names) and list(cloud.names) == sorted(cloud.names)
    for name, x, y in zip(objects.ids, objects.x, objects.y, strict=True):
        points = cloud.points[cloud.hit == cloud.names.index(name)]
        assert len(points)
        assert np.abs(points[:, 0] + seen.own.x - x).max() < 2.6 and np.abs(points[:, 1] + seen.own.y - y).max() < 1.2


def test_a_message_within_one_tick_keeps_its_place_behind_earlier_ones_of_its_sender() -> None:
    sent = tuple(
        Message("text", payload, sender, tick) for tick in (1, 0) for sender in "ab" for payload in (b"1", b"2")
    )
    renamed = rename_senders(sent, {"a": "zz", "b": "aa"})
    assert [(m.tick, m.sender, m.payload) for m in renamed] == [
        (tick, sender, payload) for tick in (0, 1) for sender in ("aa", "zz") for payload in (b"1", b"2")
    ]


@pytest.mark.slow
def test_track_names_differ_by_episode_and_observer() -> None:
    def track(observer: str, seed: int, scenario: Scenario = THREE) -> set[str]:
        _, agents = driven(seed=seed) if scenario is THREE else drive(seed=seed, scenario=scenario)
        objects = agents[observer].seen[0].objects
        assert objects is not None and len(objects.ids) == 2
        return {*objects.ids}

    other_scenario = THREE.model_copy(update={"id": "other"})
    found = [track("1", 0), track("3", 0), track("1", 1), track("1", 0, other_scenario)]
    assert len(set[str]().union(*found)) == 8
    public = {derive_track_name(observer, name) for observer in NAMES for name in NAMES}  # the unsalted hash
    assert public.isdisjoint(set[str]().union(*found))


def test_a_recording_translates_texts_of_agents() -> None:
    def name_all(seen: Observation) -> Reply:
        text = " ".join(sorted({message.sender for message in seen.messages})) + " and 1"
        return replace(HELLO, messages=(Message("text", text.encode()),))

    episode, _ = drive(answer=name_all)
    texts = [sent.message.payload.decode() for sent in episode.messages if sent.message.type == "text"]
    told, translated = texts[-1], episode.restore_names(texts[-1])
    assert told != translated
    names = set(translated.split()) - {"and"}
    assert names <= {*NAMES, "rsu"} and len(names) >= 3
