"""The cooperative baselines in closed loop: sensors, messages, knowledge and results."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from testing.agents_driving import Box, BoxWorld, crossing_route, ego, field
from testing.planning import briefing, own, seen, straight, things
from testing.sampling import sampled
from testing.short_suite import make_short_suite

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.agents.sharing import SharingNegotiationAgent
from mdrive_sumo.contract import Cause, Message, Objects, Observation, Reason
from mdrive_sumo.contract.detector_profiles import IDEAL, STANDARD
from mdrive_sumo.contract.reason import REASON
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import AgentFailure, LocalDriver
from mdrive_sumo.negotiation import NegotiationInterface
from mdrive_sumo.perception.object_tracker import ObjectTracker
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner
from mdrive_sumo.planning.stop_lines import StopPoint
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, load_job_scenario, reexecute
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import ScoreMode, score_episode
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, LinkSettings
from mdrive_sumo.v2x.messages import CAM, CPM, MCM, Cpm, Direction, Intention, Mcm, ReferencePose, decode, encode

pytestmark = pytest.mark.slow

TOWN, MINOR_ROAD = "i07_ins_ss_town", "i13_ins_sl_minor_road"
SWAPS = ("attfuse", "disconet", "fcooper", "cobevt")
DRIVING = ("single", "sharing", "colmdriver-rule", "sharing+negotiation")
TALKING: Mapping[str, frozenset[str]] = {
    "single": frozenset(),
    "sharing": frozenset((CAM, CPM)),
    "colmdriver-rule": frozenset((MCM,)),
    "sharing+negotiation": frozenset((CAM, CPM, MCM)),
    "perception-swap:attfuse:profile": frozenset((CAM, CPM)),
}


def job(
    scenario: str, agent: str, comm: CommSettings = PRESETS["ideal"], seed: int = 0, **options: float | str
) -> EpisodeJob:
    """One of the packaged suite's scenarios."""
    return EpisodeJob(
        find_suite_folder("interdrive@0"),
        scenario,
        AgentSpec(agent, options),
        seed,
        options=EpisodeOptions(comm=comm),
    )


@lru_cache
def driven(scenario: str, agent: str) -> EpisodeRecord:
    """With a faultless channel."""
    return reexecute(job(scenario, agent))


@pytest.mark.parametrize("scenario", sampled((TOWN, MINOR_ROAD), (TOWN,)))
@pytest.mark.parametrize("agent", DRIVING)
def test_baselines_arrive_unharmed(agent: str, scenario: str) -> None:
    episode = driven(scenario, agent)
    assert {ending.end for ending in episode.endings} == {End.ARRIVED}
    assert {record.note.kind for record in episode.notes} <= {REASON}  # no warning, no failure
    result = score_episode(episode, *load_job_scenario(job(scenario, agent)), ScoreMode.MDRIVE, 0)
    assert (result.sr, result.ds) == (100.0, 100.0)


@pytest.mark.parametrize("name", sampled(SWAPS, ("attfuse",)))
def test_perception_swaps_arrive(name: str) -> None:
    """Not unharmed: their hazard rule looks straight ahead only and knows no stop signs."""
    episode = driven(TOWN, f"perception-swap:{name}:profile")
    assert {ending.end for ending in episode.endings} == {End.ARRIVED}
    assert {record.note.kind for record in episode.notes} <= {REASON}  # no warning, no failure


@pytest.mark.parametrize(
    ("agent", "label"),
    [("single", "single"), ("sharing", "sharing"), ("colmdriver-rule", "negotiation"), ("colmdriver", "negotiation"),
     ("sharing+negotiation", "negotiation"), *((f"perception-swap:{name}:profile", "sharing") for name in SWAPS)],
)  # fmt: skip
def test_labels(agent: str, label: str) -> None:
    options = {"endpoint": "http://127.0.0.1:9/v1"} if agent == "colmdriver" else {}
    assert AGENTS[agent](options).label == label


