"""What reports tell of a take: who drove when, what the person did, and that a person left."""

from pathlib import Path

import pytest
from testing.takes import (
    PERSON,
    SHARING,
    ProgrammedActions,
    change_note,
    forge,
    invoke,
    let_drive,
    list_egos,
    load_recorded,
    make_take,
    record_take,
)

from mdrive_sumo.contract import Control
from mdrive_sumo.core.state import DT
from mdrive_sumo.report.replay_notes import list_notes
from mdrive_sumo.runs.takes import Action

pytestmark = pytest.mark.usefixtures("in_process")


def brake_once(tick: int) -> Control:
    return Control(0.0, 0.7, 0.0) if 40 <= tick < 70 else Control(0.5, 0.0, 0.0)


@pytest.fixture(scope="module")
def left_take(tmp_path_factory: pytest.TempPathFactory, suite: Path) -> Path:
    """A person brakes, hands over to `sharing`, takes over again and leaves."""
    run = make_take(tmp_path_factory.mktemp("left") / "take", suite)
    actions = {0: Action(PERSON), 90: Action(SHARING, texts=("you go first",)), 110: Action(PERSON)}
    record_take(run, let_drive(list_egos(run), ProgrammedActions(actions, brake_once, leaves_at=115)))
    return run.folder


def explain(folder: Path, cav: str, *more: str | int) -> list[str]:
    ended = invoke("explain", folder, "--scenario", "i01_*", "--cav", cav, *more)
    assert ended.exit_code == 0, ended.output
    return ended.stdout.splitlines()


def test_explain_tells_who_drove(left_take: Path) -> None:
    head, *lines = explain(left_take, "0")
    assert "(agent human, seed 0): agent-failed" in head
    told = [line.strip() for line in lines]
    assert told[:2] == ["0.0 s  is driven by a person (script)", "0.0 s  the person departs"]
    assert any("the person brakes from" in line for line in told)
    assert "4.5 s  is handed over by the person to sharing" in told
    assert '4.5 s  says "you go first"' in told
    assert "5.5 s  is taken over by a person (script) from sharing" in told
    assert told[-1].endswith("is out: the person left at tick 115 (5.75 s)")
    after = [line for line in told if float(line.split(" s ")[0]) > 115 * DT]
    assert not [line for line in after if "the person brakes" in line]  # it is the car that brakes


def test_explain_tells_the_driver_of_a_moment(left_take: Path) -> None:
    assert explain(left_take, "0", "--tick", 60)[1] == "It is driven by a person (script), since 0.0 s (tick 0)."
    by_agent = explain(left_take, "0", "--tick", 100)
    assert by_agent[1] == "It is driven by sharing, since 4.5 s (tick 90)."
    assert not [line for line in explain(left_take, "0", "--tick", 116) if "driven by" in line]


def test_reasons_of_an_agent_end_with_its_drive(recorded_take: Path) -> None:
    record = load_recorded(recorded_take)
    reasons = [one.tick for one in record.notes if one.note.kind == "reason" and one.ego == record.ego_ids[0]]
    assert reasons and all(30 <= tick < 60 for tick in reasons)
    for tick in (20, 70):
        assert not [line for line in explain(recorded_take, record.ego_ids[0], "--tick", tick) if "noted" in line]


def test_a_replay_lists_the_drivers(recorded_take: Path) -> None:
    record = load_recorded(recorded_take)
    rows = [(tick, text) for tick, ego, kind, text, _ in list_notes(record) if kind == "driver" and ego == "0"]
    assert rows == [(0, "driven by a person (script)"), (30, "driven by sharing"), (60, "driven by a person (script)")]


def test_a_damaged_driver_is_left_out(take: Path) -> None:
    forge(take, lambda record: change_note(record, 1, "\x1b[2J"))
    assert "  1.5 s  is handed" not in "\n".join(explain(take, "0"))
    rows = [text for _, ego, kind, text, _ in list_notes(load_recorded(take)) if kind == "driver" and ego == "0"]
    assert rows[1] == "\x1b[2J"  # as every note; the page escapes it


def test_a_person_who_left_is_no_failed_program(left_take: Path) -> None:
    ended = invoke("show", left_take)
    assert "A PERSON LEFT in 1 of 1 episodes (1 CAVs)" in ended.stdout
    assert "THE AGENT FAILED" not in ended.stdout


@pytest.mark.parametrize(
    "words",
    [
        ("rescore", "{take}", "--score-mode", "interdrive_fixed"),
        ("report", "{take}", "--out", "{out}"),
        ("export", "{take}", "--format", "csv", "--out", "{out}"),
        ("compare", "{take}", "{left}"),
        ("list", "runs", "{take}"),
        ("view", "{take}", "--export", "{out}"),
        ("view", "{take}", "{left}", "--export", "{out}"),
        ("render", "{take}", "--tick", "35", "--size", "320x180", "--out", "{out}.png"),
        ("eval-open", "--reference", "{take}", "--agent", "constant-speed", "--out", "{out}"),
    ],
)
def test_commands_for_runs_take_takes(take: Path, left_take: Path, tmp_path: Path, words: tuple[str, ...]) -> None:
    ended = invoke(*(word.format(take=take, left=left_take, out=tmp_path / "out.html") for word in words))
    assert ended.exit_code == 0, ended.output
    if words[0] == "rescore":
        assert invoke("verify", take, "--workers", 1).exit_code == 0
