"""The replay page shows the scenario's ids in messages and notes, whatever ids the agents knew."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from testing.worlds import EmptyWorld, Says, pedals, straight_ego, straight_road, straight_scenario

from mdrive_sumo.contract import Note, Observation, Reply
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.report.replay_messages import build_message_tables
from mdrive_sumo.report.replay_notes import list_notes
from mdrive_sumo.v2x.messages import Direction, Intention, Mcm, ReferencePose, encode

NAMES = ("first", "second")
SCENARIO = straight_scenario(*(straight_ego(name, x=10 + 40 * i, length=4) for i, name in enumerate(NAMES)))


class Negotiator(Says):
    """Asks everyone that it hears to stop, in an MCM, a text and two notes."""

    def act(self, seen: Observation) -> Reply:
        assert self.briefing is not None
        own, me = seen.own, self.briefing.ego_id
        names = sorted({me, *(message.sender for message in seen.messages)})
        pose = ReferencePose(own.x, own.y, own.yaw, seen.tick)
        line = np.array([(own.x + 1, own.y)])
        asked, answers = dict.fromkeys(names, Intention.STOP), dict.fromkeys(set(names) - {me}, True)
        mcm = Mcm(pose, own.speed, Intention.KEEP, Direction.FOLLOW, 0.2, line, line, asked, answers, tuple(names))
        text = f"{me}: stop, {' and '.join(names)}, x{me}x"
        notes = (Note("why", text), Note("claims", json.dumps({"asks": names})))
        return replace(pedals(throttle=0.5), messages=(encode(mcm), encode(text)), notes=notes)


def drive(ids: str) -> EpisodeRecord:
    config = EpisodeConfig(SCENARIO, straight_road(), 0, options=EpisodeOptions.parse(ids=ids))
    drivers = {name: LocalDriver(Negotiator(lambda seen: pedals())) for name in NAMES}
    return run_episode(config, EmptyWorld(), drivers)


def shown(episode: EpisodeRecord) -> dict[str, Any]:
    header, _ = build_message_tables(episode, SCENARIO, np.zeros(2))
    return {"header": header, "notes": list_notes(episode)}


def test_the_page_is_the_same_for_both_kinds_of_ids() -> None:
    random, scenario = drive("random"), drive("scenario")
    assert random.pseudonyms and not scenario.pseudonyms
    hidden = {f"x{told}x": f"x{name}x" for told, name in random.pseudonyms.items()}  # no word of its own: stays
    page = json.dumps(shown(random))
    assert all(told in page for told in hidden), "only whole words are translated"
    for told, name in hidden.items():
        page = page.replace(told, name)
    there = shown(scenario)
    assert json.loads(page)["header"]["terms"] == json.loads(json.dumps(there["header"]["terms"]))
    words = {tuple(sorted(text.replace(",", "").split())) for _, text in json.loads(page)["header"]["texts"]}
    assert words == {tuple(sorted(text.replace(",", "").split())) for _, text in there["header"]["texts"]}
    assert not any(told in json.dumps(json.loads(page)["notes"]) for told in random.pseudonyms)


@pytest.mark.parametrize("ids", ["random", "scenario"])
def test_all_stations_are_named_by_the_scenario(ids: str) -> None:
    terms = shown(drive(ids))["header"]["terms"]
    named = {name for asked, answers, group, _ in terms for name in (*dict(asked), *dict(answers), *group)}
    assert named == set(NAMES)
