"""Forged and damaged takes, and what no person can do: each is found, and told in one sentence."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from testing.journals import rewrite_journal
from testing.takes import (
    PERSON,
    ProgrammedActions,
    change_control,
    change_note,
    drive_take,
    drop_notes,
    forge,
    invoke,
    let_drive,
    list_egos,
    make_take,
)

from mdrive_sumo.contract import DRIVER, EXCHANGE, REMARK, Control, Note
from mdrive_sumo.core.clock import parse_clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.episode import EpisodeRecord, NoteRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.runs.takes import MAX_CHANGES, Action, DriverChoice, make_human_spec, prepare_take
from mdrive_sumo.v2x.messages import TEXT

pytestmark = pytest.mark.usefixtures("in_process")


def change_text(record: EpisodeRecord) -> EpisodeRecord:
    messages = [
        replace(one, message=replace(one.message, payload=b"something else")) if one.message.type == TEXT else one
        for one in record.messages
    ]
    return replace(record, messages=tuple(messages))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda record: change_control(record, 10), "first difference at tick 10 (0.50 s): the digest differs"),
        (lambda record: change_control(record, 40), "first difference at tick 40 (2.00 s): throttle of"),
        (
            lambda record: change_note(record, 1, '{"config":{"speed":4.0},"driver":"sharing"}'),
            "first difference at tick 3",
        ),
        (lambda record: change_note(record, 0, '{"device":"wheel","driver":"human"} '), "notes of the recording"),
        (lambda record: drop_notes(record, REMARK), "identical"),
        (change_text, "first difference at tick 31"),
    ],
    ids=["person", "agent", "driver", "spelling", "remark", "text"],
)
def test_a_forged_take_is_found(take: Path, change: Callable[[EpisodeRecord], EpisodeRecord], says: str) -> None:
    forge(take, change)
    ended = invoke("verify", take, "--workers", 1)
    assert says in ended.stdout, ended.output
    assert (ended.exit_code == 1) == (says != "identical") or "results.json" in ended.stdout


@pytest.mark.parametrize(
    ("index", "text", "says"),
    [
        (0, "", "tick 0: expected a driver, e.g."),
        (0, "[]", "found '[]'"),
        (0, '{"driver":7}', "expected a driver, e.g."),
        (0, '{"driver":"human","device":"pedalo"}', "expected a device among unknown, keyboard"),
        (0, '{"driver":"human","also":1}', "expected a driver, e.g."),
        (0, "[" * 5000, "expected a driver, e.g."),
        (1, '{"driver":"omniscient","config":{}}', "expected a driver among human, sharing (option substitutes)"),
        (1, '{"driver":"recording"}', "expected a recording to drive from the begin only"),
        (1, '{"driver":"evil.py:Agent","config":{}}', "expected a driver among human, sharing"),
        (1, '{"driver":"sharing","config":{"sped":4}}', "agent sharing: expected options among"),
        (1, '{"driver":"sharing","config":{"range":35}}', "expected options that need no other sensors"),
        (1, '{"driver":"sharing","config":{"weights":"/etc/passwd"}}', "expected options that name no file"),
        (1, '{"driver":"sharing","config":{"detector":["a"]}}', "expected a driver, e.g."),
    ],
)
def test_a_damaged_driver_note_is_one_sentence(take: Path, index: int, text: str, says: str) -> None:
    forge(take, lambda record: change_note(record, index, text))
    ended = invoke("verify", take, "--workers", 1)
    assert (ended.exit_code, ended.stderr.count("\n")) == (2, 1), ended.output
    assert says in ended.stderr
    assert "CAV" in ended.stderr


def test_notes_and_controls_that_no_take_has(take: Path) -> None:
    for change, says in (
        (lambda record: drop_notes(record, DRIVER), "with a driver note in its first tick, found none"),
        (lambda record: change_control(record, 10, 9000), "tick 10: throttle: expected a number in [0, 1], found 1."),
        (
            lambda record: replace(record, notes=(*record.notes, NoteRecord(30, record.ego_ids[0], PERSON.to_note()))),
            "tick 30: expected one driver note, found 2",
        ),
    ):
        before = {path: path.read_bytes() for path in take.rglob("*") if path.is_file()}
        forge(take, change)
        ended = invoke("verify", take, "--workers", 1)
        assert (ended.exit_code, ended.stderr.count("\n"), says in ended.stderr) == (2, 1, True), ended.output
        for path, content in before.items():
            path.write_bytes(content)


def change_agent_config(folder: Path, **options: Any) -> None:
    def change(line: str) -> str:
        header = json.loads(line)
        if "fingerprint" in header:
            config = {**json.loads(header["fingerprint"]["agent_config"]), **options}
            header["fingerprint"]["agent_config"] = json.dumps(config, sort_keys=True, separators=(",", ":"))
        return json.dumps(header)

    rewrite_journal(folder / "journal.jsonl", change)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"substitutes": "colmdriver"}, "expected agents without a language model, found 'colmdriver'"),
        ({"substitutes": "human"}, "expected built-in agents (stationary, "),
        ({"substitutes": "shring"}, "did you mean 'sharing'?"),
        ({"substitutes": "evil.py:Agent"}, "expected built-in agents (stationary, "),
        ({"substitutes": "idm"}, "whose sensor 'objects' is another one"),
        ({"substitutes": 3}, "expected names with commas between them, found 3"),
        ({"v2x": "loud"}, "option v2x: expected one of sharing, off"),
        ({"endpoint": "http://127.0.0.1:1"}, "expected options among"),
        ({"latency_ms": float("inf")}, "option latency_ms: expected a number in [0, 60000]"),
    ],
)
def test_a_stranger_chooses_no_other_agents(take: Path, options: dict[str, Any], says: str) -> None:
    change_agent_config(take, **options)
    ended = invoke("verify", take, "--workers", 1)
    assert (ended.exit_code, ended.stderr.count("\n"), says in ended.stderr) == (2, 1, True), ended.output


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Action(control=Control(float("nan"), 0.0, 0.0)), "throttle: expected a number in [0, 1], found nan"),
        (lambda: Action(control=Control(0.0, 0.0, -1.01)), "steer: expected a number in [-1, 1], found -1.01"),
        (lambda: Action(control=Control(0.0, "full", 0.0)), "brake: expected a number in [0, 1], found 'full'"),  # type: ignore[arg-type]
        (lambda: Action(texts=("x" * 8193,)), "text: expected at most 8192 bytes, found 8193"),
        (lambda: Action(texts=("\ud800",)), "text: expected Unicode text, found a lone surrogate"),
        (lambda: Action(texts=("x",) * 9), "texts: expected at most 8 in a tick, found 9"),
        (lambda: DriverChoice("human", {"speed": 3.0}), "driver human: expected a device among"),
    ],
)
def test_an_action_that_no_person_can_take(make: Callable[[], object], says: str) -> None:
    with pytest.raises(InputError) as error:
        make()
    assert str(error.value).startswith(says)


def test_a_program_that_drives_wrongly_is_told(tmp_path: Path, suite: Path) -> None:
    run = make_take(tmp_path / "take", suite)
    for actions, says in (
        ({}, "tick 0: expected a driver, found none"),
        ({0: Action(PERSON, notes=(Note(EXCHANGE, ""),))}, f"expected notes of kind {REMARK}, found '{EXCHANGE}'"),
        ({0: Action(PERSON, notes=(PERSON.to_note(),))}, f"expected notes of kind {REMARK}, found '{DRIVER}'"),
    ):
        with pytest.raises(InputError) as error:
            drive_take(run, let_drive(list_egos(run), ProgrammedActions(actions)))
        assert says in str(error.value)


def test_a_car_changes_its_driver_at_most_so_often(tmp_path: Path, suite: Path) -> None:
    run = make_take(tmp_path / "take", suite)
    changes = {tick: Action(PERSON) for tick in range(MAX_CHANGES + 1)}
    still = ProgrammedActions(changes, lambda _: Control(0.0, 1.0, 0.0))
    record = drive_take(run, let_drive(list_egos(run), still))
    ending = record.find_ending(record.ego_ids[0])
    assert (ending.failure, ending.failed_tick) == (FailureReason.INVALID, MAX_CHANGES)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"agent": AgentSpec("idm")}, "take: expected the agent human and no others, found idm"),
        (
            {"options": EpisodeOptions(clock=parse_clock("fixed:100"))},
            "expected the agent clock ideal, found fixed:100",
        ),
        ({"seeds": (0, 1)}, "take: expected a folder, one seed and a recording"),
        ({"out": None}, "take: expected a folder, one seed and a recording"),
        ({"scenario": "nothing"}, "nothing"),
    ],
)
def test_a_take_is_one_episode_of_people(tmp_path: Path, suite: Path, changes: dict[str, Any], says: str) -> None:
    config = RunConfig(suite=str(suite), scenario="i01_*", agent=make_human_spec(), out=tmp_path / "take")
    with pytest.raises(InputError) as error:
        prepare_take(replace(config, **changes))
    assert says in str(error.value)


def test_no_evaluation_has_a_person(suite: Path, tmp_path: Path) -> None:
    for words in (("--agent", "human"), ("--agent", "idm", "--others", "human")):
        ended = invoke("eval", "--suite", suite, *words, "--out", tmp_path / "run")
        assert (ended.exit_code, ended.stderr.count("\n")) == (2, 1)
        assert "found a person, who drives with `mdrive-sumo drive`" in ended.stderr
