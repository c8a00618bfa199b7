"""What the process of a third-party agent can find out about the scenario's ids of CAVs: nothing."""

from pathlib import Path

import pytest
from testing import carla_agents
from testing.worlds import EmptyWorld, straight_ego, straight_road, straight_scenario

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.open_agents import open_agents

pytestmark = pytest.mark.slow

CAVS = ("zulu", "alpha")
SCENARIO = straight_scenario(straight_ego(CAVS[0], x=60, length=4), straight_ego(CAVS[1], x=10, length=4))
SPY = """
import os, sys, glob, pickle
from mdrive_sumo.contract import Control, Message, Note, Reply, SensorSpec
class Spy:
    label = "single"
    def __init__(self, config): self.found = [repr(config), repr(sys.argv), repr(dict(os.environ))]
    def sensors(self): return (SensorSpec("objects"), SensorSpec("privileged"))
    def start(self, briefing): self.found.append(repr(briefing))
    def act(self, seen):
        self.found.append(repr(seen))
        for path in glob.glob("/proc/self/fd/*"):
            try:
                self.found.append(os.readlink(path))
            except OSError:
                pass
        self.found.append(open("/proc/self/cmdline").read())
        notes = (Note("pid", str(os.getpid())), Note("found", chr(10).join(self.found)[-30000:]))
        return Reply(control=Control(0.5, 0.0, 0.0), messages=(Message("text", b"hello"),), notes=notes)
"""


def drive(spec: AgentSpec, logs: Path) -> EpisodeRecord:
    config = EpisodeConfig(SCENARIO, straight_road(), seed=0)
    with open_agents(spec, config.cav_pseudonyms, logs) as drivers:
        return run_episode(config, EmptyWorld(), drivers)


def test_a_process_sees_no_id_of_the_scenario_and_logs_have_them(tmp_path: Path) -> None:
    (tmp_path / "spy.py").write_text(SPY)
    episode = drive(AgentSpec(f"{tmp_path}/spy.py:Spy"), tmp_path / "s")
    told = {name: pseudonym for pseudonym, name in episode.pseudonyms.items()}
    found = {note.ego: note.note.text for note in episode.notes if note.note.kind == "found"}
    assert set(found) == set(CAVS)
    for ego, text in found.items():
        assert told[ego] in text and "hello" in text
        assert not any(name in text for name in CAVS)
    assert {path.name for path in tmp_path.glob("*.log")} == {f"s.{ego}.log" for ego in CAVS}
    pids = {note.ego: int(note.note.text) for note in episode.notes if note.note.kind == "pid"}
    assert sorted(CAVS, key=pids.__getitem__) == sorted(CAVS, key=told.__getitem__), (
        "started in the order of pseudonyms"
    )


def test_a_joint_program_gets_pseudonyms(tmp_path: Path) -> None:
    path = carla_agents.plain(tmp_path, "good")
    path.write_text(path.read_text() + "\nimport gc, sys\n" + PRINTER)
    episode = drive(AgentSpec(f"carla:{path}"), tmp_path / "s")
    printed = (tmp_path / "s.all.log").read_text()
    assert all(told in printed for told in episode.pseudonyms)
    assert not any(name in printed for name in CAVS)


PRINTER = """
from mdrive_sumo.agent_process.carla_adapter import CarlaAgentAdapter
def spy(name):
    method = getattr(CarlaAgentAdapter, name)
    def call(self, *arguments):
        print(name, repr(self.__dict__)[:3000], repr(arguments)[:3000])
        return method(self, *arguments)
    setattr(CarlaAgentAdapter, name, call)
for name in ("sensors", "start", "act"):
    spy(name)
"""