@pytest.mark.parametrize("agent", DRIVING)
def test_sensors_are_what_the_options_say(agent: str) -> None:
    (plain,) = AGENTS[agent]({}).sensors()
    (chosen,) = AGENTS[agent]({"range": 35.0, "detector": IDEAL}).sensors()
    assert (plain.kind, plain.range_m, plain.options["profile"]) == ("objects", 80.0, STANDARD)
    assert (chosen.range_m, chosen.options["profile"]) == (35.0, IDEAL)
    assert plain.options["free_space"] is agent.startswith("sharing")


@pytest.mark.parametrize(("share", "kinds"), [(0, {MCM}), (1, {CAM, CPM, MCM})])
def test_both_ticks_of_the_paper_can_be_set(share: int, kinds: set[str]) -> None:
    """Perception shared or not, negotiation in both."""
    agent = AGENTS["colmdriver-rule"]({"share": share})
    assert agent.sensors()[0].options["free_space"] is bool(share)
    agent.start(briefing(straight()))
    reply = agent.act(seen(0, own(0.0, speed=6.0), things()))
    assert {message.type for message in reply.messages} == kinds


def test_the_model_s_agent_shares_perception_unless_told_otherwise() -> None:
    address = {"endpoint": "http://127.0.0.1:9/v1"}
    shares = [AGENTS["colmdriver"](address | more).sensors()[0].options["free_space"] for more in ({}, {"share": 0})]
    assert shares == [True, False]


@pytest.mark.parametrize("name", SWAPS)
def test_perception_swaps_differ_in_their_detector_only(name: str) -> None:
    (spec,) = AGENTS[f"perception-swap:{name}:profile"]({}).sensors()
    assert (spec.kind, spec.range_m, dict(spec.options)) == ("objects", 80.0, {"profile": name})


@pytest.mark.parametrize(
    ("agent", "options", "words"),
    [
        *((agent, {"speed": 1.9}, "option speed: expected a number in [2, 40], found 1.9") for agent in DRIVING),
        *((agent, {"speed": 40.1}, "option speed: expected a number in [2, 40], found 40.1") for agent in DRIVING),
        *((agent, {"range": 4.0}, "option range: expected a number in [5, 200], found 4") for agent in DRIVING),
        *((agent, {"range": True}, "option range: expected a number in [5, 200], found True") for agent in DRIVING),
        *((agent, {"detector": "eyes"}, "option detector: expected one of standard, lidar") for agent in DRIVING),
        ("colmdriver-rule", {"share": 0.5}, "option share: expected 0 or 1, found 0.5"),
        ("colmdriver-rule", {"compat_ego0": 2}, "option compat_ego0: expected a number in [0, 1], found 2"),
        ("sharing", {"compat_ego0": 1}, "junction_share, range, speed, speed_share), found 'compat_ego0'"),
        ("perception-swap:cobevt:profile", {"range": 50.0}, "expected options among (none), found 'range'"),
        ("colmdriver", {"endpoint": "http://127.0.0.1:9/v1", "speed": 1.0}, "option speed: expected a number in"),
    ],
)
def test_unusable_options_are_refused_in_one_sentence(agent: str, options: dict[str, float | str], words: str) -> None:
    with pytest.raises(InputError) as caught:
        AGENTS[agent](options)
    assert words in str(caught.value)
    assert str(caught.value).startswith(f"agent {agent}: ")
    assert "\n" not in str(caught.value)


def test_a_language_model_needs_an_endpoint() -> None:
    with pytest.raises(InputError, match="option endpoint: expected the URL"):
        AGENTS["colmdriver"]({})


def test_the_compatible_rule_can_be_asked_for() -> None:
    for value in (0, 1, "1"):
        assert AGENTS["colmdriver-rule"]({"compat_ego0": value}).label == "negotiation"


@pytest.mark.parametrize("agent", sorted(TALKING))
def test_sent_message_types_and_intervals(agent: str) -> None:
    episode = driven(TOWN, agent)
    sent = {(s.message.sender, s.message.type) for s in episode.messages}
    assert sent == {(name, kind) for name in episode.ego_ids for kind in TALKING[agent]}
    for sender, kind in sent:
        ticks = [s.message.tick for s in episode.messages if (s.message.sender, s.message.type) == (sender, kind)]
        assert set(np.diff(ticks)) == {4 if kind == MCM else 2}  # every planning step, and 10 Hz
        assert ticks[0] <= 1


