"""The built-in agents in closed loop on small roads."""

import math
import re
import subprocess
import sys
from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest
from testing.agents_driving import Box, all_arrived, crossing_route, drive, field
from testing.planning import briefing, own, seen, things
from testing.sampling import sampled

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.agents.sensorless import find_slot
from mdrive_sumo.contract import LABELS, MAX_PLAN_POINTS, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, End
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.planning.parameters import AVOIDANCE
from mdrive_sumo.roads.network_file import StopSignBox

pytestmark = pytest.mark.slow

NEEDED: Mapping[str, Mapping[str, str]] = {"colmdriver": {"endpoint": "http://127.0.0.1:9/v1"}}
"""Options without which an agent cannot be made."""
STRAIGHT = crossing_route("straight", 0)
EASTBOUND_BEHIND = STRAIGHT - (5.0, 0.0)
"""Bumper to bumper: 5 m behind a car of 4.90 m."""

CASES: Mapping[str, Mapping[str, Float]] = {
    "straight across": {"0": STRAIGHT, "1": crossing_route("straight", 1)},
    "left across oncoming": {"0": STRAIGHT, "1": crossing_route("left", 2)},
    "right merges": {"0": STRAIGHT, "1": crossing_route("right", 1)},
    "queue": {"0": EASTBOUND_BEHIND, "1": STRAIGHT, "2": crossing_route("straight", 3)},
    "four lefts": {str(arm): crossing_route("left", arm) for arm in range(4)},
}
EIGHT: Mapping[str, Float] = {
    **{str(arm): crossing_route("straight", arm) for arm in range(4)},
    **{str(4 + arm): crossing_route("left", arm, run_up_m=36.0) for arm in range(4)},
}


@cache
def driven(agent: str, case: str) -> EpisodeRecord:
    """A drive of `CASES` that several tests look at."""
    return drive(agent, CASES[case])


@pytest.mark.parametrize("name", sorted(AGENTS))
def test_agents_describe_themselves(name: str) -> None:
    agent = AGENTS[name](NEEDED.get(name, {}))
    assert agent.label in LABELS
    assert (type(agent).__doc__ or "").strip().splitlines()[0].endswith(".") or ":" in (type(agent).__doc__ or "")
    assert (agent.label == "privileged") == any(s.kind == "privileged" for s in agent.sensors())


