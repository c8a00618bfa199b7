"""Takes: a program drives in place of a person; the run folder is one on which every command works."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.takes import (
    PERSON,
    SHARING,
    Branch,
    ProgrammedActions,
    drive_gently,
    drive_take,
    invoke,
    let_drive,
    list_egos,
    load_recorded,
    make_take,
    record_take,
)

from mdrive_sumo.contract import CONTROL_STEP, DRIVER, REMARK, Control
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import reexecute
from mdrive_sumo.runs.takes import Action, DriverChoice, RecordedActions, make_human_spec
from mdrive_sumo.scoring import load_results
from mdrive_sumo.v2x.messages import CAM, TEXT

pytestmark = pytest.mark.usefixtures("in_process")


def list_ticks(record: EpisodeRecord, ego: str, kind: str) -> list[int]:
    return [one.message.tick for one in record.messages if (one.message.sender, one.message.type) == (ego, kind)]


def test_a_take_verifies_and_holds_what_was_done(recorded_take: Path) -> None:
    record = load_recorded(recorded_take)
    first, second = record.ego_ids
    assert [(one.tick, one.note.kind) for one in record.notes if one.ego == first and one.note.kind != "reason"] == [
        (0, DRIVER),
        (0, REMARK),
        (30, DRIVER),
        (60, DRIVER),
    ]
    ticks = [*range(30), *range(60, record.find_ending(first).tick)]
    assert [tuple(record.control_values[tick, 0]) for tick in ticks] == [
        pytest.approx((control.throttle, control.brake, control.steer)) for control in map(drive_gently, ticks)
    ]
    assert list_ticks(record, first, TEXT) == [30, 60, 60]
    assert [one.message.payload.decode() for one in record.messages if one.message.type == TEXT][-1] == "ü"
    last = [record.find_ending(ego).tick for ego in (first, second)]
    assert list_ticks(record, first, CAM) == list(range(0, last[0], 2))  # a change of the driver breaks no rhythm
    assert list_ticks(record, second, CAM) == list(range(0, last[1], 2))
    ended = invoke("verify", recorded_take, "--workers", 1)
    assert ended.exit_code == 0, ended.output
    assert f"taken from the recording: {len(ticks)} ticks of controls of people\n" in ended.stdout
    results = load_results(recorded_take / "results.json")
    assert (results.run.agent, results.run.labels, results.scenarios[0].digest) == (
        "human",
        ("negotiation",),
        record.digest,
    )


@pytest.mark.parametrize("agent", ["sharing", "single", "constant-speed", "omniscient"])
def test_a_substitute_drives_as_the_agent_does(tmp_path: Path, suite: Path, agent: str) -> None:
    run = make_take(tmp_path / "take", suite, make_human_spec((agent,)))
    record = drive_take(run, {ego: ProgrammedActions({0: Action(DriverChoice(agent))}) for ego in list_egos(run)})
    job = replace(run.make_job(run.scenarios[0]), agent=AgentSpec(agent))
    assert record.digest == reexecute(job).digest


def test_a_car_without_v2x_sends_texts_only(tmp_path: Path, suite: Path) -> None:
    run = make_take(tmp_path / "take", suite, make_human_spec(v2x="off"))
    first, *_ = list_egos(run)
    record = drive_take(run, let_drive(list_egos(run), ProgrammedActions({0: Action(PERSON, texts=("hello",))})))
    assert [one.message.type for one in record.messages if one.message.sender == first] == [TEXT]


def test_a_person_who_leaves_ends_as_a_failed_agent(tmp_path: Path, suite: Path) -> None:
    run = make_take(tmp_path / "take", suite)
    record = record_take(run, let_drive(list_egos(run), ProgrammedActions({0: Action(PERSON)}, leaves_at=25)))
    ending = record.find_ending(record.ego_ids[0])
    assert (ending.end, ending.failure, ending.failed_tick) == (End.AGENT_FAILED, FailureReason.LEFT, 25)
    assert ending.text == "the person left at tick 25 (1.25 s)"
    assert record.find_ending(record.ego_ids[1]).end is End.ARRIVED
    ended = invoke("verify", run.folder, "--workers", 1)
    assert ended.exit_code == 0, ended.output
    assert "25 ticks of controls of people" in ended.stdout


def test_a_branch_repeats_its_parent_until_its_tick(tmp_path: Path, suite: Path, recorded_take: Path) -> None:
    parent = load_recorded(recorded_take)
    run = make_take(tmp_path / "take", suite)
    braking = ProgrammedActions({50: Action(PERSON)}, lambda _: Control(0.0, 0.5, 0.0), leaves_at=70)
    first, second = parent.ego_ids
    sources = {
        first: Branch(RecordedActions(parent, first), 50, braking),
        second: Branch(RecordedActions(parent, second), 50, ProgrammedActions({50: Action(SHARING)})),
    }
    record = record_take(run, sources)
    assert (record.digests[:50] == parent.digests[:50]).all()
    assert (record.digests[50:60] != parent.digests[50:60]).any(axis=1).all()
    assert invoke("verify", run.folder, "--workers", 1).exit_code == 0


@pytest.mark.slow
def test_a_run_of_any_agent_is_entered(tmp_path: Path, suite: Path) -> None:
    """Its controls, messages and notes are repeated, whatever wrote them; forged notes of drivers are left out."""
    agent = tmp_path / "agent.py"
    agent.write_text(AGENT)
    run = invoke("eval", "--suite", suite, "--agent", f"{agent}:Talker", "--workers", 1, "--out", tmp_path / "parent")
    assert run.exit_code == 0, run.output
    parent = load_recorded(tmp_path / "parent")
    take = make_take(tmp_path / "take", suite)
    sources = {
        ego: Branch(RecordedActions(parent, ego, is_entered=True), 40, ProgrammedActions({40: Action(SHARING)}))
        for ego in parent.ego_ids
    }
    record = record_take(take, sources)
    assert (record.digests[:40] == parent.digests[:40]).all()
    said = [[one.message for one in episode.messages if one.message.tick < 40] for episode in (parent, record)]
    assert said[0] == said[1] != []
    noted = [
        [one for one in episode.notes if one.tick < 40 and one.note.kind != DRIVER] for episode in (parent, record)
    ]
    assert noted[0] == noted[1] != []
    assert invoke("verify", take.folder, "--workers", 1).exit_code == 0


AGENT = """
from mdrive_sumo import Control, Message, Note, Reply

class Talker:
    label = "negotiation"

    def __init__(self, config):
        pass

    def sensors(self):
        return ()

    def start(self, briefing):
        pass

    def act(self, seen):
        tick = seen.tick
        notes = (Note("thought", f"tick {tick}"), Note("driver", '{"driver":"omniscient"}')) if tick % 7 == 0 else ()
        messages = (Message("mine", bytes([tick % 256])), Message("text", b"hello")) if tick % 5 == 0 else ()
        return Reply(control=Control(0.3 + 0.1 * (tick % 2), 0.0, 0.0), messages=messages, notes=notes)
"""


def test_recorded_controls_are_exact(recorded_take: Path) -> None:
    record = load_recorded(recorded_take)
    source = RecordedActions(record, record.ego_ids[0])
    for tick in range(source.end_tick):
        control = source.read(tick).control
        assert control is not None
        values = np.array((control.throttle, control.brake, control.steer))
        assert (np.rint(values / CONTROL_STEP) == record.controls[tick, 0]).all()
    with pytest.raises(InputError, match="expected a CAV 'x', found none"):
        RecordedActions(record, "x")