def test_cams_contain_the_estimated_state_of_their_sender() -> None:
    """Off by the stated errors: neither exact nor further than chance has it."""
    episode = driven(TOWN, "sharing")
    errors: list[float] = []
    for sent in episode.messages[:40]:
        said, column = decode(sent.message), episode.ids.index(sent.message.sender)
        assert not isinstance(said, str)
        assert (said.pose.tick, said.pose.position_sigma) == (sent.message.tick, 0.2)
        place = episode.x[sent.message.tick, column], episode.y[sent.message.tick, column]
        errors.append(math.dist((said.pose.x, said.pose.y), place))
    assert 0.03 < max(errors) < 5 * 0.2


@pytest.mark.parametrize(
    "agent", sampled(("sharing+negotiation", "perception-swap:fcooper:profile"), ("sharing+negotiation",))
)
def test_two_runs_over_a_bad_channel_are_equal(agent: str, tmp_path: Path) -> None:
    suite = make_short_suite(tmp_path, TOWN, metres=8)
    bad = CommSettings(link=LinkSettings(latency_ticks=2, loss=0.3, pose_error_m=0.6, pose_error_deg=0.6))
    first, again, ideal, other = (
        reexecute(replace(job(TOWN, agent, comm=comm, seed=seed), suite_folder=suite))
        for comm, seed in ((bad, 0), (bad, 0), (PRESETS["ideal"], 0), (bad, 1))
    )
    assert first.digest == again.digest
    assert first.digest != ideal.digest
    assert first.digest != other.digest


def plan_of(agent: str, objects: Objects, *messages: Message) -> Float:
    """The first plan of a car that stands at the origin and goes east, (50, 2)."""
    driver = AGENTS[agent]({})
    driver.start(briefing())
    plan = driver.act(seen(1, own(speed=6.0), objects, messages)).plan
    assert plan is not None
    return plan.points


@pytest.mark.parametrize("agent", ["sharing", "sharing+negotiation"])
def test_sharing_agents_plan_around_objects_of_others(agent: str) -> None:
    told = encode(
        Cpm(ReferencePose(30.0, 20.0, 0.0, 0), 80.0, things((35.0, 0.0, 0.0, 0.0)), np.zeros(1, dtype=np.uint8))
    )
    free = plan_of(agent, things())
    assert free[-1, 0] > 60.0
    assert plan_of(agent, things(), replace(told, sender="b"))[-1, 0] < 35.0
    assert plan_of("single", things(), replace(told, sender="b")) == pytest.approx(free)


@pytest.mark.parametrize("agent", DRIVING)
def test_all_wait_for_a_slow_car_from_the_right_and_leave_it_room_to_turn(agent: str) -> None:
    plan = plan_of(agent, things((20.0, -5.0, math.pi / 2, 1.0)))
    assert plan[24, 0] < 20.0 - 12.0  # after 5 s; without room for his turn it would be at 15 m


@pytest.mark.parametrize("agent", ["colmdriver-rule", "sharing+negotiation"])
def test_negotiating_agents_rely_on_announcements(agent: str) -> None:
    """One from the right would go first; but he has said that he stops."""
    right = things((20.0, -13.0, math.pi / 2, 6.0))
    stopping = np.tile((20.0, -11.0), (50, 1))
    said = Mcm(ReferencePose(20.0, -13.0, math.pi / 2, 0), 6.0, Intention.STOP, Direction.FOLLOW, 0.2, stopping)
    free = plan_of(agent, things())
    assert np.abs(plan_of(agent, right) - free).max() > 1.0
    assert plan_of(agent, right, replace(encode(said), sender="b")) == pytest.approx(free)