def test_an_agent_is_imported_without_the_others() -> None:
    """In a fresh process: this one has imported all of them."""
    code = (
        "import sys; from mdrive_sumo.agents.registry import AGENTS\n"
        "assert 'idm' in AGENTS and 'nobody' not in AGENTS and len(AGENTS) == len([*AGENTS])\n"
        "agent = AGENTS['constant-speed']\n"
        "loaded = sorted(name for name in sys.modules if name.startswith('mdrive_sumo.agents.'))\n"
        "print(agent.__name__, *loaded)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["ConstantSpeedAgent", "mdrive_sumo.agents.registry", "mdrive_sumo.agents.sensorless"]


@pytest.mark.parametrize("name", sorted(AGENTS))
def test_unknown_options_are_refused(name: str) -> None:
    with pytest.raises(InputError, match=f"agent {re.escape(name)}: expected options among .*found 'sped'"):
        AGENTS[name]({"sped": 3.0})


@pytest.mark.parametrize("value", [0.5, 41.0, "fast", True, math.nan])
def test_unusable_values_are_refused(value: float | str | bool) -> None:
    with pytest.raises(InputError, match=r"agent idm: option speed: expected a number in \[1, 40\], found"):
        AGENTS["idm"]({"speed": value})


def test_options_may_be_text() -> None:
    AGENTS["idm"]({"speed": "5.5"})


def test_stationary_stands_until_it_is_blocked() -> None:
    episode = drive("stationary", {"0": STRAIGHT})
    assert episode.find_ending("0").end is End.BLOCKED
    assert np.all(episode.x[:, 0] == episode.x[0, 0])


def test_constant_speed_holds_its_speed_and_arrives() -> None:
    episode = drive("constant-speed", {"0": STRAIGHT})
    speeds = episode.speed[: episode.find_ending("0").tick, 0]
    assert all_arrived(episode)
    assert speeds[100:].min() == pytest.approx(8.0, abs=0.1)
    assert speeds.max() == pytest.approx(8.0, abs=0.3)


def test_constant_speed_is_blind() -> None:
    episode = drive("constant-speed", {"0": STRAIGHT}, [Box(0.0, -1.75, 0.0)])
    assert any(contact.other == "b0" for _, contact in episode.contacts)


@pytest.mark.parametrize(
    ("turn", "agent"),
    [
        *(("left", "idm"), ("right", "constant-speed"), ("right", "omniscient"), ("straight", "idm")),
        pytest.param("left", "constant-speed", marks=pytest.mark.full),
        pytest.param("left", "omniscient", marks=pytest.mark.full),
        pytest.param("right", "idm", marks=pytest.mark.full),
        pytest.param("straight", "constant-speed", marks=pytest.mark.full),
        pytest.param("straight", "omniscient", marks=pytest.mark.full),
    ],
)
def test_moving_agents_stay_on_the_route(agent: str, turn: str) -> None:
    xy = crossing_route(turn, 0)
    episode = drive(agent, {"0": xy})
    last = episode.find_ending("0").tick
    offset = [abs(Polyline(xy).project(x, y)[1]) for x, y in zip(episode.x[:last, 0], episode.y[:last, 0], strict=True)]
    assert all_arrived(episode)
    assert max(offset) < 0.75  # half of what is free beside a 2 m car on a 3.5 m lane


def test_idm_stops_behind_a_standing_car_with_room_to_turn_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """This road has no room for a detour. CAVs that stand count as blocked after 3 s already."""
    monkeypatch.setattr("mdrive_sumo.scoring.criteria.BLOCKED_TICKS", 3 * TICKS_PER_SECOND)
    episode = drive("idm", {"0": STRAIGHT}, [Box(0.0, -1.75, 0.0)])
    gap = (0.0 - 4.5 / 2) - (episode.x[-2, 0] + 4.9 / 2)
    assert not episode.contacts
    assert episode.find_ending("0").end is End.BLOCKED
    assert gap == pytest.approx(AVOIDANCE.turn_out_m, abs=0.5)


def test_idm_follows_a_slow_car() -> None:
    episode = drive("idm", {"0": STRAIGHT}, [Box(-25.0, -1.75, 0.0, 3.0)])
    late = slice(200, episode.find_ending("0").tick)
    assert not episode.contacts
    assert np.all(np.abs(episode.speed[late, 0] - 3.0) < 0.3)


@pytest.mark.parametrize("name", sampled([*CASES][:4], ("left across oncoming", "queue")))
def test_idm_yields_where_the_blind_collide(name: str) -> None:
    assert driven("constant-speed", name).contacts
    episode = driven("idm", name)
    assert not episode.contacts
    assert all_arrived(episode)


@pytest.mark.parametrize("agent", ["idm", "omniscient"])
def test_stop_signs_are_obeyed(agent: str) -> None:
    sign = StopSignBox(id="s", lane="r_0", line_pos_m=90.0, length_m=4.0)
    episode = drive(agent, {"0": STRAIGHT}, roads=field(sign))
    inside = (episode.x[:, 0] > -14.0) & (episode.x[:, 0] < -10.0)
    assert all_arrived(episode)
    assert np.abs(episode.speed[inside, 0]).min() < 0.1
    assert drive(agent, {"0": STRAIGHT}).ticks < episode.ticks - 20


def test_idm_waits_at_a_red_light() -> None:
    episode = drive("idm", {"0": STRAIGHT}, roads=field(light="L:0"), red_until=300)
    assert episode.x[299, 0] == pytest.approx(-3.0, abs=1.0)
    assert episode.x[:300, 0].max() < 0.0
    assert all_arrived(episode)


@pytest.mark.parametrize("name", sampled(CASES, ("left across oncoming", "queue", "four lefts")))
def test_omniscient_has_no_contacts_and_all_arrive(name: str) -> None:
    episode = driven("omniscient", name)
    assert not episode.contacts
    assert all_arrived(episode)


@pytest.mark.full
def test_omniscient_solves_a_crowded_crossing() -> None:
    assert drive("constant-speed", EIGHT).contacts
    episode = drive("omniscient", EIGHT)
    assert not episode.contacts
    assert all_arrived(episode)


def test_omniscient_is_reproducible() -> None:
    first, again = driven("omniscient", "right merges"), drive("omniscient", CASES["right merges"])
    assert np.array_equal(first.digests, again.digests)


def test_omniscient_lets_background_traffic_pass() -> None:
    # At its own pace it would be at the crossing lane (x = 0) after 7 s; so would the other car.
    crossing = Box(0.0, -45.0, math.pi / 2, 6.5)
    assert drive("constant-speed", {"0": STRAIGHT}, [crossing]).contacts
    episode = drive("omniscient", {"0": STRAIGHT}, [crossing])
    assert not episode.contacts
    assert all_arrived(episode)


@pytest.mark.full
def test_omniscient_waits_for_a_car_that_stands_in_its_way() -> None:
    episode = drive("omniscient", {"0": STRAIGHT}, [Box(0.0, -1.75, 0.0)])
    assert not episode.contacts
    assert episode.find_ending("0").end is not End.ARRIVED


def test_omniscient_is_called_privileged_and_publishes_long_plans() -> None:
    agent = AGENTS["omniscient"]({})
    assert agent.sensors() == (SensorSpec("privileged"),)
    episode = driven("omniscient", "straight across")
    assert all(1 <= len(record.points) <= MAX_PLAN_POINTS for record in episode.plans)


@pytest.mark.parametrize(
    ("name", "slots", "slot"),
    [("0", 8, 0), ("7", 8, 7), ("8", 8, 0), ("13", 4, 1), ("cav_2", 8, 2), ("cav_9", 8, 1), ("3", 1, 0), ("00", 8, 0)],
)
def test_a_number_in_the_id_is_the_turn(name: str, slots: int, slot: int) -> None:
    assert find_slot(name, slots) == slot


def test_random_ids_spread_over_the_turns_and_repeat() -> None:
    """1000 hexadecimal names over 8 turns: 125 each, within five standard deviations (10.5)."""
    names = [f"{i:03x}bad{i * 7919 % 4096:03x}e" for i in range(1000)]
    found = [find_slot(name, 8) for name in names]
    assert found == [find_slot(name, 8) for name in names]
    counts = [found.count(slot) for slot in range(8)]
    assert min(counts) > 125 - 53 and max(counts) < 125 + 53


def test_take_turns_needs_no_sensor_and_no_message_to_avoid_every_conflict() -> None:
    """Four left turns that collide at constant speed: one CAV after the other, and none is blocked while it waits."""
    agent = AGENTS["take-turns"]({})
    assert (agent.sensors(), agent.label) == ((), "single")
    episode = drive("take-turns", CASES["four lefts"])
    assert driven("constant-speed", "four lefts").contacts
    assert all_arrived(episode) and not episode.contacts and not episode.messages
    moved = np.hypot(episode.x - episode.x[0], episode.y - episode.y[0])[:, :4] > 1.0
    starts = [int(np.flatnonzero(moved[:, i])[0]) for i in range(4)]
    assert np.diff(starts) == pytest.approx(np.full(3, starts[3] - starts[0]) / 3, abs=15)


def test_a_wait_does_not_move_the_plan_of_take_turns_on() -> None:
    """After its wait it plans as `constant-speed` does from a standstill: a plan of one tick, not of the whole wait."""
    waiting, blind = (AGENTS[name]({}) for name in ("take-turns", "constant-speed"))
    for agent in (waiting, blind):
        agent.start(briefing(name="1"))
    first = next(tick for tick in range(2000) if waiting.act(seen(tick, own(), things())).plan is not None)
    blind.act(seen(0, own(), things()))
    for tick in range(1, 30):
        plans = [agent.act(seen(tick + late, own(), things())).plan for agent, late in ((waiting, first), (blind, 0))]
        assert plans[0] is not None and plans[1] is not None
        assert plans[0].points.tolist() == plans[1].points.tolist()
    assert first == round(0.115 * 60.0 / DT)


def test_two_cavs_of_one_turn_drive_at_the_same_time() -> None:
    """Ids 0 and 8 are both turn 0 of 8: a schedule without enough turns is `constant-speed`."""
    routes = {"0": STRAIGHT, "8": crossing_route("straight", 1)}
    assert drive("take-turns", routes).contacts
    assert not drive("take-turns", {"0": STRAIGHT, "1": crossing_route("straight", 1)}).contacts


@pytest.mark.parametrize(
    ("config", "says"),
    [
        ({"slots": 0}, r"option slots: expected a number in \[1, 64\], found 0"),
        ({"slots": 2.5}, "option slots: expected a whole number, found 2.5"),
        ({"turn": 1.5}, r"option turn: expected a number in \[0, 1\], found 1.5"),
        ({"speed": "fast"}, r"option speed: expected a number in \[1, 40\], found 'fast'"),
    ],
)
def test_unusable_options_of_take_turns_are_refused(config: Mapping[str, float | str], says: str) -> None:
    with pytest.raises(InputError, match=f"agent take-turns: {says}"):
        AGENTS["take-turns"](config)