def test_the_rule_agent_stops_where_agreed(monkeypatch: pytest.MonkeyPatch) -> None:
    def agreed(self: NegotiationInterface, seen: Observation, planner: SpaceTimePlanner) -> list[StopPoint]:
        return [StopPoint(20.0, Reason(Cause.AGREEMENT))]

    monkeypatch.setattr(NegotiationInterface, "find_stop_points", agreed)
    assert 15.0 < plan_of("colmdriver-rule", things())[-1, 0] < 20.0
    assert not SharingNegotiationAgent.stops  # passes behind others


@pytest.mark.full  # in `make test`: test_late_fusion, test_names_are_unique_after_a_merged_object_splits
def test_sharing_agents_tolerate_pose_errors() -> None:
    """Regression: cars that were confused for a while had the same name, and the agent failed."""
    episode = reexecute(job("i25_ins_oppo_boulevard", "sharing", comm=PRESETS["paper-pose"]))
    assert [(ending.end, ending.text) for ending in episode.endings] == [(End.ARRIVED, "")] * episode.egos


HIDDEN = Box(1.75, -34.0, math.pi / 2, 4.0)
"""A car without perception from the south, occluded by the house for a CAV from the west."""
HOUSE = Building(id="house", polygon=((-30.0, -45.0), (-4.0, -45.0), (-4.0, -5.0), (-30.0, -5.0)))


class Watched(LocalDriver):
    """Keeps what its agent sees; after two seconds that is enough, and the episode ends."""

    seen: list[Observation]

    def __init__(self, agent: str) -> None:
        super().__init__(AGENTS[agent]({"detector": "ideal"}))
        self.seen = []

    def ask(self, observation: Observation) -> None:
        if observation.tick > 44:
            raise AgentFailure(FailureReason.CRASHED, "seen enough")
        self.seen.append(observation)
        super().ask(observation)


def past_the_house(agent: str) -> tuple[EpisodeRecord, dict[str, Watched]]:
    """ "0" comes from the west; "1" from the east, and sees the south arm."""
    egos = (ego("0", crossing_route("straight", 0)), ego("1", crossing_route("straight", 2)))
    scenario = Scenario(id="field", bucket="Test", category="test", network="field", egos=egos)
    drivers = {one.id: Watched(agent) for one in egos}
    roads = replace(field(), buildings=(HOUSE,))
    return run_episode(EpisodeConfig(scenario, roads, seed=0), BoxWorld([HIDDEN]), drivers), drivers


def knows(objects: Objects | None, x: float, y: float) -> bool:
    assert objects is not None
    return bool((np.hypot(objects.x - x, objects.y - y) < 1.0).any())


def hidden_ticks(seen: Sequence[Observation]) -> list[int]:
    """When the own sensors do not see the blind car."""
    return [s.tick for s in seen if not knows(s.objects, HIDDEN.x, HIDDEN.y + HIDDEN.speed * s.tick * 0.05)]


def test_single_does_not_know_an_occluded_car() -> None:
    _, drivers = past_the_house("single")
    assert set(range(40)) <= set(hidden_ticks(drivers["0"].seen))
    assert hidden_ticks(drivers["1"].seen)[:1] != [0]
    assert all(not one.messages for one in drivers["0"].seen)


def test_sharing_knows_an_occluded_car(monkeypatch: pytest.MonkeyPatch) -> None:
    known: dict[tuple[int, int], Objects] = {}
    update = ObjectTracker.update

    def tracked(self: ObjectTracker, seen: Observation) -> Objects:
        known[id(self), seen.tick] = update(self, seen)
        return known[id(self), seen.tick]

    monkeypatch.setattr(ObjectTracker, "update", tracked)
    _, drivers = past_the_house("sharing")
    first = next(iter(known))[0]  # "0" is asked first
    hidden = {tick for tick in hidden_ticks(drivers["0"].seen) if 4 <= tick < 40}
    asked = [tick for one, tick in known if one == first and tick in hidden]
    assert len(asked) >= 5
    for tick in asked:
        assert knows(known[first, tick], HIDDEN.x, HIDDEN.y + HIDDEN.speed * tick * 0.05)
